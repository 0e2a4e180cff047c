//! A Legendre tree made immutable for look-ups.

use super::tree::{MAX_TREE_ORDER, Step};
use super::{LegendreTree, terms};
use crate::DirectionMap;
use crate::grid::Rgb;
use glam::{DVec2, DVec3};

/// Channels' coefficients lie in rows of this many, side by side: a register.
const LANES: usize = 4;

/// A radiance to be looked up by many threads.
///
/// A look-up descends once, first by position, then by direction, and sums its
/// leaf's polynomials as a product of two short vectors: (u, v)'s and (s, t)'s.
#[derive(Clone, Debug)]
pub struct LegendreSampler {
    map: DirectionMap,
    /// Per split cell, what its four children are.
    splits: Vec<[Below; 4]>,
    root: Below,
    leaves: Vec<Leaf>,
    /// Leaf by leaf and position term by position term: the direction terms in rows
    /// of [`LANES`], padded with zeros; a row of each channel, then the next row.
    rows: Vec<[[f32; LANES]; 3]>,
}

/// A child: a leaf's number with one bit set, a position split's with another, or a
/// direction split's. Position leaves have no place of their own; the root of their
/// directions is in theirs.
type Below = u32;
const LEAF: Below = 1 << 31;
const POSITION: Below = 1 << 30;

#[derive(Clone, Copy, Debug)]
struct Leaf {
    first_row: u32,
    orders: [u8; 2],
}

impl LegendreSampler {
    /// Prepares `tree` for look-ups.
    ///
    /// # Panics
    ///
    /// If it has 2³⁰ leaves or 2³² rows, of 48 GiB or more.
    #[must_use]
    pub fn new(tree: &LegendreTree) -> Self {
        let mut sampler = Self {
            map: tree.map(),
            splits: Vec::new(),
            root: 0,
            leaves: Vec::new(),
            rows: Vec::new(),
        };
        // A cell outside the hemisphere is a dark leaf; no direction leads there.
        let nowhere = sampler.add_leaf([1, 1], &[0; 3], 0.0);
        // Split cells whose children are not all met yet, and which comes next.
        let mut open: Vec<(usize, usize)> = Vec::new();
        tree.walk(|step| {
            let below = match step {
                Step::Position => return,
                Step::Nowhere => nowhere,
                Step::Leaf(leaf) => {
                    let quanta = &tree.quanta()[leaf.start..leaf.start + leaf.len()];
                    sampler.add_leaf(leaf.orders, quanta, leaf.scale() * tree.step())
                }
                Step::Split { position } => {
                    sampler.splits.push([nowhere; 4]);
                    // There are fewer splits than leaves.
                    (sampler.splits.len() - 1) as Below | if position { POSITION } else { 0 }
                }
            };
            match open.last_mut() {
                None => sampler.root = below,
                Some((split, child)) => {
                    sampler.splits[*split][*child] = below;
                    *child += 1;
                    if *child == 4 {
                        open.pop();
                    }
                }
            }
            if let Step::Split { .. } = step {
                open.push((sampler.splits.len() - 1, 0));
            }
        });
        sampler
    }

    fn add_leaf(&mut self, orders: [usize; 2], quanta: &[i32], scale: f64) -> Below {
        let first_row = u32::try_from(self.rows.len()).expect("fewer than 2³² rows");
        for row in quanta.chunks_exact(3 * terms(orders[1])) {
            for part in row.chunks(3 * LANES) {
                let mut lanes = [[0.0; LANES]; 3];
                for (i, rgb) in part.chunks_exact(3).enumerate() {
                    for c in 0..3 {
                        lanes[c][i] = (scale * f64::from(rgb[c])) as f32;
                    }
                }
                self.rows.push(lanes);
            }
        }
        self.leaves.push(Leaf { first_row, orders: orders.map(|p| p as u8) });
        let leaf = Below::try_from(self.leaves.len() - 1).expect("fewer than 2³⁰ leaves");
        assert!(leaf < POSITION, "{leaf} leaves");
        leaf | LEAF
    }

