//! Transport straight to a sparse tree, by blocks of directions: no dense grid of
//! the destination ever exists.

mod kept;

use super::TransportGeometry;
use super::block::SINGLE;
use super::handover::Handover;
use super::refine::{Order, Settling};
use super::slice::{Room, Slices, Way};
use super::source::Source;
use crate::grid::Rgb;
use crate::{CHILDREN, Levels, Result, Tree, children, pull};
use kept::{Branch, Sheet, Threshold, child, energy};
use rayon::prelude::*;

/// A tree of the radiance that arrives, and how far it is off.
#[derive(Clone, Debug)]
pub struct Sparse {
    /// Without the coefficients that the tolerance lets go.
    pub tree: Tree,
    /// Bound on the relative L² error: that of quadrature, estimated, plus that of
    /// the coefficients let go, which is exact, plus rounding's to single precision.
    pub relative_error: f64,
}

/// As [`transport_within`](super::transport_within), to a tree with a relative L²
/// error of at most `tolerance` that holds only what this needs.
///
/// Works through blocks of neighbouring direction cells; each is analysed, loses its
/// least coefficients and is gone. Memory: the coefficients kept, and for each thread
/// a block, 64 direction cells at all positions. Light too faint to matter anywhere
/// is let go everywhere, so that equal tolerances keep a few more coefficients than
/// [`Tree::compressed`], which sees all at once.
///
/// # Errors
///
/// As [`transport_block`](super::transport_block).
pub fn transport_sparse(
    geometry: &TransportGeometry,
    source: &impl Source,
    levels: Levels,
    tolerance: f64,
) -> Result<Sparse> {
    let slices = Slices::new(geometry, source, levels, Way::Fastest)?;
    let tolerance = (tolerance - SINGLE).max(0.25 * SINGLE);
    let (order, usual) = probe(&slices, levels);
    let forest = Forest {
        slices: &slices,
        handover: Handover::new(&slices),
        levels,
        quadrature: 0.4 * tolerance,
        letting_go: 0.6 * tolerance,
        order,
        usual,
    };
    // Blocks of 8 × 8 direction cells.
    let top = levels.direction.saturating_sub(3);
    let side = 1_u16 << top;
    let blocks: Vec<Branch> = (0..usize::from(side) * usize::from(side))
        .into_par_iter()
        .map_init(Room::default, |room, i| {
            let m = [(i % usize::from(side)) as u16, (i / usize::from(side)) as u16];
            forest.block(top, m, room)
        })
        .collect();
    Ok(forest.tree(top, blocks))
}

/// The order of the rules, and the mean energy of an image over all direction cells,
/// from some of them.
fn probe(slices: &Slices<'_, impl Source>, levels: Levels) -> (Order, f64) {
    const MOST: usize = 256;
    // An odd stride meets all rows and columns.
    let stride = (levels.directions() / MOST) | 1;
    let mut probed: Vec<Option<Settling>> = (0..levels.directions())
        .into_par_iter()
        .step_by(stride)
        .map_init(Room::default, |room, d| Settling::begin(slices, d, room))
        .collect();
    let energy: f64 = probed.iter().flatten().map(|cell| cell.energy).sum();
    (Order::measured(&mut probed, slices), energy / probed.len() as f64)
}

struct Forest<'a, 'b, S> {
    slices: &'a Slices<'b, S>,
    handover: Handover<'b, S>,
    levels: Levels,
    /// Relative errors allowed.
    quadrature: f64,
    letting_go: f64,
    order: Order,
    /// Mean energy of an image.
    usual: f64,
}

impl<S: Source> Forest<'_, '_, S> {
    /// The branch of a direction cell of level `top`.
    fn block(&self, top: u8, m: [u16; 2], room: &mut Room) -> Branch {
        let mut sheets = Vec::new();
        let mut branch = Branch::dark(self.levels);
        let found = self.descend(top, m, room, &mut sheets, &mut branch);
        // In coefficients, not means.
        let scale = self.levels.scale(self.levels.depth()).powi(-2);
        let budget = 0.5 * self.letting_go * self.letting_go * branch.energy * scale;
        branch.smooth = found.map(|(smooth, _)| smooth);
        branch.keep(self.levels, &mut sheets, budget);
        branch
    }

