//! Geometries that break naive quadrature, each with a value from elsewhere.
//! `scenes/hard_cases.json` holds them for `tracer transport`; with UPDATE_GOLDEN=1
//! it is written anew.

use super::reference::{CellOf, Map, Quad, by_direction, by_position};
use crate::support::{scene, succeed};
use glam::DVec3;
use serde_json::{Value, json};
use wrt_core::transport::{CellRadiance, CellRule, Exact, Support, TransportGeometry};

/// Where the expected mean comes from.
enum Expected {
    Value(f64),
    /// Lambert's formula over positions.
    Position,
    /// Projected outlines over directions.
    Direction,
}

struct Case {
    name: &'static str,
    source: Quad,
    j: CellOf,
    dest: Quad,
    k: CellOf,
    expected: Expected,
}

fn quad(map: Map, verts: [[f64; 3]; 4]) -> Quad {
    Quad { verts: verts.map(DVec3::from), map }
}

fn rect(origin: [f64; 3], u: [f64; 3], v: [f64; 3]) -> Quad {
    let [o, u, v] = [origin, u, v].map(DVec3::from);
    Quad { verts: [o, o + u, o + u + v, o + v], map: Map::Rect }
}

fn cell(level: u8, m: [u16; 4]) -> CellOf {
    CellOf { level, m }
}

const X: [f64; 3] = [1., 0., 0.];
const Y: [f64; 3] = [0., 1., 0.];
const Z: [f64; 3] = [0., 0., 1.];

fn floor() -> Quad {
    rect([0.; 3], X, Y)
}

fn moved(quad: Quad, scale: f64, by: DVec3) -> Quad {
    Quad { verts: quad.verts.map(|v| v * scale + by), ..quad }
}

impl Case {
    fn new(name: &'static str, source: Quad, dest: Quad, expected: Expected) -> Self {
        Self { name, source, j: CellOf::WHOLE, dest, k: CellOf::WHOLE, expected }
    }

    fn cells(self, j: CellOf, k: CellOf) -> Self {
        Self { j, k, ..self }
    }

    fn moved(self, name: &'static str, scale: f64, by: [f64; 3]) -> Self {
        let by = DVec3::from(by);
        let expected = Expected::Value(self.expect(self.found().mean));
        let (source, dest) = (moved(self.source, scale, by), moved(self.dest, scale, by));
        Self { name, source, dest, expected, ..self }
    }

    /// The mean that is to be found; the reference's tolerance is 1e-9, or 3e-8 over
    /// directions.
    fn expect(&self, guess: f64) -> f64 {
        // The guess only sets what "relative" means.
        let tolerance = 1e-9 * guess.max(1e-16);
        match self.expected {
            Expected::Value(value) => value,
            Expected::Position => {
                by_position(&self.source, &self.j, &self.dest, &self.k, tolerance)
            }
            Expected::Direction => {
                by_direction(&self.source, &self.j, &self.dest, &self.k, 30.0 * tolerance)
            }
        }
    }

    /// As `tracer transport` reads it, with the value from elsewhere and its origin.
    fn to_json(&self, expected: f64) -> Value {
        let quad = |quad: &Quad| {
            let map = match quad.map {
                Map::Rect => "rect",
                Map::Perspective => "perspective",
                Map::Bilinear => "bilinear",
            };
            json!({ "verts": quad.verts.map(|v| v.to_array()), "map": map })
        };
        let origin = match self.expected {
            Expected::Value(_) => "closed form, or the same cell elsewhere",
            Expected::Position => "Lambert's formula, integrated over positions",
            Expected::Direction => "projected outlines, integrated over directions",
        };
        json!({
            "name": self.name,
            "source": quad(&self.source),
            "dest": quad(&self.dest),
            "emission": { "type": "cell", "level": self.j.level, "m": self.j.m },
            "dest_level": self.k.level,
            "k": [self.k.m],
            "expected": expected,
            "expected_from": origin,
        })
    }

    fn found(&self) -> CellRadiance {
        let polygon = |quad: &Quad| quad.polygon().unwrap_or_else(|e| panic!("{}: {e}", self.name));
        let geometry = TransportGeometry::new(polygon(&self.source), polygon(&self.dest));
        let support = |c: &CellOf| Support::isotropic(c.level, c.m);
        let rule = CellRule::Exact(Exact { tolerance: 1e-10 });
        rule.radiance(&geometry, support(&self.j), support(&self.k))
    }
}

