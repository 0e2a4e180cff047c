//! Where a picture's noise needs more samples.

use super::pixel::{Pixel, PixelSampler, ROUND, Room, Tally};
use super::{Crop, RenderOptions};
use glam::Vec3;
use rayon::prelude::*;

/// What a pixel is at least taken for when its noise is compared with it.
pub(super) const DARK: f32 = 0.02;

/// A few samples of every pixel, which say how many each should have.
///
/// Two stages (C. Stein, *A Two-Sample Test for a Linear Hypothesis Whose Power Is
/// Independent of the Variance*, Ann. Math. Stat. 16, 1945), for to stop a pixel
/// when its own samples agree is to stop where they missed an edge.
pub(super) struct FirstRound<'a> {
    options: &'a RenderOptions,
    /// The part sampled: the picture's and a pixel about it.
    area: Crop,
    tallies: Vec<Tally>,
}

impl<'a> FirstRound<'a> {
    pub(super) fn sample(
        sampler: &PixelSampler<'a>,
        crop: Crop,
        stopped: &(dyn Fn() -> bool + Sync),
    ) -> Self {
        let options = sampler.options;
        let (left, top) = (crop.left.saturating_sub(1), crop.top.saturating_sub(1));
        let width = (crop.left + crop.width + 1).min(options.width) - left;
        let height = (crop.top + crop.height + 1).min(options.height) - top;
        let wanted = options.samples.clamp(1, ROUND);
        let row = |room: &mut Room, y: usize| {
            let pixel = |x| Pixel { x, y, wanted, tally: Tally::default() };
            let mut pixels: Vec<Pixel> = (left..left + width).map(pixel).collect();
            if !stopped() {
                sampler.finish(&mut pixels, room);
            }
            pixels
        };
        let rows = (top..top + height).into_par_iter().with_max_len(1);
        let rows: Vec<_> = rows.map_init(Room::default, row).collect();
        let tallies = rows.into_iter().flatten().map(|pixel| pixel.tally).collect();
        Self { options, area: Crop { left, top, width, height }, tallies }
    }

    pub(super) fn tally(&self, x: usize, y: usize) -> Tally {
        self.tallies[(y - self.area.top) * self.area.width + x - self.area.left]
    }

    /// How many samples take the pixel's standard error to what is asked for, by the
    /// variance of all samples of the pixel and its eight neighbours.
    ///
    /// As if samples were independent: evenly spread ones are better.
    pub(super) fn wanted(&self, x: usize, y: usize) -> u32 {
        let most = self.options.samples.max(1);
        let near = |c: usize, from: usize, n: usize| {
            c.saturating_sub(1).max(from)..=(c + 1).min(from + n - 1)
        };
        let (mut sum, mut squares, mut taken) = (Vec3::ZERO, Vec3::ZERO, 0);
        for y in near(y, self.area.top, self.area.height) {
            for x in near(x, self.area.left, self.area.width) {
                let tally = self.tally(x, y);
                sum += tally.sum;
                squares += tally.squares;
                taken += tally.taken;
            }
        }
        let n = taken.max(1) as f32;
        let variance = (squares / n - (sum / n).powf(2.0)).max(Vec3::ZERO);
        let own = self.tally(x, y);
        let mean = (own.sum / own.taken.max(1) as f32).max(Vec3::splat(DARK));
        let error = self.options.noise.unwrap_or(1.0) * mean;
        let samples = (variance / (error * error)).max_element().min(most as f32);
        (samples.ceil() as u32).clamp(most.min(ROUND), most)
    }
}
