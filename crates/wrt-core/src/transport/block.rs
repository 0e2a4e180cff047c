//! Transport of a whole level at once (§6.3, Eq. 17): for one direction all
//! position pairs share one area-exact resampling.
//!
//! Departs from §7.2.4.5, which integrates each coefficient by itself: that
//! recursion stays as the reference.

use super::TransportGeometry;
use super::refine::{Order, Settling, settle_all};
use super::slice::{Image, Room, Slices, Way};
use crate::grid::{Grid, Rgb};
use crate::{Emission, Levels, Nusselt, Result};
use glam::DVec3;
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

    /// The axis (in the source's frame) and the radius in radians of a cone that all
    /// light travels in, if there is a narrow one: other directions are then left out.
    fn cone(&self) -> Option<(DVec3, f64)> {
        None
    }
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

    fn cone(&self) -> Option<(DVec3, f64)> {
        self.lobe().cone()
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
/// # Errors
///
/// [`Error::BentGrid`](crate::Error::BentGrid) if the destination's chart is bilinear:
/// blocks need its grid lines straight.
pub fn transport_block(
    geometry: &TransportGeometry,
    source: &impl Source,
    levels: Levels,
    options: BlockOptions,
) -> Result<Grid> {
    let slices = Slices::new(geometry, source, levels, Way::Fastest)?;
    let images = (0..levels.directions())
        .into_par_iter()
        .map_init(Room::default, |room, d| {
            let regions = slices.regions(d).into_iter();
            let regions: Vec<_> = regions.map(|region| (region, [options.samples; 2])).collect();
            let image = slices.image(&regions, room)?;
            Some(single(&image))
        })
        .collect();
    Ok(Grid::from_images(levels, images))
}

/// A block and how far it is off.
#[derive(Clone, Debug)]
pub struct Transported {
    /// The radiance that arrives, as [`transport_block`] gives it.
    pub grid: Grid,
    /// Estimated relative L² error (RED, §7.1.4.3) of `grid`, all channels together.
    pub relative_error: f64,
}

/// As [`transport_block`], with as many samples in each direction cell as it takes
/// for a relative L² error (RED) of at most `tolerance` over the whole block.
///
/// The estimate compares rules of different fineness cell by cell, with an order of
/// convergence that some of the cells measure. A cell that has not settled after
/// 65 536 samples stays as it is, and `relative_error` says so. No tolerance below what
/// single precision stores, some 10⁻⁷, can be met.
///
/// # Errors
///
/// As [`transport_block`].
pub fn transport_within(
    geometry: &TransportGeometry,
    source: &impl Source,
    levels: Levels,
    tolerance: f64,
) -> Result<Transported> {
    let slices = Slices::new(geometry, source, levels, Way::Fastest)?;
    let mut cells: Vec<Option<Settling>> = (0..levels.directions())
        .into_par_iter()
        .map_init(Room::default, |room, d| Settling::begin(&slices, d, room))
        .collect();
    let order = Order::measured(&mut cells, &slices);
    let energy =
        |cells: &[Option<Settling>]| cells.iter().flatten().map(|cell| cell.energy).sum::<f64>();
    let total = tolerance * tolerance * energy(&cells);
    settle_all(&mut cells, &slices, total, order);
    let error: f64 = cells.iter().flatten().map(|cell| cell.error(order).powi(2)).sum();
    let energy = energy(&cells);
    let images = cells.iter().map(|cell| cell.as_ref()?.image.as_ref().map(single)).collect();
    Ok(Transported {
        grid: Grid::from_images(levels, images),
        relative_error: if energy > 0.0 { (error / energy).sqrt() } else { 0.0 },
    })
}

fn single(image: &Image) -> Vec<Rgb> {
    image.iter().map(|rgb| rgb.map(|x| x as f32)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::{CellRule, Exact, Support};
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
            let grid = transport_block(&geometry, &emission, levels, BlockOptions { samples })
                .expect("straight grid lines");
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
            transport_block(&geometry, &emission, levels, BlockOptions { samples: 8 })
                .expect("straight grid lines")
                .irradiance()
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
        let grid = transport_block(&geometry, &emission, levels, BlockOptions { samples: 8 })
            .expect("straight grid lines");
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

    /// Sources over the unit square: over it, across it, at an edge, far away; and
    /// with charts that are not rectilinear.
    fn geometries() -> Vec<TransportGeometry> {
        let floor = rectangle([0., 0., 0.], [1., 0., 0.], [0., 1., 0.]);
        [
            rectangle([-0.2, 1.5, 0.3], [1., 0., 0.], [0., 0., 1.]),
            rectangle([-0.3, 0.7, 1.2], [0., 0.8, -0.6], [0.8, 0.36, 0.48]),
            rectangle([0., 1., 0.], [1., 0., 0.], [0., 0., 1.]),
            rectangle([0.2, 7.0, 0.6], [1., 0., 0.], [0., 0., 1.]),
            // Backwards, and u over v.
            rectangle([0.3, 0.2, 1.0], [0., -1., 0.], [-0.5, 0., 0.]),
        ]
        .map(|source| TransportGeometry::new(source, floor.clone()))
        .into_iter()
        .chain(curved())
        .collect()
    }

    /// A tapered window over a floor that tapers towards u = 1, towards u = 0; one
    /// that goes through a tapered floor; one of a bilinear chart.
    fn curved() -> [TransportGeometry; 4] {
        let at = |corners: [[f64; 3]; 4]| corners.map(DVec3::from);
        let quad = |corners| Polygon::perspective(at(corners)).expect("a quadrilateral");
        let wall = [[-0.2, 1.3, 0.2], [0.9, 1.4, 0.3], [0.6, 1.3, 1.2], [0.0, 1.2, 1.1]];
        let wall = wall.map(|[x, _, z]| [x, 1.5, z]);
        let to_right = [[0., 0., 0.], [1., 0.3, 0.], [1., 0.6, 0.], [0., 1., 0.]];
        let to_left = [[0., 0.3, 0.], [1., 0., 0.], [1., 1.1, 0.], [0., 0.7, 0.]];
        let through = [[0.2, 0.6, -0.4], [0.9, 0.7, -0.3], [0.8, 0.6, 0.7], [0.1, 0.55, 0.5]];
        let through = through.map(|[x, _, z]| [x, 0.6 + 0.1 * z, z]);
        let bilinear = Polygon::bilinear(at(wall)).expect("a quadrilateral");
        [
            TransportGeometry::new(quad(wall), quad(to_right)),
            TransportGeometry::new(quad(wall), quad(to_left)),
            TransportGeometry::new(quad(through), quad(to_right)),
            TransportGeometry::new(bilinear, quad(to_left)),
        ]
    }

    #[test]
    fn a_bent_grid_is_refused() {
        let corners = [[0., 0., 0.], [1., 0.3, 0.], [1., 0.6, 0.], [0., 1., 0.]];
        let bent = Polygon::bilinear(corners.map(DVec3::from)).expect("a quadrilateral");
        let window = rectangle([0., 1.5, 0.], [1., 0., 0.], [0., 0., 1.]);
        let geometry = TransportGeometry::new(window, bent);
        let emission = Emission::new(0, vec![[1.0; 3]], Lobe::Lambertian);
        let found = transport_within(&geometry, &emission, Levels::isotropic(1), 1e-2);
        assert!(matches!(found, Err(crate::Error::BentGrid { chart: "bilinear" })), "{found:?}");
    }

    fn window(level: u8) -> Emission {
        let picture = (0..1_u16 << (2 * level)).map(|i| {
            [f32::from(i % 5), f32::from(i % 3), f32::from(u8::from(i % 4 > 1))].map(|x| 0.3 * x)
        });
        Emission::new(level, picture.collect(), Lobe::Lambertian)
    }

    /// ‖a − b‖ / ‖b‖.
    fn red(a: &Grid, b: &Grid) -> f64 {
        let levels = b.levels();
        let (p, d) = (1 << levels.position, 1 << levels.direction);
        let (mut difference, mut size) = (0.0, 0.0);
        for i in 0..levels.positions() * levels.directions() {
            let m = [i % p, i / p % p, i / (p * p) % d, i / (p * p * d)];
            for (a, b) in a.mean(m).into_iter().zip(b.mean(m)) {
                difference += f64::from(a - b).powi(2);
                size += f64::from(b).powi(2);
            }
        }
        (difference / size).sqrt()
    }

    /// Every cell against the kink-split integral of each source cell: two ways that
    /// share neither clipping nor quadrature.
    #[test]
    fn a_block_within_a_tolerance_is_that_far_from_exact() {
        let levels = Levels { position: 1, direction: 2 };
        let source = window(1);
        for (case, geometry) in geometries().iter().enumerate() {
            let rule = CellRule::Exact(Exact { tolerance: 1e-6 });
            let from = Levels { position: 1, direction: 0 };
            let mean = |k: [u16; 4]| {
                let mut sum = [0.0; 3];
                for (j, texel) in source.picture().iter().enumerate() {
                    let j = Support { levels: from, m: [j as u16 % 2, j as u16 / 2, 0, 0] };
                    let found = rule.radiance(geometry, j, Support { levels, m: k });
                    for (sum, x) in sum.iter_mut().zip(texel) {
                        *sum += found.mean * f64::from(*x);
                    }
                }
                sum.map(|x| x as f32)
            };
            let images = (0..16_u16)
                .map(|d| Some((0..4_u16).map(|p| mean([p % 2, p / 2, d % 4, d / 4])).collect()));
            let exact = Grid::from_images(levels, images.collect());
            for tolerance in [3e-2, 1e-3, 1e-4] {
                let found = transport_within(geometry, &source, levels, tolerance)
                    .expect("straight grid lines");
                let (error, estimate) = (red(&found.grid, &exact), found.relative_error);
                assert!(estimate <= tolerance, "case {case}: {estimate} for {tolerance}");
                assert!(error <= estimate + 1e-6, "case {case}: {error} ± {estimate}");
            }
        }
    }

    /// Also for pictures finer than the destination, and a source of direction cells.
    #[test]
    fn estimates_of_a_block_hold() {
        let levels = Levels::isotropic(3);
        for (case, geometry) in geometries()[..5].iter().enumerate() {
            let source = window(4);
            let fine = transport_within(geometry, &source, levels, 1e-4)
                .expect("straight grid lines")
                .grid;
            let found =
                transport_within(geometry, &source, levels, 1e-2).expect("straight grid lines");
            let error = red(&found.grid, &fine);
            let estimate = found.relative_error;
            assert!(error <= estimate && estimate <= 1e-2, "case {case}: {error} ± {estimate}");
        }
        let geometry = &geometries()[1];
        let source = window(2).project(3);
        let fine =
            transport_within(geometry, &source, levels, 2e-3).expect("straight grid lines").grid;
        let found = transport_within(geometry, &source, levels, 2e-2).expect("straight grid lines");
        let (error, estimate) = (red(&found.grid, &fine), found.relative_error);
        assert!(error <= estimate && estimate <= 2e-2, "{error} ± {estimate}");
    }

    /// Stencils where footprints repeat by whole texels (rectilinear and not oblique),
    /// sums between all rectilinear charts, borders everywhere.
    #[test]
    fn all_ways_give_the_same() {
        let levels = Levels { position: 3, direction: 4 };
        for (case, geometry) in geometries().iter().enumerate() {
            let source = window(3);
            let [stencils, sums, slow] = [Way::Stencils, Way::Sums, Way::Outlines].map(|way| {
                let slices =
                    Slices::new(geometry, &source, levels, way).expect("straight grid lines");
                let able = match way {
                    Way::Stencils => [0, 2, 3, 4].contains(&case),
                    _ => case < 5,
                };
                assert_eq!(slices.way(), if able { way } else { Way::Outlines }, "case {case}");
                let mut room = Room::default();
                let images = (0..levels.directions()).map(|d| {
                    let regions = slices.regions(d).into_iter();
                    let regions: Vec<_> = regions.map(|region| (region, [5, 3])).collect();
                    Some(single(&slices.image(&regions, &mut room)?))
                });
                Grid::from_images(levels, images.collect())
            });
            for fast in [stencils, sums] {
                let error = red(&fast, &slow);
                assert!(error < 1e-7, "case {case}: {error}");
            }
        }
    }

    #[test]
    fn a_block_is_the_same_from_any_number_of_threads() {
        let geometry = &geometries()[1];
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let pool = pool.expect("a thread pool");
            let found = pool
                .install(|| transport_within(geometry, &window(3), Levels::isotropic(2), 1e-3))
                .expect("straight grid lines");
            (found.grid.images().to_vec(), found.relative_error)
        };
        assert_eq!(run(1), run(3));
    }
}
