//! Which part of a direction cell can see the source at all.

use crate::transport::Pair;
use glam::{DVec2, DVec3};

/// A box of the destination's direction cell, in cell coordinates, outside which
/// no ray from the destination's cell meets the source's: low and high corner.
/// `None` if none does.
///
/// The rays' directions are those of the polytope S − D (Minkowski). On the
/// sphere they fill a convex region, so that μx and μy are extreme on its border:
/// along the polytope's edges, each a vertex of one polygon minus an edge of the
/// other, or on the horizon.
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
    let [low, high] = pair.dest_box();
    let corner = |mu: DVec2| ((mu - low) / (high - low)).clamp(DVec2::ZERO, DVec2::ONE);
    let (from, to) = (corner(bounds.low), corner(bounds.high));
    (from.cmplt(to).all()).then(|| [from.to_array(), to.to_array()])
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

    /// No direction from a grid of dest points to a grid of source points leaves
    /// the box, and some come within a grid cell of each side.
    #[test]
    fn the_box_is_tight_around_all_directions() {
        for (geometry, [j, k]) in
            [facts::facing(), facts::tilted(), facts::far(), facts::shared_edge()]
        {
            let pair = Pair::new(&geometry, j, k);
            let [low, high] = visible_box(&pair).expect("they see each other");
            let (mut least, mut greatest) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
            const N: u32 = 12;
            let grid = |polygon: &crate::Polygon| {
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
            let (low, high) = (DVec2::from(low), DVec2::from(high));
            assert!((low - 1e-9).cmple(least).all(), "{low} {least}");
            assert!((high + 1e-9).cmpge(greatest).all(), "{high} {greatest}");
            let slack = 2.0 / f64::from(N);
            assert!((least - low).max_element() < slack, "{low} {least}");
            assert!((high - greatest).max_element() < slack, "{high} {greatest}");
        }
    }
}
