//! T_jk to round-off: nested rules on the pieces between the integrand's kinks.

use super::super::pair::Pair;
use super::events::events;
use super::piece::{Estimate, Piece, Pieces};
use super::strips::strips;
use super::{Integral, Integrator};

/// Integrates between its events (kinks and jumps), where the integrand is analytic.
///
/// With μ = (sinθ, cosθ sinφ, cosθ cosφ) the rim's square root disappears:
/// 4 dκ dλ = cos²θ cosφ dθ dφ. The outer variable θ is cut wherever events cross
/// each other, the cell or the rim, or turn back; between two cuts the same events
/// bound the same pieces of the inner one, which are mapped onto squares. Each gets
/// 5 × 5 or 7 × 7 points of nested rules, and those with the largest estimated errors longer
/// rules and halves, until the sum of all errors is within the tolerance.
///
/// Departs from §7.1.4.2, whose rules all ignore the kinks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exact {
    /// Relative error asked for.
    pub tolerance: f64,
}

/// Where refinement ends, because what is left to refine is rounding: overlaps of
/// slivers do not have the digits that a tolerance may ask for. The estimate then
/// says what is left.
const MOST_EVALUATIONS: u64 = 2_000_000;

impl Default for Exact {
    /// 10⁻¹², near what double precision leaves of the overlap areas.
    fn default() -> Self {
        Self { tolerance: 1e-12 }
    }
}

impl Integrator for Exact {
    fn name(&self) -> String {
        format!("exact:{:e}", self.tolerance)
    }

    fn integrate(&self, pair: &Pair<'_>) -> Integral {
        if pair.sources().is_empty() || pair.dests().is_empty() {
            return Integral { value: 0.0, error: 0.0, evaluations: 0 };
        }
        let events = events(pair);
        let strips = strips(pair.dest_box(), &events);
        let mut evaluations = 0;
        // Shorter ones can hardly prove so many digits.
        let first_rule = usize::from(self.tolerance < 1e-8);
        let at = Pieces::of(pair, &events, None);
        let mut open = Open::default();
        for piece in Piece::all(&at, &strips, first_rule, &mut evaluations) {
            open.add(&at, 0, 1.0, piece, &mut evaluations);
        }
        let (value, error) =
            open.settle(std::slice::from_ref(&at), [self.tolerance, 0.0], &mut evaluations);
        let scale = 0.25 * pair.scale();
        let rounding = 4.0 * f64::EPSILON * value;
        // An estimate below the tolerance may be luck: no more is claimed than asked.
        let error = error.max(self.tolerance * value);
        Integral { value: value * scale, error: (error + rounding) * scale, evaluations }
    }
}

/// Pieces of one or several pairs, of which a weighted sum is wanted.
#[derive(Debug, Default)]
pub(super) struct Open {
    all: Vec<OpenPiece>,
}

#[derive(Debug)]
struct OpenPiece {
    /// Which of the pairs it belongs to, and what that counts.
    pair: usize,
    weight: f64,
    piece: Piece,
    estimate: Estimate,
}

impl Open {
    /// Adds a piece of the pair with that number, which counts `weight` ≥ 0.
    pub(super) fn add(
        &mut self,
        at: &Pieces<'_, '_>,
        pair: usize,
        weight: f64,
        piece: Piece,
        evaluations: &mut u64,
    ) {
        let estimate = piece.integral(at, evaluations);
        self.all.push(OpenPiece { pair, weight, piece, estimate });
    }

