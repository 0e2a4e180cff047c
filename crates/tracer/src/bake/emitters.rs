//! A scene's emitters: polygons, and pictures of what they emit.

use super::BakeOptions;
use crate::scene::{
    self, Material, Scene, Texture,
    surfaces::{self, PlanarPolygon},
};
use anyhow::{Context as _, bail};
use glam::{DMat3, DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;
use wrt_core::{Emission, Lobe, Polygon};

/// The most emitters that are baked.
const MOST_EMITTERS: usize = 4096;

/// Texels of all emitters' pictures together.
const TEXELS: usize = 1 << 22;

pub(super) struct Emitter {
    pub(super) polygon: Polygon,
    pub(super) emission: Emission,
    /// Twice as fine, for the check.
    pub(super) fine: Emission,
}

/// Each emitter, with a picture of this level or, if none is given, as fine as its
/// texture: 2^`MOST` cells a side at most.
///
/// # Errors
///
/// If a polygon cannot be used; by name.
pub(crate) fn emissions(
    scene: &Scene,
    level: Option<u8>,
) -> anyhow::Result<Vec<(Polygon, Emission)>> {
    /// 48 MiB a picture.
    const MOST: u32 = 11;
    /// Texels of all together.
    const ALL: usize = 1 << 24;
    /// What a clipped outline is drawn with where there is no texture.
    const OUTLINE: u32 = 8;
    let found = surfaces::emitters(scene);
    let each = level_of_each(ALL, found.len());
    let emitter = |planar: &PlanarPolygon| {
        let polygon = polygon(planar)?;
        let texture =
            material(scene, planar).emission_texture.map(|map| &scene.textures[map.texture]);
        let texels = texture.map(Texture::size).map_or(1, |(width, height)| width.max(height));
        let outline = if polygon.fills_chart() { 0 } else { OUTLINE };
        let finest = texels.next_power_of_two().ilog2().max(outline).min(MOST) as u8;
        let emission = emission(scene, planar, &polygon, level.unwrap_or(finest).min(each));
        Ok((polygon, emission))
    };
    found.iter().map(emitter).collect()
}

pub(super) fn emitters(scene: &Scene, options: &BakeOptions) -> anyhow::Result<Vec<Emitter>> {
    let found = surfaces::emitters(scene);
    if found.is_empty() {
        bail!(
            "nothing emits light: give a planar surface an emissive material (emissiveFactor, or Ke in an MTL file)"
        );
    }
    if found.len() > MOST_EMITTERS {
        bail!(
            "{} surfaces emit light, and a bake takes {MOST_EMITTERS}: give planar surfaces alone an emissive material, or render without a bake, which samples the light of all",
            found.len()
        );
    }
    let level = options.emission_level.min(level_of_each(TEXELS, found.len()));
    let emitter = |planar: &PlanarPolygon| {
        let polygon = polygon(planar)?;
        let [emission, fine] =
            [level, level + 1].map(|level| emission(scene, planar, &polygon, level));
        Ok(Emitter { polygon, emission, fine })
    };
    found.iter().map(emitter).collect()
}

/// The finest level of so many pictures that have so many texels together.
fn level_of_each(texels: usize, pictures: usize) -> u8 {
    ((texels / pictures.max(1)).max(1).ilog2() / 2) as u8
}

fn polygon(planar: &PlanarPolygon) -> anyhow::Result<Polygon> {
    Polygon::rectilinear(&planar.vertices)
        .with_context(|| format!("the emitter \"{}\"", planar.name))
}

fn material<'a>(scene: &'a Scene, planar: &PlanarPolygon) -> &'a Material {
    &scene.materials[scene.meshes[planar.mesh].material]
}

/// What it emits, its picture of this level: without sunlight through clear glass, which
/// like a mirror's image is no matter of cells but of the raytracer's rays.
fn emission(scene: &Scene, planar: &PlanarPolygon, polygon: &Polygon, level: u8) -> Emission {
    let mesh = &scene.meshes[planar.mesh];
    let material = material(scene, planar);
    let lobe = match &material.lobe {
        None => Lobe::Lambertian,
        Some(scene::Lobe { window: Some(window), .. }) => window.light_in(polygon.frame()),
        Some(lobe) => {
            let peak = (mesh.transform.matrix3 * lobe.peak).normalize();
            Lobe::Cosine { exponent: lobe.exponent, peak: polygon.frame().to_local(peak) }
        }
    };
    Emission::new(level, picture(scene, planar, material, polygon, level), lobe)
}

