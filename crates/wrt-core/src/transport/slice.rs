//! What arrives from the directions of one cell: an image over positions.

use super::cell::is_blind;
use super::cover::Cover;
use super::directions::Region;
use super::outline::{Outline, Plane, corners};
use super::source::Source;
use super::stencil::{Footprint, Repeat, Sample, Taps, Turned};
use super::summed::{Summed, Sums};
use super::{Support, TransportGeometry};
use crate::grid::Rgb;
use crate::{Error, Levels, Result};
use glam::{DVec2, DVec3};
use std::f64::consts::PI;

/// A source as the cells of a destination see it.
pub(super) struct Slices<'a, S> {
    geometry: &'a TransportGeometry,
    source: &'a S,
    levels: Levels,
    plane: Plane,
    /// The corners of both charts' unit squares, in their planes.
    source_corners: [DVec2; 4],
    dest_corners: [DVec2; 4],
    /// Cosines (μx, μy) that bound the directions to the source, low and high.
    visible: [DVec2; 2],
    pictures: Pictures,
}

/// The source's pictures, prepared for how they are resampled.
enum Pictures {
    Outlines(Vec<Outline>),
    Summed(Vec<Summed>),
    Repeating(Repeat, Vec<Turned>),
}

/// How images are made of pictures: all ways give the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(not(test), expect(dead_code, reason = "tests compare the ways"))]
pub(super) enum Way {
    /// Whichever of the others costs least.
    Fastest,
    /// By stencils, where footprints repeat.
    Stencils,
    /// By row sums, between rectilinear charts.
    Sums,
    /// By the borders of the picture.
    Outlines,
}

/// A direction, the picture seen along it, and what that counts.
#[derive(Clone, Copy, Debug)]
struct Ray {
    picture: usize,
    mu: DVec3,
    weight: f64,
}

/// Room that resampling reuses.
#[derive(Debug, Default)]
pub(super) struct Room {
    rays: Vec<Ray>,
    shadows: Vec<DVec3>,
    cover: Cover,
    sums: Sums,
    samples: Vec<Sample>,
    taps: Taps,
}

/// Means over the positions of one direction cell.
pub(super) type Image = Vec<[f64; 3]>;

/// Steps from texel to texel along a grid line that cost as much as a border: 6 to 9,
/// measured (`cargo bench --bench transport -- picture`).
const STEPS_A_BORDER: usize = 8;

impl<'a, S: Source> Slices<'a, S> {
    /// Tests ask for one of the ways; all give the same.
    ///
    /// # Errors
    ///
    /// [`Error::BentGrid`] for a bilinear chart of the destination.
    pub(super) fn new(
        geometry: &'a TransportGeometry,
        source: &'a S,
        levels: Levels,
        way: Way,
    ) -> Result<Self> {
        let plane = Plane::of(geometry.dest().chart(), 1 << levels.position);
        let plane = plane.ok_or(Error::BentGrid { chart: "bilinear" })?;
        let unit = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
        let around = |polygon: &crate::Polygon| unit.map(|uv| polygon.chart().to_plane(uv));
        let (source_corners, dest_corners) = (around(geometry.source()), around(geometry.dest()));
        let mut slices = Self {
            geometry,
            source,
            levels,
            plane,
            source_corners,
            dest_corners,
            visible: within(visible(geometry, source_corners, dest_corners), geometry, source),
            pictures: Pictures::Outlines(Vec::new()),
        };
        slices.pictures = slices.prepared(way);
        Ok(slices)
    }

    /// What it was made for.
    pub(super) fn parts(&self) -> (&'a TransportGeometry, &'a S, Levels) {
        (self.geometry, self.source, self.levels)
    }

