//! The Phong model: one definition for the bake and the raytracer.

use crate::{Error, Result, cosine_power};
use std::f64::consts::{FRAC_1_PI, TAU};

use glam::DVec3;

/// f_r = k_d/π + k_s (n+2)/(2π) max(0, R·V)ⁿ, with R the mirror direction of S.
///
/// Its albedo is k_d + k_s at normal incidence and less at any other; so no channel
/// reflects more light than it gets where k_d + k_s ≤ 1, which [`new`](Self::new)
/// insists on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Phong {
    /// Diffuse reflectance k_d, per channel.
    pub kd: [f64; 3],
    /// Specular reflectance k_s, per channel.
    pub ks: [f64; 3],
    /// n ≥ 0.
    pub exponent: f64,
}

impl Phong {
    /// The largest exponent: a lobe of 0.3°.
    pub const MAX_EXPONENT: f64 = 1e5;

    /// A BRDF that makes no light.
    ///
    /// A sum k_d + k_s within 10⁻⁶ above 1, as decimals in single precision leave it,
    /// passes; nothing is scaled down in silence.
    ///
    /// # Errors
    ///
    /// [`Error::Reflectance`] if a reflectance is negative or not finite, k_d + k_s
    /// exceeds 1 in a channel, or n lies outside 0 to [`MAX_EXPONENT`](Self::MAX_EXPONENT).
    pub fn new(kd: [f64; 3], ks: [f64; 3], exponent: f64) -> Result<Self> {
        let reject = |what, found: f64, allowed| Err(Error::Reflectance { what, found, allowed });
        for c in 0..3 {
            for (what, k) in [("k_d", kd[c]), ("k_s", ks[c])] {
                if !(k.is_finite() && k >= 0.0) {
                    return reject(what, k, "finite and at least 0");
                }
            }
            if kd[c] + ks[c] > 1.0 + 1e-6 {
                return reject("k_d + k_s", kd[c] + ks[c], "at most 1");
            }
        }
        if !(0.0..=Self::MAX_EXPONENT).contains(&exponent) {
            return reject("the exponent", exponent, "0 to 100000");
        }
        Ok(Self { kd, ks, exponent })
    }

    /// The BRDF for unit directions towards the light and the eye in the surface's
    /// frame (z is the normal), per steradian.
    #[must_use]
    pub fn eval(&self, to_light: DVec3, to_eye: DVec3) -> [f64; 3] {
        let lobe = lobe(self.exponent, to_light, to_eye);
        std::array::from_fn(|c| self.kd[c] * FRAC_1_PI + self.ks[c] * lobe)
    }

    /// Whether any channel has a lobe.
    #[must_use]
    pub fn is_glossy(&self) -> bool {
        self.ks.iter().any(|&k| k > 0.0)
    }
}

/// (n+2)/(2π) max(0, R·V)ⁿ: the lobe of k_s = 1 and exponent n, for the cosine
/// R·V between the mirror direction and the eye's.
#[must_use]
pub fn phong_lobe(exponent: f64, cosine: f64) -> f64 {
    if cosine <= 0.0 {
        return 0.0;
    }
    (exponent + 2.0) / TAU * cosine_power(cosine.min(1.0), exponent)
}

/// [`phong_lobe`] for directions in the surface's frame.
pub(super) fn lobe(exponent: f64, to_light: DVec3, to_eye: DVec3) -> f64 {
    let cosine = to_light.z * to_eye.z - to_light.x * to_eye.x - to_light.y * to_eye.y;
    phong_lobe(exponent, cosine)
}

/// Directions spread about z as the lobe of an exponent sends light.
#[derive(Debug)]
pub(super) struct LobeSample {
    directions: Vec<DVec3>,
    /// Of the light's energy, per direction and cosine to the normal.
    share: f64,
}

impl LobeSample {
    /// Rings of equal weight, in density ∝ cosⁿα, and directions along each.
    const RINGS: u32 = 32;
    const AROUND: u32 = 64;

