//! What every reflection keeps: energy, reciprocity, its tolerance; from n = 0 to
//! lobes far narrower than a cell.

use super::*;
use crate::{BrdfTree, Keep, Tree, TreeBuilder};
use glam::DVec3;
use std::f64::consts::{FRAC_1_PI, PI, TAU};

const EXPONENTS: [f64; 6] = [0.0, 1.0, 8.0, 40.0, 400.0, 1e5];

fn all(level: u8) -> Vec<usize> {
    (0..1 << (2 * level)).collect()
}

/// Σ_r of each column: the share of a cell's light that the lobe reflects.
fn shares(lobe: &LobeMatrix) -> Vec<f64> {
    let fractions = udc_fractions(lobe.outgoing_level());
    let ratio = 4.0_f64.powi(i32::from(lobe.incident_level()) - i32::from(lobe.outgoing_level()));
    let mut shares = vec![0.0; 1 << (2 * lobe.incident_level())];
    for (r, row) in lobe.rows(&all(lobe.incident_level())).iter().enumerate() {
        for &(s, weight) in row {
            shares[s as usize] += f64::from(weight) * fractions[r] * ratio;
        }
    }
    shares
}

/// ∫ f cosθ dω about the mirror direction, by midpoints in cosⁿ⁺¹α and φ.
fn albedo(exponent: f64, cosine: f64) -> f64 {
    const N: u32 = 80;
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(N);
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let mut sum = 0.0;
    for i in 0..N {
        let alpha = at(i).powf((exponent + 1.0).recip());
        let across = (1.0 - alpha * alpha).max(0.0).sqrt();
        for j in 0..N {
            sum += (alpha * cosine + across * (TAU * at(j)).cos() * sine).max(0.0);
        }
    }
    (exponent + 2.0) / (exponent + 1.0) * sum / f64::from(N * N)
}

#[test]
fn no_cell_is_reflected_with_a_gain_and_each_with_its_albedo() {
    const STEPS: usize = 40;
    for exponent in EXPONENTS {
        let albedos: Vec<f64> =
            (0..=STEPS).map(|i| albedo(exponent, i as f64 / STEPS as f64)).collect();
        let table = |cosine: f64| {
            let at = cosine * STEPS as f64;
            let low = (at as usize).min(STEPS - 1);
            albedos[low] + (at - low as f64) * (albedos[low + 1] - albedos[low])
        };
        for (incident, outgoing) in [(4, 4), (3, 4)] {
            let side = 1_usize << incident;
            let lobe = LobeMatrix::phong(exponent, incident, outgoing);
            let shares = shares(&lobe);
            // Along a row from the middle to the rim, each cell by 10² midpoints.
            for k in side / 2..side {
                let at = |i: usize, m: usize| {
                    2.0 * (m as f64 + (i as f64 + 0.5) / 10.0) / side as f64 - 1.0
                };
                let cosines: Vec<f64> = (0..100)
                    .map(|i| 1.0 - at(i % 10, k).powi(2) - at(i / 10, side / 2).powi(2))
                    .filter(|&z2| z2 > 0.0)
                    .map(f64::sqrt)
                    .collect();
                let mean = cosines.iter().map(|&z| table(z)).sum::<f64>() / cosines.len() as f64;
                let share = shares[side / 2 * side + k];
                assert!(
                    (share - mean).abs() < 5e-3,
                    "n = {exponent}, {incident} to {outgoing}, column {k}: {share} of {mean}"
                );
            }
            let most = shares.iter().copied().fold(0.0, f64::max);
            // Single precision of a few thousand weights.
            assert!(most < 1.0 + 1e-6, "n = {exponent}, {incident} to {outgoing}: {most}");
        }
    }
}

/// Uniform light: (1/π) ∫ albedo cosθ dω; 2/3 for n → ∞, whose albedo is cosθ.
#[test]
fn a_white_furnace_keeps_the_lobe_s_mean_albedo_however_sharp() {
    for exponent in EXPONENTS {
        const N: u32 = 24;
        let cosine = |i: u32| ((f64::from(i) + 0.5) / f64::from(N)).sqrt();
        let expected = (0..N).map(|i| albedo(exponent, cosine(i))).sum::<f64>() / f64::from(N);
        for level in [3, 4] {
            let lobe = LobeMatrix::phong(exponent, level, level);
            let light: Vec<f32> = udc_fractions(level).iter().map(|&f| f as f32).collect();
            let levels = Levels { position: 0, direction: level };
            let light = Grid::separable(levels, vec![[1.0; 3]], &light);
            let glossy = Phong { kd: [0.0; 3], ks: [1.0; 3], exponent };
            let found = reflect(&light, &glossy, Some(&lobe)).irradiance()[0][0] / PI;
            assert!((found / expected - 1.0).abs() < 3e-3, "n = {exponent}: {found} {expected}");
        }
        if exponent >= 1e4 {
            assert!((expected - 2.0 / 3.0).abs() < 1e-3, "the limit of a mirror: {expected}");
        }
    }
}

