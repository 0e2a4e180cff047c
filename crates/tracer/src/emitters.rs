//! Direct light of area emitters, for surfaces without a wavelet patch.
//!
//! Emissive meshes are cut into parallelograms and triangles, each with a grid
//! of cells of equal area. A cell shines with its texture's mean from one point:
//! its centre, or one that moves from sample to sample, which turns the bands
//! that a fixed grid casts in penumbras into fine noise.

mod sunbeam;

use crate::{
    phong::{Source, Surface, Unshadowed},
    scene::{Lobe, Map, Material, Mesh, Scene},
};
use glam::{DVec2, DVec3, Vec2, Vec3};
use std::f64::consts::PI;
use sunbeam::Sunbeam;
use wrt_core::cosine_power;

/// Texture samples along a texel in a cell's mean.
const SAMPLES_PER_TEXEL: f32 = 2.0;

/// Most texture samples along a cell's side.
const MAX_SAMPLES: usize = 256;

/// A parallelogram or triangle that shines to its front.
#[derive(Debug)]
pub(crate) struct AreaEmitter {
    corner: DVec3,
    edge_u: DVec3,
    edge_v: DVec3,
    /// Unit, of the side that shines.
    normal: DVec3,
    /// Of one cell, m².
    cell_area: f64,
    /// Of a cell's sides relative to the emitter's.
    cell_side: f64,
    shape: Shape,
    cells: Vec<Cell>,
    /// In world coordinates.
    lobe: Option<Lobe>,
    sunbeam: Option<Sunbeam>,
}

/// Part of an emitter, where (s, t) = origin + sign · cell_side · place.
#[derive(Debug)]
struct Cell {
    origin: DVec2,
    sign: f64,
    /// Mean radiance at the lobe's peak.
    radiance: Vec3,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Shape {
    Parallelogram,
    Triangle,
}

impl Shape {
    /// Takes a point of the unit square into the shape, area for area.
    fn place(self, at: DVec2) -> DVec2 {
        if self == Self::Triangle && at.x + at.y > 1.0 { DVec2::ONE - at } else { at }
    }
}

impl AreaEmitter {
    /// The emitters of `scene`, with about `grid`² cells per mesh.
    pub(crate) fn all(scene: &Scene, grid: usize) -> Vec<Self> {
        let mut emitters = Vec::new();
        for mesh in &scene.meshes {
            let material = &scene.materials[mesh.material];
            if material.emission.max_element() <= 0.0 {
                continue;
            }
            let pieces = pieces(mesh, material.emission_texture.as_ref());
            let total: f64 = pieces.iter().map(Piece::area).sum();
            for piece in pieces.iter().filter(|piece| piece.area() > 0.0) {
                let m = (grid as f64 * (piece.area() / total).sqrt()).round().max(1.0) as usize;
                let emitter = Self::new(scene, mesh, material, piece, m);
                // An emissive texture may be black where the mesh uses it.
                if !emitter.cells.is_empty() {
                    emitters.push(emitter);
                }
            }
        }
        emitters
    }

