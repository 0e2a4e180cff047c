//! Planar polygons in space: frame, chart, and the supports of their cells
//! (§7.1.1, §7.1.4).

use crate::{Chart, ConvexPolygon, Error, Result};
use glam::{DVec2, DVec3};

/// An orthonormal frame (x̂, ŷ, n̂) at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Where plane coordinates are (0, 0).
    pub origin: DVec3,
    /// x̂.
    pub x: DVec3,
    /// ŷ = n̂ × x̂.
    pub y: DVec3,
    /// n̂, the emitting or receiving side.
    pub n: DVec3,
}

impl Frame {
    /// The world point at plane coordinates `p`.
    #[must_use]
    pub fn point(&self, p: DVec2) -> DVec3 {
        self.origin + p.x * self.x + p.y * self.y
    }

    /// A world direction in this frame's coordinates.
    #[must_use]
    pub fn to_local(&self, direction: DVec3) -> DVec3 {
        DVec3::new(direction.dot(self.x), direction.dot(self.y), direction.dot(self.n))
    }

    /// A direction of this frame in the world.
    #[must_use]
    pub fn to_world(&self, direction: DVec3) -> DVec3 {
        direction.x * self.x + direction.y * self.y + direction.z * self.n
    }
}

/// A planar polygon with a chart: where radiance leaves or arrives.
#[derive(Clone, Debug)]
pub struct Polygon {
    frame: Frame,
    chart: Chart,
    /// Counter-clockwise in the frame's plane.
    outline: Vec<DVec2>,
    /// What cells are clipped to; empty if the outline is the chart's whole image.
    pieces: Vec<ConvexPolygon>,
}

/// Vertices may be this far off the plane, relative to the polygon's extent:
/// single-precision files round to 6·10⁻⁸ of their coordinates.
const PLANARITY: f64 = 1e-6;

/// Edges at an angle with a smaller sine are parallel: rounding makes 10⁻¹⁶ of it.
const PARALLEL: f64 = 1e-12;

impl Polygon {
    /// The rectangle origin + u·`edge_u` + v·`edge_v`.
    ///
    /// # Errors
    ///
    /// As [`rectilinear`](Self::rectilinear).
    pub fn rectangle(origin: DVec3, edge_u: DVec3, edge_v: DVec3) -> Result<Self> {
        Self::rectilinear(&[origin, origin + edge_u, origin + edge_u + edge_v, origin + edge_v])
    }

    /// Any simple polygon, convex or concave, under a rectilinear chart: its
    /// bounding rectangle with x̂ along the first edge (§7.1.1.1).
    ///
    /// `vertices` are counter-clockwise seen from the lit side. For a rectangle u
    /// runs from vertex 0 to 1 and v from 0 to 3.
    ///
    /// # Errors
    ///
    /// [`Error::VertexCount`], [`Error::NotFinite`], [`Error::ZeroArea`],
    /// [`Error::NotPlanar`] and [`Error::SelfCrossing`].
    pub fn rectilinear(vertices: &[DVec3]) -> Result<Self> {
        let (mut frame, mut outline) = flatten(vertices)?;
        let low = outline.iter().copied().fold(DVec2::INFINITY, DVec2::min);
        frame.origin = frame.point(low);
        for p in &mut outline {
            *p -= low;
        }
        let size = outline.iter().copied().fold(DVec2::ZERO, DVec2::max);
        let chart = Chart::Rectilinear { width: size.x, height: size.y };
        Self::clipped_to_outline(frame, chart, outline)
    }

