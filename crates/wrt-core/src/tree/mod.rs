//! The wavelet coefficient tree (WCT) of a radiance (§7.2.2).

mod build;
mod codec;
mod compress;
mod difference;

pub use build::TreeBuilder;
pub use codec::Quantisation;
pub use compress::{Compression, Keep};
pub use difference::Difference;

use crate::grid::{Grid, Rgb};
use crate::{CHILDREN, Cell, Levels, children, push};

/// A radiance as Haar wavelet coefficients, immutable, in three grouped channels.
///
/// Nodes lie breadth first and each node's children together in order of m′, so
/// masks alone give the whole structure: no hash, no pointers (the paper hashes
/// nodes, §7.2.2.3, because it grows them in any order; [`TreeBuilder`] does
/// that here). A coefficient that is absent is 0; ν = 0 exists only as `root`.
#[derive(Clone, Debug, PartialEq)]
pub struct Tree {
    levels: Levels,
    root: Rgb,
    nodes: Vec<Node>,
    coefficients: Vec<Rgb>,
    /// What it is stored as, if it has been quantised.
    code: Option<codec::Code>,
}

/// A node of a [`Tree`]: which children and which coefficients it has, and where.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Node {
    /// Bit m′: child m′ exists (`mskChild` of Fig. 7).
    pub child_mask: u16,
    /// Bit ν: coefficient b_ν exists (`mskNu`).
    pub nu_mask: u16,
    /// Index of the first child.
    pub first_child: u32,
    /// Index of the first coefficient; they follow by increasing ν.
    pub first_coefficient: u32,
}

impl Node {
    /// Index of child m′.
    #[must_use]
    pub fn child(&self, m_prime: usize) -> Option<usize> {
        rank(self.child_mask, m_prime).map(|r| self.first_child as usize + r)
    }

    /// Index of coefficient ν.
    #[must_use]
    pub fn coefficient(&self, nu: usize) -> Option<usize> {
        rank(self.nu_mask, nu).map(|r| self.first_coefficient as usize + r)
    }
}

/// How many bits below `bit` are set, if it is set itself.
fn rank(mask: u16, bit: usize) -> Option<usize> {
    (mask >> bit & 1 == 1).then(|| (mask & ((1 << bit) - 1)).count_ones() as usize)
}

impl Tree {
    /// A tree from its masks (breadth first) and coefficients, or what is wrong
    /// with them: an outside file promises nothing.
    ///
    /// # Errors
    ///
    /// A sentence, if a mask names a child or wavelet that its depth does not
    /// have, the counts do not fit the masks, a node holds nothing, or a
    /// coefficient is not finite.
    pub fn from_parts(
        levels: Levels,
        root: Rgb,
        masks: &[(u16, u16)],
        coefficients: Vec<Rgb>,
    ) -> Result<Self, String> {
        if levels.position > Levels::MAX || levels.direction > Levels::MAX {
            return Err(format!("levels above {}", Levels::MAX));
        }
        if let Some(bad) = coefficients.iter().position(|b| !b.iter().all(|x| x.is_finite())) {
            return Err(format!("coefficient {bad} is not finite"));
        }
        if !root.iter().all(|x| x.is_finite()) {
            return Err("the root coefficient is not finite".to_owned());
        }
        let mut nodes = Vec::with_capacity(masks.len());
        let (mut next_child, mut next_coefficient) = (1_usize, 0_usize);
        // Where the current depth ends: children follow their parents' level.
        let (mut depth, mut end) = (0, 1_usize);
        for (i, &(child_mask, nu_mask)) in masks.iter().enumerate() {
            if i == end {
                (depth, end) = (depth + 1, next_child);
            }
            let allowed = children(levels.split(depth)).fold(0_u16, |mask, m| mask | 1 << m);
            let parents = if depth + 1 < levels.depth() { allowed } else { 0 };
            if child_mask & !parents != 0 || nu_mask & !(allowed & !1) != 0 {
                return Err(format!(
                    "node {i} has masks {child_mask:#06x}, {nu_mask:#06x} that depth {depth} does not allow"
                ));
            }
            if child_mask == 0 && nu_mask == 0 {
                return Err(format!("node {i} is empty"));
            }
            nodes.push(Node {
                child_mask,
                nu_mask,
                first_child: next_child as u32,
                first_coefficient: next_coefficient as u32,
            });
            next_child += child_mask.count_ones() as usize;
            next_coefficient += nu_mask.count_ones() as usize;
            if next_child > masks.len() {
                return Err(format!(
                    "node {i} names a child past the last of {} nodes",
                    masks.len()
                ));
            }
        }
        if !masks.is_empty() && next_child != masks.len() {
            return Err(format!("{} nodes, but the masks reach {next_child}", masks.len()));
        }
        if next_coefficient != coefficients.len() {
            let found = coefficients.len();
            return Err(format!("{found} coefficients, but the masks name {next_coefficient}"));
        }
        Ok(Self { levels, root, nodes, coefficients, code: None })
    }

