//! All pixels of one camera, in parallel. The picture is the same to the bit
//! whatever the number of threads: a pixel's samples depend on its place, the
//! seed and nothing else.

mod first_round;
mod pixel;

pub(crate) use pixel::{R4, TOGETHER, splitmix};

use crate::{
    accel::Accel,
    camera::Pinhole,
    emitters::AreaEmitter,
    film::{Film, Layers},
    scene::{Camera, Scene},
    threads::in_pool,
    whitted::{PatchRadiance, Whitted},
};
use first_round::FirstRound;
use glam::{DVec2, DVec3, UVec2, Vec3};
use pixel::{Pixel, PixelSampler, Room, Tally};
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};

/// What to render, and how well.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RenderOptions {
    /// Pixels.
    pub(crate) width: usize,
    /// Pixels.
    pub(crate) height: usize,
    /// The part that is wanted; all without it.
    pub(crate) crop: Option<Crop>,
    /// Camera rays per pixel; the most of them with `noise`.
    pub(crate) samples: u32,
    /// The standard error at which a pixel is good enough, relative to its
    /// radiance, or to 0.02 for a darker one.
    pub(crate) noise: Option<f32>,
    /// Mirror and glass surfaces in a row.
    pub(crate) max_depth: u32,
    /// Cells along a side of an area emitter, for surfaces without a patch.
    pub(crate) emitter_grid: usize,
    /// 0: one per core.
    pub(crate) threads: usize,
    /// Another seed, another noise.
    pub(crate) seed: u64,
    /// Radiance where there is no surface.
    pub(crate) background: Vec3,
    /// Set from outside to leave out the rows that are not begun.
    pub(crate) stop: Option<&'static AtomicBool>,
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self {
            width: 1280,
            height: 720,
            crop: None,
            samples: 16,
            noise: None,
            max_depth: 8,
            emitter_grid: 8,
            threads: 0,
            seed: 0,
            background: Vec3::ZERO,
            stop: None,
        }
    }
}

/// A rectangle of pixels, inside the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Crop {
    pub(crate) left: usize,
    pub(crate) top: usize,
    pub(crate) width: usize,
    pub(crate) height: usize,
}

/// What a picture cost. Equal pictures cost the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct RenderStats {
    /// Camera, shadow, mirror and refraction rays.
    pub(crate) rays: u64,
    /// Camera rays.
    pub(crate) samples: u64,
    /// Rows left out because rendering was stopped.
    pub(crate) rows_left: usize,
    /// How often a patch's radiance was asked for.
    pub(crate) look_ups: u64,
}

impl std::iter::Sum for RenderStats {
    fn sum<I: Iterator<Item = Self>>(parts: I) -> Self {
        parts.fold(Self::default(), |sum, part| Self {
            rays: sum.rays + part.rays,
            samples: sum.samples + part.samples,
            rows_left: sum.rows_left + part.rows_left,
            look_ups: sum.look_ups + part.look_ups,
        })
    }
}

