//! Cases that break naive quadrature, by exact integration.

use super::Bench;
use crate::report::{Section, Table, Value, cpu_time};
use glam::DVec3;
use std::f64::consts::{FRAC_PI_4, PI};
use wrt_core::Polygon;
use wrt_core::transport::{CellRule, Exact, Support, TransportGeometry};

struct Case {
    name: String,
    source: [DVec3; 3],
    dest: [DVec3; 3],
    /// Mean incident radiance over the destination's (u, v, κ, λ): ¼ π F for a
    /// source of radiance 1.
    expected: f64,
}

/// Opposed unit squares at distance `c` (J. R. Howell, C-11).
fn facing(c: f64) -> f64 {
    let x = 1.0 / c;
    let s = 1.0 + x * x;
    // ln(s² / (1 + 2x²)) without cancellation at small x.
    let log = 0.5 * (x.powi(4) / (1.0 + 2.0 * x * x)).ln_1p();
    2.0 / (PI * x * x) * (log + 2.0 * x * s.sqrt() * (x / s.sqrt()).atan() - 2.0 * x * x.atan())
}

/// Perpendicular rectangles with a common edge of length 1: the destination
/// `w` deep, the source `h` high (J. R. Howell, C-14).
fn shared_edge(h: f64, w: f64) -> f64 {
    let (h2, w2) = (h * h, w * w);
    let s = (h2 + w2).sqrt();
    let logs = ((1.0 + w2) * (1.0 + h2) / (1.0 + w2 + h2)).ln()
        + w2 * (w2 * (1.0 + w2 + h2) / ((1.0 + w2) * (w2 + h2))).ln()
        + h2 * (h2 * (1.0 + h2 + w2) / ((1.0 + h2) * (h2 + w2))).ln();
    let arcs = w * (1.0 / w).atan() + h * (1.0 / h).atan() - s * (1.0 / s).atan();
    (arcs + 0.25 * logs) / (PI * w)
}

fn cases() -> Vec<Case> {
    let floor = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let ceiling = |c: f64| [DVec3::Z * c, DVec3::Y, DVec3::X];
    let wall = |h: f64| [DVec3::Y, DVec3::X, DVec3::Z * h];
    let case = |name: &str, source, dest, factor: f64| Case {
        name: name.to_owned(),
        source,
        dest,
        expected: factor * FRAC_PI_4,
    };
    let mut cases: Vec<Case> = [1e-3, 0.1, 1.0, 10.0, 100.0]
        .into_iter()
        .map(|c| case(&format!("facing squares, {c} apart"), ceiling(c), floor, facing(c)))
        .collect();
    for (h, w) in [(1.0, 1.0), (1e-3, 1.0), (100.0, 1.0), (1.0, 1e-3)] {
        let dest = [DVec3::Y * (1.0 - w), DVec3::X, DVec3::Y * w];
        let name = format!("shared edge, {h} high on {w} deep");
        cases.push(case(&name, wall(h), dest, shared_edge(h, w)));
    }
    let moved = |corners: [DVec3; 3], scale: f64, by: DVec3| {
        [corners[0] * scale + by, corners[1] * scale, corners[2] * scale]
    };
    let same = facing(1.0);
    for scale in [1e-6, 1e6] {
        let [source, dest] = [ceiling(1.0), floor].map(|c| moved(c, scale, DVec3::ZERO));
        cases.push(case(&format!("facing squares, {scale:e} m"), source, dest, same));
    }
    let [source, dest] = [ceiling(1.0), floor].map(|c| moved(c, 1.0, DVec3::splat(1e6)));
    cases.push(case("facing squares, 1000 km from the origin", source, dest, same));
    cases.push(case("coplanar", [2.0 * DVec3::X, DVec3::Y, DVec3::X], floor, 0.0));
    cases.push(case("back to back", [-1e-3 * DVec3::Z, DVec3::Y, DVec3::X], floor, 0.0));
    cases
}

pub(super) fn measure(bench: &Bench) -> anyhow::Result<Section> {
    let mut rows = Vec::new();
    for case in cases() {
        let polygon = |[origin, u, v]: [DVec3; 3]| Polygon::rectangle(origin, u, v);
        let geometry = TransportGeometry::new(polygon(case.source)?, polygon(case.dest)?);
        let whole = Support::isotropic(0, [0; 4]);
        for tolerance in [1e-3, 1e-6, 1e-10] {
            let rule = CellRule::Exact(Exact { tolerance });
            let (found, cost) = cpu_time(bench.runs(), || rule.radiance(&geometry, whole, whole));
            let error = if case.expected == 0.0 {
                found.mean.abs()
            } else {
                (found.mean / case.expected - 1.0).abs()
            };
            rows.push(vec![
                case.name.clone().into(),
                Value::Number(tolerance),
                Value::Number(error),
                Value::Number(found.relative_error()),
                Value::Count(found.evaluations),
                Value::Number(1e3 * cost.median),
            ]);
        }
    }
    Ok(Section {
        id: "hard",
        title: "Numerically hard cases",
        text: vec!["Mean radiance of a whole rectangle, by exact integration at three tolerances, against closed forms (J. R. Howell, A Catalog of Radiation Heat Transfer Configuration Factors, C-11 and C-14). Error and estimate are relative; absolute where nothing arrives. Below 10⁻¹³ or so it is the closed form that rounds.".to_owned()],
        tables: vec![Table {
            name: "hard",
            caption: "Asked tolerance, error reached, and error estimated.".to_owned(),
            head: vec!["case", "asked", "error", "estimate", "evaluations", "CPU time, ms"],
            rows,
        }],
        ..Section::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn form_factors_are_the_textbook_s() {
        assert!((facing(1.0) - 0.199_824_895_698_387_4).abs() < 1e-14, "{}", facing(1.0));
        let edge = shared_edge(1.0, 1.0);
        assert!((edge - 0.200_043_776_075_403_16).abs() < 1e-14, "{edge}");
        // Far apart they are points: F = 1 / (π c²), up to its own square.
        assert!((facing(100.0) * PI * 1e4 - 1.0).abs() < 1e-4, "{}", facing(100.0));
        // A_1 F_12 = A_2 F_21.
        let (there, back) = (shared_edge(0.3, 2.0) * 2.0, shared_edge(2.0, 0.3) * 0.3);
        assert!((there / back - 1.0).abs() < 1e-12, "{there} {back}");
    }
}
