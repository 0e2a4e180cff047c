//! One file per subcommand: open, call, report. The only files that print.

pub(crate) mod bake;
pub(crate) mod fly;
pub(crate) mod inspect;
pub(crate) mod render;
pub(crate) mod report_integrators;
pub(crate) mod transport;
mod view;

use crate::scene::{self, Scene};
use anyhow::Context as _;
use indicatif::{ProgressBar, ProgressStyle};
use std::path::Path;

/// Reads a scene and prints what it could not use of it.
fn load(path: &Path) -> anyhow::Result<Scene> {
    let loaded = scene::load(path)?;
    for warning in &loaded.warnings {
        eprintln!("tracer: warning: {}: {warning}", path.display());
    }
    Ok(loaded.scene)
}

/// Lights the scene's windows by the weather that the flags or the scene ask for.
fn light_windows(scene: &mut Scene, weather: &crate::cli::Weather) -> anyhow::Result<()> {
    if let Some(sky) = weather.sky()? {
        scene.sky = Some(sky);
    }
    scene::weather::light_windows(scene)
}

/// A progress bar on stderr, silent where that is no terminal.
fn bar(length: u64, what: &'static str, unit: &str) -> ProgressBar {
    let template =
        format!("{{msg:>9}} {{wide_bar}} {{pos}}/{{len}} {unit}  {{per_sec}}  {{eta}} left");
    let style =
        ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(length).with_style(style).with_message(what)
}

/// Runs `work` on a pool of so many threads; 0 is one per core.
fn with_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> anyhow::Result<T> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    Ok(pool.context("starting threads")?.install(work))
}
