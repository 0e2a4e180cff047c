//! Resampling of a picture by its row sums: exact, and in proportion to the
//! destination's grid lines where the borders of a picture outnumber them.

use super::stencil::Footprint;
use crate::grid::Rgb;
use glam::DVec2;

/// A picture with its row sums M(x, y) = ∫₀ˣ L(x′, y) dx′, so that by Green's theorem
/// ∬ L over any region is ∮ M dy over its border.
#[derive(Debug)]
pub(super) struct Summed {
    side: usize,
    /// Per row, `side` + 1 sums from the left; the fourth lane sums magnitudes.
    sums: Vec<[f64; 4]>,
}

/// Sums over directions of what cells of a destination see.
#[derive(Debug, Default)]
pub(super) struct Sums {
    cells: usize,
    /// Per cell, u fastest; the fourth lane sums magnitudes.
    sums: Vec<[f64; 4]>,
    /// ∫ M dy along the lines of the grid that one direction's light touches, each
    /// once for the cells on both of its sides.
    along_u: Vec<[f64; 4]>,
    along_v: Vec<[f64; 4]>,
}

impl Summed {
    /// The sums of a picture, `side` a side, u fastest.
    pub(super) fn new(picture: &[Rgb], side: usize) -> Self {
        let mut sums = Vec::with_capacity(side * (side + 1));
        for row in picture.chunks_exact(side) {
            let mut sum = [0.0; 4];
            sums.push(sum);
            for texel in row {
                for (sum, x) in sum.iter_mut().zip(texel) {
                    *sum += f64::from(*x);
                }
                sum[3] += texel.iter().map(|&x| f64::from(x.abs())).sum::<f64>();
                sums.push(sum);
            }
        }
        Self { side, sums }
    }

    /// Adds `weight` × the means over the footprints of all cells.
    pub(super) fn shine(&self, footprint: &Footprint, weight: f64, out: &mut Sums) {
        let cells = out.cells;
        let [(u0, u1), (v0, v1)] = footprint.touched(self.side as f64, cells);
        if u0 >= u1 || v0 >= v1 {
            return;
        }
        let step = (cells as f64).recip();
        let (du, dv) = (footprint.du * step, footprint.dv * step);
        let corner = |i: usize, j: usize| footprint.origin + du * i as f64 + dv * j as f64;
        // ∬ over a footprint → mean over the cell; the sign undoes the mirroring.
        let factor = weight / du.perp_dot(dv);
        out.along_u.clear();
        out.along_v.clear();
        for j in v0..=v1 {
            out.along_u.extend((u0..u1).map(|i| self.line(corner(i, j), corner(i + 1, j))));
        }
        for j in v0..v1 {
            out.along_v.extend((u0..=u1).map(|i| self.line(corner(i, j), corner(i, j + 1))));
        }
        let width = u1 - u0;
        for j in 0..v1 - v0 {
            let (below, above) = out.along_u[j * width..][..2 * width].split_at(width);
            let beside = &out.along_v[j * (width + 1)..][..=width];
            let row = &mut out.sums[(j + v0) * cells + u0..][..width];
            for (i, sum) in row.iter_mut().enumerate() {
                let (left, right) = (beside[i], beside[i + 1]);
                for c in 0..3 {
                    sum[c] += factor * (below[i][c] + right[c] - above[i][c] - left[c]);
                }
                let size = below[i][3].abs() + right[3].abs() + above[i][3].abs() + left[3].abs();
                sum[3] += factor.abs() * size;
            }
        }
    }

    /// ∫ M dy along the straight line from `a` to `b`, in texels; all is dark outside
    /// the picture.
    fn line(&self, a: DVec2, b: DVec2) -> [f64; 4] {
        let side = self.side as f64;
        let (low, high, sign) = if a.y < b.y { (a, b, 1.0) } else { (b, a, -1.0) };
        let mut sum = [0.0; 4];
        let (first, last) = (low.y.max(0.0), high.y.min(side));
        if first >= last || low.x.max(high.x) <= 0.0 || last.is_nan() {
            return sum;
        }
        let slope = (high.x - low.x) / (high.y - low.y);
        let mut y = first;
        let mut x = low.x + (y - low.y) * slope;
        let mut row = y as usize;
        loop {
            let next_y = ((row + 1) as f64).min(last);
            let next_x = x + (next_y - y) * slope;
            self.row(row, x, next_x, sign * (next_y - y), &mut sum);
            if next_y >= last {
                return sum;
            }
            (x, y) = (next_x, next_y);
            row += 1;
        }
    }

