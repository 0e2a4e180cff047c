//! The paper's adaptive transport: `tc_eval`, `tc_propagate` and `wct_transport`
//! (§7.2.4.4–6, Fig. 10, 11).

use super::oracle::{Verdict, oracle};
use super::{Integrator, Pair, Support, TransportGeometry};
use crate::{CHILDREN, Cell, Levels, Tree, TreeBuilder, WaveletIndex, children, pull};

/// How the recursion gets its coefficients.
#[derive(Debug)]
pub struct RecursionOptions<'a> {
    /// What integrates a pair of pure smoothing functions.
    pub integrator: &'a dyn Integrator,
    /// Whether to ask the oracle before integrating.
    pub oracle: bool,
}

/// How often the recursion got its coefficients from where.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Pairs that the oracle found blind to each other.
    pub zero: u64,
    /// Pairs that the oracle found to see each other in full.
    pub whole: u64,
    /// Pairs integrated.
    pub integrated: u64,
    /// Evaluations of the integrand.
    pub evaluations: u64,
}

/// One transport coefficient T_jk for any basis selectors, by Eq. 19 to 21 down
/// to pure smoothing functions (`tc_eval`).
#[must_use]
pub fn transport_coefficient(
    geometry: &TransportGeometry,
    j: WaveletIndex,
    k: WaveletIndex,
    options: &RecursionOptions<'_>,
    counts: &mut Counts,
) -> f64 {
    // W_νm′ of Eq. 10 with the sign of each wavelet half.
    let weight = |nu: u8, m: usize| {
        if (usize::from(nu) & m).count_ones().is_multiple_of(2) { 0.25 } else { -0.25 }
    };
    if j.nu != 0 {
        let terms = (0..CHILDREN).map(|m| {
            weight(j.nu, m) * transport_coefficient(geometry, j.child(m), k, options, counts)
        });
        return terms.sum();
    }
    if k.nu != 0 {
        let terms = (0..CHILDREN).map(|m| {
            weight(k.nu, m) * transport_coefficient(geometry, j, k.child(m), options, counts)
        });
        return terms.sum();
    }
    let support = |i: WaveletIndex| Support::isotropic(i.l, i.m);
    smoothing(&Pair::new(geometry, support(j), support(k)), options, counts)
}

/// T_jk of two pure smoothing functions: the oracle's, or the integrator's.
fn smoothing(pair: &Pair<'_>, options: &RecursionOptions<'_>, counts: &mut Counts) -> f64 {
    match if options.oracle { oracle(pair) } else { Verdict::Unknown } {
        Verdict::Zero => {
            counts.zero += 1;
            0.0
        }
        Verdict::Whole(value) => {
            counts.whole += 1;
            value
        }
        Verdict::Unknown => {
            let result = options.integrator.integrate(pair);
            counts.integrated += 1;
            counts.evaluations += result.evaluations;
            result.value
        }
    }
}

/// Transports a whole tree, coefficient by coefficient (`wct_transport`), to a
/// destination tree of `levels`, whose top level is 0.
///
/// Walks the source tree to its constant cells and carries each to the
/// destination by `tc_propagate`. Slow, adaptive, and what
/// [`transport_block`](super::transport_block) is measured against.
#[must_use]
pub fn transport_tree(
    geometry: &TransportGeometry,
    source: &Tree,
    levels: Levels,
    options: &RecursionOptions<'_>,
) -> (TreeBuilder, Counts) {
    transport_tree_below(geometry, source, levels, Cell::ROOT, options)
}

