//! What patches are expanded in: error of the picture against bytes, bake and look-up,
//! beside summing over the windows for every pixel.

use super::{Bench, baked, relative_rms};
use crate::accel::Accel;
use crate::camera::Pinhole;
use crate::reference::{Quadrature, WindowSum};
use crate::report::{Chart, Cost, Point, Section, Series, Table, Value, cpu_time, short, time_to};
use crate::scene::Scene;
use crate::whitted::{PatchRadiance, Sample};
use anyhow::Context as _;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::hint::black_box;

/// Scenes, each with the cameras that see its floor.
const SCENES: [(&str, &str, [&str; 2]); 2] = [
    ("chapel, one window", "chapel/chapel.gltf", ["top", "low"]),
    ("hall, twelve windows", "hall/hall.gltf", ["above", "along"]),
];

/// Cells of an emitter, 4^level of them, that the truth is summed over.
const TRUTH: u8 = 6;

/// The error that ratios are stated for.
const TARGET: f64 = 5e-3;

/// Pixels of a frame that costs are stated for.
const FRAME: f64 = 512.0 * 512.0;

/// Pixels of the floor, from left to right and top to bottom, and what they show.
struct Floor {
    pixels: Vec<(usize, u32, DVec3, DVec3)>,
    truth: Vec<Vec3>,
    /// Of all pixels.
    share: f64,
}

impl Floor {
    fn new(
        scene: &Scene,
        accel: &Accel,
        camera: &str,
        [width, height]: [usize; 2],
    ) -> anyhow::Result<Self> {
        let exact = Quadrature::new(scene, TRUTH)?;
        let camera = scene.cameras.iter().find(|c| c.name == camera).context("its camera")?;
        let pinhole = Pinhole::new(camera, width, height);
        let at = |i: usize, n: usize| (i as f64 + 0.5) / n as f64;
        let seen = (0..width * height).filter_map(|i| {
            let (origin, along) = pinhole.ray(at(i % width, width), at(i / width, height));
            let hit = accel.closest(origin, along, 0.0, f64::INFINITY)?;
            let floor = hit.front && exact.covers(hit.mesh, hit.triangle);
            floor.then_some((hit.mesh, hit.triangle, hit.position, -along))
        });
        let pixels: Vec<_> = seen.collect();
        let share = pixels.len() as f64 / (width * height) as f64;
        let truth = pixels.par_iter().map(|pixel| radiance(&exact, pixel)).collect();
        Ok(Self { pixels, truth, share })
    }

    fn error(&self, patches: &dyn PatchRadiance) -> f64 {
        let found = self.pixels.iter().zip(&self.truth);
        relative_rms(found.flat_map(|(pixel, truth)| {
            let pair = radiance(patches, pixel).to_array().into_iter().zip(truth.to_array());
            pair.map(|(a, b)| (f64::from(a), f64::from(b)))
        }))
    }

    /// A pixel's, in seconds.
    fn cost(&self, patches: &dyn PatchRadiance, runs: usize) -> Cost {
        // Long enough for the clock.
        let once = cpu_time(1, || self.look_at_all(patches)).1.median;
        let rounds = (0.02 / once.max(1e-6)).ceil().clamp(1.0, 1000.0) as usize;
        let (_, cost) = cpu_time(runs, || (0..rounds).for_each(|_| self.look_at_all(patches)));
        cost.per((rounds * self.pixels.len()) as f64)
    }

    fn look_at_all(&self, patches: &dyn PatchRadiance) {
        for pixel in &self.pixels {
            black_box(radiance(patches, pixel));
        }
    }
}

fn radiance(
    patches: &dyn PatchRadiance,
    &(mesh, triangle, position, eye): &(usize, u32, DVec3, DVec3),
) -> Vec3 {
    patches.outgoing(mesh, triangle, position, eye, &Sample::default()).unwrap_or_default()
}

/// A way to have the floor's light.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Way {
    Box,
    Multilinear,
    /// Orders of position and direction.
    Smooth(u8, u8),
    Sum,
}

impl Way {
    fn name(self) -> String {
        match self {
            Self::Box => "Haar, nearest cell".to_owned(),
            Self::Multilinear => "Haar, multilinear".to_owned(),
            Self::Smooth(p, q) => format!("smooth, orders {p}, {q}"),
            Self::Sum => "windows summed a pixel".to_owned(),
        }
    }
}

struct Row {
    scene: &'static str,
    camera: &'static str,
    way: Way,
    options: String,
    error: f64,
    cost: Cost,
    frame: f64,
    bake: Option<(u64, f64)>,
}

