//! Position cells, and how their directions are sampled.

use super::project::{ProjectOptions, Radiance};
use super::sampled::{Sampled, View};
use super::tree::Cells;
use super::views::ViewShare;
use super::{ViewSet, degrees, terms};
use crate::DirectionMap;
use crate::multiwavelet::{Multiwavelet, gauss_legendre, legendre};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// A position cell. Its places are worked out again whenever it is sampled: a polished
/// surface's are hundreds of kilobytes each.
pub(super) struct Position {
    pub(super) cell: Cells,
    /// `None` if it is seen from everywhere.
    pub(super) views: Option<Views>,
    pub(super) root: Sampled,
}

/// From where a position cell is looked at.
pub(super) struct Views {
    /// At any of its positions.
    pub(super) all: ViewSet,
    /// On average over them.
    share: ViewShare,
}

/// How cells are sampled.
pub(super) struct Sampling<'a, R> {
    pub(super) radiance: &'a R,
    pub(super) map: DirectionMap,
    /// Whatever the radiance says of [`views`](Radiance::views).
    looks_everywhere: bool,
    /// For directions.
    basis: Multiwavelet,
    /// Level at which no lobe is overlooked.
    base: u8,
    position: Rule,
    direction: Rule,
    pub(super) options: &'a ProjectOptions,
}

/// A product rule on the unit square, x fastest, and the polynomials at its nodes.
struct Rule {
    order: usize,
    /// Nodes and weights.
    nodes: Vec<(DVec2, f64)>,
    /// No point is farther from all nodes than this, along either axis.
    reach: f64,
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
        let gaps = line.windows(2).map(|pair| 0.5 * (pair[1].0 - pair[0].0));
        let reach = gaps.fold(line[0].0, f64::max);
        Self { order, nodes, reach, terms }
    }
}

impl<'a, R: Radiance> Sampling<'a, R> {
    pub(super) fn new(radiance: &'a R, options: &'a ProjectOptions) -> Self {
        // One order more than is kept shows what is not.
        let position = Rule::new(options.orders.position + 1);
        let direction = Rule::new(options.orders.direction + 1);
        // A cell four standard deviations wide has nodes one apart or closer.
        let widest = 4.0 * radiance.scale() * direction.order as f64 / 4.0;
        let base = (options.map.stretch() / widest).log2().ceil().max(0.0) as u8;
        Self {
            radiance,
            map: options.map,
            looks_everywhere: false,
            basis: Multiwavelet::new(direction.order),
            base: base.min(options.levels[1]),
            position,
            direction,
            options,
        }
    }

    /// Whatever the radiance says of [`views`](Radiance::views).
    pub(super) fn everywhere(self) -> Self {
        Self { looks_everywhere: true, ..self }
    }

    /// The energy that may be left out for want of positions or of directions.
    fn allowed(&self, positions: &[Position], share: f64) -> f64 {
        self.options.error * self.options.error * norm_squared(positions, View::Seen) * share
    }

