//! What transport needs to know of two polygons: q_s ↔ q_d (§7.1.1, §7.2.3).

use crate::Polygon;
use glam::{DMat3, DVec2, DVec3};

/// A source and a destination polygon, and where the one stands in the frame of
/// the other (the paper's `TransportGeometry`, Fig. 8).
///
/// A destination direction μ points *towards* the source; the light travels
/// along −μ. For a given μ the map of positions is a parallel projection.
#[derive(Clone, Debug)]
pub struct TransportGeometry {
    source: Polygon,
    dest: Polygon,
    /// Source frame to destination frame (`tfR`).
    rotation: DMat3,
    /// The source frame's origin in the destination frame.
    offset: DVec3,
}

impl TransportGeometry {
    /// The geometry of light that leaves `source`'s front for `dest`'s front.
    #[must_use]
    pub fn new(source: Polygon, dest: Polygon) -> Self {
        let (s, d) = (source.frame(), dest.frame());
        let rotation = DMat3::from_cols(d.to_local(s.x), d.to_local(s.y), d.to_local(s.n));
        // The difference first: far from the world's origin it is small and exact.
        let offset = d.to_local(s.origin - d.origin);
        Self { source, dest, rotation, offset }
    }

    /// The polygon that light leaves.
    #[must_use]
    pub fn source(&self) -> &Polygon {
        &self.source
    }

    /// The polygon that light reaches.
    #[must_use]
    pub fn dest(&self) -> &Polygon {
        &self.dest
    }

    /// x̂, ŷ and n̂ of the source in the destination's frame.
    #[must_use]
    pub fn source_axes(&self) -> [DVec3; 3] {
        [self.rotation.x_axis, self.rotation.y_axis, self.rotation.z_axis]
    }

    /// A point of the source's plane in the destination's frame.
    #[must_use]
    pub fn source_to_dest(&self, point: DVec2) -> DVec3 {
        self.offset + self.rotation.x_axis * point.x + self.rotation.y_axis * point.y
    }

    /// The direction of travel, in the source's frame, of light that arrives from
    /// `mu`; its z is positive if it leaves the source's front.
    #[must_use]
    pub fn source_direction(&self, mu: DVec3) -> DVec3 {
        self.rotation.transpose() * -mu
    }

    /// Where the ray from `point` of the destination's plane towards `mu` meets
    /// the source's plane (in that plane's coordinates), if it meets it ahead and
    /// on its front.
    #[must_use]
    pub fn source_point(&self, point: DVec2, mu: DVec3) -> Option<DVec2> {
        let n = self.rotation.z_axis;
        let (speed, height) = (n.dot(mu), n.dot(point.extend(0.0) - self.offset));
        if !(speed < 0.0 && height > 0.0) {
            return None;
        }
        let hit = point.extend(0.0) - mu * (height / speed) - self.offset;
        Some(DVec2::new(hit.dot(self.rotation.x_axis), hit.dot(self.rotation.y_axis)))
    }
}
