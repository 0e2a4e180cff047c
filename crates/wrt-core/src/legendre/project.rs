//! Any smooth radiance to a [`LegendreTree`].

use super::prune::prune;
use super::sampled::Sampled;
use super::tree::{Cells, MAX_DEPTH, MAX_TREE_ORDER};
use super::{LegendreTree, degrees, terms};
use crate::DirectionMap;
use crate::multiwavelet::{Multiwavelet, gauss_legendre, legendre};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// A radiance that can be asked for anywhere.
pub trait Radiance: Sync {
    /// What is worked out once per position.
    type Place: Send + Sync;

    /// Prepares position (u, v) of the unit square.
    fn place(&self, uv: DVec2) -> Self::Place;

    /// The radiance there towards the unit direction `mu`, W m⁻² sr⁻¹. A `mu` below
    /// the horizon asks for the continuation of what is above, as smooth as can be.
    fn radiance(&self, place: &Self::Place, mu: DVec3) -> [f64; 3];

    /// The standard deviation, in radians, of the narrowest lobe that could be
    /// overlooked; infinite if it hardly depends on direction.
    fn scale(&self) -> f64;
}

/// The highest orders of leaves: what a look-up may cost at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Orders {
    /// Total degree in (u, v) below this, 1 to 7.
    pub position: usize,
    /// Total degree in (s, t) below this, 1 to 7.
    pub direction: usize,
}

/// How to project.
#[derive(Clone, Copy, Debug)]
pub struct ProjectOptions {
    /// The relative error asked for: ‖error‖ / ‖L‖ over position and all directions
    /// of the hemisphere, weighted with cosθ dω.
    pub error: f64,
    /// The highest orders.
    pub orders: Orders,
    /// How directions lie on the square.
    pub map: DirectionMap,
    /// The deepest levels of position and of direction, at most 12.
    pub levels: [u8; 2],
    /// The most direction cells that are sampled, over all positions: time and memory.
    pub cells: usize,
}

impl Default for ProjectOptions {
    fn default() -> Self {
        Self {
            error: 2e-3,
            orders: Orders { position: 4, direction: 4 },
            map: DirectionMap::default(),
            levels: [5, 8],
            cells: 20_000,
        }
    }
}

/// What a projection made.
#[derive(Clone, Debug)]
pub struct Projected {
    /// The coefficients.
    pub tree: LegendreTree,
    /// The relative error, in the norm of [`ProjectOptions::error`], as told by the
    /// coefficients that were left out and by rounding; above what was asked for if
    /// a limit on levels or cells was met.
    pub error: f64,
    /// ‖L‖² in that norm.
    pub norm_squared: f64,
}

