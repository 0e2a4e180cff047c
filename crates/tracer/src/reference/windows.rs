//! The radiance of patches by a sum over so many points of each emitter a pixel, in
//! single precision and eight points at a time: the least code that one would write
//! instead of baking.

use super::receivers_of;
use crate::bake;
use crate::scene::Scene;
use crate::whitted::{PatchRadiance, Sample};
use anyhow::bail;
use glam::{DVec3, Vec3};
use std::f32::consts::{FRAC_1_PI, TAU};
use wrt_core::{Emission, Frame, Lobe, Phong, Polygon};

/// Points side by side.
const LANES: usize = 8;
type Lanes = [f32; LANES];

/// Emitters as points, and the receivers that they light.
pub(crate) struct WindowSum {
    emitters: Vec<Points>,
    receivers: Vec<(Frame, Phong)>,
    triangles: Vec<Vec<Option<u32>>>,
}

/// Points on an emitter: the centres of equal cells, dark ones left out.
struct Points {
    normal: Vec3,
    /// Direction of the most light, and the exponent of the cosine to it.
    lobe: Option<(Vec3, f32)>,
    batches: Vec<Batch>,
}

/// Where points are, and the area × radiance that they stand for.
#[derive(Clone, Copy, Default)]
struct Batch {
    at: [Lanes; 3],
    light: [Lanes; 3],
}

impl WindowSum {
    /// With a grid of `side`² points on each emitter, textures averaged around them.
    ///
    /// # Errors
    ///
    /// If nothing emits or receives, or a polygon cannot be used, by name; or if an
    /// emitter is a window under a sky, whose lobe is none of few terms.
    pub(crate) fn new(scene: &Scene, side: usize) -> anyhow::Result<Self> {
        let receivers = bake::receivers(scene, &mut Vec::new())?;
        let emitters = bake::emissions(scene, None)?;
        let triangles = receivers_of(scene, &receivers);
        Ok(Self {
            emitters: emitters
                .iter()
                .map(|(polygon, emission)| Points::new(polygon, emission, side))
                .collect::<anyhow::Result<_>>()?,
            receivers: receivers.iter().map(|r| (*r.polygon.frame(), r.phong)).collect(),
            triangles,
        })
    }

    /// Points looked at for a pixel.
    pub(crate) fn points(&self) -> usize {
        self.emitters.iter().map(|emitter| LANES * emitter.batches.len()).sum()
    }
}

impl Points {
    fn new(polygon: &Polygon, emission: &Emission, side: usize) -> anyhow::Result<Self> {
        let frame = polygon.frame();
        let size = polygon.size().unwrap_or_default();
        let area = size.x * size.y / (side * side) as f64;
        let mut points = Vec::new();
        for i in 0..side * side {
            let at = glam::DVec2::new((i % side) as f64, (i / side) as f64) + 0.5;
            let mean = mean(emission, [i % side, i / side], side);
            if mean != [0.0; 3] {
                points.push((frame.point(at / side as f64 * size), mean.map(|l| l * area)));
            }
        }
        let batch = |points: &[(DVec3, [f64; 3])]| {
            // What is left of the last batch is dark.
            let mut batch = Batch::default();
            for i in 0..LANES {
                let (at, light) = points.get(i).copied().unwrap_or((points[0].0, [0.0; 3]));
                for c in 0..3 {
                    (batch.at[c][i], batch.light[c][i]) = (at[c] as f32, light[c] as f32);
                }
            }
            batch
        };
        let lobe = match emission.lobe() {
            Lobe::Lambertian => None,
            Lobe::Cosine { exponent, peak } => {
                Some((frame.to_world(*peak).as_vec3(), *exponent as f32))
            }
            Lobe::Table { .. } | Lobe::Disc { .. } => bail!("a window under a sky"),
        };
        let batches = points.chunks(LANES).map(batch).collect();
        Ok(Self { normal: frame.n.as_vec3(), lobe, batches })
    }
}

/// The picture's mean over a cell of `side`² cells.
fn mean(emission: &Emission, cell: [usize; 2], side: usize) -> [f64; 3] {
    let texels = 1_usize << emission.level();
    let (mut sum, mut all) = ([0.0; 3], 0.0);
    // How much of each texel lies in the cell, along one axis.
    let parts = |m: usize| {
        let [low, high] = [m, m + 1].map(|m| m as f64 * texels as f64 / side as f64);
        (low as usize..(high.ceil() as usize).min(texels)).map(move |i| {
            let (from, to) = (low.max(i as f64), high.min((i + 1) as f64));
            (i, (to - from).max(0.0))
        })
    };
    for (y, high) in parts(cell[1]) {
        for (x, wide) in parts(cell[0]) {
            let texel = emission.picture()[y * texels + x];
            for (sum, light) in sum.iter_mut().zip(texel) {
                *sum += wide * high * f64::from(light);
            }
            all += wide * high;
        }
    }
    sum.map(|sum| sum / all)
}

