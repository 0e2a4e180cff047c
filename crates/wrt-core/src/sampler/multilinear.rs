//! The continuous look-up.

use super::rim::{self, Reach};
use super::{Sampler, cell_of};
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

impl Sampler {
    /// Radiance at (u, v, κ, λ), interpolated between the centres of the sixteen
    /// finest cells around: continuous. Coordinates past 0 or 1 count as 0 or 1.
    ///
    /// Between the outermost centres and the border of the patch it goes straight
    /// on, which beside a dark edge may take it below zero; so may the tree's own
    /// means once coefficients have been dropped.
    #[must_use]
    #[inline]
    pub fn multilinear(&self, q: [f64; 4]) -> Rgb {
        let Levels { position, direction } = self.levels;
        let [u, v] = [q[0], q[1]].map(|x| Axis::new(x, position, POSITION_BEYOND));
        let [k, l] = [q[2], q[3]].map(|x| Axis::new(x, direction, DIRECTION_BEYOND));
        if self.rim.is_around([q[2], q[3]], Reach::Four) {
            let k_shares = [1.0 - k.share, k.share];
            let weights = [0, 1].map(|i| k_shares.map(|s| s * [1.0 - l.share, l.share][i]));
            self.blend([u, v], [[k.low, k.high], [l.low, l.high]], weights)
        } else {
            self.at_rim([u, v], [q[2], q[3]])
        }
    }

    /// The sum over two by two direction cells, `weights` by l then k, of what is
    /// interpolated over position.
    #[inline]
    fn blend(&self, [u, v]: [Axis; 2], cells: [[u32; 2]; 2], weights: [[f32; 2]; 2]) -> Rgb {
        let axis = |d: usize, ends: [u32; 2]| ends.map(|m| self.bricks.axis(d, m));
        let (us, vs) = (axis(0, [u.low, u.high]), axis(1, [v.low, v.high]));
        let (ks, ls) = (axis(2, cells[0]), axis(3, cells[1]));
        // All sixteen first: they do not wait for each other.
        let texels = self.bricks.corners([us, vs, ks, ls]);
        let mut sum = [0.0; 4];
        for (i, weight) in weights.into_iter().flatten().enumerate() {
            let [a, b, c, d] = [0, 1, 2, 3].map(|j| texels[4 * i + j].0);
            let value = between(between(a, b, u.share), between(c, d, u.share), v.share);
            for (sum, x) in sum.iter_mut().zip(value) {
                *sum += weight * x;
            }
        }
        let [r, g, b, _] = sum;
        [r, g, b]
    }

    /// Where some of the four direction cells are cut by the rim: each mean is
    /// divided by f and cells without a say are left out.
    fn at_rim(&self, position: [Axis; 2], direction: [f64; 2]) -> Rgb {
        let level = self.levels.direction;
        let (kappa, lambda) = rim::inside(direction);
        let [k, l] = [kappa, lambda].map(|x| Axis::new(x, level, DIRECTION_BEYOND));
        let cells = [[k.low, k.high], [l.low, l.high]];
        let mut total = 0.0;
        let mut weights = [[0.0; 2]; 2];
        for (j, l_share) in [1.0 - l.share, l.share].into_iter().enumerate() {
            for (i, k_share) in [1.0 - k.share, k.share].into_iter().enumerate() {
                let inverse = self.rim.inverse([cells[0][i], cells[1][j]]);
                weights[j][i] = k_share * l_share * inverse;
                if inverse > 0.0 {
                    total += k_share * l_share;
                }
            }
        }
        if total > 0.0 {
            return self.blend(position, cells, weights.map(|row| row.map(|w| w / total)));
        }
        let (cell, inverse) = self.rim.nearest([kappa, lambda].map(|x| cell_of(x, level)));
        self.blend(position, cell.map(|m| [m; 2]), [[inverse, 0.0], [0.0; 2]])
    }
}

#[inline]
fn between(a: [f32; 4], b: [f32; 4], share: f32) -> [f32; 4] {
    std::array::from_fn(|c| a[c] + share * (b[c] - a[c]))
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
            let mean = sampler.texel(m).0;
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
