//! Rays that have nothing in common go through the hierarchy side by side.
//!
//! One ray alone waits: for a node's boxes to come from memory, for what they say of the
//! next, and for the processor to have guessed wrong where it goes on. Here all rays that are
//! at a node take a step, then all that are at a block. No step waits for the one before it,
//! and within one there is next to nothing to guess.

use super::{BLOCK, Node, SlabRay, WIDTH, Wide};
use fearless_simd::{mask32x8, prelude::*, u32x8};

/// Rays side by side.
pub(in crate::accel) const RAYS: usize = 32;

/// What is below the last child that is still to be visited. No child is the root.
const DONE: u32 = 0;

/// Children that a ray may have still to visit, a node's more than that for room.
const DEPTH: usize = 64;

/// What a ray has still to visit, about the nearest on top, and how far it is looked along.
#[derive(Clone, Copy, Debug)]
struct Walk {
    /// Where the ray enters the children, as the bits of a number that is not negative.
    near: [u32; DEPTH + WIDTH],
    children: [u32; DEPTH + WIDTH],
    len: usize,
    /// Not negative.
    reach: f32,
}

impl Walk {
    /// With [`DONE`] at the bottom, in everyone's reach.
    const NEW: Self =
        Self { near: [0; DEPTH + WIDTH], children: [DONE; DEPTH + WIDTH], len: 1, reach: 0.0 };

    /// The next within reach.
    #[inline(always)]
    fn pop(&mut self) -> u32 {
        let below = |len: usize| len.wrapping_sub(1) % DEPTH;
        let mut len = below(self.len);
        while f32::from_bits(self.near[len]) > self.reach {
            len = below(len);
        }
        self.len = len;
        self.children[len]
    }
}

/// Rays with what each is at.
#[derive(Clone, Copy, Debug)]
struct List {
    rays: [u8; RAYS],
    children: [u32; RAYS],
    len: usize,
}

impl List {
    const EMPTY: Self = Self { rays: [0; RAYS], children: [0; RAYS], len: 0 };

    /// Adds a ray, if it `belongs` here.
    #[inline(always)]
    fn put(&mut self, ray: usize, child: u32, belongs: bool) {
        // Written in any case, in place of a branch.
        let at = self.len % RAYS;
        (self.rays[at], self.children[at]) = (ray as u8, child);
        self.len += usize::from(belongs);
    }

    #[inline(always)]
    fn get(&self, at: usize) -> (usize, u32) {
        (usize::from(self.rays[at % RAYS]) % RAYS, self.children[at % RAYS])
    }
}

impl Wide {
    /// Calls `block` for each block whose box one of the `rays` with a bit in `of` meets
    /// within its reach, with the number of the ray; nearest boxes first, for the most part.
    /// It returns how far the ray is looked along from then on. Returns the bits of rays that
    /// it could not take to their end.
    #[inline(always)]
    pub(in crate::accel) fn traverse_each<S: Simd>(
        &self,
        simd: S,
        rays: &[SlabRay; RAYS],
        of: u32,
        mut block: impl FnMut(usize, u32) -> f32,
    ) -> u32 {
        let mut left = 0;
        if self.nodes.is_empty() {
            return left;
        }
        let mut walks = [Walk::NEW; RAYS];
        let mut nodes = List::EMPTY;
        for (ray, slabs) in rays.iter().enumerate() {
            walks[ray].reach = slabs.reach;
            nodes.put(ray, 0, of >> ray & 1 == 1);
        }
        // A list is read while another is written: in place, what is read would have to wait
        // for what was written just before, in case that it is the same.
        while nodes.len > 0 {
            let (mut next, mut blocks) = (List::EMPTY, List::EMPTY);
            for at in 0..nodes.len {
                let (ray, node) = nodes.get(at);
                let walk = &mut walks[ray];
                if walk.len > DEPTH - WIDTH {
                    left |= 1 << ray;
                    continue;
                }
                let nearest = self.nodes[node as usize].open(simd, &rays[ray], walk);
                let child = nearest.unwrap_or_else(|| walk.pop());
                next.put(ray, child, child & BLOCK == 0 && child != DONE);
                blocks.put(ray, child, child & BLOCK != 0);
            }
            while blocks.len > 0 {
                let mut more = List::EMPTY;
                for at in 0..blocks.len {
                    let (ray, child) = blocks.get(at);
                    let walk = &mut walks[ray];
                    walk.reach = block(ray, child & !BLOCK).max(0.0);
                    let child = walk.pop();
                    next.put(ray, child, child & BLOCK == 0 && child != DONE);
                    more.put(ray, child, child & BLOCK != 0);
                }
                blocks = more;
            }
            nodes = next;
        }
        left
    }
}

