//! How far two trees are apart.

use super::Tree;
use crate::{CHILDREN, children};

/// How far two radiances are apart.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Difference {
    /// ‖a − b‖² over the unit hypercube, all channels together.
    pub squared: f64,
    /// The largest |a − b| of any channel anywhere, W sr⁻¹ m⁻².
    pub largest: f64,
}

impl Tree {
    /// How far `self` and `other` are apart.
    ///
    /// # Panics
    ///
    /// If their levels differ.
    #[must_use]
    pub fn difference(&self, other: &Self) -> Difference {
        assert_eq!(self.levels, other.levels, "trees of equal levels");
        let mut difference = Difference::default();
        let start = |tree: &Self| Part {
            node: (!tree.nodes.is_empty()).then_some(0),
            smooth: tree.root.map(f64::from),
        };
        self.add_difference(other, [start(self), start(other)], 0, &mut difference);
        difference
    }

    fn add_difference(&self, other: &Self, parts: [Part; 2], depth: u8, sum: &mut Difference) {
        let [a, b] = parts;
        if a.node.is_none() && b.node.is_none() {
            for (a, b) in a.smooth.iter().zip(b.smooth) {
                sum.squared += (a - b).powi(2);
                sum.largest = sum.largest.max((a - b).abs() * self.levels.scale(depth));
            }
            return;
        }
        let split = self.levels.split(depth);
        let (a, b) = (self.children_of(a, split), other.children_of(b, split));
        for m in children(split) {
            self.add_difference(other, [a[m], b[m]], depth + 1, sum);
        }
    }

    fn children_of(&self, part: Part, split: usize) -> [Part; CHILDREN] {
        let smooth = match part.node {
            Some(i) => self.push_node(i, part.smooth, split),
            // A constant's are equal: 2^(−|split|/2) of the parent's.
            None => {
                let scale = f64::from(1_u32 << split.count_ones()).sqrt().recip();
                [part.smooth.map(|x| x * scale); CHILDREN]
            }
        };
        std::array::from_fn(|m| Part {
            node: part.node.and_then(|i| self.nodes[i].child(m)),
            smooth: smooth[m],
        })
    }
}

/// A cell of a tree.
#[derive(Clone, Copy)]
struct Part {
    node: Option<usize>,
    smooth: [f64; 3],
}

#[cfg(test)]
mod tests {
    use crate::grid::Grid;
    use crate::{Keep, Levels, TreeBuilder};

    #[test]
    fn it_is_that_of_the_cells() {
        let levels = Levels { position: 2, direction: 1 };
        let texel = |d: usize, p: usize| [(d * p) as f32, (p % 5) as f32, d as f32 - 1.5];
        let image = |d: usize| Some((0..16).map(|p| texel(d, p)).collect());
        let tree = TreeBuilder::from_grid(&Grid::from_images(levels, (0..4).map(image).collect()))
            .finish();
        let (other, report) = tree.compressed(Keep::RelativeError(0.3));
        let found = tree.difference(&other);
        let dropped = report.relative_error.powi(2) * tree.norm_squared();
        assert!((found.squared - dropped).abs() < 1e-9 * dropped, "{found:?} {dropped}");
        let (a, b) = (tree.to_grid(), other.to_grid());
        let cells = (0..64).map(|i| [i & 3, i >> 2 & 3, i >> 4 & 1, i >> 5]);
        let largest = cells.flat_map(|m| (0..3).map(move |c| (m, c)));
        let largest = largest.map(|(m, c)| (a.mean(m)[c] - b.mean(m)[c]).abs());
        let largest = f64::from(largest.fold(0.0, f32::max));
        assert!((found.largest - largest).abs() < 1e-5, "{found:?} {largest}");
        assert_eq!(tree.difference(&tree).largest, 0.0);
    }
}
