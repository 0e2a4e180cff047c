//! The step, colour axes and darkness that suit a tree.

use super::region::Region;
use super::shape::{sticks_out, volume};
use super::values::MAGNITUDE_BITS;
use crate::tree::Tree;
use crate::{CHILDREN, Cell, children};

/// Of the error allowed, what goes to cells that are made dark, as a share of its
/// square: enough to clear away what rounding and faint light leave, too little to
/// be missed by the coefficients.
const DARKNESS: f64 = 0.02;

/// Most steps tried: more than any tree has been seen to take.
const MOST_ROUNDS: u32 = 40;

/// A tree's coefficients on what is lit, before quantisation.
pub(super) struct Analysis {
    /// `(lit, nodes)`, by node of the tree.
    masks: Vec<(u16, u16)>,
    /// By node: which ν it has, and where in `coefficients`.
    starts: Vec<(u32, u16)>,
    /// Along the colour axes.
    coefficients: Vec<[f64; 3]>,
    /// The root's smoothing coefficient, along the colour axes.
    pub(super) root: [f64; 3],
    /// Rows are orthonormal axes of colour, the most energetic first.
    pub(super) axes: [[f32; 3]; 3],
    /// ‖L‖² of what was made dark.
    dropped: f64,
    /// Whether no lit cell reaches out of the UDC.
    pub(super) within_udc: bool,
    /// By node of the tree: its children.
    all: Vec<u16>,
}

impl Analysis {
    /// Analyses `tree`, of which cells may be made dark for a part of the squared
    /// error `allowed`.
    pub(super) fn new(tree: &Tree, allowed: f64) -> Self {
        let levels = tree.levels();
        // Smoothing coefficients of all children, from the root down.
        let mut cells = vec![Cell::ROOT; tree.nodes().len()];
        let mut smooth = vec![[0.0; 3]; tree.nodes().len()];
        if let Some(root) = smooth.first_mut() {
            *root = tree.root().map(f64::from);
        }
        let mut leaves = Vec::new();
        let mut values = Vec::with_capacity(tree.nodes().len());
        for (i, node) in tree.nodes().iter().enumerate() {
            let split = levels.split(cells[i].depth);
            let pushed = tree.push_node(i, smooth[i], split);
            for m in children(split) {
                match node.child(m) {
                    Some(child) => {
                        cells[child] = cells[i].child(split, m);
                        smooth[child] = pushed[m];
                    }
                    None => leaves.push((energy(pushed[m]) as f32, (i * CHILDREN + m) as u64)),
                }
            }
            values.push(pushed);
        }
        let (dark, dropped) = darkest(&leaves, DARKNESS * allowed, tree.nodes().len());
        let mut analysis = Self {
            masks: vec![(0, 0); tree.nodes().len()],
            starts: vec![(0, 0); tree.nodes().len()],
            coefficients: Vec::new(),
            root: tree.root().map(f64::from),
            axes: [[0.0; 3]; 3],
            dropped,
            within_udc: true,
            all: Vec::with_capacity(tree.nodes().len()),
        };
        for cell in &cells {
            let split = levels.split(cell.depth);
            analysis.all.push(children(split).fold(0, |all, m| all | 1 << m));
        }
        let mut volumes = vec![0.0; tree.nodes().len()];
        for (i, node) in tree.nodes().iter().enumerate().rev() {
            let split = levels.split(cells[i].depth);
            let size = volume(levels, cells[i].depth + 1);
            let mut lit = [0.0; CHILDREN];
            for m in children(split) {
                lit[m] = match node.child(m) {
                    // Analysed before: children lie behind their parents.
                    Some(child) => {
                        values[i][m] = smooth[child];
                        volumes[child]
                    }
                    None if dark[i] >> m & 1 == 1 => 0.0,
                    None => size,
                };
                if lit[m] > 0.0 {
                    analysis.masks[i].0 |= 1 << m;
                    analysis.masks[i].1 |= u16::from(node.child(m).is_some()) << m;
                    analysis.within_udc &=
                        node.child(m).is_some() || !sticks_out(levels, cells[i].child(split, m));
                }
            }
            let region = Region::new(split, lit);
            volumes[i] = region.volume();
            let mut b = [0, 1, 2]
                .map(|c| std::array::from_fn(|m| if lit[m] > 0.0 { values[i][m][c] } else { 0.0 }));
            b.iter_mut().for_each(|b| region.pull(b));
            smooth[i] = [b[0][0], b[1][0], b[2][0]];
            let mask = region.mask() & !1;
            analysis.starts[i] = (analysis.coefficients.len() as u32, mask);
            let wavelets = (1..CHILDREN).filter(|nu| mask >> nu & 1 == 1);
            analysis.coefficients.extend(wavelets.map(|nu| [b[0][nu], b[1][nu], b[2][nu]]));
        }
        if let Some(&root) = smooth.first() {
            analysis.root = if volumes[0] > 0.0 { root } else { [0.0; 3] };
        }
        analysis.turn();
        analysis
    }

