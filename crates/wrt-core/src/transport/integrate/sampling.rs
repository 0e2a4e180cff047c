//! What every sampling rule shares: which form of the integral it samples, and
//! what its samples say of T_jk.

use super::{Integral, visible::visible_box};
use crate::transport::Pair;

/// Which form of the integral of T_jk is sampled (§7.1.4.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dimensions {
    /// G_j A_jk over direction; the overlap of positions is exact.
    Two,
    /// The indicator of Eq. 18 over position and direction.
    Four,
}

impl Dimensions {
    /// 2 or 4.
    #[must_use]
    pub fn count(self) -> usize {
        match self {
            Self::Two => 2,
            Self::Four => 4,
        }
    }

    /// T_jk of an integrand whose mean over the unit square or hypercube is 1.
    ///
    /// The direction cell measures 4^−l_d in (κ, λ). A_jk is an area of (u, v)
    /// already, so that only in four dimensions the position cell's 4^−l_p
    /// comes in as well.
    fn measure(self, pair: &Pair<'_>) -> f64 {
        let levels = pair.dest().levels;
        let direction = pair.scale() * quarters(levels.direction);
        match self {
            Self::Two => direction,
            Self::Four => direction * quarters(levels.position),
        }
    }

    /// The largest value of the integrand.
    fn bound(self, pair: &Pair<'_>) -> f64 {
        match self {
            Self::Two => quarters(pair.dest().levels.position),
            Self::Four => 1.0,
        }
    }
}

/// 4^−level.
fn quarters(level: u8) -> f64 {
    0.25_f64.powi(level.into())
}

/// The integrand of a pair, and what its samples had in common.
pub(super) struct Samples<'a> {
    dimensions: Dimensions,
    pair: &'a Pair<'a>,
    /// Cell coordinates of the sampled box: low corner, and extent.
    low: [f64; 2],
    extent: [f64; 2],
    count: u64,
    least: f64,
    greatest: f64,
}

impl<'a> Samples<'a> {
    /// The integrand over the whole cell.
    pub(super) fn new(dimensions: Dimensions, pair: &'a Pair<'a>) -> Self {
        Self::within(dimensions, pair, [[0.0; 2], [1.0; 2]])
    }

    /// The integrand over a box [low, high] of the direction cell, outside which
    /// it is zero.
    pub(super) fn within(
        dimensions: Dimensions,
        pair: &'a Pair<'a>,
        [low, high]: [[f64; 2]; 2],
    ) -> Self {
        let extent = [high[0] - low[0], high[1] - low[1]];
        let (least, greatest) = (f64::INFINITY, f64::NEG_INFINITY);
        Self { dimensions, pair, low, extent, count: 0, least, greatest }
    }

    /// The integrand at `x`: (κ, λ) in two dimensions, (u, v, κ, λ) in four, each
    /// in [0, 1]. What is past [`Dimensions::count`] is ignored.
    pub(super) fn at(&mut self, x: [f64; 4]) -> f64 {
        let boxed = |d: usize, x: f64| self.low[d] + self.extent[d] * x;
        let value = match self.dimensions {
            Dimensions::Two => self.pair.integrand_2d([boxed(0, x[0]), boxed(1, x[1])]),
            Dimensions::Four => {
                self.pair.integrand_4d([x[0], x[1], boxed(0, x[2]), boxed(1, x[3])])
            }
        };
        self.count += 1;
        self.least = self.least.min(value);
        self.greatest = self.greatest.max(value);
        value
    }

    /// T_jk from the integrand's estimated mean and the error of that.
    ///
    /// Samples that all agree have an error estimate of 0 by any rule. But the part
    /// `hidden` of the cell may still have any value up to the integrand's bound,
    /// so no less than that is reported; none of it if the visible box is empty.
    pub(super) fn integral(&self, mean: f64, error: f64, hidden: f64) -> Integral {
        let measure = self.dimensions.measure(self.pair) * self.extent[0] * self.extent[1];
        let unseen = if self.least == self.greatest {
            let area = |[low, high]: [[f64; 2]; 2]| (high[0] - low[0]) * (high[1] - low[1]);
            let room = visible_box(self.pair).map_or(0.0, area) / (self.extent[0] * self.extent[1]);
            self.dimensions.bound(self.pair) * hidden.min(room)
        } else {
            0.0
        };
        Integral {
            value: measure * mean,
            error: measure * error.max(unseen),
            evaluations: self.count,
        }
    }
}

/// Mean and its standard error, of equally weighted parts that estimate the same
/// quantity independently: √(Σ (p − p̄)² / (n (n − 1))).
pub(super) fn mean_and_error(parts: &[f64]) -> (f64, f64) {
    let n = parts.len() as f64;
    let mean = parts.iter().sum::<f64>() / n;
    let squares: f64 = parts.iter().map(|p| (p - mean).powi(2)).sum();
    (mean, (squares / (n * (n - 1.0))).sqrt())
}
