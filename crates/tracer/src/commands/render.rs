//! `tracer render`: a scene and a `.wct` file to a picture.

use super::view::{Stage, named};
use crate::cli;
use crate::film::Format;
use crate::reference::Target;
use anyhow::Context as _;
use std::time::Instant;

/// Renders and prints what it took.
pub(crate) fn run(args: &cli::Render) -> anyhow::Result<()> {
    Format::of(&args.output)?;
    if args.reference.reference {
        return run_reference(args);
    }
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

/// Renders by sampling emitters, and prints the estimated error as well.
fn run_reference(args: &cli::Render) -> anyhow::Result<()> {
    let stage = Stage::without_radiance(&args.scene, &args.view)?;
    let camera = named(&stage.scene.cameras, args.camera.as_deref(), |c| &c.name, "camera")
        .with_context(|| format!("{}", args.scene.display()))?;
    let start = Instant::now();
    let (width, height) = stage.size(camera);
    let target = args.reference.error.map_or(Target::Samples(args.reference.spp), Target::Error);
    let bar = super::bar(0, "sampling", "rows");
    let (film, stats, estimate) = stage
        .render_reference(camera, target, &|| bar.inc(1))
        .with_context(|| format!("{}", args.scene.display()))?;
    bar.finish_and_clear();
    film.save(&args.output, stage.display())?;
    println!(
        "{}: {width}x{height}, camera {}, {} points a pixel, {:.2} million rays in {:.2} s, error {:.3} % relative RMS, estimated",
        args.output.display(),
        camera.name,
        estimate.points,
        stats.rays as f64 / 1e6,
        start.elapsed().as_secs_f64(),
        100.0 * estimate.relative
    );
    if let Some(wanted) = args.reference.error.filter(|wanted| estimate.relative > *wanted) {
        eprintln!(
            "tracer: warning: --error {wanted} is not reached with the most points there are"
        );
    }
    Ok(())
}
