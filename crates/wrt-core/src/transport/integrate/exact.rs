//! T_jk to round-off: Gauss rules on the pieces between the integrand's kinks.

use super::super::pair::{Overlap, Pair};
use super::events::{Event, events};
use super::patterson::{self, Estimate};
use super::{Integral, Integrator};
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, PI};

/// Integrates between its events (kinks and jumps), where the integrand is analytic.
///
/// With μ = (sinθ, cosθ sinφ, cosθ cosφ) the rim's square root disappears:
/// 4 dκ dλ = cos²θ cosφ dθ dφ. The outer variable θ is cut wherever events cross
/// each other, the cell or the rim, or turn back; the inner one at each event.
/// Each piece gets the least of the nested Gauss rules that settles it, and is
/// halved where 15 points do not.
///
/// Departs from §7.1.4.2, whose rules all ignore the kinks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exact {
    /// Relative error asked for.
    pub tolerance: f64,
}

impl Default for Exact {
    /// 10⁻¹², near what double precision leaves of the overlap areas.
    fn default() -> Self {
        Self { tolerance: 1e-12 }
    }
}

impl Integrator for Exact {
    fn name(&self) -> String {
        format!("exact:{:e}", self.tolerance)
    }

    fn integrate(&self, pair: &Pair<'_>) -> Integral {
        if pair.sources().is_empty() || pair.dests().is_empty() {
            return Integral { value: 0.0, error: 0.0, evaluations: 0 };
        }
        let mut pieces = Pieces::new(pair);
        let (value, error) = pieces.integral(self.tolerance);
        let scale = 0.25 * pair.scale();
        let rounding = 4.0 * f64::EPSILON * value;
        Integral {
            value: value * scale,
            error: (error + rounding) * scale,
            evaluations: pieces.evaluations,
        }
    }
}

/// An interval of θ within which no breakpoint lies. At an end where a root turns
/// back the inner integral has a square root, which θ = end ± t² removes.
#[derive(Clone, Copy, Debug)]
struct Outer {
    low: f64,
    high: f64,
    root_low: bool,
    root_high: bool,
}

/// What rounding leaves of an overlap area.
struct Rounding {
    /// The farthest coordinate that enters.
    reach: f64,
    /// Area in (u, v) per area in the plane, of the dest's cell on average.
    per_area: f64,
    /// The dest cell's area in (u, v).
    whole: f64,
}

impl Rounding {
    fn of(pair: &Pair<'_>) -> Self {
        let sources = pair.sources().iter().flatten().map(|(s, _)| s.abs().max_element());
        let dests = pair.dests().iter().flat_map(|d| d.vertices()).map(|d| d.abs().max_element());
        let whole = pair.dests().iter().map(|d| pair.geometry().dest().chart().area(d)).sum();
        let plane: f64 = pair.dests().iter().map(|d| d.area()).sum();
        let per_area = if plane > 0.0 { whole / plane } else { 0.0 };
        Self { reach: sources.chain(dests).fold(0.0, f64::max), per_area, whole }
    }

    /// Error of the area along a direction with μz = `height`: each border of the
    /// overlap is off by the rounding of the projected coordinates.
    fn of_area(&self, overlap: &Overlap, height: f64) -> f64 {
        let off = 4.0 * f64::EPSILON * self.reach / height;
        (off * overlap.border * self.per_area).min(self.whole)
    }
}

struct Pieces<'a, 'b> {
    pair: &'a Pair<'b>,
    rounding: Rounding,
    events: Vec<Event>,
    outer: Vec<Outer>,
    evaluations: u64,
    /// Scratch: inner breakpoints.
    cuts: Vec<f64>,
}

/// Where refinement ends, because what is left to refine is rounding: overlaps of
/// slivers do not have the digits that a tolerance may ask for. The estimate then
/// says what is left.
const MOST_EVALUATIONS: u64 = 2_000_000;

impl Outer {
    /// θ and dθ/dt at t ∈ [0, 1].
    fn at(&self, t: f64) -> (f64, f64) {
        let width = self.high - self.low;
        match (self.root_low, self.root_high) {
            (false, false) => (self.low + width * t, width),
            (true, false) => (self.low + width * t * t, 2.0 * width * t),
            (false, true) => (self.high - width * (1.0 - t) * (1.0 - t), 2.0 * width * (1.0 - t)),
            (true, true) => {
                let sine = (FRAC_PI_2 * t).sin();
                (self.low + width * sine * sine, FRAC_PI_2 * width * (PI * t).sin())
            }
        }
    }

    fn halves(&self) -> [Self; 2] {
        let middle = 0.5 * (self.low + self.high);
        [
            Self { high: middle, root_high: false, ..*self },
            Self { low: middle, root_low: false, ..*self },
        ]
    }
}

