//! `tracer render`: a scene and a `.wct` file to a picture.

use super::count;
use super::stdout::say;
use super::view::{Meter, Picture, Stage, crop, named};
use crate::cli;
use crate::film::Format;
use crate::reference::{Estimate, Target};
use crate::scene::{Camera, Scene};
use anyhow::{Context as _, bail, ensure};
use serde_json::{Value, json};

/// Renders and prints what it took.
pub(crate) fn run(args: &cli::Render) -> anyhow::Result<()> {
    let format = Format::of(&args.output)?;
    if args.reference.reference {
        return run_reference(args, format);
    }
    let stage = Stage::open(&args.scene, &args.view, |scene| check(scene, args))?;
    let camera = named(&stage.scene.cameras, args.camera.as_deref(), |c| &c.name, "camera")
        .with_context(|| format!("{}", args.scene.display()))?;
    let (width, height) = stage.size(camera);
    let rows = args.view.crop.map_or(height, |[_, y0, _, y1]| y1 - y0);
    let bar = super::bar(rows as u64, "rendering", "rows");
    let meter = Meter::start();
    let picture = stage.render(camera, format, &|rays| {
        meter.count(rays, &bar);
        bar.inc(1);
    })?;
    bar.finish_and_clear();
    if !picture.is_whole() {
        let partial = picture.save_partial(&args.output, stage.display())?;
        let left = picture.stats.rows_left;
        bail!("{}: stopped with {left} of {rows} rows left, which are black", partial.display());
    }
    picture.save(&args.output, stage.display())?;
    let output = args.output.display();
    if args.view.json {
        let mut fields = told(args, &meter, camera, &picture, (width, height));
        fields["patches"] = json!(stage.patches());
        say(fields)?;
        return Ok(());
    }
    say(format_args!(
        "{output}: {width}x{height}, camera {}, {} {}, {:.2} million rays in {:.2} s",
        camera.name,
        stage.patches(),
        if stage.patches() == 1 { "patch" } else { "patches" },
        meter.million_rays(),
        meter.seconds()
    ))?;
    Ok(())
}

/// What `--json` tells of any picture.
fn told(
    args: &cli::Render,
    meter: &Meter,
    camera: &Camera,
    picture: &Picture,
    size: (usize, usize),
) -> Value {
    let mut fields = meter.fields();
    fields["output"] = json!(args.output.display().to_string());
    fields["camera"] = json!(camera.name);
    fields["size"] = json!(size);
    fields["samples"] = json!(picture.stats.samples);
    fields
}

/// Whether the camera and the crop are there.
fn check(scene: &Scene, args: &cli::Render) -> anyhow::Result<()> {
    let camera = named(&scene.cameras, args.camera.as_deref(), |c| &c.name, "camera")?;
    crop(&args.view, camera).map(|_| ())
}

/// Renders by sampling emitters, and prints the estimated error as well.
fn run_reference(args: &cli::Render, format: Format) -> anyhow::Result<()> {
    ensure!(args.view.noise.is_none(), "--noise is not for --reference: use --error");
    let stage = Stage::without_radiance(&args.scene, &args.view, |scene| check(scene, args))?;
    let camera = named(&stage.scene.cameras, args.camera.as_deref(), |c| &c.name, "camera")
        .with_context(|| format!("{}", args.scene.display()))?;
    let meter = Meter::start();
    let (width, height) = stage.size(camera);
    let target = args.reference.error.map_or(Target::Samples(args.reference.spp), Target::Error);
    let bar = super::bar(0, "sampling", "rows");
    let (picture, estimate) = stage
        .render_reference(camera, target, format, &|rays| {
            meter.count(rays, &bar);
            bar.inc(1);
        })
        .with_context(|| format!("{}", args.scene.display()))?;
    bar.finish_and_clear();
    if !picture.is_whole() {
        let partial = picture.save_partial(&args.output, stage.display())?;
        bail!("{}: stopped before its end: too dark in places", partial.display());
    }
    picture.save(&args.output, stage.display())?;
    let output = args.output.display();
    if args.view.json {
        let mut fields = told(args, &meter, camera, &picture, (width, height));
        fields["points"] = json!(estimate.points);
        fields["error"] = json!(estimate.relative());
        fields["error_of_points"] = json!(estimate.emitters);
        fields["error_of_camera_rays"] = json!(estimate.rays);
        say(fields)?;
    } else {
        let percent = |x: f64| format!("{:.3} %", 100.0 * x);
        let known = |x: Option<f64>| x.map_or_else(|| "not known".to_owned(), percent);
        say(format_args!(
            "{output}: {width}x{height}, camera {}, {} points a pixel, {:.2} million rays in {:.2} s, error {} relative RMS, estimated: of points {}, of camera rays {}",
            camera.name,
            estimate.points,
            picture.stats.rays as f64 / 1e6,
            meter.seconds(),
            known(estimate.relative()),
            percent(estimate.emitters),
            known(estimate.rays),
        ))?;
    }
    if let Some(wanted) = args.reference.error {
        warn_of_error(&estimate, wanted);
    }
    Ok(())
}

/// Says what keeps the error above what is wanted.
fn warn_of_error(estimate: &Estimate, wanted: f64) {
    let Estimate { samples, emitters, rays, .. } = *estimate;
    let Some(rays) = rays else {
        eprintln!("tracer: warning: stopped before the error of the camera rays was estimated");
        return;
    };
    if emitters.hypot(rays) <= wanted {
        return;
    }
    let why = if rays <= emitters {
        "with the most points there are".to_owned()
    } else if samples >= cli::MOST_SAMPLES {
        "with the most camera rays there are".to_owned()
    } else {
        let more = estimate.samples_for(wanted).clamp(samples + 1, cli::MOST_SAMPLES);
        let (taken, percent) = (count(samples as usize, "camera ray"), 100.0 * rays);
        format!("with {taken} a pixel, of which {percent:.3} % is: try --samples {more}")
    };
    eprintln!("tracer: warning: --error {wanted} is not reached {why}");
}
