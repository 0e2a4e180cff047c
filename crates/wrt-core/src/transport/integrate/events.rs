//! Where the integrand of a transport coefficient has kinks and jumps.
//!
//! As the direction μ moves, the overlap A_jk(μ) changes its formula only where a
//! corner of one cell crosses an edge of the other: an *event* on the plane
//! through the corner and the edge, n·μ = 0, a great circle. G_j jumps where μ
//! crosses the source's directional grid, a·μ = c, a small circle. Between events
//! the integrand is analytic.

use super::super::Pair;
use glam::{DVec2, DVec3};

/// A circle n·μ = c on the sphere of directions, n of unit length.
#[derive(Clone, Copy, Debug)]
pub(super) struct Event {
    pub(super) n: DVec3,
    pub(super) c: f64,
    /// √(n_y² + n_z²) and the angle of (n_z, n_y): what a meridian sees of n.
    tilt: f64,
    middle: f64,
    /// The corner and the edge (start, vector) that meet; `None` for a grid line.
    meeting: Option<(DVec3, DVec3, DVec3)>,
}

/// Room for rounding where a breakpoint is tested against a bound: one too many
/// costs time, one too few costs digits.
const SLACK: f64 = 1e-9;

impl Event {
    pub(super) fn grid_line(n: DVec3, c: f64) -> Self {
        Self::new(n, c, None)
    }

    fn new(n: DVec3, c: f64, meeting: Option<(DVec3, DVec3, DVec3)>) -> Self {
        Self { n, c, tilt: n.y.hypot(n.z), middle: n.y.atan2(n.z), meeting }
    }

    fn meeting(corner: DVec3, start: DVec3, edge: DVec3) -> Option<Self> {
        let to = corner - start;
        let n = to.cross(edge);
        // A corner on the edge's own line stays there whatever the direction.
        let least = 1e-13 * edge.length() * (to.length() + edge.length());
        (n.length() > least).then(|| Self::new(n.normalize(), 0.0, Some((corner, start, edge))))
    }

    /// √(n_y² + n_z²): 0 for a circle of constant μx.
    pub(super) fn tilt(&self) -> f64 {
        self.tilt
    }

    /// Whether the corner meets the edge itself along `mu`, not just its line.
    pub(super) fn is_active(&self, mu: DVec3) -> bool {
        let Some((corner, start, edge)) = self.meeting else { return true };
        let across = edge.cross(mu);
        let along = (corner - start).cross(mu).dot(across);
        let length = across.length_squared();
        (-SLACK * length..=(1.0 + SLACK) * length).contains(&along)
    }

    /// Whether the circle can pass through directions with cosines (μx, μy) in the box.
    pub(super) fn meets(&self, dest_box: [DVec2; 2]) -> bool {
        let (low, high) = cosine_bounds(dest_box);
        self.crosses(low, high)
    }

    /// Whether the circle can pass through directions with cosines in the box.
    fn crosses(&self, low: DVec3, high: DVec3) -> bool {
        let (a, b) = (self.n * low, self.n * high);
        let (least, most) = (a.min(b).element_sum(), a.max(b).element_sum());
        least <= self.c + SLACK && most >= self.c - SLACK
    }

    /// The directions on both circles.
    pub(super) fn crossings(&self, other: &Self) -> [Option<DVec3>; 2] {
        let axis = self.n.cross(other.n);
        let sine2 = axis.length_squared();
        if sine2 < 1e-24 {
            return [None; 2];
        }
        let cosine = self.n.dot(other.n);
        let foot =
            (self.n * (self.c - other.c * cosine) + other.n * (other.c - self.c * cosine)) / sine2;
        let rest = 1.0 - foot.length_squared();
        if rest < -SLACK {
            return [None; 2];
        }
        // Near-tangent circles: rounding must not lose the root.
        let reach = (rest.max(0.0) / sine2).sqrt();
        [Some(foot + axis * reach), Some(foot - axis * reach)]
    }

    /// The directions of least and greatest μx on the circle.
    pub(super) fn extremes(&self) -> [Option<DVec3>; 2] {
        let across = DVec3::X - self.n * self.n.x;
        let (length, radius2) = (across.length(), 1.0 - self.c * self.c);
        if length < 1e-12 || radius2 < 0.0 {
            return [None; 2];
        }
        let reach = across * (radius2.sqrt() / length);
        [Some(self.n * self.c + reach), Some(self.n * self.c - reach)]
    }

    /// The angles φ ∈ [−π/2, π/2] at which the meridian μ = (sinθ, cosθ sinφ,
    /// cosθ cosφ) crosses the circle.
    pub(super) fn roots(&self, sine: f64, cosine: f64) -> [Option<f64>; 2] {
        use std::f64::consts::{FRAC_PI_2, PI, TAU};
        let height = self.tilt * cosine;
        if height < 1e-300 {
            return [None; 2];
        }
        let ratio = (self.c - self.n.x * sine) / height;
        if ratio.abs() > 1.0 + SLACK {
            return [None; 2];
        }
        let half = ratio.clamp(-1.0, 1.0).acos();
        [self.middle + half, self.middle - half].map(|phi| {
            let phi = if phi > PI {
                phi - TAU
            } else if phi < -PI {
                phi + TAU
            } else {
                phi
            };
            (phi.abs() <= FRAC_PI_2).then_some(phi)
        })
    }
}

/// All events of a pair that can touch its direction cell, each once.
pub(super) fn events(pair: &Pair<'_>) -> Vec<Event> {
    let mut all = Vec::new();
    for source in pair.sources() {
        for dest in pair.dests() {
            for (p, q) in dest.edges() {
                let (p, edge) = (p.extend(0.0), (q - p).extend(0.0));
                for &(start, source_edge) in source {
                    all.extend(Event::meeting(p, start, source_edge));
                    all.extend(Event::meeting(start, p, edge));
                }
            }
        }
    }
    let [x, y, _] = pair.geometry().source_axes();
    let [low, high] = pair.source_box();
    for (axis, c) in [(x, low.x), (x, high.x), (y, low.y), (y, high.y)] {
        // A source direction is −μ in the source's axes.
        if c.abs() < 1.0 {
            all.push(Event::grid_line(-axis, c));
        }
    }
    let (low, high) = cosine_bounds(pair.dest_box());
    all.retain(|event| event.crosses(low, high));
    all
}

/// Bounds on (μx, μy, μz) over a box of (μx, μy).
fn cosine_bounds([low, high]: [DVec2; 2]) -> (DVec3, DVec3) {
    let nearest = DVec2::ZERO.clamp(low, high);
    let farthest = low.abs().max(high.abs());
    let height = |mu: DVec2| (1.0 - mu.length_squared()).max(0.0).sqrt();
    (low.extend(height(farthest)), high.extend(height(nearest)))
}
