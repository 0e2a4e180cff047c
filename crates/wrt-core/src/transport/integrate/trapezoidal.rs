//! The trapezoidal rule on a regular grid (§7.1.4.2), over the whole cell or the
//! part of it that can see the source.

use super::{Dimensions, Integral, Integrator, sampling::Samples, visible::visible_box};
use crate::{Error, Result, transport::Pair};

/// The product trapezoidal rule.
///
/// Its error estimate is the difference from the grid of twice the spacing, all
/// of it: the usual third of it would assume a smooth integrand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trapezoidal {
    dimensions: Dimensions,
    per_side: u32,
    visible_only: bool,
}

impl Trapezoidal {
    /// The rule with `per_side` points along each dimension: odd, from 3 to 65 537
    /// in two dimensions and to 257 in four.
    ///
    /// # Errors
    ///
    /// [`Error::SampleCount`].
    pub fn new(dimensions: Dimensions, per_side: u32) -> Result<Self> {
        let (limit, allowed) = match dimensions {
            Dimensions::Two => (65_537, "an odd number a side, from 3 to 65537"),
            Dimensions::Four => (257, "an odd number a side, from 3 to 257"),
        };
        if per_side < 3 || per_side > limit || per_side.is_multiple_of(2) {
            let (method, found) = ("the trapezoidal rule", per_side.into());
            return Err(Error::SampleCount { method, found, allowed });
        }
        Ok(Self { dimensions, per_side, visible_only: false })
    }

    /// The two-dimensional rule on the part of the direction cell that bounds the
    /// directions from the destination's cell to the source's.
    ///
    /// Departs from §7.1.4.2: a grid over the whole direction cell wastes most of
    /// its points, or misses the source, where that looks small.
    ///
    /// # Errors
    ///
    /// As [`new`](Self::new).
    pub fn visible(per_side: u32) -> Result<Self> {
        Ok(Self { visible_only: true, ..Self::new(Dimensions::Two, per_side)? })
    }
}

impl Integrator for Trapezoidal {
    fn name(&self) -> String {
        let rule = if self.visible_only { "visible" } else { "trapezoid" };
        format!("{rule}{}d:{}", self.dimensions.count(), self.per_side)
    }

    fn integrate(&self, pair: &Pair<'_>) -> Integral {
        let mut samples = if self.visible_only {
            let Some(bounds) = visible_box(pair) else {
                return Integral { value: 0.0, error: 0.0, evaluations: 0 };
            };
            Samples::within(self.dimensions, pair, bounds)
        } else {
            Samples::new(self.dimensions, pair)
        };
        let [fine, coarse] = nested(&mut samples, self.dimensions, self.per_side - 1);
        samples.integral(fine, (fine - coarse).abs())
    }
}

/// Trapezoidal means with `intervals`, `intervals` / 2, … `intervals` / 2^(N−1)
/// intervals a side, from one pass over the finest grid.
pub(super) fn nested<const N: usize>(
    samples: &mut Samples<'_>,
    dimensions: Dimensions,
    intervals: u32,
) -> [f64; N] {
    let count = dimensions.count();
    let mut sums = [0.0; N];
    let mut index = [0_u32; 4];
    'grid: loop {
        let x = index.map(|i| f64::from(i) / f64::from(intervals));
        let ends = index[..count].iter().filter(|&&i| i == 0 || i == intervals).count();
        let value = samples.at(x) * 0.5_f64.powi(ends as i32);
        // A point is on the grids whose stride divides all its indices; 0 has 32
        // trailing zeros.
        let coarsest = index[..count].iter().map(|i| i.trailing_zeros()).min().unwrap_or(0);
        for sum in sums.iter_mut().take(coarsest as usize + 1) {
            *sum += value;
        }
        for i in &mut index[..count] {
            if *i < intervals {
                *i += 1;
                continue 'grid;
            }
            *i = 0;
        }
        break;
    }
    let mut side = f64::from(intervals);
    for sum in &mut sums {
        *sum /= side.powi(count as i32);
        side *= 0.5;
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::super::facts::{self, FACING, facing, tilted};
    use super::*;

    /// Kinks where the squares' shadows begin and end leave O(h²): a quarter at
    /// each halving, and two halvings below 1/8 whatever the kinks' phase.
    #[test]
    fn two_dimensions_converge_to_second_order() {
        let (geometry, [j, k]) = facing();
        let pair = Pair::new(&geometry, j, k);
        let error = |n| {
            let got = Trapezoidal::new(Dimensions::Two, n).expect("odd").integrate(&pair);
            let error = (got.value - FACING).abs();
            assert!(error <= got.error, "{n} a side: off by {error:e}, claims {:e}", got.error);
            assert_eq!(got.evaluations, u64::from(n).pow(2));
            error
        };
        let errors = [9, 17, 33, 65, 129, 257].map(error);
        for pair in errors.windows(3) {
            assert!(pair[2] < pair[0] / 8.0, "{errors:?}");
        }
    }

    /// The indicator's jump costs O(h) in four dimensions.
    #[test]
    fn four_dimensions_converge_to_first_order() {
        let (geometry, [j, k]) = facing();
        let pair = Pair::new(&geometry, j, k);
        let error = |n: u32| {
            let got = Trapezoidal::new(Dimensions::Four, n).expect("odd").integrate(&pair);
            (got.value - FACING).abs()
        };
        let errors = [5, 9, 17, 33].map(error);
        for (error, n) in errors.iter().zip([4.0, 8.0, 16.0, 32.0]) {
            assert!(*error < 0.5 / n, "{errors:?}");
        }
    }

    #[test]
    fn the_visible_box_holds_all_that_the_whole_cell_sees() {
        for (geometry, cells) in [facing(), tilted(), facts::far(), facts::shared_edge()] {
            let pair = Pair::new(&geometry, cells[0], cells[1]);
            let whole = Trapezoidal::new(Dimensions::Two, 513).expect("odd").integrate(&pair);
            let boxed = Trapezoidal::visible(129).expect("odd").integrate(&pair);
            let difference = (whole.value - boxed.value).abs();
            assert!(whole.value > 0.0, "{pair:?} sees nothing");
            assert!(difference <= whole.error + boxed.error, "{whole:?} {boxed:?}");
        }
    }

    #[test]
    fn a_small_far_source_is_found_by_the_visible_box() {
        let (geometry, [j, k]) = facts::far();
        let pair = Pair::new(&geometry, j, k);
        let got = Trapezoidal::visible(9).expect("odd").integrate(&pair);
        assert!(got.value > 0.0, "{got:?}");
        let missed = Trapezoidal::new(Dimensions::Two, 9).expect("odd").integrate(&pair);
        // What the coarse grid cannot know, its error must cover.
        assert!((missed.value - got.value).abs() <= missed.error + got.error, "{missed:?} {got:?}");
    }

    #[test]
    fn counts_that_have_no_coarser_grid_are_refused() {
        for n in [0, 1, 2, 10, 65_539] {
            let error = Trapezoidal::new(Dimensions::Two, n).expect_err("no coarse grid");
            assert!(matches!(error, Error::SampleCount { .. }), "{error}");
        }
        assert!(Trapezoidal::new(Dimensions::Four, 259).is_err(), "4.5e9 samples");
    }
}