    /// L = 0.
    fn dark(levels: Levels) -> Self {
        Self { levels, root: [0.0; 3], nodes: Vec::new(), coefficients: Vec::new(), code: None }
    }

    /// Its levels.
    #[must_use]
    pub fn levels(&self) -> Levels {
        self.levels
    }

    /// The pure smoothing coefficient of the root: the mean over the hypercube.
    #[must_use]
    pub fn root(&self) -> Rgb {
        self.root
    }

    /// Its nodes, breadth first; none if the radiance is constant.
    #[must_use]
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// The cell of each node, in the nodes' order.
    #[must_use]
    pub fn cells(&self) -> Vec<Cell> {
        let mut cells = vec![Cell::ROOT; self.nodes.len()];
        for (i, node) in self.nodes.iter().enumerate() {
            let cell = cells[i];
            let split = self.levels.split(cell.depth);
            for m_prime in children(split) {
                if let Some(child) = node.child(m_prime) {
                    cells[child] = cell.child(split, m_prime);
                }
            }
        }
        cells
    }

    /// Its wavelet coefficients, node by node, by increasing ν.
    #[must_use]
    pub fn coefficients(&self) -> &[Rgb] {
        &self.coefficients
    }

    /// The scalars it stores per channel, the root's included.
    #[must_use]
    pub fn len(&self) -> usize {
        self.coefficients.len() + 1
    }

    /// Whether it stores no wavelet.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.coefficients.is_empty()
    }

    /// ‖L‖² over the unit hypercube, all channels together: the basis is
    /// orthonormal, so it is the sum of squares.
    #[must_use]
    pub fn norm_squared(&self) -> f64 {
        self.coefficients.iter().chain([&self.root]).map(energy).sum()
    }

    /// L at (u, v, κ, λ), each in [0, 1): the sum along one path (§4).
    #[must_use]
    pub fn eval(&self, q: [f64; 4]) -> [f64; 3] {
        let mut smooth = self.root.map(f64::from);
        let mut cell = Cell::ROOT;
        let mut at = (!self.nodes.is_empty()).then_some(0);
        while let Some(i) = at {
            let split = self.levels.split(cell.depth);
            let m_prime = self.half(cell, q);
            let values = self.push_node(i, smooth, split);
            smooth = values[m_prime];
            at = self.nodes[i].child(m_prime);
            cell = cell.child(split, m_prime);
        }
        smooth.map(|x| x * self.levels.scale(cell.depth))
    }

    /// The children's pure smoothing coefficients of node `i`, whose own is
    /// `smooth` (`wn_push`, §7.2.4.3).
    #[must_use]
    pub fn push_node(&self, i: usize, smooth: [f64; 3], split: usize) -> [[f64; 3]; CHILDREN] {
        let node = self.nodes[i];
        let mut out = [[0.0; 3]; CHILDREN];
        let mut b = [0.0; CHILDREN];
        for channel in 0..3 {
            b.fill(0.0);
            b[0] = smooth[channel];
            let stored = children(split).filter(|nu| node.nu_mask >> nu & 1 == 1);
            for (nu, at) in stored.zip(node.first_coefficient as usize..) {
                b[nu] = f64::from(self.coefficients[at][channel]);
            }
            push(&mut b, split);
            for (out, b) in out.iter_mut().zip(b) {
                out[channel] = b;
            }
        }
        out
    }

    /// All means over the finest cells.
    #[must_use]
    pub fn to_grid(&self) -> Grid {
        let mut images = vec![None; self.levels.directions()];
        self.visit_leaves(&mut |low, size, mean| {
            if mean == [0.0; 3] {
                return;
            }
            let rgb = mean.map(|x| x as f32);
            for l in low[3]..low[3] + size[1] {
                for k in low[2]..low[2] + size[1] {
                    let image = images[l << self.levels.direction | k]
                        .get_or_insert_with(|| vec![[0.0; 3]; self.levels.positions()]);
                    for v in low[1]..low[1] + size[0] {
                        let row = v << self.levels.position;
                        image[row | low[0]..row + low[0] + size[0]].fill(rgb);
                    }
                }
            }
        });
        Grid::from_images(self.levels, images)
    }

    /// Calls `leaf(low, size, mean)` for every largest cell on which L is
    /// constant: its finest offsets **m** from `low`, `size` = its side in finest
    /// position and direction cells.
    pub fn visit_leaves(&self, leaf: &mut impl FnMut([usize; 4], [usize; 2], [f64; 3])) {
        let at = (!self.nodes.is_empty()).then_some(0);
        self.visit(at, Cell::ROOT, self.root.map(f64::from), leaf);
    }

    fn visit(
        &self,
        at: Option<usize>,
        cell: Cell,
        smooth: [f64; 3],
        leaf: &mut impl FnMut([usize; 4], [usize; 2], [f64; 3]),
    ) {
        let Some(i) = at else {
            let shift = |level: u8| usize::from(level - level.min(cell.depth));
            let (p, d) = (shift(self.levels.position), shift(self.levels.direction));
            let m = cell.m.map(usize::from);
            let low = [m[0] << p, m[1] << p, m[2] << d, m[3] << d];
            leaf(low, [1 << p, 1 << d], smooth.map(|x| x * self.levels.scale(cell.depth)));
            return;
        };
        let split = self.levels.split(cell.depth);
        let values = self.push_node(i, smooth, split);
        for m_prime in children(split) {
            self.visit(
                self.nodes[i].child(m_prime),
                cell.child(split, m_prime),
                values[m_prime],
                leaf,
            );
        }
    }

    /// Which child of `cell` holds `q`.
    fn half(&self, cell: Cell, q: [f64; 4]) -> usize {
        let split = self.levels.split(cell.depth);
        (0..4).filter(|d| split >> d & 1 == 1).fold(0, |m, d| {
            let cells = f64::from(2_u32 << u32::from(cell.depth));
            let at = (q[d] * cells).clamp(0.0, cells - 1.0) as usize;
            m | (at & 1) << d
        })
    }
}

