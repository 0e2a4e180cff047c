//! Resampling where the footprint repeats by whole texels along one axis (a
//! Toeplitz matrix): the overlaps of one cell serve all of its row.

use super::resample::Footprint;
use crate::grid::Rgb;
use glam::DVec2;

/// A destination axis along which each cell's footprint is the one before, moved by
/// a whole number of texels along an axis of the source; whatever the direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Repeat {
    /// Which axis of the destination: 0 = u, 1 = v.
    dest: usize,
    /// Which axis of the source's picture.
    source: usize,
    /// By how many texels.
    step: isize,
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
    /// Per texel row, `width` overlaps; zero outside the rows and columns in use.
    values: Vec<f64>,
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
        for dest in 0..2 {
            let step = |f: &Footprint| [f.du, f.dv][dest] / cells as f64;
            let (a, b) = (step(footprint), step(other));
            for source in 0..2 {
                let along = a[source].round();
                let fixed = |v: DVec2| {
                    (v[source] - along).abs() * cells as f64 <= SLACK
                        && v[1 - source].abs() * cells as f64 <= SLACK
                };
                if along != 0.0 && along.abs() < 1e6 && fixed(a) && fixed(b) {
                    return Some(Self { dest, source, step: along as isize });
                }
            }
        }
        None
    }

    /// A picture with its texels in order of the repeating axis; `side` a side.
    pub(super) fn picture(&self, picture: &[Rgb], side: usize) -> Vec<Rgb> {
        if self.source == 0 {
            return picture.to_vec();
        }
        (0..side * side).map(|i| picture[i % side * side + i / side]).collect()
    }

    /// Adds the means over all destination cells (`cells` a side, u fastest) that
    /// [`resample`](super::resample::resample) would add sample by sample.
    ///
    /// `pictures` are as [`picture`](Self::picture) leaves them.
    pub(super) fn resample(
        &self,
        pictures: &[Vec<Rgb>],
        side: usize,
        samples: &[Sample],
        cells: usize,
        taps: &mut Taps,
        out: &mut [[f64; 3]],
    ) {
        let turned = |v: DVec2| if self.source == 0 { v } else { DVec2::new(v.y, v.x) };
        let mut row_out = vec![[0.0; 3]; cells];
        // What a cell's left border has to be shifted by to meet the picture.
        let lowest = if self.step > 0 { -(self.step * (cells as isize - 1)) } else { 0 };
        let reach = self.step.unsigned_abs() * (cells - 1);
        taps.reset(side, side + reach);
        for chunk in samples.chunk_by(|a, b| a.picture == b.picture) {
            let picture = &pictures[chunk[0].picture];
            for j in 0..cells {
                for sample in chunk {
                    let f = &sample.footprint;
                    let across = [f.dv, f.du][self.dest];
                    let start = turned(f.origin + across * (j as f64 / cells as f64));
                    let edge = turned(across) / cells as f64;
                    taps.add(start, edge, self.step, lowest, sample.weight);
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
        self.values.clear();
        self.values.resize(rows * width, 0.0);
        self.used.clear();
        self.used.resize(rows, (usize::MAX, 0));
        self.width = width;
    }

    /// Adds `weight` × the share of each texel in the parallelogram between the line
    /// from `start` along `edge` and the same line moved by `step` texels along x.
    /// Column 0 is texel `lowest`.
    fn add(&mut self, start: DVec2, edge: DVec2, step: isize, lowest: isize, weight: f64) {
        let rows = self.used.len() as f64;
        let (low, high) = if edge.y > 0.0 { (start, start + edge) } else { (start + edge, start) };
        let (first, last) = (low.y.max(0.0), high.y.min(rows));
        if first >= last || last.is_nan() {
            return;
        }
        let slope = (high.x - low.x) / (high.y - low.y);
        let area = (high.y - low.y) * step.unsigned_abs() as f64;
        let scale = weight / area;
        let lowest = lowest as f64;
        let mut y = first;
        let mut x = low.x + (y - low.y) * slope - lowest;
        // The right border is the left one of the cell that many steps on.
        let (left, right) = if step > 0 { (0, step as usize) } else { ((-step) as usize, 0) };
        for row in first as usize..self.used.len() {
            let next_y = ((row + 1) as f64).min(last);
            let next_x = x + (next_y - y) * slope;
            let (a, b) = if x < next_x { (x, next_x) } else { (next_x, x) };
            let (a, b) = (a - left as f64, b - left as f64);
            self.band(row, a, b, left + right, scale * (next_y - y));
            (x, y) = (next_x, next_y);
            if next_y >= last {
                break;
            }
        }
    }

    /// Adds to one row the overlaps between a line that crosses it from x = `a` to
    /// `b` ≥ `a` and the same moved by `wide`, times `scale`.
    fn band(&mut self, row: usize, a: f64, b: f64, wide: usize, scale: f64) {
        let width = self.width as f64;
        let end = b + wide as f64;
        if end <= 0.0 || a >= width {
            return;
        }
        let (from, to) = (a.max(0.0) as usize, (end.ceil().min(width)) as usize);
        let values = &mut self.values[row * self.width..][..self.width];
        let used = &mut self.used[row];
        *used = (used.0.min(from), used.1.max(to));
        // The mean over the line of how much of texel c lies left of it, per c.
        let left = |c: f64| mean_clamped(a - c, b - c);
        for (c, value) in values.iter_mut().enumerate().take(to).skip(from) {
            let c = c as f64;
            *value += scale * (left(c - wide as f64) - left(c));
        }
    }

    /// Adds to each cell of `out` its overlaps times the picture's texels, and
    /// clears the overlaps; `false` if there were none.
    fn apply(&mut self, picture: &[Rgb], step: isize, lowest: isize, out: &mut [[f64; 3]]) -> bool {
        let side = self.used.len();
        let mut any = false;
        for (row, used) in self.used.iter_mut().enumerate() {
            let (from, to) = std::mem::replace(used, (usize::MAX, 0));
            let texels = &picture[row * side..][..side];
            for c in from..to {
                let weight = std::mem::take(&mut self.values[row * self.width + c]);
                if weight == 0.0 {
                    continue;
                }
                any = true;
                let first = c as isize + lowest;
                add(out, texels, first, step, weight);
            }
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

/// The mean of clamp(x, 0, 1) over [a, b], without cancellation for short ones.
fn mean_clamped(a: f64, b: f64) -> f64 {
    if b <= 0.0 {
        0.0
    } else if a >= 1.0 {
        1.0
    } else if a >= 0.0 && b <= 1.0 {
        0.5 * (a + b)
    } else {
        let (low, high) = (a.max(0.0), b.min(1.0));
        (0.5 * (high - low) * (high + low) + (b - 1.0).max(0.0)) / (b - a)
    }
}

#[cfg(test)]
mod tests {
    use super::super::resample::{Reach, Scratch, SummedImage, resample};
    use super::*;
    use proptest::prelude::*;

    fn image() -> Vec<Rgb> {
        (0..16).map(|i| [(i * 7 % 11) as f32, (i % 4) as f32, 1.0]).collect()
    }

    proptest! {
        /// Along any axes, forwards, backwards, by one texel or by more.
        #[test]
        fn a_repeated_stencil_is_the_general_resampling(
            x in -9.0..9.0f64, y in -9.0..9.0f64, a in -6.0..6.0f64, b in -6.0..6.0f64,
            texels in prop::sample::select(vec![-2.0, -1.0, 1.0, 2.0]),
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
            let mut expected = vec![[0.0; 3]; cells * cells];
            let summed = SummedImage::new(&image(), 4);
            let scratch = &mut Scratch::default();
            let mut found = expected.clone();
            resample(&summed, &footprint, &Reach::All, cells, 0.7, scratch, &mut expected);
            let samples = [Sample { picture: 0, footprint, weight: 0.7 }];
            let pictures = [repeat.picture(&image(), 4)];
            repeat.resample(&pictures, 4, &samples, cells, &mut Taps::default(), &mut found);
            for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
                prop_assert!((found - expected).abs() < 1e-11, "{found} {expected}");
            }
        }
    }

    #[test]
    fn a_turned_footprint_does_not_repeat() {
        let at = |du, dv| Footprint { origin: DVec2::ZERO, du, dv };
        let skew = at(DVec2::new(4.0, 0.1), DVec2::new(0.3, 2.0));
        assert_eq!(Repeat::of(&skew, &skew, 4), None);
        // By texels along one direction, by none along the other.
        let (one, other) = (at(DVec2::X * 4.0, DVec2::Y), at(DVec2::X * 4.5, DVec2::Y));
        assert_eq!(Repeat::of(&one, &other, 4), None);
    }
}
