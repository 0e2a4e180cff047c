//! The JSON description. Fields are in alphabetical order: they are written in
//! the order they are declared.

use super::smooth::{LEGENDRE, SmoothDescription};
use crate::grid::Rgb;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;

/// Which way the directions of a radiance point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// Towards where the light comes from.
    Incident,
    /// Towards where it goes.
    Outgoing,
}

/// How a patch's vertices give its chart: which constructor of
/// [`Polygon`](crate::Polygon) they are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum ChartKind {
    /// [`Polygon::rectilinear`](crate::Polygon::rectilinear).
    #[serde(rename = "rectilinear")]
    Rectilinear,
    /// [`Polygon::rectilinear_quad`](crate::Polygon::rectilinear_quad).
    #[serde(rename = "rectilinear quad")]
    RectilinearQuad,
    /// [`Polygon::perspective`](crate::Polygon::perspective).
    #[serde(rename = "perspective")]
    Perspective,
    /// [`Polygon::bilinear`](crate::Polygon::bilinear).
    #[serde(rename = "bilinear")]
    Bilinear,
}

impl ChartKind {
    /// The fewest and the most vertices it takes.
    pub(super) fn vertices(self) -> (usize, usize) {
        match self {
            Self::Rectilinear => (3, super::MAX_VERTICES),
            _ => (4, 4),
        }
    }
}

/// All of it.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Description {
    pub(super) basis: Basis,
    pub(super) colour_space: String,
    pub(super) generator: String,
    pub(super) input_hash: String,
    pub(super) options: BTreeMap<String, String>,
    pub(super) patches: Vec<PatchDescription>,
    /// For what a later version adds to the whole file: read past, not written.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(super) sections: BTreeMap<String, Section>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) smooth_patches: Vec<SmoothDescription>,
    pub(super) units: String,
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Basis {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) directions: Option<String>,
    pub(super) family: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) order: Option<u32>,
}

impl Basis {
    /// That of [`Description::patches`].
    pub(super) fn haar() -> Self {
        Self { directions: Some("nusselt".to_owned()), family: "haar".to_owned(), order: Some(1) }
    }

    /// That of a file with none but [`Description::smooth_patches`], of which each says the
    /// rest itself.
    pub(super) fn smooth() -> Self {
        Self { directions: None, family: LEGENDRE.to_owned(), order: None }
    }
}

impl fmt::Display for Basis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.family)?;
        if let Some(order) = self.order {
            write!(f, " of order {order}")?;
        }
        if let Some(directions) = &self.directions {
            write!(f, " over {directions}")?;
        }
        Ok(())
    }
}

pub(super) const COLOUR_SPACE: &str = "linear Rec. 709";
pub(super) const UNITS: &str = "W sr^-1 m^-2";

#[derive(Debug, Serialize, Deserialize)]
pub(super) struct PatchDescription {
    pub(super) chart: ChartKind,
    pub(super) coefficients: u64,
    #[serde(default)]
    pub(super) error_estimate: Option<f64>,
    pub(super) levels: LevelsDescription,
    pub(super) name: String,
    pub(super) nodes: u64,
    pub(super) relative_error: f64,
    pub(super) root: Rgb,
    pub(super) sections: BTreeMap<String, Section>,
    pub(super) side: Side,
    pub(super) vertices: Vec<[f64; 3]>,
}

#[derive(Debug, Serialize, Deserialize)]
pub(super) struct LevelsDescription {
    pub(super) direction: u8,
    pub(super) position: u8,
}

#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Section {
    pub(super) codec: String,
    pub(super) crc32: u32,
    pub(super) dtype: String,
    pub(super) nbytes: u64,
    /// From the end of the description.
    pub(super) offset: u64,
    pub(super) shape: Vec<u64>,
}

/// The sections of a tree, in the order they are written.
pub(super) const CHILD_MASK: &str = "child_mask";
pub(super) const NU_MASK: &str = "nu_mask";
pub(super) const COEFFICIENTS: &str = "coefficients";

/// The one section of a tree that has been quantised.
pub(super) const TREE: &str = "tree";

/// A section as it lies in the file.
pub(super) const RAW: &str = "raw";

/// The bytes of [`Tree::code`](crate::Tree::code).
pub(super) const REGION_HAAR: &str = "region-haar";
