//! Romberg integration over direction (§7.1.4.2).

use super::{
    Dimensions, Integral, Integrator,
    sampling::Samples,
    trapezoidal::{hidden, nested},
};
use crate::{Error, Result, transport::Pair};

/// How far the trapezoidal results are extrapolated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Degree {
    /// Linear in h², from two grids.
    Linear,
    /// Quadratic in h², from three.
    Quadratic,
    /// Cubic in h², from four.
    Cubic,
}

impl Degree {
    /// 1 to 3.
    fn steps(self) -> usize {
        match self {
            Self::Linear => 1,
            Self::Quadratic => 2,
            Self::Cubic => 3,
        }
    }
}

/// Richardson extrapolation of nested trapezoidal grids to zero spacing, as a
/// polynomial of h² (Romberg, *Vereinfachte numerische Integration*, 1955).
///
/// Its error estimate is how far extrapolation moved the finest grid's result. The
/// usual one, the tableau's last step alone, trusts the powers of h² that kinks
/// and jumps of the integrand do not have: for facing squares it claims a tenth
/// of the error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Romberg {
    degree: Degree,
    per_side: u32,
}

impl Romberg {
    /// Extrapolates from a finest grid of `per_side` points a side: one more than
    /// a multiple of 2^degree, up to 65 537.
    ///
    /// # Errors
    ///
    /// [`Error::SampleCount`].
    pub fn new(degree: Degree, per_side: u32) -> Result<Self> {
        let coarsest = 1 << degree.steps();
        let intervals = per_side.wrapping_sub(1);
        if intervals == 0 || intervals > 65_536 || !intervals.is_multiple_of(coarsest) {
            let (method, allowed) = match degree {
                Degree::Linear => ("linear Romberg", "2 n + 1 a side, up to 65537"),
                Degree::Quadratic => ("quadratic Romberg", "4 n + 1 a side, up to 65537"),
                Degree::Cubic => ("cubic Romberg", "8 n + 1 a side, up to 65537"),
            };
            return Err(Error::SampleCount { method, found: per_side.into(), allowed });
        }
        Ok(Self { degree, per_side })
    }
}

impl Integrator for Romberg {
    fn name(&self) -> String {
        let degree = match self.degree {
            Degree::Linear => "linear",
            Degree::Quadratic => "quadratic",
            Degree::Cubic => "cubic",
        };
        format!("romberg-{degree}2d:{}", self.per_side)
    }

    fn integrate(&self, pair: &Pair<'_>) -> Integral {
        let mut samples = Samples::new(Dimensions::Two, pair);
        let intervals = self.per_side - 1;
        let (mean, error) = match self.degree {
            Degree::Linear => extrapolate(nested::<2>(&mut samples, Dimensions::Two, intervals)),
            Degree::Quadratic => extrapolate(nested::<3>(&mut samples, Dimensions::Two, intervals)),
            Degree::Cubic => extrapolate(nested::<4>(&mut samples, Dimensions::Two, intervals)),
        };
        samples.integral(mean, error, hidden(intervals))
    }
}

/// The limit at h = 0 of results at h, 2h, 4h, …, and its distance from the first.
///
/// ```text
/// R_k(h) = R_k−1(h) + (R_k−1(h) − R_k−1(2h)) / (4^k − 1)
/// ```
fn extrapolate<const N: usize>(mut tableau: [f64; N]) -> (f64, f64) {
    let finest = tableau[0];
    for k in 1..N {
        let divisor = f64::from((1_u32 << (2 * k)) - 1);
        for i in 0..N - k {
            tableau[i] += (tableau[i] - tableau[i + 1]) / divisor;
        }
    }
    (tableau[0], (tableau[0] - finest).abs())
}

#[cfg(test)]
mod tests {
    use super::super::Trapezoidal;
    use super::super::facts::{FACING, facing};
    use super::*;

    /// T(h) = 1 + h² + h⁴ + h⁶ has limit 1, and degree d removes d of the terms.
    #[test]
    fn cubic_extrapolation_removes_three_terms() {
        let result = |h: f64| 1.0 + h.powi(2) + h.powi(4) + h.powi(6);
        let (cubic, _) = extrapolate([0.1, 0.2, 0.4, 0.8].map(result));
        assert!((cubic - 1.0).abs() < 1e-14, "{cubic}");
        let (linear, error) = extrapolate([0.1, 0.2].map(result));
        assert!((linear - 1.0).abs() < error, "{linear} {error}");
    }

    /// A piecewise smooth integrand still has T(h) → T, only without the order
    /// that extrapolation hopes for: each degree ends below 10 trapezoidal errors.
    #[test]
    fn every_degree_converges_on_facing_squares() {
        let (geometry, [j, k]) = facing();
        let pair = Pair::new(&geometry, j, k);
        for degree in [Degree::Linear, Degree::Quadratic, Degree::Cubic] {
            let error = |n| {
                let got = Romberg::new(degree, n).expect("2^n + 1").integrate(&pair);
                (got.value - FACING).abs()
            };
            let (coarse, fine) = (error(17), error(257));
            assert!(fine < coarse / 20.0, "{degree:?}: {coarse:e} {fine:e}");
            let trapezoidal = Trapezoidal::new(Dimensions::Two, 257).expect("odd").integrate(&pair);
            assert!(fine < 10.0 * trapezoidal.error, "{degree:?}: {fine:e} {trapezoidal:?}");
        }
    }

    #[test]
    fn grids_that_cannot_be_halved_are_refused() {
        for (degree, n) in [(Degree::Linear, 2), (Degree::Quadratic, 7), (Degree::Cubic, 5)] {
            assert!(Romberg::new(degree, n).is_err(), "{degree:?} of {n}");
        }
        assert!(Romberg::new(Degree::Cubic, 0).is_err(), "no points");
        assert!(Romberg::new(Degree::Cubic, 1).is_err(), "no interval");
    }
}
