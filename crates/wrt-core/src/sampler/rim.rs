//! How much of each direction cell lies inside the UDC.

use crate::udc_fraction;

/// Cells of which less lies inside have no say.
const LEAST: f64 = 0.25;

/// 1/f of the direction cells that are cut by the UDC's rim, by row.
///
/// The circle is symmetric: one quadrant of cells is kept.
#[derive(Clone, Debug)]
pub(super) struct Rim {
    level: u8,
    /// From λ = 0 to the middle.
    rows: Vec<Row>,
    /// 1/f of the cells in `first..full`, row by row.
    inverse: Vec<f32>,
}

#[derive(Clone, Copy, Debug)]
struct Row {
    /// The first cell with f ≥ [`LEAST`]; past the middle if there is none.
    first: u32,
    /// The first cell with f = 1.
    full: u32,
    /// Where the row's part of `inverse` starts.
    offset: u32,
}

impl Rim {
    pub(super) fn new(level: u8) -> Self {
        let cells = 1_u32 << level;
        let middle = cells.div_ceil(2);
        let at = |i: u32| f64::from(i) / f64::from(cells);
        let mut rim = Self { level, rows: Vec::new(), inverse: Vec::new() };
        for l in 0..middle {
            // The row's widest chord starts here: no cell before it is inside.
            let y = (0.5 - at(l + 1)).max(0.0);
            let start = 0.5 - (0.25 - y * y).max(0.0).sqrt();
            let mut first = (start * f64::from(cells)) as u32;
            let fraction = |k: u32| udc_fraction([at(k), at(l)], [at(k + 1), at(l + 1)]);
            while first < middle && fraction(first) < LEAST {
                first += 1;
            }
            let is_full = |k: u32| (0.5 - at(k)).powi(2) + (0.5 - at(l)).powi(2) <= 0.25;
            let offset = rim.inverse.len() as u32;
            let mut full = first;
            while full < middle && !is_full(full) {
                rim.inverse.push(fraction(full).recip() as f32);
                full += 1;
            }
            rim.rows.push(Row { first, full, offset });
        }
        rim
    }

    /// 1/f of a cell, or 0 if it has no say.
    pub(super) fn inverse(&self, [k, l]: [u32; 2]) -> f32 {
        let last = (1 << self.level) - 1;
        let row = self.rows[l.min(last - l) as usize];
        let k = k.min(last - k);
        if k >= row.full {
            1.0
        } else if k < row.first {
            0.0
        } else {
            self.inverse[(row.offset + k - row.first) as usize]
        }
    }

    /// What [`inverse`](Self::inverse) is for all cells from `low` to before `end`, if
    /// it is the same.
    pub(super) fn of_block(&self, low: [u32; 2], end: [u32; 2]) -> Option<f32> {
        let first = self.inverse(low);
        let mut cells = (low[1]..end[1]).flat_map(|l| (low[0]..end[0]).map(move |k| [k, l]));
        cells.all(|cell| self.inverse(cell) == first).then_some(first)
    }

    /// The cell itself or, if it has no say, the next towards the middle that
    /// has; with its 1/f.
    pub(super) fn nearest(&self, mut cell: [u32; 2]) -> ([u32; 2], f32) {
        let last = (1_u32 << self.level) - 1;
        loop {
            let inverse = self.inverse(cell);
            if inverse > 0.0 {
                return (cell, inverse);
            }
            // One step along the axis that is further out; the cells in the
            // middle are inside, so this ends.
            let out = |i: usize| cell[i].min(last - cell[i]);
            let axis = usize::from(out(1) < out(0));
            if cell[axis] > last / 2 {
                cell[axis] -= 1;
            } else {
                cell[axis] += 1;
            }
        }
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(&self.rows[..]) + size_of_val(&self.inverse[..])
    }
}

/// Whether (κ, λ) is a direction of the hemisphere.
#[inline]
pub(super) fn is_inside([kappa, lambda]: [f64; 2]) -> bool {
    let (x, y) = (kappa - 0.5, lambda - 0.5);
    x * x + y * y <= 0.25
}

/// (κ, λ) outside the UDC, moved to its rim.
#[cold]
pub(super) fn moved([kappa, lambda]: [f64; 2]) -> [f64; 2] {
    let (x, y) = (kappa - 0.5, lambda - 0.5);
    let scale = 0.5 / x.hypot(y);
    [0.5 + x * scale, 0.5 + y * scale]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::udc_fractions;

    #[test]
    fn the_table_has_every_cells_fraction() {
        for level in 0..=6 {
            let rim = Rim::new(level);
            for (i, f) in udc_fractions(level).into_iter().enumerate() {
                let cell = [i as u32 & ((1 << level) - 1), i as u32 >> level];
                let expected = if f < LEAST { 0.0 } else { 1.0 / f };
                let found = f64::from(rim.inverse(cell));
                assert!((found - expected).abs() < 1e-6, "{level} {cell:?}: {found} {expected}");
            }
        }
    }
}
