//! Camera rays: from a point of the image to a ray in the world.

use crate::scene::Camera;
use glam::{DAffine3, DVec3};

/// A camera with the shape of one picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pinhole {
    to_world: DAffine3,
    /// Half the image plane's sides at distance 1.
    half_width: f64,
    half_height: f64,
}

impl Pinhole {
    /// `camera` for a picture of `width` by `height` square pixels. The vertical
    /// field of view is the camera's; the horizontal one follows.
    pub(crate) fn new(camera: &Camera, width: usize, height: usize) -> Self {
        let half_height = (0.5 * camera.yfov).tan();
        let half_width = half_height * width as f64 / height as f64;
        Self { to_world: camera.transform, half_width, half_height }
    }

    /// Origin and unit direction of the ray through (x, y), which run from
    /// (0, 0) at the image's upper left to (1, 1) at its lower right.
    pub(crate) fn ray(&self, x: f64, y: f64) -> (DVec3, DVec3) {
        let (right, up) = (2.0 * x - 1.0, 1.0 - 2.0 * y);
        let local = DVec3::new(right * self.half_width, up * self.half_height, -1.0);
        (self.to_world.translation, (self.to_world.matrix3 * local).normalize())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn rays_span_the_field_of_view_about_minus_z() {
        let camera = Camera {
            name: String::new(),
            transform: DAffine3::from_translation(DVec3::new(1.0, 2.0, 3.0)),
            yfov: FRAC_PI_2,
            aspect: None,
        };
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
        let camera = Camera {
            name: String::new(),
            transform: DAffine3::from_rotation_y(FRAC_PI_2),
            yfov: 1.0,
            aspect: None,
        };
        let (_, ahead) = Pinhole::new(&camera, 4, 3).ray(0.5, 0.5);
        assert!(ahead.distance(DVec3::NEG_X) < 1e-15, "{ahead}");
    }
}
