//! The common edge of two baked tiles of one material.

use crate::render::chapel_by_window_light;
use crate::support::chapel::{Chapel, Tile};
use crate::support::{Folder, succeed};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use serde_json::json;
use wrt_core::legendre::LegendreSampler;
use wrt_core::{Nusselt, PatchGeometry, Polygon, Sampler, WctFile};

/// Tiles that meet at x = 0, and which of them the other's material is given to.
const TILES: [&str; 2] = ["tile_11", "tile_12"];

/// A place on the common edge and a direction in which it is seen.
struct Probe {
    point: DVec2,
    to_eye: DVec3,
    truth: [f64; 3],
}

/// The chapel with two tiles, both of the first's material.
fn two_tiles(folder: &Folder) -> (Chapel, String) {
    let mut chapel = Chapel::read();
    let nodes = chapel.document["nodes"].as_array_mut().expect("a list of nodes");
    let mut meshes = Vec::new();
    for node in nodes.iter_mut().filter(|node| node["extras"]["wrt"]["receiver"] == true) {
        match TILES.iter().any(|name| node["name"] == *name) {
            true => meshes.push(node["mesh"].as_u64().expect("a mesh") as usize),
            false => node["extras"]["wrt"]["receiver"] = json!(false),
        }
    }
    let [first, second] = meshes[..] else { panic!("two tiles, not {meshes:?}") };
    let meshes = &mut chapel.document["meshes"];
    let material = meshes[first]["primitives"][0]["material"].clone();
    meshes[second]["primitives"][0]["material"] = material;
    let path = chapel_by_window_light(&chapel, folder);
    (chapel, path)
}

/// Well spread over the edge and the hemisphere of directions, uniformly in (κ, λ).
fn probes(chapel: &Chapel, count: usize) -> Vec<Probe> {
    let tile = |name: &str| -> &Tile {
        chapel.tiles.iter().find(|tile| tile.name == name).expect("the tile")
    };
    let [left, right] = TILES.map(tile);
    assert_eq!((left.high.x, left.low.y), (right.low.x, right.low.y), "neighbours");
    let places = (0..count).into_par_iter().map(|i| {
        let along = |step: f64| (0.5 + i as f64 * step).fract();
        let z = left.low.y + along(0.819_172_513) * (left.high.y - left.low.y);
        let (r, phi) = (along(0.671_043_607).sqrt(), std::f64::consts::TAU * along(0.549_700_478));
        let (x, y) = (r * phi.cos(), r * phi.sin());
        let to_eye = DVec3::new(x, (1.0 - r * r).sqrt(), y);
        let point = DVec2::new(left.high.x, z);
        Probe { point, to_eye, truth: chapel.reflected(left, point, to_eye) }
    });
    places.collect()
}

/// What a patch says at the probes.
fn looked_up(
    geometry: &PatchGeometry,
    probes: &[Probe],
    look_up: impl Fn(DVec2, DVec3) -> [f32; 3],
) -> Vec<[f64; 3]> {
    let polygon: Polygon = geometry.to_polygon().expect("a rectangle");
    let (frame, size) = (polygon.frame(), polygon.size().expect("a rectangle"));
    let at = |probe: &Probe| {
        let point = DVec3::new(probe.point.x, 0.0, probe.point.y);
        let uv = frame.to_local(point - frame.origin).truncate() / size;
        assert!(uv.x.min(1.0 - uv.x).min(uv.y).min(1.0 - uv.y).abs() < 1e-9, "on the edge: {uv}");
        look_up(uv, frame.to_local(probe.to_eye)).map(f64::from)
    };
    probes.iter().map(at).collect()
}

fn rms(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    let squares = a.iter().zip(b).flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)));
    (squares.sum::<f64>() / (3 * a.len()) as f64).sqrt()
}

#[test]
fn tiles_of_one_material_have_no_seam() {
    let folder = Folder::new();
    let (chapel, scene) = two_tiles(&folder);
    let probes = probes(&chapel, 400);
    let truth: Vec<[f64; 3]> = probes.iter().map(|probe| probe.truth).collect();
    let zero = vec![[0.0; 3]; truth.len()];
    for options in [
        &["--level", "4", "--direction-level", "5"][..],
        &["--level", "4", "--direction-level", "6"],
        &["--level", "5", "--direction-level", "6"],
        &["--error", "0.02"],
        &["--error", "0.005"],
    ] {
        let wct = folder.path("two.wct");
        succeed(&[&["bake", &scene, "-o", &wct, "--checks", "500"], options].concat());
        let file = WctFile::read(&wct).expect("a file");
        let mut sides = Vec::new();
        for name in TILES {
            if let Some(patch) = file.patch(name) {
                let sampler = Sampler::new(&patch.tree);
                let found = looked_up(&patch.polygon, &probes, |uv, mu| {
                    let q = Nusselt::from_direction(mu).expect("a direction upwards");
                    sampler.multilinear([uv.x, uv.y, q.kappa, q.lambda])
                });
                sides.push((found, patch.error_estimate));
            } else {
                let patch = file.smooth.iter().find(|patch| patch.name == name).expect("a patch");
                let sampler = LegendreSampler::new(&patch.tree);
                let found = looked_up(&patch.polygon, &probes, |uv, mu| sampler.radiance(uv, mu));
                sides.push((found, patch.error_estimate));
            }
        }
        let [(left, left_error), (right, right_error)] = &sides[..] else { panic!("two tiles") };
        let size = rms(&truth, &zero);
        for (name, (found, stated)) in TILES.iter().zip([(left, left_error), (right, right_error)])
        {
            let stated = stated.expect("the error of a baked patch");
            // The edge is no worse than the rest: lit a little otherwise, and by fewer probes.
            let error = rms(found, &truth) / size;
            assert!(
                error < 1.5 * stated,
                "{options:?}, {name}: {error} on the edge, {stated} stated"
            );
            let seam = rms(left, right) / size;
            assert!(seam < 1.5 * stated, "{options:?}: a step of {seam}, {stated} stated");
        }
    }
}
