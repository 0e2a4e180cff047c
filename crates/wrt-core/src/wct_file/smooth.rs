//! Patches of smooth radiance: their description and their two sections.

use super::description::{RAW, Section};
use super::{ChartKind, PatchGeometry};
use crate::DirectionMap;
use crate::legendre::LegendreTree;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The radiance that leaves one side of one polygon, in Legendre polynomials.
#[derive(Clone, Debug, PartialEq)]
pub struct SmoothPatch {
    /// What a scene binds it by.
    pub name: String,
    /// Where it is.
    pub polygon: PatchGeometry,
    /// The radiance.
    pub tree: LegendreTree,
    /// ‖error‖ / ‖L‖ as the projection tells it.
    pub relative_error: f64,
    /// The same against an independent computation, where it was checked.
    pub error_estimate: Option<f64>,
}

impl SmoothPatch {
    /// What is wrong with it, its tree apart: a [`LegendreTree`] is sound.
    pub(super) fn faults(&self) -> Vec<String> {
        super::write::faults(&self.polygon, self.relative_error, self.error_estimate)
    }
}

/// Fields in alphabetical order, as in the file.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct SmoothDescription {
    pub(super) basis: SmoothBasis,
    pub(super) chart: ChartKind,
    pub(super) coefficients: u64,
    #[serde(default)]
    pub(super) error_estimate: Option<f64>,
    pub(super) name: String,
    pub(super) relative_error: f64,
    pub(super) sections: BTreeMap<String, Section>,
    pub(super) step: f64,
    pub(super) vertices: Vec<[f64; 3]>,
}

#[derive(Debug, Serialize, Deserialize)]
pub(super) struct SmoothBasis {
    pub(super) directions: DirectionMap,
    pub(super) family: String,
}

/// The one family there is so far.
pub(super) const LEGENDRE: &str = "legendre";

/// The sections, in the order they are written.
pub(super) const SHAPE: &str = "shape";
pub(super) const QUANTA: &str = "quanta";

/// The description of `patch`, whose sections are added to `data`.
pub(super) fn describe(patch: &SmoothPatch, data: &mut Vec<u8>) -> SmoothDescription {
    let mut sections = BTreeMap::new();
    let tree = &patch.tree;
    for (name, bytes) in [(SHAPE, tree.shape().to_vec()), (QUANTA, varints(tree.quanta()))] {
        let section = Section {
            codec: RAW.to_owned(),
            crc32: crc32fast::hash(&bytes),
            dtype: "u8".to_owned(),
            nbytes: bytes.len() as u64,
            offset: data.len() as u64,
            shape: vec![bytes.len() as u64],
        };
        sections.insert(name.to_owned(), section);
        super::write::append(data, &bytes);
    }
    SmoothDescription {
        basis: SmoothBasis { directions: tree.map(), family: LEGENDRE.to_owned() },
        chart: patch.polygon.chart,
        coefficients: tree.quanta().len() as u64,
        error_estimate: patch.error_estimate,
        name: patch.name.clone(),
        relative_error: patch.relative_error,
        sections,
        step: tree.step(),
        vertices: patch.polygon.vertices.clone(),
    }
}

/// The patch of a description and of the bytes of its sections.
pub(super) fn assemble(
    description: SmoothDescription,
    shape: &[u8],
    quanta: &[u8],
) -> Result<SmoothPatch, String> {
    let quanta = from_varints(quanta)?;
    if quanta.len() as u64 != description.coefficients {
        let (found, promised) = (quanta.len(), description.coefficients);
        return Err(format!("{found} coefficients, where its description has {promised}"));
    }
    let map = description.basis.directions;
    let tree = LegendreTree::from_parts(map, shape.to_vec(), description.step, quanta)?;
    let patch = SmoothPatch {
        name: description.name,
        polygon: PatchGeometry { vertices: description.vertices, chart: description.chart },
        tree,
        relative_error: description.relative_error,
        error_estimate: description.error_estimate,
    };
    match patch.faults().into_iter().next() {
        Some(fault) => Err(fault),
        None => Ok(patch),
    }
}

/// Zigzag (0, −1, 1, −2, …) and then seven bits a byte, low ones first, all but the
/// last byte with its high bit set: most coefficients are small.
fn varints(values: &[i32]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(values.len());
    for &value in values {
        let mut rest = (value << 1 ^ value >> 31).cast_unsigned();
        while rest >= 0x80 {
            bytes.push(rest as u8 | 0x80);
            rest >>= 7;
        }
        bytes.push(rest as u8);
    }
    bytes
}

fn from_varints(bytes: &[u8]) -> Result<Vec<i32>, String> {
    let mut values = Vec::with_capacity(bytes.iter().filter(|b| **b < 0x80).count());
    let (mut rest, mut shift) = (0_u32, 0);
    for &byte in bytes {
        let part = u32::from(byte & 0x7f);
        // Five bytes at most, the last with four bits; and no zeros at the end, so
        // that equal values are equal bytes.
        if shift == 28 && byte > 0x0f || shift > 0 && byte == 0 {
            return Err("a coefficient that no writer produces".to_owned());
        }
        rest |= part << shift;
        shift += 7;
        if byte < 0x80 {
            values.push((rest >> 1).cast_signed() ^ -((rest & 1).cast_signed()));
            (rest, shift) = (0, 0);
        }
    }
    if shift > 0 { Err("its last coefficient stops early".to_owned()) } else { Ok(values) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn varints_come_back(values in proptest::collection::vec(any::<i32>(), 0..50)) {
            prop_assert_eq!(from_varints(&varints(&values)), Ok(values));
        }

        /// What is read is written as it was read.
        #[test]
        fn any_bytes_are_read_exactly_or_refused(
            bytes in proptest::collection::vec(any::<u8>(), 0..50),
        ) {
            if let Ok(values) = from_varints(&bytes) {
                prop_assert_eq!(varints(&values), bytes);
            }
        }
    }

    #[test]
    fn small_values_take_a_byte() {
        assert_eq!(varints(&[0, -1, 1, 63, -64, 64]), [0, 1, 2, 126, 127, 128, 1]);
        assert_eq!(from_varints(&varints(&[i32::MIN, i32::MAX])), Ok(vec![i32::MIN, i32::MAX]));
    }
}
