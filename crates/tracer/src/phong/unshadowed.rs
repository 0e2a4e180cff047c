//! Light before anybody asks whether something is in its way.

#[cfg(test)]
use super::Surface;
#[cfg(test)]
use crate::accel::Accel;
use crate::accel::SHADOW_REACH;
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
    /// A point of the world that was drawn by chance and stands for others beside it.
    Drawn(DVec3),
    /// From infinity: the unit vector towards it.
    Direction(DVec3),
}

impl Source {
    /// The unit vector from `start` towards it, and how far to look for what is in the
    /// way.
    pub(crate) fn seen_from(self, start: DVec3) -> (DVec3, f64) {
        match self {
            Self::Direction(to_light) => (to_light, f64::INFINITY),
            Self::Point(point) | Self::Drawn(point) => {
                let path = point - start;
                let length = path.length();
                // Nothing is between two points that are one.
                let along = if length > 0.0 { path / length } else { DVec3::Z };
                (along, length * SHADOW_REACH)
            }
        }
    }
}

impl Unshadowed {
    /// What arrives of it at `surface`: the radiance, less what is in its way.
    #[cfg(test)]
    pub(crate) fn shadowed(&self, surface: &Surface<'_>, accel: &Accel) -> Vec3 {
        let start = accel.leave(surface.position, surface.geometric, surface.geometric);
        let (along, reach) = self.source.seen_from(start);
        self.radiance * accel.visibility_along(start, along, reach)
    }
}
