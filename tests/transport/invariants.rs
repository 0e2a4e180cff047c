//! What holds of transport whatever the polygons are.

use glam::{DMat3, DQuat, DVec3};
use proptest::prelude::*;
use wrt_core::transport::{CellRule, Exact, Support, TransportGeometry};
use wrt_core::{Error, Polygon, Result};

fn exact(tolerance: f64) -> CellRule {
    CellRule::Exact(Exact { tolerance })
}

const WHOLE: Support =
    Support { levels: wrt_core::Levels { position: 0, direction: 0 }, m: [0; 4] };

/// The mean over `dest` of radiance 1 from `source`, and the error of that.
fn mean(source: &Polygon, dest: &Polygon, j: Support, k: Support) -> (f64, f64) {
    mean_within(1e-9, source, dest, j, k)
}

fn mean_within(
    tolerance: f64,
    source: &Polygon,
    dest: &Polygon,
    j: Support,
    k: Support,
) -> (f64, f64) {
    let geometry = TransportGeometry::new(source.clone(), dest.clone());
    let cell = exact(tolerance).radiance(&geometry, j, k);
    (cell.mean, cell.error)
}

fn vector() -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from)
}

/// A rectangle, a perspective or a bilinear quadrilateral, or a triangle.
fn polygon() -> impl Strategy<Value = Polygon> {
    let shape = (0..4_u8, 0.6..1.3f64, 0.6..1.3f64, 0.2..1.5f64);
    (shape, vector(), vector(), -1.0..1.0f64).prop_filter_map(
        "a convex quadrilateral",
        |((kind, a, b, size), at, axis, angle)| {
            let turn = DQuat::from_axis_angle(axis.try_normalize()?, 3.1 * angle);
            let corners = match kind {
                0 => [(0., 0.), (1., 0.), (1., a), (0., a)],
                1 | 2 => [(0., 0.), (1., 0.), (a, b), (0., 1.)],
                _ => [(0., 0.), (1., 0.), (a, b), (a, b)],
            };
            let verts = corners.map(|(x, y)| at + turn * (size * DVec3::new(x, y, 0.0)));
            match kind {
                0 => Polygon::rectilinear_quad(verts),
                1 => Polygon::perspective(verts),
                _ => Polygon::bilinear(verts),
            }
            .ok()
        },
    )
}

fn support() -> impl Strategy<Value = Support> {
    (0..3_u8).prop_flat_map(|l| {
        prop::array::uniform4(0..1_u16 << l).prop_map(move |m| Support::isotropic(l, m))
    })
}

