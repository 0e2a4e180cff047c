//! Transport of a whole level at once (§6.3, Eq. 17): for one direction all
//! position pairs share one area-exact resampling.
//!
//! Departs from §7.2.4.5, which integrates each coefficient by itself: that
//! recursion stays as the reference.

use super::TransportGeometry;
use super::handover::hand_over;
use super::refine::{Order, Settling, settle_all};
use super::slice::{Image, Room, Slices, Way};
use super::source::Source;
use crate::grid::{Grid, Rgb};
use crate::{Levels, Result};
use rayon::prelude::*;

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
/// convergence that some of the cells measure. A cell that is likely to take more than
/// 65 536 samples is handed over to the rules of [`Exact`](super::Exact), between the
/// kinks of what each of its positions sees, whose own estimate then counts. What even
/// these leave, `relative_error` says; it includes the rounding to single precision,
/// 6·10⁻⁸, and no tolerance below that can be met.
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
    let allowed = (tolerance * tolerance - SINGLE * SINGLE).max(SINGLE * SINGLE / 16.0);
    settle_all(&mut cells, &slices, allowed, order);
    hand_over(&mut cells, &slices, allowed, order);
    let error: f64 = cells.iter().flatten().map(|cell| cell.error(order).powi(2)).sum();
    let energy: f64 = cells.iter().flatten().map(|cell| cell.energy).sum();
    let images = cells.iter().map(|cell| cell.as_ref()?.image.as_ref().map(single)).collect();
    Ok(Transported {
        grid: Grid::from_images(levels, images),
        relative_error: if energy > 0.0 { (error / energy + SINGLE * SINGLE).sqrt() } else { 0.0 },
    })
}

/// Relative error of rounding to single precision, at most.
pub(super) const SINGLE: f64 = 0.5 * f32::EPSILON as f64;

fn single(image: &Image) -> Vec<Rgb> {
    image.iter().map(|rgb| rgb.map(|x| x as f32)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::{CellRule, Exact, Support};
    use crate::{Emission, Lobe, Polygon};
    use glam::DVec3;

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

    /// The block as the sum over all texels of their coefficients.
    fn from_coefficients(
        geometry: &TransportGeometry,
        source: &Emission,
        levels: Levels,
        tolerance: f64,
    ) -> Grid {
        let rule = CellRule::Exact(Exact { tolerance });
        let from = Levels { position: source.level(), direction: 0 };
        let mean = |k: [u16; 4]| {
            let mut sum = [0.0; 3];
            for (j, texel) in source.picture().iter().enumerate() {
                let (u, v) = (j & ((1 << from.position) - 1), j >> from.position);
                let j = Support { levels: from, m: [u as u16, v as u16, 0, 0] };
                let found = rule.radiance(geometry, j, Support { levels, m: k });
                for (sum, x) in sum.iter_mut().zip(texel) {
                    *sum += found.mean * f64::from(*x);
                }
            }
            sum.map(|x| x as f32)
        };
        let cells = |level: u8| {
            let side = 1_u16 << level;
            (0..side * side).map(move |i| [i % side, i / side])
        };
        let images = cells(levels.direction)
            .map(|[k, l]| Some(cells(levels.position).map(|[u, v]| mean([u, v, k, l])).collect()));
        Grid::from_images(levels, images.collect())
    }

    /// Every cell against the kink-split integral of each source cell: two ways that
    /// share neither clipping nor quadrature.
    #[test]
    fn a_block_within_a_tolerance_is_that_far_from_exact() {
        let levels = Levels { position: 1, direction: 2 };
        let source = window(1);
        for (case, geometry) in geometries().iter().enumerate() {
            let exact = from_coefficients(geometry, &source, levels, 1e-6);
            for tolerance in [3e-2, 1e-3, 1e-4] {
                let found = transport_within(geometry, &source, levels, tolerance)
                    .expect("straight grid lines");
                let (error, estimate) = (red(&found.grid, &exact), found.relative_error);
                assert!(estimate <= tolerance, "case {case}: {estimate} for {tolerance}");
                assert!(error <= estimate + 1e-6, "case {case}: {error} ± {estimate}");
            }
        }
    }

    /// What 65 536 samples a cell do not settle, the rules between kinks do, to single
    /// precision: across tilted planes, from a shared edge, on charts that taper.
    #[test]
    fn what_samples_do_not_settle_is_handed_over() {
        let levels = Levels { position: 1, direction: 1 };
        let source = window(1);
        let all = geometries();
        for (case, geometry) in [1, 2, 5].map(|case| (case, &all[case])) {
            let exact = from_coefficients(geometry, &source, levels, 1e-10);
            let sampled = transport_block(geometry, &source, levels, BlockOptions { samples: 256 });
            let sampled = red(&sampled.expect("straight grid lines"), &exact);
            assert!(sampled > 2e-7, "case {case}: samples alone do: {sampled}");
            for tolerance in [1e-6, 1e-7] {
                let found = transport_within(geometry, &source, levels, tolerance)
                    .expect("straight grid lines");
                let (error, estimate) = (red(&found.grid, &exact), found.relative_error);
                assert!(estimate <= tolerance, "case {case}: {estimate} for {tolerance}");
                assert!(error <= estimate, "case {case}: {error} ± {estimate}");
            }
        }
    }

    #[test]
    fn form_factors_are_met_to_single_precision() {
        let floor = rectangle([0., 0., 0.], [1., 0., 0.], [0., 1., 0.]);
        let ceiling = rectangle([0., 0., 1.], [0., 1., 0.], [1., 0., 0.]);
        let geometry = TransportGeometry::new(ceiling, floor);
        let emission = Emission::new(0, vec![[1.0, 2.0, 0.5]], Lobe::Lambertian);
        let found = transport_within(&geometry, &emission, Levels::isotropic(2), 1e-7)
            .expect("straight grid lines");
        let expected = std::f64::consts::PI * 0.199_824_895_698_387_46;
        let mean = found.grid.irradiance().iter().map(|e| e[0]).sum::<f64>() / 16.0;
        assert!((mean / expected - 1.0).abs() < 1e-7, "{mean} {expected}");
        assert!(found.relative_error <= 1e-7, "{}", found.relative_error);
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
        let run = |threads, (picture, tolerance)| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let pool = pool.expect("a thread pool");
            let (source, levels) = (window(picture), Levels::isotropic(picture.min(2)));
            let found = pool
                .install(|| transport_within(geometry, &source, levels, tolerance))
                .expect("straight grid lines");
            (found.grid.images().to_vec(), found.relative_error)
        };
        // The latter is handed over.
        for case in [(3, 1e-3), (1, 1e-6)] {
            assert_eq!(run(1, case), run(3, case));
        }
    }
}
