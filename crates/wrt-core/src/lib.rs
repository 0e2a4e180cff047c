//! Wavelet radiative transfer.

mod chart;
mod convex;
mod error;
mod haar;
mod index;
pub mod metrics;
mod nusselt;
mod polygon;
pub mod transport;

pub use chart::Chart;
pub use convex::ConvexPolygon;
pub use error::{Error, Result};
pub use haar::{CHILDREN, pull, push};
pub use index::{Cell, Levels, WaveletIndex, children};
pub use nusselt::{Nusselt, udc_fraction};
pub use polygon::{Frame, Polygon};
