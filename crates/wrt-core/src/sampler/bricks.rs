//! All finest cells in bricks of 4⁴, blocks that are constant in a single value.
//!
//! A table has an entry for each of the coarsest blocks; an entry names a brick,
//! 256 indices of a byte, and where the values start that they count from. Constant
//! blocks share bricks of zeros, so that a look-up has no branch: entry, index,
//! value. Where a table of all bricks would be large, indices of coarser bricks
//! lead to entries of finer ones instead.

mod build;

use glam::Vec4;

/// Levels that a brick takes of each dimension.
const BITS: u32 = 2;
const CELLS: usize = 1 << (4 * BITS);

/// Cells of a brick that share their direction.
const ROW: usize = 1 << (2 * BITS);

/// The table has at most 2^`TABLE_BITS` entries of 8 bytes.
const TABLE_BITS: u32 = 18;

/// Cells of a brick by the index of its value.
type Brick = [u8; CELLS];

/// The brick of zeros for constant blocks whose neighbours upwards have the same
/// value: all that a multilinear look-up reads from there on.
const FLAT: u32 = 0;

/// The brick of zeros for other constant blocks.
const CONSTANT: u32 = 1;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Entry {
    brick: u32,
    base: u32,
}

/// One step of the descent.
#[derive(Clone, Debug)]
struct Stage {
    entries: Vec<Entry>,
    /// The first two are all zeros.
    bricks: Vec<Brick>,
}

/// A place along one dimension, or several.
#[derive(Clone, Copy, Debug)]
struct Axis {
    /// What it adds to the table's index.
    table: u32,
    /// What it adds to the cell of a finest brick.
    cell: u32,
}

/// The layout.
///
/// A value is red, green, blue and 1. Where there is one stage, as there nearly always
/// is, the UDC's rim is in the values already: a direction cell of which the part f
/// lies inside has its mean divided by f, and a cell without a say is all zeros. So the
/// fourth component of a sum over cells is the weight of those that count.
#[derive(Clone, Debug)]
pub(super) struct Bricks {
    /// From the table on: none where the table is that of the finest.
    coarser: Vec<Stage>,
    finest: Stage,
    /// And as many more as a brick may count, so that no index needs to be looked at.
    values: Vec<Vec4>,
    /// Levels that the stages take of each dimension.
    shift: u32,
    /// By dimension: bits of the table's index below its own.
    strides: [u32; 4],
    /// By dimension and offset, where there is one stage; the last stands there twice.
    axes: [Vec<Axis>; 4],
}

impl Bricks {
    /// Whether the rim has been seen to: see the type.
    #[inline]
    pub(super) fn knows_the_rim(&self) -> bool {
        self.coarser.is_empty()
    }

    pub(super) fn bytes(&self) -> usize {
        let stage = |s: &Stage| size_of_val(&s.entries[..]) + size_of_val(&s.bricks[..]);
        let coarser: usize = self.coarser.iter().map(stage).sum();
        let axes: usize = self.axes.iter().map(|axis| size_of_val(&axis[..])).sum();
        coarser + stage(&self.finest) + size_of_val(&self.values[..]) + axes
    }

    /// The value of the finest cell **m**.
    #[inline]
    pub(super) fn at(&self, m: [u32; 4]) -> Vec4 {
        if !self.coarser.is_empty() {
            return self.at_deep(m);
        }
        let axis = |d: usize| self.axes[d][m[d] as usize];
        let (u, v, k, l) = (axis(0), axis(1), axis(2), axis(3));
        let entry = self.finest.entries[(u.table + v.table + k.table + l.table) as usize];
        self.value(entry, u.cell | v.cell | k.cell | l.cell)
    }

    #[cold]
    fn at_deep(&self, m: [u32; 4]) -> Vec4 {
        let cell = (0..4).fold(0, |cell, d| cell | self.axis(d, m[d]).cell);
        self.value(self.finest.entries[self.descend(m) as usize], cell)
    }

