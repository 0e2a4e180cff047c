//! Transport of radiance from one polygon to another (§6.3, §7.1, §7.2).

mod block;
mod geometry;
mod integrate;
mod pair;
mod resample;

pub use block::{BlockOptions, Source, transport_block};
pub use geometry::TransportGeometry;
pub use integrate::{Exact, Integral, Integrator};
pub use pair::{Pair, Support};
