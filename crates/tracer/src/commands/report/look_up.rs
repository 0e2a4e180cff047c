//! Look-ups: time by layout.

use super::{Bench, GlossyTile};
use crate::report::{Chart, Point, Section, Series, Table, Value, cpu_time};
use std::collections::HashMap;
use std::hint::black_box;
use wrt_core::{CHILDREN, Cell, Grid, Keep, Levels, Sampler, Tree, TreeBuilder, children, sobol};

/// Nodes found by hashing their index, coefficients summed along the path, as the
/// paper has it (§7.2.2.3).
struct Hashed {
    levels: Levels,
    root: [f64; 3],
    nodes: HashMap<Cell, Vec<(usize, [f32; 3])>>,
}

impl Hashed {
    fn new(tree: &Tree) -> Self {
        let levels = tree.levels();
        let mut cells = vec![Cell::ROOT; tree.nodes().len()];
        let mut nodes = HashMap::new();
        for (i, node) in tree.nodes().iter().enumerate() {
            let split = levels.split(cells[i].depth);
            for m in children(split) {
                if let Some(child) = node.child(m) {
                    cells[child] = cells[i].child(split, m);
                }
            }
            let stored = (1..CHILDREN).filter_map(|nu| Some((nu, node.coefficient(nu)?)));
            nodes.insert(cells[i], stored.map(|(nu, at)| (nu, tree.coefficients()[at])).collect());
        }
        Self { levels, root: tree.root().map(f64::from), nodes }
    }

    fn eval(&self, q: [f64; 4]) -> [f64; 3] {
        let (mut value, mut cell) = (self.root, Cell::ROOT);
        while cell.depth < self.levels.depth() {
            let Some(stored) = self.nodes.get(&cell) else { break };
            let cells = f64::from(2_u32 << cell.depth);
            let m_prime = (0..4).fold(0, |m, d| m | ((q[d] * cells) as usize & 1) << d);
            let scale = self.levels.scale(cell.depth);
            for (nu, b) in stored {
                let sign = if (nu & m_prime).count_ones() & 1 == 0 { scale } else { -scale };
                value.iter_mut().zip(b).for_each(|(value, b)| *value += sign * f64::from(*b));
            }
            cell = cell.child(self.levels.split(cell.depth), m_prime);
        }
        value
    }
}

/// All finest cells; the UDC's rim is not looked after.
struct Dense {
    level: u8,
    cells: Vec<[f32; 3]>,
}

impl Dense {
    fn new(grid: &Grid) -> Self {
        let level = grid.levels().position;
        let side = 1_usize << level;
        let at = |i: usize, d: u32| i >> (d * u32::from(level)) & (side - 1);
        let cell = |i| grid.mean([at(i, 0), at(i, 1), at(i, 2), at(i, 3)]);
        Self { level, cells: (0..side.pow(4)).map(cell).collect() }
    }

    fn at(&self, m: [usize; 4]) -> [f32; 3] {
        let l = self.level;
        self.cells[((m[3] << l | m[2]) << l | m[1]) << l | m[0]]
    }

    fn box_value(&self, q: [f64; 4]) -> [f32; 3] {
        let side = f64::from(1_u32 << self.level);
        self.at(q.map(|x| (x * side).min(side - 1.0) as usize))
    }

    fn multilinear(&self, q: [f64; 4]) -> [f32; 3] {
        let side = f64::from(1_u32 << self.level);
        let axes = q.map(|x| {
            let at = (x * side - 0.5).clamp(0.0, side - 1.0);
            let low = (at as usize).min(side as usize - 2);
            (low, (at - low as f64) as f32)
        });
        let mut sum = [0.0; 3];
        for corner in 0..CHILDREN {
            let high: [usize; 4] = std::array::from_fn(|d| corner >> d & 1);
            let cell = self.at(std::array::from_fn(|d| axes[d].0 + high[d]));
            let share = |d: usize| if high[d] == 1 { axes[d].1 } else { 1.0 - axes[d].1 };
            let weight: f32 = (0..4).map(share).product();
            sum.iter_mut().zip(cell).for_each(|(sum, x)| *sum += weight * x);
        }
        sum
    }
}

