//! Rays from one point go through the hierarchy together.
//!
//! A node's eight boxes are tested at once against the pyramid of all rays (after
//! A. Reshetov, A. Soupikov and J. Hurley, *Multi-Level Ray Tracing Algorithm*,
//! SIGGRAPH 2005); a box that this leaves is tested against each of the rays.

use super::{BLOCK, Node, Stack, WIDTH, Wide};
use fearless_simd::{f32x8, f32x16, prelude::*};
use glam::{DVec3, Vec3};

/// Rays of a fan.
pub(in crate::accel) const RAYS: usize = 16;

/// The farthest from the scaled frame's origin, along an axis, that a fan may begin:
/// at least four times the scene's half extent. Single precision then moves planes by less
/// than half of what boxes are padded by.
const FARTHEST: f64 = 4096.0;

/// Up to [`RAYS`] rays from one point whose directions have the same signs, in single
/// precision.
#[derive(Clone, Debug)]
pub(in crate::accel) struct FanRays {
    origin: Vec3,
    /// By axis and ray; 1 where there is none.
    inverse: [[f32; RAYS]; 3],
    /// The least and the greatest of them, by axis.
    between: [[f32; 2]; 3],
    backward: [bool; 3],
    /// How far each is looked along; less than nothing where there is none.
    pub(in crate::accel) reach: [f32; RAYS],
}

/// Of numbers, and faster than `f32::min` and `f32::max`.
fn less(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

fn more(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The signs of `direction`.
pub(in crate::accel) fn octant(direction: DVec3) -> [bool; 3] {
    direction.cmplt(DVec3::ZERO).into()
}

impl FanRays {
    /// The rays with a bit in `of` from `origin` in the scaled frame up to the distances
    /// `reach`, by one over their directions, which have the signs `backward`; `None` too
    /// far from the scene.
    pub(in crate::accel) fn new(
        origin: DVec3,
        inverses: &[DVec3; RAYS],
        backward: [bool; 3],
        of: u32,
        reach: &[f64; RAYS],
    ) -> Option<Self> {
        if origin.abs().max_element() > FARTHEST {
            return None;
        }
        let mut fan = Self {
            origin: origin.as_vec3(),
            inverse: [[1.0; RAYS]; 3],
            between: [[f32::INFINITY, f32::NEG_INFINITY]; 3],
            backward,
            reach: [-1.0; RAYS],
        };
        for ray in (0..RAYS).filter(|ray| of & (1 << ray) != 0) {
            for axis in 0..3 {
                // As a single ray's; −0 is not below 0.
                let x = (inverses[ray][axis].abs() as f32).min(1e18);
                let x = if backward[axis] { -x } else { x };
                let [least, most] = &mut fan.between[axis];
                (*least, *most) = (less(*least, x), more(*most, x));
                fan.inverse[axis][ray] = x;
            }
            fan.reach[ray] = (reach[ray] as f32).next_up();
        }
        Some(fan)
    }

    fn farthest(&self) -> f32 {
        self.reach.iter().copied().fold(-1.0, more)
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
        let mut farthest = fan.farthest();
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
                farthest = fan.farthest();
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
        let mut near = f32x16::splat(simd, 0.0);
        let mut far = f32x16::load_array_ref(simd, &fan.reach);
        for axis in 0..3 {
            let planes = &self.planes[axis];
            let backward = usize::from(fan.backward[axis]);
            let inverse = f32x16::load_array_ref(simd, &fan.inverse[axis]);
            let first = planes[backward][lane] - fan.origin[axis];
            let last = planes[1 - backward][lane] - fan.origin[axis];
            near = near.max(inverse * f32x16::splat(simd, first));
            far = far.min(inverse * f32x16::splat(simd, last));
        }
        near.simd_le(far).to_bitmask() as u32
    }
}