/// The form factor of perpendicular unit squares that share an edge (Howell C-14).
fn corner_form_factor() -> f64 {
    let s = 2.0_f64.sqrt();
    (2.0 * 1.0_f64.atan() - s * (1.0 / s).atan() + 0.25 * (0.75_f64).ln()) / std::f64::consts::PI
}

fn cases() -> Vec<Case> {
    use Expected::{Direction, Position, Value};
    let wall = rect([0., 1., 0.], X, Z);
    let ceiling = rect([0., 0., 1.], Y, X);
    let tilted = rect([0.3, 0.9, 0.4], [0.6, -0.2, 0.1], [0.15, 0.25, 0.8]);
    let near = quad(
        Map::Perspective,
        [[-0.3, 1.1, 0.3], [1.2, 1.4, 0.3], [0.9, 0.4, 0.3], [0.1, -0.5, 0.3]],
    );
    let kite = |map| quad(map, [[0., 0., 0.], [1.3, 0.1, 0.], [1.0, 0.9, 0.], [0.2, 1.2, 0.]]);
    let triangle = quad(Map::Bilinear, [[0., 0., 0.], [1., 0., 0.], [0.4, 1., 0.], [0.4, 1., 0.]]);
    let sqrt = 0.5_f64.sqrt();
    vec![
        Case::new("facing squares", ceiling, floor(), Position),
        Case::new(
            "shared edge",
            wall,
            floor(),
            Value(corner_form_factor() * std::f64::consts::FRAC_PI_4),
        ),
        Case::new("shared edge, direction cells", wall, floor(), Direction)
            .cells(cell(1, [0, 0, 1, 0]), cell(1, [0, 1, 0, 1])),
        Case::new(
            "shared edge at 5 degrees",
            rect([0., 1., 0.], X, [0., -0.996_194_698_091_745_5, 0.087_155_742_747_658_18]),
            floor(),
            Position,
        ),
        Case::new("shared corner", rect([1., 1., 0.], [1., 0., 0.], Z), floor(), Position),
        Case::new(
            "shared corner, tilted",
            rect([1., 1., 0.], [0.6, 0.8, 0.], [-0.48, 0.36, 0.8]),
            floor(),
            Position,
        ),
        Case::new("coplanar", rect([2., 0., 0.], Y, X), floor(), Value(0.)),
        Case::new("coplanar, overlapping", rect([0.5, 0., 0.], Y, X), floor(), Value(0.)),
        Case::new("back to back", rect([0., 0., -1e-3], Y, X), floor(), Value(0.)),
        Case::new("facing away", rect([0., 0., 1.], X, Y), floor(), Value(0.)),
        Case::new("crossing", rect([0., 0.5, -0.5], X, Z), floor(), Position),
        Case::new(
            "crossing obliquely",
            rect([0.1, 0.8, -0.4], [0.9, -0.3, 0.1], [0.1, -0.2, 1.1]),
            floor(),
            Position,
        ),
        Case::new(
            "crossing obliquely, direction cells",
            rect([0.1, 0.8, -0.4], [0.9, -0.3, 0.1], [0.1, -0.2, 1.1]),
            floor(),
            Direction,
        )
        .cells(cell(1, [0, 1, 1, 0]), cell(2, [1, 1, 2, 3])),
        Case::new(
            "source partly behind",
            rect([-0.5, 2., -3.], [2., 0., 0.], [0., 0.5, 4.]),
            floor(),
            Position,
        ),
        Case::new(
            "dest partly behind",
            rect([-1., 0.7, 0.2], [3., -0.2, 0.], [0., 0.1, 1.]),
            floor(),
            Position,
        ),
        Case::new("grazing at the dest", rect([0., 100., 0.], X, [0., 0., 0.1]), floor(), Position),
        Case::new("grazing at both", rect([3., 0., 0.01], Y, X), floor(), Position),
        Case::new(
            "grazing at the source",
            floor(),
            rect([0., 100., 0.], X, [0., 0., 0.1]),
            Position,
        ),
        Case::new("tilted, direction cells", tilted, floor(), Direction)
            .cells(cell(1, [1, 0, 0, 0]), cell(2, [0, 1, 2, 2])),
        Case::new(
            "cell cut by the rim",
            rect([-50., 30., 0.], [100., 0., 0.], [0., 0., 60.]),
            floor(),
            Direction,
        )
        .cells(CellOf::WHOLE, cell(3, [2, 3, 2, 7])),
        Case::new(
            "cell cut by the rim, in a corner",
            rect([3., 3., -0.5], [sqrt, -sqrt, 0.], Z),
            floor(),
            Direction,
        )
        .cells(CellOf::WHOLE, cell(3, [4, 4, 6, 6])),
        Case::new("near the rim, source cell too", tilted, floor(), Direction)
            .cells(cell(2, [0, 0, 1, 0]), cell(2, [0, 0, 2, 3])),
        Case::new(
            "sliver source",
            rect([0.2, 0.7, 0.5], [1., 0., 0.], [0., -1e-6, 0.]),
            floor(),
            Position,
        ),
        Case::new(
            "sliver source, oblique",
            rect([0.2, 0.7, 0.5], [0.6, 0.7, 0.], [0.7e-6, -0.6e-6, 0.2e-6]),
            floor(),
            Position,
        ),
        Case::new("sliver dest", tilted, rect([0., 0., 0.], X, [0., 1e-6, 0.]), Position),
        Case::new(
            "two slivers",
            rect([0.2, 0.7, 0.5], [0.6, 0.7, 0.], [0.7e-6, -0.6e-6, 0.2e-6]),
            rect([0., 0., 0.], [0.8, 0.6, 0.], [-0.6e-6, 0.8e-6, 0.]),
            Position,
        ),
        Case::new(
            "sliver, direction cells",
            rect([0.2, 0.7, 0.5], [0.6, 0.7, 0.], [0.7e-6, -0.6e-6, 0.2e-6]),
            floor(),
            Direction,
        )
        .cells(cell(1, [0, 1, 0, 1]), cell(1, [0, 1, 1, 1])),
        Case::new("perspective dest", tilted, kite(Map::Perspective), Position),
        Case::new("perspective both", near, kite(Map::Perspective), Position),
        Case::new(
            "near-degenerate perspective",
            near,
            quad(
                Map::Perspective,
                [[0., 0., 0.], [1., 0., 0.], [0.500_001, 0.5, 0.], [0., 1., 0.]],
            ),
            Position,
        ),
        Case::new(
            "perspective, corner nearly doubled",
            near,
            quad(
                Map::Perspective,
                [[0., 0., 0.], [1., 0., 0.], [0.4, 1., 0.], [0.399_999, 1., 0.]],
            ),
            Position,
        ),
        Case::new("bilinear dest", tilted, kite(Map::Bilinear), Position),
        Case::new("triangle dest, v2 = v3", tilted, triangle, Position),
        Case::new(
            "triangle dest, v1 = v2",
            tilted,
            quad(Map::Bilinear, [[0., 0., 0.], [1., 0., 0.], [1., 0., 0.], [0.4, 1., 0.]]),
            Position,
        ),
        Case::new(
            "triangle dest, v3 = v0",
            tilted,
            quad(Map::Bilinear, [[0., 0., 0.], [1., 0., 0.], [0.4, 1., 0.], [0., 0., 0.]]),
            Position,
        ),
        Case::new(
            "triangle source and dest, rect",
            quad(Map::Rect, [[0., 0., 1.], [0., 1., 1.2], [1., 1., 1.2], [0., 0., 1.]]),
            quad(Map::Rect, [[0., 0., 0.], [1., 0., 0.], [0.4, 1., 0.], [0., 0., 0.]]),
            Position,
        ),
        Case::new(
            "bilinear source cell",
            quad(Map::Bilinear, [[0., 0., 1.], [0., 1., 1.], [1.3, 0.9, 1.], [0.8, 0.1, 1.]]),
            floor(),
            Position,
        ),
        Case::new(
            "source a millionth of the dest",
            rect([0.4, 0.7, 0.6], [0.6e-3, 0., 0.8e-3], [0., -1e-3, 0.]),
            floor(),
            Position,
        ),
        Case::new("scaled by 1e-6", tilted, floor(), Direction)
            .cells(cell(1, [1, 0, 0, 0]), cell(2, [0, 1, 2, 2]))
            .moved("scale 1e-6", 1e-6, [0.; 3]),
        Case::new("scaled by 1e6", tilted, floor(), Direction)
            .cells(cell(1, [1, 0, 0, 0]), cell(2, [0, 1, 2, 2]))
            .moved("scale 1e6", 1e6, [0.; 3]),
        Case::new(
            "far scene",
            rect([0.25, 0.875, 0.5], [0.5, -0.25, 0.125], [0.125, 0.25, 0.75]),
            floor(),
            Position,
        )
        .moved("1e6 from the origin", 1.0, [1e6, -1e6, 1e6]),
        Case::new(
            "far scene, cells",
            rect([0.25, 0.875, 0.5], [0.5, -0.25, 0.], [0.125, 0.25, 0.75]),
            floor(),
            Direction,
        )
        .cells(cell(1, [1, 0, 0, 0]), cell(2, [0, 1, 2, 2]))
        .moved("1e6 from the origin, cells", 1.0, [1e6, -1e6, 1e6]),
    ]
}

