//! From a tree's leaves to bricks: block by block, on all threads, then put together in
//! order.

use super::super::leaves::{Cells, Leaves};
use super::super::rim::Rim;
use super::{BITS, Brick, Bricks, CELLS, CONSTANT, Entry, FLAT, Stage, TABLE_BITS};
use crate::Levels;
use crate::grid::Rgb;
use glam::Vec4;
use rayon::prelude::*;
use std::collections::HashMap;

/// Values of a brick that are looked for among those of others.
const FEW: usize = 4;

/// Blocks of the table that wait to be put together.
const AT_ONCE: u32 = 1 << 12;

/// A block, before it is known what others are like it.
enum Piece {
    Constant(Vec4),
    /// Of the finest: its values in order of appearance.
    Finest(Box<Brick>, Vec<Vec4>),
    /// Cells that are blocks themselves, with their places.
    Coarse(Vec<(usize, Self)>),
}

/// What there is to be put into bricks.
struct Source<'a> {
    leaves: &'a Leaves,
    /// If values are to know it.
    rim: Option<&'a Rim>,
    stages: u32,
}

impl Source<'_> {
    /// The block of `stage` that starts at **m**.
    fn piece(&self, stage: u32, m: [u32; 4]) -> Piece {
        let leaves = self.leaves;
        let below = BITS * (self.stages - stage);
        let end = |d: usize| (m[d] + (1 << below)).min(1 << leaves.level(d));
        let rim = self.rim.map_or(Some(1.0), |rim| rim.of_block([m[2], m[3]], [end(2), end(3)]));
        if rim == Some(0.0) {
            return Piece::Constant(Vec4::ZERO);
        }
        if stage + 1 == self.stages {
            return self.finest(m, rim);
        }
        let leaf = leaves.leaf(m);
        let high = leaves.extent(leaf, m).1;
        if let Some(rim) = rim
            && (0..4).all(|d| high[d] >= end(d))
        {
            return Piece::Constant(value(leaves.mean(leaf.index), rim));
        }
        let size = below - BITS;
        let cells = (0..CELLS).map(|cell| {
            let at = |d: usize| m[d] + ((cell as u32 >> (BITS * d as u32) & 3) << size);
            (cell, [at(0), at(1), at(2), at(3)])
        });
        let cells = cells.filter(|(_, at)| (0..4).all(|d| at[d] >> leaves.level(d) == 0));
        Piece::Coarse(cells.map(|(cell, m)| (cell, self.piece(stage + 1, m))).collect())
    }

    /// The finest block that starts at **m**, whose cells' 1/f are `rim` if all alike.
    fn finest(&self, m: [u32; 4], rim: Option<f32>) -> Piece {
        let mut cells = Cells::default();
        let whole = self.leaves.cells(m, BITS, &mut cells);
        if let (Some(rim), true) = (rim, whole) {
            return Piece::Constant(value(self.leaves.mean(cells.of[0]), rim));
        }
        let inverses: [f32; CELLS / 16] = std::array::from_fn(|direction| {
            let at = |d: usize, below: u32| m[d] + (direction as u32 >> below & 3);
            rim.unwrap_or_else(|| self.inverse([at(2, 0), at(3, BITS)]))
        });
        let mut brick = Box::new([0; CELLS]);
        let mut found: Vec<Vec4> = Vec::new();
        // By a hash of values, the last found: those alike are mostly near. Not to find
        // one costs 16 bytes.
        let mut seen = [0_u8; 256];
        let mut last = (u32::MAX, 0.0_f32, 0_u8);
        for (cell, &leaf) in cells.of.iter().enumerate().filter(|(_, leaf)| **leaf != Cells::NONE) {
            let inverse = inverses[cell / 16];
            if (leaf, inverse) != (last.0, last.1) {
                let value = value(self.leaves.mean(leaf), inverse);
                let slot = &mut seen[hash(value)];
                // At most 256 of them, so that a byte counts them.
                if found.get(usize::from(*slot)) != Some(&value) {
                    *slot = found.len() as u8;
                    found.push(value);
                }
                last = (leaf, inverse, *slot);
            }
            brick[cell] = last.2;
        }
        Piece::Finest(brick, found)
    }

    fn inverse(&self, cell: [u32; 2]) -> f32 {
        let last = (1 << self.leaves.level(2)) - 1;
        self.rim.map_or(1.0, |rim| rim.inverse(cell.map(|m| m.min(last))))
    }
}

