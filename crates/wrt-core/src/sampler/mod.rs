//! A tree made immutable for look-ups: the 4-D texture that rays sample (§8
//! asks for it).

mod multilinear;
mod rim;

use crate::grid::Rgb;
use crate::{Levels, Tree, children};
use rim::Rim;

/// A radiance to be looked up by many threads.
///
/// All coefficients are pushed down once, so that a look-up only descends: a
/// mask and a count of its bits a level, then the mean of the largest cell on
/// which the tree is constant.
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
    /// Breadth first, as in the tree; none if it is constant.
    nodes: Vec<Branch>,
    /// Mean radiance, node by node in order of m′.
    leaves: Vec<Rgb>,
}

/// A node with each child either a node or a leaf.
#[derive(Clone, Copy, Debug)]
struct Branch {
    child_mask: u16,
    leaf_mask: u16,
    first_child: u32,
    first_leaf: u32,
}

/// What lies below a node.
enum Below {
    Branch(usize),
    Leaf(usize),
}

impl Sampler {
    /// Prepares `tree` for look-ups.
    ///
    /// # Panics
    ///
    /// If it has 2³² leaves, of 48 GiB together.
    #[must_use]
    pub fn new(tree: &Tree) -> Self {
        let levels = tree.levels();
        let mut smooth = vec![[0.0; 3]; tree.nodes().len().max(1)];
        smooth[0] = tree.root().map(f64::from);
        let mut nodes = Vec::with_capacity(tree.nodes().len());
        let mut leaves = Vec::new();
        if tree.nodes().is_empty() {
            leaves.push(tree.root());
        }
        // Where the current depth ends: children follow their parents' depth.
        let (mut depth, mut end, mut next) = (0, 1, 1);
        for (i, node) in tree.nodes().iter().enumerate() {
            if i == end {
                (depth, end) = (depth + 1, next);
            }
            next += node.child_mask.count_ones() as usize;
            let split = levels.split(depth);
            let values = tree.push_node(i, smooth[i], split);
            let scale = levels.scale(depth + 1);
            let first_leaf = u32::try_from(leaves.len()).expect("fewer than 2³² leaves");
            let mut leaf_mask = 0;
            for m_prime in children(split) {
                match node.child(m_prime) {
                    Some(child) => smooth[child] = values[m_prime],
                    None => {
                        leaf_mask |= 1 << m_prime;
                        leaves.push(values[m_prime].map(|x| (x * scale) as f32));
                    }
                }
            }
            let (child_mask, first_child) = (node.child_mask, node.first_child);
            nodes.push(Branch { child_mask, leaf_mask, first_child, first_leaf });
        }
        Self { levels, rim: Rim::new(levels.direction), nodes, leaves }
    }

    /// Its levels.
    #[must_use]
    pub fn levels(&self) -> Levels {
        self.levels
    }

    /// Bytes it occupies.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of_val(&self.nodes[..]) + size_of_val(&self.leaves[..]) + self.rim.bytes()
    }

    /// The mean radiance over the finest cell around (u, v, κ, λ): piecewise
    /// constant. Coordinates past 0 or 1 count as 0 or 1.
    #[must_use]
    pub fn box_value(&self, q: [f64; 4]) -> Rgb {
        let (kappa, lambda) = rim::inside([q[2], q[3]]);
        let Levels { position, direction } = self.levels;
        let [u, v] = [q[0], q[1]].map(|x| cell_of(x, position));
        let cell = [kappa, lambda].map(|x| cell_of(x, direction));
        let ([k, l], inverse) = self.rim.nearest(cell);
        let mean = self.leaves[self.leaf(self.code([u, v, k, l]))];
        mean.map(|x| x * inverse)
    }

    /// The halves to take from the root to the finest cell **m**, four bits a
    /// depth, the root's on top of `4 · depth` bits. Dimensions that stop
    /// splitting earlier have zeros at the end, as m′ does.
    fn code(&self, m: [u32; 4]) -> u64 {
        let depth = self.levels.depth();
        let (p, d) = (depth - self.levels.position, depth - self.levels.direction);
        spread(m[0] << p) | spread(m[1] << p) << 1 | spread(m[2] << d) << 2 | spread(m[3] << d) << 3
    }

    /// The leaf that holds the finest cell with this [`code`](Self::code).
    fn leaf(&self, code: u64) -> usize {
        let mut below = if self.nodes.is_empty() { Below::Leaf(0) } else { Below::Branch(0) };
        let mut shift = 4 * u32::from(self.levels.depth());
        loop {
            match below {
                Below::Leaf(leaf) => return leaf,
                Below::Branch(node) => {
                    shift -= 4;
                    below = self.nodes[node].below((code >> shift & 15) as usize);
                }
            }
        }
    }
}

impl Branch {
    fn below(&self, m_prime: usize) -> Below {
        let before = |mask: u16| (mask & ((1 << m_prime) - 1)).count_ones();
        if self.child_mask >> m_prime & 1 == 1 {
            Below::Branch((self.first_child + before(self.child_mask)) as usize)
        } else {
            Below::Leaf((self.first_leaf + before(self.leaf_mask)) as usize)
        }
    }
}

/// Which of 2^`level` cells holds `x`.
fn cell_of(x: f64, level: u8) -> u32 {
    let cells = 1_u32 << level;
    ((x * f64::from(cells)) as u32).min(cells - 1)
}

/// The low 16 bits of `x`, three zeros between each two.
fn spread(x: u32) -> u64 {
    let mut x = u64::from(x);
    x = (x | x << 24) & 0x0000_00ff_0000_00ff;
    x = (x | x << 12) & 0x000f_000f_000f_000f;
    x = (x | x << 6) & 0x0303_0303_0303_0303;
    (x | x << 3) & 0x1111_1111_1111_1111
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
    fn the_coarsest_tree_is_one_leaf() {
        let sampler = sampler(Levels::isotropic(0), |_| [2.0; 3]);
        assert_eq!((sampler.nodes.len(), sampler.leaves.len()), (0, 1));
        assert!((sampler.multilinear([0.1, 0.9, 0.5, 0.5])[0] - 2.0).abs() < 1e-6, "2");
    }
}
