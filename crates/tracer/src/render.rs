//! All pixels of one camera, in parallel. The picture is the same to the bit
//! whatever the number of threads: a pixel's samples depend on its place, the
//! seed and nothing else.

use crate::{
    accel::Accel,
    camera::Pinhole,
    emitters::AreaEmitter,
    film::Film,
    scene::{Camera, Scene},
    whitted::{PatchRadiance, Sample, Whitted},
};
use anyhow::Context as _;
use glam::{DVec2, DVec4, Vec3};
use rayon::prelude::*;

/// Step of the samples' sequence, which fills the unit 4-cube evenly: powers of
/// 1/g for g⁵ = g + 1 (M. Roberts, *The Unreasonable Effectiveness of Quasirandom
/// Sequences*, 2018).
const R4: DVec4 = DVec4::new(
    0.856_674_883_854_502_9,
    0.733_891_856_627_125_8,
    0.628_706_721_037_808_8,
    0.538_597_257_223_608_1,
);

/// What to render, and how well.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RenderOptions {
    /// Pixels.
    pub(crate) width: usize,
    /// Pixels.
    pub(crate) height: usize,
    /// Camera rays per pixel.
    pub(crate) samples: u32,
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
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self {
            width: 1280,
            height: 720,
            samples: 16,
            max_depth: 8,
            emitter_grid: 8,
            threads: 0,
            seed: 0,
            background: Vec3::ZERO,
        }
    }
}

/// What a picture cost. Equal pictures cost the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct RenderStats {
    /// Camera, shadow, mirror and refraction rays.
    pub(crate) rays: u64,
}

/// Renders `scene` as `camera` sees it. `progress` is called after each row of
/// pixels, in no particular order and from any thread.
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
    progress: &(dyn Fn() + Sync),
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
    let mut pixels = vec![Vec3::ZERO; width * height];
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.threads)
        .build()
        .with_context(|| format!("starting {} threads", options.threads))?;
    let rays = pool.install(|| {
        let rows = pixels.par_chunks_mut(width.max(1)).enumerate().with_max_len(1);
        rows.map(|(y, row)| {
            let mut rays = 0;
            for (x, pixel) in row.iter_mut().enumerate() {
                *pixel = pixel_radiance(&whitted, &pinhole, options, x, y, &mut rays);
            }
            progress();
            rays
        })
        .sum()
    });
    Ok((Film { width, height, pixels }, RenderStats { rays }))
}

/// Mean over the pixel's samples; adds its rays to `rays`.
fn pixel_radiance(
    whitted: &Whitted<'_>,
    pinhole: &Pinhole,
    options: &RenderOptions,
    x: usize,
    y: usize,
    rays: &mut u64,
) -> Vec3 {
    let pixel = (y * options.width + x) as u64;
    let shift = unit_cube(options.seed, pixel);
    let samples = options.samples.max(1);
    let mut sum = Vec3::ZERO;
    // Samples are that far apart if they are spread evenly.
    let apart = 1.0 / f64::from(samples).sqrt();
    let step = apart / DVec2::new(options.width as f64, options.height as f64);
    for i in 0..samples {
        let point = (shift + f64::from(i) * R4).fract_gl();
        let at_x = (x as f64 + 0.5 + tent(point.x)) / options.width as f64;
        let at_y = (y as f64 + 0.5 + tent(point.y)) / options.height as f64;
        let beam = pinhole.beam(at_x, at_y, step);
        let mut sample = Sample { place: DVec2::new(point.z, point.w), rays: 0 };
        sum += whitted.radiance(&beam, &mut sample);
        *rays += sample.rays;
    }
    sum / samples as f32
}

/// Takes [0, 1) to (−1, 1) with density 1 − |x|: sampling by the pixel filter, so
/// that samples weigh the same and pixels share none.
fn tent(u: f64) -> f64 {
    if u < 0.5 { (2.0 * u).sqrt() - 1.0 } else { 1.0 - (2.0 - 2.0 * u).sqrt() }
}

/// A point of the unit 4-cube that belongs to `pixel`.
fn unit_cube(seed: u64, pixel: u64) -> DVec4 {
    let start = splitmix(seed).wrapping_add(pixel);
    let [a, b] = [splitmix(start), splitmix(!start)];
    let unit = |bits: u64| (bits & 0xffff_ffff) as f64 / 4_294_967_296.0;
    DVec4::new(unit(a), unit(a >> 32), unit(b), unit(b >> 32))
}

/// Scrambles 64 bits (G. Steele, D. Lea and C. Flood, *Fast Splittable
/// Pseudorandom Number Generators*, OOPSLA 2014).
fn splitmix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
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
            let progress = || {
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
        let (film, _) = render(&scene, &accel, None, &camera, &options, &|| {}).expect("threads");
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
            render(&scene, &accel, None, &camera, &options, &|| {}).expect("threads");
        assert_eq!(film.pixels, vec![background; 6]);
        assert_eq!(stats.rays, 6);
    }
}
