//! Integrators of a transport coefficient (`tc_integrate`, §7.1.4.2, §7.2.4.2).

mod beam;
mod events;
mod exact;
#[cfg(test)]
mod facts;
mod method;
mod monte_carlo;
mod nested;
mod piece;
mod quasi_random;
mod romberg;
mod sampling;
mod strips;
mod trapezoidal;
mod visible;

use super::Pair;

pub(super) use beam::{Beam, Bends, integrals};
pub(super) use strips::Strip;

pub use exact::Exact;
pub use method::Method;
pub use monte_carlo::MonteCarlo;
pub use quasi_random::{QuasiRandom, Sequence};
pub use romberg::{Degree, Romberg};
pub use sampling::Dimensions;
pub use trapezoidal::Trapezoidal;

/// What an integrator says of one coefficient.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Integral {
    /// T_jk.
    pub value: f64,
    /// Estimated absolute error of `value`.
    pub error: f64,
    /// How many times the integrand was evaluated.
    pub evaluations: u64,
}

/// A way to compute T_jk for pure smoothing functions j and k.
pub trait Integrator: Sync + std::fmt::Debug {
    /// What it is called in reports: method, dimensions, samples.
    fn name(&self) -> String;

    /// T_jk of this pair of cells.
    fn integrate(&self, pair: &Pair<'_>) -> Integral;
}
