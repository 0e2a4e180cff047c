//! Direct light of area emitters, for surfaces without a wavelet patch.
//!
//! Emissive meshes are cut into parallelograms and triangles, each with a grid
//! of cells of equal area. A cell shines with its texture's mean from one point:
//! its centre, or one that moves from sample to sample, which turns the bands
//! that a fixed grid casts in penumbras into fine noise.
//!
//! Up to [`MANY`] of these pieces every cell is asked for at every surface. Of more,
//! a hierarchy of the cells gives a few clusters, and each cluster one cell, drawn in
//! proportion to what it might give: the expected light is that of all cells, and what
//! it costs grows with the logarithm of their number.

mod cut;
mod flat;
mod hierarchy;
mod pieces;
mod sunbeam;

use crate::{
    phong::{Surface, Unshadowed},
    scene::{Lobe, Scene},
};
use flat::Flat;
use glam::{DVec2, DVec3};
use hierarchy::Hierarchy;
use pieces::{Piece, pieces};
use wrt_core::cosine_power;

/// Step of a sequence that fills the unit square evenly: 1/g and 1/g² for
/// g³ = g + 1 (M. Roberts, *The Unreasonable Effectiveness of Quasirandom
/// Sequences*, 2018).
pub(crate) const R2: DVec2 = DVec2::new(0.754_877_666_246_692_8, 0.569_840_290_998_053_3);

/// Most pieces of which every cell is asked for, as many as an authored room of lamps and
/// windows has. A picture with no more is free of the noise of drawing.
pub(crate) const MANY: usize = 256;

/// What shines: one piece of a mesh, or all of very many.
#[derive(Debug)]
pub(crate) enum AreaEmitter {
    One(Box<Flat>),
    Many(Hierarchy),
}

impl AreaEmitter {
    /// The emitters of `scene`, with about `grid`² cells per mesh and one a piece at least.
    ///
    /// Panes that the sun shines straight through stand alone however many they are.
    pub(crate) fn all(scene: &Scene, grid: usize) -> Vec<Self> {
        let mut flats = Vec::new();
        for mesh in &scene.meshes {
            let material = &scene.materials[mesh.material];
            if material.emission.max_element() <= 0.0 {
                continue;
            }
            let pieces = pieces(mesh, material.emission_texture.as_ref());
            let total: f64 = pieces.iter().map(Piece::area).sum();
            for piece in pieces.iter().filter(|piece| piece.area() > 0.0) {
                let m = (grid as f64 * (piece.area() / total).sqrt()).round().max(1.0) as usize;
                let flat = Flat::new(scene, mesh, material, piece, m);
                // An emissive texture may be black where the mesh uses it.
                if !flat.cells.is_empty() {
                    flats.push(flat);
                }
            }
        }
        let (alone, others): (Vec<Flat>, Vec<Flat>) = if flats.len() > MANY {
            flats.into_iter().partition(|flat| flat.sunbeam.is_some())
        } else {
            (flats, Vec::new())
        };
        let many = Hierarchy::new(others).map(Self::Many);
        alone.into_iter().map(|flat| Self::One(Box::new(flat))).chain(many).collect()
    }

    /// Adds to `lights` what `surface` reflects to the eye of each cell, or of one cell for
    /// each of some clusters, as much more of that as it stands for. `place`, in [0, 1)²,
    /// says which cells, and where in a cell its point lies: evenly spread places give
    /// the light of all points of all cells.
    pub(crate) fn illuminate(
        &self,
        surface: &Surface<'_>,
        place: DVec2,
        lights: &mut Vec<Unshadowed>,
    ) {
        match self {
            Self::One(flat) => flat.illuminate(surface, place, lights),
            Self::Many(hierarchy) => hierarchy.illuminate(surface, place, lights),
        }
    }

    /// What `surface` reflects to the eye of the sunlight that goes straight through this
    /// emitter, if that is clear glass: of the point of the sun's disc that `place`, in
    /// [0, 1)², stands for.
    pub(crate) fn sunlight(&self, surface: &Surface<'_>, place: DVec2) -> Option<Unshadowed> {
        match self {
            Self::One(flat) => flat.sunlight(surface, place),
            Self::Many(_) => None,
        }
    }
}

