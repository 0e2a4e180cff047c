//! Bytes to [`WctFile`], believing nothing.

use super::description::{
    Basis, CHILD_MASK, COEFFICIENTS, COLOUR_SPACE, Description, NU_MASK, PatchDescription, RAW,
    REGION_HAAR, Section, TREE, UNITS,
};
use super::header::{ALIGN, Header};
use super::smooth::{self, SmoothDescription};
use super::{Patch, PatchGeometry, SmoothPatch, WctFile};
use crate::{Error, Levels, Result, Tree};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::fs::File;
use std::io::Read as _;
use std::path::Path;

impl WctFile {
    /// Reads the file at `path`.
    ///
    /// # Errors
    ///
    /// Those of [`from_bytes`](Self::from_bytes), and [`Error::Io`].
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let mut file = File::open(path)?;
        // The header first, so that something endless is not read to its end.
        let mut bytes = Vec::with_capacity(ALIGN);
        file.by_ref().take(ALIGN as u64).read_to_end(&mut bytes)?;
        let header = Header::from_bytes(&bytes)?;
        let rest = header.file_len - ALIGN as u64;
        file.take(rest.saturating_add(1)).read_to_end(&mut bytes)?;
        Self::from_bytes(&bytes)
    }

    /// Reads the bytes of a file. They may be anything: there is no panic, and no
    /// more memory in use than 16 times their number, or 6000 times that of coded
    /// trees and a megabyte for each thread that decodes them.
    ///
    /// # Errors
    ///
    /// [`Error::NotWct`], [`Error::UnsupportedVersion`] and
    /// [`Error::Unsupported`] for what is not this build's to read,
    /// [`Error::Truncated`] if the end is missing, and [`Error::Checksum`],
    /// [`Error::BadField`], [`Error::Description`], [`Error::BadDescription`] and
    /// [`Error::BadPatch`] for what no writer produces.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let header = Header::from_bytes(bytes)?;
        let found = bytes.len() as u64;
        if found < header.file_len {
            return Err(Error::Truncated { found, needed: header.file_len });
        }
        if found > header.file_len {
            return Err(Error::BadField {
                what: "the file's length",
                found: header.file_len.to_string(),
                allowed: format!("{found}, as long as it is"),
                offset: 24,
            });
        }
        // The header's lengths are those of `bytes` now, and so fit usize.
        let (text, data) = bytes[ALIGN..].split_at(header.description_len as usize);
        if crc32fast::hash(text) != header.description_crc {
            let what = "the description".to_owned();
            return Err(Error::Checksum { what, offset: ALIGN as u64 });
        }
        let description: Description =
            serde_json::from_slice(text).map_err(|error| Error::Description {
                reason: error.to_string(),
                offset: (ALIGN + offset_of(text, &error)) as u64,
            })?;
        description.check_conventions()?;
        let data = Data { bytes: data, start: (ALIGN + text.len()) as u64 };
        data.check(&description)?;
        let mut names = BTreeSet::new();
        let patches = description.patches.iter().map(|patch| &patch.name);
        for name in patches.chain(description.smooth_patches.iter().map(|patch| &patch.name)) {
            if !names.insert(name) {
                let reason = "an earlier patch has the same name";
                return Err(bad_patch(name, reason, ALIGN as u64));
            }
        }
        // Decoding takes nearly all of the time, and each patch stands for itself.
        let patches = description.patches.into_par_iter().enumerate();
        let patches: Vec<Result<Patch>> = patches.map(|(i, patch)| data.patch(i, patch)).collect();
        let smooth = description.smooth_patches.into_par_iter().enumerate();
        let smooth: Vec<Result<SmoothPatch>> =
            smooth.map(|(i, patch)| data.smooth_patch(i, patch)).collect();
        Ok(Self {
            // The first error, whichever was met first.
            patches: patches.into_iter().collect::<Result<_>>()?,
            smooth: smooth.into_iter().collect::<Result<_>>()?,
            generator: description.generator,
            input_hash: description.input_hash,
            options: description.options,
        })
    }
}

/// Where in `text` the parser stopped.
fn offset_of(text: &[u8], error: &serde_json::Error) -> usize {
    let lines = text.split_inclusive(|&b| b == b'\n');
    let before: usize = lines.take(error.line().saturating_sub(1)).map(<[u8]>::len).sum();
    before + error.column().saturating_sub(1)
}

impl Description {
    /// That numbers mean here what they mean to this build.
    fn check_conventions(&self) -> Result<()> {
        let unsupported = |what: &str, found: String, known: String| {
            Err(Error::Unsupported { what: what.to_owned(), found, known, offset: ALIGN as u64 })
        };
        let is_smooth = self.basis == Basis::smooth() && self.patches.is_empty();
        if self.basis != Basis::haar() && !is_smooth {
            return unsupported("basis", self.basis.to_string(), Basis::haar().to_string());
        }
        if self.colour_space != COLOUR_SPACE {
            return unsupported("colour_space", self.colour_space.clone(), COLOUR_SPACE.to_owned());
        }
        if self.units != UNITS {
            return unsupported("units", self.units.clone(), UNITS.to_owned());
        }
        Ok(())
    }

