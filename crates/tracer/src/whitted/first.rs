//! What camera rays meet first, for compositing.

use super::{MAX_LAYERS, Whitted};
use crate::{camera::Beam, phong::Surface};
use glam::{DVec3, Vec2, Vec3};

/// What a camera ray meets first, for compositing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct First {
    /// k_d + k_s with textures: what is reflected of light from everywhere.
    pub(crate) albedo: Vec3,
    /// Unit, towards the eye.
    pub(crate) normal: Vec3,
    pub(crate) position: Vec3,
    /// Distance from the camera along its axis, metres.
    pub(crate) depth: f32,
    /// The mesh's number from 1.
    pub(crate) object: u32,
    /// Where on a wavelet patch.
    pub(crate) wct_uv: Option<Vec2>,
    /// [`PatchRadiance::error`](super::PatchRadiance::error) of that.
    pub(crate) wct_error: Option<f32>,
}

impl Whitted<'_> {
    /// What `beam` meets first, with depth along the unit vector `ahead`; surfaces
    /// with alpha count where they hide half or more.
    pub(crate) fn first(&self, beam: &Beam, ahead: DVec3) -> Option<First> {
        let mut from = 0.0;
        let hit = (0..MAX_LAYERS).find_map(|_| {
            let hit = self.next(beam, from);
            from = hit.map_or(f64::INFINITY, |hit| hit.t);
            hit.filter(|hit| hit.opacity >= 0.5)
        })?;
        let footprint = beam.footprint(hit.position, hit.normal);
        let surface = Surface::over(self.scene, &hit, -beam.direction, footprint);
        let patches = self.patches.filter(|_| hit.front);
        let uv = patches.and_then(|p| p.place(hit.mesh, hit.triangle, hit.position));
        Some(First {
            albedo: surface.colour + surface.specular,
            normal: surface.normal.as_vec3(),
            position: hit.position.as_vec3(),
            depth: (hit.t * beam.direction.dot(ahead)) as f32,
            object: hit.mesh as u32 + 1,
            wct_uv: uv.map(|uv| uv.as_vec2()),
            wct_error: patches
                .and_then(|p| p.error(hit.mesh, hit.triangle))
                .map(|error| error as f32),
        })
    }
}