/// Renders `scene` as `camera` sees it. `progress` is called after each row of
/// pixels with the rays it took, in no particular order and from any thread.
///
/// # Errors
///
/// If the threads cannot be started.
pub(crate) fn render(
    scene: &Scene,
    accel: &Accel,
    patches: Option<&dyn PatchRadiance>,
    camera: &Camera,
    options: &RenderOptions,
    progress: &(dyn Fn(u64) + Sync),
) -> anyhow::Result<(Film, RenderStats)> {
    let &RenderOptions { width, height, .. } = options;
    let whitted = Whitted {
        scene,
        accel,
        patches,
        emitters: AreaEmitter::all(scene, options.emitter_grid),
        max_depth: options.max_depth,
        background: options.background,
    };
    let pinhole = Pinhole::new(camera, width, height);
    let crop = options.crop.unwrap_or(Crop { left: 0, top: 0, width, height });
    let sampler = PixelSampler { whitted: &whitted, pinhole: &pinhole, options };
    let mut pixels = vec![Vec3::ZERO; crop.width * crop.height];
    let stopped = || options.stop.is_some_and(|stop| stop.load(Ordering::Relaxed));
    let stats = in_pool(options.threads, || {
        let first = options.noise.map(|_| FirstRound::sample(&sampler, crop, &stopped));
        let rows = pixels.par_chunks_mut(crop.width.max(1)).enumerate().with_max_len(1);
        rows.map(|(row, pixels)| {
            let mut stats = RenderStats::default();
            if stopped() {
                stats.rows_left = 1;
                return stats;
            }
            let y = crop.top + row;
            let pixel = |x| Pixel {
                x,
                y,
                wanted: first.as_ref().map_or(options.samples.max(1), |f| f.wanted(x, y)),
                tally: first.as_ref().map_or_else(Tally::default, |f| f.tally(x, y)),
            };
            let mut sampled: Vec<Pixel> =
                (crop.left..crop.left + pixels.len()).map(pixel).collect();
            sampler.finish(&mut sampled, &mut Room::default());
            for (pixel, Pixel { tally, .. }) in pixels.iter_mut().zip(sampled) {
                *pixel = tally.sum / tally.taken as f32;
                stats.rays += tally.rays;
                stats.look_ups += tally.look_ups;
                stats.samples += u64::from(tally.taken);
            }
            progress(stats.rays);
            stats
        })
        .sum()
    })?;
    Ok((Film { width: crop.width, height: crop.height, pixels }, stats))
}

/// What the ray through each pixel's centre meets first.
///
/// # Errors
///
/// If the threads cannot be started.
pub(crate) fn layers(
    scene: &Scene,
    accel: &Accel,
    patches: Option<&dyn PatchRadiance>,
    camera: &Camera,
    options: &RenderOptions,
) -> anyhow::Result<Layers> {
    let &RenderOptions { width, height, .. } = options;
    let whitted = Whitted {
        scene,
        accel,
        patches,
        emitters: Vec::new(),
        max_depth: 0,
        background: options.background,
    };
    let pinhole = Pinhole::new(camera, width, height);
    let crop = options.crop.unwrap_or(Crop { left: 0, top: 0, width, height });
    let ahead = camera.transform.transform_vector3(DVec3::NEG_Z);
    let pixel = |i: usize| {
        let (x, y) = (crop.left + i % crop.width, crop.top + i / crop.width);
        let size = DVec2::new(width as f64, height as f64);
        let at = (UVec2::new(x as u32, y as u32).as_dvec2() + 0.5) / size;
        whitted.first(&pinhole.beam(at.x, at.y, 1.0 / size), ahead)
    };
    in_pool(options.threads, || (0..crop.width * crop.height).into_par_iter().map(pixel).collect())
        .map(|pixels: Vec<_>| Layers { pixels })
}

#[cfg(test)]
mod tests {
    use super::first_round::DARK;
    use super::pixel::tent;
    use super::*;
    use crate::scene::{LightKind, Material, Mesh, Projection, PunctualLight};
    use glam::{DAffine3, DVec3};
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// A floor under a lamp and a mirror wall, seen from the front.
    fn room() -> (Scene, Camera) {
        let quad = |corners: [[f64; 3]; 4], material| Mesh {
            positions: corners.map(DVec3::from_array).to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            material,
            ..Mesh::default()
        };
        let floor = [[-2.0, 0.0, 2.0], [2.0, 0.0, 2.0], [2.0, 0.0, -2.0], [-2.0, 0.0, -2.0]];
        let wall = [[-2.0, 0.0, -2.0], [2.0, 0.0, -2.0], [2.0, 2.0, -2.0], [-2.0, 2.0, -2.0]];
        let lamp = [[-0.5, 2.0, -0.5], [0.5, 2.0, -0.5], [0.5, 2.0, 0.5], [-0.5, 2.0, 0.5]];
        let mirror = Material { ks: Vec3::splat(0.9), mirror: true, ..Material::default() };
        let glow = Material { emission: Vec3::new(4.0, 2.0, 1.0), ..Material::default() };
        let scene = Scene {
            meshes: vec![quad(floor, 0), quad(wall, 1), quad(lamp, 2)],
            materials: vec![Material::default(), mirror, glow],
            lights: vec![PunctualLight {
                intensity: Vec3::ONE,
                position: DVec3::new(1.0, 1.0, 0.5),
                direction: DVec3::NEG_Y,
                kind: LightKind::Point,
                range: None,
            }],
            ..Scene::default()
        };
        let camera = Camera {
            name: String::new(),
            transform: DAffine3::from_translation(DVec3::new(0.0, 1.0, 4.0)),
            projection: Projection::Perspective { yfov: 0.8 },
            aspect: None,
        };
        (scene, camera)
    }

