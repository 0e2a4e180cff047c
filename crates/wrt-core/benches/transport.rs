//! Transport of whole levels and of single coefficients: CPU time and peak memory
//! against RED, by geometry and method: `cargo bench --bench transport`, with part
//! of a row's name to run only those rows.

use cpu_time::ProcessTime;
use glam::{DQuat, DVec3};
use peak_alloc::PeakAlloc;
use std::time::Instant;
use wrt_core::metrics::relative_euclidean_distance;
use wrt_core::transport::{
    Exact, Integrator, Method, Pair, RecursionOptions, Support, TransportGeometry,
    transport_sparse, transport_tree, transport_within,
};
use wrt_core::{Emission, Grid, Levels, Lobe, Polygon, TreeBuilder};

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Runs of which a time is the median.
const RUNS: usize = 3;

fn main() {
    let filter: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let wanted = |name: &str| filter.is_empty() || filter.iter().any(|f| name.contains(f.as_str()));
    for (name, geometry) in &geometries() {
        if wanted(&format!("block {name}")) {
            blocks(name, geometry);
        }
    }
    for (name, geometry) in &geometries() {
        if wanted(&format!("sparse {name}")) {
            sparse(name, geometry);
        }
    }
    for (name, geometry) in &geometries() {
        if wanted(&format!("recursion {name}")) {
            recursion(name, geometry);
        }
    }
    for (name, geometry) in &geometries() {
        if wanted(&format!("threads {name}")) {
            threads(name, geometry);
        }
    }
    for (name, geometry) in &geometries() {
        if wanted(&format!("coefficient {name}")) {
            coefficients(name, geometry);
        }
    }
}

/// Unit squares over a floor of normal +y.
fn geometries() -> Vec<(&'static str, TransportGeometry)> {
    let rectangle = |o, u, v| Polygon::rectangle(o, u, v).expect("a rectangle");
    let floor = rectangle(DVec3::ZERO, DVec3::Z, DVec3::X);
    let source = |o, u, v| TransportGeometry::new(rectangle(o, u, v), floor.clone());
    let turn = DQuat::from_rotation_y(0.4) * DQuat::from_rotation_x(0.3);
    vec![
        ("aligned", source(DVec3::new(0.0, 0.5, -0.5), DVec3::X, DVec3::Y)),
        // As aligned but for a texel that is not quite a cell: no stencil repeats.
        ("nearly aligned", source(DVec3::new(0.0, 0.5, -0.5), 1.001 * DVec3::X, 1.001 * DVec3::Y)),
        ("tilted", source(DVec3::new(0.1, 0.4, -0.6), turn * DVec3::X, turn * DVec3::Y)),
        ("shared edge", source(DVec3::ZERO, DVec3::X, DVec3::Y)),
        ("far tile", source(DVec3::new(0.5, 0.5, -6.0), DVec3::X, DVec3::Y)),
    ]
}

/// Coloured panes between dark leads, 2^`level` texels a side.
fn panes(level: u8) -> Emission {
    let side = 1_u32 << u32::from(level);
    let picture = (0..side * side).map(|i| {
        let (x, y) = (i % side * 32 / side, i / side * 32 / side);
        let pane = (x / 4).wrapping_mul(2_654_435_761) ^ (y / 4).wrapping_mul(40_503_001);
        let lead = x % 4 == 0 || y % 4 == 0;
        let channel = |c: u32| if lead { 0.0 } else { (pane >> (8 * c + 4) & 15) as f32 / 15.0 };
        [channel(0), channel(1), channel(2)]
    });
    let lobe = Lobe::Cosine { exponent: 4.0, peak: DVec3::new(0.2, -0.5, 0.8).normalize() };
    Emission::new(level, picture.collect(), lobe)
}

/// The same on coarser texels, each the mean of the panes in it.
fn coarse_panes(level: u8) -> Emission {
    let fine = panes(5);
    let (side, share) = (1_usize << level, 32 >> level);
    let mean = |i: usize| {
        let mut sum = [0.0; 3];
        for j in 0..share * share {
            let (u, v) = (i % side * share + j % share, i / side * share + j / share);
            for (sum, x) in sum.iter_mut().zip(fine.picture()[v * 32 + u]) {
                *sum += x / (share * share) as f32;
            }
        }
        sum
    };
    Emission::new(level, (0..side * side).map(mean).collect(), fine.lobe().clone())
}

