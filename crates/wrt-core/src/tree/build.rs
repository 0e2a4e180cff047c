//! Growing a coefficient tree in any order.

use super::{Node, Tree};
use crate::grid::Grid;
use crate::{CHILDREN, Cell, Levels, children, pull};

/// A tree that grows: nodes by index, coefficients accumulated in f64.
#[derive(Clone, Debug)]
pub struct TreeBuilder {
    levels: Levels,
    root: [f64; 3],
    nodes: Vec<Growing>,
}

#[derive(Clone, Debug)]
struct Growing {
    /// 0 where there is none: the root is nobody's child.
    children: [u32; CHILDREN],
    b: [[f64; 3]; CHILDREN],
}

impl Growing {
    const EMPTY: Self = Self { children: [0; CHILDREN], b: [[0.0; 3]; CHILDREN] };
}

impl TreeBuilder {
    /// The tree of L = 0.
    #[must_use]
    pub fn new(levels: Levels) -> Self {
        Self { levels, root: [0.0; 3], nodes: vec![Growing::EMPTY] }
    }

    /// The tree of a grid of means.
    #[must_use]
    pub fn from_grid(grid: &Grid) -> Self {
        let levels = grid.levels();
        let mut builder = Self { levels, root: [0.0; 3], nodes: Vec::new() };
        // Direction blocks with any light, from the finest level up, so that dark
        // blocks are never entered.
        let mut lit =
            vec![(0..levels.directions()).map(|d| grid.slice(d).is_some()).collect::<Vec<bool>>()];
        for level in (0..usize::from(levels.direction)).rev() {
            let fine = &lit[lit.len() - 1];
            let coarse = (0..1_usize << (2 * level))
                .map(|d| {
                    let (k, l) = (d & ((1 << level) - 1), d >> level);
                    (0..4).any(|i| fine[(2 * l + (i >> 1)) << (level + 1) | (2 * k + (i & 1))])
                })
                .collect();
            lit.push(coarse);
        }
        lit.reverse();
        let scale = levels.scale(levels.depth()).recip();
        builder.root = builder.gather(Cell::ROOT, &lit, &|cell: Cell| {
            grid.mean(cell.m.map(usize::from)).map(|x| f64::from(x) * scale)
        });
        builder
    }

    /// Adds `value` to the pure smoothing coefficient of the root.
    pub fn add_root(&mut self, value: [f64; 3]) {
        for (root, value) in self.root.iter_mut().zip(value) {
            *root += value;
        }
    }

    /// Adds the coefficients ν = 1 … 15 to the node of `cell`, which with its
    /// ancestors is made if it is missing.
    pub fn add_node(&mut self, cell: Cell, b: &[[f64; 3]; CHILDREN]) {
        let mut at = 0;
        for depth in 0..cell.depth {
            let split = self.levels.split(depth);
            let m_prime = (0..4).filter(|d| split >> d & 1 == 1).fold(0, |m, d| {
                let level = if d < 2 { self.levels.position } else { self.levels.direction };
                let below = cell.depth.min(level) - depth - 1;
                m | usize::from(cell.m[d] >> below & 1) << d
            });
            at = match self.nodes[at].children[m_prime] {
                0 => {
                    let new = self.nodes.len();
                    self.nodes[at].children[m_prime] = new as u32;
                    self.nodes.push(Growing::EMPTY);
                    new
                }
                child => child as usize,
            };
        }
        for (sum, b) in self.nodes[at].b.iter_mut().zip(b).skip(1) {
            for (sum, b) in sum.iter_mut().zip(b) {
                *sum += b;
            }
        }
    }

    /// The finished tree, with the coefficients that are zero left out.
    #[must_use]
    pub fn finish(&self) -> Tree {
        let mut tree = Tree::dark(self.levels);
        tree.root = self.root.map(|x| x as f32);
        if self.nodes.is_empty() {
            return tree;
        }
        let alive = self.alive();
        if !alive[0] {
            return tree;
        }
        // Breadth first: the queue is the node list itself.
        let mut queue = vec![0_usize];
        let mut next = 0;
        while next < queue.len() {
            let node = &self.nodes[queue[next]];
            let mut new = Node {
                child_mask: 0,
                nu_mask: 0,
                first_child: queue.len() as u32,
                first_coefficient: tree.coefficients.len() as u32,
            };
            for (m, &child) in node.children.iter().enumerate() {
                if child != 0 && alive[child as usize] {
                    new.child_mask |= 1 << m;
                    queue.push(child as usize);
                }
            }
            for (nu, b) in node.b.iter().enumerate().skip(1) {
                let b = b.map(|x| x as f32);
                if b != [0.0; 3] {
                    new.nu_mask |= 1 << nu;
                    tree.coefficients.push(b);
                }
            }
            tree.nodes.push(new);
            next += 1;
        }
        tree
    }

    /// Nodes that hold a coefficient or have a descendant that does. Children lie
    /// behind their parents.
    fn alive(&self) -> Vec<bool> {
        let mut alive = vec![false; self.nodes.len()];
        for (i, node) in self.nodes.iter().enumerate().rev() {
            alive[i] = node.b[1..].iter().any(|b| b.map(|x| x as f32) != [0.0; 3])
                || node.children.iter().any(|&c| c != 0 && alive[c as usize]);
        }
        alive
    }

    /// Builds the nodes below `cell` from the leaves' smoothing coefficients and
    /// returns the cell's own.
    fn gather(
        &mut self,
        cell: Cell,
        lit: &[Vec<bool>],
        leaf: &impl Fn(Cell) -> [f64; 3],
    ) -> [f64; 3] {
        let level = cell.depth.min(self.levels.direction);
        let block = usize::from(cell.m[3]) << level | usize::from(cell.m[2]);
        if !lit[usize::from(level)][block] {
            return [0.0; 3];
        }
        if cell.depth == self.levels.depth() {
            return leaf(cell);
        }
        let split = self.levels.split(cell.depth);
        let at = self.nodes.len();
        self.nodes.push(Growing::EMPTY);
        let mut b = [[0.0; CHILDREN]; 3];
        for m_prime in children(split) {
            let before = self.nodes.len();
            let value = self.gather(cell.child(split, m_prime), lit, leaf);
            if self.nodes.len() > before {
                self.nodes[at].children[m_prime] = before as u32;
            }
            for (b, value) in b.iter_mut().zip(value) {
                b[m_prime] = value;
            }
        }
        for b in &mut b {
            pull(b, split);
        }
        for (nu, rgb) in self.nodes[at].b.iter_mut().enumerate().skip(1) {
            *rgb = [b[0][nu], b[1][nu], b[2][nu]];
        }
        [b[0][0], b[1][0], b[2][0]]
    }
}