#[test]
fn hard_case_table() {
    use rayon::prelude::*;
    let cases = cases();
    let rows: Vec<_> = cases
        .par_iter()
        .map(|case| {
            let start = std::time::Instant::now();
            let found = case.found();
            let took = start.elapsed();
            let start = std::time::Instant::now();
            let expected = case.expect(found.mean);
            (case, found, expected, took, start.elapsed())
        })
        .collect();
    println!(
        "{:40} {:>22} {:>22} {:>8} {:>8} {:>9}",
        "case", "expected", "found", "error", "estimate", "points"
    );
    let mut bad = Vec::new();
    for (case, found, expected, took, reference) in rows {
        let error = if expected == 0.0 { found.mean } else { (found.mean / expected - 1.0).abs() };
        let estimate = found.relative_error();
        println!(
            "{:40} {expected:22.16e} {:22.16e} {error:8.1e} {estimate:8.1e} {:9} {took:10.1?} {reference:10.1?}",
            case.name, found.mean, found.evaluations
        );
        // The reference itself is good to 1e-9, or 3e-8 over directions, and worse
        // where its own areas are slivers.
        if !(error <= 1e-6 && error <= estimate + 1e-7) {
            bad.push(case.name);
        }
    }
    assert!(bad.is_empty(), "{bad:?}");
}