    /// The sum and its error estimate: the pieces of the largest errors are refined
    /// until the errors of all are within `relative` of the sum, or within `absolute`, or
    /// below what rounding leaves of it.
    pub(super) fn settle(
        &mut self,
        pairs: &[Pieces<'_, '_>],
        [relative, absolute]: [f64; 2],
        evaluations: &mut u64,
    ) -> (f64, f64) {
        let most = *evaluations + MOST_EVALUATIONS;
        loop {
            let sum = |part: fn(&Estimate) -> f64| {
                self.all.iter().map(|open| open.weight * part(&open.estimate)).sum::<f64>()
            };
            let (value, rounding) = (sum(|e| e.value), sum(|e| e.rounding));
            let error = sum(Estimate::error);
            let allowed = (relative * value).max(absolute).max(rounding);
            if error <= allowed || *evaluations >= most {
                return (value, error + rounding);
            }
            // All at once that stand above what each may have: few rounds suffice.
            let share = 0.5 * allowed / self.all.len() as f64;
            for i in 0..self.all.len() {
                let OpenPiece { pair, weight, piece, estimate } = &self.all[i];
                let (pair, weight) = (*pair, *weight);
                let least = share.max(0.1 * weight * estimate.rounding);
                if weight * estimate.error() <= least {
                    continue;
                }
                let [one, other] = piece.refined(estimate.errors);
                let at = &pairs[pair];
                if let Some(piece) = one {
                    let estimate = piece.integral(at, evaluations);
                    self.all[i] = OpenPiece { pair, weight, piece, estimate };
                }
                if let Some(piece) = other {
                    self.add(at, pair, weight, piece, evaluations);
                }
            }
        }
    }

