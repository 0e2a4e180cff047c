//! What is kept of an analysis: nodes by depth, and the coefficients that stand above a
//! threshold.

use super::super::block::SINGLE;
use super::Sparse;
use crate::grid::Rgb;
use crate::{CHILDREN, Cell, Levels, Tree, children};

/// The analysis of the directions of one cell at all positions, pruned.
pub(super) struct Branch {
    /// Nodes per depth, from the whole tree's root on.
    pub(super) depths: Vec<Kept>,
    /// The top's smoothing coefficients, u fastest; `None` if all is dark.
    pub(super) smooth: Option<Vec<[f64; 3]>>,
    /// Which positions of the top have a node.
    pub(super) alive: Vec<bool>,
    /// Sums of squared means: errors of quadrature, and of what was let go.
    pub(super) error: f64,
    pub(super) energy: f64,
    pub(super) lost: f64,
}

/// Nodes of one depth, and their coefficients one node after the other.
#[derive(Default)]
pub(super) struct Kept {
    nodes: Vec<KeptNode>,
    coefficients: Vec<Rgb>,
}

/// A node: its path from the root, four bits a depth, its masks, its coefficients.
struct KeptNode {
    path: u64,
    child_mask: u16,
    nu_mask: u16,
    first: u32,
}

/// All positions of one direction cell at some depth, before pruning.
pub(super) struct Sheet {
    pub(super) depth: u8,
    pub(super) m: [u16; 2],
    /// Coefficients ν = 1 … 15 per position.
    pub(super) wavelets: Vec<[Rgb; CHILDREN - 1]>,
    /// The sheets of its direction's children, by number; the same one four times
    /// over if directions are not split.
    pub(super) children: [Option<usize>; 4],
}

impl Branch {
    pub(super) fn dark(levels: Levels) -> Self {
        let depths = (0..levels.depth()).map(|_| Kept::default()).collect();
        Self { depths, smooth: None, alive: Vec::new(), error: 0.0, energy: 0.0, lost: 0.0 }
    }

    /// Keeps of `sheets` (children first) what stands above what `budget` lets go.
    pub(super) fn keep(&mut self, levels: Levels, sheets: &mut [Sheet], budget: f64) {
        let threshold = Threshold::of(sheets.iter().map(|s| s.wavelets.as_slice()), budget);
        let mut alive: Vec<Vec<bool>> = Vec::with_capacity(sheets.len());
        for sheet in &*sheets {
            let below = sheet.children.map(|c| c.map_or(&[][..], |c| alive[c].as_slice()));
            let own = self.take(levels, sheet, &threshold, below);
            alive.push(own);
        }
        self.alive = alive.pop().unwrap_or_default();
    }

    /// Appends the nodes of a sheet; returns which positions have one. `below` are the
    /// same for the children of its direction.
    pub(super) fn take(
        &mut self,
        levels: Levels,
        sheet: &Sheet,
        threshold: &Threshold,
        below: [&[bool]; 4],
    ) -> Vec<bool> {
        let depth = sheet.depth;
        let split = levels.split(depth);
        let level = depth.min(levels.position);
        let scale = levels.scale(levels.depth()).powi(2);
        let kept = &mut self.depths[usize::from(depth)];
        let mut alive = vec![false; sheet.wavelets.len()];
        for (position, wavelets) in sheet.wavelets.iter().enumerate() {
            let first = kept.coefficients.len() as u32;
            let mut nu_mask = 0_u16;
            for (nu, b) in (1..).zip(wavelets) {
                if *b == [0.0; 3] {
                    continue;
                }
                if threshold.keeps(b) {
                    nu_mask |= 1 << nu;
                    kept.coefficients.push(*b);
                } else {
                    self.lost += square(b) * scale;
                }
            }
            let child_mask = children(split)
                .filter(|&m| below[m >> 2].get(child(position, level, m, split)) == Some(&true))
                .fold(0_u16, |mask, m| mask | 1 << m);
            if nu_mask == 0 && child_mask == 0 {
                continue;
            }
            alive[position] = true;
            let (u, v) = (position & ((1 << level) - 1), position >> level);
            let cell = Cell { depth, m: [u as u16, v as u16, sheet.m[0], sheet.m[1]] };
            kept.nodes.push(KeptNode { path: path(levels, cell), child_mask, nu_mask, first });
        }
        alive
    }

