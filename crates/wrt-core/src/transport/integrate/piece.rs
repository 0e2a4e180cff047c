//! The pieces of a strip of θ between inner breakpoints, where the integrand is
//! analytic, and nested rules on them.

use super::super::pair::{Overlap, Pair};
use super::super::shape::Shape;
use super::beam::Beam;
use super::events::Event;
use super::nested::{self, Node};
use super::strips::Strip;
use crate::Chart;
use glam::{DVec2, DVec3};
use std::rc::Rc;

/// What bounds a piece in φ.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Bound {
    /// One of the two roots of an event.
    Event { index: usize, root: usize },
    /// μy = b, as far as the rim: the cell's own border.
    Border(f64),
}

impl Bound {
    /// Its φ on the meridian with this sine and cosine of θ.
    fn at(self, events: &[Event], sine: f64, cosine: f64) -> Option<f64> {
        match self {
            Self::Event { index, root } => events[index].roots(sine, cosine)[root],
            Self::Border(b) => Some((b / cosine).clamp(-1.0, 1.0).asin()),
        }
    }
}

/// A part of the unit square (s, t) that is mapped onto the θ of a strip and the
/// φ between two bounds.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    strip: Strip,
    bounds: [Bound; 2],
    low: [f64; 2],
    high: [f64; 2],
    /// Which of the nested rules is used along s and along t.
    rules: [usize; 2],
    /// The overlap's corners, where they could be told.
    shape: Option<Rc<Shape>>,
}

/// The integral over a piece, and what is not known of it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Estimate {
    pub(super) value: f64,
    /// What the rule may miss along s and along t.
    pub(super) errors: [f64; 2],
    /// What rounding of the overlaps amounts to: no rule resolves it.
    pub(super) rounding: f64,
}

impl Estimate {
    pub(super) fn error(&self) -> f64 {
        self.errors[0] + self.errors[1]
    }
}

impl Piece {
    /// The pieces that see anything, each with a nested `rule` to begin with; adds the
    /// evaluations this takes.
    pub(super) fn all(
        at: &Pieces<'_, '_>,
        strips: &[Strip],
        rule: usize,
        evaluations: &mut u64,
    ) -> Vec<Self> {
        let Pieces { pair, events, .. } = *at;
        let mut pieces: Vec<Self> = Vec::new();
        let [low, high] = pair.dest_box();
        let mut cuts: Vec<(f64, Bound)> = Vec::new();
        // What the strip before has between which bounds: a piece, by number, or
        // nothing. A cut changes only what meets at its breakpoints.
        let mut before: Vec<([Bound; 2], Option<usize>)> = Vec::new();
        let mut open = Vec::new();
        for (i, strip) in strips.iter().enumerate() {
            if i == 0 || !strips[i - 1].continues_in(strip) {
                before.clear();
            }
            let (sine, cosine) = strip.at(0.5).0.sin_cos();
            let ends = [Bound::Border(low.y), Bound::Border(high.y)];
            let [Some(first), Some(last)] = ends.map(|end| end.at(events, sine, cosine)) else {
                before.clear();
                continue;
            };
            cuts.clear();
            for (index, event) in events.iter().enumerate() {
                for (root, phi) in event.roots(sine, cosine).into_iter().enumerate() {
                    let Some(phi) = phi.filter(|&phi| first < phi && phi < last) else { continue };
                    if event.is_active(direction(sine, cosine, phi)) {
                        cuts.push((phi, Bound::Event { index, root }));
                    }
                }
            }
            cuts.push((last, ends[1]));
            cuts.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
            let mut from = (first, ends[0]);
            for &to in &cuts {
                // Breakpoints that rounding has split are one.
                if to.0 - from.0 <= 1e-15 {
                    continue;
                }
                let bounds = [from.1, to.1];
                let known = before.iter().find(|(other, _)| *other == bounds).map(|k| k.1);
                let piece = known.unwrap_or_else(|| {
                    let middle = direction(sine, cosine, 0.5 * (from.0 + to.0));
                    *evaluations += 1;
                    // G is constant between events, and so is A = 0.
                    if !pair.leaves_in_cell(middle) || pair.area(middle) <= 0.0 {
                        return None;
                    }
                    if at.beam.is_some_and(|beam| beam.factor(middle).is_none()) {
                        return None;
                    }
                    // Nearer to one bound, where the shape is the same.
                    let other = direction(sine, cosine, 0.9 * from.0 + 0.1 * to.0);
                    pieces.push(Self {
                        strip: *strip,
                        bounds,
                        low: [0.0; 2],
                        high: [1.0; 2],
                        rules: [rule; 2],
                        shape: Shape::of(pair, middle, other).map(Rc::new),
                    });
                    Some(pieces.len() - 1)
                });
                if let (Some(_), Some(piece)) = (known, piece) {
                    let all = &mut pieces[piece].strip;
                    *all = all.joined(strip);
                }
                open.push((bounds, piece));
                from = to;
            }
            std::mem::swap(&mut before, &mut open);
            open.clear();
        }
        pieces
    }

