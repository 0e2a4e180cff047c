//! What a bake says of its error, and what it is.

use super::{Bench, baked};
use crate::reference::Quadrature;
use crate::report::{Section, Table, Value};
use crate::scene::Scene;
use crate::whitted::{PatchRadiance, Sample};
use glam::{DVec2, Vec3};
use rayon::prelude::*;
use wrt_core::{Nusselt, sobol};

/// Cells of an emitter, 4^level of them, that the truth is summed over.
const TRUTH: u8 = 6;

/// Relative RMS error of looked-up radiance over `points` random positions and
/// directions of each receiver, against a midpoint rule over the emitters.
pub(super) fn true_error(
    scene: &Scene,
    texture: &dyn PatchRadiance,
    points: u32,
) -> anyhow::Result<f64> {
    let truth = Quadrature::new(scene, TRUTH)?;
    let of_point = |(receiver, i): (usize, u32)| -> Option<(Vec3, Vec3)> {
        let tile = &truth.receivers[receiver];
        let u: [f64; 4] =
            std::array::from_fn(|d| sobol(i, d, 501 + 4 * receiver as u32 + d as u32));
        let mu = Nusselt { kappa: u[2], lambda: u[3] }.to_direction()?;
        let frame = tile.polygon.frame();
        let position = frame.point(DVec2::new(u[0], u[1]) * tile.polygon.size()?);
        let (mesh, triangle) = (tile.planar.mesh, *tile.planar.triangles.first()?);
        let at = |patches: &dyn PatchRadiance| {
            patches.outgoing(mesh, triangle, position, frame.to_world(mu), &Sample::default())
        };
        Some((at(texture)?, at(&truth)?))
    };
    let all: Vec<(usize, u32)> =
        (0..truth.receivers.len()).flat_map(|r| (0..points).map(move |i| (r, i))).collect();
    let pairs: Vec<(Vec3, Vec3)> = all.into_par_iter().filter_map(of_point).collect();
    let channels = pairs.iter().flat_map(|(a, b)| {
        a.to_array().map(f64::from).into_iter().zip(b.to_array().map(f64::from))
    });
    Ok(super::relative_rms(channels))
}

pub(super) fn measure(bench: &Bench) -> anyhow::Result<Section> {
    let points = bench.choose(64, 512);
    let scenes = ["facing/facing.gltf", "quad/quad.gltf", "chapel/chapel.gltf"];
    let mut rows = Vec::new();
    for path in scenes {
        let scene = bench.scene(path)?;
        for asked in bench.choose(&["0.03", "0.01"][..], &["0.1", "0.03", "0.01", "0.003", "0.001"])
        {
            let bake = baked(&scene, &["--error", asked])?;
            let found = true_error(&scene, &bake.texture, points)?;
            let asked: f64 = asked.parse()?;
            rows.push(vec![
                path.into(),
                Value::Percent(asked),
                Value::Percent(found),
                Value::Number(found / asked),
                bake.error.map_or(Value::Nothing, Value::Percent),
                Value::Count(bake.coefficients),
                Value::Count(bake.bytes),
                Value::Number(bake.seconds),
            ]);
        }
    }
    let coarse: &[&str] = &["--level", "3"];
    let default: &[&str] = &["--basis", "haar"];
    let paper: &[&str] = &["--level", "5", "--compress", "0.95"];
    let options: &[&[&str]] = &[coarse, paper, default];
    let options = &options[..bench.choose(1, 3)];
    let mut haar = Vec::new();
    for path in scenes {
        let scene = bench.scene(path)?;
        for flags in options {
            let bake = baked(&scene, flags)?;
            let found = true_error(&scene, &bake.texture, points)?;
            haar.push(vec![
                path.into(),
                flags.join(" ").into(),
                bake.error.map_or(Value::Nothing, Value::Percent),
                Value::Percent(found),
                bake.error.map_or(Value::Nothing, |e| Value::Number(found / e)),
                Value::Count(bake.coefficients),
                Value::Count(bake.bytes),
                Value::Number(bake.seconds),
            ]);
        }
    }
    Ok(Section {
        id: "estimates",
        title: "Asked, estimated and true error of a bake",
        text: vec![format!(
            "True is the relative RMS error of looked-up radiance at {points} positions and directions a tile, all tiles together, against quadrature over 64² cells of each emitter, textures averaged over the cells. Directions are spread evenly over the hemisphere by projected solid angle, wherever a camera could be."
        )],
        tables: vec![
            Table {
                name: "error-asked",
                caption: "Smooth basis, to an error asked for by --error.".to_owned(),
                head: vec![
                    "scene",
                    "asked",
                    "true",
                    "true / asked",
                    "estimated by the bake",
                    "coefficients",
                    "bytes",
                    "CPU time, s",
                ],
                rows,
            },
            Table {
                name: "error-haar",
                caption: "Haar basis, to levels; the bake estimates its error at 64 points a tile."
                    .to_owned(),
                head: vec![
                    "scene",
                    "options",
                    "estimated",
                    "true",
                    "true / estimated",
                    "coefficients",
                    "bytes",
                    "CPU time, s",
                ],
                rows: haar,
            },
        ],
        ..Section::default()
    })
}
