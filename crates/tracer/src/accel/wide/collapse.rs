//! Which nodes of a binary tree become children of one wide node: those with which a
//! ray costs least.
//!
//! After H. Ylitie, T. Karras and S. Laine, *Efficient Incoherent Ray Traversal on GPUs
//! Through Compressed Wide BVHs*, HPG 2017, §3.1: by dynamic programming over the
//! surface area heuristic. Opening the largest box first, as is usual, leaves nodes
//! little more than half full.

use super::WIDTH;
use obvhs::bvh2::Bvh2;

/// What testing a block costs, where testing a node costs 1.
const BLOCK_COST: f32 = 1.0;

/// How each binary node is best put below a wide one, by the number of places that it
/// may take there.
pub(super) struct Collapse<'a> {
    binary: &'a Bvh2,
    /// By binary node and places less one: how many of them go to the first child; 0 where
    /// one place fewer costs no more, and for a single place, which is a node's own. All
    /// places make up a wide node, and are always shared out.
    first: Vec<[u8; WIDTH]>,
}

impl<'a> Collapse<'a> {
    pub(super) fn new(binary: &'a Bvh2) -> Self {
        let nodes = &binary.nodes;
        // Parents before children: after reinsertion the binary tree has no order.
        let mut order = Vec::with_capacity(nodes.len());
        let mut open = vec![0];
        while let Some(node) = open.pop() {
            order.push(node as usize);
            let source = &nodes[node as usize];
            if !source.is_leaf() {
                open.extend([source.first_index, source.first_index + 1]);
            }
        }
        let mut first = vec![[0; WIDTH]; nodes.len()];
        // What a ray costs in the node's tree, times the area, by places less one.
        let mut costs = vec![[0.0_f32; WIDTH - 1]; nodes.len()];
        for node in order.into_iter().rev() {
            let source = &nodes[node];
            let area = source.aabb().half_area();
            if source.is_leaf() {
                costs[node] = [BLOCK_COST * area; WIDTH - 1];
                continue;
            }
            let children = source.first_index as usize;
            let (a, b) = (costs[children], costs[children + 1]);
            let shared = |places: usize| {
                let cost = |i: usize| (a[i - 1] + b[places - i - 1], i as u8);
                let least = |x: (f32, u8), y: (f32, u8)| if y.0 < x.0 { y } else { x };
                (2..places).map(cost).fold(cost(1), least)
            };
            let whole = shared(WIDTH);
            first[node][WIDTH - 1] = whole.1;
            let mut least = [area + whole.0; WIDTH - 1];
            for places in 2..WIDTH {
                let (cost, of_first) = shared(places);
                least[places - 1] = least[places - 2];
                if cost < least[places - 1] {
                    (least[places - 1], first[node][places - 1]) = (cost, of_first);
                }
            }
            costs[node] = least;
        }
        Self { binary, first }
    }

    /// The binary nodes to put below the wide one that stands for `node`.
    pub(super) fn children(&self, node: u32) -> Vec<u32> {
        let mut children = Vec::with_capacity(WIDTH);
        let mut open = vec![(node, WIDTH)];
        while let Some((node, mut places)) = open.pop() {
            let (source, first) = (&self.binary.nodes[node as usize], &self.first[node as usize]);
            while places > 1 && first[places - 1] == 0 {
                places -= 1;
            }
            if places == 1 {
                children.push(node);
                continue;
            }
            let of_first = usize::from(first[places - 1]);
            open.push((source.first_index + 1, places - of_first));
            open.push((source.first_index, of_first));
        }
        children
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3A;
    use obvhs::{BvhBuildParams, aabb::Aabb, bvh2::builder::build_bvh2};
    use std::time::Duration;

    /// By the children of each wide node, the surface area heuristic's cost, and the
    /// binary leaves.
    fn walk(binary: &Bvh2, children: impl Fn(u32) -> Vec<u32>) -> (f64, Vec<u32>) {
        let (mut cost, mut leaves, mut open) = (0.0, Vec::new(), vec![0]);
        while let Some(node) = open.pop() {
            let below = children(node);
            assert!((2..=WIDTH).contains(&below.len()), "{} children", below.len());
            cost += f64::from(binary.nodes[node as usize].aabb().half_area());
            for child in below {
                let source = &binary.nodes[child as usize];
                if source.is_leaf() {
                    cost += f64::from(BLOCK_COST * source.aabb().half_area());
                    leaves.push(child);
                } else {
                    open.push(child);
                }
            }
        }
        leaves.sort_unstable();
        (cost, leaves)
    }

    /// As is usual: the largest inner node is opened while there is room.
    fn largest_first(binary: &Bvh2, node: u32) -> Vec<u32> {
        let first = binary.nodes[node as usize].first_index;
        let mut children = vec![first, first + 1];
        let area = |child: u32| binary.nodes[child as usize].aabb().half_area();
        while children.len() < WIDTH {
            let inner = |&i: &usize| !binary.nodes[children[i] as usize].is_leaf();
            let larger = |&i: &usize, &j: &usize| area(children[i]).total_cmp(&area(children[j]));
            let Some(largest) = (0..children.len()).filter(inner).max_by(larger) else { break };
            let first = binary.nodes[children[largest] as usize].first_index;
            children[largest] = first;
            children.push(first + 1);
        }
        children
    }

    #[test]
    fn every_leaf_is_below_one_node_and_rays_cost_less() {
        let mut state = 1_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 40) as f32 / (1 << 24) as f32
        };
        for count in [5, 9, 40, 3000] {
            let mut at = || Vec3A::new(random(), random(), random());
            let boxes: Vec<Aabb> = std::iter::repeat_with(|| {
                let (low, side) = (at(), 0.05 * at());
                Aabb::new(low, low + side * side)
            })
            .take(count)
            .collect();
            let params = BvhBuildParams { max_prims_per_leaf: 4, ..BvhBuildParams::medium_build() };
            let binary = build_bvh2(&boxes, params, &mut Duration::default());
            let collapse = Collapse::new(&binary);
            let (cost, leaves) = walk(&binary, |node| collapse.children(node));
            let (usual, all) = walk(&binary, |node| largest_first(&binary, node));
            assert_eq!(leaves, all);
            assert!(cost <= usual * (1.0 + 1e-6), "{cost} {usual}");
            if count == 3000 {
                assert!(cost < 0.95 * usual, "{cost} {usual}");
            }
        }
    }
}
