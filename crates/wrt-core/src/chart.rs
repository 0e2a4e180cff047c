//! Charts: the maps (u, v) ↔ plane of §7.1.1, rectilinear, perspective and
//! bilinear, with their Jacobians.

use crate::{ConvexPolygon, Error, Result};
use glam::{DMat3, DVec2, DVec3};

/// A map of the unit square (u, v) onto a part of a plane with coordinates
/// (x, y), orientation kept.
#[derive(Clone, Debug)]
pub enum Chart {
    /// (x, y) = (W u, H v): a bounding rectangle from the plane's origin (§7.1.1.1).
    Rectilinear {
        /// W, along x.
        width: f64,
        /// H, along y.
        height: f64,
    },
    /// The projective map onto a convex quadrilateral (§7.1.1.2).
    Perspective {
        /// A of §7.1.1.2: homogeneous (u, v, 1) to (xw, yw, w).
        to_plane: DMat3,
        /// Its inverse.
        to_uv: DMat3,
    },
    /// p = (1−v)((1−u) p₀ + u p₁) + v((1−u) p₃ + u p₂) (§7.1.1.3).
    Bilinear {
        /// p₀ … p₃, counter-clockwise.
        corners: [DVec2; 4],
    },
}

impl Chart {
    /// The perspective chart of a quadrilateral, (u, v) = (0,0), (1,0), (1,1),
    /// (0,1) at its corners (Heckbert, *Fundamentals of texture mapping and image
    /// warping*, 1989, §2.2.3).
    ///
    /// # Errors
    ///
    /// [`Error::NotConvex`] unless it is strictly convex and counter-clockwise.
    pub fn perspective(corners: [DVec2; 4]) -> Result<Self> {
        require_convex(&corners, "perspective", f64::MIN_POSITIVE)?;
        let [p0, p1, p2, p3] = corners;
        // Relative to p0, so that the map itself does not cancel far away.
        let (e, f, d) = (p1 - p0, p3 - p0, p2 - p0);
        // d (g + h + 1) = e (g + 1) + f (h + 1)
        let area = (d - e).perp_dot(d - f);
        let rest = e + f - d;
        let g = rest.perp_dot(d - f) / area;
        let h = (d - e).perp_dot(rest) / area;
        let (x, y) = (e * (1.0 + g), f * (1.0 + h));
        let local = DMat3::from_cols(x.extend(g), y.extend(h), DVec3::Z);
        let shift = DMat3::from_cols(DVec3::X, DVec3::Y, p0.extend(1.0));
        let unshift = DMat3::from_cols(DVec3::X, DVec3::Y, (-p0).extend(1.0));
        Ok(Self::Perspective { to_plane: shift * local, to_uv: local.inverse() * unshift })
    }

    /// The bilinear chart of a quadrilateral, or of a triangle given with two
    /// equal neighbouring corners.
    ///
    /// # Errors
    ///
    /// [`Error::NotConvex`] if it is not convex and counter-clockwise.
    pub fn bilinear(corners: [DVec2; 4]) -> Result<Self> {
        require_convex(&corners, "bilinear", 0.0)?;
        Ok(Self::Bilinear { corners })
    }

    /// The point of the plane at (u, v).
    #[must_use]
    pub fn to_plane(&self, uv: DVec2) -> DVec2 {
        match self {
            Self::Rectilinear { width, height } => uv * DVec2::new(*width, *height),
            Self::Perspective { to_plane, .. } => project(to_plane, uv),
            Self::Bilinear { corners } => {
                let (p0, e, f, g) = edges(corners);
                p0 + uv.x * e + uv.y * f + uv.x * uv.y * g
            }
        }
    }

    /// (u, v) of a point of the plane. A bilinear chart picks the root that
    /// belongs to the unit square; at the collapsed corner of a triangle, where
    /// every u is right, ½.
    #[must_use]
    pub fn to_uv(&self, point: DVec2) -> DVec2 {
        match self {
            Self::Rectilinear { width, height } => point / DVec2::new(*width, *height),
            Self::Perspective { to_uv, .. } => project(to_uv, point),
            Self::Bilinear { corners } => bilinear_inverse(corners, point),
        }
    }

