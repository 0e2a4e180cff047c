//! Transport of a whole level at once (§6.3, Eq. 17): for one direction all
//! position pairs share one area-exact resampling.
//!
//! Departs from §7.2.4.5, which integrates each coefficient by itself: that
//! recursion stays as the reference.

use super::TransportGeometry;
use super::resample::{Footprint, Reach, Scratch, SummedImage, resample};
use crate::grid::{Grid, Rgb};
use crate::{ConvexPolygon, Emission, Levels, Nusselt};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Radiance that leaves a source: for each direction a picture and a factor.
pub trait Source: Sync {
    /// The pictures, each 4^[`level`](Self::level) long, u fastest.
    fn pictures(&self) -> Vec<&[Rgb]>;

    /// The level of the pictures.
    fn level(&self) -> u8;

    /// Which picture is seen, times what, in light that travels along the unit
    /// vector `travel` of the source's frame (z > 0).
    fn slice(&self, travel: DVec3) -> Option<(usize, f64)>;
}

impl Source for Emission {
    fn pictures(&self) -> Vec<&[Rgb]> {
        vec![self.picture()]
    }

    fn level(&self) -> u8 {
        self.level()
    }

    fn slice(&self, travel: DVec3) -> Option<(usize, f64)> {
        let factor = self.lobe().eval(travel);
        (factor > 0.0).then_some((0, factor))
    }
}

impl Source for Grid {
    fn pictures(&self) -> Vec<&[Rgb]> {
        self.images().iter().map(Vec::as_slice).collect()
    }

    fn level(&self) -> u8 {
        self.levels().position
    }

    fn slice(&self, travel: DVec3) -> Option<(usize, f64)> {
        let q = Nusselt::from_direction(travel)?;
        let level = self.levels().direction;
        let side = 1_usize << level;
        let cell = |x: f64| ((x * side as f64) as usize).min(side - 1);
        self.slice(cell(q.lambda) << level | cell(q.kappa)).map(|(i, f)| (i, f64::from(f)))
    }
}

/// How finely a block is integrated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockOptions {
    /// Directions sampled along each side of a direction cell.
    pub samples: u32,
}

impl Default for BlockOptions {
    fn default() -> Self {
        Self { samples: 8 }
    }
}

/// The radiance that arrives at the destination, as means over the cells of
/// `levels`; positions on the chart's whole rectangle.
///
/// Directions are sampled at midpoints of the part of each direction cell from
/// which the source can be seen at all; positions are exact.
///
/// # Panics
///
/// If either polygon's chart is not rectilinear: the map of positions is affine
/// between those only.
#[must_use]
pub fn transport_block(
    geometry: &TransportGeometry,
    source: &impl Source,
    levels: Levels,
    options: BlockOptions,
) -> Grid {
    let block = Block::new(geometry, source, levels);
    let images = (0..levels.directions())
        .into_par_iter()
        .map_init(Scratch::default, |scratch, d| block.image(d, options.samples, scratch))
        .collect();
    Grid::from_images(levels, images)
}

struct Block<'a, S> {
    geometry: &'a TransportGeometry,
    source: &'a S,
    pictures: Vec<SummedImage>,
    levels: Levels,
    reach: Reach,
    source_size: DVec2,
    dest_size: DVec2,
    /// Cosines (μx, μy) that bound the directions to the source, low and high.
    visible: [DVec2; 2],
}

impl<'a, S: Source> Block<'a, S> {
    fn new(geometry: &'a TransportGeometry, source: &'a S, levels: Levels) -> Self {
        let size = |polygon: &crate::Polygon| match polygon.size() {
            Some(size) => size,
            None => panic!("block transport is for rectilinear charts"),
        };
        let side = 1 << source.level();
        let pictures = source.pictures().iter().map(|p| SummedImage::new(p, side)).collect();
        let (source_size, dest_size) = (size(geometry.source()), size(geometry.dest()));
        Self {
            geometry,
            source,
            pictures,
            levels,
            reach: reach(geometry, dest_size, levels.position),
            source_size,
            dest_size,
            visible: visible(geometry, source_size, dest_size),
        }
    }

