//! The finished picture: baked textures against sampling the emitters.

use super::{Bake, Bench, baked, relative_rms};
use crate::accel::Accel;
use crate::film::{Display, Film, Tone};
use crate::flip::{PIXELS_PER_DEGREE, flip};
use crate::reference::{Lighting, Quadrature};
use crate::render::{RenderOptions, RenderStats, render};
use crate::report::{Chart, Cost, Point, Section, Series, Table, Value, cpu_time, short, time_to};
use crate::scene::{Camera, Scene};
use crate::whitted::{PatchRadiance, Sample};
use anyhow::Context as _;
use glam::{DVec3, Vec3};

/// Pictures of a fly-through: five seconds.
const FRAMES: f64 = 120.0;

/// The error that ratios are stated for.
const TARGET: f64 = 0.01;

/// By what factor costs may differ and be called the same: how much runs of one frame do.
const NOISE: f64 = 1.2;

/// Stops at which pictures are seen.
const EXPOSURE: f32 = 0.5;

/// Camera rays a pixel.
const RAYS: u32 = 4;

/// Camera rays of a frame that costs are stated for: 960 × 540 pixels, 16 rays
/// each. Smaller pictures are measured, for a frame costs in proportion.
const FRAME: f64 = 960.0 * 540.0 * 16.0;

/// Cells of an emitter, 4^level of them, that the truth is summed over.
const TRUTH: u8 = 6;

/// Levels, of position and direction together, above which a bake samples each
/// direction cell alike: its error is the look-up's, and a tolerance costs minutes.
const FINE: u8 = 10;

/// Patches that reflect nothing.
struct Dark(Quadrature);

impl PatchRadiance for Dark {
    fn outgoing(&self, mesh: usize, triangle: u32, _: DVec3, _: DVec3, _: &Sample) -> Option<Vec3> {
        self.0.covers(mesh, triangle).then_some(Vec3::ZERO)
    }
}

struct Stage<'a> {
    scene: &'a Scene,
    accel: Accel,
    camera: &'a Camera,
    options: RenderOptions,
    dark: &'a Dark,
}

/// A picture with its cost and error.
struct Shot {
    name: String,
    /// Before the first frame, CPU seconds.
    bake: f64,
    frame: Cost,
    /// What of the frame patches take: it less one with [`Dark`] patches, the
    /// median of pairs.
    patches: f64,
    error: f64,
    /// Mean FLIP, as seen at [`EXPOSURE`].
    flip: f64,
    stats: RenderStats,
    /// Points on emitters evaluated a patch hit.
    points: u64,
    bytes: u64,
}

impl Stage<'_> {
    fn picture(&self, patches: &dyn PatchRadiance) -> anyhow::Result<(Film, RenderStats)> {
        render(self.scene, &self.accel, Some(patches), self.camera, &self.options, &|_| {})
    }

    /// Adds what is measured of the picture to `shot`.
    fn shoot(
        &self,
        bench: &Bench,
        patches: &dyn PatchRadiance,
        errors: impl Fn(&Film) -> [f64; 2],
        shot: Shot,
    ) -> anyhow::Result<Shot> {
        let (first, cost) = cpu_time(1, || self.picture(patches));
        let (film, stats) = first?;
        // A long one need not be repeated to be timed.
        let runs = if cost.median > 5.0 { 1 } else { bench.runs() };
        let (mut dark, mut lit) = (Vec::new(), Vec::new());
        for _ in 0..runs {
            dark.push(cpu_time(1, || self.picture(self.dark)).1.median);
            lit.push(if runs == 1 {
                cost.median
            } else {
                cpu_time(1, || self.picture(patches)).1.median
            });
        }
        let differences = dark.iter().zip(&lit).map(|(dark, lit)| lit - dark).collect();
        let patches = Cost::of(differences).median;
        let [error, flip] = errors(&film);
        Ok(Shot { frame: Cost::of(lit), patches, error, flip, stats, ..shot })
    }
}

/// A camera's pictures.
struct View {
    camera: String,
    haar: Vec<Shot>,
    smooth: Vec<Shot>,
    sampled: Vec<Shot>,
    summed: Vec<Shot>,
    /// Of a frame without any light of patches.
    dark: RenderStats,
    /// Frames that cost as much as one of [`FRAME`] camera rays.
    scale: f64,
}

