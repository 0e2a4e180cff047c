//! `tracer bake`: a scene to a `.wct` file.

use super::keep::{self, KEEP};
use super::stdout::say;
use crate::accel::Accel;
use crate::bake::{
    BakeOptions, Baked, Blocked, Flight, Smooth, Stage, Transport, bake, blocked, fingerprint,
};
use crate::cli;
use crate::scene::Scene;
use crate::threads::in_pool;
use anyhow::{Context as _, bail};
use std::collections::BTreeMap;
use std::path::Path;
use wrt_core::legendre::Orders;
use wrt_core::transport::{BlockOptions, Integrator as _};
use wrt_core::{Keep, Levels, WctFile};

/// Bakes, writes, and prints what came out.
pub(crate) fn run(args: &cli::Bake) -> anyhow::Result<()> {
    // Before the work, not after it.
    check_output(&args.output)?;
    let mut scene = super::load(&args.scene)?;
    super::light_windows(&mut scene, &args.weather)
        .with_context(|| format!("{}", args.scene.display()))?;
    let mut options = options(&args.accuracy, args.incident)?;
    options.quantise = !args.raw;
    if let Some(name) = &args.need.for_animation {
        if options.smooth.is_none() {
            bail!("--for-animation is for the smooth basis; Haar's levels are equal everywhere");
        }
        let flight = Flight::new(&scene, name, args.need.margin);
        options.flight = Some(flight.with_context(|| format!("{}", args.scene.display()))?);
    }
    let accel = Accel::new(&scene);
    let (baked, blocked) = baked(&scene, &accel, &options, args.threads)
        .with_context(|| format!("baking {}", args.scene.display()))?;
    let mut recorded = BTreeMap::new();
    if let Some(smooth) = options.smooth {
        recorded.insert("basis".to_owned(), "smooth".to_owned());
        recorded.insert("error".to_owned(), smooth.error.to_string());
        let Orders { position, direction } = smooth.orders;
        recorded.insert("orders".to_owned(), format!("{position},{direction}"));
    } else {
        let Levels { position, direction } = options.levels;
        recorded.insert("levels".to_owned(), format!("{position},{direction}"));
        recorded.insert(KEEP.to_owned(), keep::text(options.keep));
        let is_quantised = options.quantise && matches!(options.keep, Keep::RelativeError(_));
        let storage = if is_quantised { "quantised" } else { "raw" };
        recorded.insert("storage".to_owned(), storage.to_owned());
        recorded.insert(
            "transport".to_owned(),
            match options.transport {
                Transport::Within(error) => format!("block within {error}"),
                Transport::Block(block) => format!("block:{}", block.samples),
                Transport::Recursion(method) => format!("recursion {}", method.name()),
            },
        );
    }
    if let Some(flight) = &options.flight {
        recorded.insert(super::ANIMATION.to_owned(), flight.name().to_owned());
        recorded.insert(super::MARGIN.to_owned(), flight.margin().to_string());
    }
    recorded.insert(super::SCENE.to_owned(), fingerprint(&scene));
    if let Some(sky) = &scene.sky {
        recorded.insert(super::SKY.to_owned(), sky.to_string());
    }
    let file = WctFile {
        patches: baked.patches.clone(),
        smooth: baked.smooth.clone(),
        generator: concat!("tracer ", env!("CARGO_PKG_VERSION")).to_owned(),
        input_hash: baked.input_hash.clone(),
        options: recorded,
    };
    file.write(&args.output).with_context(|| format!("writing {}", args.output.display()))?;
    let bytes = std::fs::metadata(&args.output).map_or(0, |m| m.len());
    say(table(&baked, &blocked, bytes, options.flight.as_ref()).trim_end())?;
    Ok(())
}

/// Whether a `.wct` can be written to `path`.
///
/// # Errors
///
/// If it is a folder or in none, or named as another kind of file.
pub(super) fn check_output(path: &Path) -> anyhow::Result<()> {
    if path.is_dir() {
        bail!("{} is a folder: name a .wct in it", path.display());
    }
    let folder = path.parent().filter(|f| !f.as_os_str().is_empty());
    if let Some(folder) = folder.filter(|f| !f.is_dir()) {
        bail!("{}: the folder {} does not exist", path.display(), folder.display());
    }
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    if ["png", "exr", "gltf", "glb", "obj", "mtl"].iter().any(|known| extension == *known) {
        bail!("{}: name it .wct", path.display());
    }
    Ok(())
}

