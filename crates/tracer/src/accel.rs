//! Closest hit and shadow ray over every triangle of a scene; the only file
//! that names obvhs.
//!
//! The hierarchy's boxes are f32, the triangles f64. Two things make the whole
//! watertight: the triangle test is that of S. Woop, C. Benthin and I. Wald,
//! *Watertight Ray/Triangle Intersection*, JCGT 2(1), 2013, and the boxes are
//! padded by more than the rounding of a ray to f32 can move it. Vertices are
//! centred on the scene and scaled by a power of two first, so that the padding
//! and obvhs's own absolute epsilon mean the same for every scene.

use crate::scene::{Cutout, Scene};
use glam::{DVec3, Vec3A};
use obvhs::{
    BvhBuildParams,
    aabb::Aabb,
    cwbvh::{CwBvh, builder::build_cwbvh},
    ray::{Ray, RayHit},
};
use std::time::Duration;

/// Half the longest side of the scaled scene, to within a factor of two.
///
/// obvhs skips boxes that a ray leaves before t = 10⁻⁴, whatever the unit. At
/// this size that is 10⁻⁷ of the scene.
const HALF_EXTENT: f64 = 1024.0;

/// What the boxes are padded by: 2⁻¹⁸ of [`HALF_EXTENT`], where rounding a ray
/// and the slab test to f32 costs a few times 2⁻²⁴.
const PADDING: f32 = 1.0 / 256.0;

/// How far secondary rays start from a surface, relative to the scene's largest
/// coordinate. f64 rounding moves a hit by about 10⁻¹⁵.
const OFFSET: f64 = 1e-10;

/// How much of a shadow ray is looked at, so that the lamp does not occlude
/// itself.
const SHADOW_REACH: f64 = 1.0 - 1e-9;

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Hit {
    /// Index into [`Scene::meshes`].
    pub(crate) mesh: usize,
    /// Index into the mesh's triangles.
    pub(crate) triangle: u32,
    /// Distance along the ray.
    pub(crate) t: f64,
    /// Barycentric weights of the triangle's second and third vertex.
    pub(crate) barycentric: (f64, f64),
    /// From the barycentric weights, hence on the triangle's plane.
    pub(crate) position: DVec3,
    /// Unit, on the triangle's front side.
    pub(crate) normal: DVec3,
    /// Whether the ray came from the front, where vertices run counter-clockwise.
    pub(crate) front: bool,
    /// Which part of what is behind it is hidden; never 0.
    pub(crate) opacity: f32,
}

/// A triangle in the scaled frame.
#[derive(Debug)]
struct Triangle {
    vertices: [[f64; 3]; 3],
    mesh: u32,
    index: u32,
    /// What a shadow ray keeps in passing: 0 for opaque.
    transmission: f32,
    /// Whether its mesh has a [`Cutout`].
    cut: bool,
}

/// All triangles of a scene, ready for rays.
#[derive(Debug)]
pub(crate) struct Accel {
    bvh: CwBvh,
    /// In the order of the hierarchy's leaves.
    triangles: Vec<Triangle>,
    /// One a mesh, where it is not opaque.
    cutouts: Vec<Option<Cutout>>,
    /// World position of the scaled frame's origin.
    centre: DVec3,
    /// Scaled units per metre, a power of two.
    scale: f64,
    /// Half the scaled scene's sides, padded.
    half_sides: DVec3,
    /// How far secondary rays start from a surface, in metres.
    offset: f64,
}

impl Accel {
    /// Sorts the triangles of `scene` into a hierarchy. Triangles without area
    /// are left out: no ray meets them.
    ///
    /// # Panics
    ///
    /// If a mesh names a vertex or a material that is not there, or if there
    /// are 2³² triangles.
    pub(crate) fn new(scene: &Scene) -> Self {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let mut triangles = Vec::new();
        let cutouts: Vec<_> = scene.meshes.iter().map(|mesh| Cutout::of(scene, mesh)).collect();
        for (m, mesh) in scene.meshes.iter().enumerate() {
            let transmission = scene.materials[mesh.material].transmission.clamp(0.0, 1.0);
            for (i, corners) in mesh.triangles.iter().enumerate() {
                let p = corners.map(|corner| mesh.positions[corner as usize]);
                if !normal_of(p).is_finite() {
                    continue;
                }
                for p in p {
                    (low, high) = (low.min(p), high.max(p));
                }
                let index = |i| u32::try_from(i).expect("fewer than 2³² triangles");
                triangles.push(Triangle {
                    vertices: p.map(|p| p.to_array()),
                    mesh: index(m),
                    index: index(i),
                    transmission,
                    cut: cutouts[m].is_some(),
                });
            }
        }
        if triangles.is_empty() {
            return Self {
                bvh: CwBvh::default(),
                triangles,
                cutouts,
                centre: DVec3::ZERO,
                scale: 1.0,
                half_sides: DVec3::ZERO,
                offset: OFFSET,
            };
        }
        let centre = 0.5 * low + 0.5 * high;
        let half_sides = 0.5 * high - 0.5 * low;
        let scale = (HALF_EXTENT / half_sides.max_element()).log2().floor().exp2();
        for vertex in triangles.iter_mut().flat_map(|t| &mut t.vertices) {
            *vertex = ((DVec3::from_array(*vertex) - centre) * scale).to_array();
        }
        let boxes: Vec<Aabb> = triangles.iter().map(padded_box).collect();
        let bvh = build_cwbvh(&boxes, BvhBuildParams::medium_build(), &mut Duration::default());
        let mut unordered: Vec<_> = triangles.into_iter().map(Some).collect();
        let triangles = bvh
            .primitive_indices
            .iter()
            .map(|&i| unordered[i as usize].take().expect("each box is in one leaf"))
            .collect();
        Self {
            bvh,
            triangles,
            cutouts,
            centre,
            scale,
            half_sides: half_sides * scale + f64::from(PADDING),
            offset: OFFSET * low.abs().max(high.abs()).max_element(),
        }
    }