    /// Turns all coefficients into the axes in which the channels are uncorrelated.
    fn turn(&mut self) {
        let mut covariance = [[0.0; 3]; 3];
        for b in &self.coefficients {
            for i in 0..3 {
                for j in 0..3 {
                    covariance[i][j] += b[i] * b[j];
                }
            }
        }
        self.axes = axes(covariance);
        let axes = self.axes;
        let turned = |b: [f64; 3]| {
            axes.map(|axis| axis.iter().zip(b).map(|(&a, b)| f64::from(a) * b).sum::<f64>())
        };
        self.root = turned(self.root);
        for b in &mut self.coefficients {
            *b = turned(*b);
        }
    }

    /// A step whose squared error is at most `allowed`, and not by much; `None` if
    /// that makes coefficients too large to be coded.
    pub(super) fn step(&self, allowed: f64) -> Option<f64> {
        let largest = self.coefficients.iter().flatten().fold(0.0_f64, |m, x| m.max(x.abs()));
        // With twice the largest as the step nothing but the root is left.
        let (mut low, mut high) = (0.0, 2.0 * largest.max(f64::from(f32::MIN_POSITIVE)));
        if self.error_squared(high) <= allowed {
            return Some(high);
        }
        // Uniform quantisation errs by Δ²/12 a coefficient, less for those that
        // become zero; the error is near a power of the step, so that secants on
        // logarithms close in within a few rounds.
        let least = largest / f64::from(1 << (MAGNITUDE_BITS - 1));
        let mut step = (4.0 * allowed / self.coefficients.len() as f64).sqrt().min(0.5 * high);
        let (mut below, mut above) = (0.0, self.error_squared(high));
        for _ in 0..MOST_ROUNDS {
            let squared = self.error_squared(step);
            if squared <= allowed {
                (low, below) = (step, squared);
                if squared > 0.995 * allowed {
                    break;
                }
            } else {
                (high, above) = (step, squared);
            }
            // Aims a little low: the answer has to be below.
            step = if low == 0.0 {
                high * (0.9 * allowed / above).sqrt()
            } else if below == 0.0 {
                0.5 * (low + high)
            } else {
                let power = (high / low).ln() / (above / below).ln();
                let secant = low * (0.998 * allowed / below).powf(power);
                // Within the bracket, and not so near its ends as to stall.
                secant.clamp(0.95 * low + 0.05 * high, 0.05 * low + 0.95 * high)
            };
            if step < least {
                return None;
            }
        }
        (low > 0.0).then_some(low)
    }

    fn error_squared(&self, step: f64) -> f64 {
        let wavelets: f64 = self
            .coefficients
            .iter()
            .flatten()
            .map(|&x| (x - f64::from(quantised(x, step)) * step).powi(2))
            .sum();
        self.dropped + wavelets
    }

    /// `(lit, nodes)` and coefficients in steps, breadth first, without the nodes
    /// below which nothing is left.
    pub(super) fn quantised(&self, tree: &Tree, step: f64) -> (Vec<(u16, u16)>, Vec<[i32; 3]>) {
        let of_node = |i: usize| {
            let (start, mask) = self.starts[i];
            &self.coefficients[start as usize..][..mask.count_ones() as usize]
        };
        let mut kept = vec![false; tree.nodes().len()];
        for (i, node) in tree.nodes().iter().enumerate().rev() {
            let (lit, nodes) = self.masks[i];
            let has_node = (0..CHILDREN)
                .filter(|m| nodes >> m & 1 == 1)
                .any(|m| node.child(m).is_some_and(|child| kept[child]));
            kept[i] = lit != self.all[i]
                || has_node
                || of_node(i).iter().flatten().any(|&x| quantised(x, step) != 0);
        }
        let (mut masks, mut out) = (Vec::new(), Vec::new());
        let mut queue: Vec<usize> =
            (0..1).filter(|_| kept.first() == Some(&true) && self.masks[0].0 != 0).collect();
        while masks.len() < queue.len() {
            let i = queue[masks.len()];
            let (lit, nodes) = self.masks[i];
            let mut below = 0;
            for m in (0..CHILDREN).filter(|m| nodes >> m & 1 == 1) {
                if let Some(child) = tree.nodes()[i].child(m).filter(|&child| kept[child]) {
                    below |= 1 << m;
                    queue.push(child);
                }
            }
            masks.push((lit, below));
            out.extend(of_node(i).iter().map(|b| b.map(|x| quantised(x, step))));
        }
        (masks, out)
    }
}