/// Σ over channels of b².
fn energy(b: &Rgb) -> f64 {
    b.iter().map(|&x| f64::from(x) * f64::from(x)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A grid of unequal levels with some dark directions, from a seed.
    fn grid(levels: Levels, seed: u64) -> Grid {
        let mut state = seed | 1;
        let mut random = move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1 << 24) as f32
        };
        let images = (0..levels.directions())
            .map(|_| {
                (random() < 0.7)
                    .then(|| (0..levels.positions()).map(|_| [random(), random(), 0.0]).collect())
            })
            .collect();
        Grid::from_images(levels, images)
    }

    fn levels() -> impl Strategy<Value = Levels> {
        (0..3_u8, 0..3_u8).prop_map(|(position, direction)| Levels { position, direction })
    }

    proptest! {
        #[test]
        fn grid_to_tree_and_back_is_exact_to_single_precision(levels in levels(), seed: u64) {
            let grid = grid(levels, seed);
            let back = TreeBuilder::from_grid(&grid).finish().to_grid();
            let (p, d) = (1 << levels.position, 1 << levels.direction);
            for i in 0..levels.positions() * levels.directions() {
                let m = [i % p, i / p % p, i / (p * p) % d, i / (p * p * d)];
                for (a, b) in grid.mean(m).iter().zip(back.mean(m)) {
                    // Each level rounds each coefficient to 2⁻²⁴ of the range, once.
                    prop_assert!((a - b).abs() < 4.0 * f32::EPSILON, "{m:?}: {a} {b}");
                }
            }
        }

        #[test]
        fn eval_agrees_with_the_cells(levels in levels(), seed: u64, q: [u16; 4]) {
            let grid = grid(levels, seed);
            let tree = TreeBuilder::from_grid(&grid).finish();
            let q = q.map(|x| f64::from(x) / 65536.0);
            let side = [levels.position, levels.position, levels.direction, levels.direction];
            let m = std::array::from_fn(|i| (q[i] * f64::from(1 << side[i])) as usize);
            for (a, b) in grid.mean(m).iter().zip(tree.eval(q)) {
                prop_assert!((f64::from(*a) - b).abs() < 1e-6, "{m:?}");
            }
        }

        /// Parseval: the basis is orthonormal.
        #[test]
        fn energy_is_the_sum_of_squares(levels in levels(), seed: u64) {
            let grid = grid(levels, seed);
            let tree = TreeBuilder::from_grid(&grid).finish();
            let (a, b) = (grid.norm_squared(), tree.norm_squared());
            prop_assert!((a - b).abs() <= 1e-6 * a, "{a} {b}");
        }

        #[test]
        fn parts_rebuild_the_tree(levels in levels(), seed: u64) {
            let tree = TreeBuilder::from_grid(&grid(levels, seed)).finish();
            let masks: Vec<_> = tree.nodes().iter().map(|n| (n.child_mask, n.nu_mask)).collect();
            let again =
                Tree::from_parts(levels, tree.root(), &masks, tree.coefficients().to_vec());
            prop_assert_eq!(again.as_ref(), Ok(&tree));
        }

        #[test]
        fn any_masks_give_a_tree_or_an_error(
            levels in levels(), masks: Vec<(u16, u16)>, coefficients: Vec<[f32; 3]>,
        ) {
            let _ = Tree::from_parts(levels, [0.0; 3], &masks, coefficients);
        }
    }
}
