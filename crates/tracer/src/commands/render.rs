//! `tracer render`: a scene and a `.wct` file to a picture.

use crate::accel::Accel;
use crate::cli;
use crate::film::{Display, Format, Tone};
use crate::render::{RenderOptions, render};
use crate::scene::{Camera, Scene};
use crate::wct_texture::WctTexture;
use anyhow::{Context as _, bail};
use glam::Vec3;
use std::time::Instant;
use wrt_core::WctFile;

/// Renders and prints what it took.
pub(crate) fn run(args: &cli::Render) -> anyhow::Result<()> {
    Format::of(&args.output)?;
    let scene = super::load(&args.scene)?;
    let camera = camera(&scene, args.camera.as_deref())
        .with_context(|| format!("{}", args.scene.display()))?;
    let texture = match &args.wct {
        Some(path) => WctFile::read(path)
            .map_err(anyhow::Error::from)
            .and_then(|file| WctTexture::bind(&file.patches, &scene))
            .with_context(|| format!("{}", path.display()))?,
        None => bake_in_memory(&scene, args)?,
    };
    let start = Instant::now();
    let accel = Accel::new(&scene);
    let (width, height) = args.size;
    let options = RenderOptions {
        width,
        height,
        samples: args.samples,
        max_depth: args.depth,
        emitter_grid: args.emitter_grid as usize,
        threads: args.threads,
        seed: args.seed,
        background: Vec3::ZERO,
    };
    let bar = super::bar(height as u64, "rendering", "rows");
    let progress = || bar.inc(1);
    let (film, stats) = render(&scene, &accel, Some(&texture), camera, &options, &progress)?;
    bar.finish_and_clear();
    let tone = match args.tone {
        cli::Tone::None => Tone::None,
        cli::Tone::Neutral => Tone::Neutral,
        cli::Tone::Agx => Tone::Agx,
    };
    film.save(&args.output, Display { exposure: args.exposure, tone })?;
    let seconds = start.elapsed().as_secs_f64();
    println!(
        "{}: {width}x{height}, camera {}, {} patches, {:.2} million rays in {seconds:.2} s",
        args.output.display(),
        camera.name,
        texture.len(),
        stats.rays as f64 / 1e6
    );
    Ok(())
}

fn bake_in_memory(scene: &Scene, args: &cli::Render) -> anyhow::Result<WctTexture> {
    eprintln!("tracer: no --wct given: baking at level {} in memory first", args.level);
    let accuracy = cli::Accuracy { level: args.level, ..cli::Accuracy::default() };
    let options = super::bake::options(&accuracy);
    let baked = super::bake::baked(scene, &options, args.threads)
        .with_context(|| format!("baking {}", args.scene.display()))?;
    WctTexture::bind(&baked.patches, scene)
}

/// The camera of that name, or the first.
fn camera<'a>(scene: &'a Scene, name: Option<&str>) -> anyhow::Result<&'a Camera> {
    let found = match name {
        Some(name) => scene.cameras.iter().find(|camera| camera.name == name),
        None => scene.cameras.first(),
    };
    if let Some(camera) = found {
        return Ok(camera);
    }
    let names: Vec<&str> = scene.cameras.iter().map(|camera| camera.name.as_str()).collect();
    bail!("no camera named \"{}\"; there are: {}", name.unwrap_or_default(), names.join(", "))
}
