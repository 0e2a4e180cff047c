//! A tree made immutable for look-ups: the 4-D texture that rays sample (§8
//! asks for it).

mod bricks;
mod footprint;
mod leaves;
mod multilinear;
mod rim;

pub use footprint::MipSampler;

use crate::grid::Rgb;
use crate::{Levels, Tree};
use bricks::Bricks;
use leaves::Leaves;
use rim::Rim;

/// A radiance to be looked up by many threads.
///
/// All coefficients are pushed down once and laid out in bricks of 4⁴ cells, so
/// that a look-up is a table's entry, an index and a value, whatever the depth of
/// the tree.
///
/// A tree's means count zeros outside the UDC. Here a finest direction cell of
/// which a fraction f lies inside has its mean divided by f, so that radiance
/// does not darken towards the horizon; cells with f < ¼, where the division
/// would magnify what thresholding left, have no say, and the nearest of the
/// others stands in for them. (κ, λ) outside the UDC are moved to its rim, unless a
/// box's cell has a say.
#[derive(Clone, Debug)]
pub struct Sampler {
    levels: Levels,
    /// Of position and of direction.
    sides: [Side; 2],
    rim: Rim,
    bricks: Bricks,
}

impl Sampler {
    /// Prepares `tree` for look-ups.
    ///
    /// # Panics
    ///
    /// If it has 2³² leaves, of 64 GiB together.
    #[must_use]
    pub fn new(tree: &Tree) -> Self {
        let levels = tree.levels();
        let rim = Rim::new(levels.direction);
        let bricks = Bricks::new(&Leaves::new(tree), &rim);
        let sides = [levels.position, levels.direction].map(Side::new);
        Self { levels, sides, rim, bricks }
    }

    /// Its levels.
    #[must_use]
    pub fn levels(&self) -> Levels {
        self.levels
    }

    /// Bytes it occupies.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.bricks.bytes() + self.rim.bytes()
    }

    /// The mean radiance over the finest cell around (u, v, κ, λ): piecewise
    /// constant. Coordinates past 0 or 1 count as 0 or 1.
    #[must_use]
    #[inline]
    pub fn box_value(&self, q: [f64; 4]) -> Rgb {
        let [position, direction] = self.sides;
        let [u, v] = [q[0], q[1]].map(|x| position.cell(x));
        let [k, l] = [q[2], q[3]].map(|x| direction.cell(x));
        if self.bricks.knows_the_rim() {
            let [r, g, b, say] = self.bricks.at([u, v, k, l]).to_array();
            if say > 0.0 {
                return [r, g, b];
            }
        }
        self.box_beside([u, v], [q[2], q[3]])
    }

    /// The mean over the cell that stands in for one that may have no say.
    #[cold]
    fn box_beside(&self, [u, v]: [u32; 2], direction: [f64; 2]) -> Rgb {
        let inside = if rim::is_inside(direction) { direction } else { rim::moved(direction) };
        let cell = inside.map(|x| self.sides[1].cell(x));
        let ([k, l], inverse) = self.rim.nearest(cell);
        let mean = self.bricks.at([u, v, k, l]);
        let mean = if self.bricks.knows_the_rim() { mean } else { inverse * mean };
        mean.truncate().into()
    }
}

/// The 2^level cells of a dimension.
#[derive(Clone, Copy, Debug)]
struct Side {
    /// In 2⁻³² of a cell.
    scale: f64,
    last: u32,
}

impl Side {
    fn new(level: u8) -> Self {
        Self { scale: 2.0_f64.powi(i32::from(level) + 32), last: (1 << level) - 1 }
    }

    /// `x`, at least 0 and at most 1, in cells, with 32 bits of fraction.
    ///
    /// Adding 2⁵² leaves a float's integer part in its lowest bits: this takes fewer
    /// instructions than a conversion that looks after all floats. Of a NaN it is
    /// something.
    #[inline]
    fn fixed(self, x: f64) -> u64 {
        const MANTISSA: u64 = (1 << 52) - 1;
        (x.clamp(0.0, 1.0) * self.scale + (1_u64 << 52) as f64).to_bits() & MANTISSA
    }

    /// Which cell holds `x`.
    #[inline]
    fn cell(self, x: f64) -> u32 {
        ((self.fixed(x) >> 32) as u32).min(self.last)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Grid, udc_fractions};
    use crate::{Keep, TreeBuilder};
    use proptest::prelude::*;

