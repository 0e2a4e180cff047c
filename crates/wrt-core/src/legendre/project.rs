//! Any smooth radiance to a [`LegendreTree`].

use super::checks::Checks;
use super::prune::prune;
use super::sampled::{Sampled, View};
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

    /// Whether anybody looks at the positions of the square at `place` from the
    /// directions of the square at `towards` on `map`, each given by its lowest corner
    /// and its width. Where nobody does, an error eight times as large will do.
    fn is_seen(&self, _map: DirectionMap, _place: (DVec2, f64), _towards: (DVec2, f64)) -> bool {
        true
    }
}

/// The highest orders of leaves: what a look-up may cost at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Orders {
    /// Total degree in (u, v) below this, 1 to 7.
    pub position: usize,
    /// Total degree in (s, t) below this, 1 to 7.
    pub direction: usize,
}

impl Default for Orders {
    /// 4 and 4: of those whose look-ups are fastest to 0.2 to 1 %, the one of the fewest
    /// bytes.
    fn default() -> Self {
        Self { position: 4, direction: 4 }
    }
}

/// How to project.
#[derive(Clone, Copy, Debug)]
pub struct ProjectOptions {
    /// The relative error asked for: ‖error‖ / ‖L‖ over position and all directions
    /// of the hemisphere that are seen, weighted with cosθ dω.
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
            orders: Orders::default(),
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
    /// The relative error, in the norm of [`ProjectOptions::error`]: what is looked up
    /// against the radiance itself at some thousands of points that no coefficient was
    /// made from. Above what was asked for if a limit on levels or cells was met.
    pub error: f64,
    /// ‖L‖² in that norm; over all that is not, where nothing is seen.
    pub norm_squared: f64,
}

/// How much of the error asked for is spent by what points tell: they miss some of it,
/// up to 15 % where most of it is in few places.
const SPENT: f64 = 0.85;

/// From where on no more coefficients are left out to spend it, and up to where it will
/// do.
const ENOUGH: [f64; 2] = [0.81, 0.87];

/// What of its square must be left for pruning: if less is, more cells are wanted.
const LEAST: f64 = 0.15;

/// How often cells are split anew, because points tell of more than coefficients do,
/// and how often pruned with what points tell of.
const ROUNDS: usize = 4;
const PRUNINGS: usize = 3;

/// Projects `radiance`, using all threads of the current pool; the result does not
/// depend on how many.
///
/// Cells are sampled at Gauss nodes for one order more than leaves may have, and
/// split where the energy of that last degree is greatest, until over all cells it is
/// below the error asked for. Then as many coefficients are left out, cells merged
/// and bits dropped as that error allows. What no coefficient tells of, at a jump most
/// of the error, is found by looking the result up at other points; if it is too much,
/// more cells are split.
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
    // A third of the error's square each for what positions, directions and pruning
    // leave out.
    let mut share = 1.0 / 3.0;
    let mut made = Projected {
        tree: LegendreTree::dark(options.map),
        error: 0.0,
        norm_squared: norm_squared(&positions),
    };
    if made.norm_squared == 0.0 {
        return made;
    }
    for _ in 0..ROUNDS {
        let cells = count(&positions);
        positions = sampling.split_positions(positions, share);
        sampling.split_directions(&mut positions, share);
        if made.error > 0.0 && count(&positions) == cells {
            break;
        }
        let norm = norm_squared(&positions);
        let checks = Checks::new(radiance, &positions, options.map);
        let wanted = (SPENT * options.error).powi(2) * norm;
        let (mut allowed, mut unknown, mut last) = (0.8 * wanted, 0.0, None);
        for _ in 0..PRUNINGS {
            let pruning = prune(&positions, norm, allowed, last.as_ref(), options);
            let found = checks.error_squared(&pruning.tree);
            unknown = found - pruning.error;
            let relative = (found / norm).sqrt();
            made.tree = pruning.tree.clone();
            (made.error, made.norm_squared) = (relative, norm);
            last = Some(pruning);
            let enough = (ENOUGH[0]..=ENOUGH[1]).contains(&(relative / options.error));
            if enough || wanted - unknown < LEAST * wanted {
                break;
            }
            allowed = wanted - unknown;
        }
        if made.error <= ENOUGH[1] * options.error {
            break;
        }
        // As much less as what is not known is more than its part.
        share *= (0.4 * wanted / unknown.max(0.4 * wanted)).clamp(0.1, 0.6);
    }
    made
}

