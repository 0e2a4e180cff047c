//! `tracer fly`: the pictures of a camera's flight.

use super::view::{Stage, named};
use crate::cli;
use crate::film::Format;
use crate::scene::flight;
use anyhow::{Context as _, bail};
use std::path::PathBuf;
use std::time::Instant;

/// Renders the pictures that do not exist yet.
pub(crate) fn run(args: &cli::Fly) -> anyhow::Result<()> {
    let pattern = Pattern::of(&args.output)?;
    Format::of(&pattern.path(0))?;
    let stage = Stage::open(&args.scene, &args.view)?;
    let animations = &stage.scene.animations;
    let animation = named(animations, args.animation.as_deref(), |a| &a.name, "animation")
        .with_context(|| format!("{}", args.scene.display()))?;
    let times = flight::times(animation, args.fps);
    let last = times.len() - 1;
    let end = args.end.unwrap_or(last);
    if args.start > end || end > last {
        bail!("--start {} --end {end}: the flight has pictures 0 to {last}", args.start);
    }
    let start = Instant::now();
    let (mut rays, mut rendered) = (0, 0_u32);
    let bar = super::bar((end - args.start + 1) as u64, "flying", "pictures");
    for (i, time) in times.enumerate().skip(args.start).take(end - args.start + 1) {
        let path = pattern.path(i);
        if !path.exists() {
            let camera = flight::camera_at(animation, &stage.scene, time);
            let (film, stats) = stage.render(&camera, &|| {})?;
            film.save(&path, stage.display())?;
            rays += stats.rays;
            rendered += 1;
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let seconds = start.elapsed().as_secs_f64();
    println!(
        "{}: {rendered} pictures rendered, {} were there, {:.2} million rays in {seconds:.2} s, {:.2} s a picture",
        args.output,
        (end - args.start + 1) - rendered as usize,
        rays as f64 / 1e6,
        seconds / f64::from(rendered.max(1))
    );
    Ok(())
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
