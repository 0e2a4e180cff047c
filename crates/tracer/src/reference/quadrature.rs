//! The radiance of patches by a midpoint rule over the emitters' cells: no noise,
//! and textures averaged over the cells beforehand.

use super::receivers_of;
use crate::bake::{self, Receiver};
use crate::scene::Scene;
use crate::whitted::{PatchRadiance, Sample};
use glam::{DVec3, Vec3};
use wrt_core::{Emission, Polygon, gather};

/// Emitters of 4^level cells each, and the receivers that they light.
pub(crate) struct Quadrature {
    emitters: Vec<(Polygon, Emission)>,
    cells: u32,
    pub(crate) receivers: Vec<Receiver>,
    triangles: Vec<Vec<Option<u32>>>,
}

impl Quadrature {
    /// # Errors
    ///
    /// If nothing receives, or a polygon cannot be used; by name.
    pub(crate) fn new(scene: &Scene, level: u8) -> anyhow::Result<Self> {
        let receivers = bake::receivers(scene, &mut Vec::new())?;
        let emitters = bake::emissions(scene, Some(level))?;
        let triangles = receivers_of(scene, &receivers);
        Ok(Self { emitters, cells: 1 << level, receivers, triangles })
    }

    /// Whether this triangle is part of a receiver.
    pub(crate) fn covers(&self, mesh: usize, triangle: u32) -> bool {
        self.triangles[mesh][triangle as usize].is_some()
    }
}

impl PatchRadiance for Quadrature {
    fn outgoing(
        &self,
        mesh: usize,
        triangle: u32,
        position: DVec3,
        to_eye: DVec3,
        _: &Sample,
    ) -> Option<Vec3> {
        let i = self.triangles[mesh][triangle as usize]?;
        let receiver = &self.receivers[i as usize];
        let frame = receiver.polygon.frame();
        let eye = frame.to_local(to_eye).normalize();
        (eye.z > 0.0).then(|| {
            let found = gather(&self.emitters, frame, position, &receiver.phong, eye, self.cells);
            DVec3::from(found).as_vec3()
        })
    }
}