/// By node: the children of least energy, of at most `allowed` together; and how much
/// they have. `leaves` are energies with sixteen times the node plus m′.
fn darkest(leaves: &[(f32, u64)], allowed: f64, nodes: usize) -> (Vec<u16>, f64) {
    // Buckets of an eighth of an octave: positive floats are ordered as their bits.
    let bucket = |energy: f32| (energy.to_bits() >> 20) as usize;
    let mut sums = vec![0.0; bucket(f32::INFINITY) + 1];
    for &(energy, _) in leaves {
        sums[bucket(energy)] += f64::from(energy);
    }
    let (mut dropped, mut end) = (0.0, 0);
    while end < sums.len() && dropped + sums[end] <= allowed {
        dropped += sums[end];
        end += 1;
    }
    let mut dark = vec![0_u16; nodes];
    for &(_, at) in leaves.iter().filter(|(energy, _)| bucket(*energy) < end) {
        dark[at as usize / CHILDREN] |= 1 << (at as usize % CHILDREN);
    }
    (dark, dropped)
}

fn energy(b: [f64; 3]) -> f64 {
    b.iter().map(|x| x * x).sum()
}

/// From which magnitude on, in steps, a coefficient is not 0: a little more than
/// half, because a 0 takes fewer bits. Between 0.55 and 0.65 the size hardly changes.
const DEAD_ZONE: f64 = 0.6;

/// `x` in steps, rounded.
fn quantised(x: f64, step: f64) -> i32 {
    let steps = x / step;
    if steps.abs() < DEAD_ZONE { 0 } else { steps.round() as i32 }
}

/// Eigenvectors of a symmetric matrix as rows, by decreasing eigenvalue: Jacobi's
/// rotations.
fn axes(mut matrix: [[f64; 3]; 3]) -> [[f32; 3]; 3] {
    let mut axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..8 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if matrix[p][q].abs() <= 1e-12 * (matrix[p][p].abs() + matrix[q][q].abs()) {
                continue;
            }
            let theta = (matrix[q][q] - matrix[p][p]) / (2.0 * matrix[p][q]);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let cos = (t * t + 1.0).sqrt().recip();
            let sin = t * cos;
            for row in &mut matrix {
                (row[p], row[q]) = (cos * row[p] - sin * row[q], sin * row[p] + cos * row[q]);
            }
            let (mp, mq) = (matrix[p], matrix[q]);
            for k in 0..3 {
                matrix[p][k] = cos * mp[k] - sin * mq[k];
                matrix[q][k] = sin * mp[k] + cos * mq[k];
            }
            let (ap, aq): ([f64; 3], [f64; 3]) = (axes[p], axes[q]);
            for k in 0..3 {
                axes[p][k] = cos * ap[k] - sin * aq[k];
                axes[q][k] = sin * ap[k] + cos * aq[k];
            }
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| matrix[b][b].total_cmp(&matrix[a][a]).then(a.cmp(&b)));
    order.map(|i| {
        let sign = if axes[i].iter().sum::<f64>() < 0.0 { -1.0 } else { 1.0 };
        axes[i].map(|x| (sign * x) as f32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn axes_are_orthonormal_and_diagonalise(rows: [[i8; 3]; 4]) {
            let mut covariance = [[0.0; 3]; 3];
            for row in rows {
                for i in 0..3 {
                    for j in 0..3 {
                        covariance[i][j] += f64::from(row[i]) * f64::from(row[j]);
                    }
                }
            }
            let found = axes(covariance).map(|axis| axis.map(f64::from));
            let trace: f64 = (0..3).map(|i| covariance[i][i]).sum();
            for i in 0..3 {
                for j in 0..3 {
                    let dot: f64 = (0..3).map(|k| found[i][k] * found[j][k]).sum();
                    prop_assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-6, "{found:?}");
                    let turned: f64 = (0..3)
                        .flat_map(|k| (0..3).map(move |l| (k, l)))
                        .map(|(k, l)| found[i][k] * covariance[k][l] * found[j][l])
                        .sum();
                    prop_assert!(i == j || turned.abs() <= 1e-6 * trace, "{turned} of {trace}");
                }
            }
        }
    }
}
