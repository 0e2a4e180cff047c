//! Closest hit and shadow ray over every triangle of a scene; the only module
//! that names obvhs.
//!
//! The hierarchy's boxes are f32, the triangles f64. Two things make the whole
//! watertight: the triangle test is that of S. Woop, C. Benthin and I. Wald,
//! *Watertight Ray/Triangle Intersection*, JCGT 2(1), 2013, and the boxes are
//! padded by more than the rounding of a ray to f32 can move it. Vertices are
//! centred on the scene and scaled by a power of two first, so that the padding
//! means the same for every scene.
//!
//! Which triangle is hit, and where, depends neither on the shape of the hierarchy
//! nor on how wide the machine's registers are.

mod block;
mod each;
mod fan;
mod wide;

use crate::scene::{Cutout, Mesh, Scene};
use block::{Block, Meeting, Owner, ShearedRay};
use fearless_simd::{Level, Simd, dispatch};
use glam::DVec3;
use obvhs::aabb::Aabb;
use rayon::prelude::*;
use wide::{Next, SlabRay, Wide};

/// Triangles of a block, tested at once.
const LANES: usize = 4;

/// Half the longest side of the scaled scene, to within a factor of two.
const HALF_EXTENT: f64 = 1024.0;

/// What the boxes are padded by: 2⁻¹⁸ of [`HALF_EXTENT`], where rounding a ray
/// and the slab test to f32 costs a few times 2⁻²⁴.
const PADDING: f32 = 1.0 / 256.0;

/// How far secondary rays start from a surface, relative to the scene's largest
/// coordinate. f64 rounding moves a hit by about 10⁻¹⁵.
const OFFSET: f64 = 1e-10;

/// How much of a shadow ray is looked at, so that the lamp does not occlude
/// itself.
pub(crate) const SHADOW_REACH: f64 = 1.0 - 1e-9;

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

/// A ray, from a distance on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray {
    pub(crate) origin: DVec3,
    /// Unit.
    pub(crate) direction: DVec3,
    pub(crate) from: f64,
}

/// What a ray meets, before anything is known of the place but where it is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Found {
    block: u32,
    lane: u32,
    meeting: Meeting,
}

/// What a mesh does to rays.
#[derive(Debug)]
struct Cover {
    /// What a shadow ray keeps in passing: 0 for opaque.
    transmission: f32,
    /// Where it is not opaque.
    cutout: Option<Cutout>,
}

/// All triangles of a scene, ready for rays.
#[derive(Debug)]
pub(crate) struct Accel {
    level: Level,
    hierarchy: Wide,
    /// As the hierarchy numbers them.
    blocks: Vec<Block>,
    /// One a mesh.
    covers: Vec<Cover>,
    /// World position of the scaled frame's origin.
    centre: DVec3,
    /// Scaled units per metre, a power of two.
    scale: f64,
    /// One over it.
    metres: f64,
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
        let (mut triangles, mut owners) = (Vec::new(), Vec::new());
        for (m, mesh) in scene.meshes.iter().enumerate() {
            for (i, corners) in mesh.triangles.iter().enumerate() {
                let p = corners.map(|corner| mesh.positions[corner as usize]);
                if !normal_of(p).is_finite() {
                    continue;
                }
                for p in p {
                    (low, high) = (low.min(p), high.max(p));
                }
                let index = |i| u32::try_from(i).expect("fewer than 2³² triangles");
                triangles.push(p);
                owners.push(Owner { mesh: index(m), triangle: index(i) });
            }
        }
        if triangles.is_empty() {
            (low, high) = (-DVec3::ONE, DVec3::ONE);
        }
        let centre = 0.5 * low + 0.5 * high;
        let half_sides = 0.5 * high - 0.5 * low;
        let scale = (HALF_EXTENT / half_sides.max_element()).log2().floor().exp2();
        for p in triangles.iter_mut().flatten() {
            *p = (*p - centre) * scale;
        }
        let boxes: Vec<Aabb> = triangles.par_iter().map(padded_box).collect();
        let (hierarchy, order) = Wide::new(&boxes);
        let member = |i: u32| (triangles[i as usize], owners[i as usize]);
        let block = |members: &[Option<u32>; LANES]| Block::new(members.map(|i| i.map(member)));
        let cover = |mesh: &Mesh| Cover {
            transmission: scene.materials[mesh.material].transmission.clamp(0.0, 1.0),
            cutout: Cutout::of(scene, mesh),
        };
        Self {
            level: Level::new(),
            hierarchy,
            blocks: order.par_iter().map(block).collect(),
            covers: scene.meshes.iter().map(cover).collect(),
            centre,
            scale,
            metres: scale.recip(),
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
        let found = self.find(origin, direction, tmin, tmax)?;
        Some(self.hit(&found, direction))
    }