    /// The first triangle along the unit `direction` with `tmin < t < tmax` that is
    /// not clear there. Of triangles at the same distance, as on a shared edge, the
    /// first in the scene's order.
    pub(crate) fn closest(
        &self,
        origin: DVec3,
        direction: DVec3,
        tmin: f64,
        tmax: f64,
    ) -> Option<Hit> {
        let (ray, segment) = self.enter(origin, direction, tmin, tmax)?;
        let mut best: Option<(usize, Meeting)> = None;
        let mut tmax = ray.tmax;
        // obvhs compares distances in f32. It is told a bound that is never
        // too small; which triangle is nearest is decided here.
        self.bvh.ray_traverse(segment, &mut RayHit::none(), |_, i| {
            let triangle = &self.triangles[i];
            let Some(meeting) = ray.meets(triangle).filter(|m| m.t <= tmax) else {
                return f32::INFINITY;
            };
            let order = |i: usize| (self.triangles[i].mesh, self.triangles[i].index);
            if best.is_some_and(|(b, nearest)| nearest.t == meeting.t && order(b) < order(i))
                || self.opacity(triangle, &meeting) == 0.0
            {
                return f32::INFINITY;
            }
            (best, tmax) = (Some((i, meeting)), meeting.t);
            ((meeting.t - ray.skipped) as f32).next_up()
        });
        let (i, meeting) = best?;
        let Meeting { t, barycentric: (u, v) } = meeting;
        let triangle = &self.triangles[i];
        let p = triangle.vertices.map(DVec3::from_array);
        let normal = normal_of(p);
        Some(Hit {
            mesh: triangle.mesh as usize,
            triangle: triangle.index,
            t: t / self.scale,
            barycentric: (u, v),
            position: (p[0] + u * (p[1] - p[0]) + v * (p[2] - p[0])) / self.scale + self.centre,
            normal,
            front: normal.dot(direction) < 0.0,
            opacity: self.opacity(triangle, &meeting),
        })
    }

    fn opacity(&self, triangle: &Triangle, meeting: &Meeting) -> f32 {
        if !triangle.cut {
            return 1.0;
        }
        let cutout = self.cutouts[triangle.mesh as usize].as_ref();
        cutout.map_or(1.0, |cutout| cutout.opacity(triangle.index, meeting.barycentric))
    }

    /// Whether anything opaque is between two points.
    #[cfg(test)]
    pub(crate) fn occluded(&self, origin: DVec3, target: DVec3) -> bool {
        self.visibility(origin, target) == 0.0
    }

    /// The fraction of light that goes from one point to another: 0 behind
    /// something opaque, the product of the transmissions of what is clear.
    /// Refraction does not bend it.
    pub(crate) fn visibility(&self, origin: DVec3, target: DVec3) -> f32 {
        let path = target - origin;
        let length = path.length();
        if length == 0.0 {
            return 1.0;
        }
        self.visibility_along(origin, path / length, length * SHADOW_REACH)
    }

    /// [`visibility`](Self::visibility) over the distance `reach`, which may be
    /// infinite, along the unit `direction`.
    pub(crate) fn visibility_along(&self, origin: DVec3, direction: DVec3, reach: f64) -> f32 {
        let Some((ray, segment)) = self.enter(origin, direction, 0.0, reach) else { return 1.0 };
        let mut visibility = 1.0;
        self.bvh.ray_traverse_miss(segment, |_, i| {
            let triangle = &self.triangles[i];
            if let Some(meeting) = ray.meets(triangle) {
                let opacity = self.opacity(triangle, &meeting);
                visibility *= 1.0 - opacity * (1.0 - triangle.transmission);
            }
            // Any distance inside the segment ends the search.
            if visibility == 0.0 { 0.0 } else { f32::INFINITY }
        });
        visibility
    }

