//! Time to make, write and read a `.wct` file and its sampler, and the bytes of each.
//!
//! ```text
//! cargo bench -p wrt-core --bench file
//! ```
//!
//! A patch of 32⁴ × RGB under a stained-glass window, stored raw or coded, and one of
//! 64⁴. Milliseconds of the processor, the least of several rounds: `code` is
//! thresholding or quantisation, `write` and `read` are to and from bytes in memory,
//! checksums and all checks included, `sampler` is what a renderer needs on top. `copy`
//! is a copy of the file's bytes into memory that is there, `fault` the first touch of
//! as much memory that is not, which whoever reads or maps a file pays.

use cpu_time::ProcessTime;
use std::hint::black_box;
use wrt_core::grid::{Grid, udc_fractions};
use wrt_core::wct_file::{ChartKind, Side};
use wrt_core::{Keep, Levels, Patch, PatchGeometry, Sampler, Tree, TreeBuilder, WctFile};

const ROUNDS: usize = 5;

/// Panes that shift with direction, under a cos⁴ lobe, with a slow shade over all.
fn window(level: u8) -> Tree {
    let side = 1_usize << level;
    let centre = |i: usize| (i as f64 + 0.5) / side as f64;
    let image = |(d, fraction): (usize, f64)| {
        let (k, l) = (2.0 * centre(d % side) - 1.0, 2.0 * centre(d / side) - 1.0);
        let z = (1.0 - k * k - l * l).max(0.01).sqrt();
        let lobe = (0.7 * z + 0.7 * l).max(0.0).powi(4) * fraction;
        let texel = |p: usize| {
            let (u, v) = (centre(p % side), centre(p / side));
            let (x, y) = (u + k / z, v + l / z - 1.0);
            let lit = (-0.5..1.5).contains(&x) && (-0.5..1.5).contains(&y);
            let pane = (3.0 * x).floor() + 3.0 * (3.0 * y).floor();
            let radiance = if lit { lobe * (1.0 + 0.3 * (2.0 * u + v).sin()) } else { 0.0 };
            [1.0, 2.0, 3.0].map(|c| (radiance * (0.5 + 0.5 * (pane * c).sin())) as f32)
        };
        (lobe > 0.0).then(|| (0..side * side).map(texel).collect())
    };
    let images = udc_fractions(level).into_iter().enumerate().map(image).collect();
    TreeBuilder::from_grid(&Grid::from_images(Levels::isotropic(level), images)).finish()
}

/// Milliseconds that `make` takes, and what it makes.
fn timed<T>(mut make: impl FnMut() -> T) -> (f64, T) {
    let mut least = f64::INFINITY;
    let mut made = None;
    for _ in 0..ROUNDS {
        let start = ProcessTime::now();
        made = Some(black_box(make()));
        least = least.min(1e3 * start.elapsed().as_secs_f64());
    }
    (least, made.expect("at least one round"))
}

/// Milliseconds of the first touch of so many bytes.
fn fault(bytes: usize) -> f64 {
    // More than the allocator keeps: from the system, page by page, each time.
    const LARGE: usize = 1 << 28;
    let (all, ()) = timed(|| {
        let mut room = vec![0_u8; LARGE];
        black_box(&mut room).iter_mut().step_by(4096).for_each(|byte| *byte = 1);
    });
    all * bytes as f64 / LARGE as f64
}

fn main() {
    let full = window(5);
    println!(
        "{:<22} {:>9} {:>9} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8} {:>9}",
        "stored", "error", "file", "code", "write", "read", "copy", "fault", "sampler", "in memory"
    );
    println!(
        "{:<22} {:>9} {:>9} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8} {:>9}",
        "", "%", "kB", "ms", "ms", "ms", "ms", "ms", "ms", "kB"
    );
    let row = |name: &str, make: &dyn Fn() -> (Tree, f64)| {
        let (code, (tree, relative_error)) = timed(make);
        let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, -1.0], [0.0, 0.0, -1.0]];
        let patch = Patch {
            name: "floor".to_owned(),
            polygon: PatchGeometry { vertices: square.to_vec(), chart: ChartKind::Rectilinear },
            side: Side::Outgoing,
            tree,
            relative_error,
            error_estimate: None,
        };
        let file = WctFile { patches: vec![patch], ..WctFile::default() };
        let (write, bytes) = timed(|| file.to_bytes());
        let (read, back) = timed(|| WctFile::from_bytes(&bytes).expect("its own bytes"));
        let mut room = bytes.clone();
        let (copy, ()) = timed(|| black_box(&mut room).copy_from_slice(&bytes));
        let fault = fault(bytes.len());
        let (build, sampler) = timed(|| Sampler::new(&back.patches[0].tree));
        println!(
            "{name:<22} {:>9.3} {:>9.1} {code:>8.1} {write:>8.2} {read:>8.2} {copy:>8.3} {fault:>8.3} {build:>8.1} {:>9.0}",
            100.0 * relative_error,
            bytes.len() as f64 / 1e3,
            sampler.bytes() as f64 / 1e3,
        );
    };
    row("raw, all", &|| (full.clone(), 0.0));
    for error in [0.002, 0.01, 0.05] {
        row(&format!("raw, within {error}"), &|| {
            let (tree, report) = full.compressed(Keep::RelativeError(error));
            (tree, report.relative_error)
        });
        row(&format!("coded, within {error}"), &|| {
            let (tree, report) = full.quantised(error);
            (tree, report.relative_error)
        });
    }
    let large = window(6);
    row("64^4, raw, all", &|| (large.clone(), 0.0));
    row("64^4, raw, within 0.01", &|| {
        let (tree, report) = large.compressed(Keep::RelativeError(0.01));
        (tree, report.relative_error)
    });
}
