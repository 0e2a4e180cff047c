//! Single destination cells: the mean radiance that one source cell gives one
//! destination cell (Eq. 18), with an error estimate that holds.

use super::oracle::{Verdict, oracle};
use super::{Exact, Integrator, Method, Pair, Support, TransportGeometry};

/// What computes a single cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CellRule {
    /// The oracle, then Gauss rules between the integrand's kinks.
    Exact(Exact),
    /// A rule of §7.1.4.2, without the oracle.
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
        let (integral, widen) = match self {
            Self::Sampled(method) => (method.integrate(&pair), Self::SIGMAS),
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
                Verdict::Unknown => (exact.integrate(&pair), 1.0),
            },
        };
        CellRadiance {
            mean: integral.value * scale,
            error: integral.error * scale * widen,
            evaluations: integral.evaluations,
        }
    }
}