    /// |∂(x, y)/∂(u, v)|, positive inside the unit square.
    #[must_use]
    pub fn jacobian(&self, uv: DVec2) -> f64 {
        match self {
            Self::Rectilinear { width, height } => width * height,
            Self::Perspective { to_plane, .. } => {
                let w = to_plane.x_axis.z * uv.x + to_plane.y_axis.z * uv.y + to_plane.z_axis.z;
                to_plane.determinant() / (w * w * w)
            }
            Self::Bilinear { corners } => {
                let (_, e, f, g) = edges(corners);
                (e + uv.y * g).perp_dot(f + uv.x * g)
            }
        }
    }

    /// The area in (u, v) of a convex polygon given in the plane.
    ///
    /// Lines stay lines in rectilinear and perspective charts. In a bilinear one
    /// a line becomes a hyperbola (§7.1.1.3), whose area beside its chord has a
    /// closed form, so that the reduction to two dimensions of §7.1.4.1 holds
    /// for all three. Departs from §7.1.4.1, which rules it out for bilinear.
    #[must_use]
    pub fn area(&self, polygon: &ConvexPolygon) -> f64 {
        match self {
            Self::Rectilinear { width, height } => polygon.area() / (width * height),
            Self::Perspective { .. } => {
                let v = polygon.vertices();
                let Some(&first) = v.first() else { return 0.0 };
                let first = self.to_uv(first);
                let mut last = DVec2::ZERO;
                let mut sum = 0.0;
                for &x in &v[1..] {
                    let next = self.to_uv(x) - first;
                    sum += last.perp_dot(next);
                    last = next;
                }
                (0.5 * sum).max(0.0)
            }
            Self::Bilinear { corners } => bilinear_area(corners, polygon),
        }
    }
}

fn bilinear_area(corners: &[DVec2; 4], polygon: &ConvexPolygon) -> f64 {
    if polygon.is_empty() {
        return 0.0;
    }
    let (_, _, f, g) = edges(corners);
    let collapse = Collapse::of(corners);
    // An end in a triangle's collapsed corner has no (u, v) of its own: lines
    // through that corner keep the coordinate of their other end.
    let ends = |a: DVec2, b: DVec2| {
        let (p, q) = (bilinear_inverse(corners, a), bilinear_inverse(corners, b));
        (collapse.resolve(a, p, q), collapse.resolve(b, q, p))
    };
    let mut first = None;
    let mut last = DVec2::ZERO;
    let (mut chords, mut excess) = (0.0, 0.0);
    for (a, b) in polygon.edges() {
        if a == b {
            continue;
        }
        let (p, q) = ends(a, b);
        let origin = *first.get_or_insert(p);
        chords += last.perp_dot(p - origin) + (p - origin).perp_dot(q - origin);
        last = q - origin;
        // On the line n·x = const: ∂/∂v of n·p(u, v) is n·(f + u g).
        let n = (b - a).perp();
        let ratio = n.dot(f + q.x * g) / n.dot(f + p.x * g);
        excess += (q.x - p.x) * (q.y - p.y) * hyperbola_excess(ratio);
    }
    (0.5 * chords - excess).max(0.0)
}

/// The corner in which two neighbouring corners of a bilinear chart coincide.
#[derive(Clone, Copy)]
struct Collapse {
    at: DVec2,
    /// Points nearer than this are the corner, give or take rounding.
    radius: f64,
    /// Which coordinate is undefined there: 0 = u, 1 = v.
    lost: Option<usize>,
}

impl Collapse {
    fn of(corners: &[DVec2; 4]) -> Self {
        let found = (0..4).find(|&i| corners[i] == corners[(i + 1) % 4]);
        let at = corners[found.unwrap_or(0)];
        let extent = corners.iter().map(|c| c.distance(at)).fold(0.0, f64::max);
        Self {
            at,
            radius: 64.0 * f64::EPSILON * (extent + at.length()),
            lost: found.map(|i| i % 2),
        }
    }