impl View {
    fn kinds(&self) -> [(&'static str, &[Shot]); 4] {
        [
            ("baked, smooth basis", &self.smooth),
            ("baked, Haar, multilinear", &self.haar),
            ("emitters sampled (--reference)", &self.sampled),
            ("emitters summed over a grid", &self.summed),
        ]
    }

    /// Error against cost of so many frames.
    fn chart(&self, frames: f64, label: &'static str, of: impl Fn(&Shot) -> f64) -> Chart {
        let point = |shot: &Shot| {
            let cost = |frame: f64| shot.bake + frames * self.scale * frame;
            let range = Some([cost(shot.frame.least), cost(shot.frame.most)]);
            Point { x: cost(shot.frame.median), y: of(shot), range }
        };
        let series = self.kinds().map(|(name, shots)| Series {
            name: name.to_owned(),
            points: frontier(shots.iter().map(point).collect()),
        });
        Chart {
            title: format!(
                "{}, {frames} frame{}",
                self.camera,
                if frames > 1.0 { "s" } else { "" }
            ),
            axes: ["CPU time, s, bake included", label],
            series: series.into(),
            ..Chart::default()
        }
    }

    fn charts(&self) -> [Chart; 3] {
        const RMS: &str = "relative RMS error";
        [
            self.chart(1.0, RMS, |shot| shot.error),
            self.chart(FRAMES, RMS, |shot| shot.error),
            self.chart(FRAMES, "mean FLIP", |shot| shot.flip),
        ]
    }

    fn rows(&self) -> Vec<Vec<Value>> {
        let all = self.kinds().into_iter().flat_map(|(_, shots)| shots);
        all.map(|shot| {
            vec![
                self.camera.clone().into(),
                shot.name.clone().into(),
                Value::Percent(shot.error),
                Value::Number(shot.flip),
                Value::Number(shot.bake),
                Value::Number(shot.frame.median),
                Value::Number(shot.frame.spread()),
                Value::Number(shot.patches),
                Value::Count(shot.bytes),
                Value::Count(shot.stats.look_ups),
                Value::Count(shot.stats.look_ups * shot.points),
                Value::Count(self.dark.rays),
            ]
        })
        .collect()
    }
}

pub(super) fn measure(bench: &Bench) -> anyhow::Result<Section> {
    let scene = bench.scene("chapel/chapel.gltf")?;
    let (width, height) = bench.choose((96, 72), (240, 180));
    let options =
        RenderOptions { width, height, samples: RAYS, emitter_grid: 1, ..RenderOptions::default() };
    let levels: &[(u8, u8)] = bench.choose(
        &[(3, 3), (3, 5)],
        &[(3, 3), (4, 4), (5, 5), (6, 6), (3, 5), (3, 6), (4, 6), (3, 7), (4, 7)],
    );
    let mut haar = Vec::new();
    for &(position, direction) in levels {
        let flags = [position.to_string(), direction.to_string()];
        let mut flags = vec!["--level", &flags[0], "--direction-level", &flags[1], "--checks", "0"];
        if position + direction > FINE {
            flags.extend(["--samples", "4"]);
        }
        let name = format!("Haar, {}² × {}² cells", 1 << position, 1 << direction);
        haar.push((name, baked(&scene, &flags)?));
    }
    let errors: &[&str] = bench.choose(
        &["0.1", "0.03", "0.01"],
        &["0.2", "0.1", "0.05", "0.02", "0.01", "0.005", "0.002"],
    );
    let mut smooth = Vec::new();
    for &error in errors {
        let name = format!("smooth, --error {error}");
        smooth.push((name, baked(&scene, &["--error", error, "--checks", "0"])?));
    }
    let cameras: &[&str] = bench.choose(&["top"], &["nave", "top"]);
    let dark = Dark(Quadrature::new(&scene, 0)?);
    let mut views = Vec::new();
    for name in cameras {
        let camera = scene.cameras.iter().find(|c| c.name == *name).context(*name)?;
        let stage =
            Stage { scene: &scene, accel: Accel::new(&scene), camera, options, dark: &dark };
        views.push(view(bench, &stage, &haar, &smooth)?);
    }
    let mut text = vec![format!(
        "The chapel, {width} × {height} pixels with {RAYS} camera rays each, punctual lights and shadows included. Error is that of the light that patches send to the eye, root of mean squares over all pixels, against a sum over 64² cells of the window, textures averaged within: most of the floor is on the picture of the camera top, a seventh of nave's is floor. Costs in the charts and below are those of a frame of 960 × 540 pixels with 16 camera rays each, in proportion to the rays; in the table, as measured. FLIP is the mean over the whole picture as displayed, {EXPOSURE} stops up.",
    )];
    text.extend(views.iter().flat_map(findings));
    Ok(Section {
        id: "picture",
        title: "The finished picture",
        text,
        charts: views.iter().flat_map(View::charts).collect(),
        tables: vec![Table {
            name: "picture",
            caption: "Pictures by how the patches' light was had.".to_owned(),
            head: vec![
                "camera",
                "picture",
                "error",
                "FLIP",
                "bake, CPU s",
                "frame, CPU s",
                "slowest / fastest",
                "of it patches, s",
                "bytes of the file",
                "patch hits",
                "points evaluated",
                "other rays",
            ],
            rows: views.iter().flat_map(View::rows).collect(),
        }],
        ..Section::default()
    })
}

/// All pictures of one camera, by named bakes.
fn view(
    bench: &Bench,
    stage: &Stage<'_>,
    haar: &[(String, Bake)],
    smooth: &[(String, Bake)],
) -> anyhow::Result<View> {
    let (truth, _) = stage.picture(&Quadrature::new(stage.scene, TRUTH)?)?;
    let (dark, dark_stats) = stage.picture(stage.dark)?;
    let display = Display { exposure: EXPOSURE, tone: Tone::Neutral };
    let seen = truth.displayed(display);
    let errors = |film: &Film| {
        let pixels = film.pixels.iter().zip(&truth.pixels).zip(&dark.pixels);
        let map = flip(&film.displayed(display), &seen, film.width, PIXELS_PER_DEGREE);
        let flip = map.iter().map(|x| f64::from(*x)).sum::<f64>() / map.len() as f64;
        let error = relative_rms(pixels.flat_map(|((found, truth), dark)| {
            let [found, truth] = [*found - *dark, *truth - *dark].map(|x| x.to_array());
            found.map(f64::from).into_iter().zip(truth.map(f64::from))
        }));
        [error, flip]
    };
    let shot = |name: String, points: u64| Shot {
        name,
        bake: 0.0,
        frame: Cost::of(vec![0.0]),
        patches: 0.0,
        error: 0.0,
        flip: 0.0,
        stats: RenderStats::default(),
        points,
        bytes: 0,
    };
    let shots = |bakes: &[(String, Bake)]| -> anyhow::Result<Vec<Shot>> {
        let shots = bakes.iter().map(|(name, bake)| {
            let shot = Shot { bake: bake.seconds, bytes: bake.bytes, ..shot(name.clone(), 0) };
            stage.shoot(bench, &bake.texture, errors, shot)
        });
        shots.collect()
    };
    let (haar, smooth) = (shots(haar)?, shots(smooth)?);
    let lighting = Lighting::new(stage.scene)?;
    let mut sampled = Vec::new();
    let counts: &[u32] = bench.choose(&[4, 16, 64, 256], &[4, 16, 64, 256, 1024, 4096, 16384]);
    for &count in counts {
        let points = count / RAYS;
        let shot = shot(format!("sampled, {count} points a pixel"), points.into());
        sampled.push(stage.shoot(bench, &lighting.sampled(points, 9), errors, shot)?);
    }
    let mut summed = Vec::new();
    for level in 1..=bench.choose(4, 5) {
        let patches = Quadrature::new(stage.scene, level)?;
        let shot = shot(format!("summed over {}² cells", 1 << level), 1 << (2 * level));
        summed.push(stage.shoot(bench, &patches, errors, shot)?);
    }
    let RenderOptions { width, height, samples, .. } = stage.options;
    let scale = FRAME / (width * height * samples as usize) as f64;
    let camera = stage.camera.name.clone();
    Ok(View { camera, haar, smooth, sampled, summed, dark: dark_stats, scale })
}

/// The points that no cheaper one betters, by cost; the others are in the table.
fn frontier(mut points: Vec<Point>) -> Vec<Point> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x));
    let mut best = f64::INFINITY;
    points.retain(|p| {
        let better = p.y < best;
        best = best.min(p.y);
        better
    });
    points
}

