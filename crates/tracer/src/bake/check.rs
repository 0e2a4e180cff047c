//! A baked patch against direct quadrature over the emitters.

use super::{flight::Flight, receivers::Receiver};
use crate::render::R4;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use wrt_core::{Emission, Nusselt, Polygon, Rgb, gather};

/// Squared error and squared reference, summed over checks.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Checked {
    error: f64,
    reference: f64,
}

impl Checked {
    pub(super) fn add(&mut self, other: &Self) {
        self.error += other.error;
        self.reference += other.reference;
    }

    pub(super) fn relative(&self) -> Option<f64> {
        (self.reference > 0.0).then(|| (self.error / self.reference).sqrt())
    }
}

/// The `i`-th of well-spread points of the unit 4-cube.
pub(super) fn spread(i: u64) -> [f64; 4] {
    R4.to_array().map(|step| (0.5 + i as f64 * step).fract())
}

/// Looks the patch up, by (u, v, κ, λ) or by direction, at well-spread points and
/// directions, of those from which `flight` sees the points if there is one, and compares
/// with direct quadrature over the emitters: the error that a picture will have.
pub(super) fn check(
    receiver: &Receiver,
    emitters: &[(Polygon, Emission)],
    flight: Option<&Flight>,
    look_up: &(impl Fn([f64; 4], DVec3) -> Rgb + Sync),
    count: u32,
) -> Checked {
    /// Points looked at for each that a flight is to see.
    const TRIES: u64 = 400;
    let size = receiver.polygon.size().unwrap_or_default();
    let frame = receiver.polygon.frame();
    let candidate = |i: u64| {
        let q = spread(i);
        let to_eye = Nusselt { kappa: q[2], lambda: q[3] }.to_direction()?;
        let point = frame.point(DVec2::new(q[0], q[1]) * size);
        let is_seen = flight.is_none_or(|flight| flight.sees(point, frame.to_world(to_eye)));
        is_seen.then_some((q, to_eye, point))
    };
    let count = u64::from(count);
    let candidates: Vec<_> = match flight {
        None => (1..=count).filter_map(candidate).collect(),
        Some(_) => (1..=TRIES * count).filter_map(candidate).take(count as usize).collect(),
    };
    let parts: Vec<Checked> = candidates
        .into_par_iter()
        .map(|(q, to_eye, point)| {
            let cells = 1 << emitters.iter().map(|e| e.1.level()).max().unwrap_or(0);
            let exact = gather(emitters, frame, point, &receiver.phong, to_eye, cells);
            let found = look_up(q, to_eye);
            let mut sum = Checked::default();
            for (exact, found) in exact.iter().zip(found) {
                sum.error += (exact - f64::from(found)).powi(2);
                sum.reference += exact * exact;
            }
            sum
        })
        .collect();
    let mut sum = Checked::default();
    // In order, for the same bits from any number of threads.
    parts.iter().for_each(|part| sum.add(part));
    sum
}
