//! One parallelogram or triangle that shines, cell by cell.

use super::{
    lobe_factor,
    pieces::Piece,
    sunbeam::{self, Sunbeam},
};
use crate::{
    phong::{Source, Surface, Unshadowed},
    scene::{Lobe, Material, Mesh, Scene},
};
use glam::{DVec2, DVec3, Vec2, Vec3};
use std::f64::consts::PI;

/// Texture samples along a texel in a cell's mean.
const SAMPLES_PER_TEXEL: f32 = 2.0;

/// Most texture samples along a cell's side.
const MAX_SAMPLES: usize = 256;

/// A parallelogram or triangle that shines to its front.
#[derive(Debug)]
pub(crate) struct Flat {
    corner: DVec3,
    edge_u: DVec3,
    edge_v: DVec3,
    /// Unit, of the side that shines.
    pub(super) normal: DVec3,
    /// Of one cell, m².
    pub(super) cell_area: f64,
    /// Of a cell's sides relative to the emitter's.
    cell_side: f64,
    shape: Shape,
    pub(super) cells: Vec<Cell>,
    /// In world coordinates.
    lobe: Option<Lobe>,
    pub(super) sunbeam: Option<Sunbeam>,
}

/// Part of an emitter, where (s, t) = origin + sign · cell_side · place.
#[derive(Debug)]
pub(super) struct Cell {
    origin: DVec2,
    sign: f64,
    /// Mean radiance at the lobe's peak.
    pub(super) radiance: Vec3,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Shape {
    Parallelogram,
    Triangle,
}

impl Shape {
    /// Takes a point of the unit square into the shape, area for area.
    fn place(self, at: DVec2) -> DVec2 {
        if self == Self::Triangle && at.x + at.y > 1.0 { DVec2::ONE - at } else { at }
    }
}

impl Flat {
    /// `piece` of `mesh` in cells of `m` a side; one without cells is black.
    pub(super) fn new(
        scene: &Scene,
        mesh: &Mesh,
        material: &Material,
        piece: &Piece,
        m: usize,
    ) -> Self {
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

    /// Adds to `lights` what `surface` reflects to the eye of each cell. `place`, in
    /// [0, 1)², is where in its cell each point lies.
    pub(super) fn illuminate(
        &self,
        surface: &Surface<'_>,
        place: DVec2,
        lights: &mut Vec<Unshadowed>,
    ) {
        if (surface.position - self.corner).dot(self.normal) <= 0.0 {
            return;
        }
        lights.extend(self.cells.iter().filter_map(|cell| self.light_of(cell, surface, place)));
    }

    /// What `surface` reflects to the eye of one cell, as it shines from its point at
    /// `place`; `None` for nothing.
    ///
    /// ```text
    /// f_r L_e cosθ_s cosθ_d ΔA / r²
    /// ```
    #[inline]
    pub(super) fn light_of(
        &self,
        cell: &Cell,
        surface: &Surface<'_>,
        place: DVec2,
    ) -> Option<Unshadowed> {
        let point = self.point(cell, place);
        let path = point - surface.position;
        let squared = path.length_squared();
        let to_light = path / squared.sqrt();
        let (cos_d, cos_s) = (surface.normal.dot(to_light), -self.normal.dot(to_light));
        if cos_d <= 0.0 || cos_s <= 0.0 {
            return None;
        }
        let lobe = self.lobe.as_ref().map_or(1.0, |lobe| lobe_factor(lobe, -to_light));
        if lobe == 0.0 {
            return None;
        }
        // A cell is no point to what touches it: its solid angle stays
        // below that of a disc seen from its edge.
        let solid_angle = self.cell_area * cos_s / squared.max(self.cell_area / PI);
        let reflectance = surface.brdf.reflectance(surface.normal, to_light, surface.to_eye);
        let radiance = reflectance * cell.radiance * (lobe * cos_d * solid_angle) as f32;
        Some(Unshadowed { radiance, source: Source::Point(point) })
    }

    /// The point of `cell` that `place`, in [0, 1)², stands for.
    #[inline]
    fn point(&self, cell: &Cell, place: DVec2) -> DVec3 {
        let st = cell.origin + cell.sign * (self.cell_side * self.shape.place(place));
        self.corner + st.x * self.edge_u + st.y * self.edge_v
    }

    /// Corners of `cell`, a triangle's last one twice.
    pub(super) fn corners(&self, cell: &Cell) -> [DVec3; 4] {
        let last = if self.shape == Shape::Triangle { DVec2::Y } else { DVec2::ONE };
        [DVec2::ZERO, DVec2::X, DVec2::Y, last].map(|at| self.point(cell, at))
    }

    /// What `surface` reflects to the eye of the sunlight that goes straight through this
    /// emitter, if that is clear glass: of the point of the sun's disc that `place`, in
    /// [0, 1)², stands for.
    pub(super) fn sunlight(&self, surface: &Surface<'_>, place: DVec2) -> Option<Unshadowed> {
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