/// What the file holds is these cases, each with what the reference says.
#[test]
fn the_file_of_hard_cases_is_these() {
    use rayon::prelude::*;
    let path = scene("hard_cases.json");
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        // A line a case.
        let line = |case: &Case| case.to_json(case.expect(case.found().mean)).to_string();
        let lines: Vec<String> = cases().par_iter().map(line).collect();
        let text = format!("{{\"cases\": [\n{}\n]}}\n", lines.join(",\n"));
        std::fs::write(&path, text).expect("a writable file");
    }
    let text = std::fs::read_to_string(&path).expect("scenes/hard_cases.json");
    let file: Value = serde_json::from_str(&text).expect("JSON");
    let there: Vec<Value> = file["cases"].as_array().expect("cases").clone();
    let here: Vec<Value> = cases()
        .iter()
        .zip(&there)
        .map(|(case, there)| case.to_json(there["expected"].as_f64().expect("a number")))
        .collect();
    assert_eq!(here, there, "run with UPDATE_GOLDEN=1 after a change of the cases");
    assert_eq!(cases().len(), there.len());
}

/// The program, asked for more and more digits, reaches them or says that it did not.
#[test]
fn the_program_reaches_the_hard_cases_or_says_so() {
    let path = scene("hard_cases.json");
    let text = std::fs::read_to_string(&path).expect("scenes/hard_cases.json");
    let file: Value = serde_json::from_str(&text).expect("JSON");
    let expected = file["cases"].as_array().expect("cases");
    for tolerance in ["1e-3", "1e-6", "1e-9"] {
        let out = succeed(&["transport", &path, "--tolerance", tolerance]);
        let out: Value = serde_json::from_str(&out).expect("JSON");
        for (found, expected) in out["cases"].as_array().expect("cases").iter().zip(expected) {
            let name = &expected["name"];
            assert_eq!(&found["name"], name);
            let cell = &found["cells"][0];
            let estimate = cell["rel_err_est"].as_f64().expect("an estimate");
            let found = cell["rgb"][0].as_f64().expect("a number");
            let expected = expected["expected"].as_f64().expect("a number");
            let error = if expected == 0.0 { found } else { (found / expected - 1.0).abs() };
            // The reference's own: 1e-9 asked of it, and areas of slivers.
            assert!(error <= estimate + 1e-7, "{name} at {tolerance}: {error:e} {estimate:e}");
            assert!(estimate < 1e-6_f64.max(2.0 * tolerance.parse::<f64>().expect("a number")));
        }
    }
}