    /// A quadrilateral under a rectilinear chart whose sides are its edges from
    /// vertex 0 to 1 (W) and from 0 to 3 (H); what of the chart's rectangle lies
    /// outside the quadrilateral is clipped away. Where those are parallel, as in a
    /// triangle whose vertices 3 and 0 are equal, H is the edge from 0 to 2.
    ///
    /// # Errors
    ///
    /// As [`rectilinear`](Self::rectilinear).
    pub fn rectilinear_quad(vertices: [DVec3; 4]) -> Result<Self> {
        let (frame, outline) = flatten(&vertices)?;
        let (u, mut v) = (outline[1] - outline[0], outline[3] - outline[0]);
        if u.perp_dot(v).abs() <= PARALLEL * u.length() * v.length() {
            v = outline[2] - outline[0];
        }
        let (width, height) = (u.length(), v.length());
        if width == 0.0 || height == 0.0 {
            return Err(Error::ZeroArea);
        }
        Self::clipped_to_outline(frame, Chart::Rectilinear { width, height }, outline)
    }

    /// A convex quadrilateral under a perspective chart (§7.1.1.2).
    ///
    /// # Errors
    ///
    /// As [`rectilinear`](Self::rectilinear), and [`Error::NotConvex`].
    pub fn perspective(vertices: [DVec3; 4]) -> Result<Self> {
        Self::quad(vertices, Chart::perspective)
    }

    /// A convex quadrilateral, or a triangle with two neighbouring vertices
    /// equal, under a bilinear chart (§7.1.1.3).
    ///
    /// # Errors
    ///
    /// As [`rectilinear`](Self::rectilinear), and [`Error::NotConvex`].
    pub fn bilinear(vertices: [DVec3; 4]) -> Result<Self> {
        Self::quad(vertices, Chart::bilinear)
    }

    /// Its frame.
    #[must_use]
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Its chart.
    #[must_use]
    pub fn chart(&self) -> &Chart {
        &self.chart
    }

    /// The outline in the frame's plane, counter-clockwise.
    #[must_use]
    pub fn outline(&self) -> &[DVec2] {
        &self.outline
    }

    /// The outline in world space.
    #[must_use]
    pub fn vertices(&self) -> Vec<DVec3> {
        self.outline.iter().map(|&p| self.frame.point(p)).collect()
    }

    /// Whether the outline is the chart's whole unit square.
    #[must_use]
    pub fn fills_chart(&self) -> bool {
        self.pieces.is_empty()
    }

    /// W and H of a rectilinear chart.
    #[must_use]
    pub fn size(&self) -> Option<DVec2> {
        match self.chart {
            Chart::Rectilinear { width, height } => Some(DVec2::new(width, height)),
            _ => None,
        }
    }

    /// Area of the outline.
    #[must_use]
    pub fn area(&self) -> f64 {
        signed_area(&self.outline)
    }

    /// The support of the cell (m_u, m_v) of level `level`, in the plane: convex
    /// pieces, none if the cell lies outside the outline.
    #[must_use]
    pub fn cell(&self, level: u8, m: [u16; 2]) -> Vec<ConvexPolygon> {
        let side = 1.0 / f64::from(1_u32 << u32::from(level));
        let corner = |a: u32, b: u32| {
            let at = |m: u16, c: u32| f64::from(u32::from(m) + c) * side;
            self.chart.to_plane(DVec2::new(at(m[0], a), at(m[1], b)))
        };
        let quad = ConvexPolygon::new(&[corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)]);
        if self.fills_chart() {
            return vec![quad];
        }
        let pieces = self.pieces.iter().map(|piece| quad.intersection(piece));
        pieces.filter(|piece| !piece.is_empty()).collect()
    }

    fn quad(vertices: [DVec3; 4], chart: impl Fn([DVec2; 4]) -> Result<Chart>) -> Result<Self> {
        let (frame, outline) = flatten(&vertices)?;
        let chart = chart([outline[0], outline[1], outline[2], outline[3]])?;
        Ok(Self { frame, chart, outline, pieces: Vec::new() })
    }

    fn clipped_to_outline(frame: Frame, chart: Chart, outline: Vec<DVec2>) -> Result<Self> {
        let mut polygon = Self { frame, chart, outline, pieces: Vec::new() };
        let size = polygon.size().unwrap_or_default();
        let corners = [DVec2::ZERO, DVec2::new(size.x, 0.0), size, DVec2::new(0.0, size.y)];
        let same = polygon.outline.len() == 4
            && corners.iter().all(|c| {
                // What single precision leaves of a right angle is not clipped.
                polygon.outline.iter().any(|p| p.distance(*c) <= PLANARITY * size.min_element())
            });
        if !same {
            polygon.pieces = triangulate(&polygon.outline);
        }
        Ok(polygon)
    }
}