    /// ∬ F A cos²θ cosφ dφ dθ over the piece, with the factor F of the beam if there is one.
    pub(super) fn integral(&self, at: &Pieces<'_, '_>, evaluations: &mut u64) -> Estimate {
        match at.beam {
            None => self.integral_of(at, |_| 1.0, evaluations),
            Some(beam) => self.integral_of(at, |mu| beam.factor(mu).unwrap_or(0.0), evaluations),
        }
    }

    fn integral_of(
        &self,
        at: &Pieces<'_, '_>,
        factor: impl Fn(DVec3) -> f64,
        evaluations: &mut u64,
    ) -> Estimate {
        let rules = self.rules.map(|rule| nested::RULES[rule]);
        let [wide, high] = [0, 1].map(|d| self.high[d] - self.low[d]);
        let middle = rules[1].len() / 2;
        let mut out = Estimate::default();
        // Per node along t, what the short rule along s makes of the column.
        let mut columns = [0.0; nested::LONGEST];
        let mut coarse_columns = [0.0; nested::LONGEST];
        for node in rules[0] {
            let s = self.low[0] + wide * node.x;
            let (theta, slope) = self.strip.at(s);
            let (sine, cosine) = theta.sin_cos();
            let [from, to] = self.bounds.map(|bound| bound.at(at.events, sine, cosine));
            let (Some(from), Some(to)) = (from, to) else { continue };
            let width = (to - from).max(0.0);
            let scale = wide * high * slope * width * cosine * cosine;
            let (mut fine, mut coarse) = (0.0, 0.0);
            for (i, &Node { x, weight, coarse: short }) in rules[1].iter().enumerate() {
                let phi = from + width * (self.low[1] + high * x);
                let (sin_phi, cos_phi) = phi.sin_cos();
                let mu = DVec3::new(sine, cosine * sin_phi, cosine * cos_phi);
                let factor = factor(mu);
                let overlap = if i == middle {
                    let overlap = match &self.shape {
                        Some(shape) => shape.overlap(at.pair, mu),
                        None => at.pair.overlap(mu),
                    };
                    let off = at.rounding.of_area(&overlap, mu.z);
                    out.rounding += node.weight * scale * cos_phi * off * factor;
                    overlap.area
                } else if let Some(shape) = &self.shape {
                    shape.area(at.pair, mu)
                } else {
                    at.pair.area(mu)
                };
                let value = scale * cos_phi * overlap * factor;
                fine += weight * value;
                coarse += short * value;
                columns[i] += node.weight * value;
                coarse_columns[i] += node.coarse * value;
            }
            *evaluations += rules[1].len() as u64;
            out.value += node.weight * fine;
            out.errors[1] += node.weight * (fine - coarse).abs();
        }
        for (i, node) in rules[1].iter().enumerate() {
            out.errors[0] += node.weight * (columns[i] - coarse_columns[i]).abs();
        }
        if at.smooth {
            out.errors = out.errors.map(|difference| nested::error(difference, out.value));
        }
        out
    }

