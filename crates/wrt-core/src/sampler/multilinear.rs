//! The continuous look-up.

use super::{Below, Sampler, rim};
use crate::Levels;
use crate::grid::Rgb;

/// Cells `low` and `high` of a dimension and the latter's share.
#[derive(Clone, Copy)]
struct Axis {
    low: u32,
    high: u32,
    share: f32,
}

impl Axis {
    /// The cells whose centres are on either side of `x` or, past the outermost
    /// centres, the two that are nearest: a straight line through them goes on
    /// for at most `beyond` cells, and then stays.
    fn new(x: f64, level: u8, beyond: f64) -> Self {
        let last = (1_u32 << level) - 1;
        let beyond = if last == 0 { 0.0 } else { beyond };
        let at = (x * f64::from(last + 1) - 0.5).clamp(-beyond, f64::from(last) + beyond);
        let low = (at as u32).min(last.saturating_sub(1));
        Self { low, high: (low + 1).min(last), share: (at - f64::from(low)) as f32 }
    }
}

/// Going straight on to a patch's border leaves, on mosaics of sixteen cells a
/// side, seams of this part of what staying at the last centre's value leaves:
/// 0.3 where edges are 4 cells wide, 0.6 at 2, 0.9 at 1 and ½, 1.2 at 0.
const POSITION_BEYOND: f64 = 0.5;

/// At the UDC's rim weights are renormalised and so must not be negative.
const DIRECTION_BEYOND: f64 = 0.0;

/// The interpolation of one look-up.
///
/// A *state* names the low or the high cell of a dimension, or both while they
/// have not yet parted: a pair of masks with a bit per dimension, `both` and
/// `high`, the latter 0 where the former is 1.
struct Stencil {
    /// Codes of the cell that is low, or high, in all dimensions.
    low: u64,
    high: u64,
    /// Of u and v, by [`pair`].
    position: [f32; 16],
    /// Of κ and λ, by [`pair`], divided by what lies inside the UDC.
    direction: [f32; 16],
}

/// Where the weight of two dimensions' state is kept: their bits of `both`, then
/// of `high`.
fn pair(both: usize, high: usize) -> usize {
    (both & 3) << 2 | high & 3
}

/// The weights of two dimensions in every state, from those of the four pairs of
/// cells; the first dimension has bit 0.
fn pairs(cells: [f32; 4]) -> [f32; 16] {
    let mut table = [0.0; 16];
    table[..4].copy_from_slice(&cells);
    table[pair(0b01, 0b00)] = cells[0b00] + cells[0b01];
    table[pair(0b01, 0b10)] = cells[0b10] + cells[0b11];
    table[pair(0b10, 0b00)] = cells[0b00] + cells[0b10];
    table[pair(0b10, 0b01)] = cells[0b01] + cells[0b11];
    table[pair(0b11, 0b00)] = table[pair(0b01, 0b00)] + table[pair(0b01, 0b10)];
    table
}

impl Stencil {
    fn weight(&self, both: usize, high: usize) -> f32 {
        self.position[pair(both, high)] * self.direction[pair(both >> 2, high >> 2)]
    }
}

impl Sampler {
    /// Radiance at (u, v, κ, λ), interpolated between the centres of the sixteen
    /// finest cells around: continuous. Coordinates past 0 or 1 count as 0 or 1.
    ///
    /// Between the outermost centres and the border of the patch it goes straight
    /// on, which beside a dark edge may take it below zero; so may the tree's own
    /// means once coefficients have been dropped.
    #[must_use]
    pub fn multilinear(&self, q: [f64; 4]) -> Rgb {
        let stencil = self.stencil(q);
        let mut sum = [0.0; 3];
        let all = 0b1111;
        if self.nodes.is_empty() {
            self.add(0, stencil.weight(all, 0), &mut sum);
        } else {
            let shift = 4 * u32::from(self.levels.depth());
            self.gather(&stencil, 0, shift, all, 0, &mut sum);
        }
        sum
    }