impl<'a, 'b> Pieces<'a, 'b> {
    fn new(pair: &'a Pair<'b>) -> Self {
        let events = events(pair);
        let outer = outer_pieces(pair.dest_box(), &events);
        let rounding = Rounding::of(pair);
        Self { pair, rounding, events, outer, evaluations: 0, cuts: Vec::new() }
    }

    /// The integral and its error estimate, halving pieces until the sum of their
    /// errors is within `tolerance` of the whole.
    fn integral(&mut self, tolerance: f64) -> (f64, f64) {
        const DEEPEST: u32 = 24;
        let outer = std::mem::take(&mut self.outer);
        let total: f64 = outer.iter().map(|o| o.high - o.low).sum();
        // A first pass by the shortest rules gives the size that "relative" means,
        // and is all that many pieces need.
        let first: Vec<Estimate> =
            outer.iter().map(|piece| self.strip(piece, f64::INFINITY)).collect();
        let allowed = tolerance * first.iter().map(|strip| strip.value).sum::<f64>().abs();
        let known: f64 = first.iter().map(|strip| strip.error + strip.inner).sum();
        if known <= allowed {
            return (first.iter().map(|strip| strip.value).sum(), known);
        }
        let mut stack: Vec<(Outer, u32, Option<Estimate>)> =
            outer.iter().zip(first).rev().map(|(&o, strip)| (o, 0, Some(strip))).collect();
        let (mut value, mut error) = (0.0, 0.0);
        while let Some((piece, depth, first)) = stack.pop() {
            let share = allowed * ((piece.high - piece.low) / total).max(1e-3);
            let settled = first.filter(|strip| strip.inner.max(strip.error) <= share);
            let strip = settled.unwrap_or_else(|| self.strip(&piece, share));
            // What the inner integrals do not know no outer piece can resolve.
            let unresolved = strip.error > share.max(strip.inner);
            if unresolved && depth < DEEPEST && self.evaluations < MOST_EVALUATIONS {
                stack.extend(piece.halves().iter().rev().map(|&half| (half, depth + 1, None)));
            } else {
                value += strip.value;
                error += strip.error + strip.inner;
            }
        }
        (value, error)
    }

    /// ∫ over one outer piece, itself and its inner integrals within `allowed` if
    /// one rule can.
    fn strip(&mut self, piece: &Outer, allowed: f64) -> Estimate {
        let width = (piece.high - piece.low).max(f64::MIN_POSITIVE);
        patterson::integrate(allowed, |t| {
            let (theta, slope) = piece.at(t);
            let (value, error) = self.line(theta, allowed / width);
            (slope * value, slope * error)
        })
    }

    /// ∫ G A cos²θ cosφ dφ over one meridian, and its error estimate.
    fn line(&mut self, theta: f64, allowed: f64) -> (f64, f64) {
        let (sine, cosine) = theta.sin_cos();
        let [low, high] = self.pair.dest_box();
        let angle = |b: f64| (b / cosine).clamp(-1.0, 1.0).asin();
        let (low, high) = (angle(low.y), angle(high.y));
        let mut cuts = std::mem::take(&mut self.cuts);
        cuts.clear();
        for event in &self.events {
            for phi in event.roots(sine, cosine).into_iter().flatten() {
                if low < phi && phi < high && event.is_active(direction(sine, cosine, phi)) {
                    cuts.push(phi);
                }
            }
        }
        cuts.push(high);
        cuts.sort_unstable_by(f64::total_cmp);
        let (mut value, mut error, mut from) = (0.0, 0.0, low);
        for &to in &cuts {
            if to - from > 1e-15 {
                let middle = direction(sine, cosine, 0.5 * (from + to));
                // G is constant between events, and so is A = 0.
                let sees = self.pair.leaves_in_cell(middle);
                let overlap = if sees { self.pair.overlap(middle) } else { Overlap::default() };
                self.evaluations += 1;
                if overlap.area > 0.0 {
                    let meridian = Meridian { sine, cosine, from, to };
                    let share = allowed * (to - from) / (high - low);
                    let (v, e) = self.segment(&meridian, overlap, share, 0);
                    value += v;
                    error += e;
                }
            }
            from = to;
        }
        self.cuts = cuts;
        (value, error)
    }

