//! An emitter to be sampled: points in proportion to what they send.

use glam::{DVec2, DVec3};
use std::f64::consts::PI;
use wrt_core::{Emission, Frame, Polygon};

/// Cells along a side of the table of densities, at most: 2⁸, whose half
/// megabyte stays in a core's cache. Within a cell density is uniform; what a
/// sample sees is the picture itself.
const FINEST_TABLE: u8 = 8;

/// A polygon that shines, and the distribution of points on it.
#[derive(Debug)]
pub(super) struct Light {
    frame: Frame,
    size: DVec2,
    emission: Emission,
    level: u8,
    /// Cumulative probabilities of the rows, from above 0 to 1.
    rows: Vec<f64>,
    /// Cumulative probabilities of the cells of each row.
    cells: Vec<f64>,
    /// Area times mean radiance over the three channels, up to the lobe: W sr⁻¹.
    power: f64,
}

/// Light on its way from a sampled point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arrival {
    /// Unit, towards the light.
    pub(super) direction: DVec3,
    pub(super) radiance: [f64; 3],
    /// Of this direction, were it sampled by this light: sr⁻¹.
    pub(super) density: f64,
}

impl Light {
    /// `None` if it is dark, or its chart not rectilinear.
    pub(super) fn new(polygon: &Polygon, emission: Emission) -> Option<Self> {
        let size = polygon.size()?;
        let level = emission.level().min(FINEST_TABLE);
        let (side, coarser) = (1_usize << level, emission.level() - level);
        let mut weights = vec![0.0; side * side];
        for (i, rgb) in emission.picture().iter().enumerate() {
            let (u, v) = (i & ((1 << emission.level()) - 1), i >> emission.level());
            let sum: f32 = rgb.iter().sum();
            weights[(v >> coarser) << level | u >> coarser] += f64::from(sum);
        }
        let total: f64 = weights.iter().sum();
        let texels = emission.picture().len() as f64;
        let rows = cumulative(weights.chunks_exact(side).map(|row| row.iter().sum()));
        let cells = weights.chunks_exact(side).flat_map(|row| cumulative(row.iter().copied()));
        (total > 0.0 && total.is_finite()).then(|| Self {
            frame: *polygon.frame(),
            size,
            level,
            rows,
            cells: cells.collect(),
            power: total / (3.0 * texels) * size.x * size.y,
            emission,
        })
    }

    /// About how much of its light reaches `at`: what lights are chosen by.
    pub(super) fn weight(&self, at: DVec3) -> f64 {
        let area = self.size.x * self.size.y;
        let path = at - self.frame.point(0.5 * self.size);
        let in_front = (at - self.frame.origin).dot(self.frame.n) > 0.0;
        if in_front { self.power / (path.length_squared() + area / PI) } else { 0.0 }
    }

    /// What arrives at `at` from the point that `u`, in (0, 1)², stands for;
    /// `None` if that is seen from behind.
    pub(super) fn sample(&self, u: [f64; 2], at: DVec3) -> Option<Arrival> {
        let side = self.rows.len();
        let (row, v) = invert(&self.rows, u[1]);
        let (column, u) = invert(&self.cells[row * side..(row + 1) * side], u[0]);
        let uv = DVec2::new(column as f64 + u, row as f64 + v) / side as f64;
        self.arrival(uv, self.frame.point(uv * self.size) - at)
    }

    /// What arrives at `at` from along the unit `direction`; `None` if nothing.
    pub(super) fn along(&self, direction: DVec3, at: DVec3) -> Option<Arrival> {
        let approach = self.frame.n.dot(direction);
        let distance = self.frame.n.dot(self.frame.origin - at) / approach;
        if approach >= 0.0 || !(distance > 0.0 && distance.is_finite()) {
            return None;
        }
        let path = direction * distance;
        let uv = self.frame.to_local(at + path - self.frame.origin).truncate() / self.size;
        let inside = uv.cmpge(DVec2::ZERO).all() && uv.cmplt(DVec2::ONE).all();
        if inside { self.arrival(uv, path) } else { None }
    }

