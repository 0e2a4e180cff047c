use super::*;
use crate::{
    accel::{Accel, Hit},
    emitters::{AreaEmitter, MANY},
    scene::{Material, Mesh, Scene},
};
use glam::{DAffine3, Vec3};
use std::hash::{DefaultHasher, Hash as _, Hasher as _};

/// A glossy floor at height 0, of side 2, that looks up, and triangles of a material that
/// shines.
fn over_floor(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Scene {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let mesh = |positions, triangles, material| Mesh {
        positions,
        triangles,
        material,
        transform: DAffine3::IDENTITY,
        ..Mesh::default()
    };
    let floor = corners.map(|[x, z]| DVec3::new(x, 0.0, z)).to_vec();
    let glossy = Material {
        kd: Vec3::splat(0.5),
        ks: Vec3::splat(0.4),
        exponent: 20.0,
        ..Material::default()
    };
    let lamp = Material { emission: Vec3::new(1.0, 2.0, 0.5), ..Material::default() };
    Scene {
        meshes: vec![mesh(floor, vec![[0, 2, 1], [0, 3, 2]], 0), mesh(positions, triangles, 1)],
        materials: vec![glossy, lamp],
        ..Scene::default()
    }
}

/// Numbers in [0, 1) that look random, the same every time.
fn unit(seed: u64) -> f64 {
    let mut hasher = DefaultHasher::new();
    seed.hash(&mut hasher);
    (hasher.finish() >> 11) as f64 / (1_u64 << 53) as f64
}

/// `count` triangles of any size up to 0.1 and any direction, about the floor and above.
fn confetti(count: u32) -> Scene {
    let point = |i: u32, scale: f64| {
        let at = |k: u32| unit(u64::from(3 * i + k));
        scale * (DVec3::new(at(0), at(1), at(2)) - 0.5)
    };
    let corners = |i: u32| {
        let middle = point(4 * i, 1.0) + DVec3::new(0.0, 0.4, 0.0);
        [1, 2, 3].map(|k| middle + point(4 * i + k, 0.1))
    };
    let triangles = (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    over_floor((0..count).flat_map(corners).collect(), triangles)
}

/// A sphere of radius 0.3 around (0, 0.5, 0), of 4 n² triangles.
fn sphere(n: u32) -> Scene {
    let corner = |i: u32| {
        let theta = PI * f64::from(i / (2 * n)) / f64::from(n);
        let (sin, cos) = (TAU * f64::from(i % (2 * n)) / f64::from(2 * n)).sin_cos();
        let along = DVec3::new(theta.sin() * cos, theta.cos(), theta.sin() * sin);
        DVec3::new(0.0, 0.5, 0.0) + 0.3 * along
    };
    let quad = |i: u32| {
        let right = i / (2 * n) * (2 * n) + (i + 1) % (2 * n);
        [[i, right, i + 2 * n], [right, right + 2 * n, i + 2 * n]]
    };
    let triangles = (0..2 * n * n).flat_map(quad).collect();
    over_floor((0..2 * n * (n + 1)).map(corner).collect(), triangles)
}

fn many(scene: &Scene) -> Hierarchy {
    let mut emitters = AreaEmitter::all(scene, 1);
    assert_eq!(emitters.len(), 1, "all in one");
    match emitters.pop() {
        Some(AreaEmitter::Many(hierarchy)) => hierarchy,
        other => panic!("{other:?}"),
    }
}

/// The floor at a place of its own for each `number`, seen from any side above.
fn on_floor(scene: &Scene, number: u64) -> Surface<'_> {
    let at = |k: u64| unit(!(8 * number + k));
    let position = DVec3::new(at(0) - 0.5, 0.0, at(1) - 0.5);
    let to_eye = DVec3::new(at(2) - 0.5, at(3), at(4) - 0.5).normalize();
    let accel = Accel::new(scene);
    let mut from = 0.0;
    let hit = std::iter::from_fn(|| {
        let hit = accel.closest(position + DVec3::Y, DVec3::NEG_Y, from, 2.0)?;
        from = hit.t;
        Some(hit)
    });
    let hit = hit.into_iter().find(|hit| hit.mesh == 0);
    Surface::new(scene, &Hit { front: true, ..hit.expect("the floor") }, to_eye)
}

/// Light of the cells of `span`, each shining from the same place of its own.
fn exact(hierarchy: &Hierarchy, span: Span, surface: &Surface<'_>, place: DVec2) -> Vec3 {
    let light = |number: usize| {
        let (flat, cell) = hierarchy.cell(number);
        flat.light_of(cell, surface, place)
    };
    (span.first..span.first + span.count)
        .filter_map(|number| light(number).map(|light| light.radiance))
        .sum()
}

#[test]
fn no_cluster_gives_more_than_its_bound() {
    let scene = confetti(600);
    let hierarchy = many(&scene);
    let (mut tight, mut dark) = (0, 0);
    for number in 0..40 {
        let surface = on_floor(&scene, number);
        let receiver = Receiver::new(&surface);
        let mut spans = vec![hierarchy.root()];
        while let Some(span) = spans.pop() {
            if span.count > 1 {
                spans.extend(span.halves());
            }
            let Potential { bound, likely } = receiver.potential(hierarchy.node(span));
            assert_eq!(bound > 0.0, likely > 0.0, "{span:?}: {bound}, {likely}");
            for place in [DVec2::ZERO, DVec2::new(0.99, 0.0), DVec2::new(0.3, 0.4)] {
                let given = exact(&hierarchy, span, &surface, place).max_element();
                // Sums and products of single precision.
                assert!(f64::from(given) <= bound * (1.0 + 1e-5), "{span:?}: {given} of {bound}");
                tight += u32::from(f64::from(given) > 0.5 * bound);
            }
            dark += u32::from(bound == 0.0);
        }
    }
    // The bound is of use: it says of much that it is dark, and is near what is given.
    assert!(tight > 1000 && dark > 1000, "{tight} near it, {dark} known as dark");
}

#[test]
fn spans_reach_every_cell_and_node_once() {
    let hierarchy = many(&confetti(777));
    let (mut cells, mut nodes) = (vec![0; 777], vec![0; 2 * 777 - 1]);
    let mut spans = vec![hierarchy.root()];
    while let Some(span) = spans.pop() {
        nodes[span.node] += 1;
        if span.count == 1 {
            cells[span.first] += 1;
        } else {
            spans.extend(span.halves());
        }
    }
    assert_eq!((cells, nodes), (vec![1; 777], vec![1; 2 * 777 - 1]));
}

/// The mean of independent draws lies within its standard error of the sum over all
/// cells, and that error is small enough to tell.
#[test]
fn draws_give_the_light_of_all_cells_in_the_mean() {
    for scene in [confetti(2000), sphere(20)] {
        let hierarchy = many(&scene);
        for number in 0..4 {
            let surface = on_floor(&scene, number);
            let mut lights = Vec::new();
            let mut drawn = |place| {
                lights.clear();
                hierarchy.illuminate(&surface, place, &mut lights);
                lights.iter().map(|light| light.radiance.as_dvec3()).sum::<DVec3>()
            };
            let count = 20_000;
            let draws: Vec<f64> =
                (0..count).map(|i| drawn(DVec2::new(unit(2 * i), unit(2 * i + 1))).x).collect();
            let mean = draws.iter().sum::<f64>() / count as f64;
            let variance = draws.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count as f64;
            let error = (variance / count as f64).sqrt();
            let all = |i: u64| {
                let place = (DVec2::splat(0.5) + i as f64 * R2).fract_gl();
                f64::from(exact(&hierarchy, hierarchy.root(), &surface, place).x)
            };
            // The sum's places within cells are a quadrature too.
            let [coarse, sum] = [1024, 4096].map(|n: u64| (0..n).map(all).sum::<f64>() / n as f64);
            let allowed = 4.0 * error + (sum - coarse).abs();
            assert!(error < 2e-3 * sum, "point {number}: {error} of {sum}");
            assert!(
                (mean - sum).abs() < allowed,
                "point {number}: {mean} ± {error}, not {sum}, {coarse}"
            );
        }
    }
}

#[test]
fn clusters_stay_few_however_many_cells() {
    let clusters = |n: u32| {
        let scene = sphere(n);
        let hierarchy = many(&scene);
        let surface = on_floor(&scene, 1);
        hierarchy.cut(&Receiver::new(&surface)).len()
    };
    let (some, very_many) = (clusters(16), clusters(128));
    assert!((32..=MOST).contains(&some), "of 1024: {some}");
    assert!(very_many <= some + some / 4, "of 65 536: {very_many}, of 1024: {some}");
}

#[test]
fn up_to_many_pieces_every_cell_is_asked_for() {
    let emitters = AreaEmitter::all(&confetti(MANY as u32), 4);
    assert_eq!(emitters.len(), MANY);
    assert!(emitters.iter().all(|emitter| matches!(emitter, AreaEmitter::One(_))));
    let emitters = AreaEmitter::all(&confetti(MANY as u32 + 1), 4);
    assert!(matches!(emitters.as_slice(), [AreaEmitter::Many(_)]), "one more");
}
