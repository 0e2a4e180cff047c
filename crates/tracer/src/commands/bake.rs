//! `tracer bake`: a scene to a `.wct` file.

use crate::bake::{BakeOptions, Baked, Stage, Transport, bake};
use crate::cli;
use crate::scene::Scene;
use anyhow::{Context as _, bail};
use std::collections::BTreeMap;
use wrt_core::transport::{BlockOptions, Integrator as _};
use wrt_core::{Keep, Levels, WctFile};

/// Bakes, writes, and prints what came out.
pub(crate) fn run(args: &cli::Bake) -> anyhow::Result<()> {
    let folder = args.output.parent().filter(|f| !f.as_os_str().is_empty());
    if let Some(folder) = folder.filter(|f| !f.is_dir()) {
        // Before the work, not after it.
        bail!("{}: the folder {} does not exist", args.output.display(), folder.display());
    }
    let mut scene = super::load(&args.scene)?;
    super::light_windows(&mut scene, &args.weather)
        .with_context(|| format!("{}", args.scene.display()))?;
    let mut options = options(&args.accuracy);
    options.incident = args.incident;
    let baked = baked(&scene, &options, args.threads)
        .with_context(|| format!("baking {}", args.scene.display()))?;
    let mut recorded = BTreeMap::new();
    let Levels { position, direction } = options.levels;
    recorded.insert("levels".to_owned(), format!("{position},{direction}"));
    recorded.insert("keep".to_owned(), format!("{:?}", options.keep));
    recorded.insert(
        "transport".to_owned(),
        match options.transport {
            Transport::Block(block) => format!("block:{}", block.samples),
            Transport::Recursion(method) => format!("recursion {}", method.name()),
        },
    );
    let file = WctFile {
        patches: baked.patches.clone(),
        generator: concat!("tracer ", env!("CARGO_PKG_VERSION")).to_owned(),
        input_hash: format!("fnv1a64:{:016x}", baked.input_hash),
        options: recorded,
    };
    file.write(&args.output).with_context(|| format!("writing {}", args.output.display()))?;
    let bytes = std::fs::metadata(&args.output).map_or(0, |m| m.len());
    print!("{}", table(&baked, bytes));
    Ok(())
}

/// The options that the accuracy flags ask for.
pub(crate) fn options(accuracy: &cli::Accuracy) -> BakeOptions {
    let (position, direction) = accuracy.levels();
    let levels = Levels { position, direction };
    let full = levels.positions() * levels.directions();
    BakeOptions {
        levels,
        emission_level: (position + 1).max(6),
        transport: match accuracy.recursion {
            Some(method) => Transport::Recursion(method),
            None => Transport::Block(BlockOptions { samples: accuracy.samples }),
        },
        keep: match accuracy.compress {
            Some(removed) => Keep::Count(((1.0 - removed) * full as f64).ceil() as usize),
            None => Keep::RelativeError(accuracy.threshold),
        },
        incident: false,
        checks: accuracy.checks,
    }
}

/// Bakes with a progress bar; prints the warnings.
pub(crate) fn baked(scene: &Scene, options: &BakeOptions, threads: usize) -> anyhow::Result<Baked> {
    let bar = super::bar(0, "baking", "patches");
    let progress = |done: usize, of: usize| {
        bar.set_length(of as u64);
        bar.set_position(done as u64);
    };
    let baked = super::with_threads(threads, || bake(scene, options, &progress))?;
    bar.finish_and_clear();
    let baked = baked?;
    for warning in &baked.warnings {
        eprintln!("tracer: warning: {warning}");
    }
    Ok(baked)
}

/// The summary: coefficients, compression, error, time per stage.
fn table(baked: &Baked, bytes: u64) -> String {
    use std::fmt::Write as _;
    let mut out = String::new();
    let mut row = |what: &str, value: String| {
        let _ = writeln!(out, "{what:<24} {value}");
    };
    let share = |part: usize| 100.0 * part as f64 / baked.full.max(1) as f64;
    row("patches", baked.patches.len().to_string());
    row("coefficients, full basis", format!("{} × RGB", baked.full));
    row("  not zero", format!("{} ({:.1} %)", baked.before, share(baked.before)));
    row("  kept", format!("{} ({:.2} %)", baked.after, share(baked.after)));
    row("compression", format!("{:.2} % removed", 100.0 - share(baked.after)));
    row("file", format!("{:.2} MB", bytes as f64 / 1e6));
    row("error of compression", format!("{:.3} % relative L2", 100.0 * baked.dropped));
    let error = baked.error.map_or("not checked".to_owned(), |e| {
        format!("{:.2} % relative RMS against direct quadrature, sampled", 100.0 * e)
    });
    row("error when looked up", error);
    for stage in Stage::ALL {
        let seconds = baked.times[stage as usize].as_secs_f64();
        row(&format!("time, {}", stage.name()), format!("{seconds:.3} s"));
    }
    let total: f64 = baked.times.iter().map(std::time::Duration::as_secs_f64).sum();
    row("time in all", format!("{total:.3} s"));
    out
}