/// Median CPU seconds of `RUNS` runs, their spread (slowest over fastest), and the
/// peak of memory above what was there.
fn measure<T>(run: impl Fn() -> T) -> (T, f64, f64, f64) {
    let mut seconds = Vec::new();
    MEMORY.reset_peak_usage();
    let before = MEMORY.current_usage();
    let mut result = None;
    for _ in 0..RUNS {
        drop(result.take());
        let clock = ProcessTime::now();
        result = Some(run());
        seconds.push(clock.elapsed().as_secs_f64());
    }
    let peak = MEMORY.peak_usage().saturating_sub(before) as f64 / f64::from(1 << 20);
    seconds.sort_by(f64::total_cmp);
    let result = result.expect("at least one run");
    (result, seconds[RUNS / 2], seconds[RUNS - 1] / seconds[0], peak)
}

fn red(found: &Grid, reference: &Grid) -> f64 {
    let (mut difference, mut size) = (0.0, 0.0);
    let levels = reference.levels();
    let values = |grid: &Grid, d: usize| -> Vec<f64> {
        grid.slice(d).map_or_else(
            || vec![0.0; 3 * levels.positions()],
            |(i, f)| grid.images()[i].iter().flatten().map(|&x| f64::from(x * f)).collect(),
        )
    };
    for d in 0..levels.directions() {
        for (a, b) in values(found, d).iter().zip(values(reference, d)) {
            difference += (a - b) * (a - b);
            size += b * b;
        }
    }
    (difference / size).sqrt()
}

/// Dense blocks to a tolerance, levels 4 to 6.
fn blocks(name: &str, geometry: &TransportGeometry) {
    let source = panes(5);
    let mut costs = Vec::new();
    for level in 4..=6 {
        let levels = Levels::isotropic(level);
        let within = if level > 5 { 2e-4 } else { 3e-5 };
        let reference =
            transport_within(geometry, &source, levels, within).expect("straight grid lines");
        println!("block {name}, level {level}: reference ± {:7.1e}", reference.relative_error);
        for tolerance in [1e-2, 3e-3, 1e-3, 3e-4].into_iter().filter(|t| *t > 4.0 * within) {
            let run = || {
                transport_within(geometry, &source, levels, tolerance).expect("straight grid lines")
            };
            let (found, seconds, spread, memory) = measure(run);
            let red = red(&found.grid, &reference.grid);
            println!(
                "  within {tolerance:5.0e}  estimate {:7.1e}  RED {red:7.1e}  {seconds:8.3} CPU s \
                 (spread {spread:4.2}) {memory:8.1} MiB",
                found.relative_error
            );
            if tolerance == 1e-3 {
                costs.push(seconds);
            }
        }
    }
    growth("CPU s at 1e-3", &costs);
}

/// Sparse trees, levels 4 to 8, of panes as fine as the positions.
fn sparse(name: &str, geometry: &TransportGeometry) {
    let mut costs = Vec::new();
    let finest = if name == "aligned" { 8 } else { 6 };
    for level in 4..=finest {
        let levels = Levels::isotropic(level);
        let source = panes(level);
        let clock = (Instant::now(), ProcessTime::now());
        MEMORY.reset_peak_usage();
        let before = MEMORY.current_usage();
        let found = transport_sparse(geometry, &source, levels, 1e-2).expect("straight grid lines");
        let (wall, cpu) = (clock.0.elapsed().as_secs_f64(), clock.1.elapsed().as_secs_f64());
        let peak = MEMORY.peak_usage().saturating_sub(before) as f64 / f64::from(1 << 20);
        println!(
            "sparse {name}, level {level}: ± {:7.1e}, {:9} coefficients ({:6.3} %), {cpu:8.2} CPU s, \
             {wall:8.2} s, {peak:8.1} MiB",
            found.relative_error,
            found.tree.len(),
            100.0 * found.tree.len() as f64 / (levels.positions() * levels.directions()) as f64
        );
        costs.push(cpu);
    }
    growth("CPU s", &costs);
}