    fn new(scene: &Scene, mesh: &Mesh, material: &Material, piece: &Piece, m: usize) -> Self {
        let h = 1.0 / m as f64;
        let corner_of = |i: usize, j: usize| DVec2::new(i as f64, j as f64) * h;
        let texture = material.emission_texture.map(|map| &scene.textures[map.texture]);
        let mean_over = |origin: DVec2, sign: f64, h: f64, shape: Shape| {
            let Some(texture) = texture else { return material.emission };
            let [uv, du, dv] = piece.uv;
            let (width, height) = texture.size();
            let texels = Vec2::new(width as f32, height as f32);
            let side = ((du * texels).length().max((dv * texels).length())) * h as f32;
            let n = ((side * SAMPLES_PER_TEXEL).ceil() as usize).clamp(1, MAX_SAMPLES);
            let sum: Vec3 = (0..n * n)
                .map(|k| {
                    let at = DVec2::new((k % n) as f64 + 0.5, (k / n) as f64 + 0.5) / n as f64;
                    let st = (origin + sign * h * shape.place(at)).as_vec2();
                    texture.at(uv + st.x * du + st.y * dv).truncate()
                })
                .sum();
            material.emission * sum / (n * n) as f32
        };
        let mean = |origin, sign| mean_over(origin, sign, h, piece.shape);
        let cell = |origin, sign| Cell { origin, sign, radiance: mean(origin, sign) };
        let mut cells = Vec::new();
        for (i, j) in (0..m).flat_map(|i| (0..m).map(move |j| (i, j))) {
            match piece.shape {
                Shape::Parallelogram => cells.push(cell(corner_of(i, j), 1.0)),
                Shape::Triangle => {
                    if i + j < m {
                        cells.push(cell(corner_of(i, j), 1.0));
                    }
                    if i + j + 1 < m {
                        cells.push(cell(corner_of(i + 1, j + 1), -1.0));
                    }
                }
            }
        }
        cells.retain(|cell| cell.radiance != Vec3::ZERO);
        let window = material.lobe.as_ref().and_then(|lobe| lobe.window.as_ref());
        let sunbeam = window.and_then(|window| window.sunlight).map(|sunlight| {
            let side = sunbeam::SIDE as f64;
            let colour = |i: usize| {
                let cell = DVec2::new((i % sunbeam::SIDE) as f64, (i / sunbeam::SIDE) as f64);
                mean_over(cell / side, 1.0, side.recip(), Shape::Parallelogram)
            };
            Sunbeam { sunlight, colours: (0..sunbeam::SIDE.pow(2)).map(colour).collect() }
        });
        let peak = |lobe: &Lobe| (mesh.transform.matrix3 * lobe.peak).normalize_or_zero();
        Self {
            corner: piece.corner,
            edge_u: piece.edge_u,
            edge_v: piece.edge_v,
            normal: piece.edge_u.cross(piece.edge_v).normalize(),
            cell_area: piece.area() * h * h,
            cell_side: h,
            lobe: material.lobe.as_ref().map(|lobe| Lobe { peak: peak(lobe), ..lobe.clone() }),
            shape: piece.shape,
            cells,
            sunbeam,
        }
    }

    /// Adds to `lights` what `surface` reflects to the eye of each cell:
    ///
    /// ```text
    /// f_r L_e cosθ_s cosθ_d ΔA / r²
    /// ```
    ///
    /// `place`, in [0, 1)², is where in its cell each point lies.
    pub(crate) fn illuminate(
        &self,
        surface: &Surface<'_>,
        place: DVec2,
        lights: &mut Vec<Unshadowed>,
    ) {
        if (surface.position - self.corner).dot(self.normal) <= 0.0 {
            return;
        }
        let place = self.cell_side * self.shape.place(place);
        for cell in &self.cells {
            let st = cell.origin + cell.sign * place;
            let point = self.corner + st.x * self.edge_u + st.y * self.edge_v;
            let path = point - surface.position;
            let squared = path.length_squared();
            let to_light = path / squared.sqrt();
            let (cos_d, cos_s) = (surface.normal.dot(to_light), -self.normal.dot(to_light));
            if cos_d <= 0.0 || cos_s <= 0.0 {
                continue;
            }
            let lobe = self.lobe.as_ref().map_or(1.0, |lobe| lobe_factor(lobe, -to_light));
            if lobe == 0.0 {
                continue;
            }
            // A cell is no point to what touches it: its solid angle stays
            // below that of a disc seen from its edge.
            let solid_angle = self.cell_area * cos_s / squared.max(self.cell_area / PI);
            let reflectance = surface.brdf.reflectance(surface.normal, to_light, surface.to_eye);
            let radiance = reflectance * cell.radiance * (lobe * cos_d * solid_angle) as f32;
            lights.push(Unshadowed { radiance, source: Source::Point(point) });
        }
    }

