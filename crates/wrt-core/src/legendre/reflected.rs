//! The radiance that a surface reflects of what shines on it, straight from there
//! (Eq. 1), for projection.

use super::Radiance;
use crate::beams::{Beams, Illuminant};
use crate::{Phong, Polygon, phong_lobe};
use glam::{DVec2, DVec3};
use std::f64::consts::FRAC_1_PI;

/// A Phong surface under some lights. No occlusion.
#[derive(Clone, Copy)]
pub struct Reflected<'a> {
    polygon: &'a Polygon,
    phong: &'a Phong,
    lights: &'a [&'a dyn Illuminant],
    size: DVec2,
}

/// What arrives at a position.
#[derive(Debug)]
pub struct Lit {
    /// k_d E / π.
    diffuse: [f64; 3],
    /// None if the surface has no lobe.
    beams: Beams,
}

/// A bundle whose whole lobe is below this part of the lobe's peak is left out.
const NEGLIGIBLE: f64 = 1e-6;

impl<'a> Reflected<'a> {
    /// What `polygon` reflects of `lights`.
    ///
    /// # Panics
    ///
    /// If its chart is not rectilinear.
    #[must_use]
    pub fn new(polygon: &'a Polygon, phong: &'a Phong, lights: &'a [&'a dyn Illuminant]) -> Self {
        let Some(size) = polygon.size() else { panic!("a receiver's chart is rectilinear") };
        Self { polygon, phong, lights, size }
    }

    /// The standard deviation of the lobe cosⁿ: 1/√n.
    fn lobe_width(&self) -> f64 {
        if self.phong.is_glossy() { self.phong.exponent.max(1.0).sqrt().recip() } else { 1.0 }
    }
}

impl std::fmt::Debug for Reflected<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Reflected({:?}, {} lights)", self.phong, self.lights.len())
    }
}

impl Radiance for Reflected<'_> {
    type Place = Lit;

    fn place(&self, uv: DVec2) -> Lit {
        let frame = self.polygon.frame();
        let point = frame.point(uv * self.size);
        let mut beams = Beams::default();
        for light in self.lights {
            light.illuminate(frame, point, self.lobe_width(), &mut beams);
        }
        let e = beams.irradiance();
        let diffuse = std::array::from_fn(|c| self.phong.kd[c] * FRAC_1_PI * e[c]);
        Lit { diffuse, beams: if self.phong.is_glossy() { beams } else { Beams::default() } }
    }

    fn radiance(&self, place: &Lit, mu: DVec3) -> [f64; 3] {
        let n = self.phong.exponent;
        // R·V is S·(mirrored V) as well.
        let mirrored = DVec3::new(-mu.x, -mu.y, mu.z);
        // The least cosine that counts.
        let least = NEGLIGIBLE.powf(1.0 / n.max(1e-3));
        let mut specular = [0.0; 3];
        for (bundle, beams) in place.beams.bundles() {
            if bundle.greatest_cosine(mirrored) <= least {
                continue;
            }
            for beam in beams {
                let lobe = phong_lobe(n, beam.to_light.dot(mirrored));
                for (sum, e) in specular.iter_mut().zip(beam.irradiance) {
                    *sum += lobe * e;
                }
            }
        }
        std::array::from_fn(|c| place.diffuse[c] + self.phong.ks[c] * specular[c])
    }

    fn scale(&self) -> f64 {
        if self.phong.is_glossy() { self.lobe_width() } else { f64::INFINITY }
    }
}