    /// The source's pictures for the fastest way, or for this one if it can be gone.
    fn prepared(&self, way: Way) -> Pictures {
        let side = 1 << self.source.level();
        let pictures = || self.source.pictures().into_iter();
        let repeat = self.repeat().filter(|_| matches!(way, Way::Fastest | Way::Stencils));
        if let Some(repeat) = repeat {
            return Pictures::Repeating(
                repeat,
                pictures().map(|p| repeat.picture(p, side)).collect(),
            );
        }
        let corners = corners(self.geometry, side);
        let outlines: Vec<_> = pictures().map(|p| Outline::new(&corners, p, side)).collect();
        let sums = match way {
            Way::Fastest => {
                // A line of the destination's grid crosses at most so many texels.
                let cells = 1 << self.levels.position;
                let steps = 2 * (cells + 1) * (2 * side + cells);
                let borders: usize = outlines.iter().map(Outline::len).sum();
                STEPS_A_BORDER * borders > steps * outlines.len()
            }
            other => matches!(other, Way::Sums),
        };
        // Both planes may cut an outline; sums need the whole destination in front.
        if sums && self.is_rectilinear() && self.is_in_front() {
            return Pictures::Summed(pictures().map(|p| Summed::new(p, side)).collect());
        }
        Pictures::Outlines(outlines)
    }

    /// Whether both charts are rectilinear.
    fn is_rectilinear(&self) -> bool {
        self.geometry.source().size().is_some() && self.geometry.dest().size().is_some()
    }

    /// The way that images are made.
    #[cfg(test)]
    pub(super) fn way(&self) -> Way {
        match self.pictures {
            Pictures::Outlines(_) => Way::Outlines,
            Pictures::Summed(_) => Way::Sums,
            Pictures::Repeating(..) => Way::Stencils,
        }
    }

    /// The directions of a cell (κ fastest) from which the source can be seen.
    pub(super) fn regions(&self, direction: usize) -> Vec<Region> {
        let level = self.levels.direction;
        let cosine = self.cosine();
        let m = DVec2::new((direction & ((1 << level) - 1)) as f64, (direction >> level) as f64);
        let (low, high) = (m * cosine - 1.0, (m + 1.0) * cosine - 1.0);
        Region::of(low.max(self.visible[0]), high.min(self.visible[1]))
    }

    /// The image of a direction cell from points along both sides of each of its
    /// regions, so many; `None` if nothing of the source is seen.
    pub(super) fn image(&self, regions: &[(Region, [u32; 2])], room: &mut Room) -> Option<Image> {
        room.rays.clear();
        for (region, n) in regions {
            self.sample(region, *n, &mut room.rays);
        }
        if room.rays.is_empty() {
            return None;
        }
        let cells = 1 << self.levels.position;
        match &self.pictures {
            Pictures::Repeating(repeat, pictures) => {
                room.samples.clear();
                room.samples.extend(room.rays.iter().map(|ray| Sample {
                    picture: ray.picture,
                    footprint: self.footprint(ray.mu),
                    weight: ray.weight,
                }));
                room.samples.sort_by_key(|sample| sample.picture);
                let mut out = vec![[0.0; 3]; self.levels.positions()];
                repeat.resample(pictures, &room.samples, cells, &mut room.taps, &mut out);
                out.iter().any(|rgb| *rgb != [0.0; 3]).then_some(out)
            }
            Pictures::Summed(pictures) => {
                room.sums.reset(cells);
                for &Ray { picture, mu, weight } in &room.rays {
                    pictures[picture].shine(&self.footprint(mu), weight, &mut room.sums);
                }
                room.sums.means()
            }
            Pictures::Outlines(outlines) => {
                room.cover.reset(cells);
                for &Ray { picture, mu, weight } in &room.rays {
                    let (shadows, cover) = (&mut room.shadows, &mut room.cover);
                    outlines[picture].shine(&self.plane, mu, weight, shadows, cover);
                }
                room.cover.means(self.plane.mirrored())
            }
        }
    }

    /// Appends the rays of a region.
    fn sample(&self, region: &Region, n: [u32; 2], rays: &mut Vec<Ray>) {
        let scale = (self.cosine() * self.cosine()).recip();
        for i in 0..n[0] * n[1] {
            let [(s, ws), (t, wt)] = [(i % n[0], n[0]), (i / n[0], n[1])].map(|(i, n)| point(i, n));
            let Some((mu, measure)) = region.at(s, t) else { continue };
            let travel = self.geometry.source_direction(mu);
            // Rays along the source's plane carry nothing and map to infinity.
            if travel.z < 1e-9 {
                continue;
            }
            let Some((picture, factor)) = self.source.slice(travel) else { continue };
            rays.push(Ray { picture, mu, weight: ws * wt * measure * scale * factor });
        }
    }

