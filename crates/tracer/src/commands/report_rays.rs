//! `tracer report rays`: how many rays a second the hierarchy answers.
//!
//! Two sets on one mesh, a bumpy sphere: camera rays in the order of the pixels,
//! and rays that leave what those hit in random directions about the normal, in
//! random order. All look for what they meet first: which triangle, and where on it.
//! Camera rays do so together, as neighbouring pixels' do, and one by one; the others side
//! by side, as rays from mirrors and glass do, and one by one.
//! `tests/embree_rays.py` measures Embree with the same mesh and rays.

use super::stdout::say;
use crate::accel::{self, Accel};
use crate::camera::Pinhole;
use crate::cli::Rays;
use crate::render::TOGETHER;
use crate::scene::{Camera, Material, Mesh, Projection, Scene};
use crate::threads::in_pool;
use anyhow::Context as _;
use cpu_time::ProcessTime;
use glam::{DAffine3, DVec3};
use rayon::prelude::*;
use serde_json::json;
use std::f64::consts::{PI, TAU};
use std::path::Path;
use std::time::Instant;

/// Origin and unit direction.
type Ray = (DVec3, DVec3);

/// Measures and prints one line of JSON.
pub(crate) fn run(args: &Rays) -> anyhow::Result<()> {
    in_pool(args.threads, || measure(args))?
}

fn measure(args: &Rays) -> anyhow::Result<()> {
    let scene = bumpy_sphere(args.triangles);
    let triangles = scene.meshes[0].triangles.len();
    let start = Instant::now();
    let accel = Accel::new(&scene);
    let build = start.elapsed().as_secs_f64();
    let primary = primary(args.rays as usize);
    let diffuse = diffuse(&accel, &primary);
    if let Some(folder) = &args.dump {
        dump(folder, &scene.meshes[0], &[("primary", &primary), ("diffuse", &diffuse)])?;
    }
    let mut fields = json!({
        "triangles": triangles,
        "threads": rayon::current_num_threads(),
        "build_seconds": build,
    });
    let sets: [(&str, &[Ray], Count); 4] = [
        ("primary", &primary, together),
        ("primary_one_by_one", &primary, one_by_one),
        ("diffuse", &diffuse, side_by_side),
        ("diffuse_one_by_one", &diffuse, one_by_one),
    ];
    for (name, rays, count) in sets {
        let mut rates = Vec::new();
        let mut hits = 0;
        for _ in 0..args.repeats {
            let (wall, cpu) = (Instant::now(), ProcessTime::now());
            hits = rays.par_chunks(1 << 12).map(|block| count(&accel, block)).sum();
            let rate = |seconds: f64| rays.len() as f64 / 1e6 / seconds;
            rates.push((rate(cpu.elapsed().as_secs_f64()), rate(wall.elapsed().as_secs_f64())));
        }
        rates.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (per_cpu_second, per_second) = rates[rates.len() / 2];
        fields[name] = json!({
            "rays": rays.len(),
            "hits": hits,
            "mrays_per_cpu_second": per_cpu_second,
            "mrays_per_second": per_second,
        });
    }
    say(fields)?;
    Ok(())
}

/// How many rays hit something.
type Count = fn(&Accel, &[Ray]) -> usize;

fn one_by_one(accel: &Accel, rays: &[Ray]) -> usize {
    let hits =
        |(origin, direction): &&Ray| accel.find(*origin, *direction, 0.0, f64::INFINITY).is_some();
    rays.iter().filter(hits).count()
}

fn side_by_side(accel: &Accel, rays: &[Ray]) -> usize {
    let (mut batch, mut found) = (Vec::new(), Vec::new());
    let ray = |&(origin, direction): &Ray| accel::Ray { origin, direction, from: 0.0 };
    let mut hits = |rays: &[Ray]| {
        batch.clear();
        batch.extend(rays.iter().map(ray));
        accel.find_each(&batch, &mut found);
        found.iter().flatten().count()
    };
    rays.chunks(TOGETHER).map(&mut hits).sum()
}

/// Of rays from one point.
fn together(accel: &Accel, rays: &[Ray]) -> usize {
    let (mut directions, mut found) = (Vec::new(), Vec::new());
    let mut hits = |rays: &[Ray]| {
        directions.clear();
        directions.extend(rays.iter().map(|ray| ray.1));
        accel.find_of(rays[0].0, &directions, &mut found);
        found.iter().flatten().count()
    };
    rays.chunks(TOGETHER).map(&mut hits).sum()
}

