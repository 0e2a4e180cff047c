//! Coplanar triangles that share edges, joined to polygons.
//!
//! A region grows from its largest triangle over shared edges, breadth first,
//! and takes a neighbour that lies in the plane of the region so far. That
//! plane is an area-weighted mean, hence steadier than any one triangle's.

use crate::scene::Mesh;
use glam::DVec3;
use std::collections::HashMap;

/// Relative to the mesh's extent: ten roundings to f32, which files hold.
const TOLERANCE: f64 = 1e-6;

/// Relative to the largest coordinate, which is what f32 rounds: 2⁻²³, doubled.
const ROUNDING: f64 = 2.4e-7;

/// The most two joined triangles may turn, radians; a sphere of ten million
/// triangles turns more between neighbours.
const MAX_TURN: f64 = 1e-3;

/// One polygon's corners and triangles, as indices into the mesh.
#[derive(Debug, PartialEq)]
pub(super) struct Outline {
    /// Counter-clockwise seen from the front, lowest first.
    pub(super) corners: Vec<u32>,
    /// Increasing.
    pub(super) triangles: Vec<u32>,
}

/// Joins `mesh`; triangles without area are in no polygon.
///
/// Where a region has a hole or touches itself, its triangles stay single.
/// O(n log n) in the number of triangles.
pub(super) fn outlines(mesh: &Mesh) -> Vec<Outline> {
    let tolerance = tolerance(&mesh.positions);
    let surface = Surface::new(mesh, tolerance);
    let mut seeds: Vec<u32> =
        (0..mesh.triangles.len() as u32).filter(|&t| surface.has_area(t)).collect();
    let area = |&t: &u32| surface.area_vectors[t as usize].length_squared();
    seeds.sort_by(|a, b| area(b).total_cmp(&area(a)).then(a.cmp(b)));

    let mut region_of = vec![u32::MAX; mesh.triangles.len()];
    let mut outlines = Vec::new();
    for (region, &seed) in (0..).zip(&seeds) {
        if region_of[seed as usize] != u32::MAX {
            continue;
        }
        let mut triangles = surface.grow(seed, region, &mut region_of);
        triangles.sort_unstable();
        match surface.outline(&triangles, region, &region_of) {
            Some(corners) => outlines.push(Outline { corners: lowest_first(corners), triangles }),
            None => outlines.extend(triangles.iter().map(|&t| Outline {
                corners: lowest_first(mesh.triangles[t as usize].to_vec()),
                triangles: vec![t],
            })),
        }
    }
    outlines.sort_unstable_by_key(|outline| outline.triangles[0]);
    outlines
}

/// The distance within which points of a mesh are one, and in one plane.
fn tolerance(positions: &[DVec3]) -> f64 {
    let low = positions.iter().copied().reduce(DVec3::min).unwrap_or_default();
    let high = positions.iter().copied().reduce(DVec3::max).unwrap_or_default();
    let largest = low.abs().max(high.abs()).max_element();
    (TOLERANCE * (high - low).length()).max(ROUNDING * largest)
}

fn lowest_first(mut corners: Vec<u32>) -> Vec<u32> {
    let lowest = (0..corners.len()).min_by_key(|&i| corners[i]).unwrap_or(0);
    corners.rotate_left(lowest);
    corners
}

/// A directed edge between welded vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Edge {
    from: u32,
    to: u32,
    triangle: u32,
}

/// A mesh, with its vertices welded by position and its edges sorted.
struct Surface<'a> {
    mesh: &'a Mesh,
    tolerance: f64,
    /// For each vertex, the first one in its place.
    welded: Vec<u32>,
    edges: Vec<Edge>,
    /// Twice the area along the front normal, for each triangle.
    area_vectors: Vec<DVec3>,
}

