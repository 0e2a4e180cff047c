//! Pictures by the reference, with an estimate of their error.

use super::Lighting;
use crate::accel::Accel;
use crate::film::Film;
use crate::render::{RenderOptions, RenderStats, render, splitmix};
use crate::scene::{Camera, Scene};

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

/// How far a picture may be from its limit of infinitely many points and camera rays, as
/// √(Σ variance / Σ L²) over the pixels that see a patch.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Estimate {
    /// Points a pixel that were taken.
    pub(crate) points: u64,
    /// Camera rays a pixel that share them.
    pub(crate) samples: u32,
    /// Of there being so many points.
    pub(crate) emitters: f64,
    /// Of there being so many camera rays; `None` where it was stopped before that was known.
    pub(crate) rays: Option<f64>,
}

impl Estimate {
    /// Of a picture that is not whole.
    const NONE: Self = Self { points: 0, samples: 0, emitters: 1.0, rays: None };

    /// Of both together, if both are known.
    pub(crate) fn relative(&self) -> Option<f64> {
        Some(self.emitters.hypot(self.rays?))
    }

    /// The error that the points may have, so that both together have `wanted`. Where the
    /// camera rays leave them nothing of it, all.
    fn share(&self, wanted: f64) -> f64 {
        let rays = self.rays.unwrap_or(0.0);
        if rays >= wanted {
            return wanted;
        }
        // A small rest would cost many points, and more camera rays few.
        (wanted * wanted - rays * rays).sqrt().max(0.25 * wanted)
    }

    /// Camera rays a pixel that leave the points half of the variance of `wanted`, were they
    /// independent; evenly spread ones are better.
    pub(crate) fn samples_for(&self, wanted: f64) -> u32 {
        let rays = self.rays.unwrap_or(0.0);
        (f64::from(self.samples) * 2.0 * (rays / wanted).powi(2)).ceil() as u32
    }
}

/// Renders `scene` as `camera` sees it, the light of patches sampled. All else,
/// camera rays included, is as in [`render`] with the same options.
///
/// The picture is the mean of four with independent points, whose scatter gives
/// their variance. Two more with other camera rays, in which the picture has no part, give
/// that of the camera rays.
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
        let mut pass = |number: u32, points: u32, options: &RenderOptions| {
            let seed = u64::from(number).wrapping_add(options.seed << 16);
            let sampled = lighting.sampled(points, seed);
            let (film, stats) =
                render(scene, accel, Some(&sampled as _), camera, options, progress)?;
            total = [total, stats].into_iter().sum();
            anyhow::Ok((film, stats.rows_left == 0))
        };
        let mut films = Vec::new();
        for number in 0..PASSES {
            let (film, is_whole) = pass(round * PASSES + number, points, &render_options)?;
            films.push(film);
            if !is_whole {
                return Ok((Moments::of(&films).mean, total, Estimate::NONE));
            }
        }
        let moments = Moments::of(&films);
        let mut estimate = Estimate {
            points: u64::from(PASSES) * u64::from(points) * u64::from(render_options.samples),
            samples: render_options.samples,
            emitters: moments.emitters(),
            rays: None,
        };
        let is_enough = match options.target {
            Target::Samples(_) => true,
            Target::Error(wanted) => estimate.emitters <= wanted || points == MOST_POINTS,
        };
        if is_enough {
            let seed = splitmix(!options.render.seed);
            let other = RenderOptions { seed, ..render_options };
            let few = points.div_ceil(2);
            let (first, _) = pass(2 * round, few, &other)?;
            let (second, is_whole) = pass(2 * round + 1, few, &other)?;
            if !is_whole {
                // These are not part of the picture, which is.
                total.rows_left = 0;
                return Ok((moments.mean, total, estimate));
            }
            estimate.rays = Some(moments.rays(&films, &[first, second]));
        }
        let Target::Error(wanted) = options.target else {
            return Ok((moments.mean, total, estimate));
        };
        let share = estimate.share(wanted);
        if is_enough && estimate.emitters <= share || points == MOST_POINTS {
            return Ok((moments.mean, total, estimate));
        }
        // Errors of a net fall about as its points increase; by sixteen at most, in
        // case that the estimate is off.
        let factor = (estimate.emitters / share).clamp(2.0, 16.0) as u32;
        points = (points * factor.next_power_of_two()).min(MOST_POINTS);
        round += 1;
    }
}

/// The picture that passes with the same camera rays make, and how far they scatter.
#[derive(Debug)]
struct Moments {
    mean: Film,
    /// Of the mean, pixel by pixel, in the mean over channels. Where it is none, no patch is
    /// seen.
    variance: Vec<f32>,
}

impl Moments {
    fn of(films: &[Film]) -> Self {
        let n = films.len() as f32;
        let mean = mean_of(films);
        let mut variance = vec![0.0; mean.pixels.len()];
        for film in films {
            for ((variance, x), mean) in variance.iter_mut().zip(&film.pixels).zip(&mean.pixels) {
                *variance += (*x - *mean).length_squared() / (3.0 * n * (n - 1.0).max(1.0));
            }
        }
        Self { mean, variance }
    }

