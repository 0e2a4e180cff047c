//! Where a radiance is not zero, and how finely it is resolved there.

use super::model::Model;
use super::range::Coder;
use crate::{CHILDREN, Cell, Levels, children};

/// A node of the coded tree, and what its children are: dark, lit and constant, or
/// nodes.
///
/// Lit cells are numbered breadth first as nodes are: 0 is the root, and the lit
/// children of each node follow each other.
#[derive(Clone, Copy, Debug)]
pub(super) struct Branch {
    pub(super) cell: Cell,
    /// Number of its own cell.
    pub(super) own: u32,
    /// Bit m′: child m′ is not dark.
    pub(super) lit: u16,
    /// Bit m′: child m′ is a node; it is lit then.
    pub(super) nodes: u16,
    /// Number of the first lit child.
    pub(super) first: u32,
    /// Index of the first node among the children.
    pub(super) first_node: u32,
    /// Numbers of the cells below and above along u, v, κ, λ, of its own depth or
    /// coarser; [`NONE`] where that is dark or outside.
    pub(super) beside: [u32; 8],
}

/// No cell, no node.
pub(super) const NONE: u32 = u32::MAX;

impl Branch {
    /// Number of child m′, if that is lit.
    pub(super) fn lit_child(&self, m_prime: usize) -> u32 {
        if self.lit >> m_prime & 1 == 1 { self.first + below(self.lit, m_prime) } else { NONE }
    }
}

/// How many bits below `bit` are set.
fn below(mask: u16, bit: usize) -> u32 {
    (mask & ((1 << bit) - 1)).count_ones()
}

/// The volume of a cell at `depth`.
pub(super) fn volume(levels: Levels, depth: u8) -> f64 {
    levels.scale(depth).powi(2).recip()
}

/// Whether no direction of the cell lies inside the UDC.
pub(super) fn is_outside(levels: Levels, cell: Cell) -> bool {
    let level = cell.depth.min(levels.direction);
    misses_udc(level, [cell.m[2].into(), cell.m[3].into()])
}

/// Whether one of the finest cells within `cell` is outside.
pub(super) fn sticks_out(levels: Levels, cell: Cell) -> bool {
    let level = cell.depth.min(levels.direction);
    let below = levels.direction - level;
    // The one furthest from the middle.
    let outermost = |m: u16| {
        let m = i64::from(m);
        let is_low = 2 * m < 1 << level;
        if is_low { m << below } else { ((m + 1) << below) - 1 }
    };
    misses_udc(levels.direction, [outermost(cell.m[2]), outermost(cell.m[3])])
}

fn misses_udc(level: u8, [k, l]: [i64; 2]) -> bool {
    let side = 1_i64 << level;
    // Twice the distance from the middle to the nearest point, in cells.
    let nearest = |m: i64| {
        let low = 2 * m - side;
        if low >= 0 { low } else { (-low - 2).max(0) }
    };
    nearest(k).pow(2) + nearest(l).pow(2) >= side * side
}

/// All nodes, breadth first, children by increasing m′; none if the radiance is
/// constant.
pub(super) struct Shape {
    pub(super) levels: Levels,
    pub(super) nodes: Vec<Branch>,
    /// By lit cell: which node it is, or [`NONE`].
    pub(super) node_of: Vec<u32>,
    /// By node: the volume that is lit in it.
    pub(super) volumes: Vec<f64>,
}

/// What each node is coded with.
struct Models {
    lit: Model<4>,
    nodes: Model<3>,
}

impl Models {
    fn new() -> Self {
        Self {
            lit: Model::new([9 * 9 * 2, 81 * 16, 16 * 17 * 18, 27 * 17], 9),
            nodes: Model::new([9 * 17 * 16, 81 * 16, 17 * 18 * 17], 9),
        }
    }
}

impl Shape {
    /// Codes a tree's shape, or returns `None` once it has more than `most` nodes or a
    /// reader has run out.
    ///
    /// A writer has `masks`, `(lit, nodes)` by node, none for a constant. Where
    /// `within_udc`, nothing outside the UDC is lit, and so nodes go down to the
    /// finest cells at its rim.
    pub(super) fn code(
        coder: &mut impl Coder,
        levels: Levels,
        within_udc: bool,
        masks: &[(u16, u16)],
        most: usize,
    ) -> Option<Self> {
        let mut shape =
            Self { levels, nodes: Vec::new(), node_of: vec![NONE], volumes: Vec::new() };
        let mut models = Models::new();
        if levels.depth() > 0 && coder.even_bits(1, (!masks.is_empty()).into()) == 1 {
            shape.node_of[0] = 0;
            shape.push(Cell::ROOT, 0);
        }
        let mut start = 0;
        while start < shape.nodes.len() {
            let end = shape.nodes.len();
            for i in start..end {
                let mask = masks.get(i).copied().unwrap_or_default();
                shape.code_node(coder, &mut models, i, within_udc, mask);
                if shape.nodes.len() > most || coder.has_run_out() {
                    return None;
                }
            }
            shape.link(start..end);
            start = end;
        }
        shape.measure();
        Some(shape)
    }