/// Points of no order, and points as neighbouring pixels see them.
fn points(count: u32) -> [(&'static str, Vec<[f64; 4]>); 2] {
    let scattered = (0..count).map(|i| {
        let u: [f64; 4] = std::array::from_fn(|d| sobol(i, d, 77 + d as u32));
        let (sine, cosine) = (std::f64::consts::TAU * u[3]).sin_cos();
        let radius = 0.5 * u[2].sqrt();
        [u[0], u[1], 0.5 + radius * cosine, 0.5 + radius * sine]
    });
    // Pixels of a floor seen from 1 m above its far edge.
    let side = f64::from(count).sqrt();
    let pixel = |i: u32| {
        let at = f64::from(i);
        let (u, v) = ((at % side).floor() / side, (at / side).floor() / side);
        let eye = glam::DVec3::new(0.5 - u, 1.3 - v, 1.0).normalize();
        [u, v, 0.5 + 0.5 * eye.x, 0.5 + 0.5 * eye.y]
    };
    [("random", scattered.collect()), ("coherent", (0..count).map(pixel).collect())]
}

pub(super) fn measure(bench: &Bench) -> anyhow::Result<Section> {
    let level = bench.choose(4, 5);
    let grid = GlossyTile::at(bench, level)?.outgoing;
    let tree = TreeBuilder::from_grid(&grid).finish();
    let dense = Dense::new(&grid);
    let full = CHILDREN.pow(level.into());
    let (mut rows, mut charts) = (Vec::new(), Vec::new());
    for (order, points) in points(1 << 14) {
        let n = points.len() as f64;
        let mut row = |layout: &str, kept: f64, bytes: usize, look_up: &dyn Fn([f64; 4])| {
            let (_, cost) =
                cpu_time(2 * bench.runs() + 1, || points.iter().for_each(|&q| look_up(q)));
            let cost = cost.per(1e-9 * n);
            rows.push(vec![
                layout.into(),
                order.into(),
                Value::Percent(kept),
                Value::Number(cost.median),
                Value::Number(cost.spread()),
                Value::Count(bytes as u64),
            ]);
            Point { x: 100.0 * kept, y: cost.median, range: None }
        };
        let bytes = size_of_val(&dense.cells[..]);
        let mut series: Vec<Series> = Vec::new();
        let mut add = |name: &str, point: Point| {
            match series.iter_mut().find(|s| s.name == name) {
                Some(series) => series.points.push(point),
                None => series.push(Series { name: name.to_owned(), points: vec![point] }),
            };
        };
        for kept in [0.2, 0.05, 0.01, 0.005] {
            let count = (kept * full as f64) as usize;
            let tree = tree.compressed(Keep::Count(count)).0;
            let kept = tree.len() as f64 / full as f64;
            let (sampler, hashed) = (Sampler::new(&tree), Hashed::new(&tree));
            let hashed_bytes = hashed.nodes.values().map(|v| 20 * v.len() + 48).sum();
            let box_row = row("tree, nearest cell", kept, sampler.bytes(), &|q| {
                black_box(sampler.box_value(q));
            });
            add("tree, nearest cell", box_row);
            let linear = row("tree, multilinear", kept, sampler.bytes(), &|q| {
                black_box(sampler.multilinear(q));
            });
            add("tree, multilinear", linear);
            let path = row("hashed nodes, path sum", kept, hashed_bytes, &|q| {
                black_box(hashed.eval(q));
            });
            add("hashed nodes, path sum (the paper's)", path);
        }
        let nearest = row("dense array, nearest cell", 1.0, bytes, &|q| {
            black_box(dense.box_value(q));
        });
        add("dense array, nearest cell", nearest);
        let linear = row("dense array, multilinear", 1.0, bytes, &|q| {
            black_box(dense.multilinear(q));
        });
        add("dense array, multilinear", linear);
        charts.push(Chart {
            title: format!("{order} points"),
            axes: ["coefficients kept, % of the full basis", "CPU time a look-up, ns"],
            series,
            ..Chart::default()
        });
    }
    charts.iter_mut().for_each(|chart| chart.title[..1].make_ascii_uppercase());
    Ok(Section {
        id: "look-up",
        title: "Look-up",
        text: vec![format!(
            "Time to look up the reflected radiance of one glossy tile of the chapel, {side}⁴ cells, by layout: the sampler of the renderer, a hash of nodes with the coefficients summed along the path as in the paper, and a plain array of all cells. The less is kept, the smaller the tree and the more of it a cache holds.",
            side = 1 << level
        )],
        charts,
        tables: vec![Table {
            name: "look-up",
            caption: "Look-ups by layout and order.".to_owned(),
            head: vec!["layout", "points", "kept", "ns", "slowest / fastest", "bytes"],
            rows,
        }],
        ..Section::default()
    })
}