pub(super) fn measure(bench: &Bench) -> anyhow::Result<Section> {
    let size = bench.choose([48, 36], [160, 120]);
    let mut rows = Vec::new();
    for (name, path, cameras) in SCENES {
        let scene = bench.scene(path)?;
        let accel = Accel::new(&scene);
        let floor =
            |camera: &&'static str| Ok((*camera, Floor::new(&scene, &accel, camera, size)?));
        let floors: Vec<(&str, Floor)> =
            cameras.iter().map(floor).collect::<anyhow::Result<_>>()?;
        let mut add = |way: Way, options: &str, bake, patches: &dyn PatchRadiance| {
            for (camera, floor) in &floors {
                let cost = floor.cost(patches, bench.runs());
                rows.push(Row {
                    scene: name,
                    camera,
                    way,
                    options: options.to_owned(),
                    error: floor.error(patches),
                    cost,
                    frame: cost.median * floor.share * FRAME,
                    bake,
                });
            }
        };
        for levels in bench.choose(&[[3, 4]][..], &[[4, 4], [5, 5], [4, 6]]) {
            let [position, direction] = levels.map(|l: u8| l.to_string());
            let flags = ["--level", &position, "--direction-level", &direction, "--checks", "0"];
            let bake = baked(&scene, &flags)?;
            let (options, cost) = (flags[..4].join(" "), Some((bake.bytes, bake.seconds)));
            add(Way::Multilinear, &options, cost, &bake.texture);
            add(Way::Box, &options, cost, &bake.texture.nearest());
        }
        for (orders, errors) in smooth(bench) {
            for error in errors {
                let text = format!("{},{}", orders[0], orders[1]);
                let flags = ["--orders", &text, "--error", error, "--checks", "0"];
                let bake = baked(&scene, &flags)?;
                let cost = Some((bake.bytes, bake.seconds));
                add(Way::Smooth(orders[0], orders[1]), &flags[2..4].join(" "), cost, &bake.texture);
            }
        }
        for side in bench.choose(&[2, 4, 8, 16][..], &[2, 3, 4, 5, 6, 8, 10, 12, 16, 24, 32]) {
            let sum = WindowSum::new(&scene, *side)?;
            let options = format!("{side}² a window, {} in all", sum.points());
            add(Way::Sum, &options, None, &sum);
        }
    }
    let views = SCENES.iter().flat_map(|(name, _, cameras)| cameras.map(|c| (*name, c)));
    let views: Vec<(&str, &str)> = views.collect();
    let of = |view: &(&str, &str)| -> Vec<&Row> {
        rows.iter().filter(|row| (row.scene, row.camera) == *view).collect()
    };
    let mut text = vec![format!(
        "Light that the floor sends to the camera's pixels, {} × {} of them, one ray each, nothing else counted: no punctual lights, no rays. Error is the root of mean squares over the floor's pixels against a sum over 64² cells of each window. Times are CPU time of one thread. Summing is done in single precision, eight points at a time, over a grid of each window's means: the least code that one would write instead of baking. Orders are the highest degrees of polynomials, + 1, in position and direction; --error says how far each patch may be off over all directions.",
        size[0], size[1]
    )];
    let ratios: Vec<Ratio> = views.iter().flat_map(|view| ratios(view, &of(view))).collect();
    text.extend(summary(&ratios));
    text.extend(ratios.iter().map(Ratio::sentence));
    let charts = views.iter().flat_map(|view| charts(view, &of(view))).collect();
    let smooth = rows.iter().filter(|row| matches!(row.way, Way::Smooth(..)));
    Ok(Section {
        id: "bases",
        title: "Boxes, polynomials, or no texture at all",
        text,
        charts,
        tables: vec![
            Table {
                name: "bases-ratios",
                caption: "The smooth basis against the others at equal error: time with one fast enough for 0.5 %, bytes with the usual orders, between two files by a power law.".to_owned(),
                head: vec![
                    "scene",
                    "camera",
                    "error",
                    "of",
                    "against",
                    "its cost",
                    "smooth basis",
                    "its options",
                    "its cost",
                    "times less",
                ],
                rows: ratios.iter().map(Ratio::values).collect(),
            },
            Table {
                name: "bases-orders",
                caption: "Look-ups by orders of position and direction.".to_owned(),
                head: vec![
                    "scene",
                    "camera",
                    "orders",
                    "options",
                    "error",
                    "a look-up, ns",
                    "bytes of the file",
                    "bake, CPU s",
                ],
                rows: smooth.map(Row::look_up).collect(),
            },
            Table {
                name: "bases",
                caption: "The floor's pixels by how their light was had.".to_owned(),
                head: vec![
                    "scene",
                    "camera",
                    "how",
                    "options",
                    "error",
                    "a pixel, ns",
                    "slowest / fastest",
                    "floor of a 512² frame, ms",
                    "bytes of the file",
                    "bake, CPU s",
                ],
                rows: rows.iter().map(Row::values).collect(),
            },
        ],
        ..Section::default()
    })
}

