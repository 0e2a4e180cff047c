//! Area-exact resampling of an image under an affine map: what the transport of
//! a whole level is for one direction (§7.1.4.1, all position pairs at once).

use crate::grid::Rgb;
use glam::DVec2;

/// An image with its row prefix sums M(x, y) = ∫₀ˣ I(x′, y) dx′, so that by
/// Green's theorem ∬ I over any region is ∮ M dy over its border.
#[derive(Clone, Debug)]
pub(super) struct SummedImage {
    side: usize,
    /// Per row, `side + 1` sums from the left; the fourth lane is padding.
    sums: Vec<[f64; 4]>,
}

impl SummedImage {
    /// The sums of a square image, u (x) fastest.
    pub(super) fn new(image: &[Rgb], side: usize) -> Self {
        let mut sums = Vec::with_capacity(side * (side + 1));
        for row in image.chunks_exact(side) {
            let mut sum = [0.0; 4];
            sums.push(sum);
            for texel in row {
                for (sum, x) in sum.iter_mut().zip(texel) {
                    *sum += f64::from(*x);
                }
                sums.push(sum);
            }
        }
        Self { side, sums }
    }

    /// ∫ M dy along the straight line from `a` to `b`, in pixels. The image is 0
    /// outside its square.
    pub(super) fn edge(&self, a: DVec2, b: DVec2) -> [f64; 4] {
        let side = self.side as f64;
        let (low, high, sign) = if a.y < b.y { (a, b, 1.0) } else { (b, a, -1.0) };
        let mut sum = [0.0; 4];
        if low.y >= side || high.y <= 0.0 || high.y <= low.y || low.x.max(high.x) <= 0.0 {
            return sum;
        }
        let slope = (high.x - low.x) / (high.y - low.y);
        let mut y = low.y.max(0.0);
        let mut x = low.x + (y - low.y) * slope;
        let end = high.y.min(side);
        let mut row = (y as usize).min(self.side - 1);
        loop {
            let next_y = ((row + 1) as f64).min(end);
            let next_x = x + (next_y - y) * slope;
            if next_y > y {
                self.row(row, x, next_x, next_y - y, &mut sum);
            }
            if next_y >= end {
                return sum.map(|s| s * sign);
            }
            (x, y) = (next_x, next_y);
            row += 1;
        }
    }

    /// Adds ∫ M dy over the part of a line that crosses `row` from x = `a` to
    /// x = `b` while y rises by `dy`.
    fn row(&self, row: usize, a: f64, b: f64, dy: f64, sum: &mut [f64; 4]) {
        let sums = &self.sums[row * (self.side + 1)..][..=self.side];
        let side = self.side as f64;
        let (low, high) = if a < b { (a, b) } else { (b, a) };
        if high <= 0.0 {
            return;
        }
        let mut add = |i: usize, middle: f64, dy: f64| {
            let t = middle - i as f64;
            for ((sum, left), right) in sum.iter_mut().zip(sums[i]).zip(sums[i + 1]) {
                *sum += dy * (left + t * (right - left));
            }
        };
        if low >= side {
            add(self.side - 1, side, dy);
            return;
        }
        let first = low.max(0.0) as usize;
        if high <= (first + 1) as f64 && low >= 0.0 {
            add(first, 0.5 * (low + high), dy);
            return;
        }
        let per_x = dy / (high - low);
        let mut x = low.max(0.0);
        for i in first..self.side {
            let next = ((i + 1) as f64).min(high);
            add(i, 0.5 * (x + next), (next - x) * per_x);
            x = next;
            if x >= high {
                return;
            }
        }
        add(self.side - 1, side, (high - side) * per_x);
    }
}

/// The affine map from destination (u, v) to source pixels for one direction.
#[derive(Clone, Copy, Debug)]
pub(super) struct Footprint {
    pub(super) origin: DVec2,
    pub(super) du: DVec2,
    pub(super) dv: DVec2,
}

impl Footprint {
    fn at(&self, u: f64, v: f64) -> DVec2 {
        self.origin + u * self.du + v * self.dv
    }

    /// Jacobian of the map: signed, for it mirrors.
    fn determinant(&self) -> f64 {
        self.du.perp_dot(self.dv)
    }

    /// The range of destination cells, low and past the high, along u and v that
    /// the image's square can touch.
    fn touched(&self, image_side: f64, cells: usize) -> [(usize, usize); 2] {
        let determinant = self.determinant();
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for corner in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let d = DVec2::from(corner) * image_side - self.origin;
            let uv = DVec2::new(d.perp_dot(self.dv), self.du.perp_dot(d)) / determinant;
            (low, high) = (low.min(uv), high.max(uv));
        }
        let range = |low: f64, high: f64| {
            // Casts saturate: an image far outside touches no cell.
            let first = (low * cells as f64).floor().max(0.0) as usize;
            (first.min(cells), ((high * cells as f64).ceil().max(0.0) as usize).min(cells))
        };
        [range(low.x, high.x), range(low.y, high.y)]
    }
}

/// Room for the border integrals of a destination grid.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    along_u: Vec<[f64; 4]>,
    along_v: Vec<[f64; 4]>,
}

