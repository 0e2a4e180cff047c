//! Typed arrays in a glTF's buffers, every range checked before it is read.

use super::super::files::Files;
use super::buffer;
use super::document::{Chunk, get, valid};
use ::gltf::json::accessor::{ComponentType, IndexComponentType, Type};
use ::gltf::json::{Accessor, Index, Root, buffer as json};
use anyhow::{Context as _, bail, ensure};

/// The most elements of an accessor that has no bytes in the file to bound it.
const MAX_UNBACKED: u64 = 1 << 24;

/// A glTF's buffers, loaded.
#[derive(Debug)]
pub(super) struct Buffers<'a> {
    root: &'a Root,
    bytes: Vec<Vec<u8>>,
}

impl<'a> Buffers<'a> {
    /// Loads every buffer; `chunk` is a GLB's own.
    ///
    /// # Errors
    ///
    /// If one is missing or shorter than the file says.
    pub(super) fn load(
        root: &'a Root,
        chunk: Option<Chunk<'_>>,
        files: &Files<'_>,
    ) -> anyhow::Result<Self> {
        let mut chunk = chunk.map(Chunk::into_owned);
        let mut bytes = Vec::with_capacity(root.buffers.len());
        for (i, buffer) in root.buffers.iter().enumerate() {
            let contents = match &buffer.uri {
                Some(uri) => buffer::resolve(uri, files),
                None => chunk.take().context("it has no URI, and the file no binary chunk left"),
            };
            let contents = contents.and_then(|c| buffer::exactly(c, buffer.byte_length.0));
            bytes.push(contents.with_context(|| format!("buffer {i}"))?);
        }
        Ok(Self { root, bytes })
    }

    /// The bytes of a buffer view.
    ///
    /// # Errors
    ///
    /// If it reaches past its buffer.
    pub(super) fn view(&self, index: Index<json::View>) -> anyhow::Result<&[u8]> {
        let view = get(self.root, index, "buffer view")?;
        let buffer = self.bytes.get(view.buffer.value());
        let buffer =
            buffer.with_context(|| format!("there is no buffer {}", view.buffer.value()))?;
        range(buffer, view.byte_offset.map_or(0, |o| o.0), view.byte_length.0)
            .with_context(|| format!("buffer view {} reaches past its buffer", index.value()))
    }

    /// Vectors of `N` floats, from floats or (normalised) integers.
    ///
    /// # Errors
    ///
    /// If the accessor has another shape or reaches past its buffer.
    pub(super) fn floats<const N: usize>(
        &self,
        index: Index<Accessor>,
    ) -> anyhow::Result<Vec<[f32; N]>> {
        let accessor = get(self.root, index, "accessor")?;
        let component = valid(&accessor.component_type, "componentType")?.0;
        self.elements(accessor, |b| decode(component, accessor.normalized, b))
            .with_context(|| format!("accessor {}", index.value()))
    }

    /// How many components an element of the accessor has.
    ///
    /// # Errors
    ///
    /// If there is no such accessor, or none of its type.
    pub(super) fn components(&self, index: Index<Accessor>) -> anyhow::Result<usize> {
        Ok(valid(&get(self.root, index, "accessor")?.type_, "type")?.multiplicity())
    }

    /// Vertex indices.
    ///
    /// # Errors
    ///
    /// If the accessor is not of unsigned integers or reaches past its buffer.
    pub(super) fn indices(&self, index: Index<Accessor>) -> anyhow::Result<Vec<u32>> {
        let accessor = get(self.root, index, "accessor")?;
        let component = valid(&accessor.component_type, "componentType")?.0;
        ensure!(
            matches!(component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32),
            "accessor {} holds {component:?}, not indices",
            index.value()
        );
        let indices = self.elements::<1, u32>(accessor, little_endian);
        let indices = indices.with_context(|| format!("accessor {}", index.value()))?;
        Ok(indices.into_iter().flatten().collect())
    }

