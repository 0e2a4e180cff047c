//! `tracer report`: every part measured, on one page.

mod bases;
mod budget;
mod compression;
mod estimates;
mod hard;
mod integrators;
mod interaction;
mod look_up;
mod picture;
mod transport;

use super::stdout::say;
use crate::bake::{Baked, bake, emissions, receivers};
use crate::cli;
use crate::report::{Page, Section, cpu_time, machine};
use crate::scene::Scene;
use crate::wct_texture::WctTexture;
use anyhow::{Context as _, bail};
use clap::Parser as _;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use wrt_core::transport::{BlockOptions, TransportGeometry, transport_block};
use wrt_core::{Grid, Levels, LobeMatrix, WctFile, reflect};

/// What sections measure, and how well.
struct Bench {
    /// Small pictures and few runs.
    quick: bool,
    scenes: PathBuf,
    output: PathBuf,
}

impl Bench {
    /// The first where there is little time.
    fn choose<T>(&self, quick: T, full: T) -> T {
        if self.quick { quick } else { full }
    }

    /// Runs of which a time is the median.
    fn runs(&self) -> usize {
        self.choose(3, 5)
    }

    fn scene(&self, path: &str) -> anyhow::Result<Scene> {
        let path = self.scenes.join(path);
        super::load(&path).with_context(|| {
            format!("{}: give the folder with the scenes by --scenes", path.display())
        })
    }
}

/// A section's name, and what measures it.
type Part = (&'static str, fn(&Bench) -> anyhow::Result<Section>);

const PARTS: [Part; 10] = [
    ("picture", picture::measure),
    ("bases", bases::measure),
    ("budget", budget::measure),
    ("estimates", estimates::measure),
    ("transport", transport::measure),
    ("integrators", integrators::measure),
    ("hard", hard::measure),
    ("interaction", interaction::measure),
    ("compression", compression::measure),
    ("look-up", look_up::measure),
];

/// Measures, and writes the page and its tables.
pub(crate) fn run(args: &cli::Everything) -> anyhow::Result<()> {
    let output = args.output.clone().unwrap_or_default();
    if let Some(unknown) = args.only.iter().find(|n| PARTS.iter().all(|part| part.0 != **n)) {
        let names: Vec<&str> = PARTS.iter().map(|part| part.0).collect();
        bail!("no section named \"{unknown}\"; there are: {}", names.join(", "));
    }
    fs::create_dir_all(&output).with_context(|| format!("cannot make {}", output.display()))?;
    let bench = Bench { quick: args.quick, scenes: args.scenes.clone(), output: output.clone() };
    let wanted = |part: &&Part| args.only.is_empty() || args.only.iter().any(|n| n == part.0);
    let parts: Vec<&Part> = PARTS.iter().filter(wanted).collect();
    let about = vec![
        format!("tracer {} on {}.", env!("CARGO_PKG_VERSION"), machine()),
        format!(
            "Times are CPU time, all threads together, medians of {} runs; the pale bars reach from the fastest to the slowest. Counts of work are the same on every machine. {}",
            bench.runs(),
            bench.choose("Made with --quick: smaller pictures, fewer rows.", "")
        ),
    ];
    let path = output.join("index.html");
    let mut page = Page { about, sections: Vec::new() };
    let bar = super::bar(parts.len() as u64, "measuring", "parts");
    for (name, measure) in parts {
        let section = measure(&bench).with_context(|| format!("measuring {name}"))?;
        save(&section, &output)?;
        page.sections.push(section);
        // All that there is so far: the next part may take many minutes.
        super::save(&path, &page.to_html())?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    say(path.display())?;
    Ok(())
}

/// Writes a section's tables and charts.
fn save(section: &Section, output: &Path) -> anyhow::Result<()> {
    for table in &section.tables {
        super::save(&output.join(format!("{}.csv", table.name)), &table.to_csv())?;
    }
    for (i, chart) in section.charts.iter().enumerate() {
        if let Some(svg) = chart.to_file() {
            super::save(&output.join(format!("{}-{}.svg", section.id, i + 1)), &svg)?;
        }
    }
    Ok(())
}

/// Radiance of the chapel's first glossy tile, from its first emitter.
struct GlossyTile {
    incident: Grid,
    outgoing: Grid,
}

impl GlossyTile {
    /// Cells of `level` along all four dimensions.
    fn at(bench: &Bench, level: u8) -> anyhow::Result<Self> {
        let scene = bench.scene("chapel/chapel.gltf")?;
        let levels = Levels::isotropic(level);
        let (polygon, emission) =
            emissions(&scene, Some(level + 1))?.into_iter().next().context("an emitter")?;
        let tiles = receivers(&scene, &mut Vec::new())?;
        let tile = tiles.iter().find(|t| t.phong.is_glossy()).context("a glossy receiver")?;
        let geometry = TransportGeometry::new(polygon, tile.polygon.clone());
        let incident = transport_block(&geometry, &emission, levels, BlockOptions::default())?;
        let lobe = LobeMatrix::phong(tile.phong.exponent, level, level);
        let outgoing = reflect(&incident, &tile.phong, Some(&lobe));
        Ok(Self { incident, outgoing })
    }
}

/// A bake, ready to be looked up.
struct Bake {
    texture: WctTexture,
    /// What it says of itself.
    error: Option<f64>,
    coefficients: u64,
    /// Of its file.
    bytes: u64,
    /// CPU seconds, projection to compression.
    seconds: f64,
}

/// Bakes with options as they are typed after `tracer bake`.
fn baked(scene: &Scene, flags: &[&str]) -> anyhow::Result<Bake> {
    let command = ["tracer", "bake", "scene", "-o", "file"];
    let args = cli::Args::try_parse_from(command.iter().chain(flags))?;
    let cli::Command::Bake(args) = args.command else { bail!("not a bake: {flags:?}") };
    let options = super::bake::options(&args.accuracy, false)?;
    let (baked, cost) = cpu_time(1, || bake(scene, &options, &|_, _| {}));
    let Baked { patches, smooth, error, after, .. } = baked?;
    let texture = WctTexture::bind(&patches, &smooth, scene)?;
    let file = WctFile {
        patches,
        smooth,
        generator: String::new(),
        input_hash: String::new(),
        options: BTreeMap::new(),
    };
    let bytes = file.to_bytes().len() as u64;
    Ok(Bake { texture, error, coefficients: after as u64, bytes, seconds: cost.median })
}

/// ‖a − b‖ / ‖b‖ from pairs.
fn relative_rms(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (error, size) = pairs.fold((0.0, 0.0), |(e, s), (a, b)| (e + (a - b).powi(2), s + b * b));
    if size > 0.0 { (error / size).sqrt() } else { 0.0 }
}
