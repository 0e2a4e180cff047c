//! Transport of a whole window: error and time by level and method.

use super::{Bench, relative_rms};
use crate::bake::{emissions, receivers};
use crate::report::{Chart, Point, Section, Series, Table, Value, cpu_time, short};
use anyhow::Context as _;
use wrt_core::transport::{
    BlockOptions, Method, RecursionOptions, TransportGeometry, transport_block, transport_tree,
    transport_within,
};
use wrt_core::{Emission, Grid, Levels, TreeBuilder};

/// The paper's rule with the count that its window was made with.
const RULE: &str = "trapezoid2d:5";

/// All cells, position fastest.
fn values(grid: &Grid) -> Vec<f64> {
    let levels = grid.levels();
    let cells = 3 * levels.positions();
    let image = |d: usize| match grid.slice(d) {
        Some((i, f)) => grid.images()[i].iter().flatten().map(|&x| f64::from(x * f)).collect(),
        None => vec![0.0; cells],
    };
    (0..levels.directions()).flat_map(image).collect()
}

fn error(found: &Grid, reference: &Grid) -> f64 {
    relative_rms(values(found).into_iter().zip(values(reference)))
}

pub(super) fn measure(bench: &Bench) -> anyhow::Result<Section> {
    let scene = bench.scene("chapel/chapel.gltf")?;
    let tiles = receivers(&scene, &mut Vec::new())?;
    let tile = tiles.iter().find(|t| t.phong.is_glossy()).context("a glossy receiver")?;
    let window = |level: u8| -> anyhow::Result<(TransportGeometry, Emission)> {
        let (polygon, emission) =
            emissions(&scene, Some(level))?.into_iter().next().context("an emitter")?;
        Ok((TransportGeometry::new(polygon, tile.polygon.clone()), emission))
    };
    let (mut rows, mut series) = (Vec::new(), Vec::new());
    for level in 3..=bench.choose(4, 6) {
        let (geometry, emission) = window(level)?;
        let levels = Levels::isotropic(level);
        let with = |samples| {
            transport_block(&geometry, &emission, levels, BlockOptions { samples })
                .expect("straight grid lines")
        };
        let finest = bench.choose(32, if level < 6 { 64 } else { 32 });
        let reference = with(finest);
        let mut points = Vec::new();
        for samples in [1, 2, 4, 8, 16].into_iter().filter(|&s| 2 * s < finest) {
            let (grid, cost) = cpu_time(bench.runs(), || with(samples));
            let red = error(&grid, &reference);
            rows.push(vec![
                "fixed count".into(),
                Value::Count(level.into()),
                Value::Count(samples.into()),
                Value::Percent(red),
                Value::Number(cost.median),
                Value::Number(cost.spread()),
                Value::Count(levels.directions() as u64 * u64::from(samples).pow(2)),
                "resamplings".into(),
            ]);
            let range = Some([cost.least, cost.most]);
            points.push(Point { x: cost.median, y: red, range });
        }
        series.push(Series { name: format!("fixed counts, {}⁴ cells", 1 << level), points });
        if level < bench.choose(4, 5) {
            continue;
        }
        let mut points = Vec::new();
        for tolerance in
            [0.1, 0.03, 0.01, 3e-3, 1e-3].into_iter().filter(|&t| !bench.quick || t > 2e-3)
        {
            let (found, cost) = cpu_time(bench.runs(), || {
                transport_within(&geometry, &emission, levels, tolerance)
                    .expect("straight grid lines")
            });
            let red = error(&found.grid, &reference);
            rows.push(vec![
                format!("to {tolerance}, estimated {}", short(found.relative_error)).into(),
                Value::Count(level.into()),
                Value::Nothing,
                Value::Percent(red),
                Value::Number(cost.median),
                Value::Number(cost.spread()),
                Value::Nothing,
                Value::Nothing,
            ]);
            let range = Some([cost.least, cost.most]);
            points.push(Point { x: cost.median, y: red, range });
        }
        series.push(Series { name: format!("to a tolerance, {}⁴ cells", 1 << level), points });
    }
    let method: Method = RULE.parse()?;
    let recursion = RecursionOptions { integrator: &method, oracle: true };
    let (mut measured, mut points): (Vec<(f64, f64)>, Vec<Point>) = (Vec::new(), Vec::new());
    for level in 1..=bench.choose(3, 4) {
        let (geometry, emission) = window(level)?;
        let levels = Levels::isotropic(level);
        let source = TreeBuilder::from_grid(&emission.project(level)).finish();
        let ((tree, counts), cost) =
            cpu_time(1, || transport_tree(&geometry, &source, levels, &recursion));
        // Both lose the source's own directions to cells of this level; the
        // reference must lose them too.
        let cells = emission.project(level);
        let reference = transport_block(&geometry, &cells, levels, BlockOptions { samples: 64 })?;
        let red = error(&tree.finish().to_grid(), &reference);
        measured.push((cost.median, counts.integrated as f64));
        points.push(Point { x: cost.median, y: red, range: None });
        rows.push(vec![
            "recursion".into(),
            Value::Count(level.into()),
            Value::Nothing,
            Value::Percent(red),
            Value::Number(cost.median),
            Value::Nothing,
            Value::Count(counts.evaluations),
            "evaluations".into(),
        ]);
    }
    series.push(Series { name: format!("the paper's recursion, {RULE}"), points });
    // Cost grows by the same factor from level to level, or nearly.
    let (seconds, _) = *measured.last().context("a measured level")?;
    let steps = i32::from(5 - bench.choose(3_u8, 4));
    let growth = match measured[..] {
        [.., a, b] => b.0 / a.0,
        _ => 256.0,
    };
    let whole = seconds * growth.powi(steps);
    Ok(Section {
        id: "transport",
        title: "Transport of the whole window",
        text: vec![
            "Incident radiance of the chapel's window on one glossy tile, at all cells at once: relative L² error against the same with many more directions, and time. With fixed counts, points are 1, 2, 4, 8 and 16 directions along each side of every direction cell; to a tolerance, each cell gets what it needs. Positions are exact either way.".to_owned(),
            format!(
                "The baseline is the paper's recursion (§7.2.4), which integrates pair by pair: level {} takes {} s. From the level before it grew {growth:.0}-fold, so level 5, the paper's 32⁴, would take {} s on this processor: extrapolated, not measured.",
                bench.choose(3, 4),
                short(seconds),
                short(whole)
            ),
        ],
        charts: vec![Chart {
            title: "One window to one tile".to_owned(),
            axes: ["CPU time, s", "relative L² error"],
            series,
            ..Chart::default()
        }],
        tables: vec![Table {
            name: "transport",
            caption: "Transport by method, level and count.".to_owned(),
            head: vec![
                "method",
                "level",
                "directions a side",
                "error",
                "CPU time, s",
                "slowest / fastest",
                "work",
                "counted in",
            ],
            rows,
        }],
        ..Section::default()
    })
}
