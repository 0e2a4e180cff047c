//! ꟻLIP: how different two pictures look to who flips between them.
//!
//! P. Andersson, J. Nilsson, T. Akenine-Möller, M. Oskarsson, K. Åström & M. D.
//! Fairchild, *FLIP: A Difference Evaluator for Alternating Images*, Proc. ACM
//! Comput. Graph. Interact. Tech. 3(2), 2020, for pictures of low dynamic range.
//! Names of constants are the paper's.

use glam::{Mat3, Vec3};
use std::f32::consts::PI;

/// Pixels a degree of the visual angle that the paper assumes: a screen 0.7 m wide
/// of 3840 pixels, seen from 0.7 m.
pub(crate) const PIXELS_PER_DEGREE: f32 = 0.7 * 3840.0 / 0.7 * PI / 180.0;

/// Linear Rec. 709 to CIE XYZ, by the primaries' chromaticities and D65.
const XYZ: Mat3 = Mat3::from_cols_array(&[
    0.412_386_56,
    0.212_636_82,
    0.019_330_62,
    0.357_591_5,
    0.715_183,
    0.119_197_17,
    0.180_450_49,
    0.072_180_2,
    0.950_372_6,
]);

/// Exponent of colour differences.
const Q_C: f32 = 0.7;
/// Share of the greatest colour difference that maps to [`P_T`].
const P_C: f32 = 0.4;
const P_T: f32 = 0.95;
/// Exponent of feature differences.
const Q_F: f32 = 0.5;
/// Width of the feature detectors, degrees.
const W: f32 = 0.082;

/// A field of one value a pixel, rows from the top.
struct Plane {
    width: usize,
    values: Vec<f32>,
}

/// Weights of neighbours −radius to radius.
type Kernel = Vec<f32>;

/// The difference, 0 to 1, of each pixel of two pictures of linear display colours
/// in [0, 1], `width` pixels a row, at so many pixels a degree.
pub(crate) fn flip(test: &[Vec3], reference: &[Vec3], width: usize, density: f32) -> Vec<f32> {
    let colours = [test, reference].map(|picture| perceived(picture, width, density));
    let features = [test, reference].map(|picture| features(picture, width, density));
    let most = hyab(hunt(lab(Vec3::Y)), hunt(lab(Vec3::Z))).powf(Q_C);
    let of_pixel = |i: usize| {
        let colour = hyab(colours[0][i], colours[1][i]).powf(Q_C);
        let knee = P_C * most;
        let colour = if colour < knee {
            colour * P_T / knee
        } else {
            P_T + (colour - knee) / (most - knee) * (1.0 - P_T)
        };
        let [test, reference] = [&features[0], &features[1]];
        let feature = (0..2).map(|k| (test[k][i] - reference[k][i]).abs()).fold(0.0, f32::max);
        let feature = (feature / 2.0_f32.sqrt()).powf(Q_F);
        colour.powf(1.0 - feature)
    };
    (0..reference.len()).map(of_pixel).collect()
}

/// What the eye makes of the colours: blurred by its contrast sensitivity, in
/// Hunt-adjusted CIELAB.
fn perceived(picture: &[Vec3], width: usize, density: f32) -> Vec<Vec3> {
    /// a₁, b₁, a₂, b₂ of luminance, red–green and blue–yellow.
    const SENSITIVITY: [[f32; 4]; 3] =
        [[1.0, 0.0047, 0.0, 1e-5], [1.0, 0.0053, 0.0, 1e-5], [34.1, 0.04, 13.5, 0.025]];
    let opponent: Vec<Vec3> = picture.iter().map(|&c| to_opponent(c)).collect();
    // All as wide as the widest of them needs.
    let radius = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * density).ceil() as i32;
    let blurred = [0, 1, 2].map(|channel| {
        let plane = Plane { width, values: opponent.iter().map(|c| c[channel]).collect() };
        let [a1, b1, a2, b2] = SENSITIVITY[channel];
        let terms = [(a1, b1), (a2, b2)].map(|(a, b)| {
            let gauss = |i: i32| (-(PI * i as f32 / density).powi(2) / b).exp();
            let kernel: Kernel = (-radius..=radius).map(gauss).collect();
            let sum: f32 = kernel.iter().sum();
            (a * (PI / b).sqrt(), sum * sum, kernel)
        });
        let total: f32 = terms.iter().map(|(peak, volume, _)| peak * volume).sum();
        let mut values = vec![0.0; plane.values.len()];
        for (peak, _, kernel) in terms.iter().filter(|term| term.0 > 0.0) {
            let part = plane.filtered(kernel, kernel);
            values.iter_mut().zip(part).for_each(|(sum, x)| *sum += x * peak / total);
        }
        values
    });
    let colour = |i: usize| from_opponent(Vec3::from_array([0, 1, 2].map(|c| blurred[c][i])));
    (0..picture.len()).map(|i| hunt(lab(colour(i).clamp(Vec3::ZERO, Vec3::ONE)))).collect()
}

