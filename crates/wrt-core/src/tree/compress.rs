//! L²-optimal thresholding of a tree (§7.2.2).

use super::{Node, Tree, energy};
use crate::Levels;

/// What to keep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Keep {
    /// As few coefficients as leave a relative L² error of at most this.
    RelativeError(f64),
    /// The largest coefficients, at most this many (the root's included).
    Count(usize),
}

/// What thresholding did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compression {
    /// Coefficients (each of three channels) before, zeros not counted.
    pub before: usize,
    /// Coefficients after.
    pub after: usize,
    /// ‖dropped‖ / ‖L‖: exact, by orthonormality.
    pub relative_error: f64,
}

impl Tree {
    /// The tree without its least coefficients, grouped by the three channels:
    /// for an orthonormal basis the largest ones are the best in L².
    ///
    /// Equal coefficients are dropped from the end, so the result depends on the
    /// tree alone.
    ///
    /// Beside bright cells the radiance that is left may be negative. The tree keeps
    /// that, and with it the flux, which is the root's; a renderer that takes 0 instead
    /// adds at most ε ‖L‖ over the mean of L to the flux, ε being the relative error.
    /// Light with one cell a hundred times as bright as the rest, reflected at n = 400,
    /// gains 3·10⁻⁵ at ε = 2·10⁻³ and 6·10⁻⁴ at 2·10⁻² (measured in
    /// `interaction/numerics.rs`).
    #[must_use]
    pub fn compressed(&self, keep: Keep) -> (Self, Compression) {
        let mut order: Vec<(f32, u32)> = self
            .coefficients
            .iter()
            .enumerate()
            .map(|(i, b)| (energy(b) as f32, i as u32))
            .collect();
        order.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let total = self.norm_squared();
        let exact = |i: u32| energy(&self.coefficients[i as usize]);
        let kept = match keep {
            Keep::Count(count) => count.saturating_sub(1).min(order.len()),
            Keep::RelativeError(error) => {
                let allowed = error * error * total;
                let mut dropped = 0.0;
                let fits = |&&(_, i): &&(f32, u32)| {
                    dropped += exact(i);
                    dropped <= allowed
                };
                order.len() - order.iter().rev().take_while(fits).count()
            }
        };
        // Smallest first, so that the sum does not lose them.
        let dropped: f64 = order[kept..].iter().rev().map(|&(_, i)| exact(i)).sum();
        let mut keeps = vec![false; self.coefficients.len()];
        for &(_, i) in &order[..kept] {
            keeps[i as usize] = true;
        }
        let compression = Compression {
            before: self.len(),
            after: kept + 1,
            // The sum of nothing is −0.
            relative_error: if total > 0.0 { (dropped.abs() / total).sqrt() } else { 0.0 },
        };
        (self.filtered(&keeps), compression)
    }

    /// The tree down to `depth` splits: its means over the cells there.
    #[must_use]
    pub fn truncated(&self, depth: u8) -> Self {
        let levels = Levels {
            position: self.levels.position.min(depth),
            direction: self.levels.direction.min(depth),
        };
        // Breadth first, what is kept comes first.
        let (mut start, mut end) = (0, usize::from(!self.nodes.is_empty() && depth > 0));
        for _ in 1..depth {
            let last = self.nodes[start..end].last();
            let next = last.map_or(end, |n| (n.first_child + n.child_mask.count_ones()) as usize);
            (start, end) = (end, next);
        }
        let mut nodes = self.nodes[..end].to_vec();
        for node in &mut nodes[start..] {
            node.child_mask = 0;
        }
        let kept = nodes.last().map_or(0, |n| n.first_coefficient + n.nu_mask.count_ones());
        let coefficients = self.coefficients[..kept as usize].to_vec();
        let every = vec![true; coefficients.len()];
        Self { levels, root: self.root, nodes, coefficients, code: None }.filtered(&every)
    }