    /// How far footprints move over a `region`, in texels or in destination cells if
    /// these are larger, along s and along t.
    pub(super) fn travel(&self, region: &Region) -> [f64; 2] {
        let [x, y, n] = self.geometry.source_axes();
        let pixels = f64::from(1_u32 << self.source.level());
        let (source_size, dest_size) = (size(self.source_corners), size(self.dest_corners));
        let scale = DVec2::splat(pixels) / source_size;
        // A point at height h over the source's plane is projected h × this away.
        let slope = |s: f64, t: f64| {
            let (mu, _) = region.at(s.clamp(1e-6, 1.0 - 1e-6), t.clamp(1e-6, 1.0 - 1e-6))?;
            let rate = n.dot(mu);
            (rate < -1e-6).then(|| DVec2::new(x.dot(mu), y.dot(mu)) / rate)
        };
        let offset = self.geometry.source_to_dest(DVec2::ZERO);
        let height = self
            .dest_corners
            .map(|corner| n.dot(corner.extend(0.0) - offset))
            .into_iter()
            .fold(0.0, f64::max);
        // Only what is seen counts: it moved by no more than across both polygons.
        let across = source_size.length() + dest_size.length() + offset.length();
        let cell = pixels / f64::from(1_u32 << self.levels.position)
            * (dest_size / source_size).max_element();
        let distance = |a: Option<DVec2>, b: Option<DVec2>| {
            let (Some(a), Some(b)) = (a, b) else { return f64::INFINITY };
            let seen = height.min(across / a.length().min(b.length()).max(1e-12));
            ((a - b) * scale).length() * seen / cell.max(1.0)
        };
        let middle = |along: usize| {
            let at = |x: f64, y: f64| if along == 0 { slope(x, y) } else { slope(y, x) };
            [0.0, 0.5, 1.0]
                .map(|y| distance(at(0.0, y), at(1.0, y)))
                .into_iter()
                .fold(0.0, f64::max)
        };
        [middle(0), middle(1)]
    }

    /// Whether the oracle proves that a direction cell (κ fastest) sees nothing, or
    /// that no part of it does.
    pub(super) fn sees_nothing(&self, direction: usize) -> bool {
        // Deep enough for what lies a few cells beside a source.
        const DEPTH: u8 = 2;
        let level = self.levels.direction;
        let (k, l) = (direction & ((1 << level) - 1), direction >> level);
        let levels = Levels { position: 0, direction: level };
        let dest = Support { levels, m: [0, 0, k as u16, l as u16] };
        is_blind(self.geometry, Support::isotropic(0, [0; 4]), dest, DEPTH)
    }

    /// √ of the sum of squares over the positions and channels of an image that has
    /// the source's brightest texel everywhere.
    pub(super) fn brightest(&self) -> f64 {
        let energy = |rgb: &Rgb| rgb.iter().map(|&x| f64::from(x) * f64::from(x)).sum::<f64>();
        let pictures = self.source.pictures().into_iter().flatten();
        let most = pictures.map(energy).fold(0.0, f64::max);
        (most * self.levels.positions() as f64).sqrt()
    }

    /// Whether the whole destination is in front of the source's plane, up to rounding.
    fn is_in_front(&self) -> bool {
        let [_, _, n] = self.geometry.source_axes();
        let offset = self.geometry.source_to_dest(DVec2::ZERO);
        let least = -1e-12 * (size(self.dest_corners).length() + offset.length());
        self.dest_corners.iter().all(|corner| n.dot(corner.extend(0.0) - offset) >= least)
    }

    /// Side of a direction cell in cosines.
    fn cosine(&self) -> f64 {
        2.0 / f64::from(1_u32 << self.levels.direction)
    }

    /// The axis along which footprints repeat, if they do.
    fn repeat(&self) -> Option<Repeat> {
        // The source's plane must not cut through the destination.
        if !self.is_rectilinear() || !self.is_in_front() {
            return None;
        }
        let [_, _, n] = self.geometry.source_axes();
        // Two directions that see the source's front, in general position to it.
        let at = |turn: DVec3| self.footprint((turn - n).normalize());
        let (one, other) = (at(DVec3::new(0.31, 0.17, 0.23)), at(DVec3::new(-0.13, 0.29, -0.19)));
        Repeat::of(&one, &other, 1 << self.levels.position)
    }