/// How much of an edge, and of a point, each pixel is.
fn features(picture: &[Vec3], width: usize, density: f32) -> [Vec<f32>; 2] {
    let deviation = 0.5 * W * density;
    let radius = (3.0 * deviation).ceil() as i32;
    let achromatic = picture.iter().map(|&c| (to_opponent(c).x + 16.0) / 116.0);
    let plane = Plane { width, values: achromatic.collect() };
    let gauss = |i: i32| (-0.5 * (i as f32 / deviation).powi(2)).exp();
    let across: Kernel = (-radius..=radius).map(gauss).collect();
    let across_sum: f32 = across.iter().sum();
    let first = |i: i32| -(i as f32) * gauss(i);
    let second = |i: i32| ((i as f32 / deviation).powi(2) - 1.0) * gauss(i);
    [&first as &dyn Fn(i32) -> f32, &second].map(|derivative| {
        let along: Kernel = (-radius..=radius).map(derivative).collect();
        // Positive weights sum to 1 and negative ones to −1.
        let sum = |sign: f32| along.iter().map(|x| (sign * x).max(0.0)).sum::<f32>() * across_sum;
        let [up, down] = [sum(1.0), sum(-1.0)];
        let along: Kernel = along.iter().map(|x| x / if *x > 0.0 { up } else { down }).collect();
        let [x, y] = [plane.filtered(&along, &across), plane.filtered(&across, &along)];
        x.into_iter().zip(y).map(|(x, y)| x.hypot(y)).collect()
    })
}

impl Plane {
    /// Filtered along rows and then along columns; the border repeats.
    fn filtered(&self, rows: &[f32], columns: &[f32]) -> Vec<f32> {
        let (width, height) = (self.width, self.values.len() / self.width);
        let at = |i: usize, k: usize, radius: usize, end: usize| {
            (i + k).saturating_sub(radius).min(end - 1)
        };
        let mut middle = vec![0.0; self.values.len()];
        for (row, out) in self.values.chunks_exact(width).zip(middle.chunks_exact_mut(width)) {
            for (x, out) in out.iter_mut().enumerate() {
                let weighed = rows.iter().enumerate();
                *out = weighed.map(|(k, w)| w * row[at(x, k, rows.len() / 2, width)]).sum();
            }
        }
        let mut result = vec![0.0; self.values.len()];
        for (y, out) in result.chunks_exact_mut(width).enumerate() {
            for (k, w) in columns.iter().enumerate() {
                let row = at(y, k, columns.len() / 2, height) * width;
                let row = &middle[row..row + width];
                out.iter_mut().zip(row).for_each(|(out, x)| *out += w * x);
            }
        }
        result
    }
}

fn white() -> Vec3 {
    XYZ * Vec3::ONE
}

/// Linear colour to Y C_x C_z.
fn to_opponent(colour: Vec3) -> Vec3 {
    let n = XYZ * colour / white();
    Vec3::new(116.0 * n.y - 16.0, 500.0 * (n.x - n.y), 200.0 * (n.y - n.z))
}