/// Factor from one level to the next.
fn growth(what: &str, costs: &[f64]) {
    let factors: Vec<String> = costs.windows(2).map(|w| format!("{:.1}", w[1] / w[0])).collect();
    println!("  {what}: × {} a level", factors.join(", × "));
}

/// The paper's recursion with its two-dimensional trapezoidal rule, at levels that it
/// finishes in; the rest by its growth from the one to the other.
fn recursion(name: &str, geometry: &TransportGeometry) {
    let run = |level: u8, rule: &str| {
        let levels = Levels::isotropic(level);
        let source = coarse_panes(level).project(level);
        let reference =
            transport_within(geometry, &source, levels, 3e-4).expect("straight grid lines").grid;
        let rule: Method = rule.parse().expect("a method");
        let tree = TreeBuilder::from_grid(&source).finish();
        let options = RecursionOptions { integrator: &rule, oracle: true };
        let clock = ProcessTime::now();
        let (found, counts) = transport_tree(geometry, &tree, levels, &options);
        let seconds = clock.elapsed().as_secs_f64();
        let red = red(&found.finish().to_grid(), &reference);
        println!(
            "recursion {name}, level {level}, {}: RED {red:7.1e}  {seconds:8.3} CPU s, {} integrals",
            rule.name(),
            counts.integrated
        );
        seconds
    };
    for rule in ["trapezoid2d:5", "trapezoid2d:17", "trapezoid2d:65"] {
        run(1, rule);
    }
    let costs = [1, 2, 3].map(|level| run(level, "trapezoid2d:5"));
    growth("CPU s with trapezoid2d:5", &costs);
}

/// Wall time from one thread and from two.
fn threads(name: &str, geometry: &TransportGeometry) {
    let source = panes(5);
    let mut walls = [1, 2].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.expect("a thread pool");
        let run = || {
            let clock = Instant::now();
            pool.install(|| transport_within(geometry, &source, Levels::isotropic(5), 3e-3))
                .expect("straight grid lines");
            clock.elapsed().as_secs_f64()
        };
        let mut runs: Vec<f64> = (0..5).map(|_| run()).collect();
        runs.sort_by(f64::total_cmp);
        // The least: other programs only add.
        runs[0]
    });
    walls.reverse();
    let [two, one] = walls;
    println!("threads {name}: one {one:.3} s, two {two:.3} s, ratio {:.2}", one / two);
}

/// All coefficients of the brightest source cell of a level.
fn coefficients(name: &str, geometry: &TransportGeometry) {
    let visible: Method = "visible2d:9".parse().expect("a method");
    for level in 0..=2_u8 {
        let cells = |level: u8| {
            (0..1_u32 << (4 * u32::from(level))).map(move |i| {
                let side = u32::from(level);
                let m =
                    std::array::from_fn(|d| (i >> (side * d as u32) & ((1 << side) - 1)) as u16);
                Support::isotropic(level, m)
            })
        };
        let root = Support::isotropic(0, [0; 4]);
        let light = |j: &Support| visible.integrate(&Pair::new(geometry, *j, root)).value;
        let j = cells(level).max_by(|a, b| light(a).total_cmp(&light(b))).expect("cells");
        let pairs: Vec<Pair<'_>> = cells(2)
            .map(|k| Pair::new(geometry, j, k))
            .filter(|pair| visible.integrate(pair).value > 0.0)
            .collect();
        let all = |rule: &dyn Integrator| -> Vec<f64> {
            pairs.iter().map(|pair| rule.integrate(pair).value).collect()
        };
        let reference = all(&Exact { tolerance: 1e-14 });
        println!("coefficient {name}, j of level {level}: {} that are lit", pairs.len());
        for tolerance in [1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12] {
            let exact = Exact { tolerance };
            let (values, seconds, spread, _) = measure(|| all(&exact));
            let red = relative_euclidean_distance(&values, &reference);
            let slowest = pairs.iter().map(|pair| {
                let clock = ProcessTime::now();
                exact.integrate(pair);
                clock.elapsed().as_secs_f64()
            });
            println!(
                "  exact:{tolerance:.0e}  RED {red:8.1e}  {:8.3} ms each (spread {spread:4.2}), \
                 {:8.3} ms the slowest",
                1e3 * seconds / pairs.len() as f64,
                1e3 * slowest.fold(0.0, f64::max)
            );
        }
    }
}
