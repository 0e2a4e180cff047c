//! Quasi-random integration: Halton, Hammersley (§7.1.4.2) and scrambled Sobol'.

use super::sampling::{Samples, mean_and_error};
use super::{Dimensions, Integral, Integrator, monte_carlo::Random};
use crate::{Error, Result, sobol, transport::Pair};

/// A sequence of low discrepancy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sequence {
    /// Radical inverses in bases 2, 3, 5, 7.
    Halton,
    /// (i + ½) / n, then radical inverses in bases 2, 3, 5.
    Hammersley,
    /// Sobol's sequence (directions of Joe & Kuo, *Constructing Sobol sequences
    /// with better two-dimensional projections*, SIAM J. Sci. Comput. 30, 2008),
    /// Owen-scrambled by hashing (Burley, *Practical hash-based Owen scrambling*,
    /// JCGT 9(4), 2020). Ours: the paper has no scrambled nets.
    Sobol,
}

/// Points of low discrepancy with equal weights.
///
/// Their error is estimated from parts that cover the cell evenly by themselves:
/// quarters in succession (Halton, Sobol'), or the residues modulo 7, prime to
/// the bases (Hammersley, whose quarters in succession would each cover a quarter
/// of its first dimension). The standard error of the parts' mean takes them for
/// independent; they complement each other, so it errs upwards as a rule (twice too
/// small at worst in `tracer report integrators`, for Hammersley on facing squares).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QuasiRandom {
    sequence: Sequence,
    dimensions: Dimensions,
    samples: u32,
    /// Scrambles Sobol'.
    seed: u64,
}

impl QuasiRandom {
    /// Halton: a multiple of 4; Hammersley: at least 14; Sobol': a power of two,
    /// at least 8. `seed` scrambles Sobol' and means nothing to the other two.
    ///
    /// # Errors
    ///
    /// [`Error::SampleCount`].
    pub fn new(
        sequence: Sequence,
        dimensions: Dimensions,
        samples: u32,
        seed: u64,
    ) -> Result<Self> {
        let (fits, method, allowed) = match sequence {
            Sequence::Halton => {
                (samples > 0 && samples.is_multiple_of(4), "Halton", "a multiple of 4")
            }
            Sequence::Hammersley => (samples >= 14, "Hammersley", "at least 14"),
            Sequence::Sobol => {
                (samples >= 8 && samples.is_power_of_two(), "Sobol'", "a power of two from 8 up")
            }
        };
        if fits {
            Ok(Self { sequence, dimensions, samples, seed })
        } else {
            Err(Error::SampleCount { method, found: samples.into(), allowed })
        }
    }

    fn parts(&self) -> u32 {
        if self.sequence == Sequence::Hammersley { 7 } else { 4 }
    }

    fn part(&self, i: u32) -> usize {
        let part = match self.sequence {
            Sequence::Hammersley => i % 7,
            Sequence::Halton | Sequence::Sobol => i / (self.samples / 4),
        };
        part as usize
    }
}

impl Integrator for QuasiRandom {
    fn name(&self) -> String {
        let sequence = match self.sequence {
            Sequence::Halton => "halton",
            Sequence::Hammersley => "hammersley",
            Sequence::Sobol => "sobol",
        };
        format!("{sequence}{}d:{}", self.dimensions.count(), self.samples)
    }

    fn integrate(&self, pair: &Pair<'_>) -> Integral {
        let mut samples = Samples::new(self.dimensions, pair);
        let mut random = Random::of_pair(self.seed, pair);
        let scrambles: [u32; 4] = std::array::from_fn(|_| random.next() as u32);
        let dimensions = self.dimensions.count();
        let (mut sum, mut parts) = (0.0, [(0.0, 0_u32); 7]);
        for i in 0..self.samples {
            let mut x = [0.0; 4];
            for (d, x) in x[..dimensions].iter_mut().enumerate() {
                *x = match (self.sequence, d) {
                    // From 1: point 0 is the origin, on the border in every dimension.
                    (Sequence::Halton, _) => radical_inverse(BASES[d], i + 1),
                    (Sequence::Hammersley, 0) => (f64::from(i) + 0.5) / f64::from(self.samples),
                    (Sequence::Hammersley, _) => radical_inverse(BASES[d - 1], i),
                    (Sequence::Sobol, _) => sobol(i, d, scrambles[d]),
                };
            }
            let value = samples.at(x);
            sum += value;
            let part = &mut parts[self.part(i)];
            *part = (part.0 + value, part.1 + 1);
        }
        let means = parts.map(|(sum, count)| sum / f64::from(count));
        let (_, error) = mean_and_error(&means[..self.parts() as usize]);
        let n = f64::from(self.samples);
        samples.integral(sum / n, error, 1.0 / n)
    }
}