    /// Σ L² over the pixels that see a patch.
    fn size(&self) -> f64 {
        let seen = self.mean.pixels.iter().zip(&self.variance).filter(|(_, v)| **v > 0.0);
        seen.map(|(x, _)| f64::from(x.length_squared()) / 3.0).sum()
    }

    /// The error of the points.
    fn emitters(&self) -> f64 {
        relative(self.variance.iter().copied().map(f64::from).sum(), self.size())
    }

    /// The error of the camera rays that `films` have in common, by two `others` with as many
    /// of their own.
    ///
    /// With independent points in all, 𝔼[(a − c)(b − d)] = 2 V for the means a, b over half of
    /// `films` each and the others c, d: camera rays are what a and b, and c and d, share.
    fn rays(&self, films: &[Film], others: &[Film; 2]) -> f64 {
        let (a, b) = films.split_at(films.len() / 2);
        let (a, b) = (mean_of(a), mean_of(b));
        let [c, d] = others;
        // One that only the others meet is one that the picture misses.
        let is_seen = |i: usize| self.variance[i] > 0.0 || c.pixels[i] != d.pixels[i];
        let variance = |i: usize| {
            let product = (a.pixels[i] - c.pixels[i]).dot(b.pixels[i] - d.pixels[i]);
            f64::from(product) / (2.0 * 3.0)
        };
        let pixels = (0..self.variance.len()).filter(|&i| is_seen(i));
        relative(pixels.map(variance).sum(), self.size())
    }
}

/// √(error / size), 0 of nothing and for a variance that noise has made negative.
fn relative(error: f64, size: f64) -> f64 {
    if size > 0.0 { (error.max(0.0) / size).sqrt() } else { 0.0 }
}

fn mean_of(films: &[Film]) -> Film {
    let (last, rest) = films.split_last().expect("at least one pass");
    let mut mean = last.clone();
    for film in rest {
        mean.pixels.iter_mut().zip(&film.pixels).for_each(|(sum, x)| *sum += *x);
    }
    mean.pixels.iter_mut().for_each(|x| *x /= films.len() as f32);
    mean
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use std::path::Path;

    /// The error that is estimated is that from a picture of 1024 camera rays a pixel, over
    /// the edges of a floor and its insides, whether camera rays or points are what it is
    /// made of.
    #[test]
    fn the_estimate_is_the_error_of_points_and_camera_rays() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/facing/facing.gltf");
        let scene = crate::scene::load(Path::new(path)).expect("a scene").scene;
        let (accel, lighting) = (Accel::new(&scene), Lighting::new(&scene).expect("lights"));
        let picture = |samples, points, seed| {
            let render =
                RenderOptions { width: 32, height: 24, samples, seed, ..RenderOptions::default() };
            let options = ReferenceOptions { render, target: Target::Samples(points) };
            let camera = &scene.cameras[0];
            let picture = render_reference(&scene, &accel, &lighting, camera, &options, &|_| {});
            let (film, _, estimate) = picture.expect("threads");
            (film, estimate)
        };
        // The same camera rays with other points: what differs is the floor, edges of the
        // emitter over the background not.
        let [truth, other] = [4096, 8192].map(|points| picture(1024, points, 1).0);
        let floor: Vec<usize> =
            (0..truth.pixels.len()).filter(|&i| truth.pixels[i] != other.pixels[i]).collect();
        let sum = |of: &dyn Fn(usize) -> Vec3| -> f64 {
            floor.iter().map(|&i| f64::from(of(i).length_squared())).sum()
        };
        let size = sum(&|i| truth.pixels[i]);
        let cases =
            [(1, 4), (1, 512), (2, 512), (3, 512), (4, 64), (8, 512), (16, 1024), (64, 256)];
        for (samples, points) in cases {
            let (mut found, mut estimated) = (0.0, 0.0);
            for seed in 3..19 {
                let (film, estimate) = picture(samples, points, seed);
                assert_eq!(estimate.samples, samples);
                found += sum(&|i| film.pixels[i] - truth.pixels[i]) / size;
                estimated += estimate.relative().expect("not stopped").powi(2);
            }
            let ratio = (estimated / found).sqrt();
            // Of sixteen pictures it scatters by 3 %; single rays all miss some edges.
            assert!((0.9..1.1).contains(&ratio), "{samples} rays, {points} points: {ratio}");
        }
    }

    #[test]
    fn points_and_camera_rays_share_what_is_wanted() {
        let estimate =
            |rays| Estimate { points: 64, samples: 16, emitters: 0.03, rays: Some(rays) };
        let relative = estimate(0.04).relative().expect("both are known");
        assert!((relative - 0.05).abs() < 1e-12);
        assert!((estimate(0.04).share(0.05) - 0.03).abs() < 1e-12);
        assert_eq!(estimate(0.0999).share(0.1), 0.025);
        assert_eq!(estimate(0.2).share(0.1), 0.1);
        // Half the variance, by twice the rays.
        assert_eq!(estimate(0.25).samples_for(0.25), 32);
        assert_eq!(estimate(0.25).samples_for(0.125), 128);
    }
}
