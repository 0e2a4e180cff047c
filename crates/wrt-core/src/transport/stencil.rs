//! Resampling where the footprint repeats by whole texels along one axis (a
//! Toeplitz matrix): the overlaps of one cell serve all of its row.

use crate::grid::Rgb;
use glam::DVec2;

/// The affine map from destination (u, v) to source texels for one direction.
#[derive(Clone, Copy, Debug)]
pub(super) struct Footprint {
    pub(super) origin: DVec2,
    pub(super) du: DVec2,
    pub(super) dv: DVec2,
}

/// A destination axis along which each cell's footprint is the one before, moved by
/// the same number of texels along an axis of the source; whatever the direction.
///
/// Where that number is a fraction, texels are split along this axis so that it is
/// whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Repeat {
    /// Which axis of the destination: 0 = u, 1 = v.
    dest: usize,
    /// Which axis of the source's picture.
    source: usize,
    /// By how many parts of a texel.
    step: isize,
    /// Parts that a texel is split into.
    split: usize,
}

/// A picture with its texels in order of the repeating axis, split along it.
#[derive(Debug)]
pub(super) struct Turned {
    texels: Vec<Rgb>,
    /// Rows, and parts of texels in one.
    rows: usize,
    width: usize,
    /// Which rows hold anything.
    lit: Vec<bool>,
}

/// One direction's footprint and what its picture is multiplied by.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    pub(super) picture: usize,
    pub(super) footprint: Footprint,
    pub(super) weight: f64,
}

/// Room for the overlaps of one destination row.
#[derive(Debug, Default)]
pub(super) struct Taps {
    /// Per texel row and column, by how much less of a column lies left of the cell's
    /// left border than of the column before; summed over samples. Zero outside the
    /// columns in use.
    differences: Vec<f64>,
    width: usize,
    /// Columns in use per row, from..to.
    used: Vec<(usize, usize)>,
}

impl Repeat {
    /// The axis along which footprints repeat on `cells` a side, if `footprint` and
    /// `other`, along two directions in general position, agree on it.
    pub(super) fn of(footprint: &Footprint, other: &Footprint, cells: usize) -> Option<Self> {
        // Rounding of the polygons' corners, in texels over the whole picture.
        const SLACK: f64 = 1e-9;
        // Splitting further costs more than repetition saves.
        const MOST_PARTS: usize = 8;
        for (dest, source, split) in (1..=MOST_PARTS)
            .flat_map(|split| [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(d, s)| (d, s, split)))
        {
            let step = |f: &Footprint| [f.du, f.dv][dest] / cells as f64;
            let (a, b) = (step(footprint), step(other));
            let along = (a[source] * split as f64).round();
            let fixed = |v: DVec2| {
                (v[source] - along / split as f64).abs() * cells as f64 <= SLACK
                    && v[1 - source].abs() * cells as f64 <= SLACK
            };
            if along != 0.0 && along.abs() < 1e6 && fixed(a) && fixed(b) {
                return Some(Self { dest, source, step: along as isize, split });
            }
        }
        None
    }

    /// A picture, `side` a side, as [`resample`](Self::resample) wants it.
    pub(super) fn picture(&self, picture: &[Rgb], side: usize) -> Turned {
        let width = side * self.split;
        let texel = |i: usize| {
            let (row, column) = (i / width, i % width / self.split);
            picture[if self.source == 0 { row * side + column } else { column * side + row }]
        };
        let texels: Vec<Rgb> = (0..side * width).map(texel).collect();
        let lit = texels.chunks_exact(width).map(|row| row.iter().any(|x| *x != [0.0; 3]));
        let lit = lit.collect();
        Turned { texels, rows: side, width, lit }
    }

    /// Adds the means over all destination cells (`cells` a side, u fastest) of the
    /// pictures in the samples' footprints, times their weights.
    pub(super) fn resample(
        &self,
        pictures: &[Turned],
        samples: &[Sample],
        cells: usize,
        taps: &mut Taps,
        out: &mut [[f64; 3]],
    ) {
        let split = DVec2::new(self.split as f64, 1.0);
        let turned = |v: DVec2| split * if self.source == 0 { v } else { DVec2::new(v.y, v.x) };
        let mut row_out = vec![[0.0; 3]; cells];
        let wide = self.step.unsigned_abs();
        let reach = wide * (cells - 1);
        // Overlaps of the cell whose column 0 is texel `lowest`; those of the others
        // are the same, moved.
        let lowest = if self.step > 0 { -(reach as isize) } else { 0 };
        // A border that lies left of all still has its cell's right one in view.
        let left = (lowest - wide as isize) as f64;
        taps.reset(pictures[0].rows, pictures[0].width + reach + wide);
        for chunk in samples.chunk_by(|a, b| a.picture == b.picture) {
            let picture = &pictures[chunk[0].picture];
            for j in 0..cells {
                for sample in chunk {
                    let f = &sample.footprint;
                    let across = [f.dv, f.du][self.dest];
                    let start = turned(f.origin + across * (j as f64 / cells as f64));
                    let edge = turned(across) / cells as f64;
                    // The left border of a cell that runs backwards is its far one.
                    let start =
                        if self.step > 0 { start } else { start - DVec2::new(wide as f64, 0.0) };
                    taps.add(
                        start - DVec2::new(left, 0.0),
                        edge,
                        wide,
                        sample.weight,
                        &picture.lit,
                    );
                }
                if taps.apply(picture, self.step, lowest, &mut row_out) {
                    for (i, sum) in row_out.iter_mut().enumerate() {
                        let cell = if self.dest == 0 { j * cells + i } else { i * cells + j };
                        for (out, sum) in out[cell].iter_mut().zip(std::mem::take(sum)) {
                            *out += sum;
                        }
                    }
                }
            }
        }
    }
}

