//! Emissive meshes as few triangles and parallelograms.

use super::flat::Shape;
use crate::scene::{Map, Mesh};
use glam::{DVec3, Vec2};

/// A triangle of a mesh, or two that make a parallelogram.
#[derive(Debug)]
pub(super) struct Piece {
    pub(super) shape: Shape,
    pub(super) corner: DVec3,
    pub(super) edge_u: DVec3,
    pub(super) edge_v: DVec3,
    /// Texture coordinates of the corner, and along either edge.
    pub(super) uv: [Vec2; 3],
}

impl Piece {
    pub(super) fn area(&self) -> f64 {
        let parallelogram = self.edge_u.cross(self.edge_v).length();
        if self.shape == Shape::Triangle { 0.5 * parallelogram } else { parallelogram }
    }
}

/// The mesh in as few pieces as follow from joining each triangle with the one
/// after it, which is how exporters write quadrilaterals.
pub(super) fn pieces(mesh: &Mesh, map: Option<&Map>) -> Vec<Piece> {
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