    /// The position image of one direction cell.
    fn image(&self, direction: usize, samples: u32, scratch: &mut Scratch) -> Option<Vec<Rgb>> {
        let level = self.levels.direction;
        let cosine = 2.0 / f64::from(1_u32 << level);
        let m = DVec2::new((direction & ((1 << level) - 1)) as f64, (direction >> level) as f64);
        let cell = [m * cosine - 1.0, (m + 1.0) * cosine - 1.0];
        let (low, high) = (cell[0].max(self.visible[0]), cell[1].min(self.visible[1]));
        let nearest = low.max(DVec2::ZERO).min(high);
        if low.cmpge(high).any() || nearest.length_squared() >= 1.0 {
            return None;
        }
        let step = (high - low) / f64::from(samples);
        let weight = step.x * step.y / (cosine * cosine);
        let mut out: Option<Vec<[f64; 3]>> = None;
        for i in 0..samples * samples {
            let at = DVec2::new(f64::from(i % samples), f64::from(i / samples)) + 0.5;
            let mu = low + at * step;
            let height = 1.0 - mu.length_squared();
            if height <= 0.0 {
                continue;
            }
            let mu = mu.extend(height.sqrt());
            let travel = self.geometry.source_direction(mu);
            // Rays along the source's plane carry nothing and map to infinity.
            if travel.z < 1e-9 {
                continue;
            }
            let Some((picture, factor)) = self.source.slice(travel) else { continue };
            let out = out.get_or_insert_with(|| vec![[0.0; 3]; self.levels.positions()]);
            resample(
                &self.pictures[picture],
                &self.footprint(mu),
                &self.reach,
                1 << self.levels.position,
                weight * factor,
                scratch,
                out,
            );
        }
        let image: Vec<Rgb> = out?.iter().map(|rgb| rgb.map(|x| x as f32)).collect();
        image.iter().any(|rgb| *rgb != [0.0; 3]).then_some(image)
    }

    /// Destination (u, v) → source pixels along `mu`.
    fn footprint(&self, mu: DVec3) -> Footprint {
        let [x, y, n] = self.geometry.source_axes();
        let offset = self.geometry.source_to_dest(DVec2::ZERO);
        let pixels = f64::from(1_u32 << self.source.level());
        // The component in the source's plane of a vector moved along μ onto it.
        let slide = |v: DVec3| {
            let on = v - mu * (n.dot(v) / n.dot(mu));
            DVec2::new(x.dot(on), y.dot(on)) / self.source_size * pixels
        };
        Footprint {
            origin: slide(-offset),
            du: slide(DVec3::X * self.dest_size.x),
            dv: slide(DVec3::Y * self.dest_size.y),
        }
    }
}

/// The parts of the destination's cells in front of the source's plane.
fn reach(geometry: &TransportGeometry, size: DVec2, level: u8) -> Reach {
    let [_, _, n] = geometry.source_axes();
    let offset = geometry.source_to_dest(DVec2::ZERO);
    let front = |uv: DVec2| n.dot((uv * size).extend(0.0) - offset);
    let unit = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
    // A shared edge lies on the plane up to rounding.
    let rounding = 1e-12 * (size.length() + offset.length());
    if unit.iter().all(|&c| front(c) >= -rounding) {
        return Reach::All;
    }
    let side = 1_usize << level;
    let part = |i: usize| {
        let at = DVec2::new((i % side) as f64, (i / side) as f64);
        let corners = unit.map(|c| (at + c) / side as f64);
        let part = ConvexPolygon::new(&corners).clipped(front);
        let whole = part.vertices() == corners;
        (!whole).then(|| part.vertices().to_vec())
    };
    Reach::Parts((0..side * side).map(part).collect())
}