/// Orders, and the errors asked for with them.
fn smooth(bench: &Bench) -> Vec<([u8; 2], &'static [&'static str])> {
    const USUAL: &[&str] = &["0.1", "0.05", "0.02", "0.01", "0.007", "0.005", "0.002"];
    const OTHER: &[&str] = &["0.02", "0.005"];
    bench.choose(
        vec![([4, 4], &["0.05", "0.02"][..])],
        vec![
            ([4, 4], USUAL),
            ([1, 2], &["0.1"]),
            ([2, 3], OTHER),
            ([3, 3], OTHER),
            ([3, 4], OTHER),
            ([5, 5], OTHER),
            ([6, 6], OTHER),
            ([7, 7], OTHER),
        ],
    )
}

impl Row {
    fn values(&self) -> Vec<Value> {
        vec![
            self.scene.into(),
            self.camera.into(),
            self.way.name().into(),
            self.options.clone().into(),
            Value::Percent(self.error),
            Value::Number(1e9 * self.cost.median),
            Value::Number(self.cost.spread()),
            Value::Number(1e3 * self.frame),
            self.bake.map_or(Value::Nothing, |bake| Value::Count(bake.0)),
            self.bake.map_or(Value::Nothing, |bake| Value::Number(bake.1)),
        ]
    }

    /// What a look-up with its orders costs, and is worth.
    fn look_up(&self) -> Vec<Value> {
        vec![
            self.scene.into(),
            self.camera.into(),
            self.way.name().into(),
            self.options.clone().into(),
            Value::Percent(self.error),
            Value::Number(1e9 * self.cost.median),
            self.bake.map_or(Value::Nothing, |bake| Value::Count(bake.0)),
            self.bake.map_or(Value::Nothing, |bake| Value::Number(bake.1)),
        ]
    }
}

/// Error against time and against bytes, and against time for each pair of orders.
fn charts((scene, camera): &(&str, &str), rows: &[&Row]) -> Vec<Chart> {
    let is_usual = |way: Way| !matches!(way, Way::Smooth(p, q) if (p, q) != (4, 4));
    let chart =
        |what: &str, label, shown: &dyn Fn(Way) -> bool, x: &dyn Fn(&Row) -> Option<f64>| {
            let mut ways: Vec<Way> = Vec::new();
            for row in rows {
                if shown(row.way) && !ways.contains(&row.way) {
                    ways.push(row.way);
                }
            }
            Chart {
                title: format!("{scene}, {camera}: {what}"),
                axes: [label, "relative RMS error"],
                series: ways
                    .iter()
                    .map(|way| {
                        let own = rows.iter().filter(|row| row.way == *way);
                        let point =
                            |row: &&Row| Some(Point { x: x(row)?, y: row.error, range: None });
                        Series { name: way.name(), points: own.filter_map(point).collect() }
                    })
                    .filter(|series| !series.points.is_empty())
                    .collect(),
                ..Chart::default()
            }
        };
    let time = |row: &Row| Some(1e9 * row.cost.median);
    let bytes = |row: &Row| row.bake.map(|bake| bake.0 as f64);
    let is_smooth = |way: Way| matches!(way, Way::Smooth(..));
    vec![
        chart("time", "CPU time a pixel, ns", &is_usual, &time),
        chart("bytes", "bytes of the file", &is_usual, &bytes),
        chart("orders", "CPU time a look-up, ns", &is_smooth, &time),
    ]
}

/// What two costs are of.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Of {
    /// A pixel's time, ns.
    Time,
    /// A file, bytes.
    Bytes,
}

/// A cost by the smooth basis beside another one's, at the same error.
struct Ratio {
    scene: String,
    camera: String,
    error: f64,
    of: Of,
    /// What it is compared with, and its options.
    other: String,
    /// `None` if no run of those measured reaches the error.
    other_cost: Option<f64>,
    way: String,
    /// Empty where it is between two files.
    options: String,
    cost: f64,
}

impl Ratio {
    fn times(&self) -> Option<f64> {
        self.other_cost.map(|other| other / self.cost)
    }