/// [`transport_tree`] from another top of the destination (`wiDTop` of Fig. 11):
/// the radiance within the cell `top` alone, 0 elsewhere.
///
/// What several tops that tile the destination give adds up to the whole, so that
/// deep levels can be had where they are wanted and in parts. Coefficients above
/// `top` are those of the part: a pure smoothing coefficient is stored at the root
/// only, and carries up there.
///
/// # Panics
///
/// If `top` is no cell of `levels`.
#[must_use]
pub fn transport_tree_below(
    geometry: &TransportGeometry,
    source: &Tree,
    levels: Levels,
    top: Cell,
    options: &RecursionOptions<'_>,
) -> (TreeBuilder, Counts) {
    assert!(top.depth <= levels.depth(), "{top:?} lies below {levels:?}");
    let mut recursion = Recursion {
        geometry,
        options,
        source_levels: source.levels(),
        levels,
        top,
        dest: TreeBuilder::new(levels),
        counts: Counts::default(),
    };
    let at = (!source.nodes().is_empty()).then_some(0);
    recursion.descend(source, at, Cell::ROOT, source.root().map(f64::from));
    (recursion.dest, recursion.counts)
}

struct Recursion<'a> {
    geometry: &'a TransportGeometry,
    options: &'a RecursionOptions<'a>,
    source_levels: Levels,
    levels: Levels,
    top: Cell,
    dest: TreeBuilder,
    counts: Counts,
}

impl Recursion<'_> {
    /// `wct_transport`, Fig. 11: `smooth` is bS0, the source cell's pure smoothing
    /// coefficient pushed down from its ancestors.
    fn descend(&mut self, source: &Tree, at: Option<usize>, cell: Cell, smooth: [f64; 3]) {
        let from = support(self.source_levels, cell);
        let dest = support(self.levels, self.top);
        if self.options.oracle && oracle(&Pair::new(self.geometry, from, dest)) == Verdict::Zero {
            self.counts.zero += 1;
            return;
        }
        let Some(i) = at else {
            if smooth != [0.0; 3] {
                let t = self.propagate(from, smooth, self.top);
                self.carry_up(t, smooth);
            }
            return;
        };
        let split = self.source_levels.split(cell.depth);
        let values = source.push_node(i, smooth, split);
        for m_prime in children(split) {
            let child = source.nodes()[i].child(m_prime);
            self.descend(source, child, cell.child(split, m_prime), values[m_prime]);
        }
    }

    /// Adds the ancestors' part of `t`, the transport into the smoothing function
    /// of the top cell, times `value`.
    fn carry_up(&mut self, mut t: f64, value: [f64; 3]) {
        for depth in (0..self.top.depth).rev() {
            let split = self.levels.split(depth);
            let (parent, m_prime) = parent(self.levels, self.top, depth);
            let mut one = [0.0; CHILDREN];
            one[m_prime] = t;
            pull(&mut one, split);
            self.dest.add_node(parent, &one.map(|t| value.map(|b| b * t)));
            t = one[0];
        }
        self.dest.add_root(value.map(|b| b * t));
    }

    /// `tc_propagate`, Fig. 10: adds the transport of one source smoothing
    /// coefficient to the destination's nodes at and below `cell`, and returns
    /// T for the cell's own smoothing function.
    fn propagate(&mut self, from: Support, value: [f64; 3], cell: Cell) -> f64 {
        let pair = Pair::new(self.geometry, from, support(self.levels, cell));
        if cell.depth == self.levels.depth() {
            return smoothing(&pair, self.options, &mut self.counts);
        }
        // An exact answer is zero or a constant: it needs no nodes below.
        if self.options.oracle {
            match oracle(&pair) {
                Verdict::Zero => {
                    self.counts.zero += 1;
                    return 0.0;
                }
                Verdict::Whole(t) => {
                    self.counts.whole += 1;
                    return t;
                }
                Verdict::Unknown => {}
            }
        }
        let split = self.levels.split(cell.depth);
        let mut t = [0.0; CHILDREN];
        for m_prime in children(split) {
            t[m_prime] = self.propagate(from, value, cell.child(split, m_prime));
        }
        pull(&mut t, split);
        if t[1..].iter().any(|&t| t != 0.0) {
            self.dest.add_node(cell, &t.map(|t| value.map(|b| b * t)));
        }
        t[0]
    }
}

