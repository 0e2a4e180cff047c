//! What a lobe gathers of beams, for one direction after another.

use super::Beams;
use fearless_simd::{Level, dispatch, f64x8, prelude::*, u64x8};
use glam::DVec3;
use std::f64::consts::{FRAC_1_SQRT_2, LN_2, LOG2_E, PI, TAU};
use std::ops::Range;

/// Beams that are worked out side by side.
const LANES: usize = 8;

/// Below this part of its peak the lobe counts as nothing: all of that is this part of
/// what it reflects.
const NEGLIGIBLE: f64 = 1e-5;

/// Beams as a lobe cosⁿ looks at them.
#[derive(Debug)]
pub struct Glossy {
    exponent: f64,
    /// The exponent, if it is a whole number: fewer multiplications.
    whole: Option<u32>,
    /// The least cosine that counts.
    least: f64,
    cones: Vec<Cone>,
    blocks: Vec<Block>,
    level: Level,
}

/// A bundle, and which blocks are its.
#[derive(Debug)]
struct Cone {
    axis: DVec3,
    /// The lobe about a direction at a greater angle to the axis meets no beam.
    reach: f64,
    /// Its cosine.
    least: f64,
    blocks: Range<usize>,
}

/// Beams side by side: x, y and z of the direction, and the irradiances.
#[derive(Clone, Debug, Default)]
struct Block([[f64; LANES]; 6]);

impl Glossy {
    /// Prepares `beams` for the lobe of an exponent of 0 or more.
    #[must_use]
    pub fn new(beams: &Beams, exponent: f64) -> Self {
        let least = NEGLIGIBLE.powf(1.0 / exponent.max(1e-3)).max(f64::MIN_POSITIVE);
        let whole = exponent as u32;
        let whole = (f64::from(whole) == exponent).then_some(whole);
        let mut glossy = Self {
            exponent,
            whole,
            least,
            cones: Vec::new(),
            blocks: Vec::with_capacity(beams.len() / LANES),
            level: Level::new(),
        };
        for (bundle, beams) in beams.bundles() {
            let from = glossy.blocks.len();
            let blocks = beams.chunks(LANES).map(|beams| {
                let mut block = Block::default();
                for (lane, beam) in beams.iter().enumerate() {
                    let [x, y, z] = beam.to_light.to_array();
                    let [r, g, b] = beam.irradiance;
                    block.0.iter_mut().zip([x, y, z, r, g, b]).for_each(|(row, v)| row[lane] = v);
                }
                block
            });
            glossy.blocks.extend(blocks);
            let reach = bundle.cosine.clamp(-1.0, 1.0).acos() + least.acos();
            glossy.cones.push(Cone {
                axis: bundle.axis,
                reach,
                least: least_cosine(reach),
                blocks: from..glossy.blocks.len(),
            });
        }
        glossy
    }

    /// Σ E (n + 2)/(2π) max(0, to light · `direction`)ⁿ over the beams, to 10⁻⁵ of
    /// [`phong_lobe`](crate::phong_lobe)'s; `direction` is a unit vector.
    #[must_use]
    pub fn gather(&self, direction: DVec3) -> [f64; 3] {
        let sum = dispatch!(self.level, simd => self.sum(simd, direction));
        sum.map(|sum| sum * (self.exponent + 2.0) / TAU)
    }

    /// Whether the lobe about any direction within `radius` radians of `axis` meets a beam.
    #[must_use]
    pub fn reaches(&self, axis: DVec3, radius: f64) -> bool {
        let meets = |cone: &Cone| cone.axis.dot(axis) >= least_cosine(cone.reach + radius);
        self.cones.iter().any(meets)
    }

