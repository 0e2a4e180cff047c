//! The radiance that a surface reflects of what shines on it, straight from there
//! (Eq. 1), for projection.

use super::Radiance;
use crate::beams::{Beams, Glossy, Illuminant};
use crate::{Phong, Polygon};
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
    glossy: Option<Glossy>,
}

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
        let lobe = || Glossy::new(&beams, self.phong.exponent);
        Lit { diffuse, glossy: self.phong.is_glossy().then(lobe) }
    }

    fn radiance(&self, place: &Lit, mu: DVec3) -> [f64; 3] {
        // R·V is S·(mirrored V) as well.
        let mirrored = DVec3::new(-mu.x, -mu.y, mu.z);
        let Some(glossy) = &place.glossy else { return place.diffuse };
        let specular = glossy.gather(mirrored);
        std::array::from_fn(|c| place.diffuse[c] + self.phong.ks[c] * specular[c])
    }

    fn is_plain(&self, place: &Lit, axis: DVec3, radius: f64) -> bool {
        let mirrored = DVec3::new(-axis.x, -axis.y, axis.z);
        place.glossy.as_ref().is_none_or(|glossy| !glossy.reaches(mirrored, radius))
    }

    fn scale(&self) -> f64 {
        if self.phong.is_glossy() { self.lobe_width() } else { f64::INFINITY }
    }
}
