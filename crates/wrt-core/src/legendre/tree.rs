//! The coefficients as they are kept: cells in preorder, whole multiples of a step.

use super::{degrees, terms};
use crate::DirectionMap;
use crate::multiwavelet::legendre;
use glam::{DVec2, DVec3};

/// The highest order of a leaf, for position and for direction.
pub const MAX_TREE_ORDER: usize = 8;

/// The most splits on the way to a leaf, for position and for direction.
pub const MAX_DEPTH: u8 = 12;

/// A shape's byte for a cell that is split into four.
pub(super) const SPLIT: u8 = 0;
/// Byte for a position cell whose quadtree of directions follows.
pub(super) const POSITION: u8 = 1;
/// Byte for a cell without directions of the hemisphere.
pub(super) const NOWHERE: u8 = 2;

/// The byte of a leaf of these orders, each 1 to 8.
pub(super) fn leaf_byte(orders: [usize; 2]) -> u8 {
    debug_assert!(orders.iter().all(|p| (1..=MAX_TREE_ORDER).contains(p)), "{orders:?}");
    ((orders[0] - 1) << 4 | (orders[1] - 1) | 0x08) as u8
}

/// The orders for position and direction of a leaf's byte.
fn leaf_orders(byte: u8) -> Option<[usize; 2]> {
    let orders = [usize::from(byte >> 4) + 1, usize::from(byte & 7) + 1];
    (byte & 0x88 == 0x08).then_some(orders)
}

/// Outgoing radiance as Legendre coefficients.
///
/// A position leaf at level a and a direction leaf below it at level b have the
/// orthonormal functions, over (u, v) × (s, t),
///
/// ```text
/// 2^a φ_i(2^a u − m_u) φ_j(2^a v − m_v) · 2^b φ_k(2^b s − m_s) φ_l(2^b t − m_t)
/// ```
///
/// with i + j below the leaf's position order and k + l below its direction order.
/// Each coefficient is a whole multiple of one step, and off by half of it at most:
/// the L² norm of what rounding adds is below step/2 · √(number of coefficients).
#[derive(Clone, Debug, PartialEq)]
pub struct LegendreTree {
    map: DirectionMap,
    shape: Vec<u8>,
    step: f64,
    /// Leaf by leaf, per position term, per direction term, per channel.
    quanta: Vec<i32>,
}

/// A cell of position and one of direction.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Cells {
    /// Splits of position and of direction.
    pub(super) levels: [u8; 2],
    /// Offsets along u and v, and along s and t.
    pub(super) m: [[u32; 2]; 2],
}

impl Cells {
    /// Its four children in position (0) or in direction (1).
    pub(super) fn children(self, axis: usize) -> [Self; 4] {
        [[0, 0], [1, 0], [0, 1], [1, 1]].map(|half| {
            let mut child = self;
            child.levels[axis] += 1;
            for (m, half) in child.m[axis].iter_mut().zip(half) {
                *m = 2 * *m + half;
            }
            child
        })
    }

    /// The corner of least coordinates, and the width.
    pub(super) fn square(self, axis: usize) -> (DVec2, f64) {
        let width = 0.5_f64.powi(self.levels[axis].into());
        let [x, y] = self.m[axis].map(f64::from);
        (DVec2::new(x, y) * width, width)
    }
}

/// A leaf, as it is met in preorder.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leaf {
    /// For position and for direction.
    pub(super) orders: [usize; 2],
    pub(super) cell: Cells,
    /// Where its coefficients start.
    pub(super) start: usize,
}

impl Leaf {
    /// Coefficients, all channels counted.
    pub(super) fn len(&self) -> usize {
        3 * terms(self.orders[0]) * terms(self.orders[1])
    }

    /// The value of φ₀φ₀φ₀φ₀ on its cell.
    pub(super) fn scale(&self) -> f64 {
        let [a, b] = self.cell.levels.map(i32::from);
        2.0_f64.powi(a + b)
    }

