//! `tracer render`: a scene and a `.wct` file to a picture.

use super::view::{Stage, named};
use crate::cli;
use crate::film::Format;
use anyhow::Context as _;
use std::time::Instant;

/// Renders and prints what it took.
pub(crate) fn run(args: &cli::Render) -> anyhow::Result<()> {
    Format::of(&args.output)?;
    let stage = Stage::open(&args.scene, &args.view)?;
    let camera = named(&stage.scene.cameras, args.camera.as_deref(), |c| &c.name, "camera")
        .with_context(|| format!("{}", args.scene.display()))?;
    let start = Instant::now();
    let (width, height) = stage.size(camera);
    let bar = super::bar(height as u64, "rendering", "rows");
    let (film, stats) = stage.render(camera, &|| bar.inc(1))?;
    bar.finish_and_clear();
    film.save(&args.output, stage.display())?;
    println!(
        "{}: {width}x{height}, camera {}, {} patches, {:.2} million rays in {:.2} s",
        args.output.display(),
        camera.name,
        stage.patches(),
        stats.rays as f64 / 1e6,
        start.elapsed().as_secs_f64()
    );
    Ok(())
}
