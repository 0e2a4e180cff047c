//! The ideal mirror and the ideal refractor: resampling in Nusselt coordinates.
//!
//! Directions point away from the surface on both sides. A mirror takes (μx, μy) to
//! (−μx, −μy), a flip of (κ, λ) about (½, ½); refraction by Snell's law takes it to
//! −η₁/η₂ (μx, μy) on the other side, in the same tangent axes: a scaling.

use crate::grid::{Grid, Rgb};
use crate::{Cell, Levels, Tree, TreeBuilder, udc_fraction};
use rayon::prelude::*;

/// The radiance that an ideal mirror reflects, exact on coefficients: cells flip, and
/// with them the sign of each ψ of κ or λ.
#[must_use]
pub fn mirrored(incident: &Tree) -> Tree {
    let levels = incident.levels();
    let mut out = TreeBuilder::new(levels);
    out.add_root(incident.root().map(f64::from));
    for (node, cell) in incident.nodes().iter().zip(incident.cells()) {
        let last = ((1_u32 << u32::from(cell.depth.min(levels.direction))) - 1) as u16;
        let [u, v, kappa, lambda] = cell.m;
        let flipped = Cell { depth: cell.depth, m: [u, v, last - kappa, last - lambda] };
        let mut b = [[0.0; 3]; crate::CHILDREN];
        for (nu, b) in b.iter_mut().enumerate().skip(1) {
            let Some(at) = node.coefficient(nu) else { continue };
            let sign = if (nu & 0b1100).count_ones() == 1 { -1.0 } else { 1.0 };
            *b = incident.coefficients()[at].map(|x| sign * f64::from(x));
        }
        out.add_node(flipped, &b);
    }
    out.finish()
}

/// A smooth boundary between two clear media.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interface {
    /// Refractive index η₁ > 0 on the side that light comes from.
    pub eta_incident: f64,
    /// Refractive index η₂ > 0 behind it.
    pub eta_transmitted: f64,
}

impl Interface {
    /// Fresnel's reflectance of unpolarised light at an angle of this cosine to the
    /// normal; 1 past the critical angle.
    #[must_use]
    pub fn reflectance(&self, cosine: f64) -> f64 {
        let ratio = self.eta_incident / self.eta_transmitted;
        let sine2 = ratio * ratio * (1.0 - cosine * cosine);
        if sine2 >= 1.0 {
            return 1.0;
        }
        let (a, b) = (cosine, (1.0 - sine2).sqrt());
        let (n1, n2) = (self.eta_incident, self.eta_transmitted);
        let perpendicular = (n1 * a - n2 * b) / (n1 * a + n2 * b);
        let parallel = (n2 * a - n1 * b) / (n2 * a + n1 * b);
        0.5 * (perpendicular * perpendicular + parallel * parallel)
    }

    /// The radiance reflected: the flip, times the mean of Fresnel's reflectance over
    /// each cell's part inside the UDC.
    #[must_use]
    pub fn reflect(&self, incident: &Grid) -> Grid {
        self.pass(incident, |f| f)
    }

    /// The flip, times a function of Fresnel's reflectance, averaged over each cell.
    pub(crate) fn pass(&self, incident: &Grid, share: impl Fn(f64) -> f64 + Sync) -> Grid {
        let levels = incident.levels();
        let side = 1_usize << levels.direction;
        let image = |r: usize| -> Option<Vec<Rgb>> {
            let s = side * side - 1 - r;
            let (image, scale) = incident.slice(s)?;
            let step = 2.0 / side as f64;
            let low = [s % side, s / side].map(|m| m as f64 * step - 1.0);
            let high = low.map(|x| x + step);
            let mean = mean_inside(low, high, |cosine| share(self.reflectance(cosine)));
            let factor = scale * mean as f32;
            Some(incident.images()[image].iter().map(|rgb| rgb.map(|x| factor * x)).collect())
        };
        let images = (0..levels.directions()).into_par_iter().map(image).collect();
        Grid::from_images(levels, images)
    }

    /// The radiance that passes to the other side, per its own hemisphere in the same
    /// tangent axes: (η₂/η₁)² (1 − F) L at the scaled direction.
    ///
    /// Exact resampling: an outgoing cell gathers the incident cells that its image
    /// overlaps by their areas inside the UDC, so that without Fresnel's losses the
    /// flux of all that is not totally reflected is kept to rounding.
    #[must_use]
    pub fn transmit(&self, incident: &Grid) -> Grid {
        let levels = incident.levels();
        let lit: Vec<usize> =
            (0..levels.directions()).filter(|&s| incident.slice(s).is_some()).collect();
        let image = |r: usize| -> Option<Vec<Rgb>> {
            let mut sum: Option<Vec<Rgb>> = None;
            for (s, weight) in self.sources(levels, r) {
                if weight == 0.0 || lit.binary_search(&s).is_err() {
                    continue;
                }
                let (image, scale) = incident.slice(s)?;
                let sum = sum.get_or_insert_with(|| vec![[0.0; 3]; levels.positions()]);
                let factor = scale * weight as f32;
                for (sum, rgb) in sum.iter_mut().zip(&incident.images()[image]) {
                    *sum = std::array::from_fn(|c| sum[c] + factor * rgb[c]);
                }
            }
            sum
        };
        let images = (0..levels.directions()).into_par_iter().map(image).collect();
        Grid::from_images(levels, images)
    }