/// Which destination cells the light of a source can reach: all of them, unless
/// the source's plane cuts through the destination.
#[derive(Clone, Debug)]
pub(super) enum Reach {
    /// Every cell, whole.
    All,
    /// Per cell (u fastest): its part in front of the source, as corners in
    /// (u, v); `None` if that is all of it, empty if nothing.
    Parts(Vec<Option<Vec<DVec2>>>),
}

/// Adds `weight` × the mean of the image over each destination cell to `out`
/// (2^level a side, u fastest), every grid line integrated once for both of its
/// cells.
pub(super) fn resample(
    image: &SummedImage,
    footprint: &Footprint,
    reach: &Reach,
    cells: usize,
    weight: f64,
    scratch: &mut Scratch,
    out: &mut [[f64; 3]],
) {
    let [(u0, u1), (v0, v1)] = footprint.touched(image.side as f64, cells);
    if u0 >= u1 || v0 >= v1 {
        return;
    }
    let step = 1.0 / cells as f64;
    let corner = |i: usize, j: usize| footprint.at(i as f64 * step, j as f64 * step);
    let width = u1 - u0;
    scratch.along_u.clear();
    scratch.along_v.clear();
    for j in v0..=v1 {
        scratch.along_u.extend((u0..u1).map(|i| image.edge(corner(i, j), corner(i + 1, j))));
    }
    for j in v0..v1 {
        scratch.along_v.extend((u0..=u1).map(|i| image.edge(corner(i, j), corner(i, j + 1))));
    }
    // ∬ over the warped cell → mean over the cell; the sign undoes the mirroring.
    let factor = weight / (footprint.determinant() * step * step);
    for j in 0..v1 - v0 {
        for i in 0..width {
            let cell = (j + v0) * cells + i + u0;
            let part = match reach {
                Reach::All => None,
                Reach::Parts(parts) => parts[cell].as_ref(),
            };
            let sum = match part {
                None => {
                    let below = scratch.along_u[j * width + i];
                    let above = scratch.along_u[(j + 1) * width + i];
                    let left = scratch.along_v[j * (width + 1) + i];
                    let right = scratch.along_v[j * (width + 1) + i + 1];
                    std::array::from_fn(|c| below[c] + right[c] - above[c] - left[c])
                }
                Some(corners) => border(image, footprint, corners),
            };
            for (out, sum) in out[cell].iter_mut().zip(sum) {
                *out += factor * sum;
            }
        }
    }
}

/// ∮ M dy around a polygon given in the destination's (u, v).
fn border(image: &SummedImage, footprint: &Footprint, corners: &[DVec2]) -> [f64; 4] {
    let mut sum = [0.0; 4];
    for (i, a) in corners.iter().enumerate() {
        let b = corners[(i + 1) % corners.len()];
        let edge = image.edge(footprint.at(a.x, a.y), footprint.at(b.x, b.y));
        for (sum, edge) in sum.iter_mut().zip(edge) {
            *sum += edge;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ConvexPolygon;
    use proptest::prelude::*;

    fn image() -> Vec<Rgb> {
        (0..16).map(|i| [(i * 7 % 11) as f32, (i % 4) as f32, 1.0]).collect()
    }

    /// The same integral by clipping every texel against the warped cell.
    fn by_clipping(footprint: &Footprint, cells: usize) -> Vec<[f64; 3]> {
        let step = 1.0 / cells as f64;
        let image = image();
        (0..cells * cells)
            .map(|cell| {
                let (i, j) = ((cell % cells) as f64, (cell / cells) as f64);
                let corner = |a: f64, b: f64| footprint.at((i + a) * step, (j + b) * step);
                let mut warped = [corner(0., 0.), corner(1., 0.), corner(1., 1.), corner(0., 1.)];
                if footprint.determinant() < 0.0 {
                    warped.reverse();
                }
                let warped = ConvexPolygon::new(&warped);
                let mut sum = [0.0; 3];
                for (t, texel) in image.iter().enumerate() {
                    let at = DVec2::new((t % 4) as f64, (t / 4) as f64);
                    let square = [at, at + DVec2::X, at + DVec2::ONE, at + DVec2::Y];
                    let overlap = warped.intersection(&ConvexPolygon::new(&square)).area();
                    for (sum, x) in sum.iter_mut().zip(texel) {
                        *sum += overlap * f64::from(*x);
                    }
                }
                sum.map(|s| s / warped.area())
            })
            .collect()
    }

    proptest! {
        #[test]
        fn resampling_equals_clipping_texel_by_texel(
            x in -6.0..6.0f64, y in -6.0..6.0f64,
            a in -6.0..6.0f64, b in -6.0..6.0f64, c in -6.0..6.0f64, d in -6.0..6.0f64,
        ) {
            let footprint =
                Footprint { origin: DVec2::new(x, y), du: DVec2::new(a, b), dv: DVec2::new(c, d) };
            prop_assume!(footprint.determinant().abs() > 0.1);
            let cells = 3;
            let mut out = vec![[0.0; 3]; 9];
            let summed = SummedImage::new(&image(), 4);
            resample(&summed, &footprint, &Reach::All, cells, 1.0, &mut Scratch::default(), &mut out);
            for (fast, slow) in out.iter().zip(by_clipping(&footprint, cells)) {
                for (fast, slow) in fast.iter().zip(slow) {
                    prop_assert!((fast - slow).abs() < 1e-10, "{fast} {slow}");
                }
            }
        }
    }
}