    /// Smoothing coefficients of a direction cell at `depth`, and its sheet.
    fn descend(
        &self,
        depth: u8,
        m: [u16; 2],
        room: &mut Room,
        sheets: &mut Vec<Sheet>,
        branch: &mut Branch,
    ) -> Option<(Vec<[f64; 3]>, Option<usize>)> {
        if depth == self.levels.depth() {
            let direction = usize::from(m[1]) << self.levels.direction | usize::from(m[0]);
            let mut cell = Settling::begin(self.slices, direction, room)?;
            let target = self.quadrature * (0.5 * (cell.energy + self.usual)).sqrt();
            cell.settle(self.slices, target, self.order, room);
            if cell.given_up() {
                cell.hand_over(&self.handover, direction, target, self.order);
            }
            branch.error += cell.error(self.order).powi(2);
            branch.energy += cell.energy;
            let scale = self.levels.scale(depth).recip();
            let mut image = cell.image?;
            image.as_flattened_mut().iter_mut().for_each(|x| *x *= scale);
            return Some((image, None));
        }
        let split = self.levels.split(depth);
        let mut parts: [Option<Vec<[f64; 3]>>; 4] = Default::default();
        let mut below = [None; 4];
        if split & 0b1100 == 0 {
            let (smooth, sheet) = self.descend(depth + 1, m, room, sheets, branch)?;
            (parts[0], below) = (Some(smooth), [sheet; 4]);
        } else {
            for i in 0..4 {
                let m = [2 * m[0] + (i as u16 & 1), 2 * m[1] + (i as u16 >> 1)];
                if let Some((smooth, sheet)) = self.descend(depth + 1, m, room, sheets, branch) {
                    (parts[i], below[i]) = (Some(smooth), sheet);
                }
            }
        }
        let (smooth, wavelets) = analysed(self.levels, depth, &parts)?;
        sheets.push(Sheet { depth, m, wavelets, children: below });
        Some((smooth, Some(sheets.len() - 1)))
    }

    /// The tree of all blocks, whose tops are the direction cells of level `top`.
    fn tree(&self, top: u8, mut blocks: Vec<Branch>) -> Sparse {
        for depth in (0..top).rev() {
            let side = 1_usize << depth;
            let mut merged = Vec::with_capacity(side * side);
            // Children of a block lie two rows apart.
            let mut take: Vec<Option<Branch>> = blocks.into_iter().map(Some).collect();
            for i in 0..side * side {
                let (k, l) = (i % side, i / side);
                let four = [0, 1, 2, 3].map(|c| {
                    let at = (2 * l + (c >> 1)) * 2 * side + 2 * k + (c & 1);
                    take[at].take().expect("each child has one parent")
                });
                merged.push(self.merge(depth, [k as u16, l as u16], four));
            }
            blocks = merged;
        }
        let root = blocks.pop().expect("one root");
        root.finish(self.levels)
    }

    /// The branch whose direction's children are these.
    fn merge(&self, depth: u8, m: [u16; 2], mut four: [Branch; 4]) -> Branch {
        let mut out = Branch::dark(self.levels);
        let parts = [0, 1, 2, 3].map(|i| four[i].smooth.take());
        for branch in &mut four {
            out.error += branch.error;
            out.energy += branch.energy;
            out.lost += branch.lost;
            for (all, kept) in out.depths.iter_mut().zip(&mut branch.depths) {
                all.append(kept);
            }
        }
        let Some((smooth, wavelets)) = analysed(self.levels, depth, &parts) else { return out };
        let budget = 0.5 * self.letting_go * self.letting_go * energy(&wavelets);
        let threshold = Threshold::of(std::iter::once(wavelets.as_slice()), budget);
        let alive = four.each_ref().map(|branch| branch.alive.as_slice());
        let sheet = Sheet { depth, m, wavelets, children: [None; 4] };
        out.alive = out.take(self.levels, &sheet, &threshold, alive);
        out.smooth = Some(smooth);
        out
    }
}

/// One step of analysis at `depth`: from the smoothing coefficients of the children
/// of a direction cell to its own, and its wavelets per position.
#[expect(clippy::type_complexity, reason = "two halves of one analysis")]
fn analysed(
    levels: Levels,
    depth: u8,
    parts: &[Option<Vec<[f64; 3]>>; 4],
) -> Option<(Vec<[f64; 3]>, Vec<[Rgb; CHILDREN - 1]>)> {
    if parts.iter().all(Option::is_none) {
        return None;
    }
    let split = levels.split(depth);
    let level = depth.min(levels.position);
    let positions = 1_usize << (2 * level);
    let (mut smooth, mut wavelets) = (Vec::with_capacity(positions), Vec::with_capacity(positions));
    for position in 0..positions {
        let mut nodes = [[0.0; CHILDREN]; 3];
        for m in children(split) {
            let Some(part) = &parts[m >> 2] else { continue };
            let value = part[child(position, level, m, split)];
            for (node, value) in nodes.iter_mut().zip(value) {
                node[m] = value;
            }
        }
        for node in &mut nodes {
            pull(node, split);
        }
        smooth.push([nodes[0][0], nodes[1][0], nodes[2][0]]);
        wavelets.push(std::array::from_fn(|i| nodes.map(|node| node[i + 1] as f32)));
    }
    Some((smooth, wavelets))
}

