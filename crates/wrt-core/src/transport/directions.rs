//! The directions of a cell as images of unit squares, rim and all.

use super::integrate::Strip;
use glam::{DVec2, DVec3};

/// Directions with μx between two bounds and μy between two others or the rim.
///
/// Mapped from the unit square by angles, μ = (sinθ, cosθ sinφ, cosθ cosφ), so that
/// radiance, which may jump at the rim and have a square root beside it, is smooth.
#[derive(Clone, Copy, Debug)]
pub(super) struct Region {
    theta: Strip,
    /// Bounds of μy.
    low: f64,
    high: f64,
}

impl Region {
    /// The regions that make up the part inside the UDC of the rectangle [low, high]
    /// of cosines (μx, μy).
    pub(super) fn of(low: DVec2, high: DVec2) -> Vec<Self> {
        if low.cmpge(high).any() {
            return Vec::new();
        }
        let [first, last] = [low.x, high.x].map(|x| x.clamp(-1.0, 1.0).asin());
        // Where a border in μy meets the rim, its angle φ turns with a square root.
        let meets =
            |y: f64| if y == 0.0 { [2.0; 2] } else { [1.0, -1.0].map(|s| s * y.abs().acos()) };
        let meetings = [low.y, high.y].map(meets).concat();
        let root = |theta: f64| meetings.contains(&theta);
        let mut cuts = meetings.clone();
        cuts.retain(|&theta| first < theta && theta < last);
        cuts.extend([first, last]);
        cuts.sort_unstable_by(f64::total_cmp);
        cuts.dedup();
        let nearest = 0.0_f64.clamp(low.y, high.y);
        cuts.windows(2)
            // Beyond where the nearest μy meets the rim there are no directions.
            .filter(|cut| (0.5 * (cut[0] + cut[1])).cos() > nearest.abs())
            .map(|cut| Self {
                theta: Strip::new([cut[0], cut[1]], [root(cut[0]), root(cut[1])]),
                low: low.y,
                high: high.y,
            })
            .collect()
    }

    /// The direction at (s, t) and dμx dμy / ds dt there; `None` where nothing is
    /// left of the square.
    pub(super) fn at(&self, s: f64, t: f64) -> Option<(DVec3, f64)> {
        let (theta, slope) = self.theta.at(s);
        let (sine, cosine) = theta.sin_cos();
        let [from, to] = [self.low, self.high].map(|y| (y / cosine).clamp(-1.0, 1.0).asin());
        let (sin_phi, cos_phi) = (from + t * (to - from)).sin_cos();
        let mu = DVec3::new(sine, cosine * sin_phi, cosine * cos_phi);
        let measure = slope * (to - from) * cosine * cosine * cos_phi;
        (mu.z > 0.0 && measure > 0.0).then_some((mu, measure))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::udc_fraction;

    /// The measure integrates to the closed-form area, for cells inside, across and
    /// beyond the rim.
    #[test]
    fn a_cell_s_measure_is_its_part_of_the_disc() {
        let side = 8_u32;
        for i in 0..side * side {
            let at = |i: u32| f64::from(i) / f64::from(side);
            let (low, high) = ([at(i % side), at(i / side)], [at(i % side + 1), at(i / side + 1)]);
            let cosine = |q: [f64; 2]| 2.0 * DVec2::from(q) - 1.0;
            let area = (cosine(high) - cosine(low)).element_product();
            let expected = udc_fraction(low, high) * area;
            let n = 20;
            let mut sum = 0.0;
            for region in Region::of(cosine(low), cosine(high)) {
                for i in 0..n * n {
                    let at = |i: i32| (f64::from(i) + 0.5) / f64::from(n);
                    let point = region.at(at(i % n), at(i / n));
                    sum += point.map_or(0.0, |(_, measure)| measure) / f64::from(n * n);
                }
            }
            assert!((sum - expected).abs() < 1e-3 * area, "cell {i}: {sum} {expected}");
        }
    }
}
