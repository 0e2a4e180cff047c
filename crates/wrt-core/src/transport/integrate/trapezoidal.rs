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
        samples.integral(fine, (fine - coarse).abs(), hidden(self.per_side - 1))
    }
}

/// What part of the cell can hide from a regular grid: the slab between two of its
/// planes.
pub(super) fn hidden(intervals: u32) -> f64 {
    1.0 / f64::from(intervals)
}

/// How far the grid's ends stay inside the cell. The source's cells are half open:
/// where their borders are the destination's too, a closed rule would take the
/// value beyond for the one within, and be of first order for no other reason.
const INSET: f64 = 1e-9;

/// Trapezoidal means with `intervals`, `intervals` / 2, … `intervals` / 2^(N−1)
/// intervals a side, from one pass over the finest grid.
pub(super) fn nested<const N: usize>(
    samples: &mut Samples<'_>,
    dimensions: Dimensions,
    intervals: u32,
) -> [f64; N] {
    let node = |i: u32| Node {
        x: INSET + (1.0 - 2.0 * INSET) * f64::from(i) / f64::from(intervals),
        weight: if i == 0 || i == intervals { 0.5 } else { 1.0 },
        grids: (i.trailing_zeros() as usize + 1).min(N),
    };
    let nodes: Vec<Node> = (0..=intervals).map(node).collect();
    let mut sums = [0.0; N];
    let d = dimensions.count() - 1;
    sweep(samples, &nodes, d, Node { x: 0.0, weight: 1.0, grids: N }, &mut [0.0; 4], &mut sums);
    let mut side = f64::from(intervals);
    for sum in &mut sums {
        *sum /= side.powi(dimensions.count() as i32);
        side *= 0.5;
    }
    sums
}

/// A coordinate of the finest grid.
#[derive(Clone, Copy, Debug)]
struct Node {
    x: f64,
    weight: f64,
    /// How many of the grids have it.
    grids: usize,
}

/// Adds the samples over dimensions 0 to `d`, the others being at `x`; `outer`
/// has their weight together, and the grids that have all of them.
fn sweep(
    samples: &mut Samples<'_>,
    nodes: &[Node],
    d: usize,
    outer: Node,
    x: &mut [f64; 4],
    sums: &mut [f64],
) {
    for node in nodes {
        x[d] = node.x;
        let (weight, grids) = (outer.weight * node.weight, outer.grids.min(node.grids));
        if d > 0 {
            sweep(samples, nodes, d - 1, Node { weight, grids, ..*node }, x, sums);
            continue;
        }
        let value = weight * samples.at(*x);
        for sum in &mut sums[..grids] {
            *sum += value;
        }
    }
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