    /// Destination (u, v) → source texels along `mu`, between rectilinear charts.
    fn footprint(&self, mu: DVec3) -> Footprint {
        let [x, y, n] = self.geometry.source_axes();
        let offset = self.geometry.source_to_dest(DVec2::ZERO);
        let pixels = f64::from(1_u32 << self.source.level());
        let (source_size, dest_size) = (self.source_corners[2], self.dest_corners[2]);
        // The component in the source's plane of a vector moved along μ onto it.
        let slide = |v: DVec3| {
            let on = v - mu * (n.dot(v) / n.dot(mu));
            DVec2::new(x.dot(on), y.dot(on)) / source_size * pixels
        };
        Footprint {
            origin: slide(-offset),
            du: slide(DVec3::X * dest_size.x),
            dv: slide(DVec3::Y * dest_size.y),
        }
    }
}

/// Mean lengths of a chart's sides along u and along v.
fn size([a, b, c, d]: [DVec2; 4]) -> DVec2 {
    0.5 * DVec2::new(a.distance(b) + d.distance(c), a.distance(d) + b.distance(c))
}

/// Node and weight `i` of the midpoint rule with `n` points on [0, 1], corrected at
/// its ends.
///
/// The rule's error is h²/24 (f′(1) − f′(0)) and then of order h⁴; the derivatives
/// are had from three points at either end (Euler-Maclaurin).
fn point(i: u32, n: u32) -> (f64, f64) {
    const CORRECTION: [f64; 3] = [2.0 / 24.0, -3.0 / 24.0, 1.0 / 24.0];
    let h = f64::from(n).recip();
    let at = |i: u32| CORRECTION.get(i as usize).copied().unwrap_or(0.0);
    let correction = if n < 3 { 0.0 } else { at(i) + at(n - 1 - i) };
    ((f64::from(i) + 0.5) * h, (1.0 + correction) * h)
}

/// Those of the bounds `visible` on μx and μy that the source's cone of light meets.
fn within(visible: [DVec2; 2], geometry: &TransportGeometry, source: &impl Source) -> [DVec2; 2] {
    let Some((axis, radius)) = source.cone() else { return visible };
    let [x, y, n] = geometry.source_axes();
    // Towards where the light comes from, in the destination's frame.
    let to = -(x * axis.x + y * axis.y + n * axis.z);
    let bound = |mu: f64, r: f64| (mu.clamp(-1.0, 1.0).acos() + r).clamp(0.0, PI).cos();
    let low = DVec2::new(bound(to.x, radius), bound(to.y, radius)) - 1e-12;
    let high = DVec2::new(bound(to.x, -radius), bound(to.y, -radius)) + 1e-12;
    [visible[0].max(low), visible[1].min(high)]
}

/// Bounds on μx and μy of all directions from the destination to the source.
///
/// With d = source point − destination point in a box, μx = dx / |d| is bounded
/// by the extreme dx over the least (for large |μx|) or greatest rest √(dy²+dz²).
fn visible(geometry: &TransportGeometry, source: [DVec2; 4], dest: [DVec2; 4]) -> [DVec2; 2] {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for s in source {
        for d in dest {
            let between = geometry.source_to_dest(s) - d.extend(0.0);
            (low, high) = (low.min(between), high.max(between));
        }
    }
    // Only what is above the destination counts.
    low.z = low.z.max(0.0);
    high.z = high.z.max(0.0);
    let least = |low: f64, high: f64| {
        if low <= 0.0 && high >= 0.0 { 0.0 } else { low.abs().min(high.abs()) }
    };
    let most = |low: f64, high: f64| low.abs().max(high.abs());
    let bound = |i: usize, j: usize| {
        let near = least(low[j], high[j]).hypot(least(low.z, high.z));
        let far = most(low[j], high[j]).hypot(most(low.z, high.z));
        let cosine = |d: f64, rest: f64| if d == 0.0 { 0.0 } else { d / d.hypot(rest) };
        let top = cosine(high[i], if high[i] > 0.0 { near } else { far });
        let bottom = cosine(low[i], if low[i] < 0.0 { near } else { far });
        (bottom, top)
    };
    let ((x0, x1), (y0, y1)) = (bound(0, 1), bound(1, 0));
    // Rounding must not shave a direction off.
    [DVec2::new(x0, y0) - 1e-12, DVec2::new(x1, y1) + 1e-12]
}