    /// The tree, breadth first.
    pub(super) fn finish(self, levels: Levels) -> Sparse {
        let root = self.smooth.as_ref().map_or([0.0; 3], |smooth| smooth[0]);
        let root = root.map(|x| x as f32);
        let mut masks = Vec::with_capacity(self.depths.iter().map(|d| d.nodes.len()).sum());
        let mut coefficients =
            Vec::with_capacity(self.depths.iter().map(|d| d.coefficients.len()).sum());
        for Kept { mut nodes, coefficients: own } in self.depths {
            nodes.sort_unstable_by_key(|node| node.path);
            for node in nodes {
                masks.push((node.child_mask, node.nu_mask));
                let first = node.first as usize;
                coefficients.extend(&own[first..first + node.nu_mask.count_ones() as usize]);
            }
        }
        let relative = |squares: f64| {
            if self.energy > 0.0 { (squares / self.energy).sqrt() } else { 0.0 }
        };
        let rounding = if self.energy > 0.0 { SINGLE } else { 0.0 };
        let relative_error = relative(self.error) + relative(self.lost) + rounding;
        let tree = Tree::from_parts(levels, root, &masks, coefficients)
            .unwrap_or_else(|reason| panic!("nodes in order of their paths: {reason}"));
        Sparse { tree, relative_error }
    }
}

impl Kept {
    pub(super) fn append(&mut self, other: &mut Self) {
        if self.nodes.is_empty() {
            std::mem::swap(self, other);
            return;
        }
        let shift = self.coefficients.len() as u32;
        self.coefficients.append(&mut other.coefficients);
        self.nodes.extend(other.nodes.drain(..).map(|n| KeptNode { first: n.first + shift, ..n }));
    }
}

/// Which coefficients are let go: those of the least energies, as many as a budget
/// allows, by a histogram.
pub(super) struct Threshold {
    /// Leading bits of the least energy that is kept.
    bits: u32,
}

impl Threshold {
    /// Leading bits of an energy that count: 8 of exponent, 7 of mantissa.
    const SHIFT: u32 = 16;

    pub(super) fn of<'a>(
        sheets: impl Iterator<Item = &'a [[Rgb; CHILDREN - 1]]>,
        budget: f64,
    ) -> Self {
        let mut sums = vec![0.0; 1 << (31 - Self::SHIFT)];
        for b in sheets.flatten().flatten() {
            sums[Self::bin(b) as usize] += square(b);
        }
        let mut lost = 0.0;
        let full = sums.iter().position(|sum| {
            lost += sum;
            lost > budget
        });
        Self { bits: full.unwrap_or(sums.len()) as u32 }
    }

    fn bin(b: &Rgb) -> u32 {
        (square(b) as f32).to_bits() >> Self::SHIFT
    }

    fn keeps(&self, b: &Rgb) -> bool {
        Self::bin(b) >= self.bits
    }
}

/// Index, among the positions one depth down, of the child m′ of a position cell of
/// `level`.
pub(super) fn child(position: usize, level: u8, m: usize, split: usize) -> usize {
    if split & 0b0011 == 0 {
        return position;
    }
    let (u, v) = (position & ((1 << level) - 1), position >> level);
    (2 * v + (m >> 1 & 1)) << (level + 1) | (2 * u + (m & 1))
}

/// The numbers m′ of a cell and its ancestors, four bits a depth: in its order nodes
/// of one depth lie breadth first.
fn path(levels: Levels, cell: Cell) -> u64 {
    (0..cell.depth).fold(0, |path, depth| {
        let m = (0..4).filter(|d| levels.split(depth) >> d & 1 == 1).fold(0, |m, d| {
            let level = if d < 2 { levels.position } else { levels.direction };
            let below = cell.depth.min(level) - depth - 1;
            m | u64::from(cell.m[d] >> below & 1) << d
        });
        path << 4 | m
    })
}

fn square(b: &Rgb) -> f64 {
    b.iter().map(|&x| f64::from(x) * f64::from(x)).sum()
}

pub(super) fn energy(wavelets: &[[Rgb; CHILDREN - 1]]) -> f64 {
    wavelets.iter().flatten().map(square).sum()
}
