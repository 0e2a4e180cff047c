//! The largest cells on which a tree is constant, found by descending.

use crate::grid::Rgb;
use crate::{Levels, Tree, children};

/// A tree's leaves: a mask of children and of leaves a node.
pub(super) struct Leaves {
    levels: Levels,
    /// Breadth first, as in the tree; none if it is constant.
    nodes: Vec<Branch>,
    /// Mean radiance, node by node in order of m′.
    means: Vec<Rgb>,
}

/// A node with each child either a node or a leaf.
#[derive(Clone, Copy)]
struct Branch {
    child_mask: u16,
    leaf_mask: u16,
    first_child: u32,
    first_leaf: u32,
}

/// A leaf and its depth in the tree.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) struct Leaf {
    pub(super) index: u32,
    pub(super) depth: u8,
}

impl Leaves {
    pub(super) fn new(tree: &Tree) -> Self {
        let levels = tree.levels();
        let mut smooth = vec![[0.0; 3]; tree.nodes().len().max(1)];
        smooth[0] = tree.root().map(f64::from);
        let mut nodes = Vec::with_capacity(tree.nodes().len());
        let mut means = Vec::new();
        if tree.nodes().is_empty() {
            means.push(tree.root());
        }
        // Where the current depth ends: children follow their parents' depth.
        let (mut depth, mut end, mut next) = (0, 1, 1);
        for (i, node) in tree.nodes().iter().enumerate() {
            if i == end {
                (depth, end) = (depth + 1, next);
            }
            next += node.child_mask.count_ones() as usize;
            let split = levels.split(depth);
            let values = tree.push_node(i, smooth[i], split);
            let scale = levels.scale(depth + 1);
            let first_leaf = u32::try_from(means.len()).expect("fewer than 2³² leaves");
            let mut leaf_mask = 0;
            for m_prime in children(split) {
                match node.child(m_prime) {
                    Some(child) => smooth[child] = values[m_prime],
                    None => {
                        leaf_mask |= 1 << m_prime;
                        means.push(values[m_prime].map(|x| (x * scale) as f32));
                    }
                }
            }
            let (child_mask, first_child) = (node.child_mask, node.first_child);
            nodes.push(Branch { child_mask, leaf_mask, first_child, first_leaf });
        }
        Self { levels, nodes, means }
    }

    pub(super) fn levels(&self) -> Levels {
        self.levels
    }

    pub(super) fn mean(&self, leaf: Leaf) -> Rgb {
        self.means[leaf.index as usize]
    }

    /// The leaf that holds the finest cell **m**.
    pub(super) fn leaf(&self, m: [u32; 4]) -> Leaf {
        if self.nodes.is_empty() {
            return Leaf { index: 0, depth: 0 };
        }
        let (mut node, mut depth) = (0, 0);
        loop {
            let Branch { child_mask, leaf_mask, first_child, first_leaf } = self.nodes[node];
            let m_prime = self.half(m, depth);
            let before = |mask: u16| (mask & ((1 << m_prime) - 1)).count_ones();
            depth += 1;
            if child_mask >> m_prime & 1 == 0 {
                return Leaf { index: first_leaf + before(leaf_mask), depth };
            }
            node = (first_child + before(child_mask)) as usize;
        }
    }

    /// Which child to take at `depth` towards the finest cell **m**.
    fn half(&self, m: [u32; 4], depth: u8) -> usize {
        (0..4).fold(0, |half, d| {
            let level = self.level(d);
            match level.checked_sub(depth + 1) {
                Some(below) => half | ((m[d] >> below & 1) as usize) << d,
                None => half,
            }
        })
    }

    /// Dimension `d`'s level.
    pub(super) fn level(&self, d: usize) -> u8 {
        if d < 2 { self.levels.position } else { self.levels.direction }
    }

    /// The finest offsets from which and up to which a leaf that holds **m**
    /// reaches.
    pub(super) fn extent(&self, leaf: Leaf, m: [u32; 4]) -> ([u32; 4], [u32; 4]) {
        let below = |d: usize| self.level(d).saturating_sub(leaf.depth);
        let low = std::array::from_fn(|d| m[d] >> below(d) << below(d));
        (low, std::array::from_fn(|d| low[d] + (1 << below(d))))
    }
}
