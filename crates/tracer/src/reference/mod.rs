//! The radiance of patches without wavelets: emitters sampled directly for every
//! camera ray. What baked pictures are compared with.

mod light;
mod picture;
mod quadrature;
mod windows;

pub(crate) use picture::{Estimate, ReferenceOptions, Target, render_reference};
pub(crate) use quadrature::Quadrature;
pub(crate) use windows::WindowSum;

use crate::bake::{self, Receiver};
use crate::render::splitmix;
use crate::scene::Scene;
use crate::whitted::{PatchRadiance, Sample};
use glam::{DVec3, Vec3};
use light::{Arrival, Light, cumulative, invert};
use std::f64::consts::{FRAC_1_PI, TAU};
use wrt_core::{Frame, Phong, sobol};

/// Emitters and receivers of a scene, ready to be sampled.
///
/// The light is that of the bake, its assumptions included: from emitters straight
/// to receivers, nothing in between. Emitters have their textures' own texels;
/// textures finer than 2¹¹ are averaged to that.
#[derive(Debug)]
pub(crate) struct Lighting {
    lights: Vec<Light>,
    receivers: Vec<Reflector>,
    /// Per mesh and triangle: index into `receivers`.
    triangles: Vec<Vec<Option<u32>>>,
}

#[derive(Debug)]
struct Reflector {
    frame: Frame,
    phong: Phong,
    /// Probability of the diffuse part when the BRDF is sampled.
    diffuse: f64,
}

impl Lighting {
    /// # Errors
    ///
    /// If nothing emits or receives, or a polygon cannot be used; by name.
    pub(crate) fn new(scene: &Scene) -> anyhow::Result<Self> {
        let receivers = bake::receivers(scene, &mut Vec::new())?;
        let lights: Vec<Light> = bake::emissions(scene, None)?
            .into_iter()
            .filter_map(|(polygon, emission)| Light::new(&polygon, emission))
            .collect();
        let triangles = receivers_of(scene, &receivers);
        Ok(Self { lights, receivers: receivers.iter().map(Reflector::new).collect(), triangles })
    }

    /// The lighting as patches that take `points` points for each camera ray.
    ///
    /// The points of one pixel's rays belong to one scrambled Sobol' sequence, so
    /// that they complement each other; another `seed` gives independent ones.
    pub(crate) fn sampled(&self, points: u32, seed: u64) -> Sampled<'_> {
        Sampled { lighting: self, points, seed }
    }

    /// An estimate of the radiance that `reflector` sends from `position` along
    /// `eye`, by one point on a light and one direction of the BRDF, weighed by
    /// the balance heuristic (E. Veach & L. Guibas, *Optimally Combining Sampling
    /// Techniques for Monte Carlo Rendering*, SIGGRAPH 1995). Lights are taken by
    /// the distribution function `chosen`.
    fn estimate(
        &self,
        reflector: &Reflector,
        chosen: &[f64],
        position: DVec3,
        eye: DVec3,
        u: [f64; 4],
    ) -> DVec3 {
        let contribution = |arrival: &Arrival, chosen: f64| {
            let to_light = reflector.frame.to_local(arrival.direction);
            if to_light.z <= 0.0 {
                return DVec3::ZERO;
            }
            let density = chosen * arrival.density + reflector.density(to_light, eye);
            let reflectance = DVec3::from(reflector.phong.eval(to_light, eye));
            reflectance * DVec3::from(arrival.radiance) * (to_light.z / density)
        };
        let share = |i: usize| chosen[i] - if i == 0 { 0.0 } else { chosen[i - 1] };
        let mut sum = DVec3::ZERO;
        let (i, u0) = invert(chosen, u[0]);
        if let Some(arrival) = self.lights[i].sample([u0, u[1]], position) {
            sum += contribution(&arrival, share(i));
        }
        let direction = reflector.direction([u[2], u[3]], eye);
        if direction.z > 0.0 {
            let direction = reflector.frame.to_world(direction);
            for (i, light) in self.lights.iter().enumerate() {
                if let Some(arrival) = light.along(direction, position) {
                    sum += contribution(&arrival, share(i));
                }
            }
        }
        sum
    }
}

