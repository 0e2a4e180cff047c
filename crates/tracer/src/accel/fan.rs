//! Several rays from one point at a time: a pixel's camera rays, a surface's shadow
//! rays. They find what each would find alone.

use super::block::ShearedRay;
use super::wide::fan::{FanRays, RAYS, octant};
use super::{Accel, Hit};
use fearless_simd::{Simd, dispatch};
use glam::DVec3;

/// Rays that go alone: getting ready to go together takes as long as they do.
const FEW: u32 = 5;

/// Rays of a fan from which on a block's edges are looked at for all of them first.
const MANY: u32 = 3;

/// A fan in the scaled frame, in double precision.
struct Fan {
    origin: DVec3,
    sheared: [ShearedRay; RAYS],
    tmax: [f64; RAYS],
    /// In single precision, by axis.
    directions: [[f32; RAYS]; 3],
}

/// The rays among `left` whose directions have the signs of the first's, and those.
fn alike(directions: &[DVec3], left: u32) -> (u32, [bool; 3]) {
    let backward = octant(directions[left.trailing_zeros() as usize]);
    let same = |of: u32, (ray, direction): (usize, &DVec3)| {
        if octant(*direction) == backward { of | 1 << ray } else { of }
    };
    (left & directions.iter().enumerate().fold(0, same), backward)
}

/// The places of the bits in `of`.
fn bits(mut of: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let ray = (of != 0).then_some(of.trailing_zeros() as usize % RAYS);
        of &= of.wrapping_sub(1);
        ray
    })
}

impl Accel {
    /// [`closest`](Self::closest) along each of the unit `directions` from `origin` on,
    /// however far, put into `hits`.
    pub(crate) fn closest_of(
        &self,
        origin: DVec3,
        directions: &[DVec3],
        hits: &mut Vec<Option<Hit>>,
    ) {
        hits.clear();
        for directions in directions.chunks(RAYS) {
            let at = hits.len();
            hits.resize(at + directions.len(), None);
            let hits = &mut hits[at..];
            if directions.len() <= FEW as usize {
                for (hit, direction) in hits.iter_mut().zip(directions) {
                    *hit = self.closest(origin, *direction, 0.0, f64::INFINITY);
                }
                continue;
            }
            dispatch!(self.level, simd => self.closest_with_fan(simd, origin, directions, hits));
        }
    }

    #[inline(always)]
    fn closest_with_fan<S: Simd>(
        &self,
        simd: S,
        origin: DVec3,
        directions: &[DVec3],
        hits: &mut [Option<Hit>],
    ) {
        let mut left = (1 << directions.len()) - 1;
        while left != 0 {
            let (of, backward) = alike(directions, left);
            left &= !of;
            let reach = [f64::INFINITY; RAYS];
            let Some((mut rays, mut fan)) = self.fan(origin, directions, backward, of, &reach)
            else {
                for ray in bits(of) {
                    hits[ray] =
                        self.closest_with(simd, origin, directions[ray], 0.0, f64::INFINITY);
                }
                continue;
            };
            let mut best = [None; RAYS];
            self.hierarchy.traverse_fan(
                simd,
                &mut rays,
                #[inline(always)]
                |i, of, reach| {
                    let i = i as usize;
                    for ray in bits(self.worth_it(simd, i, of, &fan)) {
                        let (sheared, tmax) = (&fan.sheared[ray], &mut fan.tmax[ray]);
                        self.closer(simd, i, sheared, 0.0, tmax, &mut best[ray]);
                        reach[ray] = reach[ray].min((*tmax as f32).next_up());
                    }
                },
            );
            for ray in bits(of) {
                let found = best[ray].as_ref();
                hits[ray] =
                    found.map(|(place, meeting)| self.hit(*place, meeting, directions[ray]));
            }
        }
    }

    /// [`visibility_along`](Self::visibility_along) each of the unit directions over its
    /// reach from `origin` on, put into `visible`.
    pub(crate) fn visibility_of(
        &self,
        origin: DVec3,
        rays: &[(DVec3, f64)],
        visible: &mut Vec<f32>,
    ) {
        visible.clear();
        for rays in rays.chunks(RAYS) {
            let at = visible.len();
            visible.resize(at + rays.len(), 1.0);
            let visible = &mut visible[at..];
            if rays.len() <= FEW as usize {
                for (visible, (direction, reach)) in visible.iter_mut().zip(rays) {
                    *visible = self.visibility_along(origin, *direction, *reach);
                }
                continue;
            }
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
        let mut directions = [DVec3::ZERO; RAYS];
        let mut reach = [0.0; RAYS];
        for (ray, along) in rays.iter().enumerate() {
            (directions[ray], reach[ray]) = *along;
        }
        let directions = &directions[..rays.len()];
        let mut left = (1 << directions.len()) - 1;
        while left != 0 {
            let (of, backward) = alike(directions, left);
            left &= !of;
            let Some((mut rays, fan)) = self.fan(origin, directions, backward, of, &reach) else {
                for ray in bits(of) {
                    visible[ray] = self.visibility_with(simd, origin, directions[ray], reach[ray]);
                }
                continue;
            };
            self.hierarchy.traverse_fan(
                simd,
                &mut rays,
                #[inline(always)]
                |i, of, reach| {
                    let i = i as usize;
                    for ray in bits(self.worth_it(simd, i, of, &fan)) {
                        visible[ray] *= self.passed(simd, i, &fan.sheared[ray], 0.0, fan.tmax[ray]);
                        if visible[ray] == 0.0 {
                            reach[ray] = -1.0;
                        }
                    }
                },
            );
        }
    }

    /// The rays with bits in `of`, which are [`alike`], ready to go together, if that pays.
    #[inline(always)]
    fn fan(
        &self,
        origin: DVec3,
        directions: &[DVec3],
        backward: [bool; 3],
        of: u32,
        reach: &[f64; RAYS],
    ) -> Option<(FanRays, Fan)> {
        if of.count_ones() <= FEW {
            return None;
        }
        let origin = (origin - self.centre) * self.scale;
        let reach = reach.map(|reach| reach * self.scale);
        let mut fan = Fan {
            origin,
            sheared: [ShearedRay::default(); RAYS],
            // As a single ray's: a meeting at the very end is none.
            tmax: reach.map(f64::next_down),
            directions: [[0.0; RAYS]; 3],
        };
        let mut inverses = [DVec3::ONE; RAYS];
        for ray in bits(of) {
            let direction = directions[ray];
            inverses[ray] = direction.recip();
            fan.sheared[ray] = ShearedRay::new(origin, direction, inverses[ray]);
            for axis in 0..3 {
                fan.directions[axis][ray] = direction[axis] as f32;
            }
        }
        let rays = FanRays::new(origin, &inverses, backward, of, &reach)?;
        Some((rays, fan))
    }

    /// The rays with bits in `of` that a block's triangles should be tested with.
    #[inline(always)]
    fn worth_it<S: Simd>(&self, simd: S, block: usize, of: u32, fan: &Fan) -> u32 {
        if of.count_ones() < MANY {
            return of;
        }
        of & self.blocks[block].seen_from(simd, fan.origin).may_meet(simd, &fan.directions)
    }
}
