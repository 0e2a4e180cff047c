//! The `.wct` file: named wavelet coefficient trees with the polygons they
//! belong to, little-endian throughout.
//!
//! | bytes | type | field | limit |
//! |---|---|---|---|
//! | 0..8 | `[u8; 8]` | [`MAGIC`] | |
//! | 8..10 | `u16` | format version, [`MAJOR`]: a reader refuses a newer one | |
//! | 10..12 | `u16` | [`MINOR`]: what it adds may be skipped | |
//! | 12..16 | `u32` | flags | 0 |
//! | 16..24 | `u64` | length of the description j | a multiple of 64 |
//! | 24..32 | `u64` | length of the file | |
//! | 32..36 | `u32` | CRC-32 of the description | |
//! | 36..60 | | zero | |
//! | 60..64 | `u32` | CRC-32 of bytes 0..60 | |
//! | 64..64 + j | UTF-8 | description: JSON, then spaces | |
//! | 64 + j.. | | sections, each starting at a multiple of 64; zeros between | |
//!
//! The description is an object, written with its keys sorted; a reader skips
//! keys it does not know.
//!
//! | key | value |
//! |---|---|
//! | `basis` | of `patches`: `{"directions":"nusselt","family":"haar","order":1}`, or of a file with smooth patches alone `{"family":"legendre"}`, where earlier ones have the former; another one is refused |
//! | `colour_space`, `units` | `"linear Rec. 709"`, `"W sr^-1 m^-2"`; others are refused |
//! | `generator`, `input_hash` | what wrote the file, and of which input |
//! | `options` | object of strings: how it was made |
//! | `patches` | array of patches, with distinct names |
//! | `smooth_patches` | array of smooth patches, if there are any |
//!
//! A patch:
//!
//! | key | value | limit |
//! |---|---|---|
//! | `name` | what a scene binds it by | |
//! | `vertices` | `[[x, y, z], …]` in the world, metres, counter-clockwise | [`MAX_VERTICES`] |
//! | `chart` | `"rectilinear"`, `"rectilinear quad"`, `"perspective"`, `"bilinear"`: [`ChartKind`] | |
//! | `side` | `"incident"` or `"outgoing"`: [`Side`] | |
//! | `levels` | `{"direction":…,"position":…}`: [`Levels`](crate::Levels) | 16 |
//! | `root` | `[r, g, b]`, the pure smoothing coefficient | |
//! | `nodes`, `coefficients` | how many n, c | 2³² − 1 |
//! | `relative_error` | ‖dropped‖ / ‖L‖ of thresholding | |
//! | `error_estimate` | of the integration, relative, or `null` | |
//! | `sections` | by name: see below | |
//!
//! | section | `dtype` | `shape` | what |
//! |---|---|---|---|
//! | `child_mask` | `"u16"` | `[n]` | bit m′: child m′ exists; breadth first, children in order of m′ |
//! | `nu_mask` | `"u16"` | `[n]` | bit ν: coefficient b_ν exists |
//! | `coefficients` | `"f32"` | `[c, 3]` | node by node, by increasing ν |
//!
//! or, of a tree that has been quantised, since version 1.1, the one section
//!
//! | section | `codec` | `dtype` | `shape` | what |
//! |---|---|---|---|---|
//! | `tree` | `"region-haar"` | `"u8"` | `[nbytes]` | [`Tree::code`]: its step, and coefficients in arithmetic code |
//!
//! A smooth patch is outgoing radiance, with `name`, `vertices`, `chart`,
//! `relative_error`, `error_estimate` and `sections` as above, and
//!
//! | key | value | limit |
//! |---|---|---|
//! | `basis` | `{"directions":"equal-area","family":"legendre"}`, or `"concentric"`: [`DirectionMap`](crate::DirectionMap) | |
//! | `coefficients` | how many, all channels counted | |
//! | `step` | what they are multiples of | above 0 |
//!
//! | section | `dtype` | `shape` | what |
//! |---|---|---|---|
//! | `shape` | `"u8"` | `[bytes]` | the cells in preorder: [`LegendreTree::from_parts`](crate::legendre::LegendreTree::from_parts) |
//! | `quanta` | `"u8"` | `[bytes]` | the coefficients over the step, zigzag, LEB128 |
//!
//! A section is `{"codec":"raw","crc32":…,"dtype":…,"nbytes":…,"offset":…,"shape":…}`,
//! its offset counted from the end of the description. Another codec is
//! refused in these; other sections are skipped. m′ and ν have bits 0 to 3 for
//! u, v, κ and λ; see [`Tree`] for what the numbers mean.
//!
//! Raw sections are for exchange: `tests/read_wct.py` reads them in plain Python, smooth
//! patches, which have no others, among them. A coded tree needs this crate, and 5 to 20 times fewer bytes; `tracer convert` makes
//! either of the other.
//!
//! Every byte is covered: by a checksum, or by having to be zero. Reading needs
//! memory of at most 16 times the file's size or, where trees are coded, 6000
//! times and a megabyte a thread, whatever the file says; and equal values give equal
//! bytes.
//!
//! Sections are aligned to be mapped into memory, but [`WctFile::read`] copies them: a
//! mapped file that another process cuts short ends the program, where a damaged one
//! shall be an error. Little is lost: reading a raw file, checks included, takes 1 to 1.6
//! times as long as to touch as much fresh memory, which maps pay too, and to copy the
//! bytes there (`cargo bench -p wrt-core --bench file`).

