//! The Phong model: one definition for the bake and the raytracer.

use std::f64::consts::{FRAC_1_PI, TAU};

use glam::DVec3;

/// f_r = k_d/π + k_s (n+2)/(2π) max(0, R·V)ⁿ, with R the mirror direction of S.
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
    let cosine = cosine.min(1.0);
    // Whole exponents are the common ones, and several times as fast.
    let whole = exponent as i32;
    let power = if f64::from(whole) == exponent && whole <= 256 {
        cosine.powi(whole)
    } else {
        cosine.powf(exponent)
    };
    (exponent + 2.0) / TAU * power
}

/// [`phong_lobe`] for directions in the surface's frame.
pub(super) fn lobe(exponent: f64, to_light: DVec3, to_eye: DVec3) -> f64 {
    let cosine = to_light.z * to_eye.z - to_light.x * to_eye.x - to_light.y * to_eye.y;
    phong_lobe(exponent, cosine)
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