fn hash(value: Vec4) -> usize {
    let mixed = bits(value)
        .into_iter()
        .fold(0_u32, |hash, bits| (hash.rotate_left(5) ^ bits).wrapping_mul(0x9e37_79b1));
    (mixed >> 24) as usize
}

impl Bricks {
    /// # Panics
    ///
    /// If there are 2³² values, of 64 GiB together.
    pub(in crate::sampler) fn new(leaves: &Leaves, rim: &Rim) -> Self {
        let levels = leaves.levels();
        let mut stages = 1;
        while table_bits(levels, stages) > TABLE_BITS {
            stages += 1;
        }
        let stage = Stage { entries: Vec::new(), bricks: vec![[0; CELLS]; 2] };
        let shift = BITS * stages;
        let bits = |level: u8| u32::from(level).saturating_sub(shift);
        let (p, d) = (bits(levels.position), bits(levels.direction));
        let mut builder = Builder {
            bricks: Self {
                coarser: vec![stage.clone(); stages as usize - 1],
                finest: stage,
                values: Vec::new(),
                shift,
                strides: [0, p, 2 * p, 2 * p + d],
                axes: Default::default(),
            },
            constants: vec![HashMap::new(); stages as usize],
            patterns: HashMap::new(),
            few: HashMap::new(),
        };
        let source = Source { leaves, rim: (stages == 1).then_some(rim), stages };
        let piece = |at: u32| {
            let part = |bits: u32, below: u32| (at >> below & ((1 << bits) - 1)) << shift;
            source.piece(0, [part(p, 0), part(p, p), part(d, 2 * p), part(d, 2 * p + d)])
        };
        let all = 1_u32 << (2 * p + 2 * d);
        for from in (0..all).step_by(AT_ONCE as usize) {
            let pieces = (from..(from + AT_ONCE).min(all)).into_par_iter().with_min_len(16);
            let pieces: Vec<Piece> = pieces.map(piece).collect();
            for piece in pieces {
                let entry = builder.entry(0, piece);
                builder.bricks.stage(0).entries.push(entry);
            }
        }
        let mut bricks = builder.bricks;
        bricks.values.extend([Vec4::ZERO; CELLS]);
        if stages == 1 {
            bricks.mark_flat([p, p, d, d]);
            bricks.axes = std::array::from_fn(|d| {
                let end = 1 << leaves.level(d);
                (0..=end).map(|m| bricks.axis(d, m.min(end - 1))).collect()
            });
        }
        bricks
    }

    fn stage(&mut self, stage: usize) -> &mut Stage {
        self.coarser.get_mut(stage).unwrap_or(&mut self.finest)
    }

    /// Finds which constant blocks are [`FLAT`], of a table with 2^`bits` blocks along
    /// each dimension.
    fn mark_flat(&mut self, bits: [u32; 4]) {
        let entries = &mut self.finest.entries;
        let values = &self.values;
        let mut flat: Vec<bool> = entries.iter().map(|entry| entry.brick == CONSTANT).collect();
        // One dimension after the other: after the last all sixteen have been compared.
        for (d, bits) in bits.into_iter().enumerate() {
            let stride = 1 << self.strides[d];
            for at in 0..entries.len() {
                let is_last = (at >> self.strides[d] & ((1 << bits) - 1)) + 1 == 1 << bits;
                let next = if is_last { at } else { at + stride };
                flat[at] &= flat[next]
                    && values[entries[at].base as usize] == values[entries[next].base as usize];
            }
        }
        for (entry, _) in entries.iter_mut().zip(flat).filter(|(_, flat)| *flat) {
            entry.brick = FLAT;
        }
    }
}

