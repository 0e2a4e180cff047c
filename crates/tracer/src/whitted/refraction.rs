//! Glass.

use crate::phong::Surface;
use glam::DVec3;

/// How a ray splits at a dielectric.
pub(super) struct Refraction {
    /// The fraction reflected, for unpolarised light.
    pub(super) fresnel: f64,
    /// Where the rest goes; `None` for total internal reflection.
    pub(super) direction: Option<DVec3>,
}

impl Refraction {
    /// A single-sided surface bounds a solid, with glass behind its front. A
    /// double-sided one is a thin pane: the ray goes straight on, and the two
    /// faces together reflect 2F/(1+F).
    ///
    /// Departs from physics in keeping radiance as it is inside glass instead of
    /// scaling it by η²; what goes in and comes out again is the same.
    pub(super) fn new(surface: &Surface<'_>, direction: DVec3) -> Self {
        let ior = f64::from(surface.material.ior);
        let thin = surface.material.double_sided;
        let eta = if surface.front || thin { ior.recip() } else { ior };
        let cos_i = -direction.dot(surface.normal);
        if cos_i <= 0.0 {
            // Past the horizon of an interpolated normal: grazing incidence.
            return Self { fresnel: 1.0, direction: None };
        }
        let sin2_t = eta * eta * (1.0 - cos_i * cos_i).max(0.0);
        if sin2_t >= 1.0 {
            return Self { fresnel: 1.0, direction: None };
        }
        let cos_t = (1.0 - sin2_t).sqrt();
        let across = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
        let along = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
        let fresnel = 0.5 * (across * across + along * along);
        if thin {
            let fresnel = 2.0 * fresnel / (1.0 + fresnel);
            return Self { fresnel, direction: Some(direction) };
        }
        let bent = eta * direction + (eta * cos_i - cos_t) * surface.normal;
        Self { fresnel, direction: bent.try_normalize() }
    }
}