fn children(parent: Support) -> impl Iterator<Item = Support> {
    (0..16).map(move |child| {
        let m = std::array::from_fn(|d| 2 * parent.m[d] + (child >> d & 1) as u16);
        Support::isotropic(parent.levels.position + 1, m)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// No part of space is lost or counted twice, at either end. A mean over the
    /// dest is the mean of the children's; the parts of a source add up.
    #[test]
    fn parts_sum_to_the_whole(
        source in polygon(), dest in polygon(), j in support(), k in support(),
    ) {
        let (whole, error) = mean(&source, &dest, j, k);
        let fraction = 0.25_f64.powi(i32::from(k.levels.direction));
        prop_assert!(whole >= 0.0 && error >= 0.0 && whole <= 1.0 + error, "{whole} {fraction}");
        let (mut parts, mut slack) = (0.0, error + 1e-12);
        for child in children(k) {
            let (part, error) = mean(&source, &dest, j, child);
            parts += part / 16.0;
            slack += error / 16.0;
        }
        prop_assert!((parts - whole).abs() <= slack, "dest: {parts} {whole} {slack:e}");
        let (mut parts, mut slack) = (0.0, error + 1e-12);
        for child in children(j) {
            let (part, error) = mean(&source, &dest, child, k);
            parts += part;
            slack += error;
        }
        prop_assert!((parts - whole).abs() <= slack, "source: {parts} {whole} {slack:e}");
    }

    /// A loose tolerance may stop early, but says no less than what it left.
    #[test]
    fn estimates_hold_at_any_tolerance(
        source in polygon(), dest in polygon(), j in support(), k in support(),
        digits in 1.0..9.0f64,
    ) {
        let (best, error) = mean_within(1e-11, &source, &dest, j, k);
        let tolerance = 10.0_f64.powf(-digits);
        let (found, estimate) = mean_within(tolerance, &source, &dest, j, k);
        prop_assert!(
            (found - best).abs() <= estimate + error,
            "{tolerance:e}: {found} {best}, {estimate:e} claimed"
        );
    }

    /// Flux is one number at both ends, ∬ cosθ dω dA of the rays between two cells.
    /// In (u, v, κ, λ) that is 4 W H 16^−l_k × mean, where the dest's chart has the
    /// constant Jacobian W H. Turned round, a ray's direction towards its source is
    /// what its direction of travel was, so that each end keeps its cell:
    ///
    /// ```text
    /// W_d H_d 16^−l_k mean(j → k) = W_s H_s 16^−l_j mean(k → j)
    /// ```
    #[test]
    fn flux_is_the_same_from_either_end(
        at in vector(), turn in vector(), angle in -3.0..3.0f64,
        j in support(), k in support(),
    ) {
        let Some(axis) = turn.try_normalize() else { return Ok(()) };
        let turn = DQuat::from_axis_angle(axis, angle);
        let [u, v] = [0.7 * DVec3::X, 0.9 * DVec3::Y].map(|edge| turn * edge);
        let (one, other) = (
            Polygon::rectangle(at + DVec3::Z, u, v).expect("a rectangle"),
            Polygon::rectangle(DVec3::ZERO, DVec3::X, 1.2 * DVec3::Y).expect("a rectangle"),
        );
        let flux = |source: &Polygon, dest: &Polygon, j: Support, k: Support| {
            let (mean, error) = mean(source, dest, j, k);
            let size = dest.area() / (k.scale() * k.scale());
            (mean * size, error * size)
        };
        let (there, e) = flux(&one, &other, j, k);
        let (back, f) = flux(&other, &one, k, j);
        prop_assert!((there - back).abs() <= e + f + 1e-12, "{there} {back}");
    }

    /// Moving, turning and scaling the scene as one leaves every mean as it was.
    #[test]
    fn rigid_motion_and_scale_change_nothing(
        source in polygon(), dest in polygon(), j in support(), k in support(),
        by in vector(), axis in vector(), angle in -3.0..3.0f64, scale in -6.0..6.0f64,
    ) {
        let Some(axis) = axis.try_normalize() else { return Ok(()) };
        let turn = DMat3::from_quat(DQuat::from_axis_angle(axis, angle));
        let moved = |polygon: &Polygon| -> Result<Polygon> {
            let v = polygon.vertices();
            let v = [v[0], v[1], v[2], v[3]].map(|p| (turn * p + by) * 10.0_f64.powf(scale));
            match polygon.chart() {
                wrt_core::Chart::Rectilinear { .. } => Polygon::rectilinear_quad(v),
                wrt_core::Chart::Perspective { .. } => Polygon::perspective(v),
                wrt_core::Chart::Bilinear { .. } => Polygon::bilinear(v),
            }
        };
        // Rounding may turn a collapsed corner's convexity test.
        let (Ok(s), Ok(d)) = (moved(&source), moved(&dest)) else { return Ok(()) };
        let (before, e) = mean(&source, &dest, j, k);
        let (after, f) = mean(&s, &d, j, k);
        // Vertices have moved by rounding, too.
        prop_assert!((before - after).abs() <= e + f + 1e-11, "{before} {after}");
    }
}

/// Σ_k T_jk = A_s / A_d for a cell j whose rays all land, k over all cells of its
/// level: what leaves arrives, once. To the error estimates, and these to 10⁻¹⁰.
#[test]
fn all_that_leaves_a_cell_arrives() {
    let dest = Polygon::rectangle(DVec3::ZERO, 2.0 * DVec3::X, 3.0 * DVec3::Y).expect("a square");
    let above = |height, tilt| {
        let turn = DQuat::from_rotation_x(tilt) * DQuat::from_rotation_z(0.3);
        let at = DVec3::new(0.8, 1.3, height);
        Polygon::rectangle(at, turn * (0.5 * DVec3::Y), turn * (0.4 * DVec3::X)).expect("a square")
    };
    for (source, j) in [
        (above(0.3, 0.0), Support::isotropic(2, [0, 1, 1, 1])),
        (above(0.3, 0.2), Support::isotropic(2, [3, 0, 1, 2])),
        (above(0.2, -0.4), Support::isotropic(2, [1, 2, 2, 2])),
    ] {
        let geometry = TransportGeometry::new(source, dest.clone());
        let level = j.levels.position;
        let (mut sum, mut slack) = (0.0, 0.0);
        for i in 0..1_u32 << (4 * level) {
            let m = [0, 1, 2, 3].map(|d| (i >> (d * level) & ((1 << level) - 1)) as u16);
            let cell = exact(1e-12).radiance(&geometry, j, Support::isotropic(level, m));
            sum += cell.mean;
            slack += cell.error;
        }
        let expected = geometry.source().area() / dest.area();
        let [low, high] = j.cosines().map(|c| (0.5 * (c + 1.0)).to_array());
        let expected = expected * wrt_core::udc_fraction(low, high);
        assert!((sum - expected).abs() <= slack + 1e-14, "{sum} {expected} {slack:e}");
        assert!(slack <= 1e-10 * expected, "{slack:e} of {expected}");
    }
}

/// Cells of 10⁻⁵ of a polygon, by their sum.
#[test]
fn parts_sum_to_the_whole_at_the_deepest_levels() {
    let dest = Polygon::rectangle(DVec3::ZERO, DVec3::X, DVec3::Y).expect("a square");
    let verts = [[0.3, 0.9, 0.4], [0.9, 0.7, 0.5], [1.05, 0.95, 1.3], [0.45, 1.15, 1.2]];
    let source = Polygon::bilinear(verts.map(DVec3::from)).expect("a parallelogram");
    for level in [9, 15] {
        let whole = Support::isotropic(0, [0; 4]);
        // A direction that reaches the dest from this part of the source.
        let at = |x: f64| (x * f64::from(1_u32 << level)) as u16;
        let j = Support::isotropic(level, [0.29, 0.68, 0.51, 0.024].map(at));
        let (one, error) = mean(&source, &dest, j, whole);
        assert!(one > 0.0 && error < 1e-8 * one, "level {level}: {one:e} {error:e}");
        let sum: f64 = children(j).map(|j| mean(&source, &dest, j, whole).0).sum();
        assert!((sum / one - 1.0).abs() < 1e-8, "level {level}: {sum:e} {one:e}");
        let sum: f64 = children(whole).map(|k| mean(&source, &dest, j, k).0 / 16.0).sum();
        assert!((sum / one - 1.0).abs() < 1e-8, "level {level}, dest: {sum:e} {one:e}");
    }
}

/// In a closed box the means at each face of what leaves all others have E = π:
/// Σ E/4 = π/4, the area of the UDC.
#[test]
fn every_face_of_a_closed_box_sees_light_from_everywhere() {
    let size = DVec3::new(1.0, 2.0, 0.5);
    let rectangle = |o: DVec3, u: DVec3, v: DVec3| {
        Polygon::rectangle(o * size, u * size, v * size).expect("a rectangle")
    };
    use DVec3 as V;
    let faces = [
        rectangle(V::ZERO, V::X, V::Y),
        rectangle(V::Z, V::Y, V::X),
        rectangle(V::ZERO, V::Z, V::X),
        rectangle(V::Y, V::X, V::Z),
        rectangle(V::ZERO, V::Y, V::Z),
        rectangle(V::X, V::Z, V::Y),
    ];
    for (i, dest) in faces.iter().enumerate() {
        let others = faces.iter().enumerate().filter(|&(j, _)| j != i);
        let sum: f64 = others.map(|(_, source)| mean(source, dest, WHOLE, WHOLE).0).sum();
        assert!((sum - std::f64::consts::FRAC_PI_4).abs() < 1e-9, "face {i}: {sum}");
    }
}

#[test]
fn polygons_that_are_none_are_typed_errors() {
    let quad = |v: [[f64; 3]; 4]| v.map(DVec3::from);
    let nan = quad([[0., 0., 0.], [1., 0., 0.], [1., f64::NAN, 0.], [0., 1., 0.]]);
    let line = quad([[0., 0., 0.], [1., 0., 0.], [2., 0., 0.], [3., 0., 0.]]);
    let bent = quad([[0., 0., 0.], [1., 0., 0.], [1., 1., 0.1], [0., 1., 0.]]);
    let bow = quad([[0., 0., 0.], [1., 1., 0.], [1., 0., 0.], [0., 1.5, 0.]]);
    let no_edge = quad([[0., 0., 0.], [0., 0., 0.], [1., 1., 0.], [0., 1., 0.]]);
    for make in [Polygon::rectilinear_quad, Polygon::perspective, Polygon::bilinear] {
        assert!(matches!(make(nan), Err(Error::NotFinite { vertex: 2 })));
        assert!(matches!(make(line), Err(Error::ZeroArea)));
        assert!(matches!(make(bent), Err(Error::NotPlanar { .. })));
        assert!(matches!(make(bow), Err(Error::SelfCrossing { .. })));
        assert!(matches!(make(no_edge), Err(Error::ZeroArea)));
    }
    let triangle = quad([[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 1., 0.]]);
    assert!(matches!(Polygon::perspective(triangle), Err(Error::NotConvex { .. })));
}