    /// (u, v) of `point`, found as `own`, seen along a line on to `other`.
    fn resolve(self, point: DVec2, own: DVec2, other: DVec2) -> DVec2 {
        match self.lost {
            Some(_) if point.distance(self.at) > self.radius => own,
            Some(0) => DVec2::new(other.x, own.y.round()),
            Some(_) => DVec2::new(own.x.round(), other.y),
            None => own,
        }
    }
}

/// (∫ v du − chord) / ((u₂−u₁)(v₂−v₁)) for the hyperbola through two points whose
/// denominators have the given ratio r: r (r − 1 − ln r)/(r − 1)² − ½.
fn hyperbola_excess(r: f64) -> f64 {
    if !(r > 0.0 && r.is_finite()) {
        // Vertical in (u, v), where the factor (u₂ − u₁) is zero or rounding.
        return 0.0;
    }
    let d = r - 1.0;
    if d.abs() < 0.05 {
        // Σ (−1)^(k+1) d^k / ((k+1)(k+2)): 13 terms reach round-off.
        (1..=13).rev().fold(0.0, |sum, k| {
            let k = f64::from(k);
            1.0 / ((k + 1.0) * (k + 2.0)) - d * sum
        }) * d
    } else {
        r * (d - r.ln()) / (d * d) - 0.5
    }
}

fn project(matrix: &DMat3, point: DVec2) -> DVec2 {
    let q = *matrix * point.extend(1.0);
    q.truncate() / q.z
}

/// p(u, v) = p₀ + u e + v f + u v g.
fn edges(&[p0, p1, p2, p3]: &[DVec2; 4]) -> (DVec2, DVec2, DVec2, DVec2) {
    (p0, p1 - p0, p3 - p0, (p0 - p1) + (p2 - p3))
}

fn bilinear_inverse(corners: &[DVec2; 4], point: DVec2) -> DVec2 {
    let (p0, e, f, g) = edges(corners);
    let h = point - p0;
    // k2 v² + k1 v + k0 = 0, whose derivative at a root is the Jacobian there,
    // positive inside: so the root with +√ is the one inside, always.
    let k2 = g.perp_dot(f);
    let k1 = e.perp_dot(f) + h.perp_dot(g);
    let k0 = h.perp_dot(e);
    let root = (k1 * k1 - 4.0 * k0 * k2).max(0.0).sqrt();
    let v = if corners[2] == corners[3] {
        // A triangle: the other root is 1, and the square root would cancel.
        k0 / k2
    } else if k1 > 0.0 {
        -2.0 * k0 / (k1 + root)
    } else {
        (root - k1) / (2.0 * k2)
    };
    let v = if v.is_finite() { v } else { 0.0 };
    let (along, rest) = (e + v * g, h - v * f);
    let u = if along.x.abs() > along.y.abs() { rest.x / along.x } else { rest.y / along.y };
    DVec2::new(if u.is_finite() { u } else { 0.5 }, v)
}