    fn values(&self) -> Vec<Value> {
        let number = |x: f64| match self.of {
            Of::Time => Value::Number(x),
            Of::Bytes => Value::Count(x.round() as u64),
        };
        vec![
            self.scene.clone().into(),
            self.camera.clone().into(),
            Value::Percent(self.error),
            ["a pixel, ns", "bytes"][self.of as usize].into(),
            self.other.clone().into(),
            self.other_cost.map_or(Value::Nothing, number),
            self.way.clone().into(),
            self.options.clone().into(),
            number(self.cost),
            self.times().map_or(Value::Nothing, Value::Number),
        ]
    }

    fn sentence(&self) -> String {
        let Self { scene, camera, other, way, options, cost, .. } = self;
        let error = short(100.0 * self.error);
        match (self.of, self.other_cost.zip(self.times())) {
            (Of::Time, Some((sum, times))) => format!(
                "{scene}, camera {camera}: {error} % by {way} and {options} takes {} ns a pixel; to that error summing takes {} ns, {} times as long.",
                short(*cost),
                short(sum),
                short(times)
            ),
            (Of::Bytes, Some((bytes, times))) => format!(
                "{scene}, camera {camera}: to the {error} % of {other} and {bytes} bytes, the smooth basis takes {} bytes, {} times fewer.",
                cost.round(),
                short(times)
            ),
            (_, None) => format!(
                "{scene}, camera {camera}: {error} % by {way} and {options} takes {} ns a pixel; no grid of those measured reaches it.",
                short(*cost)
            ),
        }
    }
}

/// The ranges of ratios: the two figures that the section is for.
fn summary(ratios: &[Ratio]) -> Vec<String> {
    let range = |of: Of| {
        let own = ratios.iter().filter(|ratio| ratio.of == of);
        let times: Vec<f64> = own.filter_map(Ratio::times).collect();
        let [least, most] = [f64::min, f64::max].map(|f| times.iter().copied().reduce(f));
        least.zip(most).map(|(least, most)| format!("{} to {}", short(least), short(most)))
    };
    let faster = range(Of::Time).map(|times| {
        let target = short(100.0 * TARGET);
        format!("At equal error of at most {target} %, look-ups of polynomials are {times} times faster than summing over the windows for every pixel.")
    });
    let fewer = range(Of::Bytes).map(|times| {
        format!("At equal error, their files have {times} times fewer bytes than Haar's.")
    });
    faster.into_iter().chain(fewer).collect()
}

/// Ratios at equal error.
fn ratios((scene, camera): &(&str, &str), rows: &[&Row]) -> Vec<Ratio> {
    let mut found = Vec::new();
    let curve = |mut rows: Vec<[f64; 2]>| {
        rows.sort_by(|a, b| a[0].total_cmp(&b[0]));
        rows
    };
    let within = |row: &&&Row| matches!(row.way, Way::Smooth(..)) && row.error <= TARGET;
    let best = rows.iter().filter(within);
    let best = best.min_by(|a, b| a.cost.median.total_cmp(&b.cost.median));
    let sums = rows.iter().filter(|row| row.way == Way::Sum);
    let sums = curve(sums.map(|row| [row.cost.median, row.error]).collect());
    if let Some(best) = best {
        found.push(Ratio {
            scene: (*scene).to_owned(),
            camera: (*camera).to_owned(),
            error: best.error,
            of: Of::Time,
            other: Way::Sum.name(),
            other_cost: time_to(&sums, best.error).map(|sum| 1e9 * sum),
            way: best.way.name(),
            options: best.options.clone(),
            cost: 1e9 * best.cost.median,
        });
    }
    let usual = Way::Smooth(4, 4);
    let smooth = rows.iter().filter(|row| row.way == usual);
    let smooth = curve(smooth.filter_map(|row| Some([row.bake?.0 as f64, row.error])).collect());
    for haar in rows.iter().filter(|row| row.way == Way::Multilinear) {
        // No file with more error: none of as much.
        let equal = smooth.iter().any(|run| run[1] >= haar.error);
        let fewer = time_to(&smooth, haar.error).filter(|_| equal);
        if let (Some((bytes, _)), Some(fewer)) = (haar.bake, fewer) {
            found.push(Ratio {
                scene: (*scene).to_owned(),
                camera: (*camera).to_owned(),
                error: haar.error,
                of: Of::Bytes,
                other: format!("Haar with {}", haar.options),
                other_cost: Some(bytes as f64),
                way: usual.name(),
                options: String::new(),
                cost: fewer,
            });
        }
    }
    found
}