    /// The grid whose cells inside the UDC have these means over their inside.
    pub(super) fn grid(levels: Levels, radiance: impl Fn([f64; 4]) -> [f64; 3]) -> Grid {
        let centre = |i: usize, level: u8| (i as f64 + 0.5) / f64::from(1_u32 << level);
        let image = |(d, f): (usize, f64)| {
            let k = centre(d & ((1 << levels.direction) - 1), levels.direction);
            let l = centre(d >> levels.direction, levels.direction);
            let texel = |p: usize| {
                let u = centre(p & ((1 << levels.position) - 1), levels.position);
                let v = centre(p >> levels.position, levels.position);
                radiance([u, v, k, l]).map(|x| (x * f) as f32)
            };
            (f > 0.0).then(|| (0..levels.positions()).map(texel).collect())
        };
        let fractions = udc_fractions(levels.direction).into_iter().enumerate();
        Grid::from_images(levels, fractions.map(image).collect())
    }

    pub(super) fn sampler(levels: Levels, radiance: impl Fn([f64; 4]) -> [f64; 3]) -> Sampler {
        Sampler::new(&TreeBuilder::from_grid(&grid(levels, radiance)).finish())
    }

    /// Something without symmetries, edges in position and direction included.
    pub(super) fn wild([u, v, k, l]: [f64; 4]) -> [f64; 3] {
        let edge = f64::from(u8::from(u + 0.3 * k > 0.7));
        [1.0 + (7.0 * u + 3.0 * l).sin(), edge, (5.0 * v * k).cos() + edge * l]
    }

    /// (u, v) anywhere, (κ, λ) inside the UDC.
    pub(super) fn point() -> impl Strategy<Value = [f64; 4]> {
        (0.0..1.0f64, 0.0..1.0f64, 0.0..1.0f64, 0.0..std::f64::consts::TAU).prop_map(
            |(u, v, r, phi)| {
                let r = 0.5 * r.sqrt();
                [u, v, 0.5 + r * phi.cos(), 0.5 + r * phi.sin()]
            },
        )
    }

    pub(super) fn levels() -> impl Strategy<Value = Levels> {
        (0..4_u8, 0..5_u8).prop_map(|(position, direction)| Levels { position, direction })
    }

    proptest! {
        #[test]
        fn constant_radiance_is_constant_to_the_rim(levels in levels(), q in point()) {
            let sampler = sampler(levels, |_| [1.0, 0.5, 3.0]);
            for found in [sampler.box_value(q), sampler.multilinear(q)] {
                for (a, b) in found.into_iter().zip([1.0, 0.5, 3.0]) {
                    // Rounding of the coefficients, times 1/f of at most 4.
                    prop_assert!((a - b).abs() < 3e-5, "{found:?}");
                }
            }
        }

        #[test]
        fn inside_the_rim_a_box_is_the_trees_value(
            levels in levels(), q in point(), kept in 0.0..1.0f64,
        ) {
            let tree = TreeBuilder::from_grid(&grid(levels, wild)).finish();
            let count = (kept * tree.len() as f64) as usize;
            let tree = tree.compressed(Keep::Count(count)).0;
            let sampler = Sampler::new(&tree);
            let cell = [q[2], q[3]].map(|x| sampler.sides[1].cell(x));
            prop_assume!(sampler.rim.inverse(cell) == 1.0);
            for (a, b) in sampler.box_value(q).into_iter().zip(tree.eval(q)) {
                prop_assert!((f64::from(a) - b).abs() < 1e-5, "{a} {b}");
            }
        }
    }

    #[test]
    fn a_direction_outside_the_hemisphere_counts_as_the_horizon() {
        let levels = Levels { position: 2, direction: 4 };
        let sampler = sampler(levels, wild);
        let rim = [0.3, 0.8, 0.5 + 0.5 * 0.6, 0.5 - 0.5 * 0.8];
        let past = [0.3, 0.8, 0.5 + 0.501 * 0.6, 0.5 - 0.501 * 0.8];
        assert_eq!(sampler.box_value(rim), sampler.box_value(past));
        assert_eq!(sampler.multilinear([0.5, 0.5, 0.0, 0.0]).map(f32::is_finite), [true; 3]);
    }

    #[test]
    fn the_coarsest_tree_is_one_value() {
        let sampler = sampler(Levels::isotropic(0), |_| [2.0; 3]);
        assert!((sampler.multilinear([0.1, 0.9, 0.5, 0.5])[0] - 2.0).abs() < 1e-6, "2");
        assert!(sampler.bytes() < 8192, "{} bytes", sampler.bytes());
    }
}
