//! One source cell seen from one destination cell: the integrand of a transport
//! coefficient (§7.1.4.1).

use super::TransportGeometry;
use crate::{ConvexPolygon, Levels, Nusselt};
use glam::{DVec2, DVec3};

/// The support of a pure smoothing function: a cell of position × direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Support {
    /// The cell's level in position and in direction.
    pub levels: Levels,
    /// Offsets along u, v, κ, λ, below 2^level.
    pub m: [u16; 4],
}

impl Support {
    /// The support of level `l` of the paper's isotropic index.
    ///
    /// # Panics
    ///
    /// If `l` is above [`Levels::MAX`].
    #[must_use]
    pub fn isotropic(l: u8, m: [u16; 4]) -> Self {
        Self { levels: Levels::isotropic(l), m }
    }

    /// The L² normalisation of its smoothing function, 4^l.
    #[must_use]
    pub fn scale(&self) -> f64 {
        self.levels.scale(self.levels.depth())
    }

    /// The rectangle of direction cosines (μx, μy), lower and upper corner.
    #[must_use]
    pub fn cosines(&self) -> [DVec2; 2] {
        let side = 2.0 / f64::from(1_u32 << u32::from(self.levels.direction));
        let low = DVec2::new(f64::from(self.m[2]), f64::from(self.m[3])) * side - 1.0;
        [low, low + side]
    }
}

/// A source cell and a destination cell with all that does not depend on the
/// direction worked out.
///
/// Its two integrands are those of T_jk over the destination's direction cell:
/// G_j A_jk in two dimensions, and the plain indicator in four.
#[derive(Debug)]
pub struct Pair<'a> {
    geometry: &'a TransportGeometry,
    /// Position supports of the source, in the destination's frame, as edges
    /// (start, end − start) counter-clockwise seen from the front.
    sources: Vec<Vec<(DVec3, DVec3)>>,
    /// Position supports of the destination, on the front of the source's plane.
    dests: Vec<ConvexPolygon>,
    /// Cosines of the destination's direction cell.
    dest_box: [DVec2; 2],
    /// Cosines of the source's direction cell.
    source_box: [DVec2; 2],
    dest: Support,
    source: Support,
}

/// Where a projected source cell covers a destination cell.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Overlap {
    /// Area in the destination's (u, v).
    pub(super) area: f64,
    /// Length of the border in the destination's plane.
    pub(super) border: f64,
}

impl<'a> Pair<'a> {
    /// The pair of cells `source` and `dest` of `geometry`'s polygons.
    #[must_use]
    pub fn new(geometry: &'a TransportGeometry, source: Support, dest: Support) -> Self {
        let dests = geometry.dest().cell(dest.levels.position, [dest.m[0], dest.m[1]]);
        let sources = geometry.source().cell(source.levels.position, [source.m[0], source.m[1]]);
        Self::between(geometry, &sources, source, &dests, dest)
    }

    /// The pair of these parts of the two planes, each with the directions of a cell.
    pub(super) fn between(
        geometry: &'a TransportGeometry,
        sources: &[ConvexPolygon],
        source: Support,
        dests: &[ConvexPolygon],
        dest: Support,
    ) -> Self {
        let [_, _, n] = geometry.source_axes();
        let origin = geometry.source_to_dest(DVec2::ZERO);
        let dests = dests
            .iter()
            .map(|d| d.clipped(|p| n.dot(p.extend(0.0) - origin)).without_short_edges())
            .filter(|d| !d.is_empty())
            .collect();
        let lift = |p| geometry.source_to_dest(p);
        let sources = sources
            .iter()
            .map(ConvexPolygon::without_short_edges)
            .map(|s| s.edges().map(|(a, b)| (lift(a), lift(b) - lift(a))).collect())
            .filter(|s: &Vec<(DVec3, DVec3)>| s.iter().any(|(a, _)| a.z > 0.0))
            .collect();
        let (dest_box, source_box) = (dest.cosines(), source.cosines());
        Self { geometry, sources, dests, dest_box, source_box, dest, source }
    }

