//! `tracer fly`: the pictures of a camera's flight, among what moves meanwhile.

use super::stdout::say;
use super::video;
use super::view::{Meter, Stage, crop, named, partial};
use crate::cli;
use crate::film::Format;
use crate::scene::{Animation, Scene, flight};
use anyhow::{Context as _, bail, ensure};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Renders the pictures that do not exist yet.
pub(crate) fn run(args: &cli::Fly) -> anyhow::Result<()> {
    let pattern = Pattern::of(&args.output)?;
    let format = Format::of(&pattern.path(0))?;
    if let Some(video) = &args.video {
        ensure!(format == Format::Png, "--video needs pictures that are .png");
        let extension = video.extension().unwrap_or_default().to_ascii_lowercase();
        ensure!(
            extension == "png" || extension == "apng",
            "{}: an animated PNG is named .png or .apng; for another kind see `tracer fly --help`",
            video.display()
        );
        // Before the work: is its folder there?
        Format::of(&video.with_extension("png"))?;
    }
    let mut stage = Stage::open(&args.scene, &args.view, |scene| {
        let animation = animation(scene, args)?;
        crop(&args.view, &scene.cameras[animation.camera]).map(|_| ())
    })?;
    let animation =
        animation(&stage.scene, args).with_context(|| format!("{}", args.scene.display()))?;
    let animation = animation.clone();
    stage.let_move(&animation);
    let times = flight::times(&animation, args.fps);
    let last = times.len() - 1;
    let end = args.end.unwrap_or(last);
    if args.start > end || end > last {
        bail!("--start {} --end {end}: the flight has pictures 0 to {last}", args.start);
    }
    let size = stage.size(&stage.scene.cameras[animation.camera]);
    let (_, height) = size;
    let rows = args.view.crop.map_or(height, |[_, y0, _, y1]| y1 - y0);
    let wanted: Vec<(PathBuf, f64)> = times
        .enumerate()
        .take(end + 1)
        .skip(args.start)
        .map(|(i, t)| (pattern.path(i), t))
        .collect();
    if let Some(video) = &args.video {
        let is_picture = wanted.iter().any(|(path, _)| path == video);
        ensure!(!is_picture, "--video {}: that is one of the pictures", video.display());
    }
    let (there, missing): (Vec<_>, Vec<_>) = wanted.iter().partition(|(path, _)| path.exists());
    let columns = args.view.crop.map_or(size.0, |[x0, _, x1, _]| x1 - x0);
    keep(&stage, &animation, format, &there, (columns, rows))?;
    let told = |meter: &Meter, rendered: usize, is_whole: bool| {
        let mut fields = meter.fields();
        fields["output"] = json!(args.output);
        fields["animation"] = json!(animation.name);
        fields["size"] = json!(size);
        fields["rendered"] = json!(rendered);
        fields["skipped"] = json!(there.len());
        fields["seconds_a_picture"] = json!(meter.seconds() / rendered.max(1) as f64);
        fields["interrupted"] = json!(!is_whole);
        say(fields)
    };
    let bar = super::bar((missing.len() * rows) as u64, "flying", "rows");
    let meter = Meter::start();
    let mut rendered = 0;
    for (path, time) in &missing {
        stage.pose(&animation, *time).with_context(|| format!("{}", args.scene.display()))?;
        let camera = flight::camera_at(&animation, &stage.scene, *time);
        let picture = stage.render(&camera, format, &|rays| {
            meter.count(rays, &bar);
            bar.inc(1);
        })?;
        if !picture.is_whole() {
            let partial = picture.save_partial(path, stage.display())?;
            bar.finish_and_clear();
            if args.view.json {
                told(&meter, rendered, false)?;
            }
            bail!(
                "stopped with {rendered} pictures rendered and {} left, of which {} is begun; run the command again to go on",
                missing.len() - rendered,
                partial.display()
            );
        }
        picture.save(path, stage.display())?;
        // Of a flight that was stopped in it.
        let _ = std::fs::remove_file(partial(path));
        rendered += 1;
        if stage.is_stopped() {
            break;
        }
    }
    bar.finish_and_clear();
    if rendered < missing.len() {
        if args.view.json {
            told(&meter, rendered, false)?;
        }
        bail!(
            "stopped with {rendered} pictures rendered and {} left; run the command again to go on",
            missing.len() - rendered
        );
    }
    if let Some(path) = &args.video {
        let frames: Vec<PathBuf> = wanted.iter().map(|(path, _)| path.clone()).collect();
        video::write(path, &frames, args.fps)?;
    }
    if args.view.json {
        return told(&meter, rendered, true);
    }
    let each = meter.seconds() / rendered.max(1) as f64;
    say(format_args!(
        "{}: {rendered} pictures rendered, {} were there, {:.2} million rays in {:.2} s, {each:.2} s a picture",
        args.output,
        there.len(),
        meter.million_rays(),
        meter.seconds(),
    ))?;
    Ok(())
}