fn from_opponent(colour: Vec3) -> Vec3 {
    let y = (colour.x + 16.0) / 116.0;
    let n = Vec3::new(y + colour.y / 500.0, y, y - colour.z / 200.0);
    XYZ.inverse() * (n * white())
}

/// Linear colour to CIELAB.
fn lab(colour: Vec3) -> Vec3 {
    const DELTA: f32 = 6.0 / 29.0;
    let [x, y, z] = (XYZ * colour / white())
        .to_array()
        .map(|t| if t > DELTA.powi(3) { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 });
    Vec3::new(116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z))
}

/// Colours lose their strength in the dark.
fn hunt(lab: Vec3) -> Vec3 {
    Vec3::new(lab.x, 0.01 * lab.x * lab.y, 0.01 * lab.x * lab.z)
}

/// Distance for large differences: city-block in lightness, Euclidean in chroma.
fn hyab(a: Vec3, b: Vec3) -> f32 {
    let d = a - b;
    d.x.abs() + d.y.hypot(d.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::srgb_to_linear;

    fn mean(map: &[f32]) -> f32 {
        map.iter().sum::<f32>() / map.len() as f32
    }

    /// 48 × 32 sRGB colours that wave, with a square and a dot.
    fn picture(shift: f32) -> Vec<Vec3> {
        let colour = |i: usize| {
            let (x, y) = ((i % 48) as f32, (i / 48) as f32);
            let wave = |f: f32, p: f32| 0.5 + 0.45 * (f * x + 0.13 * y + p + shift).sin();
            let inside = (20.0..30.0).contains(&(x + 8.0 * shift)) && (8.0..20.0).contains(&y);
            let dot = x == 40.0 && y == 24.0 && shift > 0.0;
            let c = if inside {
                [0.9, 0.2, 0.1]
            } else {
                [wave(0.2, 0.0), wave(0.31, 1.0), wave(0.17, 2.0)]
            };
            Vec3::from_array(if dot { [1.0; 3] } else { c }.map(srgb_to_linear))
        };
        (0..48 * 32).map(colour).collect()
    }

    #[test]
    fn equal_pictures_do_not_differ_and_black_from_white_differs_most() {
        let (a, b) = (picture(0.0), picture(0.5));
        assert_eq!(flip(&a, &a, 48, PIXELS_PER_DEGREE), vec![0.0; a.len()]);
        let there = flip(&a, &b, 48, PIXELS_PER_DEGREE);
        assert_eq!(there, flip(&b, &a, 48, PIXELS_PER_DEGREE), "it is symmetric");
        assert!(there.iter().all(|x| (0.0..=1.0).contains(x)), "{there:?}");
        let [black, white] = [Vec3::ZERO, Vec3::ONE].map(|c| vec![c; 400]);
        let most = mean(&flip(&black, &white, 20, PIXELS_PER_DEGREE));
        assert!((0.95..1.0).contains(&most), "{most}");
    }

    /// The authors' program (flip-evaluator 1.7) of the same pictures, as floats.
    #[test]
    fn the_mean_and_the_map_are_those_of_the_authors_program() {
        for (shift, expected, at) in AUTHORS {
            let map = flip(&picture(shift), &picture(0.0), 48, PIXELS_PER_DEGREE);
            let found = mean(&map);
            assert!((found - expected).abs() < 2e-4 * expected, "mean {found}, not {expected}");
            for (i, expected) in at {
                assert!((map[i] - expected).abs() < 1e-3, "{i}: {}, not {expected}", map[i]);
            }
        }
    }

    /// A pixel's number and value.
    type Pixel = (usize, f32);

    /// Shift, mean, and values of some pixels.
    const AUTHORS: [(f32, f32, [Pixel; 3]); 2] = [
        (0.02, 0.071_856_49, [(1192, 0.666_372_5), (500, 0.051_236_02), (0, 0.074_770_7)]),
        (0.5, 0.652_746, [(1192, 0.847_063), (500, 0.817_441_6), (0, 0.676_339_6)]),
    ];
}
