//! What is left out so that the bytes that stay buy the most.

use super::project::{Orders, ProjectOptions};
use super::sampled::Sampled;
use super::sampling::Position;
use super::terms;
use super::tree::{Cells, LegendreTree, NOWHERE, POSITION, SPLIT, leaf_byte};

/// Coefficients that a leaf costs beside its own: its byte and the look-up's way.
const LEAF: f64 = 0.5;

/// Steps that a coefficient may be of, well within an `i32`.
const QUANTA: f64 = (1_u32 << 30) as f64;

/// A tree, and how it was found.
pub(super) struct Pruning {
    pub(super) tree: LegendreTree,
    /// Weighted energy of what is left out of that which is seen.
    pub(super) error: f64,
    /// The logarithm of the price.
    price: f64,
}

/// Merges cells, lowers orders and rounds until the weighted energy of what is left
/// out where somebody looks is `allowed`. `norm` is a bound on it; `last` is what was found for another;
/// `unseen` is what an error's square counts where nobody looks.
///
/// One number rules all: the energy that a basis function must have to be kept, three
/// channels together. For each cell the cheapest of all pairs of orders, and of
/// keeping its children instead, is found from the leaves up: the least of energy
/// left out + that price × functions kept. The step of rounding follows from the
/// price, for a bit that makes steps half as large saves energy too.
///
/// Where cells and orders end before `allowed` is reached, hardly more than they must
/// is left out instead.
pub(super) fn prune(
    positions: &[Position],
    norm: f64,
    allowed: f64,
    last: Option<&Pruning>,
    unseen: f64,
    options: &ProjectOptions,
) -> Pruning {
    /// How far from the last price one is looked for, and how closely.
    const NEAR: f64 = 3.0;
    const CLOSE: f64 = 1e-3;
    /// What may be left out in place of the least that must be.
    const HARDLY_MORE: f64 = 1.1;
    let make = |price: f64| Pruned::new(positions, options.orders, price.exp(), unseen);
    // The price of the whole lies between nothing and everything.
    let largest = positions.iter().map(|position| largest(&position.root)).fold(0.0, f64::max);
    // Below this, coefficients would be more steps than there are.
    let least = price_of(largest / QUANTA).ln();
    let (mut low, mut high) = ((norm * 1e-24).ln(), norm.ln());
    if let Some(last) = last {
        (low, high) = (low.max(last.price - NEAR), high.min(last.price + NEAR));
    }
    let find = |mut low: f64, mut high: f64, allowed: f64| {
        while high - low > CLOSE {
            let middle = 0.5 * (low + high);
            let is_low = middle < least || make(middle).error <= allowed;
            if is_low { low = middle } else { high = middle }
        }
        let price = low.max(least);
        (price, make(price))
    };
    let (mut price, mut pruned) = find(low, high, allowed);
    if pruned.error > allowed {
        (price, pruned) = find(price, high, HARDLY_MORE * pruned.error);
    }
    let tree = LegendreTree::from_parts(options.map, pruned.shape, pruned.step, pruned.quanta);
    let tree = tree.unwrap_or_else(|reason| unreachable!("a tree just made: {reason}"));
    Pruning { tree, error: pruned.error, price }
}

/// The largest coefficient of a cell and those below it.
fn largest(cell: &Sampled) -> f64 {
    let own = cell.b.iter().fold(0.0, |most: f64, b| most.max(b.abs()));
    cell.children.iter().flat_map(|children| children.iter()).map(largest).fold(own, f64::max)
}

struct Pruned {
    /// Weight of what nobody looks at.
    unseen: f64,
    shape: Vec<u8>,
    step: f64,
    quanta: Vec<i32>,
    /// Weighted energy of what was left out of that which is seen.
    error: f64,
}

impl Pruned {
    fn new(positions: &[Position], orders: Orders, price: f64, unseen: f64) -> Self {
        let (shape, quanta) = (Vec::new(), Vec::new());
        let mut pruned = Self { unseen, shape, step: step(price), quanta, error: 0.0 };
        let mut rest = positions.iter();
        pruned.add_position(Cells::default(), &mut rest, orders, price);
        pruned
    }

    /// Writes the position cell and those below it, which come next in `rest`.
    fn add_position<'a>(
        &mut self,
        cell: Cells,
        rest: &mut std::slice::Iter<'a, Position>,
        orders: Orders,
        price: f64,
    ) {
        if rest.as_slice().first().is_some_and(|next| next.cell.levels[0] > cell.levels[0]) {
            self.shape.push(SPLIT);
            for child in cell.children(0) {
                self.add_position(child, rest, orders, price);
            }
        } else if let Some(position) = rest.next() {
            self.shape.push(POSITION);
            let plan = Plan::of(&position.root, orders, price, self.unseen);
            self.shape.extend(plan.shape);
            for (leaf, orders) in plan.leaves {
                self.add_leaf(leaf, orders);
            }
        }
    }

    fn add_leaf(&mut self, leaf: &Sampled, orders: [usize; 2]) {
        let [p, q] = orders.map(terms);
        let row = leaf.b.len() / leaf.position_terms();
        let mut rounding = 0.0;
        for row in leaf.b.chunks_exact(row).take(p) {
            for &b in &row[..3 * q] {
                let quantum = (b / self.step).round();
                rounding += (b - quantum * self.step).powi(2);
                self.quanta.push(quantum as i32);
            }
        }
        if leaf.is_seen() {
            let weight = leaf.weight(self.unseen) * leaf.measure;
            self.error += weight * (leaf.left_out(orders) + rounding);
        }
    }
}

/// The step of rounding at which a bit less saves as much as a function less.
///
/// Rounding leaves Δ²/12 per coefficient and a bit more a quarter of that, so that
/// the energy of a bit is 2 ln 2 Δ²/12 where bits are many. A function is three
/// coefficients of a byte or so: 24 bits, 2.8 Δ².
fn step(price: f64) -> f64 {
    (price / 2.8).sqrt()
}

/// The price at which [`step`] is so much.
fn price_of(step: f64) -> f64 {
    2.8 * step * step
}

/// What is kept of a cell.
struct Plan<'a> {
    /// Energy left out + price × functions kept.
    cost: f64,
    shape: Vec<u8>,
    /// With the orders kept.
    leaves: Vec<(&'a Sampled, [usize; 2])>,
}

impl<'a> Plan<'a> {
    fn of(cell: &'a Sampled, most: Orders, price: f64, unseen: f64) -> Self {
        if !cell.is_inside() {
            return Self { cost: 0.0, shape: vec![NOWHERE], leaves: vec![] };
        }
        let (weight, mut best) = (cell.weight(unseen), (f64::INFINITY, [1, 1]));
        for p in 1..=most.position {
            for q in 1..=most.direction {
                let functions = (terms(p) * terms(q)) as f64;
                let cost = weight * cell.left_out([p, q]) + price * (functions + LEAF);
                if cost < best.0 {
                    best = (cost, [p, q]);
                }
            }
        }
        let (cost, orders) = best;
        let whole = Self { cost, shape: vec![leaf_byte(orders)], leaves: vec![(cell, orders)] };
        let Some(children) = &cell.children else { return whole };
        let mut split = Self { cost: price * LEAF, shape: vec![SPLIT], leaves: vec![] };
        for child in children.iter() {
            let part = Plan::of(child, most, price, unseen);
            split.cost += part.cost;
            split.shape.extend(part.shape);
            split.leaves.extend(part.leaves);
        }
        if split.cost < whole.cost { split } else { whole }
    }
}
