//! The direction matrix of a BRDF lobe: its projection onto pairs of direction
//! cells (§6.4).

use super::phong::lobe;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::sync::OnceLock;

/// A lobe of k_s = 1 between the direction cells of two levels, sparse.
///
/// Entry (r, s) is 4 Δκ Δλ × the mean of f over the cells r and s, each over its
/// part inside the UDC: the weight of incident cell s in reflected cell r.
/// It belongs to an exponent, not to a material's colours, nor to a tile.
/// Columns are computed when light first arrives from their cell.
#[derive(Debug)]
pub struct LobeMatrix {
    exponent: f64,
    incident: (u8, Vec<DirectionCell>),
    outgoing: (u8, Vec<DirectionCell>),
    /// Per incident cell: reflected cells (κ fastest), increasing, and weights.
    columns: Vec<OnceLock<Vec<(u32, f32)>>>,
}

/// Weights below this fraction of the lobe's peak are left out: their sum over
/// all cells stays below single precision.
const NEGLIGIBLE: f64 = 1e-8;

impl LobeMatrix {
    /// The Phong lobe of exponent n = `exponent` between direction cells of level
    /// `incident` and of level `outgoing`.
    #[must_use]
    pub fn phong(exponent: f64, incident: u8, outgoing: u8) -> Self {
        // The midpoint rule's error within a cell is (width² n)/24 for points
        // 1/√n wide: points a side until that is below 3·10⁻³, where it can be.
        let points = |level: u8| {
            let width = 2.0 / f64::from(1_u32 << level);
            (4.0 * width * exponent.max(1.0).sqrt()).ceil().clamp(1.0, 8.0) as u32
        };
        let cells = |level| (level, cells(level, points(level)));
        let (incident, outgoing) = (cells(incident), cells(outgoing));
        let columns = incident.1.iter().map(|_| OnceLock::new()).collect();
        Self { exponent, incident, outgoing, columns }
    }

    /// The level of the incident direction cells.
    #[must_use]
    pub fn incident_level(&self) -> u8 {
        self.incident.0
    }

    /// The level of the reflected direction cells.
    #[must_use]
    pub fn outgoing_level(&self) -> u8 {
        self.outgoing.0
    }

    /// Per reflected cell: those incident cells among `lit` (increasing) that it
    /// takes light from, as positions in `lit`, and their weights.
    #[must_use]
    pub fn rows(&self, lit: &[usize]) -> Vec<Vec<(u32, f32)>> {
        let columns: Vec<&Vec<(u32, f32)>> =
            lit.par_iter().map(|&s| self.columns[s].get_or_init(|| self.column(s))).collect();
        let mut rows = vec![Vec::new(); self.outgoing.1.len()];
        for (i, column) in columns.iter().enumerate() {
            for &(r, weight) in *column {
                rows[r as usize].push((i as u32, weight));
            }
        }
        rows
    }

    fn column(&self, s: usize) -> Vec<(u32, f32)> {
        let from = &self.incident.1[s];
        // The least cosine that counts: a sharp lobe meets few cells.
        let least = NEGLIGIBLE.powf(1.0 / self.exponent.max(1e-3));
        let to = self.outgoing.1.iter().enumerate().filter(|(_, r)| r.may_meet(from, least));
        to.filter_map(|(i, r)| {
            let weight = (from.weight * r.mean_lobe(from, self.exponent)) as f32;
            (weight > 0.0).then_some((i as u32, weight))
        })
        .collect()
    }
}

/// A direction cell as sample directions inside the UDC.
#[derive(Debug)]
struct DirectionCell {
    directions: Vec<DVec3>,
    /// A direction within the cell and the greatest angle to any of the others.
    centre: DVec3,
    radius: f64,
    /// 4 Δκ Δλ.
    weight: f64,
}

/// The cells of a level, κ fastest, with `points`² samples in each.
fn cells(level: u8, points: u32) -> Vec<DirectionCell> {
    let side = 1_u32 << level;
    let width = 2.0 / f64::from(side);
    let cell = |k: u32, l: u32| {
        let low = DVec2::new(f64::from(k), f64::from(l)) * width - 1.0;
        let at = |i: u32| (f64::from(i) + 0.5) * width / f64::from(points);
        let directions: Vec<DVec3> = (0..points * points)
            .map(|i| low + DVec2::new(at(i % points), at(i / points)))
            .filter(|mu| mu.length_squared() < 1.0)
            .map(|mu| mu.extend((1.0 - mu.length_squared()).sqrt()))
            .collect();
        // A rim cell whose samples all miss still needs one: its innermost point.
        let directions = if directions.is_empty() {
            let inner = DVec2::ZERO.clamp(low, low + width);
            if inner.length_squared() < 1.0 {
                vec![inner.extend((1.0 - inner.length_squared()).sqrt())]
            } else {
                directions
            }
        } else {
            directions
        };
        let centre = directions.iter().sum::<DVec3>().normalize_or_zero();
        let radius = directions.iter().map(|d| d.angle_between(centre)).fold(0.0, f64::max);
        DirectionCell { directions, centre, radius, weight: width * width }
    };
    (0..side).flat_map(|l| (0..side).map(move |k| (k, l))).map(|(k, l)| cell(k, l)).collect()
}

impl DirectionCell {
    /// Whether some pair of directions can have R·V ≥ `least`.
    fn may_meet(&self, incident: &Self, least: f64) -> bool {
        if self.directions.is_empty() || incident.directions.is_empty() {
            return false;
        }
        let mirrored = DVec3::new(-incident.centre.x, -incident.centre.y, incident.centre.z);
        let angle = mirrored.angle_between(self.centre) - self.radius - incident.radius;
        angle <= least.clamp(0.0, 1.0).acos()
    }

    /// The mean of the lobe over both cells.
    fn mean_lobe(&self, incident: &Self, exponent: f64) -> f64 {
        let mut sum = 0.0;
        for v in &self.directions {
            for s in &incident.directions {
                sum += lobe(exponent, *s, *v);
            }
        }
        sum / (self.directions.len() * incident.directions.len()) as f64
    }
}