    /// All sections, with where in the description each is.
    fn sections(&self) -> impl Iterator<Item = (String, &Section)> {
        let patches = self.patches.iter().enumerate().flat_map(|(i, patch)| {
            patch.sections.iter().map(move |(name, section)| (path(i, name), section))
        });
        let smooth = self.smooth_patches.iter().enumerate().flat_map(|(i, patch)| {
            patch.sections.iter().map(move |(name, section)| (smooth_path(i, name), section))
        });
        self.sections
            .iter()
            .map(|(name, section)| (format!("sections.{name}"), section))
            .chain(patches)
            .chain(smooth)
    }
}

fn path(patch: usize, section: &str) -> String {
    format!("patches[{patch}].sections.{section}")
}

fn smooth_path(patch: usize, section: &str) -> String {
    format!("smooth_patches[{patch}].sections.{section}")
}

/// What follows the description.
#[derive(Clone, Copy)]
struct Data<'a> {
    bytes: &'a [u8],
    /// Where it starts in the file.
    start: u64,
}

impl<'a> Data<'a> {
    /// That the sections lie inside, apart from each other and undamaged, with
    /// nothing but zeros between.
    fn check(self, description: &Description) -> Result<()> {
        let len = self.bytes.len() as u64;
        let mut sections: Vec<(String, &Section)> = description.sections().collect();
        for (path, section) in &sections {
            let Section { offset, nbytes, .. } = **section;
            if !offset.is_multiple_of(ALIGN as u64) {
                return Err(bad(&format!("{path}.offset"), offset, "a multiple of 64"));
            }
            if offset > len {
                return Err(bad(&format!("{path}.offset"), offset, &format!("at most {len}")));
            }
            if nbytes > len - offset {
                let allowed = format!("at most {}, the rest of the file", len - offset);
                return Err(bad(&format!("{path}.nbytes"), nbytes, &allowed));
            }
        }
        sections.sort_by_key(|(_, section)| (section.offset, section.nbytes));
        let mut end = 0;
        for (path, section) in &sections {
            if section.offset < end {
                let allowed = format!("at least {end}, where another section ends");
                return Err(bad(&format!("{path}.offset"), section.offset, &allowed));
            }
            self.check_zero(end, section.offset)?;
            end = section.offset + section.nbytes;
            if crc32fast::hash(self.slice(section)) != section.crc32 {
                let offset = self.start + section.offset;
                return Err(Error::Checksum { what: path.clone(), offset });
            }
        }
        self.check_zero(end, len)
    }

    fn check_zero(self, from: u64, to: u64) -> Result<()> {
        let gap = &self.bytes[from as usize..to as usize];
        match gap.iter().position(|&b| b != 0) {
            None => Ok(()),
            Some(at) => Err(Error::BadField {
                what: "a byte outside all sections",
                found: gap[at].to_string(),
                allowed: "0".to_owned(),
                offset: self.start + from + at as u64,
            }),
        }
    }