    fn push(&mut self, cell: Cell, own: u32) {
        let beside = [NONE; 8];
        self.nodes.push(Branch { cell, own, lit: 0, nodes: 0, first: 0, first_node: 0, beside });
    }

    /// Codes node `i`'s masks and appends its children.
    fn code_node(
        &mut self,
        coder: &mut impl Coder,
        models: &mut Models,
        i: usize,
        within_udc: bool,
        (lit, nodes): (u16, u16),
    ) {
        let cell = self.nodes[i].cell;
        let split = self.levels.split(cell.depth);
        let may_split = cell.depth + 1 < self.levels.depth();
        let depth = usize::from(cell.depth);
        let inside: Vec<usize> = children(split)
            .filter(|&m| !(within_udc && is_outside(self.levels, cell.child(split, m))))
            .collect();
        let previous = if i > 0 { self.nodes[i - 1] } else { self.nodes[i] };
        let own = &mut (0_u16, 0_u16);
        for (k, &m) in inside.iter().enumerate() {
            let around = self.around(i, m, own.0, split);
            // Something is lit, or the node would be dark itself.
            let implied = k + 1 == inside.len() && own.0 == 0;
            let siblings = siblings(own.0, m);
            let bit = lit >> m & 1 == 1;
            let same = usize::from(previous.lit >> m & 1);
            let contexts = [
                (around.lit * 9 + around.dark) * 2 + same,
                siblings * 16 + m,
                (k * 17 + own.0.count_ones() as usize) * 18 + depth,
                around.pattern() * 17 + previous.lit.count_ones() as usize,
            ];
            if implied || models.lit.code(coder, contexts, around.lit, bit) {
                own.0 |= 1 << m;
            }
        }
        for (k, m) in children(split).filter(|m| own.0 >> m & 1 == 1 && may_split).enumerate() {
            let around = self.around(i, m, own.0, split);
            let contexts = [
                (around.nodes * 17 + own.0.count_ones() as usize) * 16 + m,
                siblings_of(own.1, own.0, m) * 16 + m,
                (k * 18 + depth) * 17 + own.1.count_ones() as usize,
            ];
            // What is dark outside the UDC has to be told from what is lit.
            let implied = within_udc && sticks_out(self.levels, cell.child(split, m));
            let bit = nodes >> m & 1 == 1;
            if implied || models.nodes.code(coder, contexts, around.nodes, bit) {
                own.1 |= 1 << m;
            }
        }
        let first = self.node_of.len() as u32;
        let first_node = self.nodes.len() as u32;
        let branch = &mut self.nodes[i];
        (branch.lit, branch.nodes, branch.first, branch.first_node) =
            (own.0, own.1, first, first_node);
        for m in children(split).filter(|m| own.0 >> m & 1 == 1) {
            if own.1 >> m & 1 == 1 {
                self.node_of.push(self.nodes.len() as u32);
                self.push(cell.child(split, m), self.node_of.len() as u32 - 1);
            } else {
                self.node_of.push(NONE);
            }
        }
    }

    /// What is known of the cells beside child `m` of node `i` when it is coded.
    fn around(&self, i: usize, m: usize, lit: u16, split: usize) -> Around {
        let branch = &self.nodes[i];
        let mut around = Around::default();
        for d in 0..4 {
            let bit = 1 << d;
            let mut count = |is_lit: bool, is_node: bool| {
                around.lit += usize::from(is_lit);
                around.dark += usize::from(!is_lit);
                around.nodes += usize::from(is_node);
                around.by_dimension[d] += if is_lit { 1 } else { 0 };
            };
            for up in [0, 1] {
                let crosses = split & bit == 0 || (m >> d & 1) == up;
                if !crosses {
                    // The sibling: known if it has been coded.
                    if m & bit != 0 {
                        count(lit >> (m ^ bit) & 1 == 1, false);
                    }
                    continue;
                }
                let cell = branch.beside[2 * d + up];
                if cell == NONE {
                    count(false, false);
                    continue;
                }
                let node = self.node_of[cell as usize];
                if node == NONE {
                    count(true, false);
                } else if (node as usize) < i {
                    let other = if split & bit == 0 { m } else { m ^ bit };
                    let node = &self.nodes[node as usize];
                    count(node.lit >> other & 1 == 1, node.nodes >> other & 1 == 1);
                }
            }
        }
        around
    }

    /// Finds the cells beside the nodes below `parents`, all of which are known.
    fn link(&mut self, parents: std::ops::Range<usize>) {
        for i in parents {
            let branch = self.nodes[i];
            let split = self.levels.split(branch.cell.depth);
            let below = (0..CHILDREN).filter(|m| branch.nodes >> m & 1 == 1);
            for (node, m) in (branch.first_node as usize..).zip(below) {
                self.nodes[node].beside =
                    std::array::from_fn(|side| self.beside(&branch, m, side, split));
            }
        }
    }

