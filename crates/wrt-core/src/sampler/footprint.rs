//! Look-ups of more than a cell: the tree is its own mip chain.

use super::Sampler;
use crate::Tree;
use crate::grid::Rgb;

/// A radiance at all levels of its tree, for look-ups whose footprint may be larger
/// than a finest cell.
#[derive(Clone, Debug)]
pub struct MipSampler {
    /// From the root, of one cell, on.
    coarser: Vec<Sampler>,
    finest: Sampler,
}

impl MipSampler {
    /// Prepares all levels of `tree`, for at most a fifteenth more memory than the
    /// finest where all four dimensions split, a third where two do.
    #[must_use]
    pub fn new(tree: &Tree) -> Self {
        let coarser = (0..tree.levels().depth()).map(|depth| Sampler::new(&tree.truncated(depth)));
        Self { coarser: coarser.collect(), finest: Sampler::new(tree) }
    }

    /// The finest level.
    #[must_use]
    pub fn finest(&self) -> &Sampler {
        &self.finest
    }

    /// Bytes it occupies.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.coarser.iter().chain([&self.finest]).map(Sampler::bytes).sum()
    }

    /// Radiance around (u, v, κ, λ), for a look-up that stands for a region of the
    /// sides `footprint`: of (u, v), then of (κ, λ), each a part of the unit square.
    ///
    /// Multilinear on the two levels whose cells are as large as the footprint, in
    /// position or in direction, whichever needs the coarser, and linear between
    /// them: continuous in the footprint too. Where no cell is smaller than the
    /// footprint it is the finest level's [`Sampler::multilinear`].
    #[must_use]
    pub fn value(&self, q: [f64; 4], footprint: [f64; 2]) -> Rgb {
        let levels = self.finest.levels();
        let finest = f64::from(levels.depth());
        // The depth at which a cell is of that size; from the dimension's own last
        // level on its cells stay as they are, which the last step spreads over.
        let depth = |size: f64, level: u8| {
            let level = f64::from(level);
            // A NaN, too, gets the finest.
            let wanted = -size.max(f64::MIN_POSITIVE).log2();
            let last = level - 1.0;
            if wanted >= level || level == 0.0 {
                finest
            } else if wanted > last {
                last + (wanted - last) * (finest - last)
            } else {
                wanted.max(0.0)
            }
        };
        let depth = depth(footprint[0], levels.position).min(depth(footprint[1], levels.direction));
        let coarse = depth as usize;
        let share = (depth - coarse as f64) as f32;
        let at = |depth: usize| self.coarser.get(depth).unwrap_or(&self.finest).multilinear(q);
        let low = at(coarse);
        if share == 0.0 {
            return low;
        }
        let high = at(coarse + 1);
        std::array::from_fn(|c| low[c] + share * (high[c] - low[c]))
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{grid, point, wild};
    use super::*;
    use crate::{Levels, TreeBuilder};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_small_footprint_is_the_finest_look_up(q in point(), size in 0.0..0.06f64) {
            let levels = Levels { position: 3, direction: 4 };
            let mip = MipSampler::new(&TreeBuilder::from_grid(&grid(levels, wild)).finish());
            prop_assert_eq!(mip.value(q, [2.0 * size, size]), mip.finest().multilinear(q));
        }

        #[test]
        fn a_small_step_of_the_footprint_makes_a_small_change(
            q in point(), log in -6.0..1.0f64, other in -6.0..1.0f64,
        ) {
            let levels = Levels::isotropic(3);
            let mip = MipSampler::new(&TreeBuilder::from_grid(&grid(levels, wild)).finish());
            let [a, b] = [0.0, 1e-5].map(|d| mip.value(q, [(log + d).exp2(), (other + d).exp2()]));
            for (a, b) in a.into_iter().zip(b) {
                // At most the range, 8 here with 1/f, for each level.
                prop_assert!((a - b).abs() < 8.0 * 2e-5 + 1e-6, "{a} {b}");
            }
        }
    }

    #[test]
    fn constant_radiance_is_constant_at_all_levels() {
        let levels = Levels { position: 2, direction: 5 };
        let tree = TreeBuilder::from_grid(&grid(levels, |_| [1.0, 0.5, 3.0])).finish();
        let mip = MipSampler::new(&tree);
        for size in [0.001, 0.04, 0.3, 1.0, 5.0] {
            for q in [[0.5; 4], [0.1, 0.9, 0.3, 0.8], [0.0, 1.0, 0.5, 0.01]] {
                for (a, b) in mip.value(q, [size; 2]).into_iter().zip([1.0, 0.5, 3.0]) {
                    assert!((a - b).abs() < 3e-5, "{q:?} {size}: {a}");
                }
            }
        }
    }

    /// A checkerboard of finest cells is grey from afar.
    #[test]
    fn a_large_footprint_averages() {
        let levels = Levels { position: 5, direction: 0 };
        let odd = |x: f64| (x * 32.0) as u32 & 1;
        let board = |[u, v, ..]: [f64; 4]| [f64::from(odd(u) ^ odd(v)); 3];
        let mip = MipSampler::new(&TreeBuilder::from_grid(&grid(levels, board)).finish());
        for i in 0..50 {
            let q = [0.02 * f64::from(i), 0.01 * f64::from(i), 0.5, 0.5];
            let grey = mip.value(q, [1.0 / 16.0, 0.0])[0];
            assert!((grey - 0.5).abs() < 1e-6, "{q:?}: {grey}");
        }
    }
}
