//! Light whose strength depends on its direction, and sums over many pairs of cells.

use super::super::pair::Pair;
use super::events::{Event, events};
use super::exact::Open;
use super::piece::{Piece, Pieces, between};
use super::strips::strips;
use glam::{DVec2, DVec3};

/// What light from a source counts by the direction μ, in the destination's frame, that
/// it is seen in.
pub(in crate::transport) struct Beam<'a> {
    /// `None` where nothing is seen.
    pub(in crate::transport) factor: &'a (dyn Fn(DVec3) -> Option<f64> + Sync),
    /// Where the factor has kinks or jumps, of those that meet the direction cell.
    pub(in crate::transport) bends: &'a Bends,
    /// The angle over which it changes by about itself elsewhere.
    pub(in crate::transport) scale: f64,
    /// Whether it has no roots on those circles.
    pub(in crate::transport) analytic: bool,
}

impl Beam<'_> {
    pub(super) fn factor(&self, mu: DVec3) -> Option<f64> {
        (self.factor)(mu)
    }
}

/// Circles n·μ = c at which a factor is not smooth.
#[derive(Debug, Default)]
pub(in crate::transport) struct Bends(Vec<Event>);

impl Bends {
    /// Those of the circles (n, c) that can meet a direction cell with these bounds on
    /// (μx, μy).
    pub(in crate::transport) fn meeting(
        circles: impl IntoIterator<Item = (DVec3, f64)>,
        dest_box: [DVec2; 2],
    ) -> Self {
        let all = circles.into_iter().map(|(n, c)| Event::grid_line(n, c));
        Self(all.filter(|event| event.meets(dest_box)).collect())
    }

    /// A direction in each of the parts that they cut a direction cell into.
    pub(in crate::transport) fn parts(&self, dest_box: [DVec2; 2]) -> Vec<DVec3> {
        between(dest_box, &self.0, &strips(dest_box, &self.0))
    }
}

/// ∬ ∑ w F A dκ dλ over the direction cell of some pairs, whose factors F and weights
/// w ≥ 0 are given: the integral of each, and the estimated error of the weighted sum,
/// which is at most `absolute` if that can be had.
pub(in crate::transport) fn integrals(
    pairs: &[(&Pair<'_>, &Beam<'_>, f64)],
    absolute: f64,
) -> (Vec<f64>, f64) {
    // dκ dλ = dμx dμy / 4
    const CELLS: f64 = 0.25;
    let arranged: Vec<Vec<Event>> = pairs
        .iter()
        .map(|(pair, beam, _)| {
            let mut all = events(pair);
            all.extend(&beam.bends.0);
            all
        })
        .collect();
    let at: Vec<Pieces<'_, '_>> = pairs
        .iter()
        .zip(&arranged)
        .map(|((pair, beam, _), events)| Pieces::of(pair, events, Some(beam)))
        .collect();
    let (mut open, mut evaluations) = (Open::default(), 0);
    for (i, (pair, beam, weight)) in pairs.iter().enumerate() {
        let strips = strips(pair.dest_box(), &arranged[i]);
        for piece in Piece::all(&at[i], &strips, 0, &mut evaluations) {
            for part in piece.split(&at[i], beam.scale) {
                open.add(&at[i], i, *weight, part, &mut evaluations);
            }
        }
    }
    let (value, error) = open.settle(&at, [0.0, absolute / CELLS], &mut evaluations);
    let values = open.values(pairs.len()).into_iter().map(|value| CELLS * value).collect();
    // An estimate below what is asked may be luck: no more is claimed.
    let error = if value > 0.0 { (CELLS * error).max(absolute) } else { CELLS * error };
    (values, error + 4.0 * f64::EPSILON * CELLS * value)
}
