//! [`WctFile`] to bytes.

use super::description::{
    Basis, CHILD_MASK, COEFFICIENTS, COLOUR_SPACE, Description, LevelsDescription, NU_MASK,
    PatchDescription, RAW, REGION_HAAR, Section, TREE, UNITS,
};
use super::header::{ALIGN, Header, MINOR};
use super::{Patch, PatchGeometry, WctFile, smooth, write_aside};
use crate::{Error, Node, Result, Tree};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

impl WctFile {
    /// The bytes of the file.
    ///
    /// # Panics
    ///
    /// If it holds what a reader would refuse: see [`check`](Self::check).
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        if let Err(error) = self.check() {
            panic!("{error}");
        }
        let mut data = Vec::new();
        let patches = self.patches.iter().map(|patch| describe(patch, &mut data)).collect();
        let smooth = self.smooth.iter().map(|patch| smooth::describe(patch, &mut data));
        let smooth_patches = smooth.collect();
        let is_smooth = self.patches.is_empty() && !self.smooth.is_empty();
        let description = Description {
            basis: if is_smooth { Basis::smooth() } else { Basis::haar() },
            colour_space: COLOUR_SPACE.to_owned(),
            generator: self.generator.clone(),
            input_hash: self.input_hash.clone(),
            options: self.options.clone(),
            patches,
            sections: BTreeMap::new(),
            smooth_patches,
            units: UNITS.to_owned(),
        };
        let mut text =
            serde_json::to_vec(&description).expect("strings and finite numbers are JSON");
        text.resize(text.len().next_multiple_of(ALIGN), b' ');
        let is_coded = self.patches.iter().any(|patch| patch.tree.code().is_some());
        let header = Header {
            minor: if is_coded { MINOR } else { 0 },
            description_len: text.len() as u64,
            file_len: (ALIGN + text.len() + data.len()) as u64,
            description_crc: crc32fast::hash(&text),
        };
        [&header.to_bytes()[..], &text, &data].concat()
    }

    /// Writes the file beside `path` and renames it.
    ///
    /// # Errors
    ///
    /// Those of [`check`](Self::check), and [`Error::Io`]. A file that was at
    /// `path` is then still there, and nothing beside it.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        self.check()?;
        Ok(write_aside(path.as_ref(), &self.to_bytes())?)
    }

    /// Whether a reader would take it.
    ///
    /// # Errors
    ///
    /// [`Error::BadPatch`] for a patch with the name of another, a number of
    /// vertices that its chart does not take, or a number that is not finite.
    pub fn check(&self) -> Result<()> {
        let mut names = BTreeSet::new();
        let patches = self.patches.iter().map(|patch| (&patch.name, patch.faults()));
        let smooth = self.smooth.iter().map(|patch| (&patch.name, patch.faults()));
        for (name, mut reasons) in patches.chain(smooth) {
            if !names.insert(name) {
                reasons.insert(0, "an earlier patch has the same name".to_owned());
            }
            if let Some(reason) = reasons.into_iter().next() {
                return Err(Error::BadPatch { patch: name.clone(), reason, offset: None });
            }
        }
        Ok(())
    }
}

impl Patch {
    /// What is wrong with it, its tree apart: a [`Tree`] is sound.
    pub(super) fn faults(&self) -> Vec<String> {
        faults(&self.polygon, self.relative_error, self.error_estimate)
    }
}

/// What is wrong with a patch of any basis.
pub(super) fn faults(
    polygon: &PatchGeometry,
    relative_error: f64,
    error_estimate: Option<f64>,
) -> Vec<String> {
    let mut faults = Vec::new();
    let (fewest, most) = polygon.chart.vertices();
    let found = polygon.vertices.len();
    if !(fewest..=most).contains(&found) {
        faults.push(format!("{found} vertices, where {fewest} to {most} are allowed"));
    }
    if !polygon.vertices.iter().flatten().all(|x| x.is_finite()) {
        faults.push("a vertex is not finite".to_owned());
    }
    for (what, error) in
        [("relative_error", Some(relative_error)), ("error_estimate", error_estimate)]
    {
        if let Some(error) = error.filter(|e| !(e.is_finite() && *e >= 0.0)) {
            faults.push(format!("its {what} is {error}"));
        }
    }
    faults
}

/// Adds a section's bytes, and zeros up to where the next one may start.
pub(super) fn append(data: &mut Vec<u8>, bytes: &[u8]) {
    data.extend_from_slice(bytes);
    data.resize(data.len().next_multiple_of(ALIGN), 0);
}

/// The description of `patch`, whose sections are added to `data`.
fn describe(patch: &Patch, data: &mut Vec<u8>) -> PatchDescription {
    let (n, c) = (patch.tree.nodes().len() as u64, patch.tree.coefficients().len() as u64);
    let mut sections = BTreeMap::new();
    for Stored { name, codec, dtype, shape, bytes } in stored(&patch.tree) {
        let section = Section {
            codec: codec.to_owned(),
            crc32: crc32fast::hash(&bytes),
            dtype: dtype.to_owned(),
            nbytes: bytes.len() as u64,
            offset: data.len() as u64,
            shape,
        };
        sections.insert(name.to_owned(), section);
        append(data, &bytes);
    }
    let levels = patch.tree.levels();
    PatchDescription {
        chart: patch.polygon.chart,
        coefficients: c,
        error_estimate: patch.error_estimate,
        levels: LevelsDescription { direction: levels.direction, position: levels.position },
        name: patch.name.clone(),
        nodes: n,
        relative_error: patch.relative_error,
        root: patch.tree.root(),
        sections,
        side: patch.side,
        vertices: patch.polygon.vertices.clone(),
    }
}

/// A section to be.
struct Stored<'a> {
    name: &'static str,
    codec: &'static str,
    dtype: &'static str,
    shape: Vec<u64>,
    bytes: Cow<'a, [u8]>,
}

/// A tree's sections: its code if it has one, else masks and coefficients.
fn stored(tree: &Tree) -> Vec<Stored<'_>> {
    if let Some(code) = tree.code() {
        let shape = vec![code.len() as u64];
        let bytes = code.into();
        return vec![Stored { name: TREE, codec: REGION_HAAR, dtype: "u8", shape, bytes }];
    }
    let (nodes, coefficients) = (tree.nodes(), tree.coefficients());
    let (n, c) = (nodes.len() as u64, coefficients.len() as u64);
    let raw = |name, dtype, shape, bytes: Vec<u8>| Stored {
        name,
        codec: RAW,
        dtype,
        shape,
        bytes: bytes.into(),
    };
    let masks =
        |of: fn(&Node) -> u16| nodes.iter().flat_map(move |node| of(node).to_le_bytes()).collect();
    let floats = coefficients.iter().flatten().flat_map(|x| x.to_le_bytes());
    vec![
        raw(CHILD_MASK, "u16", vec![n], masks(|node| node.child_mask)),
        raw(NU_MASK, "u16", vec![n], masks(|node| node.nu_mask)),
        raw(COEFFICIENTS, "f32", vec![c, 3], floats.collect()),
    ]
}