    /// The sum over the cells at `lows` and the next ones in each dimension, with weights
    /// of (u, v) and of (κ, λ), u and κ fastest; those of either add up to 1. Only
    /// where there is one stage.
    #[inline]
    pub(super) fn blend(&self, lows: [u32; 4], uv: [f32; 4], kl: [f32; 4]) -> Vec4 {
        let axes = |d: usize| [0, 1].map(|i| self.axes[d][lows[d] as usize + i]);
        let (uvs, kls) = (pairs(axes(0), axes(1)), pairs(axes(2), axes(3)));
        let entry = |uv: Axis, kl: Axis| self.finest.entries[(uv.table + kl.table) as usize];
        let first = entry(uvs[0], kls[0]);
        if first.brick == FLAT {
            return self.values[first.base as usize];
        }
        let mut sum = Vec4::ZERO;
        let places = uvs.map(|uv| uv.cell as usize % ROW);
        if uvs[0].table == uvs[3].table {
            let mut last = (kls[0].table, self.block(first));
            for (kl, weight) in kls.into_iter().zip(kl) {
                if kl.table != last.0 {
                    last = (kl.table, self.block(entry(uvs[0], kl)));
                }
                let (brick, values) = last.1;
                let row = row(brick, kl);
                let value = |i: usize| uv[i] * values[usize::from(row[places[i]])];
                sum += weight * ((value(0) + value(1)) + (value(2) + value(3)));
            }
        } else {
            for (kl, weight) in kls.into_iter().zip(kl) {
                let value = |i: usize| {
                    let (brick, values) = self.block(entry(uvs[i], kl));
                    uv[i] * values[usize::from(row(brick, kl)[places[i]])]
                };
                sum += weight * ((value(0) + value(1)) + (value(2) + value(3)));
            }
        }
        sum
    }

    #[inline]
    fn value(&self, entry: Entry, cell: u32) -> Vec4 {
        let (brick, values) = self.block(entry);
        values[usize::from(brick[cell as usize % CELLS])]
    }

    /// An entry's brick, and the values that it counts.
    #[inline]
    fn block(&self, entry: Entry) -> (&Brick, &[Vec4; CELLS]) {
        let values = self.values[entry.base as usize..].first_chunk();
        (&self.finest.bricks[entry.brick as usize], values.expect("padded"))
    }

    /// Where offset `m` along dimension `d` is.
    fn axis(&self, d: usize, m: u32) -> Axis {
        let cell = (m & ((1 << BITS) - 1)) << (BITS * d as u32);
        Axis { table: (m >> self.shift) << self.strides[d], cell }
    }

    /// The finest entry that stages of bricks lead to.
    #[cold]
    fn descend(&self, m: [u32; 4]) -> u32 {
        let mut at = (0..4).map(|d| self.axis(d, m[d]).table).sum::<u32>();
        let mut shift = self.shift;
        for stage in &self.coarser {
            shift -= BITS;
            let part = |d: usize| (m[d] >> shift & 3) << (BITS * d as u32);
            let Entry { brick, base } = stage.entries[at as usize];
            let cell = part(0) | part(1) | part(2) | part(3);
            at = base + u32::from(stage.bricks[brick as usize][cell as usize % CELLS]);
        }
        at
    }
}

/// A brick's cells of one direction.
#[inline]
fn row(brick: &Brick, kl: Axis) -> &[u8; ROW] {
    &brick.as_chunks().0[kl.cell as usize / ROW % ROW]
}

/// All four, the first's fastest.
#[inline]
fn pairs(first: [Axis; 2], second: [Axis; 2]) -> [Axis; 4] {
    std::array::from_fn(|i| {
        let (a, b) = (first[i & 1], second[i >> 1]);
        Axis { table: a.table + b.table, cell: a.cell | b.cell }
    })
}

#[cfg(test)]
mod tests {
    use super::super::leaves::Leaves;
    use super::super::rim::Rim;
    use super::super::tests::{grid, wild};
    use super::build::value;
    use super::*;
    use crate::{CHILDREN, Cell, Levels, TreeBuilder};

