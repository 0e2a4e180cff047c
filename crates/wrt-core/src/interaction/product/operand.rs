//! A factor of a product: a tree's means, and its integrals over incident direction.

use crate::{CHILDREN, Cell, Tree, children};

/// Of a node's children, per channel.
pub(super) type Means = [[f32; CHILDREN]; 3];

/// Which pair of dimensions an integral runs over.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Over {
    Position,
    Direction,
}

/// A tree with its children's means, and its integrals over S below each node.
pub(super) struct Operand<'a> {
    pub(super) tree: &'a Tree,
    pub(super) means: Vec<Means>,
    /// Per node, 4 ∬ dκ_s dλ_s of its function as means over the finest cells of
    /// the other pair of dimensions below it, first coordinate fastest.
    pub(super) integrals: Vec<Vec<[f32; 3]>>,
}

impl<'a> Operand<'a> {
    pub(super) fn new(tree: &'a Tree, over: Over) -> Self {
        let levels = tree.levels();
        let cells = tree.cells();
        let mut means = vec![[[0.0; CHILDREN]; 3]; cells.len()];
        let mut smooth = vec![[0.0; 3]; cells.len()];
        if let Some(first) = smooth.first_mut() {
            *first = tree.root().map(f64::from);
        }
        for (i, cell) in cells.iter().enumerate() {
            let split = levels.split(cell.depth);
            let pushed = tree.push_node(i, smooth[i], split);
            let scale = levels.scale(cell.depth + 1);
            for m in children(split) {
                for c in 0..3 {
                    means[i][c][m] = (pushed[m][c] * scale) as f32;
                }
                if let Some(child) = tree.nodes()[i].child(m) {
                    smooth[child] = pushed[m];
                }
            }
        }
        let integrals = integrals(tree, &cells, &means, over);
        Self { tree, means, integrals }
    }
}

/// Children lie behind their parents: one pass backwards.
fn integrals(tree: &Tree, cells: &[Cell], means: &[Means], over: Over) -> Vec<Vec<[f32; 3]>> {
    let levels = tree.levels();
    let (shift, kept, summed) = match over {
        Over::Direction => (0, levels.position, levels.direction),
        Over::Position => (2, levels.direction, levels.position),
    };
    let mut all: Vec<Vec<[f32; 3]>> = vec![Vec::new(); cells.len()];
    for i in (0..cells.len()).rev() {
        let depth = cells[i].depth;
        let below = kept.saturating_sub(depth);
        let side = 1_usize << below;
        let weight = measure(summed, depth + 1);
        let mut image = vec![[0.0; 3]; side * side];
        for m in children(levels.split(depth)) {
            let quarter = m >> shift & 3;
            let half = side / 2;
            // Where these dimensions split no more, the image is one cell.
            let (at, size) = if below == 0 {
                (0, 1)
            } else {
                ((quarter >> 1) * half * side + (quarter & 1) * half, half)
            };
            let constant: [f32; 3] = std::array::from_fn(|c| weight * means[i][c][m]);
            let child = tree.nodes()[i].child(m).map(|child| &all[child]);
            for row in 0..size {
                let target = &mut image[at + row * side..][..size];
                match child {
                    Some(child) => add(target, &child[row * size..][..size]),
                    None => target.iter_mut().for_each(|t| {
                        *t = std::array::from_fn(|c| t[c] + constant[c]);
                    }),
                }
            }
        }
        all[i] = image;
    }
    all
}

/// 4 |S| for a cell of `depth` where S stops at `level`.
pub(super) fn measure(level: u8, depth: u8) -> f32 {
    4.0 * 0.25_f32.powi(i32::from(depth.min(level)))
}

fn add(sum: &mut [[f32; 3]], terms: &[[f32; 3]]) {
    for (sum, term) in sum.iter_mut().zip(terms) {
        *sum = std::array::from_fn(|c| sum[c] + term[c]);
    }
}