    fn elements<const N: usize, T: Copy + Default>(
        &self,
        accessor: &Accessor,
        decode: impl Fn(&[u8]) -> T,
    ) -> anyhow::Result<Vec<[T; N]>> {
        let shape = valid(&accessor.type_, "type")?;
        ensure!(shape.multiplicity() == N, "it is a {shape:?}, not of {N} components");
        ensure!(!matches!(shape, Type::Mat2), "it is a {shape:?}");
        let size = valid(&accessor.component_type, "componentType")?.0.size();
        let element = |slot: &[u8]| std::array::from_fn(|i| decode(&slot[i * size..][..size]));
        let count = accessor.count.0;
        let mut elements: Vec<[T; N]> = match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.map_or(0, |o| o.0);
                self.slots(view, offset, N * size, count)?.map(element).collect()
            }
            None => {
                ensure!(
                    accessor.sparse.is_some(),
                    "it has neither a buffer view nor sparse values"
                );
                ensure!(count <= MAX_UNBACKED, "{count} elements and no buffer view");
                let count = usize::try_from(count)?;
                vec![[T::default(); N]; count]
            }
        };
        if let Some(sparse) = &accessor.sparse {
            let IndexComponentType(at) = valid(&sparse.indices.component_type, "componentType")?;
            let (view, offset) = (sparse.indices.buffer_view, sparse.indices.byte_offset.0);
            let indices = self.slots(view, offset, at.size(), sparse.count.0)?;
            let (view, offset) = (sparse.values.buffer_view, sparse.values.byte_offset.0);
            let values = self.slots(view, offset, N * size, sparse.count.0)?;
            for (index, value) in indices.zip(values) {
                let slot = elements.get_mut(little_endian(index) as usize);
                *slot.context("a sparse index is past the last element")? = element(value);
            }
        }
        Ok(elements)
    }

    /// `count` slices of `size` bytes each, strided as the view says.
    fn slots(
        &self,
        index: Index<json::View>,
        offset: u64,
        size: usize,
        count: u64,
    ) -> anyhow::Result<impl Iterator<Item = &[u8]>> {
        let stride = get(self.root, index, "buffer view")?.byte_stride.map_or(size, |s| s.0);
        ensure!(stride >= size, "a stride of {stride} bytes for elements of {size}");
        let length = match count {
            0 => Some(0),
            _ => (stride as u64).checked_mul(count - 1).and_then(|l| l.checked_add(size as u64)),
        };
        let bytes = length.and_then(|length| range(self.view(index).ok()?, offset, length));
        match bytes {
            // The last chunk may be shorter than the stride, never than the size.
            Some(bytes) => Ok(bytes.chunks(stride).map(move |chunk| &chunk[..size])),
            None => {
                self.view(index)?;
                bail!("{count} elements reach past the end of buffer view {}", index.value())
            }
        }
    }
}

/// `bytes[offset..][..length]`, if it is there.
fn range(bytes: &[u8], offset: u64, length: u64) -> Option<&[u8]> {
    let start = usize::try_from(offset).ok()?;
    let end = usize::try_from(offset.checked_add(length)?).ok()?;
    bytes.get(start..end)
}

/// An unsigned integer of one, two or four bytes.
fn little_endian(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte))
}

