//! What the hierarchy must find, aimed at where others miss.

use super::*;
use crate::scene::{Material, Mesh};
use std::f64::consts::{PI, TAU};

fn scene_of(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Scene {
    Scene {
        meshes: vec![Mesh { positions, triangles, ..Mesh::default() }],
        materials: vec![Material::default()],
        ..Scene::default()
    }
}

/// A closed, bumpy sphere about `centre`, seen counter-clockwise from outside.
fn bumpy_sphere(centre: DVec3, radius: f64) -> Scene {
    const RINGS: u32 = 48;
    const SECTORS: u32 = 96;
    let mut positions = vec![centre + radius * DVec3::Y];
    for ring in 1..RINGS {
        for sector in 0..SECTORS {
            let polar = PI * f64::from(ring) / f64::from(RINGS);
            let azimuth = TAU * f64::from(sector) / f64::from(SECTORS);
            let bump = 1.0 + 0.08 * (7.0 * azimuth).sin() * (9.0 * polar).sin();
            let (sin, cos) = polar.sin_cos();
            let direction = DVec3::new(sin * azimuth.cos(), cos, -sin * azimuth.sin());
            positions.push(centre + radius * bump * direction);
        }
    }
    positions.push(centre - radius * DVec3::Y);
    let south = (RINGS - 1) * SECTORS + 1;
    let vertex = |ring: u32, sector: u32| match ring {
        0 => 0,
        RINGS => south,
        _ => 1 + (ring - 1) * SECTORS + sector % SECTORS,
    };
    let mut triangles = Vec::new();
    for ring in 0..RINGS {
        for sector in 0..SECTORS {
            let a = [vertex(ring, sector), vertex(ring, sector + 1)];
            let b = [vertex(ring + 1, sector), vertex(ring + 1, sector + 1)];
            triangles.push([a[0], b[0], b[1]]);
            triangles.push([a[0], b[1], a[1]]);
        }
    }
    triangles.retain(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]);
    scene_of(positions, triangles)
}

/// Aims at every vertex and along every edge of a closed mesh, from points
/// inside and outside; returns how many rays, and how many met nothing up to
/// what they were aimed at.
///
/// Silhouettes are left out: a ray that grazes one may rightly pass it.
fn misses_of_closed_mesh(centre: DVec3, radius: f64, rays_wanted: usize) -> (usize, usize) {
    let scene = bumpy_sphere(centre, radius);
    let accel = Accel::new(&scene);
    let mesh = &scene.meshes[0];
    let mut fans = vec![Vec::new(); mesh.positions.len()];
    for (i, triangle) in mesh.triangles.iter().enumerate() {
        triangle.iter().for_each(|&corner| fans[corner as usize].push(i));
    }
    let eyes = [
        DVec3::ZERO,
        DVec3::new(0.31, -0.2, 0.11),
        DVec3::new(0.0, 0.0, 0.5),
        DVec3::new(0.0, 3.0, 0.0),
        DVec3::new(-2.0, 0.1, 1.7),
        DVec3::new(1.0, 1.0, 1.0) * 40.0,
    ];
    let eyes = eyes.map(|eye| {
        let eye = centre + radius * eye;
        let faces_eye = |t: &[u32; 3]| {
            let p = t.map(|corner| mesh.positions[corner as usize]);
            normal_of(p).dot(eye - p[0]) > 0.0
        };
        (eye, mesh.triangles.iter().map(faces_eye).collect::<Vec<bool>>())
    });
    let (mut rays, mut misses) = (0, 0);
    for step in 0_u32.. {
        let along = (f64::from(step) * 0.618_033_988_749_895).fract();
        for (triangle, k) in mesh.triangles.iter().flat_map(|t| (0..3).map(move |k| (t, k))) {
            let (a, b) = (triangle[k] as usize, triangle[(k + 1) % 3] as usize);
            let target = mesh.positions[a].lerp(mesh.positions[b], along);
            for (eye, facing) in &eyes {
                let mut around =
                    fans[a].iter().filter(|i| step == 0 || fans[b].contains(i)).map(|&i| facing[i]);
                let first = around.next();
                if around.any(|facing| Some(facing) != first) {
                    continue;
                }
                let direction = (target - eye).normalize();
                let reach = eye.distance(target) * (1.0 + 1e-6);
                rays += 1;
                misses += usize::from(accel.closest(*eye, direction, 0.0, reach).is_none());
            }
        }
        if rays >= rays_wanted {
            break;
        }
    }
    (rays, misses)
}