    /// What `surface` reflects to the eye of the sunlight that goes straight through this
    /// emitter, if that is clear glass: of the point of the sun's disc that `place`, in
    /// [0, 1)², stands for.
    pub(crate) fn sunlight(&self, surface: &Surface<'_>, place: DVec2) -> Option<Unshadowed> {
        let edges = [self.edge_u, self.edge_v];
        let from = surface.position - self.corner;
        let ray = self.sunbeam.as_ref().and_then(|beam| beam.ray(place, from, edges))?;
        let cosine = surface.normal.dot(ray.to_light);
        let outside = self.shape == Shape::Triangle && ray.st.element_sum() >= 1.0;
        if outside || cosine <= 0.0 || surface.geometric.dot(ray.to_light) <= 0.0 {
            return None;
        }
        let point = self.corner + ray.st.x * self.edge_u + ray.st.y * self.edge_v;
        let reflectance = surface.brdf.reflectance(surface.normal, ray.to_light, surface.to_eye);
        let radiance = reflectance * ray.irradiance * cosine as f32;
        Some(Unshadowed { radiance, source: Source::Point(point) })
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

/// A triangle of a mesh, or two that make a parallelogram.
#[derive(Debug)]
struct Piece {
    shape: Shape,
    corner: DVec3,
    edge_u: DVec3,
    edge_v: DVec3,
    /// Texture coordinates of the corner, and along either edge.
    uv: [Vec2; 3],
}

impl Piece {
    fn area(&self) -> f64 {
        let parallelogram = self.edge_u.cross(self.edge_v).length();
        if self.shape == Shape::Triangle { 0.5 * parallelogram } else { parallelogram }
    }
}

/// The mesh in as few pieces as follow from joining each triangle with the one
/// after it, which is how exporters write quadrilaterals.
fn pieces(mesh: &Mesh, map: Option<&Map>) -> Vec<Piece> {
    let mut pieces = Vec::new();
    let mut rest = mesh.triangles.as_slice();
    while let [first, after @ ..] = rest {
        let joined = after
            .first()
            .and_then(|second| (0..3).find_map(|k| parallelogram(mesh, map, *first, k, *second)));
        rest = if joined.is_some() { &after[1..] } else { after };
        pieces.push(joined.unwrap_or_else(|| piece(mesh, map, Shape::Triangle, *first, 0)));
    }
    pieces
}

/// The piece spanned by the edges of `triangle` at its corner `k`.
fn piece(mesh: &Mesh, map: Option<&Map>, shape: Shape, triangle: [u32; 3], k: usize) -> Piece {
    let [a, b, c] = [0, 1, 2].map(|i| triangle[(k + i) % 3] as usize);
    let p = |i: usize| mesh.positions[i];
    let uv = |i: usize| map.map_or(Vec2::ZERO, |map| mesh.uv(map, i));
    Piece {
        shape,
        corner: p(a),
        edge_u: p(b) - p(a),
        edge_v: p(c) - p(a),
        uv: [uv(a), uv(b) - uv(a), uv(c) - uv(a)],
    }
}

/// Both triangles as one, if they share the edge opposite corner `k` of the
/// first and positions and texture coordinates continue across it.
fn parallelogram(
    mesh: &Mesh,
    map: Option<&Map>,
    first: [u32; 3],
    k: usize,
    second: [u32; 3],
) -> Option<Piece> {
    // Far above the rounding of f32 files and far below a visible difference.
    const TOLERANCE: f64 = 1e-5;
    let whole = piece(mesh, map, Shape::Parallelogram, first, k);
    let (b, c) = (whole.corner + whole.edge_u, whole.corner + whole.edge_v);
    let near = TOLERANCE * b.distance(c);
    let is_rest = |j: usize| {
        let rest = piece(mesh, map, Shape::Triangle, second, j);
        // The opposite corner looks back: its edges are the first's, reversed.
        let texture = [rest.uv[1] + whole.uv[1], rest.uv[2] + whole.uv[2]];
        let size = whole.uv[1].length().max(whole.uv[2].length());
        rest.corner.distance(b + whole.edge_v) <= near
            && (rest.edge_u + whole.edge_u).length() <= near
            && (rest.edge_v + whole.edge_v).length() <= near
            && texture.iter().all(|d| d.length() <= TOLERANCE as f32 * size)
            && (rest.uv[0] - whole.uv.iter().sum::<Vec2>()).length() <= TOLERANCE as f32 * size
    };
    (0..3).any(is_rest).then_some(whole)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::{Accel, Hit};
    use crate::scene::Texture;
    use glam::{DAffine3, Vec4};

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
        let emitter = &AreaEmitter::all(&scene, 4)[0];
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
