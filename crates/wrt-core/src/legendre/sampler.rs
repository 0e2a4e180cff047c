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
        // Off the horizon by some of the look-up's units, 2⁻³²: the cells outside touch
        // it there.
        const INSIDE: f64 = 1.0 - 1e-9;
        let st = (self.map.to_square(mu) - 0.5) * INSIDE + 0.5;
        self.look_up(uv, st)
    }

    fn look_up(&self, uv: DVec2, st: DVec2) -> Rgb {
        let (mut uv, mut st) = (Fixed::new(uv), Fixed::new(st));
        let mut below = self.root;
        while below & (LEAF | POSITION) == POSITION {
            below = self.splits[(below & !POSITION) as usize][uv.half()];
        }
        while below & LEAF == 0 {
            below = self.splits[below as usize][st.half()];
        }
        let leaf = self.leaves[(below & !LEAF) as usize];
        // One loop per direction order, so that each is unrolled.
        match leaf.orders[1] {
            1 => self.sum::<1, 1>(leaf, uv, st),
            2 => self.sum::<2, 1>(leaf, uv, st),
            3 => self.sum::<3, 2>(leaf, uv, st),
            4 => self.sum::<4, 3>(leaf, uv, st),
            5 => self.sum::<5, 4>(leaf, uv, st),
            6 => self.sum::<6, 6>(leaf, uv, st),
            7 => self.sum::<7, 7>(leaf, uv, st),
            _ => self.sum::<8, 9>(leaf, uv, st),
        }
    }

    /// Σ over position terms and over the `ROWS` rows of the direction terms of order
    /// `Q`.
    #[inline]
    fn sum<const Q: usize, const ROWS: usize>(&self, leaf: Leaf, uv: Fixed, st: Fixed) -> Rgb {
        const { assert!(ROWS == terms(Q).div_ceil(LANES), "rows of the direction terms") };
        let mut direction = [[0.0_f32; LANES]; ROWS];
        let (s, t) = (values::<Q>(st.x), values::<Q>(st.y));
        products(&s, &t, direction.as_flattened_mut());
        let p = usize::from(leaf.orders[0]);
        let mut position = [0.0; terms(MAX_TREE_ORDER)];
        let count = match p {
            1 => products(&[1.0], &[1.0], &mut position),
            2 => products(&values::<2>(uv.x), &values::<2>(uv.y), &mut position),
            3 => products(&values::<3>(uv.x), &values::<3>(uv.y), &mut position),
            4 => products(&values::<4>(uv.x), &values::<4>(uv.y), &mut position),
            _ => {
                let (u, v) = (values::<MAX_TREE_ORDER>(uv.x), values::<MAX_TREE_ORDER>(uv.y));
                products(&u[..p], &v[..p], &mut position)
            }
        };
        let rows = &self.rows[leaf.first_row as usize..][..count * ROWS];
        let mut sums = [[0.0_f32; LANES]; 3];
        for (a, rows) in position[..count].iter().zip(rows.as_chunks::<ROWS>().0) {
            let mut inner = [[0.0_f32; LANES]; 3];
            for (b, row) in direction.iter().zip(rows) {
                for (sum, row) in inner.iter_mut().zip(row) {
                    *sum = std::array::from_fn(|lane| sum[lane] + b[lane] * row[lane]);
                }
            }
            for (sum, inner) in sums.iter_mut().zip(&inner) {
                *sum = std::array::from_fn(|lane| sum[lane] + a * inner[lane]);
            }
        }
        sums.map(|lanes| (lanes[0] + lanes[2]) + (lanes[1] + lanes[3]))
    }
}

/// A point of [0, 1)² in units of 2⁻³²: within a cell, so that halving it is a shift.
#[derive(Clone, Copy)]
struct Fixed {
    x: u32,
    y: u32,
}

impl Fixed {
    fn new(point: DVec2) -> Self {
        // Conversion saturates, at 0 and below 1.
        let [x, y] = (point * 2.0_f64.powi(32)).to_array().map(|x| x as u32);
        Self { x, y }
    }

    /// Which child holds the point; moves the point to that child's coordinates.
    fn half(&mut self) -> usize {
        let child = self.x >> 31 | self.y >> 31 << 1;
        self.x <<= 1;
        self.y <<= 1;
        child as usize
    }
}

/// The products of the values of φ_i(x) and φ_j(y) of total degree below their number,
/// by total degree; returns how many.
#[inline]
fn products(x: &[f32], y: &[f32], products: &mut [f32]) -> usize {
    let mut n = 0;
    for degree in 0..x.len() {
        for j in 0..=degree {
            products[n] = x[degree - j] * y[j];
            n += 1;
        }
    }
    n
}

/// φ_0(x), …, φ_(p−1)(x) in single precision, p = `P`.
#[inline]
fn values<const P: usize>(x: u32) -> [f32; P] {
    // 2x − 1: the high bit is the sign.
    let y = (x ^ 1 << 31).cast_signed() as f32 * 2.0_f32.powi(-31);
    let mut values = [0.0; P];
    let (mut before, mut now) = (0.0, 1.0);
    for (k, value) in values.iter_mut().enumerate() {
        *value = now * NORM[k];
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
