//! Which part of a direction cell can get light from the source's cell at all.

use crate::transport::Pair;
use glam::{DVec2, DVec3};

/// A box of the destination's direction cell, in cell coordinates, outside which
/// the integrand is zero: low and high corner. `None` if it is zero everywhere.
///
/// It bounds the directions towards the source's positions and those of the light
/// of its direction cell. The former are those of the polytope S − D (Minkowski):
/// on the sphere they fill a convex region, so that μx and μy are extreme on its
/// border, along the polytope's edges, each a vertex of one polygon minus an edge
/// of the other, or on the horizon.
pub(super) fn visible_box(pair: &Pair<'_>) -> Option<[[f64; 2]; 2]> {
    let mut bounds = Bounds::EMPTY;
    for source in pair.sources() {
        for dest in pair.dests() {
            let mut part = Bounds::EMPTY;
            for (start, edge) in source {
                for (a, b) in dest.edges() {
                    let (a, b) = (a.extend(0.0), b.extend(0.0));
                    part.add_segment(start - a, start + edge - a);
                    part.add_segment(start - a, start - b);
                }
            }
            part.close_horizon();
            bounds.low = bounds.low.min(part.low);
            bounds.high = bounds.high.max(part.high);
        }
    }
    let leaving = leaving(pair);
    bounds.low = bounds.low.max(leaving.low);
    bounds.high = bounds.high.min(leaving.high);
    let [low, high] = pair.dest_box();
    let corner = |mu: DVec2| ((mu - low) / (high - low)).clamp(DVec2::ZERO, DVec2::ONE);
    let (from, to) = (corner(bounds.low), corner(bounds.high));
    (from.cmplt(to).all()).then(|| [from.to_array(), to.to_array()])
}

/// Bounds of the directions whose light leaves the source in its direction cell.
///
/// μx = c·t is linear in the direction of travel t, a point of the sphere above a
/// rectangle of its (x, y). So it is extreme at ±c, on an edge, or at a corner.
fn leaving(pair: &Pair<'_>) -> Bounds {
    let axes = pair.geometry().source_axes();
    let [low, high] = pair.source_box();
    let mut bounds = Bounds::EMPTY;
    for axis in 0..2 {
        let c = -DVec3::from(axes.map(|a| a[axis]));
        let mut add = |t: DVec2| {
            if t.cmpge(low).all() && t.cmple(high).all() {
                let z = (1.0 - t.length_squared()).max(0.0).sqrt();
                bounds.low[axis] = bounds.low[axis].min(c.dot(t.extend(z)));
                bounds.high[axis] = bounds.high[axis].max(c.dot(t.extend(z)));
            }
        };
        let rim = c.truncate().normalize_or_zero();
        // The pole of ±c that is not below the source, and where c's meridian
        // meets the rim.
        add(c.truncate() * if c.z < 0.0 { -1.0 } else { 1.0 } / c.length());
        add(rim);
        add(-rim);
        for edge in 0..2 {
            let across = 1 - edge;
            for at in [low[edge], high[edge]].into_iter().filter(|at| at.abs() <= 1.0) {
                // On the circle t[edge] = at: its ends on the rim, its extreme
                // above it, and the corners.
                let radius = (1.0 - at * at).sqrt();
                let slope = DVec2::new(c[across], c.z).normalize_or_zero();
                let extreme = radius * slope.x * if slope.y < 0.0 { -1.0 } else { 1.0 };
                let corners = [low[across], high[across]];
                let inside = corners.into_iter().filter(|x| x.abs() <= radius);
                for x in inside.chain([-radius, radius, extreme]) {
                    let mut t = DVec2::splat(at);
                    t[across] = x;
                    add(t);
                }
            }
        }
    }
    bounds
}

/// Bounds of direction cosines (μx, μy).
struct Bounds {
    low: DVec2,
    high: DVec2,
    /// Bounds of the directions on the horizon.
    horizon: Option<[DVec2; 2]>,
}

impl Bounds {
    const EMPTY: Self = Self { low: DVec2::INFINITY, high: DVec2::NEG_INFINITY, horizon: None };

    /// Adds the directions of the part of the segment from `a` to `b` that is not
    /// below the horizon.
    fn add_segment(&mut self, mut a: DVec3, mut b: DVec3) {
        if a.z < 0.0 && b.z < 0.0 {
            return;
        }
        if a.z < 0.0 {
            a = (b + (a - b) * (b.z / (b.z - a.z))).with_z(0.0);
        } else if b.z < 0.0 {
            b = (a + (b - a) * (a.z / (a.z - b.z))).with_z(0.0);
        }
        self.add(a);
        self.add(b);
        let e = b - a;
        let (aa, ae, ee) = (a.dot(a), a.dot(e), e.dot(e));
        for axis in 0..2 {
            // Where d/dt of (a + t e)ₓ / |a + t e| is zero.
            let t = (a[axis] * ae - e[axis] * aa) / (e[axis] * ae - a[axis] * ee);
            if 0.0 < t && t < 1.0 {
                self.add(a + e * t);
            }
        }
    }