/// Per mesh and triangle: which receiver it is part of.
fn receivers_of(scene: &Scene, receivers: &[Receiver]) -> Vec<Vec<Option<u32>>> {
    let mut triangles: Vec<Vec<Option<u32>>> =
        scene.meshes.iter().map(|mesh| vec![None; mesh.triangles.len()]).collect();
    for (i, receiver) in receivers.iter().enumerate() {
        for &triangle in &receiver.planar.triangles {
            triangles[receiver.planar.mesh][triangle as usize] = Some(i as u32);
        }
    }
    triangles
}

impl Reflector {
    fn new(receiver: &Receiver) -> Self {
        let Phong { kd, ks, .. } = receiver.phong;
        let [kd, ks] = [kd, ks].map(|k| k.iter().sum::<f64>());
        let diffuse = if kd + ks > 0.0 { kd / (kd + ks) } else { 1.0 };
        Self { frame: *receiver.polygon.frame(), phong: receiver.phong, diffuse }
    }

    /// A direction of its frame in proportion to the BRDF, roughly: a cosine about
    /// the normal, or the lobe about the eye's mirror direction.
    fn direction(&self, u: [f64; 2], eye: DVec3) -> DVec3 {
        let (sine, cosine) = (TAU * u[1]).sin_cos();
        if u[0] < self.diffuse {
            let squared = u[0] / self.diffuse;
            return DVec3::new(cosine, sine, 0.0) * squared.sqrt()
                + DVec3::Z * (1.0 - squared).sqrt();
        }
        let within = (u[0] - self.diffuse) / (1.0 - self.diffuse);
        let height = within.powf(1.0 / (self.phong.exponent + 1.0));
        let radius = (1.0 - height * height).max(0.0).sqrt();
        let axis = mirrored(eye);
        let (x, y) = axis.any_orthonormal_pair();
        x * (radius * cosine) + y * (radius * sine) + axis * height
    }

    /// Of [`direction`](Self::direction), sr⁻¹.
    fn density(&self, direction: DVec3, eye: DVec3) -> f64 {
        let diffuse = self.diffuse * direction.z * FRAC_1_PI;
        if self.diffuse == 1.0 {
            return diffuse;
        }
        let n = self.phong.exponent;
        // (n+1)/(2π) cosⁿ; the BRDF's own lobe is (n+2)/(2π) cosⁿ.
        let lobe = wrt_core::phong_lobe(n, direction.dot(mirrored(eye))) * (n + 1.0) / (n + 2.0);
        diffuse + (1.0 - self.diffuse) * lobe
    }
}

fn mirrored(v: DVec3) -> DVec3 {
    DVec3::new(-v.x, -v.y, v.z)
}

/// [`Lighting`] with a number of points.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sampled<'a> {
    lighting: &'a Lighting,
    points: u32,
    seed: u64,
}

