//! Transport of radiance from one polygon to another (§6.3, §7.1, §7.2).

mod block;
mod cell;
mod cover;
mod directions;
mod geometry;
mod handover;
mod integrate;
mod oracle;
mod outline;
mod pair;
mod recursion;
mod refine;
mod shape;
mod slice;
mod source;
mod sparse;
mod stencil;
mod summed;

pub use block::{BlockOptions, Transported, transport_block, transport_within};
pub use cell::{CellRadiance, CellRule};
pub use geometry::TransportGeometry;
pub use integrate::{
    Degree, Dimensions, Exact, Integral, Integrator, Method, MonteCarlo, QuasiRandom, Romberg,
    Sequence, Trapezoidal,
};
pub use oracle::{Verdict, oracle};
pub use pair::{Pair, Support};
pub use recursion::{
    Counts, RecursionOptions, transport_coefficient, transport_tree, transport_tree_below,
};
pub use source::{Kinks, Source};
pub use sparse::{Sparse, transport_sparse};
