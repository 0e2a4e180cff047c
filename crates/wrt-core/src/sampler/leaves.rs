//! The largest cells on which a tree is constant, found by descending.

use crate::grid::Rgb;
use crate::{CHILDREN, Levels, Tree, children};

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

enum Child {
    Node(usize),
    Leaf(u32),
}

impl Branch {
    fn child(self, m_prime: usize) -> Child {
        let before = |mask: u16| (mask & ((1 << m_prime) - 1)).count_ones();
        if self.child_mask >> m_prime & 1 == 1 {
            Child::Node((self.first_child + before(self.child_mask)) as usize)
        } else {
            Child::Leaf(self.first_leaf + before(self.leaf_mask))
        }
    }
}

/// A leaf and its depth in the tree.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) struct Leaf {
    pub(super) index: u32,
    pub(super) depth: u8,
}

/// The leaves of a block's cells, u fastest, four of each dimension.
pub(super) struct Cells {
    /// By cell; [`NONE`](Self::NONE) past the end of a dimension.
    pub(super) of: [u32; 256],
}

impl Cells {
    pub(super) const NONE: u32 = u32::MAX;

    /// Sets the box of 2^`sides` cells from `cell` on.
    fn fill(&mut self, cell: usize, sides: [u32; 4], bits: u32, leaf: u32) {
        let range = |d: usize| (0..1_usize << sides[d]).map(move |i| i << (bits * d as u32));
        for l in range(3) {
            for k in range(2) {
                for v in range(1) {
                    let row = cell + l + k + v;
                    self.of[row..row + (1 << sides[0])].fill(leaf);
                }
            }
        }
    }
}

impl Default for Cells {
    fn default() -> Self {
        Self { of: [Self::NONE; 256] }
    }
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

    pub(super) fn mean(&self, leaf: u32) -> Rgb {
        self.means[leaf as usize]
    }

    /// The leaf that holds the finest cell **m**.
    pub(super) fn leaf(&self, m: [u32; 4]) -> Leaf {
        if self.nodes.is_empty() {
            return Leaf { index: 0, depth: 0 };
        }
        let (mut node, mut depth) = (0, 0);
        loop {
            let m_prime = self.half(m, depth);
            depth += 1;
            match self.nodes[node].child(m_prime) {
                Child::Node(child) => node = child,
                Child::Leaf(index) => return Leaf { index, depth },
            }
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

    /// Finds the leaves of the block of 2^`bits` (at most four) cells a dimension that
    /// starts at **m**, and whether all of it is one leaf.
    pub(super) fn cells(&self, m: [u32; 4], bits: u32, cells: &mut Cells) -> bool {
        let all = [0, 1, 2, 3].map(|d| bits.min(u32::from(self.level(d))));
        if self.nodes.is_empty() {
            cells.fill(0, all, bits, 0);
            return true;
        }
        let (mut node, mut depth) = (0, 0);
        while (0..4).all(|d| self.below(d, depth).is_none_or(|below| below >= bits)) {
            let m_prime = self.half(m, depth);
            match self.nodes[node].child(m_prime) {
                Child::Node(child) => node = child,
                Child::Leaf(leaf) => {
                    cells.fill(0, all, bits, leaf);
                    return true;
                }
            }
            depth += 1;
        }
        self.spread((node, depth), m, bits, 0, cells);
        false
    }

    /// Finds the leaves of the cells from `cell` on that a node has of a block.
    fn spread(
        &self,
        (node, depth): (usize, u8),
        m: [u32; 4],
        bits: u32,
        cell: usize,
        cells: &mut Cells,
    ) {
        let Branch { child_mask, leaf_mask, first_child, first_leaf } = self.nodes[node];
        let (mut child, mut leaf) = (first_child as usize, first_leaf);
        // By dimension that the node splits inside the block: its upper half's first cell.
        let mut upper = [None; 4];
        let mut rest = [0; 4];
        for d in 0..4 {
            let below = self.below(d, depth);
            upper[d] =
                below.filter(|below| *below < bits).map(|below| 1 << (bits * d as u32 + below));
            rest[d] = below.map_or(0, |below| below.min(bits));
        }
        let outside = (0..4).filter(|d| upper[*d].is_none()).fold(0, |mask, d| mask | 1 << d);
        let here = self.half(m, depth) & outside;
        for m_prime in 0..CHILDREN {
            let (is_child, is_leaf) =
                (child_mask >> m_prime & 1 == 1, leaf_mask >> m_prime & 1 == 1);
            if m_prime & outside == here {
                let at = |d: usize| upper[d].filter(|_| m_prime >> d & 1 == 1).unwrap_or(0);
                let cell = cell + at(0) + at(1) + at(2) + at(3);
                if is_child {
                    self.spread((child, depth + 1), m, bits, cell, cells);
                } else if is_leaf {
                    cells.fill(cell, rest, bits, leaf);
                }
            }
            child += usize::from(is_child);
            leaf += u32::from(is_leaf);
        }
    }

    /// How many levels of dimension `d` are below what a node at `depth` splits; `None`
    /// if it splits nothing of it.
    fn below(&self, d: usize, depth: u8) -> Option<u32> {
        self.level(d).checked_sub(depth + 1).map(u32::from)
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
