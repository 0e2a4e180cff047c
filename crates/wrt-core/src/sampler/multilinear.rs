//! The continuous look-up.

use super::{Sampler, Side, rim};
use crate::grid::Rgb;
use glam::Vec3;

/// A place between two cells of a dimension.
#[derive(Clone, Copy)]
struct Axis {
    low: u32,
    /// Of the cell above, which is `low` itself if there is only one.
    share: f32,
}

impl Axis {
    /// The cells whose centres are on either side of `x` or, past the outermost
    /// centres, the two that are nearest: a straight line through them goes on
    /// for at most `beyond` cells, and then stays.
    #[inline]
    fn new(x: f64, side: Side, beyond: f32) -> Self {
        // From the first centre, in cells.
        let at = side.fixed(x).cast_signed() - (1 << 31);
        let low = ((at >> 32) as i32).min(side.last.cast_signed() - 1).max(0);
        let share = (at - (i64::from(low) << 32)) as f32 * 2.0_f32.powi(-32);
        Self { low: low.cast_unsigned(), share: share.clamp(-beyond, 1.0 + beyond) }
    }

    #[inline]
    fn shares(self) -> [f32; 2] {
        [1.0 - self.share, self.share]
    }

    fn cells(self, side: Side) -> [u32; 2] {
        [self.low, (self.low + 1).min(side.last)]
    }
}

/// Going straight on to a patch's border leaves, on mosaics of sixteen cells a
/// side, seams of this part of what staying at the last centre's value leaves:
/// 0.3 where edges are 4 cells wide, 0.6 at 2, 0.9 at 1 and ½, 1.2 at 0.
const POSITION_BEYOND: f32 = 0.5;

/// At the UDC's rim weights are renormalised and so must not be negative.
const DIRECTION_BEYOND: f32 = 0.0;

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
        let [position, direction] = self.sides;
        let [u, v] = [q[0], q[1]].map(|x| Axis::new(x, position, POSITION_BEYOND));
        let towards = [q[2], q[3]];
        let towards = if rim::is_inside(towards) { towards } else { rim::moved(towards) };
        let [k, l] = towards.map(|x| Axis::new(x, direction, DIRECTION_BEYOND));
        if !self.bricks.knows_the_rim() {
            return self.deep([u, v], [k, l], towards);
        }
        let lows = [u, v, k, l].map(|axis| axis.low);
        let sum = self.bricks.blend(lows, products(u, v), products(k, l));
        // Inside the UDC, cells with a say have weight.
        (sum.truncate() / sum.w).into()
    }

    /// Where the values know nothing of the rim: each mean is divided by f and cells
    /// without a say are left out.
    #[cold]
    fn deep(&self, [u, v]: [Axis; 2], [k, l]: [Axis; 2], towards: [f64; 2]) -> Rgb {
        let [position, direction] = self.sides;
        let mut cells = [k.cells(direction), l.cells(direction)];
        let mut weights = products(k, l);
        let mut total = 0.0;
        for (i, weight) in weights.iter_mut().enumerate() {
            let inverse = self.rim.inverse([cells[0][i & 1], cells[1][i >> 1]]);
            total += if inverse > 0.0 { *weight } else { 0.0 };
            *weight *= inverse;
        }
        if total > 0.0 {
            weights = weights.map(|w| w / total);
        } else {
            let (cell, inverse) = self.rim.nearest(towards.map(|x| direction.cell(x)));
            (cells, weights) = (cell.map(|m| [m; 2]), [inverse, 0.0, 0.0, 0.0]);
        }
        let (us, vs, uv) = (u.cells(position), v.cells(position), products(u, v));
        let mut sum = Vec3::ZERO;
        for corner in 0..16 {
            let [i, j] = [corner & 3, corner >> 2];
            let m = [us[i & 1], vs[i >> 1], cells[0][j & 1], cells[1][j >> 1]];
            sum += uv[i] * weights[j] * self.bricks.at(m).truncate();
        }
        sum.into()
    }
}

/// Shares of all four cells of two dimensions, the first's fastest.
#[inline]
fn products(first: Axis, second: Axis) -> [f32; 4] {
    let (a, b) = (first.shares(), second.shares());
    [a[0] * b[0], a[1] * b[0], a[0] * b[1], a[1] * b[1]]
}

#[cfg(test)]
mod tests {
    use super::super::leaves::Leaves;
    use super::super::tests::{grid, levels, point, sampler, wild};
    use super::*;
    use crate::{CHILDREN, Cell, Keep, Levels, Tree, TreeBuilder};
    use proptest::prelude::*;

