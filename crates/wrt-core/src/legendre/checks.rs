//! The radiance at points that no coefficient was made from.

use super::project::Radiance;
use super::sampled::Sampled;
use super::sampling::{Position, Sampling};
use super::{LegendreSampler, LegendreTree, ViewSet};
use crate::sobol;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// At least as many checks in all: the error's own is then some 3 %, for squares of
/// errors with a spread of four times their mean.
const LEAST: f64 = 4000.0;

/// The fewest and the most positions a position cell.
const PLACES: [f64; 2] = [8.0, 64.0];

/// The most directions a position and leaf, where nearly nothing of any is seen.
const MOST: f64 = 1000.0;

/// Points spread over all cells that are seen, so many to each, with the radiance
/// there.
///
/// Coefficients tell what was left out of those that were sampled, and at a jump most
/// are of higher degree than any that was. These points see all that is wrong.
pub(super) struct Checks(Vec<Check>);

struct Check {
    uv: DVec2,
    mu: DVec3,
    exact: [f64; 3],
    /// cosθ dω du dv that it stands for.
    weight: f64,
}

impl Checks {
    /// Evaluates the radiance in each leaf of `positions`.
    pub(super) fn new<R: Radiance>(sampling: &Sampling<'_, R>, positions: &[Position]) -> Self {
        let leaves: f64 = positions.iter().flat_map(|p| p.root.leaves()).map(Sampled::share).sum();
        let wanted = LEAST / leaves;
        let places = wanted.ceil().clamp(PLACES[0], PLACES[1]);
        let each = (wanted / places).ceil().min(MOST) as usize;
        let places = places as usize;
        let within = |(p, i): (usize, usize)| {
            let Position { cell, root, .. } = &positions[p];
            let (low, width) = cell.square(0);
            // Other points in each cell, and the same for any number of threads.
            let seed = 0x9e37_79b9_u32.wrapping_mul(p as u32 + 1);
            let point = |d: u32| sobol(i as u32, d as usize, seed.wrapping_add(d));
            let uv = low + width * DVec2::new(point(0), point(1));
            let share = width * width / places as f64;
            in_leaves(sampling, root, uv, [i * each, (i + 1) * each], seed, share)
        };
        let all: Vec<(usize, usize)> =
            (0..positions.len()).flat_map(|p| (0..places).map(move |i| (p, i))).collect();
        Self(all.into_par_iter().flat_map_iter(within).collect())
    }

    /// ∫ |L|² cosθ dω du dv over what is seen.
    pub(super) fn norm_squared(&self) -> f64 {
        let square = |check: &Check| check.exact.iter().map(|x| x * x).sum::<f64>();
        self.0.iter().map(|check| check.weight * square(check)).sum()
    }

    /// ∫ |error|² cosθ dω du dv of what is looked up of `tree`.
    pub(super) fn error_squared(&self, tree: &LegendreTree) -> f64 {
        let sampler = LegendreSampler::new(tree);
        let squares = self.0.iter().map(|check| {
            let found = sampler.radiance(check.uv, check.mu).into_iter().zip(check.exact);
            check.weight * found.map(|(a, b)| (f64::from(a) - b).powi(2)).sum::<f64>()
        });
        squares.sum()
    }
}

/// Checks at `uv` in each leaf of `root` that is seen, at those points of a sequence from
/// one number to another that are seen; all of one leaf stand for `share` × its area.
fn in_leaves<R: Radiance>(
    sampling: &Sampling<'_, R>,
    root: &Sampled,
    uv: DVec2,
    [from, to]: [usize; 2],
    seed: u32,
    share: f64,
) -> Vec<Check> {
    let mut checks = Vec::new();
    let Sampling { radiance, map, .. } = *sampling;
    let views = sampling.views_at(uv, 0.0);
    if views.as_ref().is_some_and(ViewSet::is_empty) {
        return checks;
    }
    let place = radiance.place(uv);
    for (n, leaf) in root.leaves().into_iter().enumerate().filter(|(_, leaf)| leaf.is_seen()) {
        let seed = seed ^ 0x85eb_ca6b_u32.wrapping_mul(n as u32);
        let point = |i: usize, d: u32| sobol(i as u32, d as usize, seed.wrapping_add(d));
        let (low, width) = leaf.cell.square(1);
        for k in from..to {
            let st = low + width * DVec2::new(point(k, 2), point(k, 3));
            if views.as_ref().is_some_and(|views| !views.contains(st)) {
                continue;
            }
            let area = width * width * share / (to - from) as f64;
            let weight = area * map.projected_measure(st);
            if weight > 0.0 {
                let mu = map.to_direction(st);
                let exact = radiance.radiance(&place, mu);
                checks.push(Check { uv, mu, exact, weight });
            }
        }
    }
    checks
}