/// The support of a node's smoothing function.
fn support(levels: Levels, cell: Cell) -> Support {
    let levels = Levels {
        position: levels.position.min(cell.depth),
        direction: levels.direction.min(cell.depth),
    };
    Support { levels, m: cell.m }
}

/// The ancestor of `cell` at `depth`, and which of its children `cell` lies in.
fn parent(levels: Levels, cell: Cell, depth: u8) -> (Cell, usize) {
    let split = levels.split(depth);
    let (mut m, mut m_prime) = (cell.m, 0);
    for (d, m) in m.iter_mut().enumerate() {
        let level = if d < 2 { levels.position } else { levels.direction };
        let below = cell.depth.min(level) - depth.min(level);
        if split >> d & 1 == 1 {
            m_prime |= usize::from(*m >> (below - 1) & 1) << d;
        }
        *m >>= below;
    }
    (Cell { depth, m }, m_prime)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::{BlockOptions, Exact, Method, transport_block};
    use crate::{Emission, Grid, Lobe, Polygon};
    use glam::DVec3;

    fn rectangle(origin: [f64; 3], u: [f64; 3], v: [f64; 3]) -> Polygon {
        Polygon::rectangle(origin.into(), u.into(), v.into()).expect("a rectangle")
    }

    /// The paper's window (Fig. 13): vertical, above the far edge of the floor.
    fn window_over_floor() -> TransportGeometry {
        let window = rectangle([-0.5, 0.0, 0.7], [1., 0., 0.], [0., 0., 1.]);
        // Seen from +y: the window faces +y if u × v points there.
        let window = Polygon::rectilinear(&window.vertices().into_iter().rev().collect::<Vec<_>>())
            .expect("the same, facing +y");
        TransportGeometry::new(window, rectangle([-0.5, 0.2, 0.], [1., 0., 0.], [0., 1., 0.]))
    }

    fn emission() -> Emission {
        let picture = vec![[1.0, 0.2, 0.0], [0.3, 0.9, 0.1], [0.0, 0.4, 2.0], [0.7, 0.7, 0.7]];
        let peak = DVec3::new(0.0, 0.6, 0.8);
        Emission::new(1, picture, Lobe::Cosine { exponent: 4.0, peak })
    }

    fn distance(a: &Grid, b: &Grid) -> f64 {
        let cells = a.levels().positions() * a.levels().directions();
        let (p, d) = (1 << a.levels().position, 1 << a.levels().direction);
        let squares = (0..cells).flat_map(|i| {
            let m = [i % p, i / p % p, i / (p * p) % d, i / (p * p * d)];
            let (a, b) = (a.mean(m), b.mean(m));
            (0..3).map(move |c| f64::from(a[c] - b[c]).powi(2))
        });
        (squares.sum::<f64>() / cells as f64).sqrt()
    }

    /// The recursion with exact integrals against the block with many samples:
    /// two ways that share no quadrature.
    #[test]
    fn recursion_and_block_agree() {
        let geometry = window_over_floor();
        let source = emission().project(2);
        let levels = Levels { position: 1, direction: 3 };
        let tree = TreeBuilder::from_grid(&source).finish();
        let exact = Exact { tolerance: 1e-8 };
        let options = RecursionOptions { integrator: &exact, oracle: true };
        let (builder, counts) = transport_tree(&geometry, &tree, levels, &options);
        let slow = builder.finish().to_grid();
        assert!(counts.zero > 0 && counts.integrated > 0, "{counts:?}");
        let size = slow.norm_squared().sqrt();
        let errors = [8, 32].map(|samples| {
            let fast = transport_block(&geometry, &source, levels, BlockOptions { samples })
                .expect("straight grid lines");
            distance(&fast, &slow) / size
        });
        assert!(errors[1] < 4e-3 && errors[1] < 0.5 * errors[0], "{errors:?}");
    }

    /// Parts that tile the destination add up to it, and each is 0 outside its own.
    #[test]
    fn tops_that_tile_the_destination_add_up_to_the_whole() {
        let geometry = window_over_floor();
        let source = TreeBuilder::from_grid(&emission().project(1)).finish();
        let levels = Levels { position: 1, direction: 2 };
        // Whatever a rule gives, it gives to the whole and to its part alike.
        let rule: Method = "trapezoid2d:9".parse().expect("a method");
        let options = RecursionOptions { integrator: &rule, oracle: true };
        let whole = transport_tree(&geometry, &source, levels, &options).0.finish().to_grid();
        let below = |top| {
            let (part, _) = transport_tree_below(&geometry, &source, levels, top, &options);
            part.finish().to_grid()
        };
        for depth in 1..=2 {
            let cells: Vec<Cell> = (0..256)
                .map(|i| Cell { depth, m: [i & 1, i >> 1 & 1, i >> 2 & 7, i >> 5 & 7] })
                .filter(|cell| cell.m[2].max(cell.m[3]) < 1 << depth)
                .collect();
            let parts: Vec<Grid> = cells.iter().map(|&top| below(top)).collect();
            let sum = Grid::sum(levels, parts.iter().cloned());
            let off = distance(&sum, &whole) / whole.norm_squared().sqrt();
            assert!(off < 1e-6, "depth {depth}: {off:e}, rounding to f32");
            let shift = 2 - depth;
            for (top, part) in cells.iter().zip(&parts) {
                for (i, l) in (0..16).flat_map(|k| (0..4).map(move |p| (p, k))) {
                    let m = [i & 1, i >> 1, l & 3, l >> 2];
                    let inside = top.m[0] as usize == m[0]
                        && top.m[1] as usize == m[1]
                        && top.m[2] as usize == m[2] >> shift
                        && top.m[3] as usize == m[3] >> shift;
                    let size = part.mean(m)[0].abs();
                    assert!(inside || size < 1e-6, "{top:?} reaches {m:?} with {size}");
                }
            }
        }
    }

    /// Two levels below a cell at depth 14: the means there are those of exact
    /// integration, of a source with levels of its own.
    #[test]
    fn levels_reach_sixteen() {
        let geometry = window_over_floor();
        let source = TreeBuilder::from_grid(&emission().project(1)).finish();
        let levels = Levels::isotropic(Levels::MAX);
        let exact = Exact { tolerance: 1e-8 };
        let options = RecursionOptions { integrator: &exact, oracle: true };
        // Where a ray from (0, 0.7) of the floor to the middle of the window lands.
        let to = DVec3::new(0.0, -0.9, 1.2).normalize();
        let at = |x: f64, level: u8| (x * f64::from(1_u32 << level)) as u16;
        let q = [0.5, 0.7, 0.5 * (to.x + 1.0), 0.5 * (to.y + 1.0)];
        let top = Cell { depth: 14, m: q.map(|x| at(x, 14)) };
        let (builder, counts) = transport_tree_below(&geometry, &source, levels, top, &options);
        let tree = builder.finish();
        assert!(counts.whole > 0, "{counts:?}");
        let mean = |m: [u16; 4]| -> [f64; 3] {
            let mut sum = [0.0; 3];
            source.visit_leaves(&mut |low, size, value| {
                assert_eq!(size, [1, 1], "a leaf of the finest level");
                let j = Support::isotropic(1, low.map(|m| m as u16));
                let k = Support::isotropic(16, m);
                let t = exact.integrate(&Pair::new(&geometry, j, k)).value;
                let share = t * k.scale() / j.scale();
                sum = std::array::from_fn(|c| sum[c] + share * value[c]);
            });
            sum
        };
        for step in [[0, 0, 0, 0], [1, 2, 3, 0], [3, 3, 3, 3]] {
            let m: [u16; 4] = std::array::from_fn(|d| 4 * top.m[d] + step[d]);
            let centre = m.map(|m| (f64::from(m) + 0.5) / 65_536.0);
            let (found, expected) = (tree.eval(centre), mean(m));
            assert!(expected[0] > 1e-3, "{expected:?}");
            for c in 0..3 {
                let off = (found[c] / expected[c] - 1.0).abs();
                // 2^32 of f32's 24 bits: sixteen levels of coefficients add up.
                assert!(off < 1e-5, "{step:?} channel {c}: {found:?} {expected:?}");
            }
        }
    }

    /// Coefficients are achromatic (§7.2.2.2): what happens to a channel does not
    /// depend on its place, nor on the others.
    #[test]
    fn channels_in_another_order_arrive_in_that_order() {
        let geometry = window_over_floor();
        let turned = |emission: &Emission| {
            let picture = emission.picture().iter().map(|&[r, g, b]| [g, b, r]).collect();
            Emission::new(emission.level(), picture, emission.lobe().clone())
        };
        let rule: Method = "trapezoid2d:9".parse().expect("a method");
        let options = RecursionOptions { integrator: &rule, oracle: true };
        let levels = Levels { position: 1, direction: 2 };
        let arrives = |emission: &Emission| {
            let source = TreeBuilder::from_grid(&emission.project(1)).finish();
            transport_tree(&geometry, &source, levels, &options).0.finish().to_grid()
        };
        let (straight, permuted) = (arrives(&emission()), arrives(&turned(&emission())));
        for (i, l) in (0..16).flat_map(|k| (0..4).map(move |p| (p, k))) {
            let m = [i & 1, i >> 1, l & 3, l >> 2];
            let [r, g, b] = straight.mean(m);
            assert_eq!(permuted.mean(m), [g, b, r], "{m:?}");
        }
    }

    #[test]
    fn the_oracle_changes_nothing() {
        let geometry = window_over_floor();
        let source = TreeBuilder::from_grid(&emission().project(1)).finish();
        let levels = Levels { position: 1, direction: 2 };
        let exact = Exact { tolerance: 1e-9 };
        let run = |oracle| {
            let options = RecursionOptions { integrator: &exact, oracle };
            let (builder, counts) = transport_tree(&geometry, &source, levels, &options);
            (builder.finish().to_grid(), counts)
        };
        let ((with, asked), (without, unasked)) = (run(true), run(false));
        assert!(distance(&with, &without) <= 1e-7 * with.norm_squared().sqrt(), "rounding to f32");
        assert!(asked.integrated < unasked.integrated, "{asked:?} {unasked:?}");
        assert_eq!((unasked.zero, unasked.whole), (0, 0));
    }

    /// `tc_eval`'s self-test: a coefficient between wavelets, refined by Eq. 21,
    /// equals the sum of its signed halves integrated one by one.
    #[test]
    fn wavelet_coefficients_follow_from_smoothing_ones() {
        let geometry = window_over_floor();
        let exact = Exact::default();
        let options = RecursionOptions { integrator: &exact, oracle: true };
        let j = WaveletIndex { nu: 0b0101, l: 0, m: [0; 4] };
        let k = WaveletIndex { nu: 0b0010, l: 1, m: [0, 1, 1, 0] };
        let mut counts = Counts::default();
        let t = transport_coefficient(&geometry, j, k, &options, &mut counts);
        // B_ν is ±(1/4)·4^(l+1) on its 16 children: the sign from each set bit.
        let sign = |nu: u8, m: usize| {
            if (usize::from(nu) & m).count_ones().is_multiple_of(2) { 1.0 } else { -1.0 }
        };
        let mut direct = 0.0;
        for a in 0..16 {
            for b in 0..16 {
                let (from, to) = (j.child(a), k.child(b));
                let pair = Pair::new(
                    &geometry,
                    Support::isotropic(from.l, from.m),
                    Support::isotropic(to.l, to.m),
                );
                let overlap = exact.integrate(&pair).value / pair.scale();
                // Values of the functions: 4^l each, at their own level.
                direct += sign(j.nu, a) * sign(k.nu, b) * overlap * 1.0 * 4.0;
            }
        }
        assert!(t.abs() > 1e-6 && (t - direct).abs() < 1e-11, "{t} {direct}");
    }
}