    /// Sixteen look-ups, one per cell, weighted as the type's documentation says.
    fn sixteen_boxes(sampler: &Sampler, tree: &Tree, q: [f64; 4]) -> [f64; 3] {
        let (levels, leaves) = (sampler.levels, Leaves::new(tree));
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
            let mean = leaves.mean(leaves.leaf(m).index);
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
            let tree = tree.compressed(Keep::Count(count)).0;
            let sampler = Sampler::new(&tree);
            let slow = sixteen_boxes(&sampler, &tree, q);
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

    /// Where the table would be too large, and values know nothing of the rim.
    #[test]
    fn deep_trees_are_interpolated_likewise() {
        let mut builder = TreeBuilder::new(Levels { position: 4, direction: 10 });
        builder.add_root([1.0, 0.5, 3.0]);
        for depth in 0..3 {
            let mut b = [[0.0; 3]; CHILDREN];
            for (nu, b) in b.iter_mut().enumerate() {
                *b = [0.02 * nu as f64, 0.1, -0.03 * f64::from(depth)];
            }
            let m = [1, 2, 3, 1].map(|m| m >> (2 - depth));
            builder.add_node(Cell { depth, m }, &b);
        }
        let tree = builder.finish();
        let sampler = Sampler::new(&tree);
        assert!(!sampler.bricks.knows_the_rim(), "stages");
        for i in 0..400 {
            let x = |k: f64| (f64::from(i) * k).fract();
            let r = if i % 2 == 0 { 0.5 * x(0.311).sqrt() } else { 0.49 + 0.01 * x(0.773) };
            let (sine, cosine) = f64::from(i).sin_cos();
            let q = [x(0.618), x(0.414), 0.5 + r * cosine, 0.5 + r * sine];
            let slow = sixteen_boxes(&sampler, &tree, q);
            for (a, b) in sampler.multilinear(q).into_iter().zip(slow) {
                assert!((f64::from(a) - b).abs() < 1e-4, "{q:?}: {a} {b}");
            }
            let cell = [q[2], q[3]].map(|x| sampler.sides[1].cell(x));
            let inverse = f64::from(sampler.rim.inverse(cell));
            for (a, b) in sampler.box_value(q).into_iter().zip(tree.eval(q)) {
                assert!(inverse == 0.0 || (f64::from(a) - inverse * b).abs() < 1e-5, "{q:?}");
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

    /// Two patches of one floor under a light that changes evenly, along u and along v.
    #[test]
    fn tiles_of_even_shading_have_no_seam() {
        let levels = Levels { position: 3, direction: 3 };
        let shade = |x: f64, y: f64, k: f64| [2.0 + x - 0.5 * y + k * x, x * k, 1.0];
        let patch = |[x, y]: [f64; 2]| {
            sampler(levels, move |[u, v, k, _]| shade(x + u, y + v, k).map(|l| l.max(0.0)))
        };
        let (own, right, above) = (patch([0.0, 0.0]), patch([1.0, 0.0]), patch([0.0, 1.0]));
        for i in 0..200 {
            let x = |k: f64| (f64::from(i) * k).fract();
            let (sine, cosine) = f64::from(i).sin_cos();
            let r = 0.499 * x(0.311).sqrt();
            let at = |u: f64, v: f64| [u, v, 0.5 + r * cosine, 0.5 + r * sine];
            let t = x(0.618);
            for (a, b) in [
                (own.multilinear(at(1.0, t)), right.multilinear(at(0.0, t))),
                (own.multilinear(at(t, 1.0)), above.multilinear(at(t, 0.0))),
            ] {
                for (a, b) in a.into_iter().zip(b) {
                    assert!((a - b).abs() < 2e-5, "{i}: {a} {b}");
                }
            }
        }
    }

    /// What continuity at the rim rests on: the cells that count never fade out.
    #[test]
    fn inside_the_udc_cells_that_count_have_weight() {
        let mut least = 1.0_f64;
        for level in 0..=8 {
            let (rim, side) = (rim::Rim::new(level), Side::new(level));
            for i in 0..20_000 {
                let phi = f64::from(i) * 0.000_314_159_3;
                for r in [0.5, 0.499, 0.49, 0.45] {
                    let axis = |x: f64| Axis::new(0.5 + r * x, side, DIRECTION_BEYOND);
                    let (k, l) = (axis(phi.cos()), axis(phi.sin()));
                    let mut total = 0.0;
                    for (i, share) in products(k, l).into_iter().enumerate() {
                        if rim.inverse([k.cells(side)[i & 1], l.cells(side)[i >> 1]]) > 0.0 {
                            total += share;
                        }
                    }
                    least = least.min(total.into());
                }
            }
        }
        assert!(least > 0.1, "{least}");
    }
}
