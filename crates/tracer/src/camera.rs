//! Camera rays: from a point of the image to a ray in the world.

use crate::scene::{Camera, Projection};
use glam::{DAffine3, DVec2, DVec3};

/// A camera with the shape of one picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pinhole {
    to_world: DAffine3,
    /// Half the sides of what is seen: at distance 1, or everywhere.
    half: DVec2,
    parallel: bool,
}

impl Pinhole {
    /// `camera` for a picture of `width` by `height` square pixels. What is seen
    /// from top to bottom is the camera's; what from left to right follows.
    pub(crate) fn new(camera: &Camera, width: usize, height: usize) -> Self {
        let (half_height, parallel) = match camera.projection {
            Projection::Perspective { yfov } => ((0.5 * yfov).tan(), false),
            Projection::Orthographic { half_height } => (half_height, true),
        };
        let half_width = half_height * width as f64 / height as f64;
        Self { to_world: camera.transform, half: DVec2::new(half_width, half_height), parallel }
    }

    /// Origin and unit direction of the ray through (x, y), which run from
    /// (0, 0) at the image's upper left to (1, 1) at its lower right.
    pub(crate) fn ray(&self, x: f64, y: f64) -> (DVec3, DVec3) {
        let at = DVec2::new(2.0 * x - 1.0, 1.0 - 2.0 * y) * self.half;
        let (origin, direction) = if self.parallel {
            (at.extend(0.0), DVec3::NEG_Z)
        } else {
            (DVec3::ZERO, at.extend(-1.0))
        };
        let direction = self.to_world.transform_vector3(direction).normalize();
        (self.to_world.transform_point3(origin), direction)
    }

    /// The ray through (x, y), with neighbours `step` to the right and below.
    pub(crate) fn beam(&self, x: f64, y: f64, step: DVec2) -> Beam {
        let (origin, direction) = self.ray(x, y);
        Beam { origin, direction, beside: [self.ray(x + step.x, y), self.ray(x, y + step.y)] }
    }
}

/// A ray with its two neighbours, which say how far apart neighbouring samples are
/// (H. Igehy, *Tracing Ray Differentials*, SIGGRAPH 1999). The neighbours follow
/// the ray as if every surface were flat.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Beam {
    pub(crate) origin: DVec3,
    /// Unit.
    pub(crate) direction: DVec3,
    /// Origin and unit direction of the neighbours, right and below; the ray's own
    /// for a ray without extent.
    pub(crate) beside: [(DVec3, DVec3); 2],
}

impl Beam {
    /// A ray without extent.
    #[cfg(test)]
    pub(crate) fn thin(origin: DVec3, direction: DVec3) -> Self {
        Self { origin, direction, beside: [(origin, direction); 2] }
    }

    /// From `position` to where the neighbours meet the plane through it with this
    /// `normal`; zero for one that does not.
    pub(crate) fn footprint(&self, position: DVec3, normal: DVec3) -> [DVec3; 2] {
        self.beside.map(|(origin, direction)| {
            let t = (position - origin).dot(normal) / direction.dot(normal);
            if t > 0.0 && t.is_finite() { origin + t * direction - position } else { DVec3::ZERO }
        })
    }

    /// The beam that leaves the plane through `position` with this `normal` in the
    /// directions to which `turn` takes those of this one.
    pub(crate) fn turned(
        &self,
        position: DVec3,
        normal: DVec3,
        turn: impl Fn(DVec3) -> DVec3,
    ) -> Self {
        let offsets = self.footprint(position, normal);
        let beside = [0, 1].map(|i| (position + offsets[i], turn(self.beside[i].1)));
        Self { origin: position, direction: turn(self.direction), beside }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    fn camera(transform: DAffine3, projection: Projection) -> Camera {
        Camera { name: String::new(), transform, projection, aspect: None }
    }

    #[test]
    fn rays_span_the_field_of_view_about_minus_z() {
        let place = DAffine3::from_translation(DVec3::new(1.0, 2.0, 3.0));
        let camera = camera(place, Projection::Perspective { yfov: FRAC_PI_2 });
        let pinhole = Pinhole::new(&camera, 200, 100);
        let close = |a: DVec3, b: DVec3| a.distance(b.normalize()) < 1e-15;
        let (origin, centre) = pinhole.ray(0.5, 0.5);
        assert_eq!(origin, DVec3::new(1.0, 2.0, 3.0));
        assert!(close(centre, DVec3::NEG_Z), "{centre}");
        let (_, top) = pinhole.ray(0.5, 0.0);
        assert!(close(top, DVec3::new(0.0, 1.0, -1.0)), "{top}");
        let (_, right) = pinhole.ray(1.0, 0.5);
        assert!(close(right, DVec3::new(2.0, 0.0, -1.0)), "{right}");
    }

    #[test]
    fn camera_turns_with_its_transform() {
        let turn = DAffine3::from_rotation_y(FRAC_PI_2);
        let camera = camera(turn, Projection::Perspective { yfov: 1.0 });
        let (_, ahead) = Pinhole::new(&camera, 4, 3).ray(0.5, 0.5);
        assert!(ahead.distance(DVec3::NEG_X) < 1e-15, "{ahead}");
    }

    #[test]
    fn orthographic_rays_are_parallel_and_span_the_magnification() {
        let place = DAffine3::from_translation(DVec3::new(1.0, 2.0, 3.0));
        let camera = camera(place, Projection::Orthographic { half_height: 0.5 });
        let pinhole = Pinhole::new(&camera, 200, 100);
        let corner = pinhole.ray(1.0, 0.0);
        assert_eq!(corner, (DVec3::new(2.0, 2.5, 3.0), DVec3::NEG_Z));
        assert_eq!(pinhole.ray(0.5, 0.5), (DVec3::new(1.0, 2.0, 3.0), DVec3::NEG_Z));
    }

    #[test]
    fn neighbours_spread_with_distance_and_slant() {
        let camera = camera(DAffine3::IDENTITY, Projection::Perspective { yfov: FRAC_PI_2 });
        let pinhole = Pinhole::new(&camera, 100, 100);
        let beam = pinhole.beam(0.5, 0.5, DVec2::splat(0.01));
        // A pixel is 0.02 wide at distance 1, and twice as long on a plane at 60°.
        let facing = beam.footprint(DVec3::NEG_Z * 4.0, DVec3::Z);
        assert!(facing[0].abs_diff_eq(DVec3::X * 0.08, 1e-12), "{}", facing[0]);
        assert!(facing[1].abs_diff_eq(DVec3::NEG_Y * 0.08, 1e-12), "{}", facing[1]);
        let tilted = DVec3::new(3.0_f64.sqrt(), 0.0, 1.0) / 2.0;
        let length = beam.footprint(DVec3::NEG_Z * 4.0, tilted)[0].length();
        assert!((length - 0.16).abs() < 0.01, "{length}");
        // A mirror half way leaves the spread of the whole path.
        let at = DVec3::NEG_Z * 2.0;
        let back = beam.turned(at, DVec3::Z, |d| DVec3::new(d.x, d.y, -d.z));
        let seen = back.footprint(DVec3::ZERO, DVec3::Z);
        assert!(seen[0].abs_diff_eq(DVec3::X * 0.08, 1e-12), "{}", seen[0]);
    }
}
