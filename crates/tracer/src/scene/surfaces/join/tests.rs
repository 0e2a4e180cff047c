use super::*;
use glam::{DQuat, DVec2};

/// A mesh in the plane z = 0.
fn flat(points: &[(f64, f64)], triangles: &[[u32; 3]]) -> Mesh {
    let positions = points.iter().map(|&(x, y)| DVec3::new(x, y, 0.0)).collect();
    Mesh { positions, triangles: triangles.to_vec(), ..Mesh::default() }
}

/// n × n unit squares of two triangles, vertices shared.
fn grid(n: u32) -> Mesh {
    let points: Vec<(f64, f64)> =
        (0..=n).flat_map(|j| (0..=n).map(move |i| (f64::from(i), f64::from(j)))).collect();
    let at = |i: u32, j: u32| j * (n + 1) + i;
    let square = |i: u32, j: u32| {
        let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
        [[a, b, c], [a, c, d]]
    };
    let triangles: Vec<[u32; 3]> =
        (0..n).flat_map(|j| (0..n).flat_map(move |i| square(i, j))).collect();
    flat(&points, &triangles)
}

/// What a file that stores f32 makes of the mesh, turned out of the axes.
fn turned_and_rounded(mut mesh: Mesh) -> Mesh {
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7);
    for p in &mut mesh.positions {
        *p = (turn * *p + DVec3::new(30.0, -20.0, 10.0)).as_vec3().as_dvec3();
    }
    mesh
}

fn corners(mesh: &Mesh) -> Vec<Vec<u32>> {
    outlines(mesh).into_iter().map(|o| o.corners).collect()
}

#[test]
fn an_l_shape_is_one_hexagon() {
    let points = [(0., 0.), (2., 0.), (2., 1.), (1., 1.), (1., 2.), (0., 2.), (0., 1.)];
    let l = flat(&points, &[[0, 1, 2], [0, 2, 3], [0, 3, 6], [6, 3, 4], [6, 4, 5]]);
    let joined = outlines(&l);
    // Vertex 6 is in the middle of the left side.
    assert_eq!(joined.len(), 1, "{joined:?}");
    assert_eq!(joined[0].corners, [0, 1, 2, 3, 4, 5]);
    assert_eq!(joined[0].triangles, [0, 1, 2, 3, 4]);
}

#[test]
fn vertices_join_by_position_not_by_index() {
    // A square whose triangles share no index, as split by an exporter.
    let points = [(0., 0.), (1., 0.), (1., 1.), (0., 0.), (1., 1.), (0., 1.)];
    let joined = corners(&flat(&points, &[[0, 1, 2], [3, 4, 5]]));
    assert_eq!(joined.len(), 1, "{joined:?}");
    assert_eq!(joined[0].len(), 4, "{joined:?}");
    assert_eq!(joined[0][0], 0);
}

#[test]
fn separate_pieces_stay_separate() {
    let points =
        [(0., 0.), (1., 0.), (0., 1.), (5., 5.), (6., 5.), (5., 6.), (1., 0.), (2., 0.), (1., -1.)];
    // The third touches the first in one point only.
    let joined = corners(&flat(&points, &[[0, 1, 2], [3, 4, 5], [8, 7, 6]]));
    assert_eq!(joined, [vec![0, 1, 2], vec![3, 4, 5], vec![6, 8, 7]]);
}

#[test]
fn a_hole_leaves_the_triangles_single() {
    let mut ring = grid(3);
    // Triangles 8 and 9 are the middle square.
    ring.triangles.drain(8..10);
    let joined = outlines(&ring);
    assert_eq!(joined.len(), 16);
    assert!(joined.iter().all(|o| o.triangles.len() == 1), "{joined:?}");
}

#[test]
fn a_bent_sheet_is_two_polygons() {
    let mut sheet = grid(2);
    for p in sheet.positions.iter_mut().filter(|p| p.x > 1.5) {
        p.z = 0.01;
    }
    let joined = corners(&sheet);
    assert_eq!(joined, [vec![0, 1, 7, 6], vec![1, 2, 8, 7]]);
}

#[test]
fn front_and_back_of_a_plate_are_two_polygons() {
    let points = [(0., 0.), (1., 0.), (1., 1.), (0., 1.)];
    let plate = flat(&points, &[[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]]);
    assert_eq!(corners(&plate), [[0, 1, 2, 3], [0, 3, 2, 1]]);
}

#[test]
fn a_triangle_that_lies_on_another_is_not_joined() {
    let points = [(0., 0.), (1., 0.), (1., 1.), (0., 1.)];
    let doubled = flat(&points, &[[0, 1, 2], [0, 2, 3], [0, 2, 3]]);
    assert_eq!(outlines(&doubled).len(), 3);
}

#[test]
fn triangles_without_area_are_dropped() {
    let points = [(0., 0.), (1., 0.), (2., 0.), (0., 1.), (1., 1e-9)];
    let mesh = flat(&points, &[[0, 1, 2], [0, 2, 4], [0, 0, 3], [0, 2, 3]]);
    assert_eq!(outlines(&mesh), [Outline { corners: vec![0, 2, 3], triangles: vec![3] }]);
    assert!(outlines(&Mesh::default()).is_empty(), "no triangles");
    assert!(outlines(&flat(&[(5., 5.); 3], &[[0, 1, 2]])).is_empty(), "a point");
}

#[test]
fn a_fine_grid_in_f32_is_one_square() {
    let n = 60;
    let joined = corners(&turned_and_rounded(grid(n)));
    assert_eq!(joined, [[0, n, (n + 1) * (n + 1) - 1, (n + 1) * n]]);
}

#[test]
fn a_sphere_stays_in_pieces() {
    let n: u32 = 200;
    let mut globe = grid(n);
    for p in &mut globe.positions {
        let (turn, tilt) = (p.x / f64::from(n) * 6.0, p.y / f64::from(n) * 2.0 - 1.0);
        let ring = DVec2::from_angle(turn) * tilt.cos();
        *p = DVec3::new(ring.x, ring.y, tilt.sin());
    }
    // A quadrilateral between two parallels is a trapezoid, hence planar; no more.
    let joined = outlines(&globe);
    assert!(joined.iter().all(|o| o.triangles.len() <= 2), "smooth, yet nowhere flat");
    assert!(joined.len() >= 40_000, "{}", joined.len());
}

#[test]
fn a_round_table_keeps_its_rim() {
    let n = 1000;
    let mut points = vec![(0.0, 0.0)];
    points.extend((0..n).map(|i| {
        let (y, x) = (f64::from(i) / f64::from(n) * std::f64::consts::TAU).sin_cos();
        (x, y)
    }));
    let fan: Vec<[u32; 3]> = (0..n).map(|i| [0, 1 + i, 1 + (i + 1) % n]).collect();
    let joined = outlines(&flat(&points, &fan));
    // The sagitta of 1/1000 turn is 5e-6, above the tolerance of 3e-6.
    assert_eq!(joined.len(), 1);
    assert_eq!(joined[0].corners.len(), 1000);
}

#[test]
fn a_million_triangles_take_seconds_not_hours() {
    // 20 % of a million, so that the suite stays quick; quadratic would show.
    let mut hills = grid(316);
    for p in &mut hills.positions {
        p.z = (0.7 * p.x).sin() * (0.9 * p.y).cos();
    }
    let begin = std::time::Instant::now();
    let joined = outlines(&hills);
    assert!(joined.len() > 100_000, "{}", joined.len());
    assert!(begin.elapsed().as_secs() < 20, "{:?}", begin.elapsed());
}
