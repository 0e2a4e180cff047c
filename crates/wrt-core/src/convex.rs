//! Small convex polygons in a plane, clipped without allocation (§7.1.4.1).

use glam::DVec2;

/// A convex polygon of at most [`CAPACITY`](Self::CAPACITY) vertices,
/// counter-clockwise; empty if it has none.
#[derive(Clone, Copy, Debug)]
pub struct ConvexPolygon {
    vertices: [DVec2; Self::CAPACITY],
    len: usize,
}

impl ConvexPolygon {
    /// A cell clipped to a triangle (7), to another such (14), to two half-planes.
    pub const CAPACITY: usize = 16;

    /// No points at all.
    pub const EMPTY: Self = Self { vertices: [DVec2::ZERO; Self::CAPACITY], len: 0 };

    /// The polygon with these vertices, which must be convex and counter-clockwise.
    ///
    /// # Panics
    ///
    /// If there are more than [`CAPACITY`](Self::CAPACITY).
    #[must_use]
    pub fn new(vertices: &[DVec2]) -> Self {
        assert!(vertices.len() <= Self::CAPACITY, "{} vertices", vertices.len());
        let mut polygon = Self::EMPTY;
        polygon.vertices[..vertices.len()].copy_from_slice(vertices);
        polygon.len = vertices.len();
        polygon
    }

    /// Its vertices, counter-clockwise.
    #[must_use]
    pub fn vertices(&self) -> &[DVec2] {
        &self.vertices[..self.len]
    }

    /// Whether nothing is left.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len < 3
    }

    /// Its edges, each from a vertex to the next.
    pub fn edges(&self) -> impl Iterator<Item = (DVec2, DVec2)> {
        let v = self.vertices();
        (0..v.len()).map(move |i| (v[i], v[if i + 1 == v.len() { 0 } else { i + 1 }]))
    }

    /// The part where `side(x) ≥ 0`, for an affine `side`.
    #[must_use]
    pub fn clipped(&self, side: impl Fn(DVec2) -> f64) -> Self {
        let mut out = *self;
        out.clip(side);
        out
    }

    /// Leaves the part where `side(x) ≥ 0`, for an affine `side` (Sutherland &
    /// Hodgman, *Reentrant polygon clipping*, CACM 17(1), 1974).
    pub fn clip(&mut self, side: impl Fn(DVec2) -> f64) {
        let mut distance = [0.0; Self::CAPACITY];
        let (mut any_in, mut any_out) = (false, false);
        for (d, v) in distance.iter_mut().zip(self.vertices()) {
            *d = side(*v);
            any_in |= *d > 0.0;
            any_out |= *d < 0.0;
        }
        if !any_out {
            return;
        }
        let len = std::mem::take(&mut self.len);
        if !any_in {
            return;
        }
        let vertices = self.vertices;
        for i in 0..len {
            let next = if i + 1 == len { 0 } else { i + 1 };
            let (a, b) = (distance[i], distance[next]);
            if a >= 0.0 {
                self.push(vertices[i]);
            }
            if (a > 0.0 && b < 0.0) || (a < 0.0 && b > 0.0) {
                // From the inner end, so that both neighbours get the same point.
                let (from, to, t) = if a > 0.0 {
                    (vertices[i], vertices[next], a / (a - b))
                } else {
                    (vertices[next], vertices[i], b / (b - a))
                };
                self.push(from + (to - from) * t);
            }
        }
        if self.len < 3 {
            self.len = 0;
        }
    }

    /// The part inside `other` as well.
    #[must_use]
    pub fn intersection(&self, other: &Self) -> Self {
        let mut out = *self;
        for (a, b) in other.edges() {
            if out.is_empty() {
                break;
            }
            out = out.clipped(|x| (b - a).perp_dot(x - a));
        }
        if other.is_empty() { Self::EMPTY } else { out }
    }

    /// The same without vertices that repeat the one before, but for rounding: an
    /// edge between two such points has no direction.
    #[must_use]
    pub fn without_short_edges(&self) -> Self {
        let size = self.vertices().iter().map(|v| v.abs().max_element()).fold(0.0, f64::max);
        let least = 16.0 * f64::EPSILON * size;
        let mut out = Self::EMPTY;
        for (a, b) in self.edges() {
            if a.distance(b) > least {
                out.push(a);
            }
        }
        if out.len < 3 { Self::EMPTY } else { out }
    }

    /// Its area, from coordinates relative to a vertex so that a small polygon
    /// far from the origin does not cancel.
    #[must_use]
    pub fn area(&self) -> f64 {
        let v = self.vertices();
        if v.len() < 3 {
            return 0.0;
        }
        let fan = v[1..].windows(2).map(|w| (w[0] - v[0]).perp_dot(w[1] - v[0]));
        (0.5 * fan.sum::<f64>()).max(0.0)
    }

    fn push(&mut self, vertex: DVec2) {
        assert!(self.len < Self::CAPACITY, "a convex polygon outgrew its storage");
        self.vertices[self.len] = vertex;
        self.len += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn square(at: DVec2, side: f64) -> ConvexPolygon {
        let corner = |x, y| at + side * DVec2::new(x, y);
        ConvexPolygon::new(&[corner(0., 0.), corner(1., 0.), corner(1., 1.), corner(0., 1.)])
    }

    proptest! {
        #[test]
        fn a_line_splits_the_area_into_its_two_sides(
            a in -2.0..2.0f64, b in -2.0..2.0f64, c in -2.0..2.0f64,
        ) {
            let unit = square(DVec2::ZERO, 1.0);
            let side = |x: DVec2| a * x.x + b * x.y + c;
            let sum = unit.clipped(side).area() + unit.clipped(|x| -side(x)).area();
            prop_assert!((sum - 1.0).abs() < 1e-14, "{sum}");
        }

        #[test]
        fn squares_overlap_by_the_product_of_their_overlaps(x in -1.5..1.5f64, y in -1.5..1.5f64) {
            let overlap = square(DVec2::ZERO, 1.0).intersection(&square(DVec2::new(x, y), 1.0));
            let expected = (1.0 - x.abs()).max(0.0) * (1.0 - y.abs()).max(0.0);
            prop_assert!((overlap.area() - expected).abs() < 1e-14, "{}", overlap.area());
        }
    }

    #[test]
    fn a_sliver_far_away_keeps_its_area() {
        let (far, thin) = (DVec2::new(1e6, -1e6), 2.0_f64.powi(-20));
        let v = [far, far + DVec2::X, far + DVec2::new(1.0, thin), far + DVec2::new(0.0, thin)];
        assert_eq!(ConvexPolygon::new(&v).area(), thin);
    }
}
