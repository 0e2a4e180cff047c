//! Several rays from one point at a time: a pixel's camera rays, a surface's shadow
//! rays. They find what each would find alone.

use super::block::ShearedRay;
use super::wide::fan::{FanRays, RAYS, bits, signs};
use super::{Accel, Found};
use fearless_simd::{Simd, dispatch};
use glam::DVec3;

/// Rays that go alone: getting ready to go together takes as long as they do.
const FEW: u32 = 3;

/// Rays of a fan from which on a block's edges are looked at for all of them first.
const MANY: u32 = 3;

impl Accel {
    /// [`find`](Self::find) along each of the unit `directions` from `origin` on, however
    /// far, put into `found`.
    pub(crate) fn find_of(
        &self,
        origin: DVec3,
        directions: &[DVec3],
        found: &mut Vec<Option<Found>>,
    ) {
        found.clear();
        found.resize(directions.len(), None);
        for (directions, found) in directions.chunks(RAYS).zip(found.chunks_mut(RAYS)) {
            dispatch!(self.level, simd => self.find_with_fan(simd, origin, directions, found));
        }
    }

    #[inline(always)]
    fn find_with_fan<S: Simd>(
        &self,
        simd: S,
        origin: DVec3,
        directions: &[DVec3],
        found: &mut [Option<Found>],
    ) {
        let from = self.scaled(origin);
        let mut tmax = [f64::MAX; RAYS];
        let alone = self.together(
            simd,
            from,
            directions,
            &[f32::INFINITY; RAYS],
            #[inline(always)]
            |block, ray, reach| {
                let sheared = ShearedRay::new(from, directions[ray]);
                self.closer(simd, block, &sheared, 0.0, &mut tmax[ray], &mut found[ray]);
                *reach = reach.min((tmax[ray] as f32).next_up());
            },
        );
        for ray in bits(alone) {
            found[ray] = self.find(origin, directions[ray], 0.0, f64::INFINITY);
        }
    }

    /// The fraction of light that goes along each of the unit directions over its reach,
    /// which may be infinite, from `origin` on, put into `visible`: 0 behind something
    /// opaque, the product of the transmissions of what is clear. Refraction does not bend
    /// it.
    pub(crate) fn visibility_of(
        &self,
        origin: DVec3,
        rays: &[(DVec3, f64)],
        visible: &mut Vec<f32>,
    ) {
        visible.clear();
        visible.resize(rays.len(), 1.0);
        for (rays, visible) in rays.chunks(RAYS).zip(visible.chunks_mut(RAYS)) {
            dispatch!(self.level, simd => self.visibility_with_fan(simd, origin, rays, visible));
        }
    }

    #[inline(always)]
    fn visibility_with_fan<S: Simd>(
        &self,
        simd: S,
        origin: DVec3,
        rays: &[(DVec3, f64)],
        visible: &mut [f32],
    ) {
        let from = self.scaled(origin);
        let mut directions = [DVec3::ZERO; RAYS];
        let (mut tmax, mut reach) = ([0.0; RAYS], [0.0; RAYS]);
        for (ray, (direction, end)) in rays.iter().enumerate() {
            let end = end * self.scale;
            directions[ray] = *direction;
            // As a single ray's: a meeting at the very end is none.
            (tmax[ray], reach[ray]) = (end.next_down(), (end as f32).next_up());
        }
        let alone = self.together(
            simd,
            from,
            &directions[..rays.len()],
            &reach,
            #[inline(always)]
            |block, ray, reach| {
                let sheared = ShearedRay::new(from, directions[ray]);
                visible[ray] *= self.passed(simd, block, &sheared, 0.0, tmax[ray]);
                if visible[ray] == 0.0 {
                    *reach = -1.0;
                }
            },
        );
        for ray in bits(alone) {
            visible[ray] = self.visibility_with(simd, origin, rays[ray].0, rays[ray].1);
        }
    }

    fn scaled(&self, origin: DVec3) -> DVec3 {
        (origin - self.centre) * self.scale
    }

    /// Takes the rays from `origin` in the scaled frame along up to [`RAYS`] `directions`
    /// through the hierarchy together, those whose directions have the same signs; calls
    /// `meet` with a block, a ray that may meet its triangles, and how far that ray is
    /// looked along from then on. Returns the bits of the rays that have to go alone.
    #[inline(always)]
    fn together<S: Simd>(
        &self,
        simd: S,
        origin: DVec3,
        directions: &[DVec3],
        reach: &[f32; RAYS],
        mut meet: impl FnMut(u32, usize, &mut f32),
    ) -> u32 {
        let mut left = u32::MAX >> (RAYS - directions.len());
        if directions.len() as u32 <= FEW {
            return left;
        }
        let mut by_axis = [[0.0; RAYS]; 3];
        for (ray, direction) in directions.iter().enumerate() {
            for axis in 0..3 {
                by_axis[axis][ray] = direction[axis] as f32;
            }
        }
        let negative = signs(simd, &by_axis);
        let mut alone = 0;
        while left != 0 {
            let backward = negative.map(|negative| negative >> left.trailing_zeros() & 1 == 1);
            let alike = |of: u32, axis: usize| {
                of & if backward[axis] { negative[axis] } else { !negative[axis] }
            };
            let of = (0..3).fold(left, alike);
            left &= !of;
            let Some(mut rays) = (of.count_ones() > FEW)
                .then(
                    #[inline(always)]
                    || FanRays::new(simd, origin, &by_axis, backward, of, reach),
                )
                .flatten()
            else {
                alone |= of;
                continue;
            };
            self.hierarchy.traverse_fan(
                simd,
                &mut rays,
                #[inline(always)]
                |block, of, reach| {
                    let mut of = of;
                    if of.count_ones() >= MANY {
                        let edges = self.blocks[block as usize].seen_from(simd, origin);
                        of &= edges.may_meet(simd, &by_axis);
                    }
                    for ray in bits(of) {
                        meet(block, ray, &mut reach[ray]);
                    }
                },
            );
        }
        alone
    }
}