    pub(super) fn new(exponent: f64) -> Self {
        let ring = |i: u32| {
            // The cosine's distribution function is cosⁿ⁺¹α.
            let share = (f64::from(i) + 0.5) / f64::from(Self::RINGS);
            let cosine = share.powf((exponent + 1.0).recip());
            // 1 − cos²α without cancelling: a ring of a sharp lobe is near its axis.
            let sine = (-(2.0 / (exponent + 1.0) * share.ln()).exp_m1()).max(0.0).sqrt();
            let turn = f64::from(i) * std::f64::consts::GOLDEN_RATIO;
            (0..Self::AROUND).map(move |j| {
                let phi = TAU * ((f64::from(j) + 0.5) / f64::from(Self::AROUND) + turn);
                DVec3::new(sine * phi.cos(), sine * phi.sin(), cosine)
            })
        };
        let directions: Vec<DVec3> = (0..Self::RINGS).flat_map(ring).collect();
        // At normal incidence all of the light is reflected, by the normalisation
        // (n+2)/(2π); so here, to rounding, whatever the number of rings.
        let share = directions.iter().map(|d| d.z).sum::<f64>().recip();
        Self { directions, share }
    }

    /// Calls `fall` with directions that light from `s` is reflected to, and the
    /// share f_r cosθ dω of its energy that goes there.
    pub(super) fn reflect(&self, s: DVec3, mut fall: impl FnMut(DVec3, f64)) {
        let mirror = DVec3::new(-s.x, -s.y, s.z);
        let (x, y) = mirror.any_orthonormal_pair();
        for d in &self.directions {
            let v = d.x * x + d.y * y + d.z * mirror;
            if v.z > 0.0 {
                fall(v, self.share * v.z);
            }
        }
    }

    /// ∫ f_r cosθ dω for light at an angle of this cosine to the normal.
    pub(super) fn albedo(&self, cosine: f64) -> f64 {
        let s = DVec3::new((1.0 - cosine * cosine).max(0.0).sqrt(), 0.0, cosine);
        let mut sum = 0.0;
        self.reflect(s, |_, share| sum += share);
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn direction() -> impl Strategy<Value = DVec3> {
        (-1.0..1.0f64, -1.0..1.0f64, 0.01..1.0f64)
            .prop_map(|(x, y, z)| DVec3::new(x, y, z).normalize())
    }

    proptest! {
        #[test]
        fn helmholtz_reciprocity(s in direction(), v in direction(), n in 0.0..500.0f64) {
            let phong = Phong { kd: [0.2; 3], ks: [0.5; 3], exponent: n };
            let (a, b) = (phong.eval(s, v)[0], phong.eval(v, s)[0]);
            prop_assert!((a - b).abs() <= 1e-12 * a.max(b), "{a} {b}");
        }
    }

    #[test]
    fn a_surface_that_makes_light_is_refused() {
        let phong = |kd: f64, ks: f64, n: f64| Phong::new([0.0, kd, 0.0], [0.0, ks, 0.0], n);
        for (kd, ks, n) in [
            (0.7, 0.4, 1.0),
            (-0.1, 0.0, 1.0),
            (0.0, f64::NAN, 1.0),
            (0.5, 0.5, -1.0),
            (0.5, 0.5, 1.1e5),
            (0.5, f64::INFINITY, 1.0),
            (0.5, 0.5, f64::NAN),
        ] {
            let error = phong(kd, ks, n).expect_err("out of range");
            assert!(matches!(error, Error::Reflectance { .. }), "{kd} {ks} {n}: {error}");
        }
        for n in [0.0, 1e5] {
            assert!(phong(0.6, 0.4 + 1e-7, n).is_ok(), "the limits are in range: {n}");
        }
    }

    /// At normal incidence the lobe reflects all of its k_s:
    /// (n+2)/(2π) ∫ cosⁿ⁺¹θ dω = 1.
    #[test]
    fn the_lobe_is_normalised_at_normal_incidence() {
        for exponent in [0.0, 1.0, 40.0] {
            const N: u32 = 200_000;
            let sum: f64 = (0..N)
                .map(|i| {
                    let cosine = (f64::from(i) + 0.5) / f64::from(N);
                    let eye = DVec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
                    lobe(exponent, DVec3::Z, eye) * cosine * TAU / f64::from(N)
                })
                .sum();
            assert!((sum - 1.0).abs() < 1e-8, "n = {exponent}: {sum}");
        }
    }
}