    /// The parts of the piece that nothing changes much on that changes by about itself
    /// over an angle of `scale`; at most 64 along either side.
    pub(super) fn split(self, at: &Pieces<'_, '_>, scale: f64) -> Vec<Self> {
        let (from, to) = (self.strip.at(0.0).0, self.strip.at(1.0).0);
        let wide = (0..=4).filter_map(|i| {
            let (sine, cosine) = self.strip.at(0.25 * f64::from(i)).0.sin_cos();
            let [from, to] = self.bounds.map(|bound| bound.at(at.events, sine, cosine));
            Some((to? - from?) * cosine)
        });
        let sizes = [to - from, wide.fold(0.0, f64::max)];
        let [n, m] = sizes.map(|size| (size / (2.0 * scale)).ceil().clamp(1.0, 64.0) as u32);
        let part = |i: u32| {
            let mut part = self.clone();
            for (d, i, n) in [(0, i % n, n), (1, i / n, m)] {
                part.low[d] = f64::from(i) / f64::from(n);
                part.high[d] = f64::from(i + 1) / f64::from(n);
            }
            part
        };
        (0..n * m).map(part).collect()
    }

    /// The piece refined where it is known worst: a longer rule first, halves then.
    pub(super) fn refined(&self, errors: [f64; 2]) -> [Option<Self>; 2] {
        let d = usize::from(errors[1] > errors[0]);
        let mut one = self.clone();
        if self.rules[d] + 1 < nested::RULES.len() {
            one.rules[d] += 1;
            return [Some(one), None];
        }
        let mut other = self.clone();
        let middle = 0.5 * (self.low[d] + self.high[d]);
        (one.high[d], other.low[d]) = (middle, middle);
        // Halves are smoother by far: a shorter rule may do again.
        (one.rules[d], other.rules[d]) = (1, 1);
        [Some(one), Some(other)]
    }
}

/// A direction between each two neighbouring breakpoints of each of the `strips` that
/// `events` cut a direction cell into.
pub(super) fn between([low, high]: [DVec2; 2], events: &[Event], strips: &[Strip]) -> Vec<DVec3> {
    let mut out = Vec::new();
    for strip in strips {
        let (sine, cosine) = strip.at(0.5).0.sin_cos();
        let ends = [low.y, high.y].map(|y| Bound::Border(y).at(events, sine, cosine));
        let [Some(first), Some(last)] = ends else { continue };
        let roots = events.iter().flat_map(|event| event.roots(sine, cosine)).flatten();
        let mut cuts: Vec<f64> = roots.filter(|&phi| first < phi && phi < last).collect();
        cuts.extend([first, last]);
        cuts.sort_unstable_by(f64::total_cmp);
        out.extend(cuts.windows(2).map(|w| direction(sine, cosine, 0.5 * (w[0] + w[1]))));
    }
    out
}

/// What the pieces of a pair lie in.
pub(super) struct Pieces<'a, 'b> {
    pub(super) pair: &'a Pair<'b>,
    pub(super) events: &'a [Event],
    /// What light counts by its direction; as much everywhere if there is none.
    beam: Option<&'a Beam<'a>>,
    rounding: Rounding,
    /// Whether longer rules gain what they do for functions analytic well beyond
    /// their piece. Near a corner that is all but doubled a perspective chart's
    /// Jacobian has a pole: there the difference of two rules is taken as it is.
    smooth: bool,
}

impl<'a, 'b> Pieces<'a, 'b> {
    pub(super) fn of(pair: &'a Pair<'b>, events: &'a [Event], beam: Option<&'a Beam<'a>>) -> Self {
        let smooth = match pair.geometry().dest().chart() {
            Chart::Perspective { to_uv, .. } => {
                let corners = pair.dests().iter().flat_map(|dest| dest.vertices());
                let weights = corners.map(|p| (*to_uv * p.extend(1.0)).z.abs());
                let (least, most) =
                    weights.fold((f64::INFINITY, 0.0_f64), |(a, b), w| (a.min(w), b.max(w)));
                least > 0.01 * most
            }
            Chart::Rectilinear { .. } | Chart::Bilinear { .. } => true,
        };
        let smooth = smooth && beam.is_none_or(|beam| beam.analytic);
        Self { pair, events, beam, rounding: Rounding::of(pair), smooth }
    }
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

fn direction(sine: f64, cosine: f64, phi: f64) -> DVec3 {
    let (s, c) = phi.sin_cos();
    DVec3::new(sine, cosine * s, cosine * c)
}
