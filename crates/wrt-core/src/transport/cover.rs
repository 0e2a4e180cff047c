//! Means over the cells of a grid of what has jumps along straight borders: exact
//! area coverage, as font rasterisers compute it (R. Levien, *font-rs*, 2016).

use glam::DVec2;

/// Sums of borders' contributions. A border adds its jump to all that lies right of
/// it; each row keeps differences from cell to cell, summed up at the end.
#[derive(Debug, Default)]
pub(super) struct Cover {
    /// Per row one difference a cell and one past the end; the fourth lane is padding.
    differences: Vec<[f64; 4]>,
    cells: usize,
}

impl Cover {
    /// Nothing yet, on `cells` × `cells`.
    pub(super) fn reset(&mut self, cells: usize) {
        self.cells = cells;
        self.differences.clear();
        self.differences.resize(cells * (cells + 1), [0.0; 4]);
    }

    /// Adds `jump` × (rise in y) of the line from `a` to `b` (in cells) right of it.
    pub(super) fn add(&mut self, a: DVec2, b: DVec2, jump: [f64; 3]) {
        let cells = self.cells as f64;
        let (low, high, sign) = if a.y < b.y { (a, b, 1.0) } else { (b, a, -1.0) };
        let (first, last) = (low.y.max(0.0), high.y.min(cells));
        if first >= last || low.x.min(high.x) >= cells || last.is_nan() {
            return;
        }
        let jump = [sign * jump[0], sign * jump[1], sign * jump[2], 0.0];
        let slope = (high.x - low.x) / (high.y - low.y);
        let mut y = first;
        let mut x = low.x + (y - low.y) * slope;
        let mut row = y as usize;
        loop {
            let next_y = ((row + 1) as f64).min(last);
            let next_x = x + (next_y - y) * slope;
            let (from, to) = if x < next_x { (x, next_x) } else { (next_x, x) };
            self.band(row, from, to, next_y - y, &jump);
            if next_y >= last {
                return;
            }
            (x, y) = (next_x, next_y);
            row += 1;
        }
    }

    /// Adds what a line does that crosses `row` from x = `from` to `to` ≥ `from` while
    /// y rises by `rise`.
    fn band(&mut self, row: usize, from: f64, to: f64, rise: f64, jump: &[f64; 4]) {
        let width = self.cells;
        let row = &mut self.differences[row * (width + 1)..][..=width];
        let mut put = |cell: usize, rise: f64, right: f64| {
            // `right`: the mean over the line of what of the cell lies left of it.
            let (own, next) = (rise * (1.0 - right), rise * right);
            for c in 0..4 {
                row[cell][c] += own * jump[c];
                row[cell + 1][c] += next * jump[c];
            }
        };
        let cells = width as f64;
        if from >= cells {
            return;
        }
        let first = from.max(0.0) as usize;
        let edge = (first + 1) as f64;
        if from >= 0.0 && to <= edge {
            put(first, rise, 0.5 * (from + to) - first as f64);
            return;
        }
        if to <= 0.0 {
            put(0, rise, 0.0);
            return;
        }
        let per_x = rise / (to - from);
        if from < 0.0 {
            put(0, -from * per_x, 0.0);
        }
        let mut x = from.max(0.0);
        let end = to.min(cells);
        let mut cell = first;
        while x < end && cell < width {
            let next = ((cell + 1) as f64).min(end);
            put(cell, (next - x) * per_x, 0.5 * (x + next) - cell as f64);
            x = next;
            cell += 1;
        }
    }

    /// The means over all cells, u fastest, columns in reverse if `mirrored`; `None`
    /// if all are zero.
    pub(super) fn means(&self, mirrored: bool) -> Option<Vec<[f64; 3]>> {
        // What is left where borders cancel: nothing but rounding.
        const ROUNDING: f64 = 1e-14;
        let mut out = vec![[0.0; 3]; self.cells * self.cells];
        let mut any = false;
        let rows = self.differences.chunks_exact(self.cells + 1);
        for (row, out) in rows.zip(out.chunks_exact_mut(self.cells)) {
            let (mut sum, mut size) = ([0.0; 4], [0.0; 4]);
            for (i, difference) in row[..self.cells].iter().enumerate() {
                for c in 0..4 {
                    sum[c] += difference[c];
                    size[c] += difference[c].abs();
                }
                let cell = if mirrored { self.cells - 1 - i } else { i };
                for (c, out) in out[cell].iter_mut().enumerate() {
                    if sum[c].abs() > ROUNDING * size[c] {
                        *out = sum[c];
                        any = true;
                    }
                }
            }
        }
        any.then_some(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ConvexPolygon;
    use proptest::prelude::*;

    proptest! {
        /// Any quadrilateral, over, across and beside the grid.
        #[test]
        fn a_polygon_covers_its_share_of_each_cell(
            x in -6.0..6.0f64, y in -6.0..6.0f64,
            a in -9.0..9.0f64, b in -9.0..9.0f64, c in -9.0..9.0f64, d in -9.0..9.0f64,
        ) {
            let cells = 4;
            let (at, u, v) = (DVec2::new(x, y), DVec2::new(a, b), DVec2::new(c, d));
            prop_assume!(u.perp_dot(v) > 0.1);
            let corners = [at, at + u, at + u + 0.7 * v, at + v];
            let mut cover = Cover::default();
            cover.reset(cells);
            for i in 0..4 {
                // Right of a border that falls in y lies the inside.
                cover.add(corners[(i + 1) % 4], corners[i], [1.0, 2.0, 0.5]);
            }
            let means = cover.means(false).unwrap_or_else(|| vec![[0.0; 3]; cells * cells]);
            for (i, mean) in means.iter().enumerate() {
                let at = DVec2::new((i % cells) as f64, (i / cells) as f64);
                let square = [at, at + DVec2::X, at + DVec2::ONE, at + DVec2::Y];
                let overlap = ConvexPolygon::new(&corners).intersection(&ConvexPolygon::new(&square));
                for (found, jump) in mean.iter().zip([1.0, 2.0, 0.5]) {
                    prop_assert!((found - jump * overlap.area()).abs() < 1e-11, "{i}: {mean:?}");
                }
            }
        }
    }
}
