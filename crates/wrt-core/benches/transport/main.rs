//! Transport of whole levels and of single coefficients: CPU time and peak memory
//! against RED, by geometry and method: `cargo bench --bench transport`, with part
//! of a row's name to run only those rows.
//!
//! How cost grows with the level l, for 2^l cells a side in all four dimensions:
//! - A recursion integrates pairs. Each of the 16^l destination cells sees as many
//!   source cells of its own size at any level, so that it costs ∝ (2^l)^4.
//! - A block has 4^l direction cells with a picture of 4^l positions each; what varies
//!   is how many directions a cell needs. Footprints move by fewer texels across
//!   smaller cells, by half as many a level along either axis as long as the picture
//!   stays the same: 4^l pictures × 4^l cells × 4^−l directions, ∝ (2^l)^2, until the
//!   three to eight directions a side that each cell gets at least make it (2^l)^4
//!   again. With pictures as fine as the positions, as `sparse` has them, footprints
//!   move by as many texels at all levels, and it is (2^l)^4 throughout, but for faint
//!   cells that need less.

mod recursion;

use cpu_time::ProcessTime;
use glam::{DQuat, DVec3};
use peak_alloc::PeakAlloc;
use recursion::Sample;
use std::time::Instant;
use wrt_core::metrics::relative_euclidean_distance;
use wrt_core::transport::{
    BlockOptions, Exact, Integrator, Method, Pair, Support, TransportGeometry, transport_block,
    transport_sparse, transport_within,
};
use wrt_core::{Emission, Grid, Levels, Lobe, Polygon};

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
        if wanted(&format!("picture {name}")) {
            pictures(name, geometry);
        }
    }
    for (name, geometry) in &geometries() {
        if wanted(&format!("sparse {name}")) {
            sparse(name, geometry);
        }
    }
    for (name, geometry) in &geometries() {
        if wanted(&format!("handover {name}")) {
            handovers(name, geometry);
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
                costs.push((level, seconds));
            }
        }
    }
    fit(&format!("block {name}, within 1e-3"), &costs);
}

/// Stained glass that changes at every texel, 2^`level` a side.
fn speckles(level: u8) -> Emission {
    let texel = |i: u32| {
        let hash = (i.wrapping_mul(2_654_435_761) ^ i >> 7).wrapping_mul(40_503_001);
        [8, 16, 24].map(|shift| (hash >> shift & 255) as f32 / 255.0)
    };
    Emission::new(level, (0..1 << (2 * u32::from(level))).map(texel).collect(), Lobe::Lambertian)
}

/// Dense blocks of pictures that have a border at every texel, by the levels of
/// picture and positions.
fn pictures(name: &str, geometry: &TransportGeometry) {
    for picture in [4, 6, 8] {
        let source = speckles(picture);
        for position in [3, 4, 5] {
            let levels = Levels { position, direction: 4 };
            let within = |tolerance: f64| {
                transport_within(geometry, &source, levels, tolerance).expect("straight grid lines")
            };
            let (found, seconds, spread, memory) = measure(|| within(3e-3));
            println!(
                "picture {name}, level {picture} onto {position}: estimate {:7.1e}  {seconds:8.3} CPU s \
                 (spread {spread:4.2}) {memory:8.1} MiB",
                found.relative_error
            );
        }
    }
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
        costs.push((level, cpu));
    }
    fit(&format!("sparse {name}"), &costs);
}

/// Small blocks to tight tolerances, against all the samples that a cell may get.
fn handovers(name: &str, geometry: &TransportGeometry) {
    for level in [2, 3] {
        let (source, levels) = (coarse_panes(level), Levels::isotropic(level));
        let within = |tolerance: f64| {
            transport_within(geometry, &source, levels, tolerance).expect("straight grid lines")
        };
        let reference = within(7e-8);
        println!("handover {name}, level {level}: reference ± {:7.1e}", reference.relative_error);
        for tolerance in [1e-4, 1e-5, 1e-6, 1e-7] {
            let (found, seconds, spread, _) = measure(|| within(tolerance));
            println!(
                "  within {tolerance:5.0e}  estimate {:7.1e}  RED {:7.1e}  {seconds:8.3} CPU s \
                 (spread {spread:4.2})",
                found.relative_error,
                red(&found.grid, &reference.grid)
            );
        }
        let options = BlockOptions { samples: 256 };
        let run = || transport_block(geometry, &source, levels, options);
        let (found, seconds, spread, _) = measure(run);
        println!(
            "  65 536 samples a cell            RED {:7.1e}  {seconds:8.3} CPU s (spread {spread:4.2})",
            red(&found.expect("straight grid lines"), &reference.grid)
        );
    }
}

