//! Reflection of a tile's light: the wavelet product against matrix products in
//! direction cells, in CPU time and error: `cargo bench --bench interaction`, with
//! part of a row's name to run only those rows.

use cpu_time::ProcessTime;
use glam::DVec3;
use std::f64::consts::FRAC_1_PI;
use wrt_core::grid::udc_fractions;
use wrt_core::transport::{BlockOptions, TransportGeometry, transport_block};
use wrt_core::{
    BrdfTree, Emission, Grid, Keep, Levels, Lobe, LobeMatrix, Phong, Polygon, Tree, TreeBuilder,
    reflect,
};

/// Runs of which a time is the median.
const RUNS: usize = 5;

fn main() {
    let filter: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread");
    for level in [4, 5] {
        let light = light(level);
        for (name, phong) in materials() {
            let name = format!("{}^4 {name}", 1 << level);
            if filter.is_empty() || filter.iter().any(|f| name.contains(f.as_str())) {
                pool.install(|| compare(&name, &light, &phong));
            }
        }
    }
}

fn materials() -> Vec<(&'static str, Phong)> {
    let glossy = |exponent| Phong { kd: [0.1; 3], ks: [0.6; 3], exponent };
    let diffuse = Phong { kd: [0.7, 0.6, 0.5], ks: [0.0; 3], exponent: 0.0 };
    vec![("diffuse", diffuse), ("n = 40", glossy(40.0)), ("n = 400", glossy(400.0))]
}

/// Light of panes with a lobe on a square floor beside their wall.
fn light(level: u8) -> Grid {
    let rectangle = |o, u, v| Polygon::rectangle(o, u, v).expect("a rectangle");
    let floor = rectangle(DVec3::new(-0.5, 0.0, 0.4), DVec3::Z, DVec3::X);
    let window = rectangle(DVec3::new(-0.8, 1.0, -1.0), DVec3::X * 1.6, DVec3::Y * 1.6);
    let picture = (0..4096_u32).map(|i| {
        let pane = (i % 64 / 8).wrapping_mul(2_654_435_761) ^ (i / 512).wrapping_mul(40_503_001);
        let lead = i % 8 == 0 || i / 64 % 8 == 0;
        let channel = |c: u32| if lead { 0.0 } else { (pane >> (8 * c + 4) & 15) as f32 / 15.0 };
        [channel(0), channel(1), channel(2)]
    });
    let lobe = Lobe::Cosine { exponent: 4.0, peak: DVec3::new(0.0, -0.7, 0.7).normalize() };
    let emission = Emission::new(6, picture.collect(), lobe);
    let geometry = TransportGeometry::new(window, floor);
    transport_block(&geometry, &emission, Levels::isotropic(level), BlockOptions::default())
        .expect("straight grid lines")
}

/// Median CPU seconds.
fn measure<T>(run: impl Fn() -> T) -> (T, f64) {
    let mut seconds = Vec::new();
    let mut result = None;
    for _ in 0..RUNS {
        drop(result.take());
        let clock = ProcessTime::now();
        result = Some(run());
        seconds.push(clock.elapsed().as_secs_f64());
    }
    seconds.sort_by(f64::total_cmp);
    (result.expect("at least one run"), seconds[RUNS / 2])
}