    /// ∫ A cos²θ cosφ dφ over an interval without events, and its error estimate;
    /// `overlap` is that of its middle.
    fn segment(
        &mut self,
        meridian: &Meridian,
        overlap: Overlap,
        allowed: f64,
        depth: u32,
    ) -> (f64, f64) {
        let &Meridian { sine, cosine, from, to } = meridian;
        let width = to - from;
        let measure = width * cosine * cosine;
        let height = cosine * (0.5 * (from + to)).cos();
        let rounding = self.rounding.of_area(&overlap, height) * (width * cosine * height);
        let Estimate { value, error, .. } = patterson::integrate(allowed.max(rounding), |t| {
            let phi = from + width * t;
            let area = if t == 0.5 {
                overlap.area
            } else {
                self.evaluations += 1;
                self.pair.area(direction(sine, cosine, phi))
            };
            (measure * phi.cos() * area, 0.0)
        });
        let refine = error > allowed.max(rounding);
        if refine && depth < 12 && self.evaluations < MOST_EVALUATIONS {
            let middle = 0.5 * (from + to);
            let mut sum = (0.0, 0.0);
            for (from, to) in [(from, middle), (middle, to)] {
                let half = Meridian { from, to, ..*meridian };
                let overlap = self.pair.overlap(direction(sine, cosine, 0.5 * (from + to)));
                self.evaluations += 1;
                let (v, e) = self.segment(&half, overlap, 0.5 * allowed, depth + 1);
                sum = (sum.0 + v, sum.1 + e);
            }
            return sum;
        }
        (value, error + rounding)
    }
}

/// The part between two angles φ of the meridian at the angle θ.
struct Meridian {
    sine: f64,
    cosine: f64,
    from: f64,
    to: f64,
}

fn direction(sine: f64, cosine: f64, phi: f64) -> DVec3 {
    let (s, c) = phi.sin_cos();
    DVec3::new(sine, cosine * s, cosine * c)
}

