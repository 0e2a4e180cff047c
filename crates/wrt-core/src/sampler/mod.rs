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
use bricks::{Bricks, Texel};
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
/// others stands in for them. (κ, λ) outside the UDC are moved to its rim.
#[derive(Clone, Debug)]
pub struct Sampler {
    levels: Levels,
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
        let bricks = Bricks::new(&Leaves::new(tree));
        Self { levels, rim, bricks }
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
    pub fn box_value(&self, q: [f64; 4]) -> Rgb {
        let Levels { position, direction } = self.levels;
        let [u, v] = [q[0], q[1]].map(|x| cell_of(x, position));
        let mut cell = [q[2], q[3]].map(|x| cell_of(x, direction));
        let mut inverse = 1.0;
        if !self.rim.is_around([q[2], q[3]], rim::Reach::Cell) {
            let (kappa, lambda) = rim::inside([q[2], q[3]]);
            let at_rim = [kappa, lambda].map(|x| cell_of(x, direction));
            (cell, inverse) = self.rim.nearest(at_rim);
        }
        let [k, l] = cell;
        let Texel([r, g, b, _]) = *self.texel([u, v, k, l]);
        [r * inverse, g * inverse, b * inverse]
    }

    /// The tree's mean over the finest cell **m**.
    #[inline]
    fn texel(&self, m: [u32; 4]) -> &Texel {
        self.bricks.at(std::array::from_fn(|d| self.bricks.axis(d, m[d])))
    }

    /// The [`multilinear`](Self::multilinear) look-ups of a packet of hits.
    ///
    /// # Panics
    ///
    /// If the lengths differ.
    pub fn multilinear_batch(&self, points: &[[f64; 4]], out: &mut [Rgb]) {
        assert_eq!(points.len(), out.len(), "a value for each point");
        for (out, &q) in out.iter_mut().zip(points) {
            *out = self.multilinear(q);
        }
    }
}

/// Which of 2^`level` cells holds `x`.
fn cell_of(x: f64, level: u8) -> u32 {
    let cells = 1_u32 << level;
    ((x * f64::from(cells)) as u32).min(cells - 1)
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
            let cell = [cell_of(q[2], levels.direction), cell_of(q[3], levels.direction)];
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
        assert!(sampler.bytes() < 4096, "{} bytes", sampler.bytes());
    }

    #[test]
    fn a_batch_is_its_look_ups() {
        let sampler = sampler(Levels { position: 2, direction: 3 }, wild);
        let points: Vec<[f64; 4]> =
            (0..100).map(|i| [3, 5, 7, 11].map(|k| f64::from(i * k % 100) / 100.0)).collect();
        let mut found = vec![[0.0; 3]; points.len()];
        sampler.multilinear_batch(&points, &mut found);
        for (found, &q) in found.iter().zip(&points) {
            assert_eq!(*found, sampler.multilinear(q), "{q:?}");
        }
    }
}
