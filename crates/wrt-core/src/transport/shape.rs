//! The overlap of two cells where no event lies: the same corners for all directions.

use super::pair::{Overlap, Pair};
use crate::{Chart, ConvexPolygon};
use glam::{DVec2, DVec3};

/// Which corners bound the overlaps of a pair's cells along directions between events.
///
/// [`Pair::area`] finds them by clipping, for each direction anew; here they are known
/// and only moved.
#[derive(Clone, Debug)]
pub(super) struct Shape {
    parts: Vec<Part>,
}

/// The overlap of one convex piece of the source with one of the destination.
#[derive(Clone, Debug)]
struct Part {
    source: usize,
    dest: usize,
    corners: Vec<Corner>,
}

/// A corner of an overlap.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Corner {
    /// That vertex of the destination.
    Dest(usize),
    /// The shadow of the source's vertex at which that edge starts.
    Source(usize),
    /// Where those edges cross.
    Crossing { dest: usize, source: usize },
}

/// The edge that leads on from a vertex.
#[derive(Clone, Copy, PartialEq)]
enum Edge {
    Dest(usize),
    Source(usize),
}

impl Shape {
    /// The shape along `mu`; `None` if it cannot be told, or does not give the areas
    /// that clipping finds there and along `other`.
    pub(super) fn of(pair: &Pair<'_>, mu: DVec3, other: DVec3) -> Option<Self> {
        let mut parts = Vec::new();
        for source in 0..pair.sources().len() {
            for dest in 0..pair.dests().len() {
                let edges = edges(&pair.sources()[source], &pair.dests()[dest], mu);
                if edges.len() < 3 {
                    continue;
                }
                let [s, d] = [pair.sources()[source].len(), pair.dests()[dest].vertices().len()];
                let before = edges.iter().cycle().skip(edges.len() - 1);
                let corners = before.zip(&edges).map(|(before, next)| match (*before, *next) {
                    (Edge::Dest(a), Edge::Dest(b)) if (a + 1) % d == b => Some(Corner::Dest(b)),
                    (Edge::Source(a), Edge::Source(b)) if (a + 1) % s == b || (b + 1) % s == a => {
                        // The source is seen from behind or in front.
                        Some(Corner::Source(if (a + 1) % s == b { b } else { a }))
                    }
                    (Edge::Dest(dest), Edge::Source(source))
                    | (Edge::Source(source), Edge::Dest(dest)) => {
                        Some(Corner::Crossing { dest, source })
                    }
                    _ => None,
                });
                let corners = corners.collect::<Option<Vec<Corner>>>()?;
                if corners.len() > ConvexPolygon::CAPACITY {
                    return None;
                }
                parts.push(Part { source, dest, corners });
            }
        }
        let shape = Self { parts };
        let agrees = |mu: DVec3| {
            let clipped = pair.area(mu);
            (shape.area(pair, mu) - clipped).abs() <= 1e-11 * clipped
        };
        (agrees(mu) && agrees(other)).then_some(shape)
    }

    /// [`Pair::area`] along a direction between the same events.
    pub(super) fn area(&self, pair: &Pair<'_>, mu: DVec3) -> f64 {
        let chart = pair.geometry().dest().chart();
        let mut sum = 0.0;
        self.outlines(pair, mu, |vertices| {
            sum += match chart {
                Chart::Rectilinear { width, height } => enclosed(vertices) / (width * height),
                _ => chart.area(&ConvexPolygon::new(vertices)),
            };
        });
        sum
    }

    /// [`Pair::overlap`], likewise.
    pub(super) fn overlap(&self, pair: &Pair<'_>, mu: DVec3) -> Overlap {
        let mut border = 0.0;
        self.outlines(pair, mu, |vertices| {
            let next = vertices.iter().cycle().skip(1);
            border += vertices.iter().zip(next).map(|(a, b)| a.distance(*b)).sum::<f64>();
        });
        Overlap { area: self.area(pair, mu), border }
    }

    /// Hands the corners of each part to `each`.
    fn outlines(&self, pair: &Pair<'_>, mu: DVec3, mut each: impl FnMut(&[DVec2])) {
        let slope = mu.truncate() / mu.z;
        let mut vertices = [DVec2::ZERO; ConvexPolygon::CAPACITY];
        for Part { source, dest, corners } in &self.parts {
            let (source, dest) = (&pair.sources()[*source][..], pair.dests()[*dest].vertices());
            for (vertex, corner) in vertices.iter_mut().zip(corners) {
                *vertex = match *corner {
                    Corner::Dest(i) => dest[i],
                    Corner::Source(j) => source[j].0.truncate() - slope * source[j].0.z,
                    Corner::Crossing { dest: i, source: j } => {
                        let (p, q) = (dest[i], dest[if i + 1 == dest.len() { 0 } else { i + 1 }]);
                        let (start, edge) = source[j];
                        let n = edge.cross(mu);
                        let c = n.dot(start);
                        let side = |x: DVec2| n.x * x.x + n.y * x.y - c;
                        let (a, b) = (side(p), side(q));
                        let t = if a == b { 0.5 } else { (a / (a - b)).clamp(0.0, 1.0) };
                        p + (q - p) * t
                    }
                };
            }
            each(&vertices[..corners.len().min(vertices.len())]);
        }
    }
}

/// Area of a convex polygon; relative to its first vertex, so that slivers far from
/// the origin do not cancel.
fn enclosed(vertices: &[DVec2]) -> f64 {
    let Some((&first, rest)) = vertices.split_first() else { return 0.0 };
    let mut last = DVec2::ZERO;
    let mut sum = 0.0;
    for &x in rest {
        sum += last.perp_dot(x - first);
        last = x - first;
    }
    (0.5 * sum).max(0.0)
}

/// The edges of `dest` clipped by the shadow of `source` along `mu` (Sutherland &
/// Hodgman), each leading on from a vertex of the overlap.
fn edges(source: &[(DVec3, DVec3)], dest: &ConvexPolygon, mu: DVec3) -> Vec<Edge> {
    let mut shape: Vec<(DVec2, Edge)> =
        dest.vertices().iter().enumerate().map(|(i, &v)| (v, Edge::Dest(i))).collect();
    for (j, (start, edge)) in source.iter().enumerate() {
        let n = edge.cross(mu);
        let c = n.dot(*start);
        let side = |x: DVec2| n.x * x.x + n.y * x.y - c;
        let mut out = Vec::with_capacity(shape.len() + 1);
        for (i, &(v, edge)) in shape.iter().enumerate() {
            let next = shape[(i + 1) % shape.len()].0;
            let (a, b) = (side(v), side(next));
            let crossing = || v + (next - v) * (a / (a - b));
            if a > 0.0 {
                out.push((v, edge));
                if b <= 0.0 {
                    out.push((crossing(), Edge::Source(j)));
                }
            } else if b > 0.0 {
                out.push((crossing(), edge));
            }
        }
        shape = out;
        if shape.len() < 3 {
            return Vec::new();
        }
    }
    shape.into_iter().map(|(_, edge)| edge).collect()
}
