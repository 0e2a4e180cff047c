//! Wavelet radiative transfer.

mod chart;
mod convex;
mod emission;
mod error;
mod gather;
pub mod grid;
mod haar;
mod index;
mod interaction;
pub mod metrics;
mod nusselt;
mod polygon;
mod sampler;
pub mod transport;
mod tree;
pub mod wct_file;

pub use chart::Chart;
pub use convex::ConvexPolygon;
pub use emission::{Emission, Lobe};
pub use error::{Error, Result};
pub use gather::gather;
pub use grid::{Grid, Rgb};
pub use haar::{CHILDREN, pull, push};
pub use index::{Cell, Levels, WaveletIndex, children};
pub use interaction::{LobeMatrix, Phong, phong_lobe, reflect};
pub use nusselt::{Nusselt, udc_fraction};
pub use polygon::{Frame, Polygon};
pub use sampler::Sampler;
pub use tree::{Compression, Keep, Node, Tree, TreeBuilder};
pub use wct_file::{Patch, PatchGeometry, WctFile};