/// The frame of a polygon (origin at vertex 0, x̂ along the first edge that has a
/// length) and its outline in it.
fn flatten(vertices: &[DVec3]) -> Result<(Frame, Vec<DVec2>)> {
    if vertices.len() < 3 {
        return Err(Error::VertexCount { found: vertices.len(), needed: "at least 3" });
    }
    if let Some(vertex) = vertices.iter().position(|v| !v.is_finite()) {
        return Err(Error::NotFinite { vertex });
    }
    let origin = vertices[0];
    let local: Vec<DVec3> = vertices.iter().map(|&v| v - origin).collect();
    let extent = local.iter().map(|v| v.length()).fold(0.0, f64::max);
    if extent == 0.0 || !extent.is_finite() {
        return Err(Error::ZeroArea);
    }
    // Newell's normal, in units of the extent so that squares do not underflow.
    let unit: Vec<DVec3> = local.iter().map(|&v| v / extent).collect();
    let normal: DVec3 = unit[1..].windows(2).map(|w| w[0].cross(w[1])).sum();
    let edge = unit[1];
    let n = normal.normalize_or_zero();
    let x = (edge - edge.dot(n) * n).normalize_or_zero();
    if n == DVec3::ZERO || x == DVec3::ZERO || normal.length() <= 1e-14 {
        return Err(Error::ZeroArea);
    }
    let frame = Frame { origin, x, y: n.cross(x), n };
    let tolerance = PLANARITY * extent;
    let distances = local.iter().map(|v| v.dot(n).abs());
    let (vertex, distance) =
        distances.enumerate().fold((0, 0.0), |worst, d| if d.1 > worst.1 { d } else { worst });
    if distance > tolerance {
        return Err(Error::NotPlanar { vertex, distance });
    }
    let outline: Vec<DVec2> = local.iter().map(|v| DVec2::new(v.dot(x), v.dot(frame.y))).collect();
    require_simple(&outline)?;
    Ok((frame, outline))
}

fn signed_area(outline: &[DVec2]) -> f64 {
    let origin = outline[0];
    0.5 * outline[1..].windows(2).map(|w| (w[0] - origin).perp_dot(w[1] - origin)).sum::<f64>()
}

fn turn(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - a)
}

fn require_simple(outline: &[DVec2]) -> Result<()> {
    let n = outline.len();
    for first in 0..n {
        for second in first + 2..n {
            if first == 0 && second == n - 1 {
                continue;
            }
            let (a, b) = (outline[first], outline[first + 1]);
            let (c, d) = (outline[second], outline[(second + 1) % n]);
            if turn(a, b, c) * turn(a, b, d) < 0.0 && turn(c, d, a) * turn(c, d, b) < 0.0 {
                return Err(Error::SelfCrossing { first, second });
            }
        }
    }
    Ok(())
}

