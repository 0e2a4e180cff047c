//! One file per subcommand: open, call, report. The only files that print.

pub(crate) mod bake;
pub(crate) mod compare;
pub(crate) mod convert;
pub(crate) mod fly;
pub(crate) mod inspect;
mod interrupt;
pub(crate) mod render;
pub(crate) mod report;
pub(crate) mod report_integrators;
pub(crate) mod report_oracle;
pub(crate) mod report_rays;
mod stdout;
pub(crate) mod transport;
mod video;
mod view;

pub(crate) use stdout::Closed;

use crate::scene::{self, Scene};
use anyhow::Context as _;
use indicatif::{ProgressBar, ProgressStyle};
use std::path::Path;
use wrt_core::wct_file::write_aside;

/// Reads a scene and prints what it could not use of it.
fn load(path: &Path) -> anyhow::Result<Scene> {
    let loaded = scene::load(path)?;
    for warning in &loaded.warnings {
        eprintln!("tracer: warning: {}: {warning}", path.display());
    }
    Ok(loaded.scene)
}

/// Which windows and floors a file was baked from, among the options in it.
const SCENE: &str = "scene";

/// What weather a file was baked under, among the options in it.
const SKY: &str = "sky";

/// Which animation a file was baked for, among the options in it, and with what margin in
/// metres.
const ANIMATION: &str = "animation";
const MARGIN: &str = "animation_margin";

/// Lights the scene's windows by the weather that the flags or the scene ask for.
fn light_windows(scene: &mut Scene, weather: &crate::cli::Weather) -> anyhow::Result<()> {
    if let Some(sky) = weather.sky()? {
        scene.sky = Some(sky);
    }
    scene::weather::light_windows(scene)
}

/// A progress bar on stderr, silent where that is no terminal.
fn bar(length: u64, what: &'static str, unit: &str) -> ProgressBar {
    let template = format!(
        "{{msg:>14}} {{spinner}} {{wide_bar}} {{pos}}/{{len}} {unit}  {{per_sec}}  {{elapsed}}, {{eta}} left"
    );
    let style =
        ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = ProgressBar::new(length).with_style(style).with_message(what);
    // A polished patch can take half a minute.
    bar.enable_steady_tick(std::time::Duration::from_millis(200));
    bar
}

/// A size for people to read: 1.2 kB, 0.87 MB.
fn bytes(count: u64) -> String {
    match count {
        0..1000 => format!("{count} bytes"),
        1000..100_000 => format!("{:.1} kB", count as f64 / 1e3),
        _ => format!("{:.2} MB", count as f64 / 1e6),
    }
}

/// Writes `text` whole or not at all.
fn save(path: &Path, text: &str) -> anyhow::Result<()> {
    write_aside(path, text.as_bytes()).with_context(|| format!("cannot write {}", path.display()))
}
