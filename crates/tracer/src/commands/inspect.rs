//! `tracer inspect`: what a `.wct` file holds, and the paper's pictures of it.

mod matrix;
mod smooth;

use super::keep::{self, KEEP};
use super::stdout::say;
use crate::cli;
use crate::film::{Display, Format, Tone};
use anyhow::{Context as _, bail};
use matrix::{Directions, Mosaic, Picture};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use wrt_core::wct_file::{ChartKind, Side};
use wrt_core::{Levels, Patch, WctFile};

/// Reads, draws, and prints.
pub(crate) fn run(args: &cli::Inspect) -> anyhow::Result<()> {
    for picture in [&args.matrix, &args.detail].into_iter().flatten() {
        Format::of(picture)?;
    }
    let mut file =
        WctFile::read(&args.file).with_context(|| format!("reading {}", args.file.display()))?;
    if let Some(name) = &args.patch {
        let smooth = file.smooth.iter().map(|patch| patch.name.clone());
        let names: Vec<String> =
            file.patches.iter().map(|patch| patch.name.clone()).chain(smooth).collect();
        file.patches.retain(|patch| patch.name == *name);
        file.smooth.retain(|patch| patch.name == *name);
        if file.patches.is_empty() && file.smooth.is_empty() {
            let path = args.file.display();
            bail!("{path} has no patch \"{name}\"; it has {}", names.join(", "));
        }
    }
    let drawn = draw(args, &file)?;
    if args.json {
        say(format_args!("{:#}", json(&file, &drawn)))?;
    } else {
        say(table(&file).trim_end())?;
        for drawn in &drawn {
            say(drawn)?;
        }
    }
    Ok(())
}

/// A picture that has been written.
struct Drawn {
    path: PathBuf,
    patches: Vec<String>,
    size: [usize; 2],
    /// Of direction cells: the first, and how many.
    directions: Directions,
    levels: Levels,
    exposure: f32,
}

impl std::fmt::Display for Drawn {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { path, patches, size, levels, directions: [first, count], exposure } = self;
        let [last_kappa, last_lambda] = [0, 1].map(|i| first[i] + count[i] - 1);
        let of = match &patches[..] {
            [one] => one.clone(),
            many => format!("{} patches", many.len()),
        };
        write!(
            f,
            "{}: {}x{}, {} at levels {},{}, directions κ {}–{last_kappa}, λ {}–{last_lambda}, exposure {exposure:.2} stops",
            path.display(),
            size[0],
            size[1],
            of,
            levels.position,
            levels.direction,
            first[0],
            first[1],
        )
    }
}

fn draw(args: &cli::Inspect, file: &WctFile) -> anyhow::Result<Vec<Drawn>> {
    if args.matrix.is_none() && args.detail.is_none() {
        return Ok(Vec::new());
    }
    let smooth: Vec<Patch> = file.smooth.iter().map(smooth::drawn).collect();
    let mosaic = Mosaic::of(if smooth.is_empty() { &file.patches } else { &smooth })
        .with_context(|| format!("drawing {}: it has no patches", args.file.display()))?;
    let mut drawn = Vec::new();
    let mut save = |path: &Path, picture: Picture| {
        let exposure = args.exposure.unwrap_or_else(|| picture.exposure());
        let directions = picture.directions();
        let film = picture.into_film(exposure);
        film.save(path, Display { exposure, tone: Tone::None })?;
        let patches = mosaic.patches().map(|patch| patch.name.clone()).collect();
        let (size, levels) = ([film.width, film.height], mosaic.levels());
        drawn.push(Drawn { path: path.to_owned(), patches, size, levels, directions, exposure });
        anyhow::Ok(())
    };
    if let Some(path) = &args.matrix {
        save(path, mosaic.matrix())?;
    }
    if let Some(path) = &args.detail {
        save(path, mosaic.detail())?;
    }
    Ok(drawn)
}

/// Coefficients that the full basis would have.
fn full(patch: &Patch) -> f64 {
    let levels = patch.tree.levels();
    levels.positions() as f64 * levels.directions() as f64
}

/// Bytes of its sections.
fn bytes(patch: &Patch) -> usize {
    let raw = 4 * patch.tree.nodes().len() + 12 * patch.tree.coefficients().len();
    patch.tree.code().map_or(raw, <[u8]>::len)
}

fn side(patch: &Patch) -> &'static str {
    match patch.side {
        Side::Incident => "incident",
        Side::Outgoing => "outgoing",
    }
}

fn levels(levels: Levels) -> Value {
    json!({ "position": levels.position, "direction": levels.direction })
}