    /// The bytes of a section that [`check`](Self::check) has passed.
    fn slice(self, section: &Section) -> &'a [u8] {
        &self.bytes[section.offset as usize..][..section.nbytes as usize]
    }

    /// The bytes of a section of patch `i`, once they are of the type and number
    /// wanted.
    fn section(
        self,
        (i, patch): (usize, &PatchDescription),
        (name, codec): (&str, &str),
        dtype: (&str, u64),
        shape: &[u64],
    ) -> Result<&'a [u8]> {
        self.checked((&path(i, name), codec), patch.sections.get(name), dtype, shape)
    }

    fn checked(
        self,
        (path, codec): (&str, &str),
        section: Option<&Section>,
        (dtype, size): (&str, u64),
        shape: &[u64],
    ) -> Result<&'a [u8]> {
        let Some(section) = section else {
            return Err(bad(path, "missing", "there"));
        };
        if section.codec != codec {
            return Err(Error::Unsupported {
                what: format!("{path}.codec"),
                found: section.codec.clone(),
                known: codec.to_owned(),
                offset: ALIGN as u64,
            });
        }
        if section.dtype != dtype {
            return Err(bad(&format!("{path}.dtype"), &section.dtype, dtype));
        }
        if section.shape != shape {
            let found = format!("{:?}", section.shape);
            return Err(bad(&format!("{path}.shape"), found, &format!("{shape:?}")));
        }
        let needed = shape.iter().try_fold(size, |product, &n| product.checked_mul(n));
        if needed != Some(section.nbytes) {
            let allowed = format!("{size} for each of {shape:?}");
            return Err(bad(&format!("{path}.nbytes"), section.nbytes, &allowed));
        }
        Ok(self.slice(section))
    }

    fn patch(self, i: usize, patch: PatchDescription) -> Result<Patch> {
        let (n, c) = (patch.nodes, patch.coefficients);
        for (what, count) in [("nodes", n), ("coefficients", c)] {
            if count > u64::from(u32::MAX) {
                return Err(bad(&format!("patches[{i}].{what}"), count, "below 2^32"));
            }
        }
        let levels = Levels { position: patch.levels.position, direction: patch.levels.direction };
        for (what, level) in [("position", levels.position), ("direction", levels.direction)] {
            if level > Levels::MAX {
                return Err(bad(&format!("patches[{i}].levels.{what}"), level, "at most 16"));
            }
        }
        let tree = match patch.sections.get(TREE) {
            Some(section) => self.coded_tree((i, &patch), section, levels)?,
            None => self.raw_tree((i, &patch), levels)?,
        };
        let patch = Patch {
            polygon: PatchGeometry { vertices: patch.vertices, chart: patch.chart },
            side: patch.side,
            tree,
            relative_error: patch.relative_error,
            error_estimate: patch.error_estimate,
            name: patch.name,
        };
        match patch.faults().first() {
            Some(fault) => Err(bad_patch(&patch.name, fault, ALIGN as u64)),
            None => Ok(patch),
        }
    }

    /// The tree of masks and coefficients as they are.
    fn raw_tree(self, (i, patch): (usize, &PatchDescription), levels: Levels) -> Result<Tree> {
        let (n, c) = (patch.nodes, patch.coefficients);
        let section =
            |name, dtype, shape: &[u64]| self.section((i, patch), (name, RAW), dtype, shape);
        let child_masks = section(CHILD_MASK, ("u16", 2), &[n])?;
        let nu_masks = section(NU_MASK, ("u16", 2), &[n])?;
        let floats = section(COEFFICIENTS, ("f32", 4), &[c, 3])?;
        let masks: Vec<(u16, u16)> = u16s(child_masks).zip(u16s(nu_masks)).collect();
        let coefficients = floats.as_chunks::<12>().0.iter().map(|rgb| {
            std::array::from_fn(|c| {
                f32::from_le_bytes([rgb[4 * c], rgb[4 * c + 1], rgb[4 * c + 2], rgb[4 * c + 3]])
            })
        });
        let offset = self.start + patch.sections[CHILD_MASK].offset;
        Tree::from_parts(levels, patch.root, &masks, coefficients.collect())
            .map_err(|reason| bad_patch(&patch.name, &reason, offset))
    }

    /// The tree that a section has quantised.
    fn coded_tree(
        self,
        (i, patch): (usize, &PatchDescription),
        section: &Section,
        levels: Levels,
    ) -> Result<Tree> {
        let shape = [section.nbytes];
        let bytes = self.section((i, patch), (TREE, REGION_HAAR), ("u8", 1), &shape)?;
        let tree = Tree::from_code(levels, bytes)
            .map_err(|reason| bad_patch(&patch.name, &reason, self.start + section.offset))?;
        // What the description says for those who do not decode it.
        let (nodes, coefficients) = (tree.nodes().len() as u64, tree.coefficients().len() as u64);
        for (what, found, decoded) in
            [("nodes", patch.nodes, nodes), ("coefficients", patch.coefficients, coefficients)]
        {
            if found != decoded {
                let allowed = format!("{decoded}, as its code has");
                return Err(bad(&format!("patches[{i}].{what}"), found, &allowed));
            }
        }
        if patch.root != tree.root() {
            let allowed = format!("{:?}, as its code has", tree.root());
            return Err(bad(&format!("patches[{i}].root"), format!("{:?}", patch.root), &allowed));
        }
        Ok(tree)
    }
}

impl<'a> Data<'a> {
    fn smooth_patch(self, i: usize, patch: SmoothDescription) -> Result<SmoothPatch> {
        if patch.basis.family != smooth::LEGENDRE {
            return Err(Error::Unsupported {
                what: format!("smooth_patches[{i}].basis.family"),
                found: patch.basis.family,
                known: smooth::LEGENDRE.to_owned(),
                offset: ALIGN as u64,
            });
        }
        let bytes = |name: &str| -> Result<&'a [u8]> {
            let section = patch.sections.get(name);
            let shape = section.map_or(0, |section| section.nbytes);
            self.checked((&smooth_path(i, name), RAW), section, ("u8", 1), &[shape])
        };
        let (shape, quanta) = (bytes(smooth::SHAPE)?, bytes(smooth::QUANTA)?);
        let offset = self.start + patch.sections[smooth::SHAPE].offset;
        let name = patch.name.clone();
        smooth::assemble(patch, shape, quanta).map_err(|reason| bad_patch(&name, &reason, offset))
    }
}

fn u16s(bytes: &[u8]) -> impl Iterator<Item = u16> {
    bytes.as_chunks::<2>().0.iter().map(|&b| u16::from_le_bytes(b))
}

fn bad(path: &str, found: impl std::fmt::Display, allowed: &str) -> Error {
    Error::BadDescription {
        path: path.to_owned(),
        found: found.to_string(),
        allowed: allowed.to_owned(),
        offset: ALIGN as u64,
    }
}

fn bad_patch(patch: &str, reason: &str, offset: u64) -> Error {
    let (patch, reason) = (patch.to_owned(), reason.to_owned());
    Error::BadPatch { patch, reason, offset: Some(offset) }
}
