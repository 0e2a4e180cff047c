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
    let mut recursion = Recursion {
        geometry,
        options,
        source_levels: source.levels(),
        levels,
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
    dest: TreeBuilder,
    counts: Counts,
}

impl Recursion<'_> {
    /// `wct_transport`, Fig. 11: `smooth` is bS0, the source cell's pure smoothing
    /// coefficient pushed down from its ancestors.
    fn descend(&mut self, source: &Tree, at: Option<usize>, cell: Cell, smooth: [f64; 3]) {
        let from = support(self.source_levels, cell);
        let dest = support(self.levels, Cell::ROOT);
        if self.options.oracle && oracle(&Pair::new(self.geometry, from, dest)) == Verdict::Zero {
            self.counts.zero += 1;
            return;
        }
        let Some(i) = at else {
            if smooth != [0.0; 3] {
                let t = self.propagate(from, smooth, Cell::ROOT);
                self.dest.add_root(smooth.map(|b| b * t));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::{BlockOptions, Exact, transport_block};
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
            let fast = transport_block(&geometry, &source, levels, BlockOptions { samples });
            distance(&fast, &slow) / size
        });
        assert!(errors[1] < 4e-3 && errors[1] < 0.5 * errors[0], "{errors:?}");
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