#[cfg(test)]
mod tests {
    use super::super::transport_within;
    use super::*;
    use crate::{Emission, Keep, Lobe, Polygon, TreeBuilder};
    use glam::DVec3;

    fn geometry() -> TransportGeometry {
        let rectangle = |o, u, v| Polygon::rectangle(o, u, v).expect("a rectangle");
        let window = rectangle(DVec3::new(0.1, 1.5, 0.3), DVec3::X, DVec3::Z);
        TransportGeometry::new(window, rectangle(DVec3::ZERO, DVec3::X, DVec3::Y))
    }

    fn window() -> Emission {
        let picture = (0..64_u8).map(|i| [f32::from(i % 5), f32::from(i % 3), f32::from(i / 16)]);
        Emission::new(3, picture.collect(), Lobe::Lambertian)
    }

    fn distance(a: &Tree, b: &Tree) -> f64 {
        let (a, b, levels) = (a.to_grid(), b.to_grid(), b.levels());
        let (p, d) = (1 << levels.position, 1 << levels.direction);
        let squares = (0..levels.positions() * levels.directions()).map(|i| {
            let m = [i % p, i / p % p, i / (p * p) % d, i / (p * p * d)];
            a.mean(m).iter().zip(b.mean(m)).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>()
        });
        (squares.sum::<f64>() / (levels.positions() * levels.directions()) as f64).sqrt()
    }

    /// At levels with position or direction finer, and with several blocks.
    #[test]
    fn a_sparse_tree_is_the_dense_one_within_its_error() {
        for (position, direction) in [(3, 3), (2, 4), (4, 2), (0, 4), (3, 0), (0, 0)] {
            let levels = Levels { position, direction };
            let dense = transport_within(&geometry(), &window(), levels, 1e-4)
                .expect("straight grid lines")
                .grid;
            let dense = TreeBuilder::from_grid(&dense).finish();
            let norm = dense.norm_squared().sqrt();
            let mut sizes = Vec::new();
            for tolerance in [1e-3, 3e-2] {
                let sparse = transport_sparse(&geometry(), &window(), levels, tolerance)
                    .expect("straight grid lines");
                let error = distance(&sparse.tree, &dense) / norm;
                assert!(
                    error <= sparse.relative_error + 1e-4 && sparse.relative_error <= tolerance,
                    "{levels:?}: {error} ± {}, {tolerance}",
                    sparse.relative_error
                );
                sizes.push(sparse.tree.len());
            }
            // What knows all coefficients at once keeps no fewer than two thirds.
            let best = dense.compressed(Keep::RelativeError(0.6 * 3e-2)).1.after;
            assert!(
                sizes[1] <= sizes[0] && 2 * sizes[1] <= 3 * best,
                "{levels:?}: {sizes:?}, {best}"
            );
        }
    }

    /// Where cells are handed over.
    #[test]
    fn a_tight_tolerance_is_met() {
        let levels = Levels { position: 1, direction: 2 };
        let dense = transport_within(&geometry(), &window(), levels, 1e-7);
        let dense = TreeBuilder::from_grid(&dense.expect("straight grid lines").grid).finish();
        let sparse = transport_sparse(&geometry(), &window(), levels, 1e-6);
        let sparse = sparse.expect("straight grid lines");
        let error = distance(&sparse.tree, &dense) / dense.norm_squared().sqrt();
        let bound = sparse.relative_error;
        assert!(error <= bound + 1e-7 && bound <= 1e-6, "{error} ± {bound}");
    }

    #[test]
    fn the_tree_is_the_same_from_any_number_of_threads() {
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let levels = Levels { position: 2, direction: 4 };
            pool.expect("a thread pool").install(|| {
                transport_sparse(&geometry(), &window(), levels, 1e-2)
                    .expect("straight grid lines")
                    .tree
            })
        };
        assert_eq!(run(1), run(3));
    }

    #[test]
    fn no_light_makes_no_tree() {
        let dark = Emission::new(0, vec![[0.0; 3]], Lobe::Lambertian);
        let sparse = transport_sparse(&geometry(), &dark, Levels::isotropic(3), 1e-3)
            .expect("straight grid lines");
        assert!(sparse.tree.is_empty() && sparse.relative_error == 0.0, "{sparse:?}");
    }
}
