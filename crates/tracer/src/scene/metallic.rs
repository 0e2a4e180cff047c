//! glTF's metallic-roughness reflection as Phong's.
//!
//! With roughness r, metalness m, base colour c and the reflectance f_d of a
//! dielectric at normal incidence, ((η−1)/(η+1))² or 0.04:
//!
//! ```text
//! α = r²    n = clamp(2/α² − 2, 0, 10⁵)
//! f₀ = lerp(f_d, c, m)    k_s = f₀    k_d = c (1−m) (1 − max f₀)
//! ```
//!
//! n is the Blinn-Phong exponent whose half-vector lobe has the GGX width α (B.
//! Walter et al., *Microfacet Models for Refraction through Rough Surfaces*,
//! EGSR 2007, §5.2), used for Phong's lobe as it stands.

use super::Map;
use super::extras::MAX_PHONG_EXPONENT;
use super::load::conserve;
use glam::Vec3;

/// The parameters of a metallic-roughness material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MetallicRoughness {
    /// c, before its texture.
    pub(crate) base: Vec3,
    /// m, before its texture, 0 to 1.
    pub(crate) metallic: f32,
    /// r, before its texture, 0 to 1.
    pub(crate) roughness: f32,
    /// f_d.
    pub(crate) dielectric: Vec3,
    /// r in the green channel, m in the blue.
    pub(crate) map: Option<Map>,
}

impl MetallicRoughness {
    /// (k_d, k_s, n) where the textures' factors for c and, as (r, m), for the rest
    /// are these.
    pub(crate) fn phong(&self, base: Vec3, [roughness, metallic]: [f32; 2]) -> (Vec3, Vec3, f32) {
        let (roughness, metallic) = (self.roughness * roughness, self.metallic * metallic);
        let base = self.base * base;
        let f0 = self.dielectric.lerp(base, metallic);
        let kd = base * (1.0 - metallic) * (1.0 - f0.max_element()).max(0.0);
        let (kd, ks) = conserve(kd, f0);
        (kd, ks, exponent(roughness))
    }
}

/// n of a roughness.
pub(super) fn exponent(roughness: f32) -> f32 {
    let alpha = roughness * roughness;
    // α = 0 gives +∞, which the clamp takes to the largest exponent.
    (2.0 / (alpha * alpha) - 2.0).clamp(0.0, MAX_PHONG_EXPONENT)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn energy_is_conserved_for_every_material() {
        for i in 0..=10 {
            for j in 0..=10 {
                let (metallic, base) = (i as f32 / 10.0, Vec3::new(1.0, j as f32 / 10.0, 0.0));
                for dielectric in [0.0, 0.04, 0.5, 1.0].map(Vec3::splat) {
                    let map = None;
                    let material =
                        MetallicRoughness { base, metallic, roughness: 0.5, dielectric, map };
                    let (kd, ks, _) = material.phong(Vec3::ONE, [1.0; 2]);
                    assert!((kd + ks).max_element() <= 1.0 + 1e-6, "{kd} + {ks}");
                }
            }
        }
    }

    #[test]
    fn textures_multiply_the_factors() {
        let dielectric = Vec3::splat(0.04);
        let whole = |base, metallic, roughness| MetallicRoughness {
            base,
            metallic,
            roughness,
            dielectric,
            map: None,
        };
        let c = Vec3::new(0.8, 0.4, 0.2);
        let textured = whole(c, 0.5, 1.0).phong(Vec3::splat(0.5), [0.5, 0.25]);
        assert_eq!(textured, whole(0.5 * c, 0.125, 0.5).phong(Vec3::ONE, [1.0; 2]));
        // α = ¼, n = 2 · 16 − 2.
        assert_eq!(textured.2, 30.0);
    }
}
