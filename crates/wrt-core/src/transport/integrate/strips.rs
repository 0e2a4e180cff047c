//! Strips of θ within which the inner breakpoints keep their order.

use super::events::Event;
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, PI};

/// An interval of θ within which no breakpoint lies. At an end where a root turns
/// back the inner integral has a square root, which θ = end ± t² removes.
#[derive(Clone, Copy, Debug)]
pub(in crate::transport) struct Strip {
    low: f64,
    high: f64,
    root_low: bool,
    root_high: bool,
    /// Whether breakpoints on both sides of the lower end may be the same by name and
    /// yet not continue each other.
    broken: bool,
}

/// A value of θ at which the set of inner breakpoints changes its nature.
#[derive(Clone, Copy, Debug)]
struct Cut {
    theta: f64,
    /// Whether a breakpoint turns back there.
    root: bool,
    /// Whether pieces end there that no breakpoint bounds.
    breaks: bool,
}

impl Strip {
    /// The interval [low, high], and at which ends there is a square root.
    pub(in crate::transport) fn new(
        [low, high]: [f64; 2],
        [root_low, root_high]: [bool; 2],
    ) -> Self {
        Self { low, high, root_low, root_high, broken: false }
    }

    /// Whether what lies between two breakpoints of this strip lies between the same
    /// two in `next`.
    pub(super) fn continues_in(&self, next: &Self) -> bool {
        !next.broken && self.high == next.low
    }

    /// Both strips as one.
    pub(super) fn joined(&self, next: &Self) -> Self {
        Self { high: next.high, root_high: next.root_high, ..*self }
    }

    /// θ and dθ/ds at s ∈ [0, 1].
    pub(in crate::transport) fn at(&self, s: f64) -> (f64, f64) {
        let width = self.high - self.low;
        match (self.root_low, self.root_high) {
            (false, false) => (self.low + width * s, width),
            (true, false) => (self.low + width * s * s, 2.0 * width * s),
            (false, true) => (self.high - width * (1.0 - s) * (1.0 - s), 2.0 * width * (1.0 - s)),
            (true, true) => {
                let sine = (FRAC_PI_2 * s).sin();
                (self.low + width * sine * sine, FRAC_PI_2 * width * (PI * s).sin())
            }
        }
    }
}

/// Cuts θ wherever the set of inner breakpoints changes its nature.
pub(super) fn strips([low, high]: [DVec2; 2], events: &[Event]) -> Vec<Strip> {
    const SLACK: f64 = 1e-9;
    // Circles around the x axis: θ is the same all along, no breakpoint in φ tells.
    const UPRIGHT: f64 = 1e-6;
    let mut cuts: Vec<Cut> = Vec::new();
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
        let breaks = event.tilt() < UPRIGHT;
        for mu in event.extremes().into_iter().flatten().filter(inside) {
            cuts.push(Cut { theta: theta(mu), root: true, breaks });
        }
        for other in events[i + 1..].iter().chain(&borders) {
            for mu in event.crossings(other).into_iter().flatten().filter(inside) {
                if event.is_active(mu) && other.is_active(mu) {
                    let breaks = breaks || other.tilt() < UPRIGHT;
                    cuts.push(Cut { theta: theta(mu), root: false, breaks });
                }
            }
        }
    }
    // μy = b meets the rim where cosθ = |b|, at a square root; beyond it is the rim.
    for b in [low.y, high.y] {
        if b.abs() < 1.0 && b != 0.0 {
            let turn = b.abs().acos();
            cuts.extend([turn, -turn].map(|theta| Cut { theta, root: true, breaks: true }));
        }
    }
    cuts.retain(|cut| first < cut.theta && cut.theta < last);
    cuts.extend([first, last].map(|theta| Cut { theta, root: false, breaks: true }));
    cuts.sort_unstable_by(|a, b| a.theta.total_cmp(&b.theta));
    // Breakpoints that rounding has split are one, and all that any of them is.
    let mut merged: Vec<Cut> = Vec::new();
    for cut in cuts {
        match merged.last_mut() {
            Some(last) if cut.theta - last.theta < 1e-14 => {
                last.root |= cut.root;
                last.breaks |= cut.breaks;
            }
            _ => merged.push(cut),
        }
    }
    let nearest = DVec2::ZERO.clamp(low, high);
    merged
        .windows(2)
        .map(|w| Strip {
            low: w[0].theta,
            high: w[1].theta,
            root_low: w[0].root,
            root_high: w[1].root,
            broken: w[0].breaks,
        })
        // Beyond the rim of this cell there are no directions.
        .filter(|piece| (0.5 * (piece.low + piece.high)).cos() > nearest.y.abs())
        .collect()
}
