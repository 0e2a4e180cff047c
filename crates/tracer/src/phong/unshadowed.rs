//! Light before anybody asks whether something is in its way.

use super::Surface;
use crate::accel::Accel;
use glam::{DVec3, Vec3};

/// What a surface reflects to the eye of one light, or of one part of it, where nothing
/// stands between the two.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Unshadowed {
    /// Reflected radiance.
    pub(crate) radiance: Vec3,
    pub(crate) source: Source,
}

/// Where light comes from.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Source {
    /// A point of the world.
    Point(DVec3),
    /// From infinity: the unit vector towards it.
    Direction(DVec3),
}

impl Unshadowed {
    /// What arrives of it at `surface`: the radiance, less what is in its way. Casts one
    /// ray and counts it in `rays`.
    pub(crate) fn shadowed(&self, surface: &Surface<'_>, accel: &Accel, rays: &mut u64) -> Vec3 {
        *rays += 1;
        let start = accel.leave(surface.position, surface.geometric, surface.geometric);
        let visible = match self.source {
            Source::Point(point) => accel.visibility(start, point),
            Source::Direction(to_light) => accel.visibility_along(start, to_light, f64::INFINITY),
        };
        self.radiance * visible
    }
}