    /// The sum over the pieces of each of so many pairs, unweighted.
    pub(super) fn values(&self, pairs: usize) -> Vec<f64> {
        let mut values = vec![0.0; pairs];
        for open in &self.all {
            values[open.pair] += open.estimate.value;
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::{Support, TransportGeometry};
    use crate::{Levels, Polygon, udc_fraction};
    use std::f64::consts::PI;

    fn rectangle(origin: [f64; 3], u: [f64; 3], v: [f64; 3]) -> Polygon {
        Polygon::rectangle(origin.into(), u.into(), v.into()).expect("a rectangle")
    }

    fn whole() -> Support {
        Support::isotropic(0, [0; 4])
    }

    /// πF/4 = T at the root (E = πF L, and the mean of L over the hypercube is
    /// E/4). F from J. R. Howell's catalog, C-11: facing unit squares, distance 1.
    #[test]
    fn facing_squares_have_their_form_factor_to_twelve_digits() {
        let floor = rectangle([0., 0., 0.], [1., 0., 0.], [0., 1., 0.]);
        let ceiling = rectangle([0., 0., 1.], [0., 1., 0.], [1., 0., 0.]);
        let geometry = TransportGeometry::new(ceiling, floor);
        let (x, y) = (1.0_f64, 1.0_f64);
        let (p, q) = (1.0 + x * x, 1.0 + y * y);
        let form = 2.0 / (PI * x * y)
            * ((p * q / (1.0 + x * x + y * y)).sqrt().ln()
                + x * q.sqrt() * (x / q.sqrt()).atan()
                + y * p.sqrt() * (y / p.sqrt()).atan()
                - x * x.atan()
                - y * y.atan());
        let result = Exact::default().integrate(&Pair::new(&geometry, whole(), whole()));
        let expected = PI * form / 4.0;
        assert!((result.value / expected - 1.0).abs() < 1e-12, "{result:?} {expected}");
        assert!(result.error < 1e-11 * expected, "{result:?}");
    }

    /// Perpendicular unit squares that share an edge: F = 0.20004377607540315
    /// (Howell C-14, H = W = 1).
    #[test]
    fn squares_that_share_an_edge_have_their_form_factor() {
        let floor = rectangle([0., 0., 0.], [1., 0., 0.], [0., 1., 0.]);
        let wall = rectangle([0., 1., 0.], [1., 0., 0.], [0., 0., 1.]);
        let geometry = TransportGeometry::new(wall, floor);
        let form = (2.0 * 1.0_f64.atan() - 2.0_f64.sqrt() * (0.5_f64).sqrt().atan()
            + 0.25 * (4.0_f64 / 3.0 * (3.0_f64 / 4.0).powi(2)).ln())
            / PI;
        let result = Exact::default().integrate(&Pair::new(&geometry, whole(), whole()));
        let expected = PI * form / 4.0;
        assert!((result.value / expected - 1.0).abs() < 1e-11, "{result:?} {expected}");
    }

    /// A source that fills the hemisphere: every direction cell gets its own part
    /// of the UDC.
    #[test]
    fn cells_under_a_huge_source_hold_their_udc_fraction() {
        let floor = rectangle([0., 0., 0.], [1., 0., 0.], [0., 1., 0.]);
        let sky = rectangle([-1e9, 1e9, 1.], [2e9, 0., 0.], [0., -2e9, 0.]);
        let geometry = TransportGeometry::new(sky, floor);
        let levels = Levels { position: 0, direction: 2 };
        for k in 0..16_u16 {
            let (kappa, lambda) = (k % 4, k / 4);
            let dest = Support { levels, m: [0, 0, kappa, lambda] };
            let pair = Pair::new(&geometry, whole(), dest);
            let at = |m: u16| f64::from(m) / 4.0;
            let fraction = udc_fraction([at(kappa), at(lambda)], [at(kappa + 1), at(lambda + 1)]);
            let mean = Exact::default().integrate(&pair).value * dest.scale();
            assert!((mean - fraction).abs() < 1e-8, "cell {k}: {mean} {fraction}");
        }
    }

    /// What leaves a source cell whose rays all land arrives: Σ_k T_jk = A_s / A_d for
    /// k of j's level, by whatever angle the two are turned.
    #[test]
    fn coefficients_of_a_cell_whose_rays_all_land_sum_to_the_ratio_of_areas() {
        let floor = rectangle([-8., -9., 0.], [16., 0., 0.], [0., 16., 0.]);
        let level = [[0., 0., 1.], [0., 1., 0.], [1., 0., 0.]];
        let tilted = [[0.1, -0.2, 0.9], [0.0, 0.96, 0.28], [0.96, -0.0784, 0.2688]];
        for [origin, u, v] in [level, tilted] {
            let source = rectangle(origin, u, v);
            let expected = source.area() / floor.area();
            let geometry = TransportGeometry::new(source, floor.clone());
            // Directions within 45° of the source's normal.
            let j = Support::isotropic(2, [1, 2, 1, 2]);
            let exact = Exact::default();
            let mut sum = 0.0;
            for i in 0..256_u16 {
                let k = Support::isotropic(2, [i & 3, i >> 2 & 3, i >> 4 & 3, i >> 6]);
                sum += exact.integrate(&Pair::new(&geometry, j, k)).value;
            }
            assert!((sum / expected - 1.0).abs() < 1e-10, "{sum} {expected}");
        }
    }

    /// T of the parts sums to T of the whole, over source and destination cells in
    /// position and direction.
    #[test]
    fn parts_sum_to_the_whole() {
        let dest = rectangle([0., 0., 0.], [1., 0., 0.], [0., 1., 0.]);
        let tilted = rectangle([0.3, 0.9, 0.4], [0.6, -0.2, 0.1], [0.15, 0.25, 0.8]);
        let geometry = TransportGeometry::new(tilted, dest);
        let exact = Exact::default();
        let measure = |s: Support, d: Support| {
            exact.integrate(&Pair::new(&geometry, s, d)).value / (s.scale() * d.scale())
        };
        let parent = Support::isotropic(1, [1, 0, 1, 1]);
        let child = |parent: Support, m: usize| {
            let m = std::array::from_fn(|d| 2 * parent.m[d] + (m >> d & 1) as u16);
            Support::isotropic(parent.levels.position + 1, m)
        };
        let whole_source = Support::isotropic(0, [0; 4]);
        let whole = measure(whole_source, parent);
        assert!(whole > 1e-3, "the case sees light: {whole}");
        let over_dest: f64 = (0..16).map(|m| measure(whole_source, child(parent, m))).sum();
        let over_source: f64 = (0..16).map(|m| measure(child(whole_source, m), parent)).sum();
        assert!((over_dest / whole - 1.0).abs() < 1e-11, "{over_dest} {whole}");
        assert!((over_source / whole - 1.0).abs() < 1e-11, "{over_source} {whole}");
    }
}
