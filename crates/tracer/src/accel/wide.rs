//! A hierarchy of boxes, eight to a node, each node tested at once.
//!
//! obvhs joins the boxes in pairs; its binary tree is flattened here. A node is 256 bytes with its children's
//! planes as they are. obvhs's own nodes of eight have 80, but its tests of them are
//! compiled for SSE2, and must take the triangles one at a time.

mod collapse;
pub(super) mod each;
pub(super) mod fan;

use super::LANES;
use collapse::Collapse;
use fearless_simd::{f32x8, mask32x8, prelude::*};
use glam::{DVec3, Vec3A};
use obvhs::{BvhBuildParams, aabb::Aabb, bvh2::builder::build_bvh2, ploc::PlocSearchDistance};
use std::time::Duration;

/// Children of a node.
const WIDTH: usize = 8;

/// Marks a child that is a block of triangles.
const BLOCK: u32 = 1 << 31;

/// Boxes of eight children, by plane; what is missing has a box at infinity, out of all
/// rays' reach.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
struct Node {
    /// By axis, low and high.
    planes: [[[f32; WIDTH]; 2]; 3],
    /// A node, or a block with [`BLOCK`] set.
    children: [u32; WIDTH],
}

impl Node {
    const EMPTY: Self = { Self { planes: [[[f32::INFINITY; WIDTH]; 2]; 3], children: [0; WIDTH] } };

    /// Where a ray up to the finite distance `reach` enters the boxes, and which of them it
    /// meets.
    #[inline(always)]
    fn meets<S: Simd>(&self, simd: S, ray: &SlabRay, reach: f32) -> (f32x8<S>, mask32x8<S>) {
        let splat = |x: f32| f32x8::splat(simd, x);
        let (inverse, offset) = (ray.inverse, ray.offset);
        let [x, y, z] = &self.planes;
        let [x0, x1] = slab(simd, x, inverse.x, offset.x);
        let [y0, y1] = slab(simd, y, inverse.y, offset.y);
        let [z0, z1] = slab(simd, z, inverse.z, offset.z);
        let near = x0.max(y0).max(z0.max(splat(0.0)));
        let far = x1.min(y1).min(z1.min(splat(reach)));
        (near, near.simd_le(far))
    }
}

/// Where a ray enters and leaves the slabs between planes. Which it meets first is not known
/// beforehand: to look that up would take longer.
#[inline(always)]
fn slab<S: Simd>(simd: S, planes: &[[f32; WIDTH]; 2], inverse: f32, offset: f32) -> [f32x8<S>; 2] {
    let (inverse, offset) = (f32x8::splat(simd, inverse), f32x8::splat(simd, offset));
    let low = f32x8::load_array_ref(simd, &planes[0]).mul_sub(inverse, offset);
    let high = f32x8::load_array_ref(simd, &planes[1]).mul_sub(inverse, offset);
    [low.min(high), low.max(high)]
}

/// The nodes; the first is the root. Empty for an empty scene.
#[derive(Debug, Default)]
pub(super) struct Wide {
    nodes: Vec<Node>,
}

/// What to do after a block.
pub(super) enum Next {
    /// Go on up to this distance.
    Within(f32),
    /// Enough.
    Stop,
}

/// A ray in single precision, ready for slabs.
#[derive(Clone, Copy, Debug)]
pub(super) struct SlabRay {
    inverse: Vec3A,
    /// Origin over direction.
    offset: Vec3A,
    reach: f32,
}

impl SlabRay {
    /// None at all.
    pub(super) const NONE: Self = Self { inverse: Vec3A::ZERO, offset: Vec3A::ZERO, reach: 0.0 };

    /// The part of a ray from `origin` up to the distance `reach`, by one over its
    /// direction.
    #[inline(always)]
    pub(super) fn new(origin: DVec3, inverse: DVec3, reach: f32) -> Self {
        // A component below 10⁻¹⁸ moves no point of the scaled scene by as much
        // as rounding does, and its inverse keeps all products finite.
        let inverse = inverse.clamp(DVec3::splat(-1e18), DVec3::splat(1e18));
        // Finite, for the boxes of missing children to stay at infinity.
        let offset = (origin * inverse).clamp(DVec3::splat(-1e37), DVec3::splat(1e37));
        Self { inverse: inverse.as_vec3a(), offset: offset.as_vec3a(), reach }
    }
}