    #[test]
    fn picture_and_cost_do_not_depend_on_the_number_of_threads() {
        let (scene, camera) = room();
        let accel = Accel::new(&scene);
        let with = |threads, seed| {
            let options = RenderOptions {
                width: 40,
                height: 30,
                samples: 4,
                threads,
                seed,
                ..RenderOptions::default()
            };
            let rows = AtomicUsize::new(0);
            let progress = |_| {
                rows.fetch_add(1, Ordering::Relaxed);
            };
            let picture = render(&scene, &accel, None, &camera, &options, &progress);
            assert_eq!(rows.into_inner(), 30, "rows reported");
            picture.expect("threads to spare")
        };
        let (film, stats) = with(1, 0);
        assert!(film.pixels.iter().all(|p| p.is_finite()), "not finite");
        assert!(film.pixels.iter().any(|p| p.x > 1.0), "all dark");
        assert!(stats.rays > 40 * 30 * 4, "{stats:?}");
        assert_eq!(with(2, 0), (film.clone(), stats));
        assert_eq!(with(7, 0), (film.clone(), stats));
        assert_ne!(with(1, 1).0, film, "the seed does nothing");
    }

    #[test]
    fn image_is_upright_and_not_mirrored() {
        let (mut scene, camera) = room();
        // Only a glowing floor, right of the middle.
        scene.meshes.truncate(1);
        scene.materials[0].emission = Vec3::ONE;
        scene.meshes[0].positions.iter_mut().for_each(|p| p.x += 2.5);
        scene.lights.clear();
        let accel = Accel::new(&scene);
        let options = RenderOptions { width: 8, height: 8, ..RenderOptions::default() };
        let (film, _) = render(&scene, &accel, None, &camera, &options, &|_| {}).expect("threads");
        let at = |x: usize, y: usize| film.pixels[y * 8 + x].x;
        assert!(at(7, 7) > 0.9, "lower right: {}", at(7, 7));
        for (x, y) in [(0, 0), (7, 0), (0, 7)] {
            assert_eq!(at(x, y), 0.0, "({x}, {y})");
        }
    }

    #[test]
    fn tent_has_its_mean_at_zero_and_variance_a_sixth() {
        let n = 10_000;
        let samples = (0..n).map(|i| tent((f64::from(i) + 0.5) / f64::from(n)));
        let (mean, square) = samples.fold((0.0, 0.0), |(m, s), x| (m + x, s + x * x));
        assert!((mean / f64::from(n)).abs() < 1e-9, "{mean}");
        assert!((square / f64::from(n) - 1.0 / 6.0).abs() < 1e-4, "{square}");
    }

    #[test]
    fn nothing_to_see_is_background() {
        let (_, camera) = room();
        let scene = Scene::default();
        let background = Vec3::new(0.1, 0.2, 0.3);
        let options =
            RenderOptions { width: 3, height: 2, samples: 1, background, ..Default::default() };
        let accel = Accel::new(&scene);
        let (film, stats) =
            render(&scene, &accel, None, &camera, &options, &|_| {}).expect("threads");
        assert_eq!(film.pixels, vec![background; 6]);
        assert_eq!(stats.rays, 6);
    }