    /// Adds ∫ M dy over the part of a line that crosses `row` between x = `a` and
    /// x = `b` while y rises by `rise`.
    fn row(&self, row: usize, a: f64, b: f64, rise: f64, sum: &mut [f64; 4]) {
        let sums = &self.sums[row * (self.side + 1)..][..=self.side];
        let side = self.side as f64;
        let (low, high) = if a < b { (a, b) } else { (b, a) };
        if high <= 0.0 {
            return;
        }
        let mut part = |texel: usize, middle: f64, rise: f64| {
            let t = middle - texel as f64;
            for ((sum, left), right) in sum.iter_mut().zip(sums[texel]).zip(sums[texel + 1]) {
                *sum += rise * (left + t * (right - left));
            }
        };
        if low >= side {
            part(self.side - 1, side, rise);
            return;
        }
        let first = low.max(0.0) as usize;
        if high <= (first + 1) as f64 && low >= 0.0 {
            part(first, 0.5 * (low + high), rise);
            return;
        }
        let per_x = rise / (high - low);
        let mut x = low.max(0.0);
        for texel in first..self.side {
            let next = ((texel + 1) as f64).min(high);
            part(texel, 0.5 * (x + next), (next - x) * per_x);
            x = next;
            if x >= high {
                return;
            }
        }
        part(self.side - 1, side, (high - side) * per_x);
    }
}

impl Sums {
    /// Nothing yet, on `cells` × `cells`.
    pub(super) fn reset(&mut self, cells: usize) {
        self.cells = cells;
        self.sums.clear();
        self.sums.resize(cells * cells, [0.0; 4]);
    }

    /// The means over all cells, u fastest; `None` if all are zero.
    pub(super) fn means(&self) -> Option<Vec<[f64; 3]>> {
        // What is left where sums cancel: nothing but rounding.
        const ROUNDING: f64 = 1e-14;
        let counts = |x: f64, size: f64| if x.abs() > ROUNDING * size { x } else { 0.0 };
        let mean = |&[r, g, b, size]: &[f64; 4]| [r, g, b].map(|x| counts(x, size));
        let means: Vec<[f64; 3]> = self.sums.iter().map(mean).collect();
        means.iter().any(|mean| *mean != [0.0; 3]).then_some(means)
    }
}

impl Footprint {
    /// The range of destination cells, low and past the high, along u and along v
    /// that a picture, `side` a side, can touch.
    fn touched(&self, side: f64, cells: usize) -> [(usize, usize); 2] {
        let determinant = self.du.perp_dot(self.dv);
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for corner in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let d = DVec2::from(corner) * side - self.origin;
            let uv = DVec2::new(d.perp_dot(self.dv), self.du.perp_dot(d)) / determinant;
            (low, high) = (low.min(uv), high.max(uv));
        }
        let range = |low: f64, high: f64| {
            // Casts saturate: a picture far outside touches no cell.
            let first = (low * cells as f64).floor().max(0.0) as usize;
            (first.min(cells), ((high * cells as f64).ceil().max(0.0) as usize).min(cells))
        };
        [range(low.x, high.x), range(low.y, high.y)]
    }
}

#[cfg(test)]
mod tests {
    use super::super::stencil::tests::by_clipping;
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn resampling_by_sums_equals_clipping_texel_by_texel(
            x in -6.0..6.0f64, y in -6.0..6.0f64,
            a in -6.0..6.0f64, b in -6.0..6.0f64, c in -6.0..6.0f64, d in -6.0..6.0f64,
        ) {
            let footprint =
                Footprint { origin: DVec2::new(x, y), du: DVec2::new(a, b), dv: DVec2::new(c, d) };
            prop_assume!(footprint.du.perp_dot(footprint.dv).abs() > 0.1);
            let (picture, cells) = (super::super::stencil::tests::image(), 3);
            let mut sums = Sums::default();
            sums.reset(cells);
            Summed::new(&picture, 4).shine(&footprint, 0.7, &mut sums);
            let means = sums.means().unwrap_or_else(|| vec![[0.0; 3]; cells * cells]);
            let expected = by_clipping(&footprint, cells);
            for (found, expected) in means.iter().flatten().zip(expected.iter().flatten()) {
                prop_assert!((found - 0.7 * expected).abs() < 1e-10, "{found} {expected}");
            }
        }
    }
}
