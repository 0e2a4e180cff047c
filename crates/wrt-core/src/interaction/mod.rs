//! Surface interaction: incident radiance to reflected radiance (§6.4).

mod brdf;
mod cells;
mod interface;
mod operator;
mod phong;
mod product;
mod tabulated;

pub use brdf::BrdfTree;
pub use interface::{Interface, mirrored};
pub use operator::LobeMatrix;
pub use phong::{Phong, phong_lobe};
pub use tabulated::{Bsdf, Patches, Ring, disc_of_square, square_of_disc};

use crate::Levels;
use crate::grid::{Grid, Rgb, udc_fractions};
use rayon::prelude::*;

/// The radiance that a Phong surface reflects of `incident` (Eq. 22), zero
/// outside the UDC; at each position a matrix product in direction alone.
///
/// The diffuse part is of rank one, k_d E/π; `lobe` is the matrix of the
/// material's exponent and gives the direction levels of both sides. Without a
/// lobe the result has the incident levels.
///
/// Incident cells hold their mean with the zeros outside the UDC, so only L
/// vanishes there and f does not: together they would lose the rim's light.
///
/// # Panics
///
/// If the matrix's incident level is not `incident`'s.
#[must_use]
pub fn reflect(incident: &Grid, phong: &Phong, lobe: Option<&LobeMatrix>) -> Grid {
    let level = lobe.map_or(incident.levels().direction, LobeMatrix::outgoing_level);
    if let Some(lobe) = lobe {
        let (found, needed) = (incident.levels().direction, lobe.incident_level());
        assert_eq!(found, needed, "the lobe's incident level is the light's");
    }
    let levels = Levels { position: incident.levels().position, direction: level };
    let diffuse: Vec<[f64; 3]> = incident
        .irradiance()
        .iter()
        .map(|e| std::array::from_fn(|c| e[c] * phong.kd[c] * std::f64::consts::FRAC_1_PI))
        .collect();
    let lit: Vec<usize> =
        (0..incident.levels().directions()).filter(|&s| incident.slice(s).is_some()).collect();
    let light = |&s: &usize| -> Vec<f32> {
        let (image, scale) = incident.slice(s).unwrap_or_default();
        incident.images()[image].iter().flatten().map(|x| x * scale).collect()
    };
    let rows = lobe.map(|lobe| lobe.rows(&lit));
    let light: Vec<Vec<f32>> =
        if rows.is_some() { lit.iter().map(light).collect() } else { vec![] };
    let image = |(r, fraction): (usize, f64)| -> Option<Vec<Rgb>> {
        if fraction == 0.0 {
            return None;
        }
        let mut specular = vec![0.0_f32; 3 * levels.positions()];
        for &(s, weight) in rows.as_ref().map_or(&[][..], |rows| &rows[r]) {
            for (sum, light) in specular.iter_mut().zip(&light[s as usize]) {
                *sum += weight * light;
            }
        }
        let sum = diffuse.iter().zip(specular.chunks_exact(3)).map(|(d, s)| {
            std::array::from_fn(|c| (fraction * (d[c] + phong.ks[c] * f64::from(s[c]))) as f32)
        });
        let image: Vec<Rgb> = sum.collect();
        image.iter().any(|rgb| *rgb != [0.0; 3]).then_some(image)
    };
    let images = udc_fractions(level).into_par_iter().enumerate().map(image).collect();
    Grid::from_images(levels, images)
}

