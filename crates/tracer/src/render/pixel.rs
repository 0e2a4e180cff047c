//! The samples of one pixel.

use super::RenderOptions;
use crate::{
    camera::{Beam, Pinhole},
    whitted::{Sample, Waves, Whitted},
};
use glam::{DVec2, DVec4, Vec3};

/// Step of the samples' sequence, which fills the unit 4-cube evenly: powers of
/// 1/g for g⁵ = g + 1 (M. Roberts, *The Unreasonable Effectiveness of Quasirandom
/// Sequences*, 2018).
pub(crate) const R4: DVec4 = DVec4::new(
    0.856_674_883_854_502_9,
    0.733_891_856_627_125_8,
    0.628_706_721_037_808_8,
    0.538_597_257_223_608_1,
);

/// Samples of each pixel that say how many it needs.
pub(super) const ROUND: u32 = 8;

/// What the samples of one pixel have given so far.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Tally {
    pub(super) sum: Vec3,
    pub(super) squares: Vec3,
    pub(super) taken: u32,
    pub(super) rays: u64,
    pub(super) look_ups: u64,
}

/// A pixel and the samples that it is to have.
#[derive(Clone, Debug)]
pub(super) struct Pixel {
    pub(super) x: usize,
    pub(super) y: usize,
    pub(super) wanted: u32,
    pub(super) tally: Tally,
}

/// Camera rays that go together, of one pixel or of neighbours.
pub(crate) const TOGETHER: usize = 32;

/// A sample about to be taken.
struct Taking {
    /// Which of the pixels it is of.
    pixel: usize,
    /// Which of the pixel's it is.
    index: u32,
    /// Where in the unit 4-cube.
    point: DVec4,
}

/// Room for camera rays that go together.
#[derive(Default)]
pub(super) struct Room {
    takings: Vec<Taking>,
    beams: Vec<Beam>,
    samples: Vec<Sample>,
    waves: Waves,
}

/// Where a picture's samples go.
pub(super) struct PixelSampler<'a> {
    pub(super) whitted: &'a Whitted<'a>,
    pub(super) pinhole: &'a Pinhole,
    pub(super) options: &'a RenderOptions,
}

impl PixelSampler<'_> {
    /// Adds samples to the pixels' tallies until each has as many as wanted. How the
    /// pixels are put together changes nothing.
    pub(super) fn finish(&self, pixels: &mut [Pixel], room: &mut Room) {
        for pixel in 0..pixels.len() {
            let Pixel { x, y, wanted, ref tally } = pixels[pixel];
            let shift = unit_cube(self.options.seed, self.number(x, y));
            for index in tally.taken..wanted {
                let point = (shift + f64::from(index) * R4).fract_gl();
                room.takings.push(Taking { pixel, index, point });
                if room.takings.len() == TOGETHER {
                    self.take(pixels, room);
                }
            }
        }
        self.take(pixels, room);
    }

    fn number(&self, x: usize, y: usize) -> u64 {
        (y * self.options.width + x) as u64
    }

    /// Takes the samples that stand in `room`.
    fn take(&self, pixels: &mut [Pixel], room: &mut Room) {
        let &RenderOptions { width, height, seed, samples, noise, .. } = self.options;
        let (width_f, height_f) = (width as f64, height as f64);
        // Samples are that far apart if they are spread evenly.
        let even = if noise.is_some() { samples.clamp(1, ROUND) } else { samples.max(1) };
        let step = f64::from(even).sqrt().recip() / DVec2::new(width_f, height_f);
        // Taking turns sets a pixel's samples apart, by which noise is measured.
        let of = if noise.is_some() { 1 } else { samples };
        let beam = |taking: &Taking| {
            let (Pixel { x, y, .. }, point) = (&pixels[taking.pixel], taking.point);
            let at_x = (*x as f64 + 0.5 + tent(point.x)) / width_f;
            let at_y = (*y as f64 + 0.5 + tent(point.y)) / height_f;
            self.pinhole.beam(at_x, at_y, step)
        };
        room.beams.clear();
        room.beams.extend(room.takings.iter().map(beam));
        let sample = |taking: &Taking| {
            let Pixel { x, y, .. } = pixels[taking.pixel];
            Sample {
                place: DVec2::new(taking.point.z, taking.point.w),
                index: taking.index,
                of,
                scramble: splitmix(splitmix(seed).wrapping_add(self.number(x, y))),
                ..Sample::default()
            }
        };
        room.samples.clear();
        room.samples.extend(room.takings.iter().map(sample));
        self.whitted.trace(&room.beams, &mut room.samples, &mut room.waves);
        for (taking, sample) in room.takings.drain(..).zip(&room.samples) {
            let tally = &mut pixels[taking.pixel].tally;
            tally.sum += sample.radiance;
            tally.squares += sample.radiance * sample.radiance;
            tally.rays += sample.rays;
            tally.look_ups += sample.look_ups;
            tally.taken += 1;
        }
    }
}

/// Takes [0, 1) to (−1, 1) with density 1 − |x|: sampling by the pixel filter, so
/// that samples weigh the same and pixels share none.
pub(super) fn tent(u: f64) -> f64 {
    if u < 0.5 { (2.0 * u).sqrt() - 1.0 } else { 1.0 - (2.0 - 2.0 * u).sqrt() }
}

/// A point of the unit 4-cube that belongs to `pixel`.
fn unit_cube(seed: u64, pixel: u64) -> DVec4 {
    let start = splitmix(seed).wrapping_add(pixel);
    let [a, b] = [splitmix(start), splitmix(!start)];
    let unit = |bits: u64| (bits & 0xffff_ffff) as f64 / 4_294_967_296.0;
    DVec4::new(unit(a), unit(a >> 32), unit(b), unit(b >> 32))
}

/// Scrambles 64 bits (G. Steele, D. Lea and C. Flood, *Fast Splittable
/// Pseudorandom Number Generators*, OOPSLA 2014).
pub(crate) fn splitmix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}
