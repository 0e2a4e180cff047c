//! A planar face, convex or not, as triangles: ear clipping.
//!
//! G. H. Meisters, *Polygons Have Ears*, American Mathematical Monthly 82(6),
//! 1975. O(n²) for faces as they are, O(n³) at worst.

use glam::{DVec2, DVec3};

/// Appends the triangles of `face`, whose corners are indices into `positions`.
///
/// A face of n corners gives n − 2 triangles, none for fewer than three. One
/// that crosses itself is cut somehow.
pub(super) fn triangulate(face: &[u32], positions: &[DVec3], triangles: &mut Vec<[u32; 3]>) {
    if face.len() <= 3 {
        triangles.extend(<[u32; 3]>::try_from(face));
        return;
    }
    let points = flatten(face, positions);
    let mut left: Vec<usize> = (0..face.len()).collect();
    while left.len() > 3 {
        // Where rounding or a crossing has left no ear, any corner will do.
        let ear = (0..left.len()).find(|&i| is_ear(i, &left, &points)).unwrap_or(0);
        triangles.push(around(ear, &left).map(|i| face[i]));
        left.remove(ear);
    }
    triangles.push([face[left[0]], face[left[1]], face[left[2]]]);
}

/// The corner before `i`, itself and the one after.
fn around(i: usize, left: &[usize]) -> [usize; 3] {
    let n = left.len();
    [left[(i + n - 1) % n], left[i], left[(i + 1) % n]]
}

/// Whether corner `i` sticks out and no other corner is in its triangle.
fn is_ear(i: usize, left: &[usize], points: &[DVec2]) -> bool {
    let ear = around(i, left);
    let [a, b, c] = ear.map(|i| points[i]);
    let turn = |a: DVec2, b: DVec2, c: DVec2| (b - a).perp_dot(c - a);
    if turn(a, b, c) <= 0.0 {
        return false;
    }
    // A corner in the same place as one of the ear's, as where a hole is cut
    // open, is no obstacle.
    let inside = |p: DVec2| {
        p != a
            && p != b
            && p != c
            && turn(a, b, p) >= 0.0
            && turn(b, c, p) >= 0.0
            && turn(c, a, p) >= 0.0
    };
    !left.iter().any(|&j| inside(points[j]))
}

/// The face's corners in its plane, counter-clockwise.
fn flatten(face: &[u32], positions: &[DVec3]) -> Vec<DVec2> {
    let at = |i: usize| positions[face[i % face.len()] as usize] - positions[face[0] as usize];
    // M. E. Newell's normal: twice the area projected on each axis plane.
    let normal: DVec3 = (0..face.len()).map(|i| at(i).cross(at(i + 1))).sum();
    let u = normal.normalize_or(DVec3::Z).any_orthonormal_vector();
    let v = normal.normalize_or(DVec3::Z).cross(u);
    (0..face.len()).map(|i| DVec2::new(at(i).dot(u), at(i).dot(v))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A polygon in a tilted plane, its area and its triangles' areas.
    fn cut(outline: &[(f64, f64)]) -> (f64, Vec<f64>) {
        let (u, v) = (DVec3::new(0.6, 0.8, 0.0), DVec3::new(0.0, 0.0, 1.0));
        let positions: Vec<DVec3> =
            outline.iter().map(|&(x, y)| DVec3::ONE + u * x + v * y).collect();
        let face: Vec<u32> = (0..outline.len() as u32).collect();
        let mut triangles = Vec::new();
        triangulate(&face, &positions, &mut triangles);
        let signed = |[a, b, c]: [u32; 3]| {
            let at = |i: u32| positions[i as usize];
            0.5 * (at(b) - at(a)).cross(at(c) - at(a)).dot(u.cross(v))
        };
        let n = outline.len();
        let shoelace = (0..n).map(|i| {
            let ((a, b), (c, d)) = (outline[i], outline[(i + 1) % n]);
            0.5 * (a * d - b * c)
        });
        (shoelace.sum(), triangles.into_iter().map(signed).collect())
    }

    #[test]
    fn triangles_cover_a_concave_polygon_once() {
        let arrow: &[_] = &[(0., 0.), (4., -3.), (1., 0.), (4., 3.)];
        let l: &[_] = &[(0., 0.), (2., 0.), (2., 1.), (1., 1.), (1., 2.), (0., 2.)];
        let comb: &[_] = &[(0., 0.), (7., 0.), (7., 5.), (6., 1.), (4., 5.), (3., 1.), (2., 5.)];
        let with_midpoints: &[_] = &[(0., 0.), (1., 0.), (2., 0.), (2., 2.), (1., 2.), (0., 2.)];
        for outline in [arrow, l, comb, with_midpoints] {
            let (area, parts) = cut(outline);
            assert_eq!(parts.len(), outline.len() - 2, "{outline:?}");
            assert!(parts.iter().all(|&p| p >= -1e-12), "turned over: {parts:?}");
            // All of one sign and of the right sum: no gap and no overlap.
            assert!((parts.iter().sum::<f64>() - area).abs() < 1e-12, "{parts:?} of {area}");
        }
    }

    #[test]
    fn faces_that_are_none_give_no_triangles_and_no_panic() {
        assert!(cut(&[(0., 0.), (1., 0.)]).1.is_empty(), "a line");
        assert_eq!(cut(&[(0., 0.); 5]).1.len(), 3);
        assert_eq!(cut(&[(0., 0.), (1., 1.), (1., 0.), (0., 1.)]).1.len(), 2);
    }
}
