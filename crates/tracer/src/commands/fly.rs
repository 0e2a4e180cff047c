//! `tracer fly`: the pictures of a camera's flight, among what moves meanwhile.

use super::count;
use super::stdout::say;
use super::video;
use super::view::{Meter, Stage, crop, named, partial};
use crate::cli;
use crate::film::Format;
use crate::scene::{Animation, Scene, flight};
use anyhow::{Context as _, bail, ensure};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Renders the pictures that do not exist yet.
pub(crate) fn run(args: &cli::Fly) -> anyhow::Result<()> {
    let pattern = Pattern::of(&args.output)?;
    let format = Format::of(&pattern.path(0))?;
    if let Some(video) = &args.video {
        ensure!(format == Format::Png, "--video needs pictures that are .png");
        check_video(video, &pattern, args)?;
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
    check_there(&stage, &animation, format, &there, (columns, rows))?;
    let bar = super::bar((missing.len() * rows) as u64, "flying", "rows");
    let meter = Meter::start();
    let mut rendered = 0;
    let mut begun = None;
    for (path, time) in &missing {
        stage.pose(&animation, *time).with_context(|| format!("{}", args.scene.display()))?;
        let camera = flight::camera_at(&animation, &stage.scene, *time);
        let picture = stage.render(&camera, format, &|rays| {
            meter.count(rays, &bar);
            bar.inc(1);
        })?;
        if !picture.is_whole() {
            begun = Some(picture.save_partial(path, stage.display())?);
            break;
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
    let left = missing.len() - rendered;
    if let Some(path) = args.video.as_ref().filter(|_| left == 0) {
        let frames: Vec<PathBuf> = wanted.iter().map(|(path, _)| path.clone()).collect();
        video::write(path, &frames, args.fps)?;
    }
    let each = meter.seconds() / rendered.max(1) as f64;
    if args.view.json {
        let mut fields = meter.fields();
        fields["output"] = json!(args.output);
        fields["animation"] = json!(animation.name);
        fields["size"] = json!(size);
        fields["rendered"] = json!(rendered);
        fields["skipped"] = json!(there.len());
        fields["left"] = json!(left);
        fields["interrupted"] = json!(left > 0);
        fields["seconds_a_picture"] = json!(each);
        say(fields)?;
    }
    if left > 0 {
        let begun = begun.map(|path| format!(", of which {} is begun", path.display()));
        bail!(
            "stopped with {} rendered and {left} left{}; run the command again to go on",
            count(rendered, "picture"),
            begun.unwrap_or_default()
        );
    }
    if args.view.json {
        return Ok(());
    }
    say(format_args!(
        "{}: {} rendered, {} {} there, {:.2} million rays in {:.2} s, {each:.2} s a picture",
        args.output,
        count(rendered, "picture"),
        there.len(),
        if there.len() == 1 { "was" } else { "were" },
        meter.million_rays(),
        meter.seconds(),
    ))?;
    Ok(())
}

/// Whether `path` names an animated PNG that can be written.
///
/// # Errors
///
/// If it does not, with the command that makes what it names of the pictures.
fn check_video(path: &Path, pattern: &Pattern, args: &cli::Fly) -> anyhow::Result<()> {
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    if extension == "png" {
        return Format::of(path).map(|_| ());
    }
    let Pattern { before, digits, after } = pattern;
    let cli::Fly { fps, start, .. } = args;
    ensure!(
        extension == "apng",
        "--video {0}: what is written is an animated PNG: name it .png or .apng. ffmpeg makes other films of the pictures: ffmpeg -framerate {fps} -start_number {start} -i {before}%0{digits}d{after} {0}",
        path.display()
    );
    // It is for its folder that is looked.
    Format::of(&path.with_extension("png")).map(|_| ())
}

/// Finds out whether the pictures that are `there` can stay, and warns of such as do not say
/// how they were made.
///
/// # Errors
///
/// If one is of another size or was made with other settings, or cannot be read; by name.
fn check_there(
    stage: &Stage<'_>,
    animation: &Animation,
    format: Format,
    there: &[&(PathBuf, f64)],
    (columns, rows): (usize, usize),
) -> anyhow::Result<()> {
    let camera = &stage.scene.cameras[animation.camera];
    let mut silent = Vec::new();
    for (path, time) in there {
        let name = path.display();
        let found = format.size_of(path).with_context(|| format!("{name}"))?;
        ensure!(
            found == (columns, rows),
            "{name}: it is there already, {}x{} pixels where {columns}x{rows} are wanted: remove it, or name the pictures otherwise",
            found.0,
            found.1
        );
        let found = format.settings_of(path).with_context(|| format!("{name}"))?;
        let Some(found) = found.and_then(|found| serde_json::from_str(&found).ok()) else {
            silent.push(path);
            continue;
        };
        let moment = (animation.name.clone(), *time);
        let differences = differences(&found, &stage.settings(camera, format, Some(&moment)));
        ensure!(
            differences.is_empty(),
            "{name}: it is there already, made with other settings ({}): remove it, or name the pictures otherwise",
            differences.join("; ")
        );
    }
    if let Some(first) = silent.first() {
        let more = match silent.len() - 1 {
            0 => String::new(),
            n => format!(", like {n} more"),
        };
        eprintln!(
            "tracer: warning: {}: it does not say how it was made, and is left as it is{more}",
            first.display()
        );
    }
    Ok(())
}

/// In which settings a picture that was `found` is not as `wanted`.
fn differences(found: &Value, wanted: &Value) -> Vec<String> {
    // Numbers as they are read, to the last bit.
    let wanted: Value = serde_json::from_str(&wanted.to_string()).unwrap_or_default();
    let different = |(name, value): (&String, &Value)| {
        let found = found.get(name).unwrap_or(&Value::Null);
        // A hash means nothing to who reads it: that it is not the same is all there is to say.
        let words = match name.strip_suffix("_content") {
            Some(file) => format!("another content of the {file}"),
            None => format!("{name} {found}, not {value}"),
        };
        (found != value).then_some(words)
    };
    wanted.as_object().into_iter().flatten().filter_map(different).collect()
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
