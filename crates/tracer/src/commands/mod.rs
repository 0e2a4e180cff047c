//! One file per subcommand: open, call, report. The only files that print.

pub(crate) mod bake;
pub(crate) mod compare;
pub(crate) mod convert;
pub(crate) mod fly;
pub(crate) mod inspect;
mod interrupt;
mod keep;
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

use crate::scene::{self, Loaded, Scene};
use anyhow::Context as _;
use indicatif::{ProgressBar, ProgressStyle};
use std::path::Path;
use wrt_core::wct_file::write_aside;

/// Reads a scene and prints what it could not use of it.
fn load(path: &Path) -> anyhow::Result<Scene> {
    load_all(path).map(|loaded| loaded.scene)
}

/// The same, with the files that it was read from.
fn load_all(path: &Path) -> anyhow::Result<Loaded> {
    let loaded = scene::load(path)?;
    for warning in &loaded.warnings {
        eprintln!("tracer: warning: {}: {warning}", path.display());
    }
    Ok(loaded)
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

/// So many of what has a plural in -s.
fn count(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}

/// A size for people to read: 1.2 kB, 0.87 MB.
fn bytes(n: u64) -> String {
    match n {
        0..1000 => count(n as usize, "byte"),
        1000..100_000 => format!("{:.1} kB", n as f64 / 1e3),
        _ => format!("{:.2} MB", n as f64 / 1e6),
    }
}

/// Writes `text` whole or not at all.
fn save(path: &Path, text: &str) -> anyhow::Result<()> {
    write_aside(path, text.as_bytes()).with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_have_a_digit_to_show() {
        for (n, expected) in [
            (0, "0 bytes"),
            (1, "1 byte"),
            (999, "999 bytes"),
            (1000, "1.0 kB"),
            (4321, "4.3 kB"),
            (466_200, "0.47 MB"),
            (8_930_000, "8.93 MB"),
        ] {
            assert_eq!(bytes(n), expected);
        }
    }
}