mod aside;
mod description;
mod header;
mod read;
mod smooth;
mod write;

pub use aside::write_aside;
pub use description::{ChartKind, Side};
pub use header::{MAGIC, MAJOR, MINOR};
pub use smooth::SmoothPatch;

use crate::{Error, Polygon, Result, Tree};
use glam::DVec3;
use std::collections::BTreeMap;

/// Vertices a patch may have: what a polygon does with them takes their number
/// squared.
pub const MAX_VERTICES: usize = 1024;

/// What a `.wct` file holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WctFile {
    /// The patches, with names distinct from each other's and from those of
    /// [`smooth`](Self::smooth).
    pub patches: Vec<Patch>,
    /// Patches in Legendre polynomials.
    pub smooth: Vec<SmoothPatch>,
    /// The program that made it, with its version.
    pub generator: String,
    /// Hash of the scene it was made from, in the generator's own notation.
    pub input_hash: String,
    /// The options it was made with.
    pub options: BTreeMap<String, String>,
}

/// The radiance on one side of one polygon.
#[derive(Clone, Debug, PartialEq)]
pub struct Patch {
    /// What a scene binds it by.
    pub name: String,
    /// Where it is.
    pub polygon: PatchGeometry,
    /// Which way its directions point.
    pub side: Side,
    /// The radiance.
    pub tree: Tree,
    /// ‖dropped‖ / ‖L‖ of thresholding.
    pub relative_error: f64,
    /// The integration's own relative error, where it was estimated.
    pub error_estimate: Option<f64>,
}

/// A polygon as a file has it: enough to make the [`Polygon`] again.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchGeometry {
    /// In the world, metres, counter-clockwise seen from the lit side.
    pub vertices: Vec<[f64; 3]>,
    /// How (u, v) lies on it.
    pub chart: ChartKind,
}

impl PatchGeometry {
    /// The polygon.
    ///
    /// # Errors
    ///
    /// Those of the [`Polygon`] constructor that [`chart`](Self::chart) names.
    pub fn to_polygon(&self) -> Result<Polygon> {
        let vertices: Vec<DVec3> = self.vertices.iter().map(|&v| v.into()).collect();
        let quad = || {
            let wrong = Error::VertexCount { found: vertices.len(), needed: "4" };
            <[DVec3; 4]>::try_from(&vertices[..]).map_err(|_| wrong)
        };
        match self.chart {
            ChartKind::Rectilinear => Polygon::rectilinear(&vertices),
            ChartKind::RectilinearQuad => Polygon::rectilinear_quad(quad()?),
            ChartKind::Perspective => Polygon::perspective(quad()?),
            ChartKind::Bilinear => Polygon::bilinear(quad()?),
        }
    }
}

impl WctFile {
    /// The patch of that name.
    #[must_use]
    pub fn patch(&self, name: &str) -> Option<&Patch> {
        self.patches.iter().find(|patch| patch.name == name)
    }
}