    fn stencil(&self, q: [f64; 4]) -> Stencil {
        let Levels { position, direction } = self.levels;
        let [u, v] = [q[0], q[1]].map(|x| Axis::new(x, position, POSITION_BEYOND));
        let (kappa, lambda) = rim::inside([q[2], q[3]]);
        let [k, l] = [kappa, lambda].map(|x| Axis::new(x, direction, DIRECTION_BEYOND));
        let shares = |a: Axis, b: Axis| -> [f32; 4] {
            let (a, b) = ([1.0 - a.share, a.share], [1.0 - b.share, b.share]);
            [a[0] * b[0], a[1] * b[0], a[0] * b[1], a[1] * b[1]]
        };
        let cells = [[k.low, l.low], [k.high, l.low], [k.low, l.high], [k.high, l.high]];
        let inverse = cells.map(|cell| self.rim.inverse(cell));
        let mut weights = shares(k, l);
        let counted = weights.iter().zip(inverse).filter(|(_, inverse)| *inverse > 0.0);
        let total: f32 = counted.map(|(weight, _)| weight).sum();
        let mut ends = [[k.low, l.low], [k.high, l.high]];
        if total > 0.0 {
            for (weight, inverse) in weights.iter_mut().zip(inverse) {
                *weight *= inverse / total;
            }
        } else {
            let cell = [kappa, lambda].map(|x| super::cell_of(x, direction));
            let (cell, inverse) = self.rim.nearest(cell);
            (weights, ends) = ([inverse, 0.0, 0.0, 0.0], [cell; 2]);
        }
        Stencil {
            low: self.code([u.low, v.low, ends[0][0], ends[0][1]]),
            high: self.code([u.high, v.high, ends[1][0], ends[1][1]]),
            position: pairs(shares(u, v)),
            direction: pairs(weights),
        }
    }

    /// Adds what the cells of a state contribute below `node`, reading each leaf
    /// once.
    fn gather(
        &self,
        stencil: &Stencil,
        mut node: usize,
        mut shift: u32,
        both: usize,
        high: usize,
        sum: &mut [f32; 3],
    ) {
        loop {
            shift -= 4;
            let low_half = (stencil.low >> shift & 15) as usize;
            let high_half = (stencil.high >> shift & 15) as usize;
            // Dimensions whose two cells part here.
            let part = both & (low_half ^ high_half);
            if part == 0 {
                match self.nodes[node].below(low_half & !high | high_half & high) {
                    Below::Leaf(leaf) => return self.add(leaf, stencil.weight(both, high), sum),
                    Below::Branch(child) => node = child,
                }
                continue;
            }
            let both = both & !part;
            // All subsets of `part`, from none to itself.
            let mut chosen = 0;
            loop {
                let high = high | chosen;
                match self.nodes[node].below(low_half & !high | high_half & high) {
                    Below::Leaf(leaf) => self.add(leaf, stencil.weight(both, high), sum),
                    Below::Branch(child) => self.gather(stencil, child, shift, both, high, sum),
                }
                if chosen == part {
                    return;
                }
                chosen = chosen.wrapping_sub(part) & part;
            }
        }
    }

