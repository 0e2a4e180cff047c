//! The direction matrix of a BRDF lobe: its projection onto pairs of direction
//! cells (§6.4).

use super::cells::{DirectionCell, cells};
use super::phong::{LobeSample, lobe};
use crate::grid::udc_fractions;
use rayon::prelude::*;
use std::sync::OnceLock;

/// A lobe of k_s = 1 between the direction cells of two levels, sparse.
///
/// Entry (r, s) is 4 Δκ Δλ × the mean of f over the cells r and s, each over its
/// part inside the UDC: the weight of incident cell s in reflected cell r.
/// It belongs to an exponent, not to a material's colours, nor to a tile.
/// Columns are computed when light first arrives from their cell.
///
/// A column's energy, Σ_r (entry) |r| / |s|, is the lobe's mean albedo over s by a
/// quadrature of its own, however narrow the lobe: where it is wide, samples of both
/// cells are averaged and the column is scaled to that albedo; where it is narrower
/// than a cell, its light is followed to the cells that it falls into. Reciprocity
/// f(s, r) = f(r, s) holds exactly for the function and here to 0.5 % in L² at level
/// 4; single entries at the rim are off by up to a tenth of the lobe's peak.
#[derive(Debug)]
pub struct LobeMatrix {
    exponent: f64,
    incident: (u8, Vec<DirectionCell>),
    outgoing: (u8, Vec<DirectionCell>),
    /// Of each outgoing cell, what is inside the UDC.
    fractions: Vec<f64>,
    sample: LobeSample,
    /// Albedo for light at cosθ = i / (len − 1).
    albedo: Vec<f64>,
    /// Per incident cell: reflected cells (κ fastest), increasing, and weights.
    columns: Vec<OnceLock<Vec<(u32, f32)>>>,
}

/// Weights below this fraction of the lobe's peak are left out: their sum over
/// all cells stays below single precision.
const NEGLIGIBLE: f64 = 1e-8;

/// Samples along a side of a cell from which on a lobe counts as narrow.
const MOST_POINTS: u32 = 8;

/// Entries of the table of albedos.
const ALBEDOS: u32 = 257;

impl LobeMatrix {
    /// The Phong lobe of exponent n = `exponent` ≥ 0 between direction cells of
    /// level `incident` and of level `outgoing`.
    #[must_use]
    pub fn phong(exponent: f64, incident: u8, outgoing: u8) -> Self {
        // The midpoint rule's error within a cell is (width² n)/24 for points
        // 1/√n wide: points a side until that is below 3·10⁻³, where it can be; and
        // a few at the rim, where even cosθ varies by 2·diameter and more in a cell.
        let points = |diameter: f64| {
            let density = (4.0 * exponent.sqrt()).max(12.0);
            (density * diameter).ceil().clamp(1.0, f64::from(2 * MOST_POINTS)) as u32
        };
        let cells = |level| (level, cells(level, points));
        let (incident, outgoing) = (cells(incident), cells(outgoing));
        let sample = LobeSample::new(exponent);
        let at = |i: u32| f64::from(i) / f64::from(ALBEDOS - 1);
        let albedo = (0..ALBEDOS).into_par_iter().map(|i| sample.albedo(at(i))).collect();
        let columns = incident.1.iter().map(|_| OnceLock::new()).collect();
        let fractions = udc_fractions(outgoing.0);
        Self { exponent, incident, outgoing, fractions, sample, albedo, columns }
    }

    /// Its exponent n.
    #[must_use]
    pub fn exponent(&self) -> f64 {
        self.exponent
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
        let columns: Vec<&Vec<(u32, f32)>> = lit.par_iter().map(|&s| self.column(s)).collect();
        let mut rows = vec![Vec::new(); self.outgoing.1.len()];
        for (i, column) in columns.iter().enumerate() {
            for &(r, weight) in *column {
                rows[r as usize].push((i as u32, weight));
            }
        }
        rows
    }