/// f(s, r) = f(r, s): the matrices of equal levels are symmetric, in L² over both
/// discs.
#[test]
fn reflection_is_reciprocal() {
    for exponent in EXPONENTS {
        let rows = LobeMatrix::phong(exponent, 4, 4).rows(&all(4));
        let fractions = udc_fractions(4);
        let (mut asymmetry, mut size) = (0.0, 0.0);
        for r in 0..256 {
            for &(s, weight) in &rows[r] {
                let s = s as usize;
                let back = rows[s].iter().find(|e| e.0 as usize == r).map_or(0.0, |e| e.1);
                let inside = fractions[r] * fractions[s];
                asymmetry += inside * f64::from(weight - back).powi(2);
                size += inside * f64::from(weight).powi(2);
            }
        }
        let found = (asymmetry / size).sqrt();
        println!("n = {exponent}: asymmetric by {found:.1e}");
        assert!(found < 0.02, "n = {exponent}: {found}");
    }
}

/// Light of one bright cell and a dim rest, over a few positions.
fn light(level: u8) -> Grid {
    let levels = Levels { position: 2, direction: level };
    let side = 1_usize << level;
    let image = |d: usize| {
        let (k, l) = (d % side, d / side);
        let bright = (k, l) == (side * 3 / 4, side / 2);
        let dim = 0.05 * ((k * l) % 7) as f32;
        let value = move |x: usize| if bright { 10.0 + x as f32 } else { dim * (x % 5) as f32 };
        Some((0..16).map(|x| [value(x), 1.0, 0.5 * value(x)]).collect())
    };
    let fractions = udc_fractions(level);
    let inside = |d: usize| (fractions[d] > 1e-9).then(|| image(d)).flatten();
    Grid::from_images(levels, (0..side * side).map(inside).collect())
}

fn difference(a: &Grid, b: &Grid) -> f64 {
    let levels = b.levels();
    let (p, d) = (1 << levels.position, 1 << levels.direction);
    let cells = (0..levels.positions() * levels.directions())
        .map(|i| [i % p, i / p % p, i / (p * p) % d, i / (p * p * d)]);
    let squares = cells.flat_map(|m| {
        let (a, b) = (a.mean(m), b.mean(m));
        (0..3).map(move |c| f64::from(a[c] - b[c]).powi(2))
    });
    (squares.sum::<f64>() / (levels.positions() * levels.directions()) as f64).sqrt()
}

/// The product of coefficients against the matrix of cells, diffuse part and all.
#[test]
fn reflection_in_coefficients_is_reflection_in_cells() {
    for exponent in [1.0, 40.0, 1e4] {
        let phong = Phong { kd: [0.2, 0.3, 0.0], ks: [0.5, 0.1, 0.6], exponent };
        let lobe = LobeMatrix::phong(exponent, 4, 4);
        let light = light(4);
        let cells = reflect(&light, &phong, Some(&lobe));
        let norm = cells.norm_squared().sqrt();
        let incident = TreeBuilder::from_grid(&light).finish();
        for tolerance in [0.0, 1e-2] {
            let brdf = BrdfTree::phong(&phong, &lobe, tolerance);
            let found = difference(&brdf.reflect(&incident).to_grid(), &cells) / norm;
            // Single precision, or a few times the BRDF's own error for light as
            // narrow as this.
            let allowed = if tolerance == 0.0 { 1e-6 } else { 5.0 * tolerance };
            assert!(found < allowed, "n = {exponent}, tolerance {tolerance}: {found}");
        }
    }
}