/// Bounds on μx and μy of all directions from the destination to the source.
///
/// With d = source point − destination point in a box, μx = dx / |d| is bounded
/// by the extreme dx over the least (for large |μx|) or greatest rest √(dy²+dz²).
fn visible(geometry: &TransportGeometry, source: DVec2, dest: DVec2) -> [DVec2; 2] {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for s in [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y] {
        for d in [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y] {
            let between = geometry.source_to_dest(s * source) - (d * dest).extend(0.0);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Lobe, Polygon};

    fn rectangle(origin: [f64; 3], u: [f64; 3], v: [f64; 3]) -> Polygon {
        Polygon::rectangle(origin.into(), u.into(), v.into()).expect("a rectangle")
    }

    /// Two facing unit squares at distance 1: F = 0.19982489569838746, so the
    /// mean irradiance for L = 1 is πF (J. R. Howell, *A catalog of radiation heat
    /// transfer configuration factors*, C-11).
    #[test]
    fn facing_squares_exchange_their_form_factor() {
        let floor = rectangle([0., 0., 0.], [1., 0., 0.], [0., 1., 0.]);
        let ceiling = rectangle([0., 0., 1.], [0., 1., 0.], [1., 0., 0.]);
        let geometry = TransportGeometry::new(ceiling, floor);
        let emission = Emission::new(0, vec![[1.0, 2.0, 0.5]], Lobe::Lambertian);
        let levels = Levels::isotropic(3);
        let expected = std::f64::consts::PI * 0.199_824_895_698_387_46;
        let mut errors = vec![];
        for samples in [4, 16] {
            let grid = transport_block(&geometry, &emission, levels, BlockOptions { samples });
            let mean = |c: usize| grid.irradiance().iter().map(|e| e[c]).sum::<f64>() / 64.0;
            assert!((mean(1) / mean(0) - 2.0).abs() < 1e-6, "channels are alike");
            errors.push((mean(0) / expected - 1.0).abs());
        }
        assert!(errors[1] < 2e-5 && errors[1] < 0.5 * errors[0], "{errors:?}");
    }

    /// A source that the destination's plane cuts sends what its upper half does.
    #[test]
    fn what_lies_behind_the_destination_does_not_count() {
        let floor = rectangle([0., 0., 0.], [1., 0., 0.], [0., 1., 0.]);
        let wall = |from: f64| rectangle([0., 1.5, from], [1., 0., 0.], [0., 0., 1.0 - from]);
        let emission = Emission::new(0, vec![[1.0; 3]], Lobe::Lambertian);
        let levels = Levels { position: 2, direction: 4 };
        let irradiance = |from: f64| {
            let geometry = TransportGeometry::new(wall(from), floor.clone());
            transport_block(&geometry, &emission, levels, BlockOptions { samples: 8 }).irradiance()
        };
        for (cut, half) in irradiance(-1.0).iter().zip(irradiance(0.0)) {
            assert!((cut[0] / half[0] - 1.0).abs() < 2e-3, "{cut:?} {half:?}");
        }
    }

    /// A destination that the source's plane cuts is lit on the front alone.
    #[test]
    fn what_lies_behind_the_source_stays_dark() {
        let floor = rectangle([0., 0., 0.], [1., 0., 0.], [0., 1., 0.]);
        // Faces −y, across the middle of cells 2 and 6 of 8.
        let wall = rectangle([0., 0.55, 0.], [1., 0., 0.], [0., 0., 1.]);
        let geometry = TransportGeometry::new(wall, floor);
        let emission = Emission::new(0, vec![[1.0; 3]], Lobe::Lambertian);
        let levels = Levels { position: 3, direction: 4 };
        let grid = transport_block(&geometry, &emission, levels, BlockOptions { samples: 8 });
        let rows: Vec<f64> =
            grid.irradiance().chunks(8).map(|row| row.iter().map(|e| e[0]).sum()).collect();
        assert!(
            rows[..4].iter().all(|&e| e > 0.1) && rows[5..].iter().all(|&e| e == 0.0),
            "{rows:?}"
        );
        // Row 4 covers y ∈ [0.5, 0.625], 0.4 of it in front, right at the wall:
        // E tends to π/2 there, for all of the 8 cells.
        assert!(
            (0.3..0.4 * std::f64::consts::FRAC_PI_2 + 0.01).contains(&(rows[4] / 8.0)),
            "{rows:?}"
        );
    }
}