    /// The incident cells that outgoing cell `r` takes light from, and their weights.
    fn sources(&self, levels: Levels, r: usize) -> Vec<(usize, f64)> {
        let side = 1_usize << levels.direction;
        let step = 2.0 / side as f64;
        // μ_incident = −ratio μ_transmitted.
        let ratio = self.eta_transmitted / self.eta_incident;
        let overlaps = |m: usize| -> Vec<(usize, [f64; 2])> {
            let (low, high) = (m as f64 * step - 1.0, (m + 1) as f64 * step - 1.0);
            let (from, to) = (-ratio * high, -ratio * low);
            let index = |x: f64| ((x + 1.0) / step).floor().clamp(0.0, (side - 1) as f64) as usize;
            (index(from)..=index(to))
                .filter_map(|s| {
                    let cell = [s as f64 * step - 1.0, (s + 1) as f64 * step - 1.0];
                    let part = [from.max(cell[0]), to.min(cell[1])];
                    (part[0] < part[1]).then_some((s, part))
                })
                .collect()
        };
        let (kappa, lambda) = (overlaps(r % side), overlaps(r / side));
        let mut sources = Vec::new();
        for &(l, [y0, y1]) in &lambda {
            for &(k, [x0, x1]) in &kappa {
                // Inside the UDC of the transmitted side: else it is reflected totally.
                let scaled = |x: f64| 0.5 * (1.0 + x / ratio);
                let inside = udc_fraction([scaled(x0), scaled(y0)], [scaled(x1), scaled(y1)]);
                let area = (x1 - x0) * (y1 - y0) * inside / (ratio * ratio * step * step);
                let passed = mean_inside([x0, y0], [x1, y1], |c| 1.0 - self.reflectance(c));
                sources.push((l << levels.direction | k, ratio * ratio * area * passed));
            }
        }
        sources
    }
}

