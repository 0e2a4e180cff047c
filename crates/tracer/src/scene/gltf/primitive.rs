//! One primitive of a glTF mesh, as triangles.

use super::super::load::Warnings;
use super::super::{Mesh, Shape};
use super::accessor::Buffers;
use super::document::valid;
use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Accessor, Index};
use anyhow::{Context as _, ensure};
use glam::{Vec2, Vec3, Vec4};

/// Reads `primitive`, or `None` for points and lines: its shape, which is still to be
/// placed, and the rest of its mesh.
///
/// The mesh's name, material and receiver mark are left to the caller.
///
/// # Errors
///
/// If an attribute is malformed, not finite or not one a vertex.
pub(super) fn read(
    buffers: &Buffers<'_>,
    primitive: &Primitive,
    owner: &str,
    warnings: &mut Warnings,
) -> anyhow::Result<Option<(Shape, Mesh)>> {
    warn_of_the_rest(primitive, owner, warnings);
    let mode = valid(&primitive.mode, "mode")?;
    if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
        warnings.ignored("points and lines", owner);
        return Ok(None);
    }
    let attribute = |semantic: Semantic| -> Option<Index<Accessor>> {
        primitive.attributes.get(&Checked::Valid(semantic)).copied()
    };
    let Some(positions) = attribute(Semantic::Positions) else {
        warnings.ignored("primitives without positions", owner);
        return Ok(None);
    };
    let positions = buffers.floats::<3>(positions).context("POSITION")?;
    let count = positions.len();
    let indices = match primitive.indices {
        Some(index) => buffers.indices(index).context("indices")?,
        None => (0..u32::try_from(count).context("POSITION")?).collect(),
    };
    if let Some(past) = indices.iter().find(|&&i| i as usize >= count) {
        anyhow::bail!("indices: there is no vertex {past}, only {count} of them");
    }
    let normals = match attribute(Semantic::Normals) {
        Some(index) => {
            let normals = buffers.floats::<3>(index).context("NORMAL")?;
            ensure!(normals.len() == count, "NORMAL: {} for {count} vertices", normals.len());
            normals
        }
        None => Vec::new(),
    };
    let mut uvs = [Vec::new(), Vec::new()];
    for (set, uvs) in (0..).zip(&mut uvs) {
        if let Some(index) = attribute(Semantic::TexCoords(set)) {
            let name = || format!("TEXCOORD_{set}");
            let read = buffers.floats::<2>(index).with_context(name)?;
            ensure!(read.len() == count, "{}: {} for {count} vertices", name(), read.len());
            *uvs = read.into_iter().map(Vec2::from).collect();
            ensure!(uvs.iter().all(|uv| uv.is_finite()), "{}: one is not finite", name());
        }
    }
    let colours = attribute(Semantic::Colors(0)).map(|index| colours(buffers, index, count));
    let colours = colours.transpose().context("COLOR_0")?.unwrap_or_default();
    let tangents = match attribute(Semantic::Tangents) {
        Some(index) if !normals.is_empty() => {
            let tangents = buffers.floats::<4>(index).context("TANGENT")?;
            ensure!(tangents.len() == count, "TANGENT: {} for {count} vertices", tangents.len());
            tangents
        }
        _ => Vec::new(),
    };
    let shape = Shape { positions, normals, tangents, triangles: assemble(mode, &indices) };
    Ok(Some((shape, Mesh { uvs, colours, ..Mesh::default() })))
}

/// Linear colours with alpha; of three components, it is 1.
fn colours(
    buffers: &Buffers<'_>,
    index: Index<Accessor>,
    count: usize,
) -> anyhow::Result<Vec<Vec4>> {
    let read: Vec<Vec4> = if buffers.components(index)? == 3 {
        let rgb = buffers.floats::<3>(index)?;
        rgb.into_iter().map(|c| Vec3::from(c).extend(1.0)).collect()
    } else {
        buffers.floats::<4>(index)?.into_iter().map(Vec4::from).collect()
    };
    ensure!(read.len() == count, "{} for {count} vertices", read.len());
    let valid = |c: &Vec4| c.is_finite() && c.min_element() >= 0.0;
    ensure!(read.iter().all(valid), "one is negative or not finite");
    Ok(read)
}

fn warn_of_the_rest(primitive: &Primitive, owner: &str, warnings: &mut Warnings) {
    if primitive.targets.as_ref().is_some_and(|t| !t.is_empty()) {
        warnings.ignored("morph targets", owner);
    }
    if primitive.attributes.contains_key(&Checked::Valid(Semantic::Colors(1))) {
        warnings.ignored("vertex colours beyond the first", owner);
    }
}

/// Triangles of a list, strip or fan, counter-clockwise (glTF 2.0, §3.7.2.1).
///
/// Those with a repeated vertex, which strips turn corners with, are left out.
fn assemble(mode: Mode, v: &[u32]) -> Vec<[u32; 3]> {
    let all: Vec<[u32; 3]> = match mode {
        Mode::TriangleStrip => v
            .windows(3)
            .enumerate()
            .map(|(i, w)| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] })
            .collect(),
        Mode::TriangleFan => {
            v.get(1..).unwrap_or_default().windows(2).map(|w| [w[0], w[1], v[0]]).collect()
        }
        _ => v.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
    };
    all.into_iter().filter(|[a, b, c]| a != b && b != c && c != a).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_alternate_and_fans_share_the_first_vertex() {
        let strip = assemble(Mode::TriangleStrip, &[0, 1, 2, 3, 4]);
        assert_eq!(strip, [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
        let fan = assemble(Mode::TriangleFan, &[7, 1, 2, 3]);
        assert_eq!(fan, [[1, 2, 7], [2, 3, 7]]);
        let list = assemble(Mode::Triangles, &[0, 1, 2, 2, 1, 3, 9]);
        assert_eq!(list, [[0, 1, 2], [2, 1, 3]]);
    }

    #[test]
    fn degenerate_and_missing_triangles_are_left_out() {
        let strip = assemble(Mode::TriangleStrip, &[0, 1, 2, 2, 3, 4]);
        assert_eq!(strip, [[0, 1, 2], [2, 4, 3]]);
        for mode in [Mode::Triangles, Mode::TriangleStrip, Mode::TriangleFan] {
            for len in 0..3 {
                assert!(assemble(mode, &[0, 1, 2][..len]).is_empty(), "{mode:?} of {len}");
            }
        }
    }
}
