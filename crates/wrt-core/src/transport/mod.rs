//! Transport of radiance from one polygon to another (§6.3, §7.1, §7.2).

mod geometry;
mod integrate;
mod pair;

pub use geometry::TransportGeometry;
pub use integrate::{
    Degree, Dimensions, Integral, Integrator, Method, MonteCarlo, QuasiRandom, Romberg, Sequence,
    Trapezoidal,
};
pub use pair::{Pair, Support};