    /// Where (u, v) and (s, t) lie in it, each coordinate from 0 to 1; `None` if
    /// they do not.
    fn local(&self, points: [DVec2; 2]) -> Option<[[f64; 2]; 2]> {
        let mut local = [[0.0; 2]; 2];
        for axis in 0..2 {
            let side = f64::from(1_u32 << self.cell.levels[axis]);
            for i in 0..2 {
                let x = (points[axis][i] * side).clamp(0.0, side);
                // The last cell has its upper border.
                let own = x.floor().min(side - 1.0);
                if own != f64::from(self.cell.m[axis][i]) {
                    return None;
                }
                local[axis][i] = x - own;
            }
        }
        Some(local)
    }
}

/// What is found on the way through a shape.
#[derive(Clone, Copy, Debug)]
pub(super) enum Step {
    /// A cell that splits, of position or of direction; its four children follow.
    Split {
        position: bool,
    },
    /// A position leaf; its directions follow.
    Position,
    /// Outside the hemisphere.
    Nowhere,
    Leaf(Leaf),
}

impl LegendreTree {
    /// The tree of this shape, step and coefficients, from a file or made.
    ///
    /// `shape` lists the cells in preorder, children in the order of c_x + 2 c_y: 0
    /// for one that splits, first of position; 1 for a position leaf, whose direction
    /// cells follow likewise; 2 for a direction cell outside the hemisphere; and
    /// (p − 1) · 16 + 8 + (q − 1) for a leaf with orders p and q.
    ///
    /// # Errors
    ///
    /// What is wrong, in words: a shape that stops early, goes on after its end, is
    /// deeper than [`MAX_DEPTH`] or has an unknown byte; a number of coefficients
    /// that is not the shape's; a step that is not positive and finite.
    pub fn from_parts(
        map: DirectionMap,
        shape: Vec<u8>,
        step: f64,
        quanta: Vec<i32>,
    ) -> Result<Self, String> {
        if !(step > 0.0 && step.is_finite()) {
            return Err(format!("its step is {step}"));
        }
        let mut needed = 0_usize;
        walk(&shape, |found| {
            if let Step::Leaf(leaf) = found {
                needed += leaf.len();
            }
        })?;
        if needed != quanta.len() {
            return Err(format!("{} coefficients, where its shape has {needed}", quanta.len()));
        }
        let greatest = quanta.iter().map(|q| q.unsigned_abs()).max().unwrap_or(0);
        // On the deepest leaf, with as many terms as a leaf can have at √15 a factor.
        let most = (terms(MAX_TREE_ORDER) * terms(MAX_TREE_ORDER) * 225) as f64;
        let value = step * f64::from(greatest) * 2.0_f64.powi(2 * i32::from(MAX_DEPTH)) * most;
        if value > f64::from(f32::MAX) {
            return Err(format!("its coefficients reach {}", step * f64::from(greatest)));
        }
        Ok(Self { map, shape, step, quanta })
    }

    /// No light at all.
    #[must_use]
    pub fn dark(map: DirectionMap) -> Self {
        let shape = vec![POSITION, leaf_byte([1, 1])];
        Self { map, shape, step: 1.0, quanta: vec![0; 3] }
    }

    /// How directions lie on its square.
    #[must_use]
    pub fn map(&self) -> DirectionMap {
        self.map
    }

    /// The cells in preorder: see [`from_parts`](Self::from_parts).
    #[must_use]
    pub fn shape(&self) -> &[u8] {
        &self.shape
    }

    /// What the coefficients are multiples of.
    #[must_use]
    pub fn step(&self) -> f64 {
        self.step
    }

    /// The coefficients over the step: leaf by leaf, per position term (i, j), per
    /// direction term (k, l), per channel; terms by total degree, then by the second
    /// degree.
    #[must_use]
    pub fn quanta(&self) -> &[i32] {
        &self.quanta
    }

    /// Basis functions, each with three channels.
    #[must_use]
    pub fn len(&self) -> usize {
        self.quanta.len() / 3
    }

