//! One primitive of a glTF mesh, as world-space triangles.

use super::super::Mesh;
use super::super::load::Warnings;
use super::accessor::Buffers;
use super::document::valid;
use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Accessor, Index};
use anyhow::{Context as _, ensure};
use glam::{DAffine3, DMat3, DVec3, Vec2, Vec3, Vec4};

/// Reads `primitive` through `transform`, or `None` for points and lines.
///
/// The mesh's name, material and receiver mark are left to the caller.
///
/// # Errors
///
/// If an attribute is malformed, not finite or not one a vertex.
pub(super) fn read(
    buffers: &Buffers<'_>,
    primitive: &Primitive,
    transform: DAffine3,
    owner: &str,
    warnings: &mut Warnings,
) -> anyhow::Result<Option<Mesh>> {
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
    let positions: Vec<DVec3> = positions
        .into_iter()
        .map(|p| transform.transform_point3(DVec3::from(p.map(f64::from))))
        .collect();
    let odd = positions.iter().position(|p| !p.is_finite());
    ensure!(odd.is_none(), "POSITION: vertex {} is not finite", odd.unwrap_or_default());

    let indices = match primitive.indices {
        Some(index) => buffers.indices(index).context("indices")?,
        None => (0..u32::try_from(count).context("POSITION")?).collect(),
    };
    if let Some(past) = indices.iter().find(|&&i| i as usize >= count) {
        anyhow::bail!("indices: there is no vertex {past}, only {count} of them");
    }
    let mut triangles = assemble(mode, &indices);
    if transform.matrix3.determinant() < 0.0 {
        // A reflection turns the winding: turn it back to keep the front.
        triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }

    let normals = match attribute(Semantic::Normals) {
        Some(index) => {
            let normals = buffers.floats::<3>(index).context("NORMAL")?;
            ensure!(normals.len() == count, "NORMAL: {} for {count} vertices", normals.len());
            world_normals(&normals, &transform, &positions, &triangles)
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
            tangents.into_iter().map(|t| world_tangent(t.into(), &transform)).collect()
        }
        _ => Vec::new(),
    };
    Ok(Some(Mesh {
        positions,
        normals,
        uvs,
        colours,
        tangents,
        triangles,
        transform,
        ..Mesh::default()
    }))
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

/// A tangent in world space, with the sign of a bitangent that a reflection turns;
/// zero where it has no direction.
fn world_tangent(tangent: Vec4, transform: &DAffine3) -> Vec4 {
    let along = transform.matrix3 * tangent.truncate().as_dvec3();
    let sign = tangent.w * transform.matrix3.determinant().signum() as f32;
    along.normalize_or_zero().as_vec3().extend(sign)
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

/// Unit normals in world space: n′ ∝ M⁻ᵀ n.
///
/// A normal that is zero or not finite becomes that of a triangle it belongs to.
fn world_normals(
    normals: &[[f32; 3]],
    transform: &DAffine3,
    positions: &[DVec3],
    triangles: &[[u32; 3]],
) -> Vec<Vec3> {
    // The cofactors are M⁻ᵀ times the determinant, and exist when it is zero.
    let m = transform.matrix3;
    let sign = if m.determinant() < 0.0 { -1.0 } else { 1.0 };
    let cofactors = sign
        * DMat3::from_cols(
            m.y_axis.cross(m.z_axis),
            m.z_axis.cross(m.x_axis),
            m.x_axis.cross(m.y_axis),
        );
    let unit = |n: &[f32; 3]| (cofactors * DVec3::from(n.map(f64::from))).try_normalize();
    let mut units: Vec<Option<DVec3>> = normals.iter().map(unit).collect();
    if units.iter().any(Option::is_none) {
        for triangle in triangles {
            let [a, b, c] = triangle.map(|i| positions[i as usize]);
            let flat = (b - a).cross(c - a).try_normalize();
            for &i in triangle {
                let slot = &mut units[i as usize];
                *slot = slot.or(flat);
            }
        }
    }
    units.into_iter().map(|n| n.unwrap_or(DVec3::Y).as_vec3()).collect()
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

    #[test]
    fn normals_stay_perpendicular_under_uneven_scale() {
        let scale = DAffine3::from_scale(DVec3::new(4.0, 1.0, 1.0));
        // The plane x + y = 0 becomes x / 4 + y = 0.
        let [n] = world_normals(&[[1.0, 1.0, 0.0]], &scale, &[], &[])[..] else { panic!("one") };
        assert!(n.abs_diff_eq(Vec3::new(0.25, 1.0, 0.0).normalize(), 1e-6), "{n}");
    }

    #[test]
    fn a_mirrored_normal_is_mirrored_once() {
        let mirror = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
        let normals = world_normals(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &mirror, &[], &[]);
        assert_eq!(normals, [Vec3::NEG_X, Vec3::Y]);
    }

    #[test]
    fn a_missing_normal_is_the_triangles() {
        let positions = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let normals = [[0.0; 3], [f32::NAN, 0.0, 0.0], [1.0, 0.0, 0.0]];
        let normals = world_normals(&normals, &DAffine3::IDENTITY, &positions, &[[0, 1, 2]]);
        assert_eq!(normals, [Vec3::Z, Vec3::Z, Vec3::X]);
    }
}