    fn add(&self, leaf: usize, weight: f32, sum: &mut [f32; 3]) {
        for (sum, x) in sum.iter_mut().zip(self.leaves[leaf]) {
            *sum += weight * x;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{grid, levels, point, sampler, wild};
    use super::*;
    use crate::{Keep, TreeBuilder};
    use proptest::prelude::*;

    /// Sixteen look-ups, one per cell, weighted as the type's documentation says.
    fn sixteen_boxes(sampler: &Sampler, q: [f64; 4]) -> [f64; 3] {
        let levels = sampler.levels;
        let level = [levels.position, levels.position, levels.direction, levels.direction];
        let cell = |d: usize, high: usize| -> (u32, f64) {
            let last = (1_i64 << level[d]) - 1;
            let at = q[d] * (last + 1) as f64 - 0.5;
            let at = if d < 2 && last > 0 { at } else { at.clamp(0.0, last as f64) };
            let low = (at.floor() as i64).clamp(0, (last - 1).max(0));
            let share = at - low as f64;
            ((low + high as i64).min(last) as u32, if high == 1 { share } else { 1.0 - share })
        };
        let (mut sum, mut total) = ([0.0; 3], 0.0);
        for corner in 0..16_usize {
            let cells: [_; 4] = std::array::from_fn(|d| cell(d, corner >> d & 1));
            let m = cells.map(|c| c.0);
            let inverse = f64::from(sampler.rim.inverse([m[2], m[3]]));
            if inverse == 0.0 {
                continue;
            }
            let weight: f64 = cells.iter().map(|c| c.1).product();
            total += weight;
            let mean = sampler.leaves[sampler.leaf(sampler.code(m))];
            for (sum, x) in sum.iter_mut().zip(mean) {
                *sum += weight * inverse * f64::from(x);
            }
        }
        if total > 0.0 { sum.map(|x| x / total) } else { sampler.box_value(q).map(f64::from) }
    }

    proptest! {
        #[test]
        fn one_descent_equals_sixteen(levels in levels(), q in point(), kept in 0.0..1.0f64) {
            let tree = TreeBuilder::from_grid(&grid(levels, wild)).finish();
            let count = (kept * tree.len() as f64) as usize;
            let sampler = Sampler::new(&tree.compressed(Keep::Count(count)).0);
            let slow = sixteen_boxes(&sampler, q);
            for (a, b) in sampler.multilinear(q).into_iter().zip(slow) {
                prop_assert!((f64::from(a) - b).abs() < 1e-4, "{a} {b}");
            }
        }

        #[test]
        fn linear_radiance_is_reproduced(q in [0.0..1.0f64, 0.0..1.0, 0.25..0.75, 0.25..0.75]) {
            let plane = |[u, v, k, l]: [f64; 4]| [1.0 + u - 2.0 * v, 3.0 * k + l, u + l];
            let levels = Levels { position: 2, direction: 4 };
            let found = sampler(levels, plane).multilinear(q);
            for (a, b) in found.into_iter().zip(plane(q)) {
                prop_assert!((f64::from(a) - b).abs() < 1e-5, "{a} {b}");
            }
        }

        #[test]
        fn a_small_step_makes_a_small_change(
            direction in 0..5_u8, q in point(), step in [-1e-6..1e-6f64, -1e-6..1e-6, -1e-6..1e-6, -1e-6..1e-6],
        ) {
            let levels = Levels { position: 3, direction };
            let sampler = sampler(levels, wild);
            let next: [f64; 4] = std::array::from_fn(|d| q[d] + step[d]);
            for (a, b) in sampler.multilinear(q).into_iter().zip(sampler.multilinear(next)) {
                // At most the range (8 here with 1/f) per cell width in each of
                // four dimensions, over the least weight that counts at the rim.
                prop_assert!((a - b).abs() < 1e-6 * 4.0 * 16.0 * 8.0 / 0.1, "{a} {b}");
            }
        }
    }

    /// Two patches side by side that show a soft shadow's edge.
    #[test]
    fn going_straight_on_makes_seams_smaller() {
        let edge = |x: f64, v: f64| 1.0 / (1.0 + (-(x + 0.3 * v - 1.2) * 10.0).exp());
        let levels = Levels { position: 4, direction: 0 };
        let patch = |from: f64| sampler(levels, |[u, v, ..]| [edge(u + from, v); 3]);
        let (left, right) = (patch(0.0), patch(1.0));
        let (mut straight, mut stay) = (0.0_f32, 0.0_f32);
        for i in 0..100 {
            let v = f64::from(i) / 100.0;
            let step = |a: f64, b: f64| {
                let [l, r] =
                    [(&left, a), (&right, b)].map(|(s, u)| s.multilinear([u, v, 0.5, 0.5])[0]);
                (l - r).powi(2)
            };
            straight += step(1.0, 0.0);
            stay += step(1.0 - 0.5 / 16.0, 0.5 / 16.0);
        }
        assert!(straight < 0.1 * stay, "squares {straight} {stay}");
    }

    /// What continuity at the rim rests on: the cells that count never fade out.
    #[test]
    fn inside_the_udc_cells_that_count_have_weight() {
        let mut least = 1.0_f64;
        for level in 0..=8 {
            let rim = rim::Rim::new(level);
            for i in 0..20_000 {
                let phi = f64::from(i) * 0.000_314_159_3;
                for r in [0.5, 0.499, 0.49, 0.45] {
                    let axis = |x: f64| Axis::new(0.5 + r * x, level, DIRECTION_BEYOND);
                    let (k, l) = (axis(phi.cos()), axis(phi.sin()));
                    let mut total = 0.0;
                    for (cell_l, share_l) in [(l.low, 1.0 - l.share), (l.high, l.share)] {
                        for (cell_k, share_k) in [(k.low, 1.0 - k.share), (k.high, k.share)] {
                            if rim.inverse([cell_k, cell_l]) > 0.0 {
                                total += share_k * share_l;
                            }
                        }
                    }
                    least = least.min(total.into());
                }
            }
        }
        assert!(least > 0.1, "{least}");
    }
}