/// The paper's recursion with its two-dimensional trapezoidal rule at levels 4 to 7, from
/// a sample of its work; at level 5 against blocks within the same RED.
fn recursion(name: &str, geometry: &TransportGeometry) {
    let mut costs = Vec::new();
    for level in 4..=7 {
        let source = if level < 5 { coarse_panes(level) } else { panes(level) };
        let sample = Sample::draw(geometry, &source, level, 300, 1e-5);
        let exact = sample.exact();
        println!(
            "recursion {name}, level {level}: {} cells of {:.1e}; exact:1e-5 {:.0} CPU s ± {:.0} %",
            sample.len(),
            16.0_f64.powi(i32::from(level)),
            exact.value,
            100.0 * exact.standard_error / exact.value
        );
        for samples in [3, 5, 9, 17, 33, 65] {
            let rule: Method = format!("trapezoid2d:{samples}").parse().expect("a method");
            let (red, seconds, integrals) = sample.measure(&rule, 0, 1);
            println!(
                "  {:14}  RED {red:7.1e}  {:9.0} CPU s ± {:2.0} %, at least {:9.0}, {integrals:.1e} integrals",
                rule.name(),
                seconds.value,
                100.0 * seconds.standard_error / seconds.value,
                seconds.at_least()
            );
            if red <= BAR {
                costs.push((level, seconds.value));
                if level == 5 {
                    ratios(name, geometry, &sample, &rule);
                }
                break;
            }
        }
    }
    fit(&format!("recursion {name}, RED 1e-3"), &costs);
}

/// The RED at which methods are compared.
const BAR: f64 = 1e-3;

/// How many times as long as blocks the recursion takes for 32^4 × RGB at the RED of
/// the [`BAR`], in turns: part of its sample, a block.
fn ratios(name: &str, geometry: &TransportGeometry, sample: &Sample<'_>, rule: &Method) {
    const TURNS: usize = 5;
    let levels = Levels::isotropic(5);
    let emission = panes(5);
    let reference = transport_within(geometry, &emission, levels, 5e-5);
    let reference = reference.expect("straight grid lines").grid;
    let block = |tolerance: f64| {
        let clock = ProcessTime::now();
        let found = transport_within(geometry, &emission, levels, tolerance);
        (found.expect("straight grid lines").grid, clock.elapsed().as_secs_f64())
    };
    // The loosest tolerance that meets the bar.
    let tolerances = [1e-2, 7e-3, 5e-3, 4e-3, 3e-3, 2e-3, 1.5e-3, 1e-3];
    let met = tolerances.into_iter().map(|t| (t, red(&block(t).0, &reference)));
    let Some((tolerance, red)) = met.into_iter().find(|(_, red)| *red <= BAR) else {
        println!("ratio {name}: no block meets RED {BAR:.0e}");
        return;
    };
    let mut ratios = Vec::new();
    let (mut seconds, mut least) = (Vec::new(), f64::INFINITY);
    for turn in 0..TURNS {
        let (_, paper, _) = sample.measure(rule, turn, TURNS);
        let (_, ours) = block(tolerance);
        ratios.push(paper.value / ours);
        seconds.push(ours);
        least = least.min(paper.at_least() / ours);
    }
    ratios.sort_by(f64::total_cmp);
    seconds.sort_by(f64::total_cmp);
    println!(
        "  ratio {name}, 32^4 × RGB: block RED {red:7.1e} in {:.3} CPU s; the recursion takes {:.0} times \
         as long, {:.0} to {:.0} in {TURNS} turns; at least {least:.0} in each with 97.5 %",
        seconds[TURNS / 2],
        ratios[TURNS / 2],
        ratios[0],
        ratios[TURNS - 1]
    );
}

/// Prints by which power of the number of cells a side costs grow: least squares of
/// their logarithms.
fn fit(what: &str, costs: &[(u8, f64)]) {
    if costs.len() < 2 {
        return;
    }
    let n = costs.len() as f64;
    let points = || costs.iter().map(|&(level, cost)| (f64::from(level), cost.log2()));
    let (x, y) = (points().map(|p| p.0).sum::<f64>() / n, points().map(|p| p.1).sum::<f64>() / n);
    let above = points().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>();
    let slope = above / points().map(|p| (p.0 - x).powi(2)).sum::<f64>();
    let off = points().map(|p| (p.1 - y - slope * (p.0 - x)).abs()).fold(0.0, f64::max);
    println!("  {what}: CPU s ∝ (cells a side)^{slope:.2}, within a factor of {:.2}", off.exp2());
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
            let slowest = pairs.iter().map(|pair| measure(|| exact.integrate(pair)).1);
            println!(
                "  exact:{tolerance:.0e}  RED {red:8.1e}  {:8.3} ms each (spread {spread:4.2}), \
                 {:8.3} ms the slowest",
                1e3 * seconds / pairs.len() as f64,
                1e3 * slowest.fold(0.0, f64::max)
            );
        }
    }
}