    /// The geometry it was made for.
    #[must_use]
    pub fn geometry(&self) -> &'a TransportGeometry {
        self.geometry
    }

    /// The destination cell.
    #[must_use]
    pub fn dest(&self) -> Support {
        self.dest
    }

    /// The source cell.
    #[must_use]
    pub fn source(&self) -> Support {
        self.source
    }

    /// Cosines (μx, μy) that bound the destination's direction cell, low and high.
    #[must_use]
    pub fn dest_box(&self) -> [DVec2; 2] {
        self.dest_box
    }

    /// Cosines that bound the source's direction cell, low and high.
    #[must_use]
    pub fn source_box(&self) -> [DVec2; 2] {
        self.source_box
    }

    /// Position supports of the source, in the destination's frame, as edges
    /// (start, end − start), counter-clockwise seen from the front.
    #[must_use]
    pub fn sources(&self) -> &[Vec<(DVec3, DVec3)>] {
        &self.sources
    }

    /// Position supports of the destination in its plane.
    #[must_use]
    pub fn dests(&self) -> &[ConvexPolygon] {
        &self.dests
    }

    /// Factor from ∬ G A dκ dλ (or the four-dimensional measure) to T_jk.
    #[must_use]
    pub fn scale(&self) -> f64 {
        self.source.scale() * self.dest.scale()
    }

    /// A_jk(μ): the area in the destination's (u, v) of the source's position
    /// support, projected along `mu`, inside the destination's position support.
    ///
    /// Clips the destination by the planes through the source's edges and `mu`,
    /// which needs no division by μz, so that grazing directions are no special
    /// case.
    #[must_use]
    pub fn area(&self, mu: DVec3) -> f64 {
        let chart = self.geometry.dest().chart();
        let mut sum = 0.0;
        self.overlaps(mu, |overlap| sum += chart.area(overlap));
        sum
    }

    /// The [`area`](Self::area) along `mu`, and the border around it.
    pub(super) fn overlap(&self, mu: DVec3) -> Overlap {
        let chart = self.geometry.dest().chart();
        let mut sum = Overlap::default();
        self.overlaps(mu, |overlap| {
            sum.area += chart.area(overlap);
            sum.border += overlap.edges().map(|(a, b)| a.distance(b)).sum::<f64>();
        });
        sum
    }

    fn overlaps(&self, mu: DVec3, mut each: impl FnMut(&ConvexPolygon)) {
        for source in &self.sources {
            for dest in &self.dests {
                let mut overlap = *dest;
                for (start, edge) in source {
                    let n = edge.cross(mu);
                    let c = n.dot(*start);
                    overlap.clip(|p| n.x * p.x + n.y * p.y - c);
                    if overlap.is_empty() {
                        break;
                    }
                }
                if !overlap.is_empty() {
                    each(&overlap);
                }
            }
        }
    }

    /// Whether light arriving from `mu` leaves the source within its direction
    /// cell: the directional part of G_j.
    #[must_use]
    pub fn leaves_in_cell(&self, mu: DVec3) -> bool {
        let travel = self.geometry.source_direction(mu);
        let [low, high] = self.source_box;
        travel.z > 0.0
            && (low.x <= travel.x && travel.x < high.x || travel.x == 1.0 && high.x == 1.0)
            && (low.y <= travel.y && travel.y < high.y || travel.y == 1.0 && high.y == 1.0)
    }

    /// G_j A_jk at a point of the destination's direction cell, each coordinate in
    /// [0, 1]; 0 outside the UDC. Integrates to T_jk / [`scale`](Self::scale) ×
    /// 4^l_d.
    #[must_use]
    pub fn integrand_2d(&self, x: [f64; 2]) -> f64 {
        match self.direction(x) {
            Some(mu) if self.leaves_in_cell(mu) => self.area(mu),
            _ => 0.0,
        }
    }

    /// 1 where the ray of a point of the destination's whole cell, each coordinate
    /// in [0, 1] (u, v, κ, λ), comes from the source's cell, else 0.
    #[must_use]
    pub fn integrand_4d(&self, x: [f64; 4]) -> f64 {
        let Some(mu) = self.direction([x[2], x[3]]).filter(|&mu| self.leaves_in_cell(mu)) else {
            return 0.0;
        };
        let side = 1.0 / f64::from(1_u32 << u32::from(self.dest.levels.position));
        let uv = DVec2::new(f64::from(self.dest.m[0]) + x[0], f64::from(self.dest.m[1]) + x[1]);
        let point = self.geometry.dest().chart().to_plane(uv * side);
        let inside = self.dests.iter().any(|dest| {
            // The quadrature samples closed cells: a border counts as inside.
            self.geometry.dest().fills_chart()
                || dest.edges().all(|(a, b)| (b - a).perp_dot(point - a) >= 0.0)
        });
        let Some(hit) = self.geometry.source_point(point, mu).filter(|_| inside) else {
            return 0.0;
        };
        let hit = self.geometry.source_to_dest(hit);
        let [_, _, n] = self.geometry.source_axes();
        let inside = self
            .sources
            .iter()
            .any(|source| source.iter().all(|(start, edge)| edge.cross(hit - start).dot(n) >= 0.0));
        f64::from(u8::from(inside))
    }

    /// The direction at a point of the destination's direction cell.
    fn direction(&self, x: [f64; 2]) -> Option<DVec3> {
        let [low, high] = self.dest_box;
        let mu = low + (high - low) * DVec2::from_array(x);
        let q = 0.5 * (mu + 1.0);
        Nusselt { kappa: q.x, lambda: q.y }.to_direction()
    }
}