impl<'a> Surface<'a> {
    fn new(mesh: &'a Mesh, tolerance: f64) -> Self {
        let welded = weld(&mesh.positions, tolerance);
        let at = |i: u32| mesh.positions[i as usize];
        let area_vector = |&[a, b, c]: &[u32; 3]| (at(b) - at(a)).cross(at(c) - at(a));
        let area_vectors = mesh.triangles.iter().map(area_vector).collect();
        let mut surface = Self { mesh, tolerance, welded, edges: Vec::new(), area_vectors };
        let triangles = (0..mesh.triangles.len() as u32).filter(|&t| surface.has_area(t));
        let mut edges: Vec<Edge> = triangles.flat_map(|t| surface.edges_of(t)).collect();
        edges.sort_unstable();
        surface.edges = edges;
        surface
    }

    fn edges_of(&self, triangle: u32) -> [Edge; 3] {
        let [a, b, c] = self.mesh.triangles[triangle as usize].map(|i| self.welded[i as usize]);
        [(a, b), (b, c), (c, a)].map(|(from, to)| Edge { from, to, triangle })
    }

    fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.mesh.triangles[triangle as usize].map(|i| self.mesh.positions[i as usize])
    }

    /// The least of the triangle's three heights.
    fn height(&self, triangle: u32) -> f64 {
        let [a, b, c] = self.corners(triangle);
        let longest = (b - a).length().max((c - b).length()).max((a - c).length());
        self.area_vectors[triangle as usize].length() / longest
    }

    fn has_area(&self, triangle: u32) -> bool {
        // False for the NaN of three equal corners, too.
        self.height(triangle) > self.tolerance
    }

    /// All triangles with the edge, in its direction.
    fn with_edge(&self, from: u32, to: u32) -> impl Iterator<Item = u32> {
        let first = self.edges.partition_point(|e| (e.from, e.to) < (from, to));
        let rest = self.edges[first..].iter();
        rest.take_while(move |e| (e.from, e.to) == (from, to)).map(|e| e.triangle)
    }

    /// The triangles of `seed`'s region, marked in `region_of`.
    fn grow(&self, seed: u32, region: u32, region_of: &mut [u32]) -> Vec<u32> {
        let mut triangles = vec![seed];
        region_of[seed as usize] = region;
        let mut plane = Plane::default();
        plane.add(self.area_vectors[seed as usize], self.corners(seed));
        let mut next = 0;
        while let Some(&triangle) = triangles.get(next) {
            next += 1;
            for Edge { from, to, .. } in self.edges_of(triangle) {
                let fits = |&t: &u32| self.fits(t, &plane);
                let mut across = self.with_edge(to, from).filter(fits);
                let Some(neighbour) = across.next() else { continue };
                // More than two sheets at one edge: which to join is anyone's guess.
                let ambiguous =
                    across.next().is_some() || self.with_edge(from, to).filter(fits).count() > 1;
                if ambiguous || region_of[neighbour as usize] != u32::MAX {
                    continue;
                }
                region_of[neighbour as usize] = region;
                triangles.push(neighbour);
                plane.add(self.area_vectors[neighbour as usize], self.corners(neighbour));
            }
        }
        triangles
    }

    fn fits(&self, triangle: u32, plane: &Plane) -> bool {
        let area_vector = self.area_vectors[triangle as usize];
        let (normal, centre) = (plane.normal(), plane.centre());
        // What moving its corners by the tolerance may turn a narrow triangle.
        let turn = MAX_TURN.max(self.tolerance / self.height(triangle)).min(0.5);
        let sine = normal.cross(area_vector).length() / area_vector.length();
        normal.dot(area_vector) > 0.0
            && sine <= turn
            && self
                .corners(triangle)
                .iter()
                .all(|&p| normal.dot(p - centre).abs() <= self.tolerance)
    }

    /// The one loop round a region, or `None` if it has several or touches itself.
    fn outline(&self, triangles: &[u32], region: u32, region_of: &[u32]) -> Option<Vec<u32>> {
        let inside = |from, to| {
            self.with_edge(from, to).filter(|&t| region_of[t as usize] == region).count()
        };
        // From each welded vertex: the next one, and the vertex of the mesh.
        let mut steps: HashMap<u32, (u32, u32)> = HashMap::new();
        for &triangle in triangles {
            let vertices = self.mesh.triangles[triangle as usize];
            for (Edge { from, to, .. }, vertex) in self.edges_of(triangle).into_iter().zip(vertices)
            {
                if inside(from, to) > 1 {
                    return None;
                }
                if inside(to, from) == 0 && steps.insert(from, (to, vertex)).is_some() {
                    return None;
                }
            }
        }
        let &start = steps.keys().min()?;
        let (mut at, mut corners) = (start, Vec::with_capacity(steps.len()));
        loop {
            let &(to, vertex) = steps.get(&at)?;
            corners.push(vertex);
            at = to;
            if at == start {
                break;
            }
            // Every vertex has one way out, so a longer walk is caught in a loop.
            if corners.len() == steps.len() {
                return None;
            }
        }
        (corners.len() == steps.len()).then_some(())?;
        let corners = self.without_collinear(corners);
        (corners.len() >= 3).then_some(corners)
    }

    /// The loop without the vertices that lie between their neighbours.
    fn without_collinear(&self, mut corners: Vec<u32>) -> Vec<u32> {
        let at = |i: u32| self.mesh.positions[i as usize];
        let centre = corners.iter().map(|&i| at(i)).sum::<DVec3>() / corners.len() as f64;
        // The farthest from anywhere is a corner for sure: begin there.
        let distance = |i: usize| at(corners[i]).distance_squared(centre);
        let far = (0..corners.len()).max_by(|&i, &j| distance(i).total_cmp(&distance(j)));
        corners.rotate_left(far.unwrap_or(0));
        let mut kept: Vec<u32> = Vec::with_capacity(corners.len());
        for (k, &corner) in corners.iter().enumerate() {
            let next = corners[(k + 1) % corners.len()];
            // Measured from the last corner kept, so that many small turns add up.
            let between = kept.last().is_some_and(|&last| {
                let (a, p, b) = (at(last), at(corner), at(next));
                let along = (b - a).normalize_or_zero();
                let off = (p - a).cross(along).length();
                off <= self.tolerance && (p - a).dot(b - p) > 0.0
            });
            if !between {
                kept.push(corner);
            }
        }
        kept
    }
}