    /// The cell on `side` of child `m` of `branch`.
    fn beside(&self, branch: &Branch, m: usize, side: usize, split: usize) -> u32 {
        let (bit, up) = (1 << (side / 2), side & 1);
        if split & bit != 0 && m >> (side / 2) & 1 != up {
            return branch.lit_child(m ^ bit);
        }
        let cell = branch.beside[side];
        if cell == NONE || self.node_of[cell as usize] == NONE {
            return cell;
        }
        let other = if split & bit == 0 { m } else { m ^ bit };
        self.nodes[self.node_of[cell as usize] as usize].lit_child(other)
    }

    /// Fills in the volumes.
    fn measure(&mut self) {
        self.volumes = vec![0.0; self.nodes.len()];
        for i in (0..self.nodes.len()).rev() {
            self.volumes[i] = self.lit_volumes(&self.nodes[i]).iter().sum();
        }
    }

    /// The volume that is lit in each child; children lie behind their parents.
    pub(super) fn lit_volumes(&self, branch: &Branch) -> [f64; CHILDREN] {
        let size = volume(self.levels, branch.cell.depth + 1);
        std::array::from_fn(|m| match branch.lit_child(m) {
            NONE => 0.0,
            cell => match self.node_of[cell as usize] {
                NONE => size,
                node => self.volumes[node as usize],
            },
        })
    }
}

#[derive(Default)]
struct Around {
    lit: usize,
    dark: usize,
    nodes: usize,
    /// How many of the two beside are known to be lit.
    by_dimension: [usize; 4],
}

impl Around {
    fn pattern(&self) -> usize {
        let [u, v, k, l] = self.by_dimension;
        (u + v).min(2) * 9 + k * 3 + l
    }
}

/// Of the siblings of child `m` in each dimension: not yet coded, dark or lit.
fn siblings(lit: u16, m: usize) -> usize {
    siblings_of(lit, u16::MAX, m)
}

/// Likewise of those in `among`, the others being not coded.
fn siblings_of(mask: u16, among: u16, m: usize) -> usize {
    (0..4).fold(0, |all, d| {
        let other = m ^ (1 << d);
        let state = if m >> d & 1 == 0 || among >> other & 1 == 0 {
            0
        } else {
            1 + usize::from(mask >> other & 1)
        };
        all * 3 + state
    })
}

#[cfg(test)]
mod tests {
    use super::super::range::{Decoder, Encoder};
    use super::*;
    use crate::grid::udc_fractions;

    #[test]
    fn cells_without_any_part_in_the_udc_are_outside() {
        for direction in 0..=6 {
            let levels = Levels { position: 2, direction };
            for depth in 0..=direction {
                let side = 1_usize << depth;
                for (i, fraction) in udc_fractions(depth).into_iter().enumerate() {
                    let m = [0, 0, (i % side) as u16, (i / side) as u16];
                    let outside = is_outside(levels, Cell { depth, m });
                    // Where the circle touches a corner, areas are of rounding's size.
                    assert_eq!(outside, fraction < 1e-12, "{m:?} at {depth}: {fraction}");
                    let below = direction - depth;
                    let finest = (0..1_u16 << (2 * below)).any(|j| {
                        let k = m[2] << below | j & ((1 << below) - 1);
                        let l = m[3] << below | j >> below;
                        is_outside(levels, Cell { depth: direction, m: [0, 0, k, l] })
                    });
                    let cell = Cell { depth, m };
                    assert_eq!(sticks_out(levels, cell), finest, "{m:?} at {depth}");
                }
            }
        }
    }

    /// A full node of whose children two are nodes, one of them with one lit child.
    #[test]
    fn a_shape_comes_back_with_its_neighbours() {
        let levels = Levels::isotropic(2);
        let masks = [(0xffff, 0b0000_0000_0000_0110), (0x0001, 0), (0xffff, 0)];
        let mut encoder = Encoder::new();
        let written = Shape::code(&mut encoder, levels, false, &masks, 3).expect("3 nodes");
        let bytes = encoder.finish();
        let mut decoder = Decoder::new(&bytes);
        let read = Shape::code(&mut decoder, levels, false, &[], 3).expect("3 nodes");
        assert!(decoder.is_at_end());
        for shape in [&written, &read] {
            let found: Vec<_> = shape.nodes.iter().map(|n| (n.lit, n.nodes)).collect();
            assert_eq!(found, masks);
            assert_eq!(shape.volumes, [15.0 / 16.0 + 1.0 / 256.0, 1.0 / 256.0, 1.0 / 16.0]);
            // Cell 0 is the root, 1 to 16 its children; node 1 is child 1 and node 2
            // is child 2, whose neighbours are children 0, 3, 6 and 10.
            assert_eq!(shape.nodes[2].beside, [NONE, 4, 1, NONE, NONE, 7, NONE, 11]);
        }
        assert!(Shape::code(&mut Decoder::new(&bytes), levels, false, &[], 2).is_none());
    }
}