    /// Splits position cells until what they leave out is allowed, or there would be more
    /// than `most` cells.
    pub(super) fn split_positions(
        &self,
        mut positions: Vec<Position>,
        share: f64,
        most: usize,
    ) -> Vec<Position> {
        let deepest = self.options.levels[0];
        loop {
            let tails: Vec<f64> = positions.iter().map(|p| p.root.tail(0)).collect();
            let cells = count(&positions);
            // Each split makes three more positions with as many directions.
            let room = most.saturating_sub(cells) * positions.len();
            let splits = |i: usize| positions[i].cell.levels[0] < deepest;
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

    /// Splits direction cells until what they leave out is allowed, or there are `most`
    /// cells.
    pub(super) fn split_directions(&self, positions: &mut [Position], share: f64, most: usize) {
        loop {
            let allowed = self.allowed(positions, share);
            let mut leaves: Vec<&mut Sampled> = Vec::new();
            // The number of each position's last leaf, and one.
            let mut ends = Vec::new();
            for Position { root, .. } in &mut *positions {
                leaves.extend(root.leaves_mut());
                ends.push(leaves.len());
            }
            let tails: Vec<f64> = leaves.iter().map(|leaf| leaf.tail(1)).collect();
            let room = most.saturating_sub(leaves.len()) / 3;
            let splits = |i: usize| {
                let leaf: &Sampled = leaves[i];
                leaf.is_seen() && leaf.cell.levels[1] < self.options.levels[1]
            };
            let split = worst(&tails, allowed, room, splits);
            if split.is_empty() {
                return;
            }
            let (mut rest, mut start, mut work) = (&split[..], 0, Vec::new());
            for (position, end) in positions.iter_mut().zip(ends) {
                let (chosen, others) = rest.split_at(rest.partition_point(|i| *i < end));
                if !chosen.is_empty() {
                    work.push((position, chosen.iter().map(|i| i - start).collect::<Vec<_>>()));
                }
                (rest, start) = (others, end);
            }
            work.into_par_iter().for_each(|(Position { cell, views, root }, chosen)| {
                let places = self.places(*cell);
                let leaves = root.leaves_mut().into_iter().enumerate();
                let leaves: Vec<_> =
                    leaves.filter(|(i, _)| chosen.binary_search(i).is_ok()).collect();
                leaves.into_par_iter().for_each(|(_, leaf)| {
                    let below = leaf.cell.children(1);
                    let below = below.map(|cell| self.cell(&places, views.as_ref(), cell));
                    leaf.adopt(below, &self.basis);
                });
            });
        }
    }

    /// What arrives at the position cell's Gauss nodes, u fastest.
    fn places(&self, cell: Cells) -> Vec<R::Place> {
        let (low, width) = cell.square(0);
        let place = |(at, _): &(DVec2, f64)| self.radiance.place(low + width * *at);
        self.position.nodes.par_iter().map(place).collect()
    }

    pub(super) fn position(&self, cell: Cells) -> Position {
        let (low, width) = cell.square(0);
        let places = self.places(cell);
        let views = self.views(low, width);
        let root = self.directions(&places, views.as_ref(), cell);
        Position { cell, views, root }
    }

    /// See [`Radiance::views`].
    pub(super) fn views_at(&self, uv: DVec2, reach: f64) -> Option<ViewSet> {
        if self.looks_everywhere { None } else { self.radiance.views(self.map, uv, reach) }
    }

    /// From where the position cell is looked at.
    fn views(&self, low: DVec2, width: f64) -> Option<Views> {
        let reach = self.position.reach * width;
        let at = |(at, _): &(DVec2, f64)| {
            let uv = low + width * *at;
            Some((self.views_at(uv, 0.0)?, self.views_at(uv, reach)?))
        };
        let sets = self.position.nodes.par_iter().map(at).collect::<Option<Vec<_>>>()?;
        let mut all = ViewSet::none();
        sets.iter().for_each(|(_, around)| all.add(around));
        let own = sets.iter().zip(&self.position.nodes).map(|((own, _), node)| (own, node.1));
        Some(Views { all, share: ViewShare::new(self.map, own) })
    }

    /// The cell's quadtree of directions down to the base level, or one less where
    /// nobody looks: nodes two standard deviations apart see a lobe to 2 %.
    fn directions(&self, places: &[R::Place], views: Option<&Views>, cell: Cells) -> Sampled {
        let mut sampled = self.cell(places, views, cell);
        let base = if sampled.is_seen() { self.base } else { self.base.saturating_sub(1) };
        if cell.levels[1] < base && sampled.is_inside() && !self.is_plain(places, cell) {
            let below: Vec<Sampled> = cell
                .children(1)
                .into_par_iter()
                .map(|child| self.directions(places, views, child))
                .collect();
            let below = below.try_into().unwrap_or_else(|_| unreachable!("four children"));
            sampled.adopt(below, &self.basis);
        }
        sampled
    }

    /// Whether no direction of the cell sees a lobe from any of the places.
    fn is_plain(&self, places: &[R::Place], cell: Cells) -> bool {
        let (low, width) = cell.square(1);
        let axis = self.map.to_direction(low + 0.5 * width);
        let corners = [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE];
        let angle = |corner| self.map.to_direction(low + width * corner).angle_between(axis);
        // The square is bent: a little more than its corners.
        let radius = 1.2 * corners.map(angle).into_iter().fold(0.0, f64::max);
        places.iter().all(|place| self.radiance.is_plain(place, axis, radius))
    }

    /// Samples and projects one cell.
    fn cell(&self, places: &[R::Place], views: Option<&Views>, cell: Cells) -> Sampled {
        let (low, width) = cell.square(1);
        let nodes: Vec<DVec2> = self.direction.nodes.iter().map(|n| low + width * n.0).collect();
        let measures: Vec<f64> = nodes.iter().map(|&st| self.map.projected_measure(st)).collect();
        let directions: Vec<DVec3> = nodes.iter().map(|&st| self.map.to_direction(st)).collect();
        let area = cell.square(0).1 * width;
        let (view, share) = match views {
            // Counted as seen among all.
            None if !self.map.has_directions(low, width) => (View::Nowhere, 1.0),
            Some(_) if !self.map.has_directions(low, width) => (View::Nowhere, 0.0),
            None => (View::Seen, 1.0),
            Some(views) if views.all.meets(low, width) => {
                (View::Seen, views.share.mean(low, width))
            }
            Some(_) => (View::Unseen, 1.0),
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
        let orders = [self.position.order, self.direction.order];
        Sampled::new(cell, orders, b, share * norm, measure, (view, share))
    }
}

/// How many direction cells there are.
pub(super) fn count(positions: &[Position]) -> usize {
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

/// ‖L‖² of the leaves with that view.
pub(super) fn norm_squared(positions: &[Position], view: View) -> f64 {
    let leaves = positions.iter().flat_map(|p| p.root.leaves());
    leaves.filter(|leaf| leaf.view == view).map(|leaf| leaf.norm).sum()
}