/// How many direction cells there are.
fn count<P>(positions: &[Position<P>]) -> usize {
    positions.iter().map(|p| p.root.leaves().len()).sum()
}

/// Which values to do something about, increasing, so that the others' sum is below
/// half of `allowed`: the greatest of those that `can`, at most `room`; none if all
/// together are below `allowed`. Nor those that together are a hundredth of it, lest a
/// limit on others splits them all.
fn worst(values: &[f64], allowed: f64, room: usize, can: impl Fn(usize) -> bool) -> Vec<usize> {
    let mut sum: f64 = values.iter().sum();
    if sum <= allowed {
        return Vec::new();
    }
    let least = 0.01 * allowed / values.len() as f64;
    let matters = |&i: &usize| can(i) && values[i] > least;
    let mut order: Vec<usize> = (0..values.len()).filter(matters).collect();
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

/// Of what is seen; of all, if nothing is.
fn norm_squared<P>(positions: &[Position<P>]) -> f64 {
    let leaves = || positions.iter().flat_map(|p| p.root.leaves());
    let seen: f64 = leaves().filter(|leaf| leaf.is_seen()).map(|leaf| leaf.norm).sum();
    if seen > 0.0 { seen } else { leaves().map(|leaf| leaf.norm).sum() }
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
    options: &'a ProjectOptions,
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
    fn new(radiance: &'a R, options: &'a ProjectOptions) -> Self {
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
            options,
        }
    }

    /// The energy that may be left out for want of positions or of directions.
    fn allowed(&self, positions: &[Position<R::Place>], share: f64) -> f64 {
        self.options.error * self.options.error * norm_squared(positions) * share
    }

    /// Splits position cells until what they leave out is allowed.
    fn split_positions(
        &self,
        mut positions: Vec<Position<R::Place>>,
        share: f64,
    ) -> Vec<Position<R::Place>> {
        let most = self.options.levels[0];
        loop {
            let tails: Vec<f64> = positions.iter().map(|p| p.root.tail(0)).collect();
            let cells = count(&positions);
            // Each split makes three more positions with as many directions; three
            // quarters of the cells are for what directions need.
            let room = (self.options.cells / 4).saturating_sub(cells) * positions.len();
            let splits = |i: usize| positions[i].cell.levels[0] < most;
            let allowed = self.allowed(&positions, share);
            let split = worst(&tails, allowed, room / (3 * cells), splits);
            if split.is_empty() {
                return positions;
            }
            let parts = positions.into_iter().enumerate().map(|(i, position)| {
                if split.binary_search(&i).is_err() {
                    return vec![position];
                }
                position.cell.children(0).into_iter().map(|cell| self.position(cell)).collect()
            });
            positions = parts.flatten().collect();
        }
    }

    /// Splits direction cells until what they leave out is allowed.
    fn split_directions(&self, positions: &mut [Position<R::Place>], share: f64) {
        loop {
            let allowed = self.allowed(positions, share);
            let mut leaves = Vec::new();
            for Position { places, root, .. } in &mut *positions {
                leaves.extend(root.leaves_mut().into_iter().map(|leaf| (&*places, leaf)));
            }
            let tails: Vec<f64> = leaves.iter().map(|(_, leaf)| leaf.tail(1)).collect();
            let room = self.options.cells.saturating_sub(leaves.len()) / 3;
            let splits = |i: usize| {
                let leaf: &Sampled = leaves[i].1;
                leaf.is_seen() && leaf.cell.levels[1] < self.options.levels[1]
            };
            let split = worst(&tails, allowed, room, splits);
            if split.is_empty() {
                return;
            }
            let chosen = leaves.into_iter().enumerate();
            let chosen: Vec<_> = chosen.filter(|(i, _)| split.binary_search(i).is_ok()).collect();
            chosen.into_par_iter().for_each(|(_, (places, leaf))| {
                let below = leaf.cell.children(1).map(|cell| self.cell(places, cell));
                leaf.adopt(below, &self.basis);
            });
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
        if cell.levels[1] < self.base && sampled.is_inside() {
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
        let view = if !self.map.has_directions(low, width) {
            View::Nowhere
        } else if self.radiance.is_seen(self.map, cell.square(0), (low, width)) {
            View::Seen
        } else {
            View::Unseen
        };
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
        let norm = if view == View::Nowhere { 0.0 } else { norm * area * area };
        Sampled::new(cell, [self.position.order, self.direction.order], b, norm, measure, view)
    }
}
