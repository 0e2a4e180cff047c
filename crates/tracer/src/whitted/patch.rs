//! Radiance that baked surfaces send, as the ray tree asks for it.

use super::Sample;
use crate::{accel::Hit, camera::Beam};
use glam::{DVec2, DVec3, Vec3};

/// Radiance that is looked up instead of gathered.
pub(crate) trait PatchRadiance: Sync {
    /// Radiance that leaves `position`, on a mesh's triangle seen from its
    /// front, along the unit vector `to_eye`: what the surface reflects of the
    /// area emitters. `None` if no patch lies there.
    fn outgoing(
        &self,
        mesh: usize,
        triangle: u32,
        position: DVec3,
        to_eye: DVec3,
        sample: &Sample,
    ) -> Option<Vec3>;

    /// The same for a camera ray that stands for a part of the picture, as wide as from
    /// it to its neighbours `beside`: by default that of its middle.
    fn outgoing_over(
        &self,
        mesh: usize,
        triangle: u32,
        position: DVec3,
        to_eye: DVec3,
        _beside: &[Beside; 2],
        sample: &Sample,
    ) -> Option<Vec3> {
        self.outgoing(mesh, triangle, position, to_eye, sample)
    }

    /// Relative RMS error of the radiance of a triangle's patch, if it has one.
    fn error(&self, _mesh: usize, _triangle: u32) -> Option<f64> {
        None
    }

    /// Where on the patch of a triangle `position` is, in [0, 1]².
    fn place(&self, _mesh: usize, _triangle: u32, _position: DVec3) -> Option<DVec2> {
        None
    }
}

/// What a neighbouring camera ray sees of the same surface, less what the ray itself
/// does.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Beside {
    pub(crate) position: DVec3,
    /// Of the unit vectors to the eye.
    pub(crate) to_eye: DVec3,
}

/// What the neighbours of `beam` see of the plane that it hits.
pub(super) fn beside(beam: &Beam, hit: &Hit) -> [Beside; 2] {
    let positions = beam.footprint(hit.position, hit.normal);
    [0, 1].map(|i| Beside { position: positions[i], to_eye: beam.direction - beam.beside[i].1 })
}