/// Projects `radiance`, using all threads of the current pool; the result does not
/// depend on how many.
///
/// Cells are sampled at Gauss nodes for one order more than leaves may have, and
/// split where the energy of that last degree is greatest, until over all cells it is
/// below the error asked for. Then as many coefficients are left out, cells merged
/// and bits dropped as that error allows.
///
/// # Panics
///
/// If an order is not 1 to 7 or a level above 12.
#[must_use]
pub fn project<R: Radiance>(radiance: &R, options: &ProjectOptions) -> Projected {
    let Orders { position, direction } = options.orders;
    for order in [position, direction] {
        assert!((1..MAX_TREE_ORDER).contains(&order), "order {order} is not in 1..=7");
    }
    assert!(options.levels.iter().all(|l| *l <= MAX_DEPTH), "levels {:?}", options.levels);
    let sampling = Sampling::new(radiance, options);
    let mut positions = vec![sampling.position(Cells::default())];
    let mut norm = norm_squared(&positions);
    if norm == 0.0 {
        return Projected { tree: LegendreTree::dark(options.map), error: 0.0, norm_squared: 0.0 };
    }
    // A third of the error's square each for what positions, directions and pruning
    // leave out.
    let allowed = |norm: f64| options.error * options.error * norm / 3.0;
    loop {
        let tails: Vec<f64> = positions.iter().map(|p| p.root.tail(0)).collect();
        let cells: usize = positions.iter().map(|p| p.root.leaves().len()).sum();
        // Each split makes three more positions with as many directions; three quarters
        // of the cells are for what directions need.
        let room = (options.cells / 4).saturating_sub(cells) * positions.len() / (3 * cells);
        let splits = |i: usize| positions[i].cell.levels[0] < options.levels[0];
        let split = worst(&tails, allowed(norm), room, splits);
        if split.is_empty() {
            break;
        }
        let parts = positions.into_iter().enumerate().map(|(i, position)| {
            if split.binary_search(&i).is_err() {
                return vec![position];
            }
            position.cell.children(0).into_iter().map(|cell| sampling.position(cell)).collect()
        });
        positions = parts.flatten().collect();
        norm = norm_squared(&positions);
    }
    loop {
        let mut leaves = Vec::new();
        for Position { places, root, .. } in &mut positions {
            leaves.extend(root.leaves_mut().into_iter().map(|leaf| (&*places, leaf)));
        }
        let tails: Vec<f64> = leaves.iter().map(|(_, leaf)| leaf.tail(1)).collect();
        let room = options.cells.saturating_sub(leaves.len()) / 3;
        let splits = |i: usize| {
            let leaf: &Sampled = leaves[i].1;
            leaf.inside && leaf.cell.levels[1] < options.levels[1]
        };
        let split = worst(&tails, allowed(norm), room, splits);
        if split.is_empty() {
            break;
        }
        let chosen = leaves.into_iter().enumerate();
        let chosen: Vec<_> = chosen.filter(|(i, _)| split.binary_search(i).is_ok()).collect();
        chosen.into_par_iter().for_each(|(_, (places, leaf))| {
            let below = leaf.cell.children(1).map(|cell| sampling.cell(places, cell));
            leaf.adopt(below, &sampling.basis);
        });
        norm = norm_squared(&positions);
    }
    prune(&positions, norm, options)
}

/// Which values to do something about, increasing, so that the others' sum is below
/// half of `allowed`: the greatest of those that `can`, at most `room`; none if all
/// together are below `allowed`.
fn worst(values: &[f64], allowed: f64, room: usize, can: impl Fn(usize) -> bool) -> Vec<usize> {
    let mut sum: f64 = values.iter().sum();
    if sum <= allowed {
        return Vec::new();
    }
    let mut order: Vec<usize> = (0..values.len()).filter(|&i| can(i) && values[i] > 0.0).collect();
    order.sort_by(|&a, &b| values[b].total_cmp(&values[a]).then(a.cmp(&b)));
    let enough = |i: &usize| {
        let more = sum > 0.5 * allowed;
        sum -= values[*i];
        more
    };
    let mut chosen: Vec<usize> = order.into_iter().take(room).take_while(enough).collect();
    chosen.sort_unstable();
    chosen
}

fn norm_squared<P>(positions: &[Position<P>]) -> f64 {
    positions.iter().flat_map(|p| p.root.leaves()).map(|leaf| leaf.norm).sum()
}

/// A position cell with its places, at Gauss nodes, u fastest.
pub(super) struct Position<P> {
    pub(super) cell: Cells,
    places: Vec<P>,
    pub(super) root: Sampled,
}

/// How cells are sampled.
struct Sampling<'a, R> {
    radiance: &'a R,
    map: DirectionMap,
    /// For directions.
    basis: Multiwavelet,
    /// Level at which no lobe is overlooked.
    base: u8,
    position: Rule,
    direction: Rule,
}

/// A product rule on the unit square, x fastest, and the polynomials at its nodes.
struct Rule {
    order: usize,
    /// Nodes and weights.
    nodes: Vec<(DVec2, f64)>,
    /// Per node the terms' values × the weight.
    terms: Vec<Vec<f64>>,
}