/// Bricks in the making.
struct Builder {
    bricks: Bricks,
    /// By stage: entries of constant blocks, by the bits of their value.
    constants: Vec<HashMap<[u32; 4], Entry>>,
    /// Finest bricks: many are alike, along the rim and where leaves are large.
    patterns: HashMap<Box<Brick>, u32>,
    /// Where the values of bricks with at most [`FEW`] start, by their bits.
    few: HashMap<Vec<[u32; 4]>, u32>,
}

impl Builder {
    /// The entry of `stage` for a block.
    fn entry(&mut self, stage: usize, piece: Piece) -> Entry {
        let cells = match piece {
            Piece::Constant(value) => return self.constant(stage, value),
            Piece::Finest(brick, values) => return self.finest(brick, values),
            Piece::Coarse(cells) => cells,
        };
        let mut brick = [0; CELLS];
        let mut found = Vec::<Entry>::new();
        for (cell, piece) in cells {
            let entry = self.entry(stage + 1, piece);
            brick[cell] = found.iter().rposition(|other| *other == entry).unwrap_or_else(|| {
                found.push(entry);
                found.len() - 1
            }) as u8;
        }
        let base = self.bricks.stage(stage + 1).entries.len();
        self.bricks.stage(stage + 1).entries.extend(found);
        let bricks = &mut self.bricks.stage(stage).bricks;
        bricks.push(brick);
        Entry { brick: number(bricks.len() - 1), base: number(base) }
    }

    /// The entry of a finest brick with these values.
    fn finest(&mut self, brick: Box<Brick>, found: Vec<Vec4>) -> Entry {
        let bricks = &mut self.bricks.finest.bricks;
        let brick = *self.patterns.entry(brick).or_insert_with_key(|brick| {
            bricks.push(**brick);
            number(bricks.len() - 1)
        });
        let values = &mut self.bricks.values;
        let base = number(values.len());
        if found.len() <= FEW {
            let base = *self.few.entry(found.iter().copied().map(bits).collect()).or_insert(base);
            if base as usize == values.len() {
                values.extend(found);
            }
            return Entry { brick, base };
        }
        values.extend(found);
        Entry { brick, base }
    }

    /// The entry of `stage` for a block of one value.
    fn constant(&mut self, stage: usize, value: Vec4) -> Entry {
        if let Some(&entry) = self.constants[stage].get(&bits(value)) {
            return entry;
        }
        let base = if stage == self.bricks.coarser.len() {
            self.bricks.values.push(value);
            self.bricks.values.len() - 1
        } else {
            let entry = self.constant(stage + 1, value);
            let entries = &mut self.bricks.stage(stage + 1).entries;
            entries.push(entry);
            entries.len() - 1
        };
        let entry = Entry { brick: CONSTANT, base: number(base) };
        self.constants[stage].insert(bits(value), entry);
        entry
    }
}

/// A value of a cell that has 1/f or, if it has no say, 0.
pub(super) fn value([r, g, b]: Rgb, inverse: f32) -> Vec4 {
    if inverse == 0.0 {
        return Vec4::ZERO;
    }
    Vec4::new(r * inverse, g * inverse, b * inverse, 1.0)
}

fn bits(value: Vec4) -> [u32; 4] {
    value.to_array().map(f32::to_bits)
}

fn number(count: usize) -> u32 {
    u32::try_from(count).expect("fewer than 2³² values")
}

fn table_bits(levels: Levels, stages: u32) -> u32 {
    let bits = |level: u8| u32::from(level).saturating_sub(BITS * stages);
    2 * bits(levels.position) + 2 * bits(levels.direction)
}