/// One component as a float; the glTF specification's §3.11 for normalised integers.
fn decode(component: ComponentType, normalized: bool, bytes: &[u8]) -> f32 {
    let unsigned = little_endian(bytes);
    // Sign extension by truncation; the widths match by construction.
    let (value, limit) = match component {
        ComponentType::F32 => return f32::from_bits(unsigned),
        ComponentType::I8 => (f32::from(unsigned as u8 as i8), 127.0),
        ComponentType::U8 => (unsigned as f32, 255.0),
        ComponentType::I16 => (f32::from(unsigned as u16 as i16), 32767.0),
        ComponentType::U16 => (unsigned as f32, 65535.0),
        ComponentType::U32 => (unsigned as f32, 4294967295.0),
    };
    if normalized { (value / limit).max(-1.0) } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};
    use std::path::Path;

    /// Sixteen bytes 0, 1, … 15 behind one view, and the accessors given.
    fn with_accessors<R>(accessors: &[Value], test: impl Fn(&Buffers<'_>) -> R) -> R {
        let root: Root = serde_json::from_value(json!({
            "asset": {"version": "2.0"},
            "buffers": [{"byteLength": 16}],
            "bufferViews": [
                {"buffer": 0, "byteLength": 16},
                {"buffer": 0, "byteOffset": 4, "byteLength": 12, "byteStride": 4},
                {"buffer": 0, "byteOffset": 8, "byteLength": 9},
                {"buffer": 7, "byteLength": 1},
            ],
            "accessors": accessors
        }))
        .expect("glTF JSON");
        let chunk: Vec<u8> = (0..16).collect();
        let buffers = Buffers::load(&root, Some(chunk.into()), &Files::beside(Path::new("")))
            .expect("16 bytes");
        test(&buffers)
    }

    fn indices(accessor: Value) -> anyhow::Result<Vec<u32>> {
        with_accessors(&[accessor], |b| b.indices(Index::new(0)))
    }

    #[test]
    fn strides_and_offsets_are_followed() {
        let packed = json!({"bufferView": 0, "byteOffset": 2, "count": 3,
                            "componentType": 5123, "type": "SCALAR"});
        assert_eq!(indices(packed).expect("in range"), [0x0302, 0x0504, 0x0706]);
        let strided = json!({"bufferView": 1, "byteOffset": 1, "count": 3,
                             "componentType": 5121, "type": "SCALAR"});
        assert_eq!(indices(strided).expect("in range"), [5, 9, 13]);
    }

    #[test]
    fn normalised_integers_end_at_one() {
        assert_eq!(decode(ComponentType::U8, true, &[255]), 1.0);
        assert_eq!(decode(ComponentType::U8, false, &[255]), 255.0);
        assert_eq!(decode(ComponentType::I8, true, &[0x80]), -1.0);
        assert_eq!(decode(ComponentType::I16, true, &[0x01, 0x80]), -1.0);
        assert_eq!(decode(ComponentType::I16, false, &[0xff, 0xff]), -1.0);
        assert_eq!(decode(ComponentType::F32, false, &1.5_f32.to_le_bytes()), 1.5);
    }

    #[test]
    fn sparse_values_replace_the_base() {
        let accessor = json!({
            "count": 4, "componentType": 5121, "type": "SCALAR",
            "sparse": {
                "count": 2,
                "indices": {"bufferView": 0, "byteOffset": 1, "componentType": 5121},
                "values": {"bufferView": 0, "byteOffset": 14}
            }
        });
        assert_eq!(indices(accessor).expect("in range"), [0, 14, 15, 0]);
    }

    #[test]
    fn ranges_past_the_end_are_errors() {
        let accessor = |view: u32, offset: u64, count: u64, component: u32, shape: &str| {
            json!({"bufferView": view, "byteOffset": offset, "count": count,
                   "componentType": component, "type": shape})
        };
        for (accessor, expected) in [
            (accessor(0, 0, 9, 5123, "SCALAR"), "9 elements reach past the end of buffer view 0"),
            (accessor(0, 15, 1, 5123, "SCALAR"), "1 elements reach past"),
            (accessor(0, u64::MAX, 1, 5123, "SCALAR"), "reach past"),
            (accessor(0, 0, u64::MAX, 5123, "SCALAR"), "reach past"),
            (accessor(1, 0, 4, 5121, "SCALAR"), "reach past"),
            (accessor(2, 0, 1, 5121, "SCALAR"), "buffer view 2 reaches past its buffer"),
            (accessor(3, 0, 1, 5121, "SCALAR"), "there is no buffer 7"),
            (accessor(4, 0, 1, 5121, "SCALAR"), "there is no buffer view 4"),
            (accessor(0, 0, 1, 5126, "SCALAR"), "holds F32, not indices"),
            (accessor(0, 0, 1, 5121, "VEC2"), "it is a Vec2, not of 1 components"),
            (accessor(0, 0, 1, 1234, "SCALAR"), "componentType has a value"),
            (
                json!({"count": 9_999_999_999_u64, "componentType": 5121, "type": "SCALAR",
                       "sparse": {"count": 0, "values": {"bufferView": 0},
                                  "indices": {"bufferView": 0, "componentType": 5121}}}),
                "no buffer view",
            ),
        ] {
            let text = format!("{:#}", indices(accessor).expect_err("out of range"));
            assert!(text.contains(expected), "{text}");
        }
        let missing = with_accessors(&[], |b| b.indices(Index::new(3)));
        assert_eq!(missing.expect_err("none at all").to_string(), "there is no accessor 3");
    }
}
