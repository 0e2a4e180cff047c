//! Rays from one point go through the hierarchy together.
//!
//! A node's eight boxes are tested at once against the pyramid of all rays (after
//! A. Reshetov, A. Soupikov and J. Hurley, *Multi-Level Ray Tracing Algorithm*,
//! SIGGRAPH 2005); a box that this leaves is tested against each of the rays.

use super::{BLOCK, Node, Stack, WIDTH, Wide};
use fearless_simd::{f32x8, f32x16, mask32x16, prelude::*};
use glam::{DVec3, Vec3};

/// Rays of a fan.
pub(in crate::accel) const RAYS: usize = 32;

/// Rays of a register.
const LANES: usize = 16;

/// The farthest from the scaled frame's origin, along an axis, that a fan may begin:
/// at least four times the scene's half extent. Planes are at most 2¹³ from there, and
/// rounding to single precision, of the origin, a direction, its inverse, a difference
/// and a product, moves them by less than 5 · 2⁻²⁴ of that: two thirds of what boxes are
/// padded by.
const FARTHEST: f64 = 4096.0;

/// Up to [`RAYS`] rays from one point whose directions have the same signs, in single
/// precision.
#[derive(Clone, Debug)]
pub(in crate::accel) struct FanRays {
    origin: Vec3,
    /// By axis and ray.
    inverse: [[f32; RAYS]; 3],
    /// The least and the greatest of them, by axis.
    between: [[f32; 2]; 3],
    backward: [bool; 3],
    /// How far each is looked along; less than nothing where there is none.
    pub(in crate::accel) reach: [f32; RAYS],
}

/// The places of the bits in `of`.
pub(in crate::accel) fn bits(mut of: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let ray = (of != 0).then_some(of.trailing_zeros() as usize % RAYS);
        of &= of.wrapping_sub(1);
        ray
    })
}

/// By axis, the bits of the directions that go backward.
#[inline(always)]
pub(in crate::accel) fn signs<S: Simd>(simd: S, directions: &[[f32; RAYS]; 3]) -> [u32; 3] {
    let [x, y, z] = directions;
    [negative(simd, x), negative(simd, y), negative(simd, z)]
}

#[inline(always)]
fn negative<S: Simd>(simd: S, x: &[f32; RAYS]) -> u32 {
    let mut negative = 0;
    for at in (0..RAYS).step_by(LANES) {
        let x = f32x16::load_array_ref(simd, lanes(x, at));
        negative |= (x.simd_lt(f32x16::splat(simd, 0.0)).to_bitmask() as u32) << at;
    }
    negative
}

/// The rays from `at` on, of a register.
#[inline(always)]
pub(in crate::accel) fn lanes(x: &[f32; RAYS], at: usize) -> &[f32; LANES] {
    &x.as_chunks().0[at / LANES]
}

#[inline(always)]
fn lanes_mut(x: &mut [f32; RAYS], at: usize) -> &mut [f32; LANES] {
    &mut x.as_chunks_mut().0[at / LANES]
}

impl FanRays {
    /// The rays with a bit in `of` from `origin` in the scaled frame up to the distances
    /// `reach` along `directions`, by axis, whose [`signs`] are `backward`; `None`
    /// too far from the scene.
    #[inline(always)]
    pub(in crate::accel) fn new<S: Simd>(
        simd: S,
        origin: DVec3,
        directions: &[[f32; RAYS]; 3],
        backward: [bool; 3],
        of: u32,
        reach: &[f32; RAYS],
    ) -> Option<Self> {
        if origin.abs().max_element() > FARTHEST {
            return None;
        }
        let mut fan = Self {
            origin: origin.as_vec3(),
            inverse: [[0.0; RAYS]; 3],
            between: [[0.0; 2]; 3],
            backward,
            reach: [0.0; RAYS],
        };
        let one = f32x16::splat(simd, 1.0);
        let (least, most) = (f32::INFINITY, f32::NEG_INFINITY);
        let mut between = [[f32x16::splat(simd, least), f32x16::splat(simd, most)]; 3];
        for at in (0..RAYS).step_by(LANES) {
            let there = mask32x16::from_bitmask(simd, u64::from(of >> at & 0xffff));
            for (axis, [least, most]) in between.iter_mut().enumerate() {
                // A component below 10⁻¹⁸ moves no point of the scaled scene by as much
                // as rounding does, and its inverse keeps all products finite.
                let x = (one / f32x16::load_array_ref(simd, lanes(&directions[axis], at))).abs();
                let x = x.min(f32x16::splat(simd, 1e18));
                let x = if backward[axis] { -x } else { x };
                *lanes_mut(&mut fan.inverse[axis], at) = x.into();
                *least = there.select(least.min(x), *least);
                *most = there.select(most.max(x), *most);
            }
            let reach = f32x16::load_array_ref(simd, lanes(reach, at));
            // Short of infinity, where missing children are.
            let reach = reach.min(f32x16::splat(simd, f32::MAX));
            let reach = there.select(reach, f32x16::splat(simd, -1.0));
            *lanes_mut(&mut fan.reach, at) = reach.into();
        }
        for (ends, [least, most]) in fan.between.iter_mut().zip(between) {
            *ends = [least.reduce_min(), most.reduce_max()];
        }
        Some(fan)
    }