    /// The mean of f over the incident cell `s` and the reflected cell `r`.
    pub(super) fn mean(&self, s: usize, r: usize) -> f64 {
        let column = self.column(s);
        let found = column.binary_search_by_key(&(r as u32), |entry| entry.0);
        found.map_or(0.0, |at| f64::from(column[at].1) / self.incident.1[s].weight)
    }

    fn column(&self, s: usize) -> &Vec<(u32, f32)> {
        self.columns[s].get_or_init(|| {
            let from = &self.incident.1[s];
            if from.directions.is_empty() {
                Vec::new()
            } else if 4.0 * from.diameter * self.exponent.sqrt() > f64::from(MOST_POINTS) {
                self.narrow(from)
            } else {
                self.wide(from)
            }
        })
    }

    /// The midpoint rule on both cells, scaled to the albedo.
    fn wide(&self, from: &DirectionCell) -> Vec<(u32, f32)> {
        // The least cosine that counts: a sharp lobe meets few cells.
        let least = NEGLIGIBLE.powf(1.0 / self.exponent.max(1e-3));
        let to = self.outgoing.1.iter().enumerate().filter(|(_, r)| r.may_meet(from, least));
        let means: Vec<(u32, f64)> =
            to.map(|(i, r)| (i as u32, r.mean_lobe(from, self.exponent))).collect();
        let cell = self.outgoing.1[0].weight;
        let found: f64 = means.iter().map(|&(r, f)| f * cell * self.fractions[r as usize]).sum();
        let expected = from.mean(|cosine| self.albedo_at(cosine));
        let scale = if found > 0.0 { expected / found } else { 0.0 };
        let weights = means.into_iter().map(|(r, f)| (r, (from.weight * scale * f) as f32));
        weights.filter(|w| w.1 > 0.0).collect()
    }

    /// Where the light from each sample of the incident cell falls.
    fn narrow(&self, from: &DirectionCell) -> Vec<(u32, f32)> {
        let level = self.outgoing.0;
        let side = 1_usize << level;
        let cell = |mu: f64| ((0.5 * (mu + 1.0) * side as f64) as usize).min(side - 1);
        let mut shares = vec![0.0; self.outgoing.1.len()];
        for &s in &from.directions {
            self.sample.reflect(s, |v, share| shares[cell(v.y) << level | cell(v.x)] += share);
        }
        let count = from.directions.len() as f64;
        let outgoing = self.outgoing.1[0].weight;
        let weight = |(r, share): (usize, f64)| {
            let inside = outgoing * self.fractions[r];
            let mean = if inside > 0.0 { share / (count * inside) } else { 0.0 };
            (r as u32, (from.weight * mean) as f32)
        };
        let lit = shares.into_iter().enumerate().filter(|s| s.1 > 0.0);
        lit.map(weight).filter(|w| w.1 > 0.0).collect()
    }

    fn albedo_at(&self, cosine: f64) -> f64 {
        let at = cosine.clamp(0.0, 1.0) * f64::from(ALBEDOS - 1);
        let low = (at as usize).min(self.albedo.len() - 2);
        let t = at - low as f64;
        (1.0 - t) * self.albedo[low] + t * self.albedo[low + 1]
    }
}

impl DirectionCell {
    /// Whether some pair of directions can have R·V ≥ `least`.
    fn may_meet(&self, incident: &Self, least: f64) -> bool {
        if self.directions.is_empty() {
            return false;
        }
        self.mirror_angle(incident).0 <= least.clamp(0.0, 1.0).acos()
    }

    /// The mean of the lobe over both cells.
    pub(super) fn mean_lobe(&self, incident: &Self, exponent: f64) -> f64 {
        let mut sum = 0.0;
        for v in &self.directions {
            for s in &incident.directions {
                sum += lobe(exponent, *s, *v);
            }
        }
        sum / (self.directions.len() * incident.directions.len()) as f64
    }
}
