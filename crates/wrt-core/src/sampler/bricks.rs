//! All finest cells in bricks of 4⁴, blocks that are constant in a single value.
//!
//! A table has an entry for each of the coarsest blocks; an entry names a brick,
//! 256 indices of a byte, and where the values start that they count from. Constant
//! blocks share one brick of zeros, so that a look-up has no branch: entry, index,
//! value. Where a table of all bricks would be large, indices of coarser bricks
//! lead to entries of finer ones instead.

use super::leaves::Leaves;
use crate::Levels;
use crate::grid::Rgb;
use std::collections::HashMap;

/// Levels that a brick takes of each dimension.
const BITS: u32 = 2;
const CELLS: usize = 1 << (4 * BITS);

/// The table has at most 2^`TABLE_BITS` entries of 8 bytes.
const TABLE_BITS: u32 = 18;

#[derive(Clone, Copy, Debug)]
struct Entry {
    brick: u32,
    base: u32,
}

/// One step of the descent.
#[derive(Clone, Debug)]
struct Stage {
    entries: Vec<Entry>,
    /// The first is all zeros.
    bricks: Vec<[u8; CELLS]>,
}

/// Red, green, blue and 0: one load of 16 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(16))]
pub(super) struct Texel(pub(super) [f32; 4]);

/// The layout.
#[derive(Clone, Debug)]
pub(super) struct Bricks {
    /// From the table on, at least one.
    stages: Vec<Stage>,
    values: Vec<Texel>,
    /// Levels that the stages take of each dimension.
    shift: u32,
    /// By dimension: bits of the table's index below its own.
    strides: [u32; 4],
}

impl Bricks {
    /// # Panics
    ///
    /// If there are 2³² values, of 64 GiB together.
    pub(super) fn new(leaves: &Leaves) -> Self {
        let levels = leaves.levels();
        let mut count = 1;
        while table_bits(levels, count) > TABLE_BITS {
            count += 1;
        }
        let stage = Stage { entries: Vec::new(), bricks: vec![[0; CELLS]] };
        let shift = BITS * count;
        let bits = |level: u8| u32::from(level).saturating_sub(shift);
        let (p, k) = (bits(levels.position), bits(levels.direction));
        let mut bricks = Self {
            stages: vec![stage; count as usize],
            values: Vec::new(),
            shift,
            strides: [0, p, 2 * p, 2 * p + k],
        };
        let side = |level: u8| 1_u32 << u32::from(level).saturating_sub(shift);
        let (p, d) = (side(levels.position), side(levels.direction));
        let mut constants = vec![HashMap::new(); count as usize];
        for l in 0..d {
            for k in 0..d {
                for v in 0..p {
                    for u in 0..p {
                        let entry = bricks.entry(
                            leaves,
                            0,
                            [u, v, k, l].map(|m| m << shift),
                            &mut constants,
                        );
                        bricks.stages[0].entries.push(entry);
                    }
                }
            }
        }
        bricks
    }

    pub(super) fn bytes(&self) -> usize {
        let stage = |s: &Stage| size_of_val(&s.entries[..]) + size_of_val(&s.bricks[..]);
        self.stages.iter().map(stage).sum::<usize>() + size_of_val(&self.values[..])
    }

    /// How many levels the stages from `stage` on take of each dimension.
    fn below(&self, stage: usize) -> u32 {
        BITS * (self.stages.len() - stage) as u32
    }

    /// The entry of `stage` for the block that starts at **m**; `constants` has, by
    /// stage and leaf, those that have been needed.
    fn entry(
        &mut self,
        leaves: &Leaves,
        stage: usize,
        m: [u32; 4],
        constants: &mut [HashMap<u32, Entry>],
    ) -> Entry {
        let below = self.below(stage);
        let leaf = leaves.leaf(m);
        let high = leaves.extent(leaf, m).1;
        if (0..4).all(|d| high[d] >= (m[d] + (1 << below)).min(1 << leaves.level(d))) {
            if let Some(&entry) = constants[stage].get(&leaf.index) {
                return entry;
            }
            let base = self.constant(stage, leaves.mean(leaf));
            let entry = Entry { brick: 0, base };
            constants[stage].insert(leaf.index, entry);
            return entry;
        }
        let size = below - BITS;
        let cells = (0..CELLS).map(|cell| {
            let at = |d: usize| m[d] + ((cell as u32 >> (BITS * d as u32) & 3) << size);
            (cell, [at(0), at(1), at(2), at(3)])
        });
        let cells = cells.filter(|(_, at)| (0..4).all(|d| at[d] >> leaves.level(d) == 0));
        let mut brick = [0; CELLS];
        let is_finest = stage + 1 == self.stages.len();
        let base = if is_finest {
            // By leaf, in order of appearance: at most 256, so that a byte counts them.
            let mut found: Vec<u32> = Vec::new();
            let base = self.values.len();
            for (cell, at) in cells {
                let leaf = leaves.leaf(at);
                let known = found.iter().rposition(|&index| index == leaf.index);
                brick[cell] = known.unwrap_or_else(|| {
                    found.push(leaf.index);
                    self.values.push(texel(leaves.mean(leaf)));
                    found.len() - 1
                }) as u8;
            }
            base
        } else {
            let mut found = Vec::<Entry>::new();
            for (cell, at) in cells {
                let entry = self.entry(leaves, stage + 1, at, constants);
                let same = |other: &Entry| (other.brick, other.base) == (entry.brick, entry.base);
                brick[cell] = found.iter().rposition(same).unwrap_or_else(|| {
                    found.push(entry);
                    found.len() - 1
                }) as u8;
            }
            let base = self.stages[stage + 1].entries.len();
            self.stages[stage + 1].entries.extend(found);
            base
        };
        let bricks = &mut self.stages[stage].bricks;
        bricks.push(brick);
        Entry { brick: (bricks.len() - 1) as u32, base: number(base) }
    }