    #[inline(always)]
    fn sum<S: Simd>(&self, simd: S, direction: DVec3) -> [f64; 3] {
        let (zero, least) = (f64x8::splat(simd, 0.0), f64x8::splat(simd, self.least));
        let (mut red, mut green, mut blue) = (zero, zero, zero);
        for cone in &self.cones {
            if cone.axis.dot(direction) < cone.least {
                continue;
            }
            for Block([x, y, z, r, g, b]) in &self.blocks[cone.blocks.clone()] {
                let cosine = load(simd, x) * direction.x
                    + load(simd, y) * direction.y
                    + load(simd, z) * direction.z;
                if cosine.simd_le(least).all_true() {
                    continue;
                }
                let lobe = self.lobe(simd, cosine);
                red += lobe * load(simd, r);
                green += lobe * load(simd, g);
                blue += lobe * load(simd, b);
            }
        }
        [sum_of(red), sum_of(green), sum_of(blue)]
    }

    /// cosⁿ, 0 where it is negligible.
    #[inline(always)]
    fn lobe<S: Simd>(&self, simd: S, cosine: f64x8<S>) -> f64x8<S> {
        let least = f64x8::splat(simd, self.least);
        let power = if let Some(mut whole) = self.whole {
            let (mut power, mut square) = (f64x8::splat(simd, 1.0), cosine);
            while whole > 0 {
                if whole & 1 == 1 {
                    power *= square;
                }
                square *= square;
                whole >>= 1;
            }
            power
        } else {
            exp(simd, ln(simd, cosine.max(least)) * self.exponent)
        };
        cosine.simd_gt(least).select(power, f64x8::splat(simd, 0.0))
    }
}

/// The cosine of an angle, or less than any from a half turn on.
fn least_cosine(angle: f64) -> f64 {
    if angle < PI { angle.cos() } else { -2.0 }
}

#[inline(always)]
fn load<S: Simd>(simd: S, lanes: &[f64; LANES]) -> f64x8<S> {
    f64x8::load_array_ref(simd, lanes)
}

/// In the same order on every machine.
#[inline(always)]
fn sum_of<S: Simd>(lanes: f64x8<S>) -> f64 {
    <[f64; LANES]>::from(lanes).iter().sum()
}

/// 2 artanh(s)/s in powers of s²: 2/(2k + 1).
const LN_SERIES: [f64; 9] = {
    let mut series = [0.0; 9];
    let mut k = 0;
    while k < series.len() {
        series[k] = 2.0 / (2 * k + 1) as f64;
        k += 1;
    }
    series
};

/// 1/k!.
const EXP_SERIES: [f64; 12] = {
    let mut series = [1.0; 12];
    let mut k = 1;
    while k < series.len() {
        series[k] = series[k - 1] / k as f64;
        k += 1;
    }
    series
};

/// The logarithm of normal positive numbers, to 10⁻¹³ of it.
#[inline(always)]
fn ln<S: Simd>(simd: S, x: f64x8<S>) -> f64x8<S> {
    const MANTISSA: u64 = (1 << 52) - 1;
    /// 2^52, and its exponent's bits.
    const ONES: f64 = (1_u64 << 52) as f64;
    const ONES_BITS: u64 = 0x433 << 52;
    let bits = x.bitcast::<u64x8<S>>();
    // x = m 2^e with m from ½ to 1; the bits of e + 1022 make a number from 2^52.
    let e = (bits >> 52 | ONES_BITS).bitcast::<f64x8<S>>() - (ONES + 1022.0);
    let m = (bits & MANTISSA | 0x3fe << 52).bitcast::<f64x8<S>>();
    let is_low = m.simd_lt(f64x8::splat(simd, FRAC_1_SQRT_2));
    let (m, e) = (is_low.select(m * 2.0, m), is_low.select(e - 1.0, e));
    // 2 artanh s.
    let s = (m - 1.0) / (m + 1.0);
    let t = s * s;
    let mut series = f64x8::splat(simd, 0.0);
    for &c in LN_SERIES.iter().rev() {
        series = series * t + c;
    }
    e * LN_2 + s * series
}

