//! A floor lit through a window from outside, baked in either basis, against closed forms
//! and quadrature that knows neither wavelets nor tables.

use super::*;
use crate::scene::{Material, Mesh, weather::light_windows};
use glam::{DVec2, Vec3};
use std::f64::consts::PI;
use wrt_core::legendre::LegendreSampler;
use wrt_core::{Glazing, Phong, Sky, SkyModel};

/// The window: 2 m wide about x = 0, from 0.8 to 2 m above the floor, in the plane z = 0
/// that looks south (+z), so that its outside looks north.
const SILL: f64 = 0.8;
const TOP: f64 = 2.0;
const HALF: f64 = 1.0;

/// Lies on the floor y = 0 before the window: x from −1 to 1, z from 1 to 3.
fn scene(glazing: Glazing, sky: Sky) -> Scene {
    let mesh = |corners: [[f64; 3]; 4], material: usize, receiver| Mesh {
        name: ["window", "floor"][material].to_owned(),
        positions: corners.map(DVec3::from).to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        material,
        receiver,
        ..Mesh::default()
    };
    let glass = [[-HALF, SILL, 0.], [HALF, SILL, 0.], [HALF, TOP, 0.], [-HALF, TOP, 0.]];
    let floor = [[-1., 0., 1.], [-1., 0., 3.], [1., 0., 3.], [1., 0., 1.]];
    let white = Material { kd: Vec3::ONE, ks: Vec3::ZERO, ..Material::default() };
    let window = Material { emission: Vec3::ONE, glazing: Some(glazing), ..Material::default() };
    let mut scene = Scene {
        meshes: vec![mesh(glass, 0, false), mesh(floor, 1, true)],
        materials: vec![window, white],
        sky: Some(sky),
        ..Scene::default()
    };
    light_windows(&mut scene).expect("a plane");
    scene
}

/// Irradiance of the floor as looked up, at (x, z), from a bake in the smooth basis and
/// one in Haar's.
fn baked(scene: &Scene, error: f64, points: &[(f64, f64)]) -> [Vec<f64>; 2] {
    let options = |smooth| BakeOptions {
        smooth,
        flight: None,
        levels: Levels { position: 5, direction: 4 },
        emission_level: 5,
        transport: Transport::Within(1e-3),
        keep: Keep::RelativeError(1e-4),
        quantise: true,
        incident: false,
        checks: 0,
    };
    let polygon = &receivers(scene, &mut Vec::new()).expect("a floor")[0].polygon;
    let to_eye = DVec3::new(0.2, -0.1, 1.0).normalize();
    let place = |&(x, z): &(f64, f64)| {
        let at = polygon.frame().to_local(DVec3::new(x, 0.0, z) - polygon.frame().origin);
        at.truncate() / polygon.size().expect("a rectangle")
    };
    let smooth =
        bake(scene, &options(Some(Smooth { error, orders: Orders::default() })), &|_, _| {})
            .expect("a bake");
    let sampler = LegendreSampler::new(&smooth.smooth[0].tree);
    let first = points.iter().map(|p| PI * f64::from(sampler.radiance(place(p), to_eye)[0]));
    let haar = bake(scene, &options(None), &|_, _| {}).expect("a bake");
    let sampler = Sampler::new(&haar.patches[0].tree);
    let second = points.iter().map(|p| {
        let DVec2 { x: u, y: v } = place(p);
        PI * f64::from(sampler.multilinear([u, v, 0.6, 0.45])[0])
    });
    [first.collect(), second.collect()]
}

const POINTS: [(f64, f64); 6] =
    [(0.0, 2.0), (0.5, 1.3), (-0.8, 1.1), (0.9, 2.8), (-0.3, 1.7), (0.05, 2.45)];

fn assert_close(found: &[Vec<f64>; 2], expected: &[f64], tolerance: f64, what: &str) {
    for (basis, found) in ["smooth", "haar"].iter().zip(found) {
        for ((found, expected), at) in found.iter().zip(expected).zip(POINTS) {
            assert!(
                (found / expected - 1.0).abs() < tolerance,
                "{what}, {basis}, {at:?}: {found} {expected}"
            );
        }
    }
}

