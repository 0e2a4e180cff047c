//! Single destination cells: the mean radiance that one source cell gives one
//! destination cell (Eq. 18), with an error estimate that holds.

use super::oracle::{Verdict, oracle};
use super::{Exact, Integral, Integrator, Method, Pair, Support, TransportGeometry};
use crate::{CHILDREN, Levels};

/// What computes a single cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CellRule {
    /// The oracle, then Gauss rules between the integrand's kinks.
    Exact(Exact),
    /// A rule of §7.1.4.2, without the oracle. Make it by [`From`], which tells
    /// `exact` from the others.
    Sampled(Method),
}

/// The mean radiance over a destination cell whose source cell emits radiance 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellRadiance {
    /// Mean over the cell of position × direction; what of the cell lies outside
    /// the UDC counts as 0.
    pub mean: f64,
    /// Bound on the absolute error of `mean`.
    pub error: f64,
    /// How many times the integrand was evaluated; 0 if geometry alone decided.
    pub evaluations: u64,
}

impl CellRadiance {
    /// Estimated |found − true| / true, in \[0, ∞\].
    ///
    /// 1 for a mean of 0 that is not proven: were anything there, all of it would
    /// be missing.
    #[must_use]
    pub fn relative_error(&self) -> f64 {
        if self.error == 0.0 {
            0.0
        } else if self.mean == 0.0 {
            1.0
        } else if self.error < self.mean {
            // Relative to the least that the truth can be.
            self.error / (self.mean - self.error)
        } else {
            f64::INFINITY
        }
    }
}

impl From<Method> for CellRule {
    fn from(method: Method) -> Self {
        match method {
            Method::Exact(exact) => Self::Exact(exact),
            sampled => Self::Sampled(sampled),
        }
    }
}

impl CellRule {
    /// Standard errors, or differences from the grid before, that make a bound of
    /// a sampling rule's estimate.
    const SIGMAS: f64 = 4.0;

    /// The mean radiance over the `dest` cell of light from the `source` cell
    /// alone, which emits radiance 1: T_jk 4^l_k / 4^l_j.
    #[must_use]
    pub fn radiance(
        &self,
        geometry: &TransportGeometry,
        source: Support,
        dest: Support,
    ) -> CellRadiance {
        let pair = Pair::new(geometry, source, dest);
        let scale = dest.scale() / source.scale();
        let integral = match self {
            Self::Sampled(method) => {
                let found = method.integrate(&pair);
                let error = Self::SIGMAS * found.error + found.value * resolution(*method, &found);
                Integral { error, ..found }
            }
            Self::Exact(exact) => match oracle(&pair) {
                Verdict::Zero => return CellRadiance { mean: 0.0, error: 0.0, evaluations: 0 },
                Verdict::Whole(t) => {
                    let mean = t * scale;
                    return CellRadiance {
                        mean,
                        error: 16.0 * f64::EPSILON * mean,
                        evaluations: 0,
                    };
                }
                Verdict::Unknown => exact.integrate(&pair),
            },
        };
        let mut error = integral.error * scale;
        if matches!(self, Self::Exact(_)) && integral.value == 0.0 {
            let blind = is_blind(geometry, source, dest, 2);
            error = if blind { 0.0 } else { f64::EPSILON };
        }
        CellRadiance { mean: integral.value * scale, error, evaluations: integral.evaluations }
    }
}

/// Whether the oracle proves of all parts of the dest cell, split `depth` times,
/// that they see nothing of the source cell.
pub(super) fn is_blind(
    geometry: &TransportGeometry,
    source: Support,
    dest: Support,
    depth: u8,
) -> bool {
    match oracle(&Pair::new(geometry, source, dest)) {
        Verdict::Zero => true,
        Verdict::Unknown if depth > 0 && dest.levels.depth() < Levels::MAX => {
            let levels =
                Levels { position: dest.levels.position + 1, direction: dest.levels.direction + 1 };
            (0..CHILDREN).all(|m_prime| {
                let m = std::array::from_fn(|d| 2 * dest.m[d] + (m_prime >> d & 1) as u16);
                is_blind(geometry, source, Support { levels, m }, depth - 1)
            })
        }
        _ => false,
    }
}

/// The least relative error to believe of so many samples: two grids can agree by
/// chance. Kinks of the integrand over direction cost a grid O(h²), with h² = 1/n
/// in two dimensions, and the jumps of the indicator O(h), with h⁴ = 1/n.
fn resolution(method: Method, found: &Integral) -> f64 {
    let n = found.evaluations.max(1) as f64;
    if method.name().contains("4d") { 0.5 * n.powf(-0.25) } else { 1.0 / n }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Polygon;
    use glam::DVec3;

    /// A zero that nothing proves is not passed off as exact.
    #[test]
    fn zeros_are_certain_only_where_geometry_says_so() {
        let square = |o, u, v| Polygon::rectangle(o, u, v).expect("a square");
        let floor = square(DVec3::ZERO, DVec3::X, DVec3::Y);
        let cell = Support::isotropic(0, [0; 4]);
        let rule = CellRule::Exact(Exact::default());
        let away = TransportGeometry::new(square(DVec3::Z, DVec3::X, DVec3::Y), floor.clone());
        let found = rule.radiance(&away, cell, cell);
        assert_eq!((found.mean, found.relative_error()), (0.0, 0.0));
        let sampled: Method = "trapezoid2d:5".parse().expect("a method");
        let speck = square(DVec3::new(0.3, 0.3, 9.0), 1e-3 * DVec3::Y, 1e-3 * DVec3::X);
        let speck = TransportGeometry::new(speck, floor);
        let narrow = Support::isotropic(3, [1, 1, 4, 4]);
        let missed = CellRule::Sampled(sampled).radiance(&speck, cell, narrow);
        assert_eq!((missed.mean, missed.relative_error()), (0.0, 1.0));
    }
}
