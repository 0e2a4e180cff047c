//! What geometry alone says of a coefficient, before any quadrature
//! (`tg_oracle`, §7.2.4.1).

use super::Pair;
use crate::udc_fraction;
use glam::{DVec2, DVec3};

/// What the oracle knows of T_jk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// No ray of the destination cell comes from the source cell.
    Zero,
    /// Every ray does: T_jk is the volume of the destination's support, scaled.
    Whole(f64),
    /// Only quadrature can tell.
    Unknown,
}

/// Asks whether the pair's cells see each other not at all or in full.
///
/// Departs from §7.2.4.1, which projects the 16 corners of the support and hopes
/// that they bound it (§7.1.3.2 says that they need not). Here each test is a
/// plane through a corner of one cell and an edge of the other, whose side the
/// direction μ is on: linear in μ, hence bounded over a box around the direction
/// cell by interval arithmetic. An answer other than
/// [`Unknown`](Verdict::Unknown) is therefore proven, up to rounding.
#[must_use]
pub fn oracle(pair: &Pair<'_>) -> Verdict {
    let [low, high] = pair.dest_box();
    let nearest = DVec2::ZERO.clamp(low, high);
    if nearest.length_squared() >= 1.0 || outside_udc(pair.source_box()) {
        return Verdict::Zero;
    }
    if pair.sources().is_empty() || pair.dests().is_empty() {
        return Verdict::Zero;
    }
    let directions = Directions::over([low, high]);
    let leaving = leaving(pair, &directions);
    if leaving == Sees::Nothing {
        return Verdict::Zero;
    }
    let mut all_whole = leaving == Sees::All && inside_udc([low, high]);
    let mut none = true;
    for dest in pair.dests() {
        let mut covered = false;
        for source in pair.sources() {
            match overlap(source, dest.vertices(), &directions) {
                Sees::Nothing => {}
                Sees::All => (none, covered) = (false, true),
                Sees::Some => none = false,
            }
        }
        all_whole &= covered;
    }
    if none {
        return Verdict::Zero;
    }
    if !all_whole {
        return Verdict::Unknown;
    }
    let area: f64 = pair.dests().iter().map(|d| pair.geometry().dest().chart().area(d)).sum();
    let size = 0.25 * (high - low).element_product();
    Verdict::Whole(pair.scale() * area * size)
}

#[derive(Clone, Copy, PartialEq)]
enum Sees {
    Nothing,
    Some,
    All,
}

/// A box around the unit vectors of a direction cell.
struct Directions {
    low: DVec3,
    high: DVec3,
}

impl Directions {
    fn over([low, high]: [DVec2; 2]) -> Self {
        let nearest = DVec2::ZERO.clamp(low, high);
        let farthest = low.abs().max(high.abs());
        let height = |mu: DVec2| (1.0 - mu.length_squared()).max(0.0).sqrt();
        Self { low: low.extend(height(farthest)), high: high.extend(height(nearest)) }
    }

    /// The least and greatest n·μ.
    fn range(&self, n: DVec3) -> (f64, f64) {
        let (a, b) = (n * self.low, n * self.high);
        (a.min(b).element_sum(), a.max(b).element_sum())
    }
}

fn outside_udc([low, high]: [DVec2; 2]) -> bool {
    DVec2::ZERO.clamp(low, high).length_squared() >= 1.0
}

fn inside_udc([low, high]: [DVec2; 2]) -> bool {
    let q = |mu: DVec2| [0.5 * (mu.x + 1.0), 0.5 * (mu.y + 1.0)];
    low.abs().max(high.abs()).length_squared() <= 1.0 && udc_fraction(q(low), q(high)) > 0.0
}

/// Whether light from the destination's directions leaves within the source's
/// direction cell, on its front.
fn leaving(pair: &Pair<'_>, directions: &Directions) -> Sees {
    let [x, y, n] = pair.geometry().source_axes();
    let [low, high] = pair.source_box();
    let (least, most) = directions.range(-n);
    if most <= 0.0 {
        return Sees::Nothing;
    }
    let mut all = least > 0.0;
    for (axis, low, high) in [(x, low.x, high.x), (y, low.y, high.y)] {
        let (least, most) = directions.range(-axis);
        if most < low || least >= high {
            return Sees::Nothing;
        }
        // The cell at the rim is closed: cosines do not exceed 1.
        all &= least >= low && (most < high || high == 1.0);
    }
    if all { Sees::All } else { Sees::Some }
}

