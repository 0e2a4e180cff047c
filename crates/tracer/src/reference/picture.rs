//! Pictures by the reference, with an estimate of their error.

use super::Lighting;
use crate::accel::Accel;
use crate::film::Film;
use crate::render::{RenderOptions, RenderStats, render};
use crate::scene::{Camera, Scene};
use glam::Vec3;

/// Independent pictures that the error is estimated from.
const PASSES: u32 = 4;

/// Points a camera ray and pass at most: 2¹⁶ camera rays of so many still have
/// distinct points of the sequence.
const MOST_POINTS: u32 = 1 << 16;

/// How well the patches' light is to be sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Target {
    /// So many points a pixel, shared by its camera rays.
    Samples(u32),
    /// Until the estimated relative RMS error is below it.
    Error(f64),
}

/// What to render, and how well.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ReferenceOptions {
    pub(crate) render: RenderOptions,
    pub(crate) target: Target,
}

/// How far a picture may be from its limit of infinitely many points.
#[derive(Clone, Debug)]
pub(crate) struct Estimate {
    /// Points a pixel that were taken.
    pub(crate) points: u64,
    /// Camera rays a pixel that share them.
    pub(crate) samples: u32,
    /// √(Σ variance / Σ L²) over the pixels that see a patch.
    pub(crate) relative: f64,
}

/// Renders `scene` as `camera` sees it, the light of patches sampled. All else,
/// camera rays included, is as in [`render`] with the same options.
///
/// The picture is the mean of four with independent points, whose scatter gives
/// the variance.
///
/// # Errors
///
/// If the threads cannot be started.
pub(crate) fn render_reference(
    scene: &Scene,
    accel: &Accel,
    lighting: &Lighting,
    camera: &Camera,
    options: &ReferenceOptions,
    progress: &(dyn Fn(u64) + Sync),
) -> anyhow::Result<(Film, RenderStats, Estimate)> {
    let mut render_options = options.render;
    let mut points = 1;
    match options.target {
        Target::Samples(count) => {
            // No point for some of the camera rays would be a bias.
            render_options.samples = render_options.samples.min(count / PASSES).max(1);
            points = (count / (PASSES * render_options.samples)).clamp(1, MOST_POINTS);
        }
        Target::Error(_) => {}
    }
    let (mut round, mut total) = (0, RenderStats::default());
    loop {
        let mut sum = Moments::default();
        for pass in 0..PASSES {
            let seed = u64::from(round * PASSES + pass).wrapping_add(options.render.seed << 16);
            let sampled = lighting.sampled(points, seed);
            let patches = Some(&sampled as _);
            let (film, stats) = render(scene, accel, patches, camera, &render_options, progress)?;
            total = [total, stats].into_iter().sum();
            sum.add(film);
            if total.rows_left > 0 {
                let none = Estimate { points: 0, samples: 0, relative: 1.0 };
                return Ok((sum.finish(0, 0).0, total, none));
            }
        }
        let taken = u64::from(PASSES) * u64::from(points) * u64::from(render_options.samples);
        let (film, estimate) = sum.finish(taken, render_options.samples);
        let Target::Error(wanted) = options.target else { return Ok((film, total, estimate)) };
        if estimate.relative <= wanted || points == MOST_POINTS {
            return Ok((film, total, estimate));
        }
        // Errors of a net fall about as its points increase; by sixteen at most, in
        // case that the estimate is off.
        let factor = (estimate.relative / wanted).clamp(2.0, 16.0) as u32;
        points = (points * factor.next_power_of_two()).min(MOST_POINTS);
        round += 1;
    }
}

/// Sums over passes, pixel by pixel.
#[derive(Debug, Default)]
struct Moments {
    films: Vec<Film>,
}

impl Moments {
    fn add(&mut self, film: Film) {
        self.films.push(film);
    }

    /// The mean, and the variance of the mean.
    fn finish(mut self, points: u64, samples: u32) -> (Film, Estimate) {
        let n = self.films.len() as f32;
        let mut mean = self.films.pop().expect("at least one pass");
        let last = mean.pixels.clone();
        for film in &self.films {
            mean.pixels.iter_mut().zip(&film.pixels).for_each(|(sum, x)| *sum += *x);
        }
        mean.pixels.iter_mut().for_each(|x| *x /= n);
        let passes = self.films.iter().map(|film| &film.pixels).chain([&last]);
        let mut variance = vec![0.0; last.len()];
        for pixels in passes {
            for ((variance, x), mean) in variance.iter_mut().zip(pixels).zip(&mean.pixels) {
                *variance += (*x - *mean).length_squared() / (3.0 * n * (n - 1.0));
            }
        }
        let (mut error, mut size) = (0.0, 0.0);
        for (variance, x) in variance.iter().zip(&mean.pixels).filter(|(v, _)| **v > 0.0) {
            error += f64::from(*variance);
            size += f64::from(x.dot(Vec3::ONE / 3.0 * *x));
        }
        let relative = if size > 0.0 { (error / size).sqrt() } else { 0.0 };
        (mean, Estimate { points, samples, relative })
    }
}