    /// [`closest`](Self::closest), to be [looked at](Self::hit).
    pub(crate) fn find(
        &self,
        origin: DVec3,
        direction: DVec3,
        tmin: f64,
        tmax: f64,
    ) -> Option<Found> {
        dispatch!(self.level, simd => self.find_with(simd, origin, direction, tmin, tmax))
    }

    #[inline(always)]
    fn find_with<S: Simd>(
        &self,
        simd: S,
        origin: DVec3,
        direction: DVec3,
        tmin: f64,
        tmax: f64,
    ) -> Option<Found> {
        let ray = self.enter(origin, direction, tmin, tmax)?;
        let mut best = None;
        let mut tmax = ray.tmax;
        self.hierarchy.traverse(
            simd,
            &ray.slabs,
            #[inline(always)]
            |i| {
                self.closer(simd, i, &ray.sheared, ray.tmin, &mut tmax, &mut best);
                Next::Within(ray.single(tmax))
            },
        );
        best
    }

    /// Puts what a ray meets in a block into `best`, and its distance into `tmax`, if it
    /// is not farther than that.
    #[inline(always)]
    fn closer<S: Simd>(
        &self,
        simd: S,
        block: u32,
        ray: &ShearedRay,
        tmin: f64,
        tmax: &mut f64,
        best: &mut Option<Found>,
    ) {
        let mut meetings = ray.meets(simd, &self.blocks[block as usize], tmin, *tmax);
        while meetings.met != 0 {
            let lane = meetings.take();
            let found = Found { block, lane, meeting: meetings.at(lane) };
            let t = found.meeting.t;
            let later = |best: &Found| best.meeting.t == t && self.owner(best) < self.owner(&found);
            let farther = t > *tmax || best.as_ref().is_some_and(later);
            if !farther && self.opacity(&found) != 0.0 {
                (*best, *tmax) = (Some(found), t);
            }
        }
    }

    /// What there is where a ray along the unit `direction` has found something.
    pub(crate) fn hit(&self, found: &Found, direction: DVec3) -> Hit {
        let Owner { mesh, triangle } = self.owner(found);
        let p = self.blocks[found.block as usize].triangle(found.lane);
        let normal = normal_of(p);
        let (u, v) = found.meeting.barycentric();
        Hit {
            mesh: mesh as usize,
            triangle,
            t: found.meeting.t * self.metres,
            barycentric: (u, v),
            position: (p[0] + u * (p[1] - p[0]) + v * (p[2] - p[0])) * self.metres + self.centre,
            normal,
            front: normal.dot(direction) < 0.0,
            opacity: self.opacity(found),
        }
    }

    #[inline]
    fn owner(&self, found: &Found) -> Owner {
        self.blocks[found.block as usize].owner(found.lane)
    }

    #[inline]
    fn opacity(&self, found: &Found) -> f32 {
        let Owner { mesh, triangle } = self.owner(found);
        let cutout = self.covers[mesh as usize].cutout.as_ref();
        cutout.map_or(1.0, |cutout| cutout.opacity(triangle, found.meeting.barycentric()))
    }

    /// Whether anything opaque is between two points.
    #[cfg(test)]
    pub(crate) fn occluded(&self, origin: DVec3, target: DVec3) -> bool {
        self.visibility(origin, target) == 0.0
    }

    /// [`visibility_along`](Self::visibility_along) from one point to another.
    #[cfg(test)]
    pub(crate) fn visibility(&self, origin: DVec3, target: DVec3) -> f32 {
        let path = target - origin;
        let length = path.length();
        if length == 0.0 {
            return 1.0;
        }
        self.visibility_along(origin, path / length, length * SHADOW_REACH)
    }

    /// [`visibility_of`](Self::visibility_of) a single ray.
    #[cfg(test)]
    pub(crate) fn visibility_along(&self, origin: DVec3, direction: DVec3, reach: f64) -> f32 {
        dispatch!(self.level, simd => self.visibility_with(simd, origin, direction, reach))
    }