#[test]
fn no_ray_slips_through_the_edges_of_a_closed_mesh() {
    let (rays, misses) = misses_of_closed_mesh(DVec3::ZERO, 1.0, 2_000_000);
    assert_eq!(misses, 0, "of {rays} rays");
}

#[test]
fn neither_distance_from_the_origin_nor_size_opens_gaps() {
    let far = DVec3::new(1e6, -3e5, 2e6);
    for (centre, radius) in [(far, 10.0), (DVec3::ZERO, 1e-5), (DVec3::ZERO, 1e7)] {
        let (rays, misses) = misses_of_closed_mesh(centre, radius, 150_000);
        assert_eq!(misses, 0, "of {rays} rays, centre {centre}, radius {radius}");
    }
}

/// Axis-parallel rays have zero components, of either sign.
#[test]
fn no_ray_slips_through_the_edges_of_a_grid_along_its_axes() {
    const SIDE: u32 = 32;
    let vertex = |x: u32, y: u32| y * (SIDE + 1) + x;
    let positions = (0..=SIDE)
        .flat_map(|y| (0..=SIDE).map(move |x| DVec3::new(x.into(), y.into(), 0.0)))
        .collect();
    let triangles = (0..SIDE)
        .flat_map(|y| (0..SIDE).map(move |x| (x, y)))
        .flat_map(|(x, y)| {
            let (a, b) = (vertex(x, y), vertex(x + 1, y));
            let (c, d) = (vertex(x + 1, y + 1), vertex(x, y + 1));
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let accel = Accel::new(&scene_of(positions, triangles));
    for i in 0..=8 * SIDE {
        for j in 0..=8 * SIDE {
            let eye = DVec3::new(f64::from(i) / 8.0, f64::from(j) / 8.0, 0.0);
            for zero in [0.0, -0.0] {
                for z in [1.0, -1.0] {
                    let direction = DVec3::new(zero, zero, -z);
                    let hit = accel.closest(eye + z * DVec3::Z, direction, 0.0, 2.0);
                    let hit = hit.unwrap_or_else(|| panic!("miss at {eye} along {direction}"));
                    assert_eq!((hit.t, hit.front), (1.0, z > 0.0), "at {eye}");
                }
            }
        }
    }
}

/// Fans aimed at vertices, edges and faces, from inside and outside, from a vertex, and
/// from too far; of all signs mixed, zeros among them.
#[test]
fn rays_from_one_point_find_what_each_finds_alone() {
    let mut scene = bumpy_sphere(DVec3::new(3.0, -2.0, 7.0), 2.0);
    let glass = Material { transmission: 0.5, ..Material::default() };
    scene.materials.push(glass);
    let shell = bumpy_sphere(DVec3::new(3.1, -2.0, 7.0), 2.5).meshes.remove(0);
    scene.meshes.push(Mesh { material: 1, ..shell });
    let accel = Accel::new(&scene);
    let mesh = &scene.meshes[0];
    let corners = |i: usize| mesh.triangles[i].map(|k| mesh.positions[k as usize]);
    let eyes = [
        DVec3::new(3.0, -2.0, 7.0),
        DVec3::new(3.3, -2.2, 7.1),
        mesh.positions[700],
        DVec3::new(3.0, 4.0, 7.0),
        DVec3::new(-1.0, -5.0, 11.0),
        DVec3::new(40.0, 20.0, -30.0),
    ];
    let axes = [DVec3::X, -DVec3::X, DVec3::Y, DVec3::NEG_Z, DVec3::new(-0.0, 1.0, 0.0)];
    let (mut found, mut visible) = (Vec::new(), Vec::new());
    let (mut met, mut clear) = (0, [0; 3]);
    for eye in eyes {
        let targets = (0..mesh.triangles.len()).flat_map(|i| {
            let [a, b, c] = corners(i);
            [a, a.lerp(b, (i as f64 * 0.618).fract()), (a + b + c) / 3.0]
        });
        let aimed = targets.filter_map(|target| (target - eye).try_normalize());
        let directions: Vec<DVec3> = axes.into_iter().chain(aimed).collect();
        // Neighbours together, then rays that have nothing to do with each other.
        for stride in [1, 1009] {
            let pick = |i: usize| directions[i * stride % directions.len()];
            let directions: Vec<DVec3> = (0..directions.len()).map(pick).collect();
            for size in [1, 2, 3, 16, 23] {
                for fan in directions.chunks(size).step_by(size.div_ceil(3) * 2) {
                    accel.find_of(eye, fan, &mut found);
                    let alone = |d: &DVec3| accel.closest(eye, *d, 0.0, f64::INFINITY);
                    let look = |(found, d): (&Option<Found>, &DVec3)| {
                        found.as_ref().map(|found| accel.hit(found, *d))
                    };
                    let hits: Vec<_> = found.iter().zip(fan).map(look).collect();
                    assert_eq!(hits, fan.iter().map(alone).collect::<Vec<_>>(), "{eye}: {fan:?}");
                    met += hits.iter().flatten().count();
                    let reach = |i: usize| [f64::INFINITY, 1.0, 4.0, 0.0][i % 4];
                    let rays: Vec<_> =
                        fan.iter().enumerate().map(|(i, d)| (*d, reach(i))).collect();
                    accel.visibility_of(eye, &rays, &mut visible);
                    let alone = |(d, reach): &(DVec3, f64)| accel.visibility_along(eye, *d, *reach);
                    assert_eq!(visible, rays.iter().map(alone).collect::<Vec<_>>(), "{eye}");
                    for visible in &visible {
                        clear[(2.0 * visible).ceil() as usize] += 1;
                    }
                }
            }
        }
    }
    assert!(met > 100_000 && clear.iter().all(|n| *n > 5_000), "{met} hits, {clear:?} shadows");
}

/// Rays that share nothing: from inside, outside, a vertex and far away, at vertices, edges,
/// faces and past the scene, some from beyond their first hit on.
#[test]
fn rays_side_by_side_find_what_each_finds_alone() {
    let scene = bumpy_sphere(DVec3::new(3.0, -2.0, 7.0), 2.0);
    let accel = Accel::new(&scene);
    let mesh = &scene.meshes[0];
    let eyes = [
        DVec3::new(3.0, -2.0, 7.0),
        mesh.positions[700],
        DVec3::new(3.0, 4.0, 7.0),
        DVec3::new(40.0, 20.0, -30.0),
        DVec3::new(1e9, -1e9, 1e8),
        DVec3::new(1e60, 1e58, -1e60),
    ];
    let ray = |i: usize| {
        let eye = eyes[i % eyes.len()];
        let [a, b, c] = mesh.triangles[i * 1009 % mesh.triangles.len()];
        let [a, b, c] = [a, b, c].map(|k| mesh.positions[k as usize]);
        let middle = (a + b + c) / 3.0;
        let target = match i % 7 {
            0 => a,
            1 | 2 => a.lerp(b, (i as f64 * 0.618).fract()),
            3 => eye + DVec3::new(-0.0, 1.0, 0.0),
            4 => 2.0 * eye - middle,
            _ => middle,
        };
        let direction = (target - eye).try_normalize()?;
        let from = if i.is_multiple_of(3) { eye.distance(target) } else { 0.0 };
        Some(Ray { origin: eye, direction, from })
    };
    let rays: Vec<Ray> = (0..20_000).filter_map(ray).collect();
    let mut found = Vec::new();
    let (mut met, mut rest, mut sizes) = (0, &rays[..], (0..=70).cycle());
    while !rest.is_empty() {
        let (some, others) = rest.split_at(sizes.next().map_or(1, |n: usize| n.min(rest.len())));
        rest = others;
        accel.find_each(some, &mut found);
        assert_eq!(found.len(), some.len());
        for (found, ray) in found.iter().zip(some) {
            let hit = found.as_ref().map(|found| accel.hit(found, ray.direction));
            let alone = accel.closest(ray.origin, ray.direction, ray.from, f64::INFINITY);
            assert_eq!(hit, alone, "{ray:?}");
            met += usize::from(hit.is_some());
        }
    }
    let share = met as f64 / rays.len() as f64;
    assert!((0.3..0.9).contains(&share), "{met} of {} meet something", rays.len());
}

#[test]
fn hit_is_where_the_ray_and_the_triangle_say() {
    let a = [DVec3::new(1.0, 2.0, -3.0), DVec3::new(4.0, 2.5, -3.5), DVec3::new(1.5, 6.0, -4.0)];
    let accel = Accel::new(&scene_of(a.to_vec(), vec![[0, 1, 2]]));
    let target = 0.5 * a[0] + 0.3 * a[1] + 0.2 * a[2];
    let eye = DVec3::new(0.0, 0.0, 5.0);
    let direction = (target - eye).normalize();
    let hit = accel.closest(eye, direction, 0.0, f64::INFINITY).expect("aimed at it");
    assert_eq!((hit.mesh, hit.triangle, hit.front), (0, 0, true));
    assert!((hit.t - eye.distance(target)).abs() < 1e-14, "{hit:?}");
    assert!((hit.barycentric.0 - 0.3).abs() < 1e-14, "{hit:?}");
    assert!((hit.barycentric.1 - 0.2).abs() < 1e-14, "{hit:?}");
    assert!(hit.position.distance(target) < 1e-14, "{hit:?}");
    let past = accel.closest(eye, direction, hit.t, f64::INFINITY);
    assert_eq!(past, None, "tmin is excluded");
    assert_eq!(accel.closest(eye, direction, 0.0, hit.t), None, "tmax is excluded");
    let back = accel.closest(2.0 * target - eye, -direction, 0.0, f64::INFINITY);
    assert!(back.is_some_and(|hit| !hit.front), "{back:?}");
}

#[test]
fn surfaces_closer_than_f32_can_tell_are_told_apart() {
    let quad = |z: f64| [[0.0, 0.0], [9.0, 0.0], [0.0, 9.0]].map(|[x, y]| DVec3::new(x, y, z));
    let positions = [quad(0.0), quad(1e-12)].concat();
    let accel = Accel::new(&scene_of(positions, vec![[0, 1, 2], [3, 4, 5]]));
    let hit = |z: f64| accel.closest(DVec3::new(1.0, 2.0, z), -z * DVec3::Z, 0.0, 9.0);
    assert_eq!(hit(1.0).map(|hit| hit.triangle), Some(1));
    assert_eq!(hit(-1.0).map(|hit| hit.triangle), Some(0));
}

#[test]
fn shadow_ray_ends_at_its_target() {
    let scene = bumpy_sphere(DVec3::ZERO, 1.0);
    let accel = Accel::new(&scene);
    let outside = DVec3::new(0.0, 3.0, 0.2);
    assert!(accel.occluded(outside, DVec3::ZERO), "the shell is between");
    let direction = (outside - DVec3::ZERO).normalize();
    let hit = accel.closest(DVec3::ZERO, direction, 0.0, 9.0).expect("inside the shell");
    assert!(!accel.occluded(DVec3::ZERO, hit.position), "the shell hides itself");
    let start = accel.leave(hit.position, hit.normal, direction);
    assert!(!accel.occluded(start, outside), "the surface hides what it faces");
    let start = accel.leave(hit.position, hit.normal, -direction);
    assert!(accel.occluded(start, outside), "the surface lets light through");
}

#[test]
fn clear_triangles_dim_shadow_rays() {
    let positions = [0.0, 1.0]
        .map(|z| [[-1.0, -1.0], [3.0, -1.0], [-1.0, 3.0]].map(|[x, y]| DVec3::new(x, y, z)))
        .concat();
    let mut scene = scene_of(positions, vec![[0, 1, 2], [3, 4, 5]]);
    scene.materials[0].transmission = 0.5;
    let accel = Accel::new(&scene);
    let through = accel.visibility(DVec3::new(0.0, 0.0, -1.0), DVec3::new(0.0, 0.1, 2.0));
    assert_eq!(through, 0.25);
}

#[test]
fn empty_and_degenerate_scenes_are_empty_space() {
    let point = vec![DVec3::ONE; 3];
    let line = vec![DVec3::ZERO, DVec3::X, 2.0 * DVec3::X];
    let nan = vec![DVec3::ZERO, DVec3::X, DVec3::NAN];
    for positions in [point, line, nan] {
        let accel = Accel::new(&scene_of(positions, vec![[0, 1, 2]]));
        let hit = accel.closest(DVec3::new(0.5, 0.0, 1.0), -DVec3::Z, 0.0, f64::INFINITY);
        assert_eq!(hit, None);
    }
    let accel = Accel::new(&Scene::default());
    assert_eq!(accel.closest(DVec3::ZERO, DVec3::X, 0.0, f64::INFINITY), None);
    assert!(!accel.occluded(DVec3::ZERO, DVec3::ONE), "by what?");
}

/// Of a single triangle, most of a node is missing children: no ray may go there, from however
/// far it comes.
#[test]
fn rays_from_beyond_all_numbers_end() {
    let corners = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
    let accel = Accel::new(&scene_of(corners, vec![[0, 1, 2]]));
    // Evenly, so that rounding moves all axes alike and the ray is not told to pass the scene.
    for far in [1e9, 1e30, 1e56, 1e60, 1e100, 3e150] {
        let origin = DVec3::splat(far);
        let direction = DVec3::NEG_ONE.normalize();
        let hit = accel.closest(origin, direction, 0.0, f64::INFINITY);
        let mut found = Vec::new();
        accel.find_each(&[Ray { origin, direction, from: 0.0 }], &mut found);
        assert_eq!(found[0].map(|found| accel.hit(&found, direction)), hit, "{far}");
        accel.find_of(origin, &[direction; 8], &mut found);
        assert_eq!(found[7].map(|found| accel.hit(&found, direction)), hit, "{far}");
    }
}

/// Wider registers do not change what is hit, nor where.
#[test]
#[cfg(target_arch = "x86_64")]
fn every_instruction_set_finds_the_same() {
    let mut accel = Accel::new(&bumpy_sphere(DVec3::new(3.0, -1.0, 2.0), 1.0));
    let best = Level::new();
    let sets = [
        best.as_sse2().map(Level::Sse2),
        best.as_sse4_2().map(Level::Sse4_2),
        best.as_avx2().map(Level::Avx2),
        best.as_avx512().map(Level::Avx512),
    ];
    let rays = |accel: &Accel| {
        let ray = |i: u32| {
            // Two irrational steps fill the sphere of directions.
            let z = 2.0 * (f64::from(i) * 0.618_033_988_749_895).fract() - 1.0;
            let (sin, cos) = (TAU * f64::from(i) * 0.414_213_562_373_095).sin_cos();
            let r = (1.0 - z * z).sqrt();
            let target = DVec3::new(3.0 + r * cos, -1.0 + r * sin, 2.0 + z);
            let eye = DVec3::new(0.5, 0.5, f64::from(i % 7));
            let hit = accel.closest(eye, (target - eye).normalize(), 0.0, f64::INFINITY);
            (hit, accel.visibility(eye, target))
        };
        let alone: Vec<_> = (0..5000).map(ray).collect();
        let side_by_side = |i: u32| {
            let angle = f64::from(i);
            let origin = DVec3::new(3.0 + 2.0 * angle.cos(), -1.0, 2.0 + 2.0 * angle.sin());
            let direction = DVec3::new(-angle.cos(), 0.5 * (7.0 * angle).sin(), -angle.sin());
            Ray { origin, direction: direction.normalize(), from: 0.0 }
        };
        let others: Vec<Ray> = (0..5000).map(side_by_side).collect();
        let mut found = Vec::new();
        accel.find_each(&others, &mut found);
        let hit = |(found, ray): (&Option<Found>, &Ray)| {
            found.as_ref().map(|found| accel.hit(found, ray.direction))
        };
        (alone, found.iter().zip(&others).map(hit).collect::<Vec<_>>())
    };
    let expected = rays(&accel);
    assert!(expected.0.iter().filter(|(hit, _)| hit.is_some()).count() > 2000, "too few hits");
    assert!(expected.1.iter().flatten().count() > 2000, "too few hits side by side");
    for level in sets.into_iter().flatten() {
        accel.level = level;
        assert_eq!(rays(&accel), expected, "{level:?}");
    }
}