/// The options that the accuracy flags ask for. `incident` is for the Haar basis.
///
/// # Errors
///
/// If options of both bases are given.
pub(crate) fn options(accuracy: &cli::Accuracy, incident: bool) -> anyhow::Result<BakeOptions> {
    let basis = match accuracy.basis()? {
        cli::Basis::Smooth
            if incident && (accuracy.basis.is_some() || accuracy.error.is_some()) =>
        {
            bail!("--incident is for the Haar basis: give --basis haar, and no --error")
        }
        cli::Basis::Smooth if incident => cli::Basis::Haar,
        basis => basis,
    };
    let smooth = (basis == cli::Basis::Smooth)
        .then(|| Smooth { error: accuracy.error.unwrap_or(ERROR), orders: accuracy.orders });
    let (position, direction) = accuracy.levels();
    let levels = Levels { position, direction };
    let full = levels.positions() * levels.directions();
    Ok(BakeOptions {
        smooth,
        flight: None,
        levels,
        // A smooth basis looks at the picture's moments in cells of any size.
        emission_level: if smooth.is_some() { 7 } else { (position + 1).max(6) },
        transport: match accuracy.recursion {
            Some(method) => Transport::Recursion(method),
            None => match accuracy.samples {
                Some(samples) => Transport::Block(BlockOptions { samples }),
                None => Transport::Within(accuracy.transport_error.unwrap_or(TRANSPORT)),
            },
        },
        keep: match accuracy.compress {
            Some(removed) => Keep::Count(((1.0 - removed) * full as f64).ceil() as usize),
            None => Keep::RelativeError(accuracy.threshold.unwrap_or(THRESHOLD)),
        },
        quantise: true,
        incident,
        checks: accuracy.checks,
    })
}

/// The error of a smooth basis where none is asked for.
const ERROR: f64 = 2e-3;

/// The error of Haar's transport where none is asked for. Over the chapel a fifth of
/// it changes neither of the errors when looked up, 4 % at levels 5, 5 and 1 % at 4, 6,
/// and takes three times as long.
const TRANSPORT: f64 = 1e-2;

/// The error that thresholding adds to Haar's where none is asked for.
const THRESHOLD: f64 = 2e-3;

/// Of all light that falls on the receivers, what may go through objects without a word.
const GHOSTLY: f64 = 0.1;

/// Bakes with a progress bar; prints the warnings.
pub(crate) fn baked(
    scene: &Scene,
    accel: &Accel,
    options: &BakeOptions,
    threads: usize,
) -> anyhow::Result<(Baked, Blocked)> {
    let bar = super::bar(0, "baking", "patches");
    let progress = |done: usize, of: usize| {
        bar.set_length(of as u64);
        bar.set_position(done as u64);
    };
    let baked = in_pool(threads, || bake(scene, options, &progress))?;
    bar.finish_and_clear();
    let baked = baked?;
    for warning in &baked.warnings {
        eprintln!("tracer: warning: {warning}");
    }
    let blocked = in_pool(threads, || blocked(scene, accel))??;
    if blocked.share > GHOSTLY {
        let percent = 100.0 * blocked.share;
        eprintln!(
            "tracer: warning: objects stand in the way of {percent:.0} % of the baked light, which goes through them: a bake has no shadows"
        );
    }
    Ok((baked, blocked))
}

/// The summary: coefficients, compression, error, time per stage.
fn table(baked: &Baked, blocked: &Blocked, bytes: u64, flight: Option<&Flight>) -> String {
    use std::fmt::Write as _;
    let mut out = String::new();
    let mut row = |what: &str, value: String| {
        let _ = writeln!(out, "{what:<24} {value}");
    };
    let share = |part: usize| 100.0 * part as f64 / baked.full.max(1) as f64;
    if baked.smooth.is_empty() {
        row("patches", baked.patches.len().to_string());
        row("coefficients, full basis", format!("{} × RGB", baked.full));
        row("  not zero", format!("{} ({:.1} %)", baked.before, share(baked.before)));
        row("  kept", format!("{} ({:.2} %)", baked.after, share(baked.after)));
        row("compression", format!("{:.2} % removed", 100.0 - share(baked.after)));
        row("file", super::bytes(bytes));
        let error = baked.transport_error.map_or("not estimated".to_owned(), |e| {
            format!("{:.3} % relative L2 of the incident radiance, estimated", 100.0 * e)
        });
        row("error of transport", error);
        row("error of compression", format!("{:.3} % relative L2", 100.0 * baked.dropped));
    } else {
        row("patches", format!("{}, smooth", baked.smooth.len()));
        if let Some(flight) = flight {
            let (name, margin, seen) = (flight.name(), flight.margin(), baked.seen);
            row("baked for", format!("animation {name} and {margin:.3} m around, {seen} seen"));
        }
        row("coefficients", format!("{} × RGB", baked.after));
        row("file", super::bytes(bytes));
        row("error of what is left out", format!("{:.3} % relative L2", 100.0 * baked.dropped));
    }
    let error = baked.error.map_or("not checked".to_owned(), |e| {
        format!("{:.2} % relative RMS against direct quadrature, sampled", 100.0 * e)
    });
    row("error when looked up", error);
    let Blocked { share, worst: (most, name) } = blocked;
    let through = match *most {
        0.0 => "none".to_owned(),
        most => format!(
            "{:.1} % of all, {:.0} % on {name}: bakes have no shadows",
            100.0 * share,
            100.0 * most
        ),
    };
    row("light through objects", through);
    for stage in Stage::ALL {
        let seconds = baked.times[stage as usize].as_secs_f64();
        row(&format!("time, {}", stage.name()), format!("{seconds:.3} s"));
    }
    let total: f64 = baked.times.iter().map(std::time::Duration::as_secs_f64).sum();
    row("time in all", format!("{total:.3} s"));
    out
}
