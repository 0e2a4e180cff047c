//! Wavefront OBJ with its MTL files into a [`Scene`].
//!
//! tobj reads both; [`lines`] keeps from it what it would panic on, and
//! [`polygon`] cuts its faces into triangles, which it does for convex ones
//! only. Lengths are taken for metres. An OBJ has no cameras and no lights.

mod lines;
mod material;
mod polygon;

use super::files::Files;
use super::load::{Names, Warnings};
use super::texture::srgb_to_linear;
use super::{Loaded, Material, Mesh, Scene};
use anyhow::{Context as _, ensure};
use glam::{DVec3, Vec2, Vec3, Vec4};
use std::path::Path;

/// Reads an OBJ whose files are relative to `directory`.
///
/// # Errors
///
/// If a texture is missing, or a file is malformed.
pub(super) fn read(bytes: &[u8], directory: &Path) -> anyhow::Result<Loaded> {
    let mut warnings = Warnings::default();
    let text = lines::joined(bytes);
    lines::check(&text)?;
    let files = Files::beside(directory);
    let library = material::Library::load(&text, &files, &mut warnings)?;
    let options = tobj::LoadOptions {
        single_index: true,
        ignore_points: true,
        ignore_lines: true,
        ..tobj::LoadOptions::default()
    };
    let parsed = tobj::load_obj_buf(&mut text.as_bytes(), &options, |_| library.for_tobj());
    let (models, _) = parsed.context("malformed OBJ")?;

    let mut names = Names::default();
    let mut scene =
        Scene { materials: library.materials, textures: library.textures, ..Scene::default() };
    let mut plain = None;
    for model in models {
        let material = model.mesh.material_id.unwrap_or_else(|| {
            *plain.get_or_insert_with(|| {
                scene.materials.push(Material::default());
                scene.materials.len() - 1
            })
        });
        let owner = format!("object {:?}", model.name);
        let mesh = mesh(&model.mesh, &owner, &mut warnings).context(owner)?;
        if !mesh.triangles.is_empty() {
            scene.meshes.push(Mesh { name: names.unique(&model.name), material, ..mesh });
        }
    }
    Ok(Loaded { scene, files: files.into_read(), warnings: warnings.into_lines() })
}

fn mesh(from: &tobj::Mesh, owner: &str, warnings: &mut Warnings) -> anyhow::Result<Mesh> {
    let triple = |c: &[f32]| Vec3::new(c[0], c[1], c[2]);
    let positions: Vec<DVec3> =
        from.positions.chunks_exact(3).map(|c| triple(c).as_dvec3()).collect();
    ensure!(positions.iter().all(|p| p.is_finite()), "a vertex is not finite");
    let count = positions.len();

    // tobj leaves out what single faces lack, and with it the correspondence.
    let mut complete = |length: usize, what: &str| {
        if length != 0 && length != count {
            warnings.ignored(&format!("{what} that not all faces have"), owner);
        }
        length == count
    };
    let mut uvs = Vec::new();
    if complete(from.texcoords.len() / 2, "texture coordinates") {
        // v is up in an OBJ, and down in a scene.
        uvs = from.texcoords.chunks_exact(2).map(|c| Vec2::new(c[0], 1.0 - c[1])).collect();
        ensure!(uvs.iter().all(|uv| uv.is_finite()), "a texture coordinate is not finite");
    }
    let (mut normals, mut odd): (Vec<Vec3>, bool) = (Vec::new(), false);
    if complete(from.normals.len() / 3, "normals") {
        let unit = |c: &[f32]| triple(c).try_normalize();
        odd = from.normals.chunks_exact(3).any(|c| unit(c).is_none());
        normals = from.normals.chunks_exact(3).filter_map(unit).collect();
    }
    let mut colours: Vec<Vec4> = Vec::new();
    if complete(from.vertex_color.len() / 3, "vertex colours") {
        // In the display's encoding: OBJ says nothing, and scanners write bytes.
        let linear = |c: f32| srgb_to_linear(c.clamp(0.0, 1.0));
        let colour = |c: &[f32]| triple(c).map(linear).extend(1.0);
        colours = from.vertex_color.chunks_exact(3).map(colour).collect();
        ensure!(colours.iter().all(|c| c.is_finite()), "a vertex colour is not finite");
    }

    if odd {
        warnings.ignored("normals of which some are zero", owner);
        normals.clear();
    }

    let mut triangles = Vec::with_capacity(from.indices.len() / 3);
    let mut rest = &from.indices[..];
    let mut arities = from.face_arities.iter();
    while !rest.is_empty() {
        // No arities at all says that all are three.
        let arity = arities.next().map_or(3, |&n| n as usize);
        let (face, others) = rest.split_at_checked(arity).context("a face is cut short")?;
        ensure!(arity > 0, "a face has no vertices");
        polygon::triangulate(face, &positions, &mut triangles);
        rest = others;
    }
    Ok(Mesh { positions, normals, uvs: [uvs, Vec::new()], colours, triangles, ..Mesh::default() })
}

#[cfg(test)]
mod tests;