impl Rule {
    fn new(order: usize) -> Self {
        let line = gauss_legendre(order);
        let square = line.iter().flat_map(|y| line.iter().map(move |x| (x, y)));
        let nodes: Vec<_> = square.map(|(x, y)| (DVec2::new(x.0, y.0), x.1 * y.1)).collect();
        let values = |(at, weight): &(DVec2, f64)| {
            let (x, y) = (legendre(order, at.x), legendre(order, at.y));
            degrees(order).map(|(i, j)| weight * x[i] * y[j]).collect()
        };
        let terms = nodes.iter().map(values).collect();
        Self { order, nodes, terms }
    }
}

impl<'a, R: Radiance> Sampling<'a, R> {
    fn new(radiance: &'a R, options: &ProjectOptions) -> Self {
        // One order more than is kept shows what is not.
        let position = Rule::new(options.orders.position + 1);
        let direction = Rule::new(options.orders.direction + 1);
        // A cell four standard deviations wide has nodes one apart or closer.
        let widest = 4.0 * radiance.scale() * direction.order as f64 / 4.0;
        let base = (options.map.stretch() / widest).log2().ceil().max(0.0) as u8;
        Self {
            radiance,
            map: options.map,
            basis: Multiwavelet::new(direction.order),
            base: base.min(options.levels[1]),
            position,
            direction,
        }
    }

    fn position(&self, cell: Cells) -> Position<R::Place> {
        let (low, width) = cell.square(0);
        let place = |(at, _): &(DVec2, f64)| self.radiance.place(low + width * *at);
        let places: Vec<R::Place> = self.position.nodes.par_iter().map(place).collect();
        let root = self.directions(&places, cell);
        Position { cell, places, root }
    }

    /// The cell's quadtree of directions down to the base level.
    fn directions(&self, places: &[R::Place], cell: Cells) -> Sampled {
        let mut sampled = self.cell(places, cell);
        if cell.levels[1] < self.base && sampled.inside {
            let below: Vec<Sampled> = cell
                .children(1)
                .into_par_iter()
                .map(|child| self.directions(places, child))
                .collect();
            let below = below.try_into().unwrap_or_else(|_| unreachable!("four children"));
            sampled.adopt(below, &self.basis);
        }
        sampled
    }

    /// Samples and projects one cell.
    fn cell(&self, places: &[R::Place], cell: Cells) -> Sampled {
        let (low, width) = cell.square(1);
        let nodes: Vec<DVec2> = self.direction.nodes.iter().map(|n| low + width * n.0).collect();
        let measures: Vec<f64> = nodes.iter().map(|&st| self.map.projected_measure(st)).collect();
        let directions: Vec<DVec3> = nodes.iter().map(|&st| self.map.to_direction(st)).collect();
        let area = cell.square(0).1 * width;
        let inside = self.map.has_directions(low, width);
        let [p, q] = [&self.position, &self.direction].map(|rule| terms(rule.order));
        let mut b = vec![0.0; 3 * p * q];
        let mut norm = 0.0;
        for (i, place) in places.iter().enumerate() {
            let mut row = vec![0.0; 3 * q];
            for (k, &mu) in directions.iter().enumerate() {
                let value = self.radiance.radiance(place, mu);
                let square: f64 = value.iter().map(|x| x * x).sum();
                norm += square * measures[k] * self.direction.nodes[k].1 * self.position.nodes[i].1;
                for (sum, weight) in row.chunks_exact_mut(3).zip(&self.direction.terms[k]) {
                    for c in 0..3 {
                        sum[c] += weight * value[c];
                    }
                }
            }
            for (sum, weight) in b.chunks_exact_mut(3 * q).zip(&self.position.terms[i]) {
                for (sum, x) in sum.iter_mut().zip(&row) {
                    *sum += area * weight * x;
                }
            }
        }
        let rule = self.direction.nodes.iter();
        let measure = rule.zip(&measures).map(|((_, weight), m)| weight * m).sum();
        let norm = if inside { norm * area * area } else { 0.0 };
        Sampled::new(cell, [self.position.order, self.direction.order], b, norm, measure, inside)
    }
}