    /// Where a ray that leaves a surface along `direction` starts: off it by
    /// more than rounding, on the side that the ray goes to.
    pub(crate) fn leave(&self, position: DVec3, normal: DVec3, direction: DVec3) -> DVec3 {
        position + normal * self.offset.copysign(normal.dot(direction))
    }

    /// The ray in the scaled frame, and its part inside the scene's box for
    /// obvhs; `None` if there is none. Starting at the box keeps the f32
    /// coordinates small however far the eye is.
    fn enter(
        &self,
        origin: DVec3,
        direction: DVec3,
        tmin: f64,
        tmax: f64,
    ) -> Option<(ShearedRay, Ray)> {
        debug_assert!(direction.is_normalized(), "not a unit vector: {direction}");
        let origin = (origin - self.centre) * self.scale;
        let (tmin, tmax) = (tmin * self.scale, tmax * self.scale);
        let (mut near, mut far) = (tmin, tmax);
        for axis in 0..3 {
            let (o, d, half) = (origin[axis], direction[axis], self.half_sides[axis]);
            // With d = 0 on a face these are NaN, which min and max pass over.
            let (t0, t1) = ((-half - o) / d, (half - o) / d);
            near = near.max(t0.min(t1));
            far = far.min(t0.max(t1));
        }
        if near > far {
            return None;
        }
        let start = (origin + near * direction).as_vec3a();
        // obvhs takes the sign of a zero from two places that disagree on −0.
        let along = direction.as_vec3a() + Vec3A::ZERO;
        let reach = ((far - near) as f32).next_up() + PADDING;
        let segment = Ray::new(start, along, 0.0, reach);
        Some((ShearedRay::new(origin, direction, near, tmin, tmax), segment))
    }
}

/// Unit normal on the side from which `p` runs counter-clockwise; not finite if
/// the triangle has no area or its coordinates are not finite.
fn normal_of(p: [DVec3; 3]) -> DVec3 {
    let n = (p[1] - p[0]).cross(p[2] - p[0]);
    n / n.length()
}

fn padded_box(triangle: &Triangle) -> Aabb {
    let [a, b, c] = triangle.vertices.map(|p| DVec3::from_array(p).as_vec3a());
    Aabb::new(a.min(b).min(c) - PADDING, a.max(b).max(c) + PADDING)
}

/// Where a [`ShearedRay`] meets a triangle.
#[derive(Clone, Copy, Debug)]
struct Meeting {
    t: f64,
    barycentric: (f64, f64),
}

/// A ray in the scaled frame with the shear that turns it into +z (Woop et al.,
/// §3.1).
#[derive(Debug)]
struct ShearedRay {
    origin: [f64; 3],
    /// The axes that become x, y and z.
    axes: [usize; 3],
    shear: [f64; 3],
    /// Where the segment given to obvhs starts.
    skipped: f64,
    tmin: f64,
    tmax: f64,
}

impl ShearedRay {
    fn new(origin: DVec3, direction: DVec3, skipped: f64, tmin: f64, tmax: f64) -> Self {
        let z = direction.abs().max_position();
        let axes = [(z + 1) % 3, (z + 2) % 3, z];
        let d = axes.map(|axis| direction[axis]);
        let shear = [d[0] / d[2], d[1] / d[2], 1.0 / d[2]];
        Self { origin: origin.to_array(), axes, shear, skipped, tmin, tmax }
    }

    /// Woop et al., §3.2, in f64 throughout. A vanishing edge function counts as
    /// inside: both neighbours of an edge get bitwise opposite values, so a
    /// ray through the edge is claimed by at least one of them.
    ///
    /// Departs from Woop et al. in having no fallback to a higher precision;
    /// theirs only settles which of the two neighbours is hit.
    #[inline]
    fn meets(&self, triangle: &Triangle) -> Option<Meeting> {
        let [kx, ky, kz] = self.axes;
        let [sx, sy, sz] = self.shear;
        let [a, b, c] = triangle.vertices.map(|p| {
            let z = p[kz] - self.origin[kz];
            [p[kx] - self.origin[kx] - sx * z, p[ky] - self.origin[ky] - sy * z, z]
        });
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let determinant = u + v + w;
        if determinant == 0.0 {
            return None;
        }
        let inverse = 1.0 / determinant;
        let t = sz * (u * a[2] + v * b[2] + w * c[2]) * inverse;
        (self.tmin < t && t < self.tmax)
            .then_some(Meeting { t, barycentric: (v * inverse, w * inverse) })
    }
}

#[cfg(test)]
mod tests;