impl Wide {
    /// Sorts `boxes` into a tree. Returns it with the boxes' numbers in the order
    /// of the blocks, [`LANES`] to each; a block may have fewer.
    pub(super) fn new(boxes: &[Aabb]) -> (Self, Vec<[Option<u32>; LANES]>) {
        let params = BvhBuildParams {
            max_prims_per_leaf: LANES as u32,
            ploc_search_distance: PlocSearchDistance::High,
            ..BvhBuildParams::medium_build()
        };
        let binary = build_bvh2(boxes, params, &mut Duration::default());
        let mut wide = Self::default();
        let mut blocks = Vec::new();
        if binary.nodes.is_empty() {
            return (wide, blocks);
        }
        wide.nodes.push(Node::EMPTY);
        // The root of a binary tree has no sibling, and may be a leaf.
        let mut open = vec![(0, 0)];
        let collapse = Collapse::new(&binary);
        while let Some((index, whole)) = open.pop() {
            for (lane, child) in collapse.children(whole).into_iter().enumerate() {
                let source = &binary.nodes[child as usize];
                let bounds = source.aabb();
                let code = if source.is_leaf() {
                    let first = source.first_index as usize;
                    let members = &binary.primitive_indices[first..][..source.prim_count as usize];
                    blocks.push(std::array::from_fn(|i| members.get(i).copied()));
                    BLOCK | (blocks.len() - 1) as u32
                } else {
                    wide.nodes.push(Node::EMPTY);
                    let node = wide.nodes.len() - 1;
                    open.push((node, child));
                    node as u32
                };
                let node = &mut wide.nodes[index];
                node.children[lane] = code;
                for axis in 0..3 {
                    node.planes[axis][0][lane] = bounds.min[axis];
                    node.planes[axis][1][lane] = bounds.max[axis];
                }
            }
        }
        (wide, blocks)
    }

    /// Calls `block` for each block whose box the ray meets within its reach,
    /// nearest boxes first.
    #[inline(always)]
    pub(super) fn traverse<S: Simd>(
        &self,
        simd: S,
        ray: &SlabRay,
        mut block: impl FnMut(u32) -> Next,
    ) {
        if self.nodes.is_empty() {
            return;
        }
        let mut reach = ray.reach;
        let mut stack = Stack::default();
        let mut current = 0_u32;
        loop {
            if current & BLOCK == 0 {
                let node = &self.nodes[current as usize];
                let (near, met) = node.meets(simd, ray, reach);
                let mut met = met.to_bitmask() as u32;
                if met != 0 {
                    let near: [f32; WIDTH] = near.into();
                    let mut take = || {
                        let lane = met.trailing_zeros() as usize % WIDTH;
                        met &= met - 1;
                        (key(near[lane], node.children[lane]), met != 0)
                    };
                    let (mut nearest, mut more) = take();
                    let bottom = stack.len;
                    while more {
                        let further;
                        (further, more) = take();
                        stack.insert(bottom, nearest.max(further));
                        nearest = nearest.min(further);
                    }
                    current = nearest as u32;
                    continue;
                }
            } else {
                match block(current & !BLOCK) {
                    Next::Within(distance) => reach = distance,
                    Next::Stop => return,
                }
            }
            loop {
                let Some(next) = stack.pop() else { return };
                if f32::from_bits((next >> 32) as u32) <= reach {
                    current = next as u32;
                    break;
                }
            }
        }
    }
}

/// A child and where the ray enters it, in the order of the distances: those are
/// not negative, and such numbers are ordered as their bits are.
#[inline(always)]
fn key(near: f32, child: u32) -> u64 {
    u64::from(near.to_bits()) << 32 | u64::from(child)
}

/// What is still to be visited, nearest on top.
#[derive(Debug)]
struct Stack {
    top: [u64; Self::INLINE],
    len: usize,
    /// What does not fit into `top`, in trees deeper than any met so far.
    spill: Vec<u64>,
}

impl Default for Stack {
    #[inline(always)]
    fn default() -> Self {
        Self { top: [0; Self::INLINE], len: 0, spill: Vec::new() }
    }
}

impl Stack {
    const INLINE: usize = 64;

    /// Pushes `key` under the smaller ones down to place `bottom`.
    #[inline(always)]
    fn insert(&mut self, bottom: usize, key: u64) {
        if self.len == Self::INLINE {
            // Out of order costs time and nothing else.
            self.spill.push(key);
            return;
        }
        let mut at = self.len;
        while at > bottom && self.top[at - 1] < key {
            self.top[at] = self.top[at - 1];
            at -= 1;
        }
        self.top[at] = key;
        self.len += 1;
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<u64> {
        if let Some(key) = self.spill.pop() {
            return Some(key);
        }
        self.len = self.len.checked_sub(1)?;
        Some(self.top[self.len])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stack_gives_the_nearest_first_and_loses_nothing_when_full() {
        let mut stack = Stack::default();
        for k in [5, 9, 2, 7] {
            stack.insert(0, k);
        }
        assert_eq!([(); 4].map(|()| stack.pop()), [2, 5, 7, 9].map(Some));
        assert_eq!(stack.pop(), None);
        let many = 3 * Stack::INLINE as u64;
        (0..many).for_each(|k| stack.insert(0, k));
        let mut all: Vec<_> = std::iter::from_fn(|| stack.pop()).collect();
        all.sort_unstable();
        assert_eq!(all, (0..many).collect::<Vec<_>>());
    }
}