fn json(file: &WctFile, drawn: &[Drawn]) -> Value {
    let patch = |patch: &Patch| {
        let tree = &patch.tree;
        json!({
            "name": patch.name,
            "side": side(patch),
            "chart": match patch.polygon.chart {
                ChartKind::Rectilinear => "rectilinear",
                ChartKind::RectilinearQuad => "rectilinear quad",
                ChartKind::Perspective => "perspective",
                ChartKind::Bilinear => "bilinear",
            },
            "vertices": patch.polygon.vertices,
            "levels": levels(tree.levels()),
            "nodes": tree.nodes().len(),
            "coefficients": tree.len(),
            "kept": tree.len() as f64 / full(patch),
            "bytes": bytes(patch),
            "storage": if tree.code().is_some() { "quantised" } else { "raw" },
            "relative_error": patch.relative_error,
            "largest_error": tree.largest_error(),
            "error_estimate": patch.error_estimate,
            "energy": tree.norm_squared(),
            // E = 4 ∬ L dκ dλ, Eq. 12.
            "mean_irradiance": tree.root().map(|b| 4.0 * b),
        })
    };
    let picture = |drawn: &Drawn| {
        json!({
            "file": drawn.path,
            "patches": drawn.patches,
            "size": drawn.size,
            "levels": levels(drawn.levels),
            "first_direction": drawn.directions[0],
            "directions": drawn.directions[1],
            "exposure": drawn.exposure,
        })
    };
    json!({
        "generator": file.generator,
        "input_hash": file.input_hash,
        "options": in_words(&file.options),
        "patches": file.patches.iter().map(patch).collect::<Vec<_>>(),
        "smooth_patches": file.smooth.iter().map(smooth::json).collect::<Vec<_>>(),
        "pictures": drawn.iter().map(picture).collect::<Vec<_>>(),
    })
}

fn table(file: &WctFile) -> String {
    let mut rows = vec![
        [
            "patch",
            "side",
            "levels",
            "nodes",
            "coefficients",
            "kept",
            "bytes",
            "dropped",
            "error",
            "energy",
        ]
        .map(str::to_owned)
        .to_vec(),
    ];
    let percent = |x: f64, digits: usize| format!("{:.digits$} %", 100.0 * x);
    let row = |name: &str, side: &str, levels: String, patches: &[Patch]| {
        let sum = |of: fn(&Patch) -> f64| patches.iter().map(of).sum::<f64>();
        let energy = sum(|patch| patch.tree.norm_squared());
        let coefficients = sum(|patch| patch.tree.len() as f64);
        // Relative errors add up weighted by energy.
        let error = |of: &dyn Fn(&Patch) -> Option<f64>| -> Option<f64> {
            let squares = patches.iter().map(|p| Some(of(p)?.powi(2) * p.tree.norm_squared()));
            let sum: f64 = squares.sum::<Option<f64>>()?;
            Some(if energy > 0.0 { (sum / energy).sqrt() } else { 0.0 })
        };
        vec![
            name.to_owned(),
            side.to_owned(),
            levels,
            sum(|patch| patch.tree.nodes().len() as f64).to_string(),
            coefficients.to_string(),
            percent(coefficients / sum(full), 2),
            sum(|patch| bytes(patch) as f64).to_string(),
            error(&|patch| Some(patch.relative_error)).map_or("-".to_owned(), |e| percent(e, 3)),
            error(&|patch| patch.error_estimate).map_or("-".to_owned(), |e| percent(e, 2)),
            format!("{energy:.4e}"),
        ]
    };
    for patch in &file.patches {
        let levels = patch.tree.levels();
        let levels = format!("{},{}", levels.position, levels.direction);
        rows.push(row(&patch.name, side(patch), levels, std::slice::from_ref(patch)));
    }
    if file.patches.len() > 1 {
        rows.push(row("all", "", String::new(), &file.patches));
    }
    let mut out = String::new();
    let options = in_words(&file.options);
    for (what, value) in [("generator", &file.generator), ("input hash", &file.input_hash)]
        .into_iter()
        .chain(options.iter().map(|(key, value)| (key.as_str(), value)))
    {
        out += &format!("{what:<12}  {value}\n");
    }
    if !file.patches.is_empty() || file.smooth.is_empty() {
        out += &aligned(&rows);
    }
    if !file.smooth.is_empty() {
        out += &aligned(&smooth::rows(&file.smooth));
    }
    out
}

/// The options of a file, as the program writes them now.
fn in_words(options: &BTreeMap<String, String>) -> BTreeMap<String, String> {
    let words = |(name, said): (&String, &String)| {
        let said = if name == KEEP { keep::in_words(said) } else { said.clone() };
        (name.clone(), said)
    };
    options.iter().map(words).collect()
}

/// Columns of equal width, the first two to the left.
fn aligned(rows: &[Vec<String>]) -> String {
    let columns = rows.first().map_or(0, Vec::len);
    let width = |c: usize| rows.iter().map(|row| row[c].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut out = String::new();
    for row in rows {
        let cells = row.iter().zip(&widths).enumerate().map(|(c, (cell, &width))| {
            if c < 2 { format!("{cell:<width$}") } else { format!("{cell:>width$}") }
        });
        out += cells.collect::<Vec<_>>().join("  ").trim_end();
        out += "\n";
    }
    out
}