    #[inline(always)]
    fn farthest<S: Simd>(&self, simd: S) -> f32 {
        let mut farthest = f32x16::load_array_ref(simd, lanes(&self.reach, 0));
        for at in (LANES..RAYS).step_by(LANES) {
            farthest = farthest.max(f32x16::load_array_ref(simd, lanes(&self.reach, at)));
        }
        farthest.reduce_max()
    }
}

impl Wide {
    /// Calls `block` for each block whose box some rays meet within their reach, with
    /// the bits of those, nearest boxes first. It may shorten the rays' reach; one of less
    /// than nothing ends a ray.
    #[inline(always)]
    pub(in crate::accel) fn traverse_fan<S: Simd>(
        &self,
        simd: S,
        fan: &mut FanRays,
        mut block: impl FnMut(u32, u32, &mut [f32; RAYS]),
    ) {
        if self.nodes.is_empty() {
            return;
        }
        let mut farthest = fan.farthest(simd);
        let mut stack = Stack::default();
        let mut current = 0_u32;
        loop {
            let node = &self.nodes[current as usize];
            let (mut met, near) = node.meets_pyramid(simd, fan, farthest);
            let bottom = stack.len;
            while met != 0 {
                let lane = met.trailing_zeros() % WIDTH as u32;
                met &= met - 1;
                let place = u64::from(current * WIDTH as u32 + lane);
                stack.insert(bottom, u64::from(near[lane as usize].to_bits()) << 32 | place);
            }
            loop {
                let Some(next) = stack.pop() else { return };
                if f32::from_bits((next >> 32) as u32) > farthest {
                    continue;
                }
                let place = next as u32;
                let (node, lane) = (&self.nodes[place as usize / WIDTH], place as usize % WIDTH);
                let rays = node.meets_each(simd, lane, fan);
                if rays == 0 {
                    continue;
                }
                let child = node.children[lane];
                if child & BLOCK == 0 {
                    current = child;
                    break;
                }
                block(child & !BLOCK, rays, &mut fan.reach);
                farthest = fan.farthest(simd);
                if farthest < 0.0 {
                    return;
                }
            }
        }
    }
}

impl Node {
    /// Which boxes a ray of the fan may meet, and where at the earliest.
    #[inline(always)]
    fn meets_pyramid<S: Simd>(&self, simd: S, fan: &FanRays, farthest: f32) -> (u32, [f32; WIDTH]) {
        let mut near = f32x8::splat(simd, 0.0);
        let mut far = f32x8::splat(simd, farthest);
        for axis in 0..3 {
            let planes = &self.planes[axis];
            let backward = usize::from(fan.backward[axis]);
            let origin = f32x8::splat(simd, fan.origin[axis]);
            let least = f32x8::splat(simd, fan.between[axis][0]);
            let most = f32x8::splat(simd, fan.between[axis][1]);
            let first = f32x8::load_array_ref(simd, &planes[backward]) - origin;
            let last = f32x8::load_array_ref(simd, &planes[1 - backward]) - origin;
            near = near.max((first * least).min(first * most));
            far = far.min((last * least).max(last * most));
        }
        (near.simd_le(far).to_bitmask() as u32, near.into())
    }

    /// Which rays of the fan meet the box of the child at `lane`.
    #[inline(always)]
    fn meets_each<S: Simd>(&self, simd: S, lane: usize, fan: &FanRays) -> u32 {
        let mut met = 0;
        for at in (0..RAYS).step_by(LANES) {
            let mut near = f32x16::splat(simd, 0.0);
            let mut far = f32x16::load_array_ref(simd, lanes(&fan.reach, at));
            for axis in 0..3 {
                let planes = &self.planes[axis];
                let backward = usize::from(fan.backward[axis]);
                let inverse = f32x16::load_array_ref(simd, lanes(&fan.inverse[axis], at));
                let first = planes[backward][lane] - fan.origin[axis];
                let last = planes[1 - backward][lane] - fan.origin[axis];
                near = near.max(inverse * f32x16::splat(simd, first));
                far = far.min(inverse * f32x16::splat(simd, last));
            }
            met |= (near.simd_le(far).to_bitmask() as u32) << at;
        }
        met
    }
}