const BASES: [u32; 4] = [2, 3, 5, 7];

/// The digits of `i` in `base`, mirrored at the point.
fn radical_inverse(base: u32, mut i: u32) -> f64 {
    if base == 2 {
        return f64::from(i.reverse_bits()) * 2.0_f64.powi(-32);
    }
    let step = 1.0 / f64::from(base);
    let (mut sum, mut digit) = (0.0, step);
    while i > 0 {
        sum += f64::from(i % base) * digit;
        i /= base;
        digit *= step;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::super::facts::{FACING, facing};
    use super::*;

    #[test]
    fn radical_inverse_mirrors_the_digits() {
        assert_eq!(radical_inverse(2, 6), 0.375, "110 → 0.011");
        assert!((radical_inverse(3, 5) - 7.0 / 9.0).abs() < 1e-15, "12 → 0.21");
        assert!((radical_inverse(7, 7) - 1.0 / 49.0).abs() < 1e-15, "10 → 0.01");
    }

    /// Half as many, as many and twice as many: one alone may be right by chance.
    fn worst(sequence: Sequence, dimensions: Dimensions, n: u32) -> f64 {
        let (geometry, [j, k]) = facing();
        let pair = Pair::new(&geometry, j, k);
        let errors = [n / 2, n, 2 * n].map(|n| {
            let rule = QuasiRandom::new(sequence, dimensions, n, 1).expect("2^n");
            let got = rule.integrate(&pair);
            let error = (got.value - FACING).abs();
            assert!(error < 4.0 * got.error, "{}: {error:e} {got:?}", rule.name());
            error
        });
        errors.into_iter().fold(0.0, f64::max)
    }

    const SEQUENCES: [Sequence; 3] = [Sequence::Halton, Sequence::Hammersley, Sequence::Sobol];

    /// Koksma–Hlawka in two dimensions: nearly 1/n.
    #[test]
    fn error_falls_nearly_as_the_count_in_two_dimensions() {
        for sequence in SEQUENCES {
            let of = |n| worst(sequence, Dimensions::Two, n);
            let (coarse, fine) = (of(256), of(1 << 14));
            assert!(fine < 2.0 * coarse / 64.0_f64.powf(0.9), "{sequence:?}: {coarse:e} {fine:e}");
        }
    }

    /// The indicator's jumps spoil that in four, yet not below independent points,
    /// whose error is √(T (1 − T) / n), at the smallest of the counts.
    #[test]
    fn four_dimensions_still_beat_independent_points() {
        for sequence in SEQUENCES {
            for n in [256, 1 << 14] {
                let independent = (FACING * (1.0 - FACING) / f64::from(n / 2)).sqrt();
                let error = worst(sequence, Dimensions::Four, n);
                assert!(error < independent, "{sequence:?}: {error:e} {independent:e}");
            }
        }
    }

    #[test]
    fn counts_that_do_not_fill_the_parts_are_refused() {
        let make = |sequence, n| QuasiRandom::new(sequence, Dimensions::Two, n, 0);
        for (sequence, n) in [
            (Sequence::Halton, 0),
            (Sequence::Halton, 6),
            (Sequence::Hammersley, 13),
            (Sequence::Sobol, 24),
            (Sequence::Sobol, 4),
        ] {
            assert!(make(sequence, n).is_err(), "{sequence:?} of {n}");
        }
    }
}
