//! Wavelet radiative transfer: radiance as 4-D wavelet coefficients, moved between
//! polygons and reflected by them.
//!
//! Follows R. R. Lewis and A. Fournier, *Wavelet Radiative Transfer and Surface
//! Interaction*, Eurographics 2002, called "the paper" throughout; `§7.1.4` and
//! `Eq. 21` without a source are its section and equation numbers.
//!
//! # The flow
//!
//! [`Emission`] → [`transport`] → [`reflect`] → [`Tree`] → [`WctFile`] →
//! [`Sampler`]: what leaves a window, what arrives on a floor, what the floor
//! reflects, its coefficients, kept, and looked up by a raytracer.
//!
//! # Notation
//!
//! | paper | here | meaning | range, unit |
//! |---|---|---|---|
//! | u, v | `u`, `v` | position on a polygon | `[0, 1]` |
//! | κ, λ | [`Nusselt`] | direction: (μx + 1)/2, (μy + 1)/2 | `[0, 1]`, inside the UDC |
//! | ν, l, **m** | [`WaveletIndex`] | which basis function | ν `0..16`, m `0..2^l` |
//! | L | radiance | per channel, linear Rec. 709 | W m⁻² sr⁻¹ |
//! | E, Φ | [`Irradiance`], its `flux` | 4 ∬ L dκ dλ, ∬ E dA | W m⁻², W |
//! | T_jk | [`transport_coefficient`](transport::transport_coefficient) | source function j to destination function k | |
//! | UDC | unit directional circle | the disc that the hemisphere fills in (κ, λ) | |
//!
//! # Conventions
//!
//! World space is right-handed, in metres. A polygon's frame (x̂, ŷ, n̂) is
//! orthonormal and n̂ is its emitting or receiving side. Directions point *away*
//! from the surface: incident ones to where the light comes from, outgoing ones to
//! the eye. Computation is in f64, coefficients are stored in f32.

pub mod beams;
mod chart;
mod convex;
mod emission;
mod error;
mod gather;
mod glazing;
pub mod grid;
mod haar;
mod hemisphere;
mod index;
mod interaction;
pub mod legendre;
pub mod metrics;
pub mod multiwavelet;
mod nusselt;
mod polygon;
mod radiometry;
mod sampler;
mod sky;
mod sobol;
pub mod transport;
mod tree;
pub mod wct_file;

pub use chart::Chart;
pub use convex::ConvexPolygon;
pub use emission::{Emission, Lobe, cone_solid_angle, cosine_power};
pub use error::{Error, Result};
pub use gather::gather;
pub use glazing::Glazing;
pub use grid::{Grid, Rgb};
pub use haar::{CHILDREN, pull, push};
pub use hemisphere::DirectionMap;
pub use index::{Cell, Levels, WaveletIndex, children};
pub use interaction::{
    BrdfTree, Bsdf, Interface, LobeMatrix, Patches, Phong, Ring, disc_of_square, mirrored,
    phong_lobe, reflect, square_of_disc,
};
pub use nusselt::{Nusselt, udc_fraction};
pub use polygon::{Frame, Polygon};
pub use radiometry::Irradiance;
pub use sampler::{MipSampler, Sampler};
pub use sky::{Sky, SkyModel, Sun};
pub use sobol::sobol;
pub use tree::{Compression, Difference, Keep, Node, Quantisation, Tree, TreeBuilder};
pub use wct_file::{Patch, PatchGeometry, SmoothPatch, WctFile};
