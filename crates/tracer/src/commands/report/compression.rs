//! What thresholding costs: error against coefficients kept.

use super::{Bench, GlossyTile};
use crate::report::{Chart, Point, Section, Series, Table, Value, cpu_time};
use wrt_core::{Grid, Keep, Levels, TreeBuilder};

/// What the paper keeps of 32⁴ coefficients (§7.3).
const PAPER: f64 = 0.05;

pub(super) fn measure(bench: &Bench) -> anyhow::Result<Section> {
    let level = bench.choose(4, 5);
    let levels = Levels::isotropic(level);
    let GlossyTile { incident, outgoing } = GlossyTile::at(bench, level)?;
    let full = levels.positions() * levels.directions();
    let (mut rows, mut series) = (Vec::new(), Vec::new());
    let mut add = |name: &str, grid: &Grid| {
        let tree = TreeBuilder::from_grid(grid).finish();
        let mut points = Vec::new();
        for kept in [0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001] {
            let count = (kept * full as f64).ceil() as usize;
            let ((_, done), cost) = cpu_time(bench.runs(), || tree.compressed(Keep::Count(count)));
            let share = done.after as f64 / full as f64;
            // An index of 2 bytes, a mask shared by fifteen, and three floats.
            let bytes = 14 * done.after as u64;
            rows.push(vec![
                name.into(),
                Value::Percent(kept),
                Value::Count(done.after as u64),
                Value::Count(bytes),
                Value::Percent(done.relative_error),
                Value::Number(1e3 * cost.median),
            ]);
            if done.relative_error > 0.0 {
                points.push(Point { x: 100.0 * share, y: done.relative_error, range: None });
            }
        }
        series.push(Series { name: name.to_owned(), points });
    };
    add("incident radiance", &incident);
    add("reflected radiance", &outgoing);
    Ok(Section {
        id: "compression",
        title: "Compression",
        text: vec![format!(
            "Error that thresholding adds to one glossy tile of the chapel at {side}⁴ cells, against the share of the full basis that is kept. The paper removes 95 %. Much of the basis is zero before any compression, for the window fills but a part of the hemisphere: rows whose error is 0 keep all there is.",
            side = 1 << level
        )],
        charts: vec![Chart {
            title: "What is kept, and the error of leaving out the rest".to_owned(),
            axes: ["coefficients kept, % of the full basis", "relative L² error"],
            series,
            lines: vec![(100.0 * PAPER, "the paper's 5 %")],
        }],
        tables: vec![Table {
            name: "compression",
            caption: "Thresholding of one tile.".to_owned(),
            head: vec![
                "what",
                "asked to keep",
                "coefficients kept",
                "bytes, uncoded",
                "relative L² error",
                "CPU time, ms",
            ],
            rows,
        }],
        ..Section::default()
    })
}