/// Whether the source piece (edges with start and vector, counter-clockwise from
/// its front) covers the destination piece along the directions.
fn overlap(source: &[(DVec3, DVec3)], dest: &[DVec2], directions: &Directions) -> Sees {
    let mut all = true;
    // Along μ a point p lies inside the edge (s, e) where (e × μ)·(p − s) ≥ 0,
    // that is μ·((p − s) × e) ≥ 0.
    for &(start, edge) in source {
        let mut outside = true;
        for &p in dest {
            let (least, most) = directions.range((p.extend(0.0) - start).cross(edge));
            outside &= most <= 0.0;
            all &= least >= 0.0;
        }
        if outside {
            return Sees::Nothing;
        }
    }
    // A source corner s lands inside the destination's edge (q, d) where
    // ẑ·(d × (s − q − σμ)) ≥ 0 with σ = s_z / μz: times μz > 0 that is linear.
    for (i, &q) in dest.iter().enumerate() {
        let d = dest[(i + 1) % dest.len()] - q;
        let outside = source.iter().all(|&(s, _)| {
            let n = DVec3::new(s.z * d.y, -s.z * d.x, d.perp_dot(s.truncate() - q));
            directions.range(n).1 <= 0.0
        });
        if outside {
            return Sees::Nothing;
        }
    }
    if all { Sees::All } else { Sees::Some }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Polygon;
    use crate::transport::{Exact, Integrator, Support, TransportGeometry};
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = DVec3> {
        (-1.0..1.0f64, -1.0..1.0f64, -0.5..1.5f64).prop_map(|(x, y, z)| DVec3::new(x, y, z))
    }

    fn support() -> impl Strategy<Value = Support> {
        (0..4_u8).prop_flat_map(|l| {
            prop::array::uniform4(0..1_u16 << l).prop_map(move |m| Support::isotropic(l, m))
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]
        /// Whatever the oracle answers, exact integration agrees.
        #[test]
        fn answers_agree_with_exact_integration(
            at in point(), u in point(), v in point(), j in support(), k in support(),
        ) {
            let dest = Polygon::rectangle(DVec3::ZERO, DVec3::X, DVec3::Y).expect("a square");
            let v = v - u * (u.dot(v) / u.length_squared());
            let Ok(source) = Polygon::rectangle(at, u, v) else { return Ok(()) };
            let geometry = TransportGeometry::new(source, dest);
            let pair = Pair::new(&geometry, j, k);
            let exact = || Exact { tolerance: 1e-9 }.integrate(&pair).value;
            let most = pair.scale() / (k.scale() * k.scale());
            match oracle(&pair) {
                Verdict::Zero => prop_assert!(exact() <= 1e-12 * most, "{}", exact()),
                Verdict::Whole(t) => prop_assert!((exact() / t - 1.0).abs() < 1e-9),
                Verdict::Unknown => {}
            }
        }
    }

    /// A repeated corner is an edge that every direction is on, and no reason to be
    /// blind: this triangle once was.
    #[test]
    fn a_triangle_with_a_repeated_corner_is_seen() {
        let dest = Polygon::rectangle(DVec3::ZERO, DVec3::X, DVec3::Y).expect("a square");
        let (a, b, c) = (DVec3::Z, DVec3::new(0., 1., 1.), DVec3::new(1., 1., 1.));
        let whole = Support::isotropic(0, [0; 4]);
        for verts in [[a, b, c, c], [a, b, b, c], [a, b, c, a]] {
            for triangle in [Polygon::bilinear(verts), Polygon::rectilinear_quad(verts)] {
                let geometry = TransportGeometry::new(triangle.expect("a triangle"), dest.clone());
                let pair = Pair::new(&geometry, whole, whole);
                assert_eq!(oracle(&pair), Verdict::Unknown, "{verts:?}");
                assert!(Exact::default().integrate(&pair).value > 0.05, "{verts:?}");
            }
        }
    }

    /// A small cell right under a large source is seen whole, one that looks the
    /// other way not at all.
    #[test]
    fn both_answers_are_given() {
        let dest = Polygon::rectangle(DVec3::ZERO, DVec3::X, DVec3::Y).expect("a square");
        let sky = Polygon::rectangle(DVec3::new(-9., 9., 1.), DVec3::X * 20., DVec3::Y * -18.);
        let geometry = TransportGeometry::new(sky.expect("a rectangle"), dest);
        let source = Support::isotropic(0, [0; 4]);
        let ask = |m| oracle(&Pair::new(&geometry, source, Support::isotropic(3, m)));
        assert!(matches!(ask([3, 3, 4, 4]), Verdict::Whole(_)), "{:?}", ask([3, 3, 4, 4]));
        assert_eq!(ask([3, 3, 0, 0]), Verdict::Zero, "outside the UDC");
        // −x directions from the left half reach past the source's edge at x = −9.
        assert_eq!(ask([0, 3, 0, 4]), Verdict::Unknown);
    }
}