    fn small(samples: u32) -> RenderOptions {
        RenderOptions { width: 24, height: 18, samples, threads: 1, ..RenderOptions::default() }
    }

    #[test]
    fn a_crop_is_a_part_of_the_picture_to_the_bit() {
        let (scene, camera) = room();
        let accel = Accel::new(&scene);
        let picture = |crop| {
            let options = RenderOptions { crop, ..small(3) };
            render(&scene, &accel, None, &camera, &options, &|_| {}).expect("threads").0
        };
        let whole = picture(None);
        let crop = Crop { left: 5, top: 9, width: 7, height: 4 };
        let part = picture(Some(crop));
        assert_eq!((part.width, part.height), (7, 4));
        for (i, pixel) in part.pixels.iter().enumerate() {
            assert_eq!(*pixel, whole.pixels[(9 + i / 7) * 24 + 5 + i % 7], "pixel {i}");
        }
    }

    #[test]
    fn noise_is_refined_where_it_is() {
        let (scene, camera) = room();
        let accel = Accel::new(&scene);
        let picture = |samples, noise| {
            let options = RenderOptions { noise, ..small(samples) };
            render(&scene, &accel, None, &camera, &options, &|_| {}).expect("threads")
        };
        let (adaptive, stats) = picture(256, Some(0.02));
        let (all, most) = (picture(256, None), 24 * 18 * 256);
        assert!(stats.samples >= 24 * 18 * 8 && stats.samples < most * 2 / 3, "{stats:?}");
        assert_eq!(all.1.samples, most);
        // The edges want more than 256 samples: where fewer do, no error is added.
        let (truth, _) = picture(2048, None);
        let error = |film: &Film| {
            let pairs = film.pixels.iter().zip(&truth.pixels);
            let relative = |(a, b): (&Vec3, &Vec3)| {
                ((a - b).abs() / b.max(Vec3::splat(DARK))).max_element().powi(2)
            };
            (pairs.map(relative).sum::<f32>() / truth.pixels.len() as f32).sqrt()
        };
        let (found, fixed, few) = (error(&adaptive), error(&all.0), error(&picture(8, None).0));
        assert!(found < 1.1 * fixed, "{found}, with 256 each {fixed}");
        assert!(few > 2.0 * found, "8 samples each: {few}");
    }

    #[test]
    fn stopping_leaves_rows_out_and_counts_them() {
        static STOP: AtomicBool = AtomicBool::new(false);
        let (scene, camera) = room();
        let accel = Accel::new(&scene);
        let options = RenderOptions { stop: Some(&STOP), ..small(1) };
        let progress = |_| STOP.store(true, Ordering::Relaxed);
        let rendered = render(&scene, &accel, None, &camera, &options, &progress);
        let (film, stats) = rendered.expect("threads");
        assert_eq!((film.height, stats.rows_left), (18, 17), "one row on one thread");
        assert_eq!(stats.samples, 24);
    }

    #[test]
    fn layers_say_what_is_seen() {
        let (scene, camera) = room();
        let accel = Accel::new(&scene);
        let layers = layers(&scene, &accel, None, &camera, &small(1)).expect("threads");
        // The middle looks at the mirror wall: from z = 4 to z = −2.
        let middle = layers.pixels[9 * 24 + 12].expect("the wall");
        assert_eq!((middle.object, middle.normal), (2, Vec3::Z));
        assert!((middle.depth - 6.0).abs() < 1e-6, "{middle:?}");
        assert!((middle.position.z + 2.0).abs() < 1e-6, "{middle:?}");
        // k_d and k_s of the wall.
        assert!(middle.albedo.abs_diff_eq(Vec3::splat(0.5 + 0.9), 1e-6), "{middle:?}");
        assert_eq!(middle.wct_uv, None, "no patches");
        // Depth is along the axis: the same all over the wall.
        let aside = layers.pixels[9 * 24 + 18].expect("the wall");
        assert!((aside.depth - 6.0).abs() < 1e-5, "{aside:?}");
        assert_eq!(layers.pixels[0], None, "above the room");
    }
}