impl Taps {
    fn reset(&mut self, rows: usize, width: usize) {
        // One more, for what a border in the last column gives the next.
        self.width = width + 1;
        self.differences.clear();
        self.differences.resize(rows * self.width, 0.0);
        self.used.clear();
        self.used.resize(rows, (usize::MAX, 0));
    }

    /// Adds `weight` × what lies left of the line from `start` along `edge`, in
    /// shares of the parallelogram between it and the same moved by `wide` along x.
    fn add(&mut self, start: DVec2, edge: DVec2, wide: usize, weight: f64, lit: &[bool]) {
        let rows = self.used.len() as f64;
        let (low, high) = if edge.y > 0.0 { (start, start + edge) } else { (start + edge, start) };
        let (first, last) = (low.y.max(0.0), high.y.min(rows));
        if first >= last || last.is_nan() {
            return;
        }
        let rise = (high.y - low.y).recip();
        let slope = (high.x - low.x) * rise;
        let scale = weight * rise / wide as f64;
        let mut y = first;
        let mut x = low.x + (y - low.y) * slope;
        for (row, &lit) in lit.iter().enumerate().skip(first as usize) {
            let next_y = ((row + 1) as f64).min(last);
            let next_x = x + (next_y - y) * slope;
            if lit {
                let (from, to) = if x < next_x { (x, next_x) } else { (next_x, x) };
                self.band(row, from, to, scale * (next_y - y));
            }
            (x, y) = (next_x, next_y);
            if next_y >= last {
                break;
            }
        }
    }

    /// Adds to one row a line that crosses it from x = `from` to `to` ≥ `from`.
    fn band(&mut self, row: usize, from: f64, to: f64, share: f64) {
        let end = (self.width - 1) as f64;
        if to <= 0.0 || from >= end {
            return;
        }
        let values = &mut self.differences[row * self.width..][..self.width];
        let first = from.max(0.0) as usize;
        let used = &mut self.used[row];
        used.0 = used.0.min(first);
        if from >= 0.0 && to <= (first + 1) as f64 {
            let right = share * (0.5 * (from + to) - first as f64);
            values[first] += share - right;
            values[first + 1] += right;
            used.1 = used.1.max(first + 2);
            return;
        }
        let per_x = share / (to - from);
        let (mut x, mut column) = (from.max(0.0), first);
        let to = to.min(end);
        while x < to && column + 1 < self.width {
            let next = ((column + 1) as f64).min(to);
            let share = (next - x) * per_x;
            let right = share * (0.5 * (x + next) - column as f64);
            values[column] += share - right;
            values[column + 1] += right;
            x = next;
            column += 1;
        }
        used.1 = used.1.max(column + 1);
    }

    /// Adds to each cell of `out` its overlaps times the picture's texels, and
    /// clears the overlaps; `false` if there were none.
    fn apply(
        &mut self,
        picture: &Turned,
        step: isize,
        lowest: isize,
        out: &mut [[f64; 3]],
    ) -> bool {
        let wide = step.unsigned_abs();
        let mut any = false;
        for (row, used) in self.used.iter_mut().enumerate() {
            let (from, to) = std::mem::replace(used, (usize::MAX, 0));
            if from >= to {
                continue;
            }
            let differences = &mut self.differences[row * self.width..][..self.width];
            let texels = &picture.texels[row * picture.width..][..picture.width];
            // Between its two borders lies what is left of the one and not of the
            // other: the differences of as many columns as they are apart.
            for c in from..to + wide - 1 {
                let first = (c + 1).saturating_sub(wide).max(from);
                let weight: f64 = differences[first..(c + 1).min(to)].iter().sum();
                if weight != 0.0 {
                    any = true;
                    add(out, texels, c as isize + lowest - wide as isize, step, weight);
                }
            }
            differences[from..to].fill(0.0);
        }
        any
    }
}