fn compare(name: &str, light: &Grid, phong: &Phong) {
    let level = light.levels().direction;
    let directions = light.levels().directions();
    let clock = ProcessTime::now();
    let lobe = LobeMatrix::phong(phong.exponent, level, level);
    let all: Vec<usize> = (0..directions).collect();
    let rows = lobe.rows(&all);
    println!("{name}: the lobe's matrix in {:.3} CPU s", clock.elapsed().as_secs_f64());
    // Entries for the first channel's reflectances; the three cost the same.
    let mut matrix =
        vec![(4.0 / directions as f64 * phong.kd[0] * FRAC_1_PI) as f32; directions * directions];
    for (r, row) in rows.iter().enumerate() {
        for &(s, weight) in row {
            matrix[r * directions + s as usize] += phong.ks[0] as f32 * weight;
        }
    }
    let fractions = udc_fractions(level);
    let grey = Phong { kd: [phong.kd[0]; 3], ks: [phong.ks[0]; 3], ..*phong };
    let lit: Vec<usize> = (0..directions).filter(|&s| light.slice(s).is_some()).collect();
    let inside: Vec<usize> = (0..directions).filter(|&r| fractions[r] > 0.0).collect();
    let (reference, dense) = measure(|| product(light, &matrix, &fractions, &all, &all));
    let row = |what: String, seconds: f64, error: f64| {
        println!(
            "  {what:<46} {:9.3} ms  {:7.1} x dense  error {error:8.1e}",
            1e3 * seconds,
            dense / seconds
        );
    };
    row("dense matrix".into(), dense, 0.0);
    let (grid, seconds) = measure(|| product(light, &matrix, &fractions, &lit, &inside));
    row(
        format!("{} lit x {} in the UDC", lit.len(), inside.len()),
        seconds,
        distance(&grid, &reference),
    );
    let sparse = || reflect(light, &grey, grey.is_glossy().then_some(&lobe));
    let (grid, seconds) = measure(sparse);
    row("sparse matrix, diffuse of rank one".into(), seconds, distance(&grid, &reference));
    let (_, seconds) = measure(|| TreeBuilder::from_grid(&sparse()).finish());
    row("  and its coefficients".into(), seconds, distance(&grid, &reference));
    let incident = TreeBuilder::from_grid(light).finish();
    let (_, seconds) = measure(|| {
        let light = incident.to_grid();
        let out = reflect(&light, &grey, grey.is_glossy().then_some(&lobe));
        TreeBuilder::from_grid(&out).finish()
    });
    row("  from coefficients to coefficients".into(), seconds, distance(&grid, &reference));
    for (threshold, tolerance) in
        [(0.0, 0.0), (1e-3, 1e-3), (3e-3, 3e-3), (1e-2, 1e-2), (3e-2, 3e-2)]
    {
        let full = TreeBuilder::from_grid(light).finish();
        let kept = full.compressed(Keep::RelativeError(threshold)).0;
        let clock = ProcessTime::now();
        let brdf = BrdfTree::phong(&grey, &lobe, tolerance);
        let projection = clock.elapsed().as_secs_f64();
        let (tree, seconds) = measure(|| brdf.reflect(&kept));
        row(
            format!("wavelets to {tolerance:.0e}: {} x {}", brdf.tree().len(), kept.len()),
            seconds,
            tree_distance(&tree, &reference),
        );
        println!("    BRDF projected in {projection:.3} CPU s, result {}", tree.len());
    }
}

/// Every pair of these incident and reflected cells, at all positions.
fn product(light: &Grid, matrix: &[f32], fractions: &[f64], lit: &[usize], to: &[usize]) -> Grid {
    let levels = light.levels();
    let dark = vec![[0.0; 3]; levels.positions()];
    let images: Vec<Vec<f32>> = (0..levels.directions())
        .map(|s| match light.slice(s) {
            Some((image, scale)) => {
                light.images()[image].iter().flatten().map(|x| x * scale).collect()
            }
            None => dark.iter().flatten().copied().collect(),
        })
        .collect();
    let mut out = vec![None; levels.directions()];
    for &r in to {
        let mut sum = vec![0.0_f32; 3 * levels.positions()];
        for &s in lit {
            let weight = matrix[r * levels.directions() + s];
            for (sum, light) in sum.iter_mut().zip(&images[s]) {
                *sum += weight * light;
            }
        }
        let fraction = fractions[r] as f32;
        out[r] =
            Some(sum.chunks_exact(3).map(|rgb| [0, 1, 2].map(|c| fraction * rgb[c])).collect());
    }
    Grid::from_images(levels, out)
}

fn distance(a: &Grid, b: &Grid) -> f64 {
    let levels = b.levels();
    let (p, d) = (1 << levels.position, 1 << levels.direction);
    let mut sum = 0.0;
    for i in 0..levels.positions() * levels.directions() {
        let m = [i % p, i / p % p, i / (p * p) % d, i / (p * p * d)];
        for (a, b) in a.mean(m).iter().zip(b.mean(m)) {
            sum += f64::from(a - b).powi(2);
        }
    }
    (sum / (levels.positions() * levels.directions()) as f64 / b.norm_squared()).sqrt()
}

fn tree_distance(a: &Tree, b: &Grid) -> f64 {
    distance(&a.to_grid(), b)
}