/// Mean emitted radiance over each cell of the polygon's chart, u fastest.
fn picture(
    scene: &Scene,
    planar: &PlanarPolygon,
    material: &Material,
    polygon: &Polygon,
    level: u8,
) -> Vec<[f32; 3]> {
    let texture = material.emission_texture.map(|map| &scene.textures[map.texture]);
    let to_uv = texture.and_then(|_| texture_map(planar, polygon));
    let side = 1_usize << level;
    let texels = texture.map(Texture::size).map_or(1, |(width, height)| width.max(height));
    // A sample per texel; a clipped outline needs some even without a picture.
    let samples = texels.div_ceil(side).clamp(if polygon.fills_chart() { 1 } else { 8 }, 64);
    let size = polygon.size().unwrap_or_default();
    let cell = |i: usize| {
        let low = DVec2::new((i % side) as f64, (i / side) as f64);
        let mut sum = Vec3::ZERO;
        for s in 0..samples * samples {
            let at = DVec2::new((s % samples) as f64, (s / samples) as f64) + 0.5;
            let point = (low + at / samples as f64) / side as f64 * size;
            if !polygon.fills_chart() && !contains(polygon.outline(), point) {
                continue;
            }
            sum += match (texture, &to_uv) {
                (Some(texture), Some(map)) => {
                    let uv = (*map * point.extend(1.0)).truncate();
                    // The nearest texel: a picture averages many of them.
                    texture.nearest(uv.as_vec2()).truncate()
                }
                _ => Vec3::ONE,
            };
        }
        (material.emission * sum / (samples * samples) as f32).to_array()
    };
    (0..side * side).into_par_iter().map(cell).collect()
}

/// The affine map from the polygon's plane to texture coordinates, from its
/// first corners that span the plane; `None` without texture coordinates.
fn texture_map(planar: &PlanarPolygon, polygon: &Polygon) -> Option<DMat3> {
    let frame = polygon.frame();
    let plane = |v: &DVec3| frame.to_local(*v - frame.origin).truncate();
    let corner = |i: usize| {
        let uv: Vec2 = *planar.uvs.get(i)?;
        Some((plane(planar.vertices.get(i)?), uv.as_dvec2()))
    };
    let (a, b) = (corner(0)?, corner(1)?);
    (2..planar.vertices.len()).find_map(|i| {
        let c = corner(i)?;
        let columns = |p: DVec2, q: DVec2, r: DVec2| {
            DMat3::from_cols(p.extend(1.0), q.extend(1.0), r.extend(1.0))
        };
        let from = columns(a.0, b.0, c.0);
        (from.determinant().abs() > 1e-12).then(|| columns(a.1, b.1, c.1) * from.inverse())
    })
}

/// Whether a simple outline holds the point (even-odd rule).
fn contains(outline: &[DVec2], p: DVec2) -> bool {
    (0..outline.len()).fold(false, |inside, i| {
        let (a, b) = (outline[i], outline[(i + 1) % outline.len()]);
        let crosses =
            (a.y > p.y) != (b.y > p.y) && p.x < (b.x - a.x) * (p.y - a.y) / (b.y - a.y) + a.x;
        inside != crosses
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Map, Mesh};

    /// A texture of four texels on a square whose texture coordinates turn it by a
    /// quarter: the picture turns with them.
    #[test]
    fn a_picture_follows_the_texture_coordinates() {
        let texels = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::ONE].map(|t| t.extend(1.0)).to_vec();
        let planar = PlanarPolygon {
            mesh: 0,
            name: "window".to_owned(),
            vertices: vec![DVec3::ZERO, DVec3::X, DVec3::new(1., 1., 0.), DVec3::Y],
            uvs: vec![Vec2::X, Vec2::ONE, Vec2::Y, Vec2::ZERO],
            triangles: vec![0, 1],
        };
        let scene = Scene {
            meshes: vec![Mesh::default()],
            textures: vec![Texture::from_texels(2, 2, texels)],
            ..Scene::default()
        };
        let material = Material {
            emission: Vec3::splat(2.0),
            emission_texture: Some(Map::of(0)),
            ..Material::default()
        };
        let polygon = Polygon::rectilinear(&planar.vertices).expect("a square");
        let picture = picture(&scene, &planar, &material, &polygon, 1);
        // Corner 0 (u = v = 0) has texture (1, 0): texel 1; corner 1 (1, 1): texel 3.
        assert_eq!(picture[0], [0.0, 2.0, 0.0]);
        assert_eq!(picture[1], [2.0, 2.0, 2.0]);
        assert_eq!(picture[2], [2.0, 0.0, 0.0]);
        assert_eq!(picture[3], [0.0, 0.0, 2.0]);
    }

    #[test]
    fn a_triangle_s_picture_is_dark_outside_it() {
        let planar = PlanarPolygon {
            mesh: 0,
            name: "lamp".to_owned(),
            vertices: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
            uvs: vec![],
            triangles: vec![0],
        };
        let material = Material { emission: Vec3::ONE, ..Material::default() };
        let polygon = Polygon::rectilinear(&planar.vertices).expect("a triangle");
        let picture = picture(&Scene::default(), &planar, &material, &polygon, 2);
        let area: f32 = picture.iter().map(|rgb| rgb[0]).sum::<f32>() / 16.0;
        assert!((area - 0.5).abs() < 0.02, "half the square: {area}");
        assert_eq!((picture[0][0], picture[15][0]), (1.0, 0.0));
    }
}