    #[test]
    fn every_cell_has_its_leafs_value_over_its_part_inside_the_udc() {
        for (position, direction) in [(0, 0), (1, 3), (3, 1), (2, 4), (3, 3)] {
            let levels = Levels { position, direction };
            let tree = TreeBuilder::from_grid(&grid(levels, wild)).finish();
            let rim = Rim::new(direction);
            for kept in [1, 10, 1000, usize::MAX] {
                let leaves = Leaves::new(&tree.compressed(crate::Keep::Count(kept)).0);
                let bricks = Bricks::new(&leaves, &rim);
                let (p, d) = (1 << position, 1 << direction);
                for i in 0..p * p * d * d {
                    let m = [i % p, i / p % p, i / (p * p) % d, i / (p * p * d)];
                    let expected =
                        value(leaves.mean(leaves.leaf(m).index), rim.inverse([m[2], m[3]]));
                    assert_eq!(bricks.at(m), expected, "{m:?}");
                }
            }
        }
    }

    /// A few finest cells of 2⁴⁸: stages of bricks, and memory for what is there.
    #[test]
    fn deep_trees_are_looked_up_stage_by_stage() {
        let levels = Levels { position: 10, direction: 14 };
        let mut builder = TreeBuilder::new(levels);
        builder.add_root([0.5; 3]);
        let m = [5, 700, 9000, 12345];
        for depth in [0, 3, 9, 13] {
            let shift = |level: u8| u32::from(level.saturating_sub(depth));
            let (p, d) = (shift(levels.position), shift(levels.direction));
            let cell = [m[0] >> p, m[1] >> p, m[2] >> d, m[3] >> d];
            let mut b = [[0.0; 3]; CHILDREN];
            for (nu, b) in b.iter_mut().enumerate() {
                if nu & !levels.split(depth) == 0 {
                    *b = [1.0 + nu as f64, 2.0, f64::from(depth)];
                }
            }
            builder.add_node(Cell { depth, m: cell.map(|m| m as u16) }, &b);
        }
        let leaves = Leaves::new(&builder.finish());
        let bricks = Bricks::new(&leaves, &Rim::new(levels.direction));
        assert!(!bricks.knows_the_rim(), "more than one stage");
        assert!(bricks.bytes() < 4 << 20, "{} bytes", bricks.bytes());
        let assert_same = |m: [u32; 4]| {
            assert_eq!(bricks.at(m), value(leaves.mean(leaves.leaf(m).index), 1.0), "{m:?}");
        };
        for step in [0_u32, 1, 2, 3, 5, 100, 511] {
            for d in 0..4 {
                let mut near = m;
                near[d] ^= step;
                assert_same(near);
            }
        }
        let last = [1023, 1023, 16383, 16383];
        for m in [[0; 4], last] {
            assert_same(m);
        }
    }

    /// What blends read from a block that is called flat on.
    #[test]
    fn flat_blocks_have_neighbours_of_their_value() {
        let levels = Levels { position: 5, direction: 0 };
        let lit = |[u, v, ..]: [f64; 4]| [f64::from(u8::from(u + v > 1.5)); 3];
        let tree = TreeBuilder::from_grid(&grid(levels, lit)).finish();
        let bricks = Bricks::new(&Leaves::new(&tree), &Rim::new(levels.direction));
        let mut flat = 0;
        for (at, entry) in bricks.finest.entries.iter().enumerate() {
            if entry.brick != FLAT {
                continue;
            }
            flat += 1;
            let low = [0, 3].map(|below| (at as u32 >> below & 7) << BITS);
            for i in 0..25 {
                let m = [(low[0] + i % 5).min(31), (low[1] + i / 5).min(31), 0, 0];
                assert_eq!(bricks.at(m), bricks.values[entry.base as usize], "{low:?} {m:?}");
            }
        }
        assert!((20..60).contains(&flat), "{flat} of 64 blocks");
    }
}