    fn arrival(&self, uv: DVec2, path: DVec3) -> Option<Arrival> {
        let squared = path.length_squared();
        let direction = path / squared.sqrt();
        let cosine = -self.frame.n.dot(direction);
        if cosine <= 0.0 || !direction.is_finite() {
            return None;
        }
        let density = self.density(uv) * squared / cosine;
        let radiance = self.emission.eval(uv, self.frame.to_local(-direction));
        Some(Arrival { direction, radiance, density })
    }

    /// Of points, m⁻².
    fn density(&self, uv: DVec2) -> f64 {
        let side = 1_usize << self.level;
        let at = |x: f64| ((x * side as f64) as usize).min(side - 1);
        let (column, row) = (at(uv.x), at(uv.y));
        let share = |cumulative: &[f64], i: usize| {
            cumulative[i] - if i == 0 { 0.0 } else { cumulative[i - 1] }
        };
        let cells = &self.cells[row * side..(row + 1) * side];
        let chosen = share(&self.rows, row) * share(cells, column);
        chosen * (side * side) as f64 / (self.size.x * self.size.y)
    }
}

/// Running sums divided by the last: the distribution function of `weights`, or
/// ones if they are all zero.
pub(super) fn cumulative(weights: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut sums: Vec<f64> = weights
        .scan(0.0, |sum, weight| {
            *sum += weight;
            Some(*sum)
        })
        .collect();
    let total = sums.last().copied().unwrap_or(0.0);
    for sum in &mut sums {
        *sum = if total > 0.0 { *sum / total } else { 1.0 };
    }
    sums
}

/// Which interval of a distribution function holds `u`, and where in it, in
/// [0, 1): the inverse of the distribution function.
pub(super) fn invert(cumulative: &[f64], u: f64) -> (usize, f64) {
    let i = cumulative.partition_point(|&c| c <= u).min(cumulative.len() - 1);
    let low = if i == 0 { 0.0 } else { cumulative[i - 1] };
    let width = cumulative[i] - low;
    let within = if width > 0.0 { (u - low) / width } else { 0.5 };
    (i, within.clamp(0.0, 1.0 - f64::EPSILON))
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrt_core::{Lobe, sobol};

    fn light(picture: Vec<[f32; 3]>) -> Light {
        let polygon = Polygon::rectangle(DVec3::ZERO, DVec3::X * 2.0, DVec3::Y).expect("2 × 1");
        let level = picture.len().ilog2() / 2;
        let emission = Emission::new(level as u8, picture, Lobe::Lambertian);
        Light::new(&polygon, emission).expect("it shines")
    }

    #[test]
    fn points_are_as_dense_as_their_radiance() {
        let light = light([1.0, 3.0, 0.0, 4.0].map(|x| [x; 3]).to_vec());
        let counts = (0..4096).fold([0; 4], |mut counts, i| {
            let u = [0, 1].map(|d| sobol(i, d, 7));
            let arrival = light.sample(u, DVec3::new(1.0, 0.5, 1e9)).expect("in front");
            counts[arrival.radiance[0] as usize % 4] += 1;
            counts
        });
        // 4 mod 4 is 0, and the dark cell must have none of it.
        assert_eq!(counts, [2048, 512, 0, 1536]);
        assert!((light.power - 2.0 * 2.0).abs() < 1e-12, "{}", light.power);
    }

    #[test]
    fn sampled_and_met_points_agree_on_their_density() {
        let light = light((0..256_u32).map(|i| [((i * 37) % 11) as f32; 3]).collect());
        let at = DVec3::new(0.3, -0.4, 0.7);
        for i in 0..200 {
            let sampled = light.sample([0, 1].map(|d| sobol(i, d, 1)), at).expect("in front");
            let met = light.along(sampled.direction, at).expect("on the light");
            assert!((met.density / sampled.density - 1.0).abs() < 1e-9, "{met:?} {sampled:?}");
            assert_eq!(met.radiance, sampled.radiance, "point {i}");
        }
        assert!(light.along(DVec3::Z, at).is_none(), "away from it");
        assert!(light.sample([0.5; 2], -at).is_none(), "behind it");
    }

    #[test]
    fn a_distribution_without_weight_stays_in_range() {
        assert_eq!(cumulative([0.0, 0.0].into_iter()), [1.0, 1.0]);
        assert_eq!(invert(&[0.0, 0.0, 1.0], 0.0).0, 2, "empty intervals are passed over");
        assert_eq!(invert(&[0.5, 1.0], 1.0).0, 1);
    }
}