impl PatchRadiance for Sampled<'_> {
    fn outgoing(
        &self,
        mesh: usize,
        triangle: u32,
        position: DVec3,
        to_eye: DVec3,
        sample: &Sample,
    ) -> Option<Vec3> {
        let i = self.lighting.triangles[mesh][triangle as usize]?;
        let reflector = &self.lighting.receivers[i as usize];
        let eye = reflector.frame.to_local(to_eye).normalize();
        if eye.z <= 0.0 {
            return None;
        }
        let lights = &self.lighting.lights;
        let chosen = cumulative(lights.iter().map(|light| light.weight(position)));
        if chosen.is_empty() {
            return Some(Vec3::ZERO);
        }
        let bits = splitmix(sample.scramble ^ splitmix(self.seed));
        let more = splitmix(bits);
        let seeds = [bits as u32, (bits >> 32) as u32, more as u32, (more >> 32) as u32];
        let first = sample.index.wrapping_mul(self.points);
        let mut sum = DVec3::ZERO;
        for i in 0..self.points {
            let at = first.wrapping_add(i);
            let u = std::array::from_fn(|d| sobol(at, d, seeds[d]));
            sum += self.lighting.estimate(reflector, &chosen, position, eye, u);
        }
        Some((sum / f64::from(self.points)).as_vec3())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrt_core::{Emission, Lobe, Polygon, gather};

    /// A receiver in the plane y = 0 around the origin under these lights.
    fn lighting(phong: Phong, lights: &[(Polygon, Emission)]) -> Lighting {
        let floor = Polygon::rectangle(DVec3::ZERO, DVec3::Z, DVec3::X).expect("a square");
        let kd: f64 = phong.kd.iter().sum();
        let ks: f64 = phong.ks.iter().sum();
        let lights: Vec<Light> = lights
            .iter()
            .filter_map(|(polygon, emission)| Light::new(polygon, emission.clone()))
            .collect();
        Lighting {
            lights,
            receivers: vec![Reflector { frame: *floor.frame(), phong, diffuse: kd / (kd + ks) }],
            triangles: vec![vec![Some(0)]],
        }
    }

    fn radiance(lighting: &Lighting, position: DVec3, eye: DVec3, points: u32, seed: u64) -> Vec3 {
        let sampled = lighting.sampled(points, seed);
        sampled
            .outgoing(0, 0, position, eye.normalize(), &Sample::default())
            .expect("the front of the receiver")
    }

    /// A 1.6 m window of coloured panes and dark leads, 2 m above the floor, whose
    /// light goes down into the room.
    fn window() -> (Polygon, Emission) {
        let polygon =
            Polygon::rectangle(DVec3::new(-0.8, 1.2, -1.5), 1.6 * DVec3::X, 1.6 * DVec3::Y);
        let picture = (0..4096_u32).map(|i| {
            let (x, y) = (i % 64, i / 64);
            let pane = (x / 8).wrapping_mul(2_654_435_761) ^ (y / 8).wrapping_mul(40_503_001);
            let lead = x % 8 == 0 || y % 8 == 0;
            let channel = |c: u32| if lead { 0.0 } else { (pane >> (8 * c) & 15) as f32 };
            [channel(0), channel(1), channel(2)]
        });
        let peak = DVec3::new(0.1, -0.6, 0.8).normalize();
        let lobe = Lobe::Cosine { exponent: 4.0, peak };
        (polygon.expect("a rectangle"), Emission::new(6, picture.collect(), lobe))
    }

    fn glossy(exponent: f64) -> Phong {
        Phong { kd: [0.3, 0.2, 0.1], ks: [0.4, 0.5, 0.6], exponent }
    }

    #[test]
    fn sampling_agrees_with_quadrature_over_the_texels() {
        let lamp = Polygon::rectangle(DVec3::new(0.4, 0.3, 0.5), 0.3 * DVec3::X, 0.2 * DVec3::Z);
        let lamp = (lamp.expect("a rectangle"), Emission::new(0, vec![[9.0; 3]], Lobe::Lambertian));
        let emitters = [window(), lamp];
        let position = DVec3::new(0.3, 0.0, 0.4);
        for phong in [
            Phong { kd: [0.5; 3], ks: [0.0; 3], exponent: 0.0 },
            glossy(8.0),
            glossy(40.0),
            glossy(1000.0),
        ] {
            let lighting = lighting(phong, &emitters);
            for eye in [DVec3::new(-0.1, 0.6, 1.2), DVec3::new(0.5, 1.0, -0.2)] {
                let frame = lighting.receivers[0].frame;
                let local = frame.to_local(eye.normalize());
                let exact = gather(&emitters, &frame, position, &phong, local, 1024);
                for (c, exact) in exact.into_iter().enumerate() {
                    let (mean, error) = mean_and_error(16, |seed| {
                        let found = radiance(&lighting, position, eye, 1 << 10, seed);
                        f64::from(found[c])
                    });
                    let n = phong.exponent;
                    assert!(error < 0.01 * exact, "too noisy to tell, n = {n}: {mean} ± {error}");
                    // The quadrature itself is good to 10⁻⁴.
                    let off = (mean - exact).abs();
                    assert!(off < 3.0 * error + 1e-4 * exact, "n = {n}: {mean} ± {error}, {exact}");
                }
            }
        }
    }

    /// The mean over seeds, and its standard error.
    fn mean_and_error(seeds: u64, of: impl Fn(u64) -> f64) -> (f64, f64) {
        let found: Vec<f64> = (0..seeds).map(of).collect();
        let n = seeds as f64;
        let mean = found.iter().sum::<f64>() / n;
        let squares: f64 = found.iter().map(|x| (x - mean).powi(2)).sum();
        (mean, (squares / (n * (n - 1.0))).sqrt())
    }

    /// A square lamp over a point under its corner, as in [`gather`]'s own test:
    /// F = (1/π) (1/√2) atan(1/√2) for each of its two halves (J. R. Howell, B-3).
    #[test]
    fn a_square_over_its_corner_gives_the_textbook_radiance() {
        let lamp = Polygon::rectangle(DVec3::Y, DVec3::X, DVec3::Z).expect("a square");
        let lamp = (lamp, Emission::new(0, vec![[1.0; 3]], Lobe::Lambertian));
        let white = Phong { kd: [1.0; 3], ks: [0.0; 3], exponent: 0.0 };
        let expected = 0.5_f64.sqrt() * 0.5_f64.sqrt().atan() * FRAC_1_PI;
        let found = radiance(&lighting(white, &[lamp]), DVec3::ZERO, DVec3::Y, 4096, 0);
        assert!((f64::from(found.x) / expected - 1.0).abs() < 1e-3, "{found} {expected}");
    }

    /// Under a sky of radiance 1, k_d + k_s leaves along the normal whatever the
    /// exponent. The sky is a ceiling 10⁴ times as wide as it is high, which
    /// sampling by area alone would see as a few blinding points.
    #[test]
    fn a_furnace_gives_back_all_that_the_surface_reflects() {
        let corner = DVec3::new(-1e4, 1.0, -1e4);
        let sky = Polygon::rectangle(corner, 2e4 * DVec3::X, 2e4 * DVec3::Z).expect("a square");
        let sky = [(sky, Emission::new(0, vec![[1.0; 3]], Lobe::Lambertian))];
        for n in [0.0, 1.0, 40.0, 1e5] {
            let found = radiance(&lighting(glossy(n), &sky), DVec3::ZERO, DVec3::Y, 4096, 1);
            assert!((found - Vec3::splat(0.7)).abs().max_element() < 1e-3, "n = {n}: {found}");
        }
    }

    /// Few points are as unbiased as many.
    #[test]
    fn scramblings_scatter_about_the_truth() {
        let emitters = [window()];
        let (phong, position, eye) = (glossy(40.0), DVec3::ZERO, DVec3::new(0.1, 0.9, 1.0));
        let lighting = lighting(phong, &emitters);
        let frame = lighting.receivers[0].frame;
        let local = frame.to_local(eye.normalize());
        let exact = gather(&emitters, &frame, position, &phong, local, 1024)[1];
        let (mean, error) =
            mean_and_error(1024, |seed| f64::from(radiance(&lighting, position, eye, 1, seed).y));
        assert!(error > 3e-3 * exact, "one point a pixel is noise: {error}");
        assert!((mean - exact).abs() < 3.0 * error, "{mean} ± {error}, {exact}");
    }

    #[test]
    fn a_black_surface_and_a_dark_scene_are_dark() {
        let black = Phong { kd: [0.0; 3], ks: [0.0; 3], exponent: 0.0 };
        let mut dark = lighting(glossy(8.0), &[]);
        assert_eq!(radiance(&dark, DVec3::ZERO, DVec3::Y, 4, 0), Vec3::ZERO);
        dark = lighting(black, &[window()]);
        dark.receivers[0].diffuse = 1.0;
        assert_eq!(radiance(&dark, DVec3::ZERO, DVec3::Y, 4, 0), Vec3::ZERO);
    }
}