/// Form factor of the window from the floor at (x, z): rectangles in a plane perpendicular
/// to an element, a corner of each in line with it (J. R. Howell, *A Catalog of Radiation
/// Heat Transfer Configuration Factors*, B-4).
fn form_factor(x: f64, z: f64) -> f64 {
    let corner = |width: f64, height: f64| {
        let (b, a, c) = (width.abs(), height, z);
        let root = (a * a + c * c).sqrt();
        width.signum() * ((b / c).atan() - c / root * (b / root).atan()) / (2.0 * PI)
    };
    let up_to = |height| corner(HALF - x, height) + corner(HALF + x, height);
    up_to(TOP) - up_to(SILL)
}

/// π L F τ. Behind the glass the sky is all that the floor sees.
#[test]
fn a_uniform_sky_gives_radiance_times_form_factor() {
    let expected: Vec<f64> = POINTS.iter().map(|&(x, z)| PI * form_factor(x, z)).collect();
    let sky = || Sky::new(SkyModel::Uniform, PI, None, 0.0).expect("L = 1");
    let found = baked(&scene(Glazing::Clear { ior: 1.0 }, sky()), 2e-3, &POINTS);
    assert_close(&found, &expected, 0.01, "no glass");
    // Half of the sky lights the pane; 60 % of that leaves, in all directions.
    let milk = Glazing::Diffusing(Phong::new([0.6; 3], [0.0; 3], 0.0).expect("in range"));
    let expected: Vec<f64> = expected.iter().map(|e| 0.5 * 0.6 * e).collect();
    assert_close(&baked(&scene(milk, sky()), 2e-3, &POINTS), &expected, 0.01, "milk glass");
}

/// ∫ L(γ) τ(θ) cosθ_s cosθ_d / r² dA over the window by midpoints, with the sky and the
/// glass written out.
fn overcast(x: f64, z: f64) -> f64 {
    const N: u32 = 400;
    // E = 7π/9 of the zenith's radiance.
    let zenith = 100.0 * 9.0 / (7.0 * PI);
    let mut sum = 0.0;
    for i in 0..N * N {
        let at = |i: u32| (f64::from(i) + 0.5) / f64::from(N);
        let point = DVec2::new(2.0 * HALF * at(i % N) - HALF, SILL + (TOP - SILL) * at(i / N));
        let to = DVec3::new(point.x - x, point.y, -z);
        let (up, out) = (to.y / to.length(), z / to.length());
        let refracted = (1.0 - (1.0 - out * out) / (1.5 * 1.5)).sqrt();
        let s = (out - 1.5 * refracted) / (out + 1.5 * refracted);
        let p = (1.5 * out - refracted) / (1.5 * out + refracted);
        let f = 0.5 * (s * s + p * p);
        let radiance = zenith * (1.0 + 2.0 * up) / 3.0 * (1.0 - f) / (1.0 + f);
        sum += radiance * up * out / to.length_squared();
    }
    sum * 2.0 * HALF * (TOP - SILL) / f64::from(N * N)
}

#[test]
fn an_overcast_sky_through_glass_is_its_own_quadrature() {
    let expected: Vec<f64> = POINTS.iter().map(|&(x, z)| overcast(x, z)).collect();
    let sky = Sky::new(SkyModel::Overcast, 100.0, None, 0.2).expect("in range");
    let found = baked(&scene(Glazing::Clear { ior: 1.5 }, sky), 2e-3, &POINTS);
    assert_close(&found, &expected, 0.01, "overcast");
}

/// Sunlight through clear glass is the raytracer's: a bake under it is one under its sky.
#[test]
fn a_bake_leaves_clear_sunlight_to_rays_and_keeps_what_is_scattered() {
    let sun = wrt_core::Sun::new(-15.0, 35.0, 600.0).expect("in range");
    let alone = || Sky::new(SkyModel::Uniform, 0.0, Some(sun), 0.0).expect("in range");
    let found = baked(&scene(Glazing::Clear { ior: 1.5 }, alone()), 2e-3, &POINTS);
    assert_eq!(found.concat(), vec![0.0; 12], "clear");
    let milk = Glazing::Diffusing(Phong::new([0.6; 3], [0.0; 3], 0.0).expect("in range"));
    // Exitance 0.6 E of the pane, which the sun meets at cos 35° cos 15°.
    let facing = 600.0 * 35_f64.to_radians().cos() * 15_f64.to_radians().cos();
    let expected: Vec<f64> =
        POINTS.iter().map(|&(x, z)| 0.6 * facing * form_factor(x, z)).collect();
    assert_close(&baked(&scene(milk, alone()), 2e-3, &POINTS), &expected, 0.01, "milk glass");
}