    fn add(&mut self, d: DVec3) {
        // 0 where the polygons touch: it is no direction, and those around it are
        // on other edges.
        let Some(mu) = d.try_normalize() else { return };
        let mu_xy = mu.truncate();
        self.low = self.low.min(mu_xy);
        self.high = self.high.max(mu_xy);
        if mu.z == 0.0 {
            let [low, high] = self.horizon.unwrap_or([mu_xy; 2]);
            self.horizon = Some([low.min(mu_xy), high.max(mu_xy)]);
        }
    }

    /// Adds ±x̂ and ±ŷ where directions on the horizon may enclose them.
    fn close_horizon(&mut self) {
        let Some([low, high]) = self.horizon else { return };
        for (axis, across) in [(0, 1), (1, 0)] {
            if low[across] <= 0.0 && high[across] >= 0.0 {
                if high[axis] > 0.0 {
                    self.high[axis] = 1.0;
                }
                if low[axis] < 0.0 {
                    self.low[axis] = -1.0;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::facts;
    use super::*;
    use crate::transport::{Support, TransportGeometry};
    use crate::{Nusselt, Polygon};

    /// No direction from a grid of dest points to a grid of source points leaves
    /// the box, and some come within a grid cell of each side.
    #[test]
    fn the_box_is_tight_around_all_directions() {
        for (geometry, [j, k]) in
            [facts::facing(), facts::tilted(), facts::far(), facts::shared_edge()]
        {
            let pair = Pair::new(&geometry, j, k);
            let (mut least, mut greatest) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
            const N: u32 = 12;
            let grid = |polygon: &Polygon| {
                let point = |i: u32| {
                    let uv = DVec2::new(f64::from(i % (N + 1)), f64::from(i / (N + 1)));
                    polygon.frame().point(polygon.chart().to_plane(uv / f64::from(N)))
                };
                (0..(N + 1).pow(2)).map(point).collect::<Vec<_>>()
            };
            let (sources, dests) = (grid(geometry.source()), grid(geometry.dest()));
            for s in &sources {
                for d in &dests {
                    let mu = geometry.dest().frame().to_local(s - d).normalize_or_zero();
                    if mu.z > 1e-9 && geometry.source().frame().n.dot(d - s) > 1e-9 {
                        let x = 0.5 * (mu.truncate() + 1.0);
                        (least, greatest) = (least.min(x), greatest.max(x));
                    }
                }
            }
            require_tight(&pair, [least, greatest], 2.0 / f64::from(N));
        }
    }

    /// A direction cell at the source whose frame is the destination's turned about
    /// the normal is one at the destination: the box is that.
    #[test]
    fn the_box_of_an_aligned_direction_cell_is_the_cell() {
        let (geometry, [_, root]) = facts::facing();
        let mut j = Support::isotropic(2, [0, 0, 2, 1]);
        j.levels.position = 0;
        // Travel ½ > μx > 0 along dest y and −½ < μy < 0 along x, seen from the dest.
        let got = visible_box(&Pair::new(&geometry, j, root)).expect("they see each other");
        for (got, expected) in got.as_flattened().iter().zip([0.5, 0.25, 0.75, 0.5]) {
            assert!((got - expected).abs() < 1e-15, "{got} {expected}");
        }
    }

    /// The same source cells seen from a tilted destination, by a source so large
    /// that every direction meets it.
    #[test]
    fn the_box_holds_a_source_direction_cell() {
        let (tilted, [_, root]) = facts::tilted();
        let mut big = tilted.source().vertices();
        let middle = big.iter().sum::<DVec3>() / 4.0;
        big.iter_mut().for_each(|p| *p = middle + 1e6 * (*p - middle));
        let big = Polygon::rectilinear(&big).expect("a rectangle");
        let geometry = TransportGeometry::new(big, tilted.dest().clone());
        for m in 0..16 {
            let mut j = Support::isotropic(2, [0, 0, m / 4, m % 4]);
            j.levels.position = 0;
            let pair = Pair::new(&geometry, j, root);
            let bounds = visible_box(&pair).unwrap_or_default();
            const N: u32 = 200;
            for i in 0..(N + 1).pow(2) {
                let [x, y] = [i % (N + 1), i / (N + 1)].map(|i| f64::from(i) / f64::from(N));
                let mu = Nusselt { kappa: x, lambda: y }.to_direction();
                let inside = (bounds[0][0]..=bounds[1][0]).contains(&x)
                    && (bounds[0][1]..=bounds[1][1]).contains(&y);
                let lit = mu.is_some_and(|mu| pair.leaves_in_cell(mu));
                assert!(inside || !lit, "({x}, {y}) of cell {m} is outside {bounds:?}");
            }
        }
    }

    fn require_tight(pair: &Pair<'_>, [least, greatest]: [DVec2; 2], slack: f64) {
        let [low, high] = visible_box(pair).expect("they see each other").map(DVec2::from);
        assert!((low - 1e-9).cmple(least).all(), "{low} {least}");
        assert!((high + 1e-9).cmpge(greatest).all(), "{high} {greatest}");
        assert!((least - low).max_element() < slack, "{low} {least}");
        assert!((high - greatest).max_element() < slack, "{high} {greatest}");
    }
}