/// The area-weighted mean plane of some triangles.
#[derive(Debug, Default)]
struct Plane {
    area_vector: DVec3,
    area: f64,
    moment: DVec3,
}

impl Plane {
    fn add(&mut self, area_vector: DVec3, corners: [DVec3; 3]) {
        let area = area_vector.length();
        self.area_vector += area_vector;
        self.area += area;
        self.moment += area / 3.0 * corners.into_iter().sum::<DVec3>();
    }

    fn normal(&self) -> DVec3 {
        self.area_vector.normalize_or_zero()
    }

    fn centre(&self) -> DVec3 {
        self.moment / self.area
    }
}

/// For each position, the index of the first that is within `tolerance` of it.
fn weld(positions: &[DVec3], tolerance: f64) -> Vec<u32> {
    // Cells several times as wide as the tolerance: most points look in one.
    let width = 8.0 * tolerance;
    if width <= 0.0 {
        return vec![0; positions.len()];
    }
    let cell = |p: DVec3| (p / width).floor().to_array().map(|x| x as i64);
    // The last vertex kept in each cell, and before each vertex the one before.
    let mut last: HashMap<[i64; 3], u32> = HashMap::new();
    let mut before = vec![u32::MAX; positions.len()];
    let mut welded = Vec::with_capacity(positions.len());
    for (i, &p) in (0..).zip(positions) {
        let (low, high) = (cell(p - tolerance), cell(p + tolerance));
        let mut first = i;
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    let mut at = last.get(&[x, y, z]).copied().unwrap_or(u32::MAX);
                    while at != u32::MAX {
                        if positions[at as usize].distance_squared(p) <= tolerance * tolerance {
                            first = first.min(at);
                        }
                        at = before[at as usize];
                    }
                }
            }
        }
        if first == i {
            before[i as usize] = last.insert(cell(p), i).unwrap_or(u32::MAX);
        }
        welded.push(first);
    }
    welded
}

#[cfg(test)]
mod tests;