/// How much of its peak radiance a lobe sends along `travel`, a unit vector in
/// the peak's coordinates.
///
/// A window's sunlight is not in it: see [`Window::radiance`](crate::scene::Window).
pub(crate) fn lobe_factor(lobe: &Lobe, travel: DVec3) -> f64 {
    if let Some(window) = &lobe.window {
        return window.light.eval(window.frame.to_local(travel));
    }
    cosine_power(travel.dot(lobe.peak), lobe.exponent)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::{Accel, Hit};
    use crate::scene::{Map, Material, Mesh, Texture};
    use glam::{DAffine3, Vec2, Vec3, Vec4};
    use std::f64::consts::PI;

    /// Unit squares that face each other at distance 1: the lower one, white,
    /// looks up; the upper one has radiance 1.
    fn facing_squares() -> Scene {
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let square = |y: f64, triangles: Vec<[u32; 3]>, material| Mesh {
            positions: corners.map(|[x, z]| DVec3::new(x, y, z)).to_vec(),
            uvs: [corners.map(|[x, z]| Vec2::new(x as f32, z as f32)).to_vec(), Vec::new()],
            triangles,
            material,
            transform: DAffine3::IDENTITY,
            ..Mesh::default()
        };
        let white = Material { kd: Vec3::ONE, ..Material::default() };
        let lamp = Material { emission: Vec3::ONE, ..Material::default() };
        Scene {
            meshes: vec![
                square(0.0, vec![[0, 2, 1], [0, 3, 2]], 0),
                square(1.0, vec![[0, 1, 2], [0, 2, 3]], 1),
            ],
            materials: vec![white, lamp],
            ..Scene::default()
        }
    }

    /// Mean radiance of the lower square, seen from above, at n² points.
    fn mean_radiance(scene: &Scene, emitters: &[AreaEmitter], n: usize) -> f64 {
        let accel = Accel::new(scene);
        let at = |i: usize| (i as f64 + 0.5) / n as f64;
        let sum: f64 = (0..n * n)
            .map(|k| {
                let below = DVec3::new(at(k % n), -1.0, at(k / n));
                let hit = accel.closest(below, DVec3::Y, 0.0, 1.5).expect("the square");
                let surface = Surface::new(scene, &Hit { front: true, ..hit }, DVec3::Y);
                let mut lights = Vec::new();
                for emitter in emitters {
                    emitter.illuminate(&surface, DVec2::splat(0.5), &mut lights);
                }
                let shadowed = |light: &Unshadowed| light.shadowed(&surface, &accel).x;
                lights.iter().map(|light| f64::from(shadowed(light))).sum::<f64>()
            })
            .sum();
        sum / (n * n) as f64
    }

    /// The form factor of facing unit squares at distance 1 is 0.1998249, and
    /// radiance from a white surface is irradiance over π.
    #[test]
    fn facing_squares_have_their_form_factor() {
        let mut scene = facing_squares();
        let emitters = AreaEmitter::all(&scene, 24);
        assert_eq!(emitters.len(), 1, "two triangles are one square");
        let mean = mean_radiance(&scene, &emitters, 24);
        // Midpoint rule on either square, error ∝ (1/24)².
        assert!((mean - 0.199_824_9).abs() < 2e-4, "{mean}");
        // The same square as triangles that do not pair up.
        scene.meshes[1].triangles = vec![[0, 1, 2], [3, 0, 2]];
        scene.meshes[1].uvs[0][3] = Vec2::new(5.0, 5.0);
        scene.textures.push(Texture::from_texels(1, 1, vec![Vec4::ONE]));
        scene.materials[1].emission_texture = Some(Map::of(0));
        let emitters = AreaEmitter::all(&scene, 24);
        assert_eq!(emitters.len(), 2, "texture coordinates break at the diagonal");
        let mean = mean_radiance(&scene, &emitters, 24);
        assert!((mean - 0.199_824_9).abs() < 5e-4, "{mean}");
    }

    #[test]
    fn cells_have_the_mean_of_their_part_of_the_texture() {
        let mut scene = facing_squares();
        let texel = |i: usize| Vec4::splat(((i * 2_654_435_761) % 1000) as f32);
        let texels: Vec<Vec4> = (0..60 * 60).map(texel).collect();
        let mean = (texels.iter().sum::<Vec4>() / texels.len() as f32).truncate();
        scene.textures.push(Texture::from_texels(60, 60, texels));
        scene.materials[1].emission_texture = Some(Map::of(0));
        let emitters = AreaEmitter::all(&scene, 4);
        let [AreaEmitter::One(emitter)] = emitters.as_slice() else { panic!("{emitters:?}") };
        assert_eq!(emitter.cells.len(), 16);
        let of_cells = emitter.cells.iter().map(|cell| cell.radiance).sum::<Vec3>() / 16.0;
        assert!((of_cells - mean).length() < 0.01 * mean.length(), "{of_cells} of {mean}");
    }

    #[test]
    fn lobe_shines_along_its_peak_in_local_coordinates_and_only_to_the_front() {
        let mut scene = facing_squares();
        // A quarter turn about x takes local −z to world −y.
        scene.meshes[1].transform = DAffine3::from_rotation_x(-0.5 * PI);
        scene.materials[1].lobe = Some(Lobe { exponent: 1e4, peak: DVec3::NEG_Z, window: None });
        let emitters = AreaEmitter::all(&scene, 64);
        // A beam: ∫ cosⁿ⁺¹θ dω = 2π/(n+2), and all of it lands on the square but
        // for the rim.
        let mean = mean_radiance(&scene, &emitters, 16) * PI;
        let expected = 2.0 * PI / (1e4 + 2.0);
        assert!((mean / expected - 1.0).abs() < 0.05, "{mean}, expected {expected}");
        scene.meshes[1].triangles.iter_mut().for_each(|t| t.swap(0, 1));
        let emitters = AreaEmitter::all(&scene, 8);
        assert_eq!(mean_radiance(&scene, &emitters, 4), 0.0, "shines backwards");
    }

    #[test]
    fn triangles_pair_up_whichever_diagonal_and_corner_they_start_from() {
        let mut scene = facing_squares();
        for first in [[0, 1, 2], [1, 2, 0], [2, 0, 1]] {
            for second in [[0, 2, 3], [2, 3, 0], [3, 0, 2]] {
                scene.meshes[1].triangles = vec![first, second];
                let pieces = pieces(&scene.meshes[1], None);
                assert_eq!(pieces.len(), 1, "{first:?} {second:?}");
                assert_eq!(pieces[0].area(), 1.0);
                assert!(pieces[0].edge_u.cross(pieces[0].edge_v).y < 0.0, "faces down");
            }
        }
        scene.meshes[1].positions[3].x -= 0.5;
        assert_eq!(pieces(&scene.meshes[1], None).len(), 2, "a trapezium");
    }

    /// Sunlight lands where the line to the sun meets the glass, with the irradiance
    /// given times what the glass passes and the cosine at the surface; on the beam's edge
    /// with half of it.
    #[test]
    fn sunlight_lands_where_geometry_says() {
        let mut scene = facing_squares();
        scene.materials[1].glazing = Some(wrt_core::Glazing::Clear { ior: 1.5 });
        let sun = wrt_core::Sun::new(30.0, 60.0, 600.0).expect("in range");
        let sky = wrt_core::Sky::new(wrt_core::SkyModel::Uniform, 0.0, Some(sun), 0.0);
        scene.sky = Some(sky.expect("in range"));
        // From north-north-east, 60° up, on glass that lies flat: the upper square.
        crate::scene::weather::light_windows(&mut scene).expect("a plane");
        let (emitters, accel) = (AreaEmitter::all(&scene, 4), Accel::new(&scene));
        let seen = |x: f64, z: f64| {
            let hit = accel.closest(DVec3::new(x, -1.0, z), DVec3::Y, 0.0, 1.5).expect("the floor");
            let surface = Surface::new(&scene, &Hit { front: true, ..hit }, DVec3::Y);
            let count = 400;
            let sum: f32 = (0..count)
                .map(|i| {
                    let place = DVec2::new(
                        (f64::from(i) + 0.5) / f64::from(count),
                        f64::from(i) * 0.618_034,
                    );
                    let light = emitters[0].sunlight(&surface, place.fract());
                    light.map_or(0.0, |light| light.shadowed(&surface, &accel).x)
                })
                .sum();
            PI * f64::from(sum / count as f32)
        };
        let cosine = 60_f64.to_radians().sin();
        let refracted = (1.0 - (1.0 - cosine * cosine) / 2.25_f64).sqrt();
        let s = ((cosine - 1.5 * refracted) / (cosine + 1.5 * refracted)).powi(2);
        let p = ((1.5 * cosine - refracted) / (1.5 * cosine + refracted)).powi(2);
        let f = 0.5 * (s + p);
        let full = 600.0 * cosine * (1.0 - f) / (1.0 + f);
        // The square is moved by cot 60°, away from the sun: to −x and +z.
        let shift = 3_f64.sqrt().recip();
        let (dx, dz) = (-shift * 30_f64.to_radians().sin(), shift * 30_f64.to_radians().cos());
        for (x, z, expected) in [
            (0.3, 0.9, 1.0),
            (0.02, dz + 0.02, 1.0),
            (1.0 + dx - 0.02, 0.98, 1.0),
            (0.3, dz, 0.5),
            (1.0 + dx, 0.8, 0.5),
            (0.3, dz - 0.02, 0.0),
            (1.0 + dx + 0.02, 0.8, 0.0),
        ] {
            let found = seen(x, z) / full;
            assert!((found - expected).abs() < 0.01, "({x}, {z}): {found}");
        }
    }
}