/// The mean of a function of cosθ over the part of a box of cosines (μx, μy) that
/// lies inside the UDC, by midpoints; 0 if none does.
fn mean_inside(low: [f64; 2], high: [f64; 2], value: impl Fn(f64) -> f64) -> f64 {
    const POINTS: usize = 8;
    let at = |d: usize, i: usize| low[d] + (high[d] - low[d]) * (i as f64 + 0.5) / POINTS as f64;
    let (mut sum, mut count) = (0.0, 0);
    for i in 0..POINTS * POINTS {
        let height = 1.0 - at(0, i % POINTS).powi(2) - at(1, i / POINTS).powi(2);
        if height > 0.0 {
            sum += value(height.sqrt());
            count += 1;
        }
    }
    if count == 0 { 0.0 } else { sum / f64::from(count) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Irradiance, grid::udc_fractions};
    use std::f64::consts::PI;

    /// Radiance 1 from everywhere.
    fn furnace(direction: u8) -> Grid {
        let lobe: Vec<f32> = udc_fractions(direction).iter().map(|&f| f as f32).collect();
        Grid::separable(Levels { position: 0, direction }, vec![[1.0; 3]], &lobe)
    }

    /// Unequal cells within a radius of μ.
    fn spots(direction: u8, radius: f64) -> Grid {
        let levels = Levels { position: 1, direction };
        let side = 1_usize << direction;
        let at = |m: usize| 2.0 * (m as f64 + 0.5) / side as f64 - 1.0;
        let image = |d: usize| {
            let (k, l) = (d % side, d / side);
            let inside = at(k).hypot(at(l)) + 2.0 / side as f64 <= radius;
            inside.then(|| vec![[((k * 5 + l * 3) % 7) as f32, 1.0, k as f32]; 4])
        };
        Grid::from_images(levels, (0..side * side).map(image).collect())
    }

    fn flux(grid: &Grid) -> f64 {
        grid.irradiance()[0][0]
    }

    /// Diffuse Fresnel reflectance from outside (J. W. T. Walsh, 1926).
    fn walsh(n: f64) -> f64 {
        let n2 = n * n;
        0.5 + (n - 1.0) * (3.0 * n + 1.0) / (6.0 * (n + 1.0).powi(2))
            + n2 * (n2 - 1.0).powi(2) / (n2 + 1.0).powi(3) * ((n - 1.0) / (n + 1.0)).ln()
            - 2.0 * n2 * n * (n2 + 2.0 * n - 1.0) / ((n2 + 1.0) * (n2 * n2 - 1.0))
            + 8.0 * n2 * n2 * (n2 * n2 + 1.0) * n.ln() / ((n2 + 1.0) * (n2 * n2 - 1.0).powi(2))
    }

    #[test]
    fn two_mirrors_make_the_identity() {
        let tree = TreeBuilder::from_grid(&spots(4, 1.0)).finish();
        let once = mirrored(&tree);
        assert_ne!(once, tree, "the light is on the other side");
        assert_eq!(mirrored(&once), tree);
        assert_eq!(Irradiance::of(&once), Irradiance::of(&tree), "nothing is lost");
        let (grid, flipped) = (tree.to_grid(), once.to_grid());
        for (k, l) in [(3, 4), (9, 12), (8, 2)] {
            let (a, b) = (grid.mean([1, 0, k, l]), flipped.mean([1, 0, 15 - k, 15 - l]));
            for c in 0..3 {
                assert!((a[c] - b[c]).abs() < 1e-5, "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn fresnel_flux_is_the_closed_form_from_either_side() {
        let light = furnace(6);
        for n in [1.33, 1.5, 2.4] {
            let outside = walsh(n);
            // By reciprocity, what enters is what leaves, less the (1/n²) that fits out.
            let inside = 1.0 - (1.0 - outside) / (n * n);
            for (from, to, expected) in [(1.0, n, outside), (n, 1.0, inside)] {
                let interface = Interface { eta_incident: from, eta_transmitted: to };
                let reflected = flux(&interface.reflect(&light)) / PI;
                let passed = flux(&interface.transmit(&light)) / PI;
                assert!(
                    (reflected - expected).abs() < 2e-3,
                    "{from} to {to}: {reflected} {expected}"
                );
                assert!((passed + expected - 1.0).abs() < 4e-3, "{from} to {to}: {passed}");
            }
        }
    }

    /// Within matched media nothing happens but the flip, exactly.
    #[test]
    fn equal_indices_only_turn_the_light_over() {
        let light = spots(4, 1.0);
        let nothing = Interface { eta_incident: 1.5, eta_transmitted: 1.5 };
        let out = nothing.transmit(&light);
        for d in 0..256_usize {
            let m = |d: usize| [0, 1, d % 16, d / 16];
            let (a, b) = (light.mean(m(d)), out.mean(m(255 - d)));
            for c in 0..3 {
                // A cell on the rim keeps what is inside.
                assert!(b[c] <= a[c] + 1e-5, "{d}: {a:?} {b:?}");
            }
        }
    }

    /// Without Fresnel's losses (η₁/η₂ near 1 has nearly none) flux is kept; radiance
    /// grows by (η₂/η₁)².
    #[test]
    fn refraction_keeps_the_flux_that_is_not_lost() {
        for (from, to) in [(1.0, 1.5), (1.5, 1.0), (1.0, 1.1)] {
            let interface = Interface { eta_incident: from, eta_transmitted: to };
            // Far inside the critical angle.
            let light = spots(6, 0.4);
            let out = interface.transmit(&light);
            let lost = flux(&interface.reflect(&light));
            let sum = flux(&out) + lost;
            assert!((sum / flux(&light) - 1.0).abs() < 1e-4, "{from} to {to}: {sum}");
        }
        let uniform = Interface { eta_incident: 1.0, eta_transmitted: 1.5 };
        let centre = uniform.transmit(&furnace(5)).mean([0, 0, 16, 16])[0];
        assert!((centre - 2.25 * 0.96).abs() < 1e-3, "radiance n² (1 − F): {centre}");
    }

    #[test]
    fn light_past_the_critical_angle_does_not_pass() {
        let interface = Interface { eta_incident: 1.5, eta_transmitted: 1.0 };
        let levels = Levels { position: 0, direction: 6 };
        let lit = |k: usize| {
            let images = (0..4096).map(|d| (d == 32 << 6 | k).then(|| vec![[1.0; 3]]));
            Grid::from_images(levels, images.collect())
        };
        // Critical at μ = 2/3: cell 53.3 of 64.
        assert!(flux(&interface.transmit(&lit(50))) > 0.0, "within");
        for k in [55, 60] {
            assert_eq!(flux(&interface.transmit(&lit(k))), 0.0, "past it");
            let share = flux(&interface.reflect(&lit(k))) / flux(&lit(k));
            assert!((share - 1.0).abs() < 1e-6, "reflected totally: {share}");
        }
        assert_eq!(interface.reflectance(0.0), 1.0);
    }
}