/// Convex pieces of a simple polygon: itself if it is convex and small, else
/// triangles by ear clipping.
fn triangulate(outline: &[DVec2]) -> Vec<ConvexPolygon> {
    let n = outline.len();
    let convex =
        (0..n).all(|i| turn(outline[i], outline[(i + 1) % n], outline[(i + 2) % n]) >= 0.0);
    if convex && n <= 6 {
        return vec![ConvexPolygon::new(outline)];
    }
    let mut rest: Vec<DVec2> = outline.to_vec();
    let mut triangles = Vec::with_capacity(n);
    while rest.len() > 3 {
        let n = rest.len();
        let corner = |i: usize| [rest[(i + n - 1) % n], rest[i], rest[(i + 1) % n]];
        let is_ear = |&i: &usize| {
            let [a, b, c] = corner(i);
            turn(a, b, c) > 0.0
                && !rest.iter().any(|&p| {
                    p != a
                        && p != b
                        && p != c
                        && turn(a, b, p) >= 0.0
                        && turn(b, c, p) >= 0.0
                        && turn(c, a, p) >= 0.0
                })
        };
        // Rounding can leave no ear in a sliver: then its flattest corner goes.
        let flattest = || {
            let flat = |i: usize| {
                let [a, b, c] = corner(i);
                turn(a, b, c).abs()
            };
            (0..n).min_by(|&i, &j| flat(i).total_cmp(&flat(j))).unwrap_or(0)
        };
        let ear = (0..n).find(is_ear).unwrap_or_else(flattest);
        let triangle = corner(ear);
        if turn(triangle[0], triangle[1], triangle[2]) > 0.0 {
            triangles.push(ConvexPolygon::new(&triangle));
        }
        rest.remove(ear);
    }
    triangles.push(ConvexPolygon::new(&rest));
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(points: &[(f64, f64)]) -> Vec<DVec3> {
        points.iter().map(|&(x, y)| DVec3::new(x, y, 0.0)).collect()
    }

    #[test]
    fn frame_of_a_rectangle_runs_along_its_edges() {
        let p = Polygon::rectangle(DVec3::new(1., 2., 3.), DVec3::X * 2.0, -DVec3::Z * 0.5)
            .expect("a rectangle");
        assert_eq!((p.frame().x, p.frame().y, p.frame().n), (DVec3::X, -DVec3::Z, DVec3::Y));
        assert_eq!(p.size(), Some(DVec2::new(2.0, 0.5)));
        assert!(p.fills_chart(), "{p:?}");
    }

    /// The cells of a concave polygon have its area together, at any level.
    #[test]
    fn cells_of_an_l_shape_add_up_to_its_area() {
        let l = flat(&[(0., 0.), (3., 0.), (3., 1.), (1., 1.), (1., 2.), (0., 2.)]);
        let polygon = Polygon::rectilinear(&l).expect("an L");
        for level in 0..4 {
            let side = 1_u16 << level;
            let area: f64 = (0..side)
                .flat_map(|u| (0..side).map(move |v| [u, v]))
                .flat_map(|m| polygon.cell(level, m))
                .map(|piece| piece.area())
                .sum();
            assert!((area - 4.0).abs() < 1e-13, "level {level}: {area}");
        }
    }

    #[test]
    fn each_bad_polygon_is_named() {
        let nan = [DVec3::ZERO, DVec3::X, DVec3::new(f64::NAN, 1.0, 0.0)];
        assert!(matches!(Polygon::rectilinear(&nan), Err(Error::NotFinite { vertex: 2 })));
        let line = flat(&[(0., 0.), (1., 0.), (2., 0.)]);
        assert!(matches!(Polygon::rectilinear(&line), Err(Error::ZeroArea)));
        let bow = flat(&[(0., 0.), (2., 1.), (2., 0.), (0., 1.2)]);
        assert!(matches!(Polygon::rectilinear(&bow), Err(Error::SelfCrossing { .. })));
        let mut bent = flat(&[(0., 0.), (1., 0.), (1., 1.), (0., 1.)]);
        bent[2].z = 1e-3;
        assert!(matches!(Polygon::rectilinear(&bent), Err(Error::NotPlanar { .. })));
        let two = flat(&[(0., 0.), (1., 0.)]);
        assert!(matches!(Polygon::rectilinear(&two), Err(Error::VertexCount { found: 2, .. })));
    }
}