/// ‖f − f̃‖ over both discs, as promised, and with fewer coefficients.
#[test]
fn a_brdf_is_projected_to_its_tolerance() {
    let norm_of = |a: &Grid, b: &Grid, level: usize| {
        let fractions = udc_fractions(level as u8);
        let side = 1 << level;
        let mut sums = [0.0; 2];
        for i in 0..side * side * side * side {
            let m = [i % side, i / side % side, i / (side * side) % side, i / (side * side * side)];
            let inside = fractions[m[1] * side + m[0]] * fractions[m[3] * side + m[2]];
            let (a, b) = (f64::from(a.mean(m)[0]), f64::from(b.mean(m)[0]));
            sums[0] += inside * (a - b).powi(2);
            sums[1] += inside * b * b;
        }
        (sums[0] / sums[1]).sqrt()
    };
    for exponent in [1.0, 40.0, 400.0] {
        let phong = Phong { kd: [0.3; 3], ks: [0.5; 3], exponent };
        let lobe = LobeMatrix::phong(exponent, 4, 4);
        let full = BrdfTree::phong(&phong, &lobe, 0.0);
        let reference = full.tree().to_grid();
        for tolerance in [1e-1, 1e-2, 1e-3] {
            let brdf = BrdfTree::phong(&phong, &lobe, tolerance);
            let error = norm_of(&brdf.tree().to_grid(), &reference, 4);
            assert!(error <= tolerance, "n = {exponent}: {error} of {tolerance}");
            assert!(brdf.tree().len() < full.tree().len(), "n = {exponent}, {tolerance}");
        }
    }
}

/// Without a lobe the BRDF is one coefficient, and the result k_d E / π.
#[test]
fn without_a_lobe_only_irradiance_counts() {
    for exponent in [0.0, 40.0, 1e5] {
        let phong = Phong { kd: [0.5, 0.25, 1.0], ks: [0.0; 3], exponent };
        let brdf = BrdfTree::phong(&phong, &LobeMatrix::phong(exponent, 3, 3), 0.0);
        assert_eq!(brdf.tree().len(), 1, "constant");
        let light = light(3);
        let out = brdf.reflect(&TreeBuilder::from_grid(&light).finish()).to_grid();
        for (x, e) in light.irradiance().iter().enumerate() {
            let found = out.mean([x % 4, x / 4, 4, 4]);
            for c in 0..3 {
                let expected = phong.kd[c] * e[c] * FRAC_1_PI;
                assert!((f64::from(found[c]) - expected).abs() < 1e-5 * expected, "{x} {c}");
            }
        }
    }
}

/// Thresholding leaves negative radiance beside bright cells. The flux is exact
/// all the same, so that what a look-up gains by taking 0 instead is what the
/// negative parts hold.
#[test]
fn negative_radiance_after_thresholding_is_below_its_tolerance() {
    let phong = Phong { kd: [0.1; 3], ks: [0.6; 3], exponent: 400.0 };
    let lobe = LobeMatrix::phong(400.0, 4, 4);
    let full = TreeBuilder::from_grid(&reflect(&light(4), &phong, Some(&lobe))).finish();
    let negative = |tree: &Tree| {
        let (mut below, mut all) = (0.0, 0.0);
        tree.visit_leaves(&mut |_, size, mean| {
            let volume = (size[0] * size[0] * size[1] * size[1]) as f64;
            below += volume * (-mean[0]).max(0.0);
            all += volume * mean[0];
        });
        below / all
    };
    assert!(negative(&full) < 1e-7, "rounding alone: {}", negative(&full));
    for tolerance in [2e-3, 2e-2] {
        let (small, _) = full.compressed(Keep::RelativeError(tolerance));
        let share = negative(&small);
        println!("tolerance {tolerance}: clamping at 0 would add {share:.1e} of the flux");
        assert_eq!(small.root(), full.root(), "the flux is the root's");
        // An L² error of ε in a mean of 1 is at most ε ‖L‖ / mean in L¹.
        let most = tolerance * full.norm_squared().sqrt() / f64::from(full.root()[0]);
        assert!(share < most, "{tolerance}: {share} of {most}");
    }
}

#[test]
fn the_sample_of_a_lobe_points_along_its_axis() {
    for exponent in EXPONENTS {
        let sample = phong::LobeSample::new(exponent);
        let (mut sum, mut mean) = (0.0, DVec3::ZERO);
        sample.reflect(DVec3::new(0.3, -0.1, 0.9_f64.sqrt()), |v, share| {
            sum += share;
            mean += share * v;
        });
        assert!(sum > 0.0 && sum <= 1.0 + 1e-12, "{sum}");
        let towards = mean.normalize();
        assert!(towards.x < 0.0 && towards.y > 0.0, "n = {exponent}: {towards}");
    }
}