/// e^x for x from −700 to 0, to 10⁻¹³ of it.
#[inline(always)]
fn exp<S: Simd>(simd: S, x: f64x8<S>) -> f64x8<S> {
    /// 1.5 × 2^52: what is added to it is rounded to a whole number in its last bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let shifted = x * LOG2_E + ROUND;
    let r = x - (shifted - ROUND) * LN_2;
    let mut series = f64x8::splat(simd, 0.0);
    for &c in EXP_SERIES.iter().rev() {
        series = series * r + c;
    }
    let power = (shifted.bitcast::<u64x8<S>>() + 1023_u64) << 52;
    series * power.bitcast::<f64x8<S>>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::beams::Beam;
    use crate::phong_lobe;
    use proptest::prelude::*;

    #[test]
    fn logarithms_and_exponentials_are_those_of_the_standard_library() {
        let ln =
            |x: f64| dispatch!(Level::new(), simd => sum_of(ln(simd, f64x8::splat(simd, x))) / 8.0);
        let exp = |x: f64| dispatch!(Level::new(), simd => sum_of(exp(simd, f64x8::splat(simd, x))) / 8.0);
        for i in 1..=10_000 {
            let x = f64::from(i) / 10_000.0;
            assert!((ln(x) - x.ln()).abs() <= 1e-13 * x.ln().abs(), "ln {x}: {}", ln(x));
            let y = -700.0 * (1.0 - x);
            assert!((exp(y) / y.exp() - 1.0).abs() <= 1e-13, "exp {y}: {}", exp(y));
        }
        assert!(ln(f64::MIN_POSITIVE).is_finite(), "{}", ln(f64::MIN_POSITIVE));
    }

    fn direction() -> impl Strategy<Value = DVec3> {
        (0.0..1.0, 0.0..TAU).prop_map(|(z, phi): (f64, f64)| {
            let r = (1.0 - z * z).sqrt();
            DVec3::new(r * phi.cos(), r * phi.sin(), z)
        })
    }

    proptest! {
        /// Where a lobe is said to reach no beam, it gathers nothing.
        #[test]
        fn out_of_reach_is_dark(
            to in direction(),
            exponent in 1.0..1e4,
            axis in direction(),
            radius in 0.0..1.0,
            turn in 0.0..TAU,
            part in 0.0..1.0,
        ) {
            let mut beams = Beams::default();
            beams.push(to, [Beam { to_light: to, irradiance: [1.0; 3] }]);
            let glossy = Glossy::new(&beams, exponent);
            let across = axis.any_orthonormal_pair().0;
            let across = glam::DQuat::from_axis_angle(axis, turn) * across;
            let angle: f64 = radius * part;
            let direction = angle.cos() * axis + angle.sin() * across;
            let found = glossy.gather(direction)[0];
            prop_assert!(found == 0.0 || glossy.reaches(axis, radius), "{found}");
            prop_assert!(glossy.reaches(to, 0.0), "not what it is aimed at");
        }

        /// Any beams, any exponent, whole or not, and any direction.
        #[test]
        fn a_lobe_gathers_what_it_gathers_beam_by_beam(
            axis in direction(),
            spread in 0.0..1.0,
            to in prop::collection::vec(direction(), 1..40),
            exponent in prop_oneof![0.0..3.0, 1.0..1e5, (0_u32..500).prop_map(f64::from)],
            towards in direction(),
        ) {
            let beam = |(i, to): (usize, &DVec3)| Beam {
                to_light: axis.lerp(*to, spread).normalize(),
                irradiance: [1.0, i as f64, 0.5],
            };
            let all: Vec<Beam> = to.iter().enumerate().map(beam).collect();
            let mut beams = Beams::default();
            beams.push(axis, all.iter().copied());
            // Mirrored light, or near it.
            let towards = axis.lerp(towards, spread).normalize();
            let found = Glossy::new(&beams, exponent).gather(towards);
            for (c, found) in found.into_iter().enumerate() {
                let each = |beam: &Beam| {
                    beam.irradiance[c] * phong_lobe(exponent, beam.to_light.dot(towards))
                };
                let expected: f64 = all.iter().map(each).sum();
                let peak: f64 = all.iter().map(|b| b.irradiance[c]).sum::<f64>();
                let allowed = 1e-9 * expected + NEGLIGIBLE * peak * phong_lobe(exponent, 1.0);
                prop_assert!((found - expected).abs() <= allowed, "{found} for {expected}");
            }
        }
    }
}