    /// Where a constant block's indices of `stage`, all 0, count from.
    fn constant(&mut self, stage: usize, mean: Rgb) -> u32 {
        if stage + 1 == self.stages.len() {
            self.values.push(texel(mean));
            number(self.values.len() - 1)
        } else {
            let base = self.constant(stage + 1, mean);
            let entries = &mut self.stages[stage + 1].entries;
            entries.push(Entry { brick: 0, base });
            number(entries.len() - 1)
        }
    }

    /// Where offset `m` along dimension `d` is.
    #[inline]
    pub(super) fn axis(&self, d: usize, m: u32) -> Axis {
        let shift = self.shift;
        Axis { table: (m >> shift) << self.strides[d], cell: (m & 3) << (BITS * d as u32), m }
    }

    /// The value at these places along u, v, κ and λ.
    #[inline]
    pub(super) fn at(&self, axes: [Axis; 4]) -> &Texel {
        let [u, v, k, l] = axes;
        let table = u.table + v.table + k.table + l.table;
        let cell = u.cell | v.cell | k.cell | l.cell;
        let value = match &self.stages[..] {
            // Nearly always: up to 64⁴ cells, or as many of other proportions.
            [only] => only.step(table, cell),
            stages => descend(stages, table, axes.map(|axis| axis.m)),
        };
        &self.values[value as usize]
    }
}

impl Bricks {
    /// The values at both places along each of u, v, κ and λ, u fastest.
    #[inline]
    pub(super) fn corners(&self, ends: [[Axis; 2]; 4]) -> [&Texel; 16] {
        let corner = |i: usize| -> [Axis; 4] { std::array::from_fn(|d| ends[d][i >> d & 1]) };
        let is_one_block = ends.iter().all(|[low, high]| low.table == high.table);
        if let ([only], true) = (&self.stages[..], is_one_block) {
            let Entry { brick, base } =
                only.entries[corner(0).map(|a| a.table).iter().sum::<u32>() as usize];
            if brick == 0 {
                return [&self.values[base as usize]; 16];
            }
            let brick = &only.bricks[brick as usize];
            return std::array::from_fn(|i| {
                let cell = corner(i).iter().fold(0, |cell, axis| cell | axis.cell);
                &self.values[base as usize + usize::from(brick[cell as usize % CELLS])]
            });
        }
        std::array::from_fn(|i| self.at(corner(i)))
    }
}

impl Stage {
    #[inline]
    fn step(&self, entry: u32, cell: u32) -> u32 {
        let Entry { brick, base } = self.entries[entry as usize];
        base + u32::from(self.bricks[brick as usize][cell as usize % CELLS])
    }
}

/// The value that stages of bricks lead to.
#[cold]
fn descend(stages: &[Stage], table: u32, m: [u32; 4]) -> u32 {
    let (mut at, mut shift) = (table, BITS * stages.len() as u32);
    for stage in stages {
        shift -= BITS;
        let part = |d: usize| (m[d] >> shift & 3) << (BITS * d as u32);
        at = stage.step(at, part(0) | part(1) | part(2) | part(3));
    }
    at
}

/// A place along one dimension.
#[derive(Clone, Copy)]
pub(super) struct Axis {
    /// What it adds to the table's index.
    table: u32,
    /// What it adds to the cell of a finest brick.
    cell: u32,
    m: u32,
}

fn texel([r, g, b]: Rgb) -> Texel {
    Texel([r, g, b, 0.0])
}

fn number(count: usize) -> u32 {
    u32::try_from(count).expect("fewer than 2³² values")
}

fn table_bits(levels: Levels, stages: u32) -> u32 {
    let bits = |level: u8| u32::from(level).saturating_sub(BITS * stages);
    2 * bits(levels.position) + 2 * bits(levels.direction)
}

#[cfg(test)]
mod tests {
    use super::super::tests::{grid, wild};
    use super::*;
    use crate::{CHILDREN, Cell, TreeBuilder};

    fn assert_same(leaves: &Leaves, bricks: &Bricks, m: [u32; 4]) {
        let axes = std::array::from_fn(|d| bricks.axis(d, m[d]));
        assert_eq!(bricks.at(axes), &texel(leaves.mean(leaves.leaf(m))), "{m:?}");
    }

    #[test]
    fn every_cell_has_its_leafs_value() {
        for (position, direction) in [(0, 0), (1, 3), (3, 1), (2, 4), (3, 3)] {
            let levels = Levels { position, direction };
            let tree = TreeBuilder::from_grid(&grid(levels, wild)).finish();
            for kept in [1, 10, 1000, usize::MAX] {
                let leaves = Leaves::new(&tree.compressed(crate::Keep::Count(kept)).0);
                let bricks = Bricks::new(&leaves);
                let (p, d) = (1 << position, 1 << direction);
                for i in 0..p * p * d * d {
                    let m = [i % p, i / p % p, i / (p * p) % d, i / (p * p * d)];
                    assert_same(&leaves, &bricks, m);
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
        let bricks = Bricks::new(&leaves);
        assert!(bricks.bytes() < 4 << 20, "{} bytes", bricks.bytes());
        for step in [0_u32, 1, 2, 3, 5, 100, 511] {
            for d in 0..4 {
                let mut near = m;
                near[d] ^= step;
                assert_same(&leaves, &bricks, near);
            }
        }
        let last = [1023, 1023, 16383, 16383];
        for m in [[0; 4], last] {
            assert_same(&leaves, &bricks, m);
        }
    }
}