/// Cuts θ wherever the set of inner breakpoints changes its nature.
fn outer_pieces([low, high]: [DVec2; 2], events: &[Event]) -> Vec<Outer> {
    const SLACK: f64 = 1e-9;
    let mut cuts: Vec<(f64, bool)> = Vec::new();
    let (first, last) = (low.x.asin(), high.x.asin());
    // The cell's own borders in μy, and the rim: crossings with them only.
    let borders = [
        Event::grid_line(DVec3::Y, low.y),
        Event::grid_line(DVec3::Y, high.y),
        Event::grid_line(DVec3::Z, 0.0),
    ];
    let inside = |mu: &DVec3| {
        mu.z >= -SLACK
            && (low.x - SLACK..=high.x + SLACK).contains(&mu.x)
            && (low.y - SLACK..=high.y + SLACK).contains(&mu.y)
    };
    let theta = |mu: DVec3| mu.x.atan2(mu.y.hypot(mu.z));
    for (i, event) in events.iter().enumerate() {
        for mu in event.extremes().into_iter().flatten().filter(inside) {
            cuts.push((theta(mu), true));
        }
        for other in events[i + 1..].iter().chain(&borders) {
            for mu in event.crossings(other).into_iter().flatten().filter(inside) {
                if event.is_active(mu) && other.is_active(mu) {
                    cuts.push((theta(mu), false));
                }
            }
        }
    }
    // μy = b meets the rim where cosθ = |b|, at a square root.
    for b in [low.y, high.y] {
        if b.abs() < 1.0 && b != 0.0 {
            let turn = b.abs().acos();
            cuts.extend([(turn, true), (-turn, true)]);
        }
    }
    cuts.retain(|&(t, _)| first < t && t < last);
    cuts.extend([(first, false), (last, false)]);
    cuts.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    // Breakpoints that rounding has split are one, with a root if any has.
    let mut merged: Vec<(f64, bool)> = Vec::new();
    for (t, root) in cuts {
        match merged.last_mut() {
            Some(last) if t - last.0 < 1e-14 => last.1 |= root,
            _ => merged.push((t, root)),
        }
    }
    let nearest = DVec2::ZERO.clamp(low, high);
    merged
        .windows(2)
        .map(|w| Outer { low: w[0].0, high: w[1].0, root_low: w[0].1, root_high: w[1].1 })
        // Beyond the rim of this cell there are no directions.
        .filter(|piece| (0.5 * (piece.low + piece.high)).cos() > nearest.y.abs())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::{Support, TransportGeometry};
    use crate::{Levels, Polygon, udc_fraction};

    fn rectangle(origin: [f64; 3], u: [f64; 3], v: [f64; 3]) -> Polygon {
        Polygon::rectangle(origin.into(), u.into(), v.into()).expect("a rectangle")
    }

    fn whole() -> Support {
        Support::isotropic(0, [0; 4])
    }

    /// πF/4 = T at the root (E = πF L, and the mean of L over the hypercube is
    /// E/4). F from J. R. Howell's catalog, C-11: facing unit squares, distance 1.
    #[test]
    fn facing_squares_have_their_form_factor_to_twelve_digits() {
        let floor = rectangle([0., 0., 0.], [1., 0., 0.], [0., 1., 0.]);
        let ceiling = rectangle([0., 0., 1.], [0., 1., 0.], [1., 0., 0.]);
        let geometry = TransportGeometry::new(ceiling, floor);
        let (x, y) = (1.0_f64, 1.0_f64);
        let (p, q) = (1.0 + x * x, 1.0 + y * y);
        let form = 2.0 / (PI * x * y)
            * ((p * q / (1.0 + x * x + y * y)).sqrt().ln()
                + x * q.sqrt() * (x / q.sqrt()).atan()
                + y * p.sqrt() * (y / p.sqrt()).atan()
                - x * x.atan()
                - y * y.atan());
        let result = Exact::default().integrate(&Pair::new(&geometry, whole(), whole()));
        let expected = PI * form / 4.0;
        assert!((result.value / expected - 1.0).abs() < 1e-12, "{result:?} {expected}");
        assert!(result.error < 1e-11 * expected, "{result:?}");
    }

    /// Perpendicular unit squares that share an edge: F = 0.20004377607540315
    /// (Howell C-14, H = W = 1).
    #[test]
    fn squares_that_share_an_edge_have_their_form_factor() {
        let floor = rectangle([0., 0., 0.], [1., 0., 0.], [0., 1., 0.]);
        let wall = rectangle([0., 1., 0.], [1., 0., 0.], [0., 0., 1.]);
        let geometry = TransportGeometry::new(wall, floor);
        let form = (2.0 * 1.0_f64.atan() - 2.0_f64.sqrt() * (0.5_f64).sqrt().atan()
            + 0.25 * (4.0_f64 / 3.0 * (3.0_f64 / 4.0).powi(2)).ln())
            / PI;
        let result = Exact::default().integrate(&Pair::new(&geometry, whole(), whole()));
        let expected = PI * form / 4.0;
        assert!((result.value / expected - 1.0).abs() < 1e-11, "{result:?} {expected}");
    }

    /// A source that fills the hemisphere: every direction cell gets its own part
    /// of the UDC.
    #[test]
    fn cells_under_a_huge_source_hold_their_udc_fraction() {
        let floor = rectangle([0., 0., 0.], [1., 0., 0.], [0., 1., 0.]);
        let sky = rectangle([-1e9, 1e9, 1.], [2e9, 0., 0.], [0., -2e9, 0.]);
        let geometry = TransportGeometry::new(sky, floor);
        let levels = Levels { position: 0, direction: 2 };
        for k in 0..16_u16 {
            let (kappa, lambda) = (k % 4, k / 4);
            let dest = Support { levels, m: [0, 0, kappa, lambda] };
            let pair = Pair::new(&geometry, whole(), dest);
            let at = |m: u16| f64::from(m) / 4.0;
            let fraction = udc_fraction([at(kappa), at(lambda)], [at(kappa + 1), at(lambda + 1)]);
            let mean = Exact::default().integrate(&pair).value * dest.scale();
            assert!((mean - fraction).abs() < 1e-8, "cell {k}: {mean} {fraction}");
        }
    }

    /// T of the parts sums to T of the whole, over source and destination cells in
    /// position and direction.
    #[test]
    fn parts_sum_to_the_whole() {
        let dest = rectangle([0., 0., 0.], [1., 0., 0.], [0., 1., 0.]);
        let tilted = rectangle([0.3, 0.9, 0.4], [0.6, -0.2, 0.1], [0.15, 0.25, 0.8]);
        let geometry = TransportGeometry::new(tilted, dest);
        let exact = Exact::default();
        let measure = |s: Support, d: Support| {
            exact.integrate(&Pair::new(&geometry, s, d)).value / (s.scale() * d.scale())
        };
        let parent = Support::isotropic(1, [1, 0, 1, 1]);
        let child = |parent: Support, m: usize| {
            let m = std::array::from_fn(|d| 2 * parent.m[d] + (m >> d & 1) as u16);
            Support::isotropic(parent.levels.position + 1, m)
        };
        let whole_source = Support::isotropic(0, [0; 4]);
        let whole = measure(whole_source, parent);
        assert!(whole > 1e-3, "the case sees light: {whole}");
        let over_dest: f64 = (0..16).map(|m| measure(whole_source, child(parent, m))).sum();
        let over_source: f64 = (0..16).map(|m| measure(child(whole_source, m), parent)).sum();
        assert!((over_dest / whole - 1.0).abs() < 1e-11, "{over_dest} {whole}");
        assert!((over_source / whole - 1.0).abs() < 1e-11, "{over_source} {whole}");
    }
}