/// Where a view's curves cross: by the cheapest bake within the target, or by the
/// best there is.
fn findings(view: &View) -> Vec<String> {
    let frame = |shot: &Shot| view.scale * shot.frame.median;
    let cost = |shot: &&Shot| shot.bake + FRAMES * frame(shot);
    let baked = || view.smooth.iter().chain(&view.haar);
    let within = || baked().filter(|shot| shot.error <= TARGET);
    // Frames cost the same but for noise: of the cheapest, the one baked soonest.
    let least_cost = within().map(|shot| cost(&shot)).fold(f64::INFINITY, f64::min);
    let cheapest = within()
        .filter(|shot| cost(shot) <= NOISE * least_cost)
        .min_by(|a, b| a.bake.total_cmp(&b.bake));
    let least = baked().min_by(|a, b| a.error.total_cmp(&b.error));
    let Some(best) = cheapest.or(least) else { return vec![] };
    let (percent, name, camera) = (short(100.0 * best.error), &best.name, &view.camera);
    let against = [("sampling", &view.sampled), ("summing over a grid", &view.summed)];
    let sentence = |(what, shots): (&str, &Vec<Shot>)| {
        let by = |cost: &dyn Fn(&Shot) -> f64| {
            let runs: Vec<[f64; 2]> = shots.iter().map(|shot| [cost(shot), shot.error]).collect();
            time_to(&runs, best.error)
        };
        let (Some(other), Some(patches)) = (by(&frame), by(&|shot| shot.patches.max(1e-9))) else {
            return format!(
                "Camera {camera}, {what}: no count measured reaches the {percent} % of \"{name}\"."
            );
        };
        let saved = other - frame(best);
        let crossing = if saved > 0.0 {
            format!("the bake pays from frame {:.0} on", (best.bake / saved).ceil().max(1.0))
        } else {
            "the bake never pays".to_owned()
        };
        let light = if best.patches > 0.0 {
            format!("{} times as long", short(patches / best.patches))
        } else {
            "too much longer to tell".to_owned()
        };
        format!(
            "Camera {camera}, {what} instead of looking up, to the {percent} % of \"{name}\": \
             {crossing}; {FRAMES} frames take {} times as long as with it, bake included. The \
             patches' light alone takes {light} a frame.",
            short(FRAMES * other / cost(&best))
        )
    };
    against.map(sentence).into()
}
