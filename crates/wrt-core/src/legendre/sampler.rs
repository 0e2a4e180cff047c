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
/// A look-up descends once, first by position, then by direction, two levels a step,
/// and sums its leaf's polynomials as a product of two short vectors: (u, v)'s and
/// (s, t)'s.
#[derive(Clone, Debug)]
pub struct LegendreSampler {
    map: DirectionMap,
    /// Per split cell at an even depth, what its sixteen grandchildren are: one cache
    /// line. Of a child that does not split, all four are that child.
    nodes: Vec<Node>,
    root: Below,
    leaves: Vec<Leaf>,
    /// Leaf by leaf and position term by position term: the direction terms in rows
    /// of [`LANES`], padded with zeros; a row of each channel, then the next row.
    rows: Vec<[[f32; LANES]; 3]>,
}

/// By two bits of x, then two of y.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Node([Below; 16]);

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
    /// Of position and of direction: a point's bits below them are where in the leaf
    /// it is.
    levels: [u8; 2],
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
            nodes: Vec::new(),
            root: 0,
            leaves: Vec::new(),
            rows: Vec::new(),
        };
        // A cell outside the hemisphere is a dark leaf; no direction leads there.
        let nowhere = sampler.add_leaf([1, 1], [0, 0], &[0; 3], 0.0);
        // Per split cell, its four children; the whole's comes first.
        let (mut splits, mut root) = (Vec::new(), nowhere);
        // Split cells whose children are not all met yet, and which comes next.
        let mut open: Vec<(usize, usize)> = Vec::new();
        tree.walk(|step| {
            let below = match step {
                Step::Position => return,
                Step::Nowhere => nowhere,
                Step::Leaf(leaf) => {
                    let quanta = &tree.quanta()[leaf.start..leaf.start + leaf.len()];
                    let scale = leaf.scale() * tree.step();
                    sampler.add_leaf(leaf.orders, leaf.cell.levels, quanta, scale)
                }
                Step::Split { position } => {
                    splits.push([nowhere; 4]);
                    // There are fewer splits than leaves.
                    (splits.len() - 1) as Below | if position { POSITION } else { 0 }
                }
            };
            match open.last_mut() {
                None => root = below,
                Some((split, child)) => {
                    splits[*split][*child] = below;
                    *child += 1;
                    if *child == 4 {
                        open.pop();
                    }
                }
            }
            if let Step::Split { .. } = step {
                open.push((splits.len() - 1, 0));
            }
        });
        sampler.root = sampler.widen(&splits, root);
        sampler
    }

    /// Makes nodes of sixteen of the splits from `below` on; what then is in its place.
    fn widen(&mut self, splits: &[[Below; 4]], below: Below) -> Below {
        if below & LEAF != 0 {
            return below;
        }
        let kind = below & POSITION;
        let is_split = |below: Below| below & (LEAF | POSITION) == kind;
        let at = self.nodes.len();
        self.nodes.push(Node([0; 16]));
        for (c, child) in splits[(below & !POSITION) as usize].into_iter().enumerate() {
            let grandchildren = if is_split(child) {
                splits[(child & !POSITION) as usize].map(|below| self.widen(splits, below))
            } else {
                [self.widen(splits, child); 4]
            };
            for (g, below) in grandchildren.into_iter().enumerate() {
                let [x, y] = [c % 2 * 2 + g % 2, c / 2 * 2 + g / 2];
                self.nodes[at].0[4 * y + x] = below;
            }
        }
        at as Below | kind
    }

    fn add_leaf(
        &mut self,
        orders: [usize; 2],
        levels: [u8; 2],
        quanta: &[i32],
        scale: f64,
    ) -> Below {
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
        self.leaves.push(Leaf { first_row, orders: orders.map(|p| p as u8), levels });
        let leaf = Below::try_from(self.leaves.len() - 1).expect("fewer than 2³⁰ leaves");
        assert!(leaf < POSITION, "{leaf} leaves");
        leaf | LEAF
    }

    /// Bytes it occupies.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of_val(&self.nodes[..]) + size_of_val(&self.leaves[..]) + size_of_val(&self.rows[..])
    }

    /// The levels of its finest cells, of position and of direction.
    #[must_use]
    pub fn finest_levels(&self) -> [u8; 2] {
        self.leaves
            .iter()
            .fold([0, 0], |[p, d], leaf| [p.max(leaf.levels[0]), d.max(leaf.levels[1])])
    }

    /// The radiance at (u, v), of which what lies outside [0, 1]² counts as its
    /// border, towards the unit direction `mu` of the upper hemisphere.
    #[must_use]
    pub fn radiance(&self, uv: DVec2, mu: DVec3) -> Rgb {
        // Off the horizon by some of the look-up's units, 2⁻³²: the cells outside touch
        // it there.
        const INSIDE: f64 = 1.0 - 1e-9;
        let st = (self.map.to_square(mu) - 0.5) * INSIDE + 0.5;
        self.look_up(Fixed::new(uv), Fixed::new(st))
    }

    fn look_up(&self, uv: Fixed, st: Fixed) -> Rgb {
        let mut below = self.root;
        let mut at = uv;
        while below & (LEAF | POSITION) == POSITION {
            below = self.nodes[(below & !POSITION) as usize].0[at.quarter()];
        }
        at = st;
        while below & LEAF == 0 {
            below = self.nodes[below as usize].0[at.quarter()];
        }
        let leaf = self.leaves[(below & !LEAF) as usize];
        let [uv, st] = [uv.below(leaf.levels[0]), st.below(leaf.levels[1])];
        // One loop per pair of orders, so that each is unrolled, for those up to what
        // a projection has if not asked for more; per direction order for the rest.
        match leaf.orders {
            [1, 1] => self.sum::<1, 1, 1, 1>(leaf, uv, st),
            [1, 2] => self.sum::<1, 1, 2, 1>(leaf, uv, st),
            [1, 3] => self.sum::<1, 1, 3, 2>(leaf, uv, st),
            [1, 4] => self.sum::<1, 1, 4, 3>(leaf, uv, st),
            [2, 1] => self.sum::<2, 3, 1, 1>(leaf, uv, st),
            [2, 2] => self.sum::<2, 3, 2, 1>(leaf, uv, st),
            [2, 3] => self.sum::<2, 3, 3, 2>(leaf, uv, st),
            [2, 4] => self.sum::<2, 3, 4, 3>(leaf, uv, st),
            [3, 1] => self.sum::<3, 6, 1, 1>(leaf, uv, st),
            [3, 2] => self.sum::<3, 6, 2, 1>(leaf, uv, st),
            [3, 3] => self.sum::<3, 6, 3, 2>(leaf, uv, st),
            [3, 4] => self.sum::<3, 6, 4, 3>(leaf, uv, st),
            [4, 1] => self.sum::<4, 10, 1, 1>(leaf, uv, st),
            [4, 2] => self.sum::<4, 10, 2, 1>(leaf, uv, st),
            [4, 3] => self.sum::<4, 10, 3, 2>(leaf, uv, st),
            [4, 4] => self.sum::<4, 10, 4, 3>(leaf, uv, st),
            [_, 1] => self.sum::<8, 36, 1, 1>(leaf, uv, st),
            [_, 2] => self.sum::<8, 36, 2, 1>(leaf, uv, st),
            [_, 3] => self.sum::<8, 36, 3, 2>(leaf, uv, st),
            [_, 4] => self.sum::<8, 36, 4, 3>(leaf, uv, st),
            [_, 5] => self.sum::<8, 36, 5, 4>(leaf, uv, st),
            [_, 6] => self.sum::<8, 36, 6, 6>(leaf, uv, st),
            [_, 7] => self.sum::<8, 36, 7, 7>(leaf, uv, st),
            _ => self.sum::<8, 36, 8, 9>(leaf, uv, st),
        }
    }

    /// Σ over the position terms of order `P`, `COUNT` of them, or of a lower one if
    /// `P` is 8, and over the `ROWS` rows of the direction terms of order `Q`.
    ///
    /// Position first: its terms are single factors, direction's a row of them.
    #[inline]
    fn sum<const P: usize, const COUNT: usize, const Q: usize, const ROWS: usize>(
        &self,
        leaf: Leaf,
        uv: Fixed,
        st: Fixed,
    ) -> Rgb {
        const { assert!(ROWS == terms(Q).div_ceil(LANES) && COUNT == terms(P), "rows, terms") };
        let mut position = [0.0; COUNT];
        products::<P>(uv, &mut position);
        let own = if P == MAX_TREE_ORDER { terms(leaf.orders[0].into()) } else { COUNT };
        let rows = &self.rows[leaf.first_row as usize..][..own * ROWS];
        let mut sums = [[[0.0_f32; LANES]; 3]; ROWS];
        for (a, rows) in position.iter().zip(rows.as_chunks::<ROWS>().0) {
            for (sums, row) in sums.iter_mut().zip(rows) {
                for (sum, row) in sums.iter_mut().zip(row) {
                    *sum = std::array::from_fn(|lane| sum[lane] + a * row[lane]);
                }
            }
        }
        let mut direction = [[0.0_f32; LANES]; ROWS];
        products::<Q>(st, direction.as_flattened_mut());
        let mut found = [[0.0_f32; LANES]; 3];
        for (b, sums) in direction.iter().zip(&sums) {
            for (found, sum) in found.iter_mut().zip(sums) {
                *found = std::array::from_fn(|lane| found[lane] + b[lane] * sum[lane]);
            }
        }
        found.map(|lanes| (lanes[0] + lanes[2]) + (lanes[1] + lanes[3]))
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

    /// Which grandchild holds the point; moves the point to that one's coordinates.
    #[inline]
    fn quarter(&mut self) -> usize {
        let grandchild = self.x >> 30 | self.y >> 30 << 2;
        self.x <<= 2;
        self.y <<= 2;
        grandchild as usize
    }

    /// Where in the cell of that level that holds it the point is.
    #[inline]
    fn below(self, level: u8) -> Self {
        Self { x: self.x << level, y: self.y << level }
    }
}

/// The products φ_i φ_j at a point of total degree below `P`, by total degree.
#[inline]
fn products<const P: usize>(at: Fixed, products: &mut [f32]) {
    let (x, y) = (values::<P>(at.x), values::<P>(at.y));
    let mut n = 0;
    for degree in 0..P {
        for j in 0..=degree {
            products[n] = x[degree - j] * y[j];
            n += 1;
        }
    }
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