#[cfg(test)]
mod numerics;

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// Radiance 1 from everywhere, at one position.
    fn furnace(direction: u8) -> Grid {
        let lobe: Vec<f32> = udc_fractions(direction).iter().map(|&f| f as f32).collect();
        Grid::separable(Levels { position: 0, direction }, vec![[1.0; 3]], &lobe)
    }

    fn flux(grid: &Grid) -> f64 {
        grid.irradiance()[0][0]
    }

    #[test]
    fn a_white_diffuse_furnace_keeps_its_radiance() {
        let white = Phong { kd: [1.0; 3], ks: [0.0; 3], exponent: 0.0 };
        let out = reflect(&furnace(5), &white, None);
        for (r, fraction) in udc_fractions(5).into_iter().enumerate() {
            let radiance = out.slice(r).map_or(0.0, |(i, s)| out.images()[i][0][0] * s);
            assert!((f64::from(radiance) - fraction).abs() < 1e-6, "cell {r}: {radiance}");
        }
        assert!((flux(&out) - PI).abs() < 1e-5, "{}", flux(&out));
    }

    /// The lobe's mean albedo under uniform light, (1/π) ∫∫ f cosθ_s cosθ_r dω dω,
    /// by a midpoint rule in cos²θ_s, cos²θ_r and φ.
    fn mean_albedo(exponent: f64, steps: u32) -> f64 {
        let at = |i: u32| (f64::from(i) + 0.5) / f64::from(steps);
        let direction = |cos2: f64, phi: f64| {
            let (sine, cosine) = ((1.0 - cos2).sqrt(), cos2.sqrt());
            glam::DVec3::new(sine * phi.cos(), sine * phi.sin(), cosine)
        };
        let mut sum = 0.0;
        for s in 0..steps {
            for r in 0..steps {
                for phi in 0..steps {
                    let eye = direction(at(r), PI * at(phi));
                    sum += phong::lobe(exponent, direction(at(s), 0.0), eye);
                }
            }
        }
        // cosθ dω = ½ dcos²θ dφ over 2π, twice, over π.
        sum * PI / f64::from(steps).powi(3)
    }

    #[test]
    fn a_glossy_furnace_reflects_the_lobe_s_albedo_and_no_more() {
        for exponent in [1.0, 8.0, 40.0] {
            let matrix = LobeMatrix::phong(exponent, 5, 5);
            let glossy = Phong { kd: [0.0; 3], ks: [1.0; 3], exponent };
            let albedo = flux(&reflect(&furnace(5), &glossy, Some(&matrix))) / PI;
            let expected = mean_albedo(exponent, 160);
            assert!((albedo / expected - 1.0).abs() < 3e-3, "n = {exponent}: {albedo} {expected}");
            assert!(albedo < 1.0, "n = {exponent}: {albedo}");
        }
    }

    /// Light from one cell against Eq. 1 integrated directly.
    #[test]
    fn one_lit_cell_reflects_as_eq_1_says() {
        let (incident, outgoing) = (4, 4);
        let phong = Phong { kd: [0.3; 3], ks: [0.5; 3], exponent: 12.0 };
        let levels = Levels { position: 0, direction: incident };
        let (k, l) = (11_u32, 6_u32);
        let mut images = vec![None; levels.directions()];
        images[(l << 4 | k) as usize] = Some(vec![[2.0; 3]]);
        let light = Grid::from_images(levels, images);
        let matrix = LobeMatrix::phong(phong.exponent, incident, outgoing);
        let out = reflect(&light, &phong, Some(&matrix));
        // Both cells by a 12² midpoint rule.
        const N: u32 = 12;
        let sample =
            |cell: u32, i: u32| (f64::from(cell) + (f64::from(i) + 0.5) / f64::from(N)) / 8.0 - 1.0;
        let directions = |k: u32, l: u32| {
            (0..N * N).map(move |i| {
                let mu = glam::DVec2::new(sample(k, i % N), sample(l, i / N));
                mu.extend((1.0 - mu.length_squared()).sqrt())
            })
        };
        for (rk, rl) in [(4, 9), (5, 8), (8, 8), (2, 7)] {
            let mean: f64 = directions(rk, rl)
                .map(|v| directions(k, l).map(|s| phong.eval(s, v)[0]).sum::<f64>())
                .sum::<f64>()
                / f64::from(N.pow(4));
            let expected = 2.0 * mean * 4.0 / 256.0;
            let found = f64::from(out.mean([0, 0, rk as usize, rl as usize])[0]);
            assert!((found / expected - 1.0).abs() < 2e-2, "({rk}, {rl}): {found} {expected}");
        }
    }
}