    /// Bytes it occupies.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of_val(&self.splits[..]) + size_of_val(&self.leaves[..]) + size_of_val(&self.rows[..])
    }

    /// The radiance at (u, v), of which what lies outside [0, 1]² counts as its
    /// border, towards the unit direction `mu` of the upper hemisphere.
    #[must_use]
    pub fn radiance(&self, uv: DVec2, mu: DVec3) -> Rgb {
        // Off the horizon by a rounding or two: the cells outside touch it there.
        const INSIDE: f64 = 1.0 - 8.0 * f64::EPSILON;
        let below_one = DVec2::splat(1.0 - f64::EPSILON);
        let st = (self.map.to_square(mu) - 0.5) * INSIDE + 0.5;
        let uv = uv.clamp(DVec2::ZERO, below_one);
        let st = st.clamp(DVec2::ZERO, below_one);
        self.look_up(uv, st)
    }

    fn look_up(&self, mut uv: DVec2, mut st: DVec2) -> Rgb {
        let mut below = self.root;
        while below & (LEAF | POSITION) == POSITION {
            below = self.splits[(below & !POSITION) as usize][half(&mut uv)];
        }
        while below & LEAF == 0 {
            below = self.splits[below as usize][half(&mut st)];
        }
        let leaf = self.leaves[(below & !LEAF) as usize];
        let [p, q] = leaf.orders.map(usize::from);
        // One loop per number of rows, so that each is unrolled.
        match terms(q).div_ceil(LANES) {
            1 => self.sum::<1>(leaf, p, q, uv, st),
            2 => self.sum::<2>(leaf, p, q, uv, st),
            3 => self.sum::<3>(leaf, p, q, uv, st),
            4 => self.sum::<4>(leaf, p, q, uv, st),
            6 => self.sum::<6>(leaf, p, q, uv, st),
            7 => self.sum::<7>(leaf, p, q, uv, st),
            _ => self.sum::<9>(leaf, p, q, uv, st),
        }
    }

    /// Σ over position terms and over `ROWS` rows of direction terms.
    #[inline]
    fn sum<const ROWS: usize>(&self, leaf: Leaf, p: usize, q: usize, uv: DVec2, st: DVec2) -> Rgb {
        let position = products::<{ terms(MAX_TREE_ORDER) }>(p, uv);
        let mut direction = [[0.0; LANES]; ROWS];
        let flat = products::<{ terms(MAX_TREE_ORDER) }>(q, st);
        direction.as_flattened_mut().copy_from_slice(&flat[..ROWS * LANES]);
        let count = terms(p);
        let rows = &self.rows[leaf.first_row as usize..][..count * ROWS];
        let mut sums = [[0.0_f32; LANES]; 3];
        for (a, rows) in position[..count].iter().zip(rows.as_chunks::<ROWS>().0) {
            for (b, row) in direction.iter().zip(rows) {
                for lane in 0..LANES {
                    let function = a * b[lane];
                    for c in 0..3 {
                        sums[c][lane] += function * row[c][lane];
                    }
                }
            }
        }
        sums.map(|lanes| (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]))
    }
}

/// Which child holds the point; moves the point to that child's coordinates.
fn half(point: &mut DVec2) -> usize {
    let twice = 2.0 * *point;
    let (x, y) = (twice.x >= 1.0, twice.y >= 1.0);
    *point = twice - DVec2::new(f64::from(u8::from(x)), f64::from(u8::from(y)));
    usize::from(x) | usize::from(y) << 1
}

/// The products φ_i(x) φ_j(y) of total degree below `order`, by total degree; zeros
/// follow.
#[inline]
fn products<const N: usize>(order: usize, point: DVec2) -> [f32; N] {
    let (x, y) = (values(order, point.x), values(order, point.y));
    let mut products = [0.0; N];
    let mut n = 0;
    for degree in 0..order {
        for j in 0..=degree {
            products[n] = x[degree - j] * y[j];
            n += 1;
        }
    }
    products
}

/// φ_0(x), …, φ_(p−1)(x) in single precision.
#[inline]
fn values(order: usize, x: f64) -> [f32; MAX_TREE_ORDER] {
    let y = (2.0 * x - 1.0) as f32;
    let mut values = [0.0; MAX_TREE_ORDER];
    let (mut before, mut now) = (0.0, 1.0);
    for k in 0..order {
        values[k] = now * NORM[k];
        (before, now) = (now, NOW[k] * y * now - BEFORE[k] * before);
    }
    values
}

/// √(2k + 1), and the factors of P_k and of P_(k−1) in P_(k+1).
const NORM: [f32; MAX_TREE_ORDER] =
    [1.0, 1.732_050_8, 2.236_068, 2.645_751_3, 3.0, 3.316_624_8, 3.605_551_2, 3.872_983_3];
const NOW: [f32; MAX_TREE_ORDER] =
    [1.0, 3.0 / 2.0, 5.0 / 3.0, 7.0 / 4.0, 9.0 / 5.0, 11.0 / 6.0, 13.0 / 7.0, 15.0 / 8.0];
const BEFORE: [f32; MAX_TREE_ORDER] =
    [0.0, 1.0 / 2.0, 2.0 / 3.0, 3.0 / 4.0, 4.0 / 5.0, 5.0 / 6.0, 6.0 / 7.0, 7.0 / 8.0];