    #[inline(always)]
    fn visibility_with<S: Simd>(
        &self,
        simd: S,
        origin: DVec3,
        direction: DVec3,
        reach: f64,
    ) -> f32 {
        let Some(ray) = self.enter(origin, direction, 0.0, reach) else { return 1.0 };
        let mut visibility = 1.0;
        self.hierarchy.traverse(
            simd,
            &ray.slabs,
            #[inline(always)]
            |i| {
                visibility *= self.passed(simd, i, &ray.sheared, ray.tmin, ray.tmax);
                if visibility == 0.0 { Next::Stop } else { Next::Within(ray.reach) }
            },
        );
        visibility
    }

    /// What a shadow ray keeps in passing a block.
    #[inline(always)]
    fn passed<S: Simd>(&self, simd: S, block: u32, ray: &ShearedRay, tmin: f64, tmax: f64) -> f32 {
        let mut kept = 1.0;
        let mut meetings = ray.meets(simd, &self.blocks[block as usize], tmin, tmax);
        while meetings.met != 0 {
            let lane = meetings.take();
            let found = Found { block, lane, meeting: meetings.at(lane) };
            let transmission = self.covers[self.owner(&found).mesh as usize].transmission;
            kept *= 1.0 - self.opacity(&found) * (1.0 - transmission);
        }
        kept
    }

    /// Where a ray that leaves a surface along `direction` starts: off it by
    /// more than rounding, on the side that the ray goes to.
    pub(crate) fn leave(&self, position: DVec3, normal: DVec3, direction: DVec3) -> DVec3 {
        position + normal * self.offset.copysign(normal.dot(direction))
    }

    /// The ray in the scaled frame, and its part inside the scene's box; `None` if
    /// there is none. Starting at the box keeps the f32 coordinates small however
    /// far the eye is.
    #[inline(always)]
    fn enter(&self, origin: DVec3, direction: DVec3, tmin: f64, tmax: f64) -> Option<Entered> {
        debug_assert!(direction.is_normalized(), "not a unit vector: {direction}");
        let origin = (origin - self.centre) * self.scale;
        let (tmin, tmax) = (tmin * self.scale, tmax * self.scale);
        let inverse = direction.recip();
        let (mut near, mut far) = (tmin, tmax);
        for axis in 0..3 {
            let (o, d) = (origin[axis], inverse[axis]);
            let half = self.half_sides[axis].copysign(d);
            // Of a ray in a face one is not a number, and passed over.
            let (enters, leaves) = ((-half - o) * d, (half - o) * d);
            near = if enters > near { enters } else { near };
            far = if leaves < far { leaves } else { far };
        }
        if near > far {
            return None;
        }
        let reach = (((far - near) as f32).next_up() + PADDING).min(f32::MAX);
        Some(Entered {
            slabs: SlabRay::new(origin + near * direction, inverse, reach),
            sheared: ShearedRay::new(origin, direction),
            skipped: near,
            reach,
            tmin,
            // A meeting at the very end is none.
            tmax: tmax.next_down(),
        })
    }
}

/// A ray in the scaled frame.
#[derive(Debug)]
struct Entered {
    /// From the scene's box on.
    slabs: SlabRay,
    sheared: ShearedRay,
    /// Where the box begins.
    skipped: f64,
    /// Where it or the ray ends, from `skipped`.
    reach: f32,
    tmin: f64,
    tmax: f64,
}

impl Entered {
    /// A distance as the boxes take it, never too small.
    #[inline(always)]
    fn single(&self, t: f64) -> f32 {
        ((t - self.skipped) as f32).next_up().min(self.reach)
    }
}

/// Unit normal on the side from which `p` runs counter-clockwise; not finite if
/// the triangle has no area or its coordinates are not finite.
fn normal_of(p: [DVec3; 3]) -> DVec3 {
    let n = (p[1] - p[0]).cross(p[2] - p[0]);
    n / n.length()
}

fn padded_box(triangle: &[DVec3; 3]) -> Aabb {
    let [a, b, c] = triangle.map(|p| p.as_vec3a());
    Aabb::new(a.min(b).min(c) - PADDING, a.max(b).max(c) + PADDING)
}

#[cfg(test)]
mod tests;