/// `out`\[i\] += `weight` × `texels`\[`first` + i `step`\], wherever there is one.
fn add(out: &mut [[f64; 3]], texels: &[Rgb], first: isize, step: isize, weight: f64) {
    let side = texels.len() as isize;
    let cells = out.len() as isize;
    // The i with 0 ≤ first + i step < side.
    let (near, far) = if step > 0 { (-first, side - first) } else { (first - side + 1, first + 1) };
    let up = |x: isize| x.div_euclid(step.abs()) + isize::from(x.rem_euclid(step.abs()) != 0);
    let (from, to) = (up(near).clamp(0, cells), up(far).clamp(0, cells));
    if from >= to {
        return;
    }
    let out = &mut out[from as usize..to as usize];
    let mut accumulate = |texels: &mut dyn Iterator<Item = &Rgb>| {
        for (out, texel) in out.iter_mut().zip(texels) {
            for (out, x) in out.iter_mut().zip(texel) {
                *out += weight * f64::from(*x);
            }
        }
    };
    let at = (first + from * step) as usize;
    match step {
        1 => {
            // The common case, left to the compiler as one run.
            let run = texels[at..at + (to - from) as usize].as_flattened();
            for (out, x) in out.as_flattened_mut().iter_mut().zip(run) {
                *out += weight * f64::from(*x);
            }
        }
        _ if step > 0 => accumulate(&mut texels[at..].iter().step_by(step as usize)),
        _ => accumulate(&mut texels[..=at].iter().rev().step_by(step.unsigned_abs())),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::ConvexPolygon;
    use proptest::prelude::*;

    pub(in crate::transport) fn image() -> Vec<Rgb> {
        (0..16).map(|i| [(i * 7 % 11) as f32, (i % 4) as f32, f32::from(i / 4 != 2)]).collect()
    }

    /// The same by clipping every texel against each cell's footprint.
    pub(in crate::transport) fn by_clipping(footprint: &Footprint, cells: usize) -> Vec<[f64; 3]> {
        let at = |u: usize, v: usize| {
            let step = 1.0 / cells as f64;
            footprint.origin + (footprint.du * u as f64 + footprint.dv * v as f64) * step
        };
        let mean = |cell: usize| {
            let (i, j) = (cell % cells, cell / cells);
            let mut corners = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            if footprint.du.perp_dot(footprint.dv) < 0.0 {
                corners.reverse();
            }
            let warped = ConvexPolygon::new(&corners);
            let mut sum = [0.0; 3];
            for (t, texel) in image().iter().enumerate() {
                let at = DVec2::new((t % 4) as f64, (t / 4) as f64);
                let square = [at, at + DVec2::X, at + DVec2::ONE, at + DVec2::Y];
                let overlap = warped.intersection(&ConvexPolygon::new(&square)).area();
                for (sum, x) in sum.iter_mut().zip(texel) {
                    *sum += overlap / warped.area() * f64::from(*x);
                }
            }
            sum
        };
        (0..cells * cells).map(mean).collect()
    }

    proptest! {
        /// Along any axes, forwards, backwards, by one texel, by more, by parts of one.
        #[test]
        fn a_repeated_stencil_is_the_overlap_of_each_texel_with_each_cell(
            x in -9.0..9.0f64, y in -9.0..9.0f64, a in -6.0..6.0f64, b in -6.0..6.0f64,
            texels in prop::sample::select(vec![-2.0, -1.0, -0.25, 0.5, 1.0, 1.5, 2.0]),
            dest in 0..2_usize, source in 0..2_usize, cells in prop::sample::select(vec![2_usize, 3, 8]),
        ) {
            prop_assume!(b.abs() > 0.05);
            let along = texels * cells as f64;
            let (along, across) = (DVec2::new(along, 0.0), DVec2::new(a, b));
            let turned = |v: DVec2| if source == 0 { v } else { DVec2::new(v.y, v.x) };
            let origin = turned(DVec2::new(x, y));
            let (along, across) = (turned(along), turned(across));
            let (du, dv) = if dest == 0 { (along, across) } else { (across, along) };
            let footprint = Footprint { origin, du, dv };
            let other = Footprint { origin: origin * 1.1, ..footprint };
            let repeat = Repeat::of(&footprint, &other, cells).expect("it repeats");
            let samples = [Sample { picture: 0, footprint, weight: 0.7 }];
            let pictures = [repeat.picture(&image(), 4)];
            let mut found = vec![[0.0; 3]; cells * cells];
            repeat.resample(&pictures, &samples, cells, &mut Taps::default(), &mut found);
            let expected = by_clipping(&footprint, cells);
            for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
                prop_assert!((found - 0.7 * expected).abs() < 1e-11, "{found} {expected}");
            }
        }
    }

    #[test]
    fn a_turned_footprint_does_not_repeat() {
        let at = |du, dv| Footprint { origin: DVec2::ZERO, du, dv };
        let skew = at(DVec2::new(4.0, 0.1), DVec2::new(0.3, 2.1));
        assert_eq!(Repeat::of(&skew, &skew, 4), None);
        // By texels along one direction, by none along the other.
        let across = DVec2::new(0.3, 1.1);
        let (one, other) = (at(DVec2::X * 4.0, across), at(DVec2::X * 4.5, across));
        assert_eq!(Repeat::of(&one, &other, 4), None);
    }
}