/// All corners turn left, by more than `least` (an area).
fn require_convex(corners: &[DVec2; 4], chart: &'static str, least: f64) -> Result<()> {
    for vertex in 0..4 {
        let [a, b, c] = [3, 0, 1].map(|i| corners[(vertex + i) % 4]);
        let turn = (b - a).perp_dot(c - b);
        // A triangle's repeated corner turns by 0, or by the rounding of 0.
        let rounding = 8.0 * f64::EPSILON * (b - a).length() * (c - b).length();
        if turn < least - if least == 0.0 { rounding } else { 0.0 } {
            return Err(Error::NotConvex { vertex, chart });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const QUAD: [DVec2; 4] =
        [DVec2::new(0.1, 0.2), DVec2::new(2.0, -0.3), DVec2::new(2.5, 1.9), DVec2::new(-0.4, 1.1)];

    fn charts() -> Vec<Chart> {
        vec![
            Chart::Rectilinear { width: 2.0, height: 0.5 },
            Chart::perspective(QUAD).expect("convex"),
            Chart::bilinear(QUAD).expect("convex"),
            // A triangle: p2 = p3.
            Chart::bilinear([QUAD[0], QUAD[1], QUAD[2], QUAD[2]]).expect("a triangle"),
        ]
    }

    fn unit_interval() -> impl Strategy<Value = f64> {
        0.001..0.999f64
    }

    proptest! {
        #[test]
        fn to_uv_inverts_to_plane(u in unit_interval(), v in unit_interval()) {
            for chart in charts() {
                let back = chart.to_uv(chart.to_plane(DVec2::new(u, v)));
                // Near a triangle's collapsed corner u is ill-conditioned like 1/(1 − v).
                prop_assert!((back - DVec2::new(u, v)).length() < 1e-12 / (1.0 - v), "{chart:?}");
            }
        }

        #[test]
        fn jacobian_is_the_derivative(u in unit_interval(), v in unit_interval()) {
            const H: f64 = 1e-5;
            for chart in charts() {
                let d = |a: f64, b: f64| {
                    let at = |s: f64| chart.to_plane(DVec2::new(u + s * a, v + s * b));
                    (at(H) - at(-H)) / (2.0 * H)
                };
                let expected = d(1.0, 0.0).perp_dot(d(0.0, 1.0));
                let jacobian = chart.jacobian(DVec2::new(u, v));
                prop_assert!((jacobian - expected).abs() < 1e-7, "{chart:?}: {jacobian}");
            }
        }

        /// Two halves cut by any line have the whole's area in (u, v), and a cell
        /// has exactly its own.
        #[test]
        fn areas_of_a_cut_cell_add_up(
            i in 0..10_u32, j in 0..10_u32, angle in 0.0..6.3f64, at in 0.0..1.0f64,
        ) {
            for chart in charts() {
                // A cut near a triangle's collapsed corner loses digits like 1/(1 − v).
                let collapsed = matches!(&chart, Chart::Bilinear { corners } if corners[2] == corners[3]);
                let tolerance = if collapsed { 1e-11 } else { 1e-13 };
                let corner = |a, b| chart.to_plane(DVec2::new(f64::from(i + a), f64::from(j + b)) / 10.0);
                let cell =
                    ConvexPolygon::new(&[corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)]);
                prop_assert!((chart.area(&cell) - 0.01).abs() < 1e-13, "{chart:?}");
                let (n, c) = (DVec2::from_angle(angle), corner(0, 1).lerp(corner(1, 0), at));
                let sum = chart.area(&cell.clipped(|x| n.dot(x - c)))
                    + chart.area(&cell.clipped(|x| -n.dot(x - c)));
                prop_assert!((sum - 0.01).abs() < tolerance, "{chart:?}: {sum}");
            }
        }
    }

    /// The bilinear area against ∬ du dv counted on a fine grid.
    #[test]
    fn bilinear_area_under_a_hyperbola_is_right() {
        let chart = Chart::bilinear(QUAD).expect("convex");
        let (n, c) = (DVec2::new(0.6, 0.8), DVec2::new(1.0, 0.7));
        let half = ConvexPolygon::new(&QUAD).clipped(|x| n.dot(x - c));
        const N: u32 = 2000;
        let centre = |i: u32| (f64::from(i) + 0.5) / f64::from(N);
        let inside = (0..N * N)
            .filter(|i| n.dot(chart.to_plane(DVec2::new(centre(i % N), centre(i / N))) - c) >= 0.0)
            .count();
        let counted = inside as f64 / f64::from(N * N);
        // Cells on the curve: at most 2 N of N².
        assert!((chart.area(&half) - counted).abs() < 2.0 / f64::from(N), "{counted}");
    }

    #[test]
    fn a_reflex_corner_is_named() {
        let dart = [DVec2::ZERO, DVec2::X, DVec2::new(0.2, 0.2), DVec2::Y];
        let error = Chart::perspective(dart).expect_err("a dart folds");
        assert!(matches!(error, Error::NotConvex { vertex: 2, .. }), "{error}");
        assert!(Chart::bilinear(dart).is_err(), "bilinear folds too");
    }
}