    /// Whether it has no basis functions: never so.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.quanta.is_empty()
    }

    /// How many position leaves and how many direction leaves below them, outside
    /// cells not counted; the deepest levels; and the highest orders.
    #[must_use]
    pub fn census(&self) -> Census {
        let mut census = Census::default();
        self.walk(|step| match step {
            Step::Position => census.positions += 1,
            Step::Leaf(leaf) => {
                census.leaves += 1;
                for i in 0..2 {
                    census.levels[i] = census.levels[i].max(leaf.cell.levels[i]);
                    census.orders[i] = census.orders[i].max(leaf.orders[i]);
                }
            }
            Step::Split { .. } | Step::Nowhere => {}
        });
        census
    }

    /// ∫ |L|² du dv ds dt over all that its leaves cover, all channels together.
    #[must_use]
    pub fn norm_squared(&self) -> f64 {
        let squares = self.quanta.iter().map(|&x| f64::from(x) * f64::from(x));
        squares.sum::<f64>() * self.step * self.step
    }

    /// The radiance at (u, v) towards the unit direction `mu` of the upper
    /// hemisphere, term by term: what [`LegendreSampler`](super::LegendreSampler)
    /// does fast.
    #[must_use]
    pub fn eval(&self, uv: DVec2, mu: DVec3) -> [f64; 3] {
        let st = self.map.to_square(mu);
        let mut found = [0.0; 3];
        self.walk(|step| {
            let Step::Leaf(leaf) = step else { return };
            let Some([[x, y], [s, t]]) = leaf.local([uv, st]) else { return };
            let [fx, fy, fs, ft] = [x, y, s, t].map(|x| legendre(MAX_TREE_ORDER, x));
            let mut at = leaf.start;
            for (i, j) in degrees(leaf.orders[0]) {
                for (k, l) in degrees(leaf.orders[1]) {
                    let function = leaf.scale() * fx[i] * fy[j] * fs[k] * ft[l];
                    for (c, found) in found.iter_mut().enumerate() {
                        *found += function * self.step * f64::from(self.quanta[at + c]);
                    }
                    at += 3;
                }
            }
        });
        found
    }

    pub(super) fn walk(&self, visit: impl FnMut(Step)) {
        if let Err(reason) = walk(&self.shape, visit) {
            unreachable!("a checked shape: {reason}");
        }
    }
}

/// What a tree is made of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Census {
    /// Position leaves.
    pub positions: usize,
    /// Direction leaves below all of them.
    pub leaves: usize,
    /// The deepest levels of position and of direction.
    pub levels: [u8; 2],
    /// The highest orders for position and for direction.
    pub orders: [usize; 2],
}

/// Calls `visit` for each cell of a shape, in order.
fn walk(shape: &[u8], mut visit: impl FnMut(Step)) -> Result<(), String> {
    // Cells still to come, each of position or of direction.
    let mut open = vec![(true, Cells::default())];
    let mut start = 0;
    let mut bytes = shape.iter();
    while let Some((position, cell)) = open.pop() {
        let Some(&byte) = bytes.next() else { return Err("its shape stops early".to_owned()) };
        match (byte, position) {
            (SPLIT, _) => {
                let axis = usize::from(!position);
                if cell.levels[axis] == MAX_DEPTH {
                    return Err(format!("its shape is deeper than {MAX_DEPTH}"));
                }
                visit(Step::Split { position });
                open.extend(cell.children(axis).into_iter().rev().map(|c| (position, c)));
            }
            (POSITION, true) => {
                visit(Step::Position);
                open.push((false, cell));
            }
            (NOWHERE, false) => visit(Step::Nowhere),
            (byte, false) if leaf_orders(byte).is_some() => {
                let orders = leaf_orders(byte).unwrap_or_default();
                let leaf = Leaf { orders, cell, start };
                start += leaf.len();
                visit(Step::Leaf(leaf));
            }
            _ => return Err(format!("its shape has a byte {byte}")),
        }
    }
    match bytes.len() {
        0 => Ok(()),
        rest => Err(format!("its shape goes on for {rest} bytes after its end")),
    }
}
