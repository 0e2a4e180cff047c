//! `tracer compare`: how far apart two pictures are, in numbers and to the eye.

use super::stdout::say;
use super::view;
use crate::cli;
use crate::film::{Display, Film, Format, Tone};
use crate::flip::{PIXELS_PER_DEGREE, flip};
use anyhow::bail;
use glam::Vec3;
use serde_json::json;
use std::path::Path;

/// Reads, compares, prints.
pub(crate) fn run(args: &cli::Compare) -> anyhow::Result<()> {
    if let Some(output) = &args.output {
        Format::of(output)?;
    }
    let (test, reference) = (Film::open(&args.test)?, Film::open(&args.reference)?);
    let sizes = [&test, &reference].map(|film| [film.width, film.height]);
    if sizes[0] != sizes[1] {
        let [[w, h], [of_w, of_h]] = sizes;
        let [test, reference] = [&args.test, &args.reference].map(|path| path.display());
        bail!("{test} is {w} x {h} pixels and {reference} {of_w} x {of_h}: give two of one size");
    }
    let display = |path: &Path| match Format::of(path) {
        Ok(Format::Exr) => view::display(args.exposure, args.tone),
        _ => Display { exposure: 0.0, tone: Tone::None },
    };
    let shown =
        [test.displayed(display(&args.test)), reference.displayed(display(&args.reference))];
    let density = args.density.unwrap_or(PIXELS_PER_DEGREE);
    let map = flip(&shown[0], &shown[1], reference.width, density);
    let mean = map.iter().map(|x| f64::from(*x)).sum::<f64>() / map.len().max(1) as f64;
    let worst = map.iter().copied().fold(0.0, f32::max);
    let [rms, mse] = linear(&test, &reference);
    if let Some(output) = &args.output {
        let Film { width, height, .. } = reference;
        let film = Film { width, height, pixels: map.iter().map(|&x| colour(x)).collect() };
        film.save(output, Display { exposure: 0.0, tone: Tone::None })?;
    }
    if args.json {
        let found = json!({
            "flip": mean, "flip_max": worst, "relative_rms": rms, "relative_mse": mse,
        });
        say(format_args!("{found:#}"))?;
    } else {
        say(format_args!("{:<24} {mean:.5} mean, {worst:.3} at most", "FLIP"))?;
        say(format_args!("{:<24} {:.4} %", "relative RMS", 100.0 * rms))?;
        say(format_args!("{:<24} {mse:.3e}", "relative MSE"))?;
    }
    Ok(())
}

/// Of linear colours: ‖a − b‖ / ‖b‖, and the mean of (a − b)² / (b² + 0.01), the
/// usual measure of a renderer's noise.
fn linear(test: &Film, reference: &Film) -> [f64; 2] {
    let (mut error, mut size, mut relative) = (0.0, 0.0, 0.0);
    for (a, b) in test.pixels.iter().zip(&reference.pixels) {
        for (a, b) in a.to_array().into_iter().zip(b.to_array()) {
            let (off, b) = ((f64::from(a) - f64::from(b)).powi(2), f64::from(b).powi(2));
            error += off;
            size += b;
            relative += off / (b + 0.01);
        }
    }
    let rms = if error > 0.0 { (error / size).sqrt() } else { 0.0 };
    [rms, relative / (3 * test.pixels.len().max(1)) as f64]
}

/// Black, purple, orange, white: brighter all the way, so it prints in grey.
fn colour(x: f32) -> Vec3 {
    const STOPS: [[f32; 3]; 4] =
        [[0.0, 0.0, 0.0], [0.12, 0.01, 0.19], [0.9, 0.22, 0.06], [1.0, 1.0, 0.9]];
    let at = 3.0 * x.clamp(0.0, 1.0);
    let i = (at as usize).min(2);
    Vec3::from(STOPS[i]).lerp(Vec3::from(STOPS[i + 1]), at - i as f32)
}