    /// The tree with the coefficients that `keeps` marks.
    pub(super) fn filtered(&self, keeps: &[bool]) -> Self {
        let nu_mask = |node: &Node| {
            (1..16)
                .filter(|&nu| node.coefficient(nu).is_some_and(|c| keeps[c]))
                .fold(0_u16, |mask, nu| mask | 1 << nu)
        };
        // Children lie behind their parents, so one pass backwards suffices.
        let mut alive = vec![false; self.nodes.len()];
        for (i, node) in self.nodes.iter().enumerate().rev() {
            alive[i] = nu_mask(node) != 0
                || (0..16).any(|m| node.child(m).is_some_and(|child| alive[child]));
        }
        let mut out = Self { root: self.root, ..Self::dark(self.levels) };
        let mut next_child = 1;
        for (node, _) in self.nodes.iter().zip(&alive).filter(|(_, alive)| **alive) {
            let child_mask = (0..16)
                .filter(|&m| node.child(m).is_some_and(|child| alive[child]))
                .fold(0_u16, |mask, m| mask | 1 << m);
            let nu_mask = nu_mask(node);
            out.nodes.push(Node {
                child_mask,
                nu_mask,
                first_child: next_child,
                first_coefficient: out.coefficients.len() as u32,
            });
            next_child += child_mask.count_ones();
            let kept = (1..16).filter(|nu| nu_mask >> nu & 1 == 1);
            let kept = kept.filter_map(|nu| node.coefficient(nu));
            out.coefficients.extend(kept.map(|c| self.coefficients[c]));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{TreeBuilder, grid::Grid};

    /// A smooth function with a step, on 4² × 4² cells.
    fn tree() -> Tree {
        let levels = Levels::isotropic(2);
        let image = |d: usize| {
            let value =
                move |p: usize| (p as f32 * 0.37 + d as f32 * 0.11).sin() + f32::from(p > 9);
            Some((0..16).map(|p| [value(p), 0.5 * value(p), 1.0]).collect())
        };
        TreeBuilder::from_grid(&Grid::from_images(levels, (0..16).map(image).collect())).finish()
    }

    fn distance(a: &Tree, b: &Tree) -> f64 {
        let (a, b) = (a.to_grid(), b.to_grid());
        let cells = (0..256_usize).map(|i| [i & 3, i >> 2 & 3, i >> 4 & 3, i >> 6]);
        let squares = cells.flat_map(|m| {
            let (a, b) = (a.mean(m), b.mean(m));
            (0..3).map(move |c| f64::from(a[c] - b[c]).powi(2))
        });
        (squares.sum::<f64>() / 256.0).sqrt()
    }

    #[test]
    fn the_reported_error_is_the_measured_one() {
        let tree = tree();
        for error in [0.3, 0.1, 0.01] {
            let (small, report) = tree.compressed(Keep::RelativeError(error));
            let measured = distance(&tree, &small) / tree.norm_squared().sqrt();
            assert!((measured - report.relative_error).abs() < 1e-6, "{measured} {report:?}");
            assert!(report.relative_error <= error, "{report:?}");
            // One coefficient fewer would break the promise.
            let (_, fewer) = tree.compressed(Keep::Count(report.after - 1));
            assert!(fewer.relative_error > error, "{fewer:?} against {report:?}");
        }
    }

    #[test]
    fn a_truncated_tree_has_the_means_of_the_coarser_cells() {
        let tree = tree().compressed(Keep::Count(60)).0;
        let (fine, coarse) = (tree.to_grid(), tree.truncated(1).to_grid());
        assert_eq!(coarse.levels(), Levels::isotropic(1));
        for cell in 0..16_usize {
            let m: [usize; 4] = std::array::from_fn(|d| cell >> d & 1);
            let inside = (0..16).map(|i| std::array::from_fn(|d| 2 * m[d] + (i >> d & 1)));
            let sum = inside.fold(0.0, |sum, m: [usize; 4]| sum + fine.mean(m)[0]);
            assert!((coarse.mean(m)[0] - sum / 16.0).abs() < 1e-6, "{m:?}");
        }
        assert_eq!(tree.truncated(2), tree);
        assert_eq!(tree.truncated(0).nodes(), &[]);
    }

    #[test]
    fn a_count_asked_for_is_met() {
        let (small, report) = tree().compressed(Keep::Count(13));
        assert_eq!((small.len(), report.after), (13, 13));
    }

    #[test]
    fn keeping_everything_changes_nothing() {
        let tree = tree();
        assert_eq!(tree.compressed(Keep::RelativeError(0.0)).0, tree);
    }
}