impl PatchRadiance for WindowSum {
    fn outgoing(
        &self,
        mesh: usize,
        triangle: u32,
        position: DVec3,
        to_eye: DVec3,
        _: &Sample,
    ) -> Option<Vec3> {
        let i = self.triangles[mesh][triangle as usize]?;
        let (frame, phong) = &self.receivers[i as usize];
        let height = to_eye.dot(frame.n);
        if height <= 0.0 {
            return None;
        }
        let mirrored = (2.0 * height * frame.n - to_eye).normalize().as_vec3();
        let (position, normal) = (position.as_vec3(), frame.n.as_vec3());
        let exponent = phong.is_glossy().then_some(phong.exponent as f32);
        let [mut diffuse, mut glossy] = [[[0.0; LANES]; 3]; 2];
        for emitter in &self.emitters {
            for batch in &emitter.batches {
                let to: [Lanes; 3] = [0, 1, 2].map(|d| batch.at[d].map(|x| x - position[d]));
                let along = |axis: Vec3| -> Lanes {
                    let [x, y, z] = to;
                    std::array::from_fn(|i| x[i] * axis.x + y[i] * axis.y + z[i] * axis.z)
                };
                let inverse: Lanes = std::array::from_fn(|i| {
                    1.0 / (to[0][i] * to[0][i] + to[1][i] * to[1][i] + to[2][i] * to[2][i]).sqrt()
                });
                let cosine = |axis: Vec3| -> Lanes {
                    let along = along(axis);
                    std::array::from_fn(|i| (along[i] * inverse[i]).max(0.0))
                };
                let (leaves, arrives) = (cosine(-emitter.normal), cosine(normal));
                let mut weight: Lanes =
                    std::array::from_fn(|i| leaves[i] * arrives[i] * inverse[i] * inverse[i]);
                if let Some((peak, exponent)) = emitter.lobe {
                    times(&mut weight, &power(cosine(-peak), exponent));
                }
                add(&mut diffuse, &weight, &batch.light);
                if let Some(exponent) = exponent {
                    times(&mut weight, &power(cosine(mirrored), exponent));
                    add(&mut glossy, &weight, &batch.light);
                }
            }
        }
        let sum = |lanes: Lanes| lanes.iter().sum::<f32>();
        let (kd, ks) = (DVec3::from(phong.kd).as_vec3(), DVec3::from(phong.ks).as_vec3());
        let lobe = (phong.exponent as f32 + 2.0) / TAU;
        Some(
            kd * FRAC_1_PI * Vec3::from(diffuse.map(sum)) + ks * lobe * Vec3::from(glossy.map(sum)),
        )
    }
}

#[inline]
fn times(a: &mut Lanes, b: &Lanes) {
    *a = std::array::from_fn(|i| a[i] * b[i]);
}

#[inline]
fn add(sums: &mut [Lanes; 3], weight: &Lanes, light: &[Lanes; 3]) {
    for (sum, light) in sums.iter_mut().zip(light) {
        *sum = std::array::from_fn(|i| sum[i] + weight[i] * light[i]);
    }
}

/// xⁿ, by squaring where n is whole.
#[inline]
fn power(mut x: Lanes, n: f32) -> Lanes {
    let mut whole = n as u32;
    if whole as f32 != n {
        return x.map(|x| x.powf(n));
    }
    let mut power = [1.0; LANES];
    loop {
        if whole & 1 == 1 {
            times(&mut power, &x);
        }
        whole >>= 1;
        if whole == 0 {
            return power;
        }
        let square = x;
        times(&mut x, &square);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrt_core::gather;

    /// The same points in double precision, one by one.
    #[test]
    fn eight_at_a_time_are_the_sum_of_each() {
        let polygon = Polygon::rectangle(DVec3::new(-0.8, 1.2, -1.5), 1.6 * DVec3::X, DVec3::Y);
        let polygon = polygon.expect("a rectangle");
        let texel = |i: usize| [0.2 + (i % 5) as f32, (i % 3) as f32, 1.0];
        let peak = DVec3::new(0.1, -0.6, 0.8).normalize();
        for lobe in [Lobe::Lambertian, Lobe::Cosine { exponent: 3.0, peak }] {
            let emission = Emission::new(3, (0..64).map(texel).collect(), lobe);
            let floor = Polygon::rectangle(DVec3::ZERO, DVec3::Z, DVec3::X).expect("a square");
            for exponent in [0.5, 1.0, 40.0] {
                let phong = Phong { kd: [0.3, 0.2, 0.1], ks: [0.4, 0.5, 0.6], exponent };
                let sum = WindowSum {
                    emitters: vec![
                        Points::new(&polygon, &emission, 8).expect("a lobe of one term"),
                    ],
                    receivers: vec![(*floor.frame(), phong)],
                    triangles: vec![vec![Some(0)]],
                };
                assert_eq!(sum.points(), 64);
                let (position, eye) = (DVec3::new(0.3, 0.0, 0.4), DVec3::new(-0.1, 0.6, 1.2));
                let eye = eye.normalize();
                let found = sum.outgoing(0, 0, position, eye, &Sample::default()).expect("front");
                let emitters = [(polygon.clone(), emission.clone())];
                let local = floor.frame().to_local(eye);
                let exact = gather(&emitters, floor.frame(), position, &phong, local, 8);
                for c in 0..3 {
                    let off = (f64::from(found[c]) / exact[c] - 1.0).abs();
                    assert!(off < 1e-5, "n = {exponent}: {found} {exact:?}");
                }
            }
        }
    }

    #[test]
    fn means_over_cells_that_cut_texels_keep_the_light() {
        let picture: Vec<[f32; 3]> = (0..64).map(|i| [i as f32, 1.0, 0.0]).collect();
        let emission = Emission::new(3, picture, Lobe::Lambertian);
        for side in [1, 3, 5, 8, 20] {
            let cells = (0..side * side).map(|i| mean(&emission, [i % side, i / side], side));
            let sum = cells.fold([0.0; 3], |s, m| [s[0] + m[0], s[1] + m[1], s[2] + m[2]]);
            let mean = sum.map(|s| s / (side * side) as f64);
            assert!((mean[0] - 31.5).abs() < 1e-9 && (mean[1] - 1.0).abs() < 1e-12, "{mean:?}");
        }
    }
}