impl Node {
    /// The nearest child that the ray meets, if any; the others are added to what it has
    /// still to visit.
    #[inline(always)]
    fn open<S: Simd>(&self, simd: S, ray: &SlabRay, walk: &mut Walk) -> Option<u32> {
        let (near, met) = self.meets(simd, ray, walk.reach);
        let near: u32x8<S> = near.bitcast();
        // With its place in the last bits, the least of all says where it is.
        let places = u32x8::load_array(simd, [0, 1, 2, 3, 4, 5, 6, 7]);
        let placed = near & u32x8::splat(simd, !7) | places;
        let nearest = met.select(placed, u32x8::splat(simd, u32::MAX)).reduce_min() % 8;
        let of = met.to_bitmask();
        let others = mask32x8::from_bitmask(simd, of & !(1 << nearest));
        let children = u32x8::load_array_ref(simd, &self.children);
        let at = walk.len % DEPTH;
        near.compress(others).store_slice(&mut walk.near[at..at + WIDTH]);
        children.compress(others).store_slice(&mut walk.children[at..at + WIDTH]);
        if of == 0 {
            return None;
        }
        walk.len = at + of.count_ones() as usize - 1;
        Some(self.children[nearest as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::{Level, dispatch};
    use glam::DVec3;

    /// Nodes in a chain with seven blocks each, all with the same box, which every ray meets.
    fn chain(nodes: u32) -> Wide {
        let box_of_all = [[[-1.0; WIDTH], [1.0; WIDTH]]; 3];
        let node = |i: u32| {
            let mut children = std::array::from_fn(|lane| BLOCK | (7 * i + lane as u32));
            children[7] = if i + 1 < nodes { i + 1 } else { BLOCK | (7 * nodes) };
            Node { planes: box_of_all, children }
        };
        Wide { nodes: (0..nodes).map(node).collect() }
    }

    /// How often each block was met by each ray with a bit in `of`, and which are left.
    fn met(wide: &Wide, blocks: usize, of: u32) -> (Vec<[u32; RAYS]>, u32) {
        let ray = SlabRay::new(DVec3::new(0.1, 0.2, -2.0), DVec3::new(1e9, 1e9, 1.0), 4.0);
        let mut met = vec![[0; RAYS]; blocks];
        let left = dispatch!(Level::new(), simd => wide.traverse_each(
            simd,
            &[ray; RAYS],
            of,
            #[inline(always)]
            |ray, block| {
                met[block as usize][ray] += 1;
                4.0
            },
        ));
        (met, left)
    }

    #[test]
    fn every_ray_meets_every_block_once() {
        for of in [0, 1, 0x8000_0000, 0x0110_0400, u32::MAX] {
            let (met, left) = met(&chain(5), 36, of);
            assert_eq!(left, 0);
            let expected = std::array::from_fn(|ray| of >> ray & 1);
            assert!(met.iter().all(|by_ray| *by_ray == expected), "{of:x}: {met:?}");
        }
    }

    #[test]
    fn rays_with_more_to_visit_than_there_is_room_for_are_told() {
        // Of a node's children one is met at once, the last, a node, next, and six are left;
        // one is there to begin with.
        let most = (DEPTH - WIDTH - 1) as u32 / 6 + 1;
        let of = 0x0110_0400;
        for nodes in [most - 1, most, most + 1, 3 * most] {
            let (_, left) = met(&chain(nodes), 7 * nodes as usize + 1, of);
            assert!(left == 0 || left == of, "{left:x}");
            assert_eq!(left == of, nodes > most, "{nodes} nodes");
        }
    }
}