/// Finds out whether the pictures that are `there` can stay.
///
/// # Errors
///
/// If one is of another size or says that it was made with other settings.
fn keep(
    stage: &Stage<'_>,
    animation: &Animation,
    format: Format,
    there: &[&(PathBuf, f64)],
    (columns, rows): (usize, usize),
) -> anyhow::Result<()> {
    let camera = &stage.scene.cameras[animation.camera];
    let mut is_silent = false;
    for (path, time) in there {
        let name = path.display();
        let found = format.size_of(path).with_context(|| format!("{name}"))?;
        ensure!(
            found == (columns, rows),
            "{name}: it is there already, {}x{} pixels where {columns}x{rows} are wanted: remove it, or name the pictures otherwise",
            found.0,
            found.1
        );
        let moment = (animation.name.clone(), *time);
        let own = stage.settings(camera, format, Some(&moment));
        let wanted = own.to_string();
        match format.settings_of(path).with_context(|| format!("{name}"))? {
            None => is_silent = true,
            Some(found) => ensure!(
                found == wanted,
                "{name}: it is there already, made with other settings{}: remove it, or name the pictures otherwise",
                difference(&found, &own)
            ),
        }
    }
    if is_silent {
        eprintln!(
            "tracer: warning: some pictures that are there do not say how they were made, and are left as they are"
        );
    }
    Ok(())
}

/// What of the settings of a picture is not as wanted, in brackets.
fn difference(found: &str, wanted: &Value) -> String {
    let Ok(Value::Object(found)) = serde_json::from_str(found) else { return String::new() };
    let differs = |(key, wanted): (&String, &Value)| {
        let found = found.get(key).unwrap_or(&Value::Null);
        (found != wanted).then(|| format!("{key} {found}, not {wanted}"))
    };
    let all: Vec<String> = wanted.as_object().into_iter().flatten().filter_map(differs).collect();
    if all.is_empty() { String::new() } else { format!(" ({})", all.join("; ")) }
}

/// The animation of the wanted name that the wanted camera sees.
fn animation<'a>(scene: &'a Scene, args: &cli::Fly) -> anyhow::Result<&'a Animation> {
    let all = &scene.animations;
    let camera_of = |a: &Animation| scene.cameras[a.camera].name.clone();
    let Some(camera) = &args.camera else {
        return named(all, args.animation.as_deref(), |a| &a.name, "animation");
    };
    let of_camera: Vec<&Animation> = all.iter().filter(|a| camera_of(a) == *camera).collect();
    ensure!(
        !of_camera.is_empty(),
        "no animation has to do with a camera named {camera:?}; there are: {}",
        all.iter().map(camera_of).collect::<Vec<_>>().join(", ")
    );
    named(&of_camera, args.animation.as_deref(), |a| &a.name, "animation").copied()
}

/// A file name with a row of # for the picture's number.
struct Pattern {
    before: String,
    digits: usize,
    after: String,
}

impl Pattern {
    fn of(text: &str) -> anyhow::Result<Self> {
        let digits = text.matches('#').count();
        match text.split_once(&"#".repeat(digits)) {
            Some((before, after)) if digits > 0 => {
                Ok(Self { before: before.to_owned(), digits, after: after.to_owned() })
            }
            _ => bail!("{text}: put one row of # where the number goes, such as frame.####.png"),
        }
    }

    fn path(&self, number: usize) -> PathBuf {
        format!("{}{number:0width$}{}", self.before, self.after, width = self.digits).into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_padded_to_the_row() {
        let pattern = Pattern::of("out/frame.####.png").expect("a row of #");
        assert_eq!(pattern.path(7), PathBuf::from("out/frame.0007.png"));
        assert_eq!(pattern.path(12_345), PathBuf::from("out/frame.12345.png"));
    }

    #[test]
    fn a_pattern_without_one_row_is_refused() {
        assert!(Pattern::of("frame.png").is_err(), "no #");
        assert!(Pattern::of("a#b#.png").is_err(), "two rows");
    }
}