/// A closed sphere of radius 1 with bumps, of about so many triangles.
fn bumpy_sphere(triangles: u32) -> Scene {
    // Twice as many sectors as rings, two triangles a quadrilateral.
    let rings = (f64::from(triangles) / 4.0).sqrt().round() as u32;
    let sectors = 2 * rings;
    let vertex = |ring: u32, sector: u32| {
        let polar = PI * f64::from(ring) / f64::from(rings);
        let azimuth = TAU * f64::from(sector) / f64::from(sectors);
        let bump = 1.0 + 0.05 * (23.0 * azimuth).sin() * (17.0 * polar).sin();
        let (sin, cos) = polar.sin_cos();
        // As single precision, which other programs take.
        let p = bump * DVec3::new(sin * azimuth.cos(), cos, -sin * azimuth.sin());
        p.as_vec3().as_dvec3()
    };
    let index = |ring: u32, sector: u32| ring * sectors + sector % sectors;
    let quads = (0..rings).flat_map(|ring| (0..sectors).map(move |sector| (ring, sector)));
    let triangles = quads.flat_map(|(ring, sector)| {
        let (a, b) = (index(ring, sector), index(ring, sector + 1));
        let (c, d) = (index(ring + 1, sector), index(ring + 1, sector + 1));
        [[a, c, d], [a, d, b]]
    });
    let mesh = Mesh {
        positions: (0..=rings)
            .flat_map(|ring| (0..sectors).map(move |sector| (ring, sector)))
            .map(|(ring, sector)| vertex(ring, sector))
            .collect(),
        triangles: triangles.collect(),
        ..Mesh::default()
    };
    Scene { meshes: vec![mesh], materials: vec![Material::default()], ..Scene::default() }
}

/// Rays through the pixels of a square picture that the sphere fills, by rows.
fn primary(count: usize) -> Vec<Ray> {
    let side = (count as f64).sqrt().floor().max(1.0) as usize;
    let camera = Camera {
        name: String::new(),
        transform: DAffine3::from_translation(DVec3::Z * 3.0),
        projection: Projection::Perspective { yfov: 0.75 },
        aspect: None,
    };
    let pinhole = Pinhole::new(&camera, side, side);
    let at = |i: usize| (i as f64 + 0.5) / side as f64;
    let ray = |i: usize| {
        let (origin, direction) = pinhole.ray(at(i % side), at(i / side));
        single(origin, direction)
    };
    (0..side * side).map(ray).collect()
}

/// From the hits of `rays`, in directions with a density of cosθ/π, shuffled.
fn diffuse(accel: &Accel, rays: &[Ray]) -> Vec<Ray> {
    let mut state = 1_u64;
    let mut random = move || {
        // PCG's multiplier; the upper bits are the good ones (M. O'Neill, 2014).
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut leaving = Vec::with_capacity(rays.len());
    for &(origin, direction) in rays {
        let Some(hit) = accel.closest(origin, direction, 0.0, f64::INFINITY) else { continue };
        let (z, azimuth) = (2.0 * random() - 1.0, TAU * random());
        let r = (1.0 - z * z).sqrt();
        // A point of the sphere on the normal's tip.
        let about = hit.normal + DVec3::new(r * azimuth.cos(), r * azimuth.sin(), z);
        let direction = about.try_normalize().unwrap_or(hit.normal);
        leaving.push(single(hit.position + 1e-4 * hit.normal, direction));
    }
    for i in (1..leaving.len()).rev() {
        leaving.swap(i, (random() * (i + 1) as f64) as usize);
    }
    leaving
}

/// The ray that a program in single precision is given.
fn single(origin: DVec3, direction: DVec3) -> Ray {
    let direction = direction.as_vec3().as_dvec3().normalize();
    (origin.as_vec3().as_dvec3(), direction)
}

fn dump(folder: &Path, mesh: &Mesh, sets: &[(&str, &[Ray])]) -> anyhow::Result<()> {
    let write = |name: &str, bytes: Vec<u8>| {
        let path = folder.join(name);
        std::fs::write(&path, bytes).with_context(|| format!("writing {}", path.display()))
    };
    let floats = |v: &DVec3| v.as_vec3().to_array().into_iter().flat_map(f32::to_le_bytes);
    write("positions.f32", mesh.positions.iter().flat_map(floats).collect())?;
    let indices = mesh.triangles.iter().flatten().flat_map(|i| i.to_le_bytes());
    write("triangles.u32", indices.collect())?;
    for (name, rays) in sets {
        let both = rays.iter().flat_map(|(o, d)| floats(o).chain(floats(d)));
        write(&format!("{name}.f32"), both.collect())?;
    }
    Ok(())
}
