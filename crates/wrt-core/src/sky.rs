//! Sky and sun as the light that falls on the outside of a window.
//!
//! World directions: +Y is up, north is −Z and east is +X; azimuths run from north
//! towards east. Radiance in W m⁻² sr⁻¹, the same in all channels.

use crate::grid::Grid;
use crate::{Error, Frame, Levels, Result, udc_fraction};
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::fmt;

/// How the radiance of the sky depends on direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SkyModel {
    /// The same everywhere.
    Uniform,
    /// The CIE overcast sky, (1 + 2 sin γ)/3 of the zenith's at elevation γ (Moon &
    /// Spencer, 1942; ISO 15469, sky 16).
    Overcast,
    /// The all-weather model, from blue to white by its two irradiances (R. Perez, R.
    /// Seals, J. Michalsky, *All-weather model for sky luminance distribution*, Solar
    /// Energy 50(3), 1993).
    Clear,
}

/// The sun, seen under 0.533°.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Unit vector towards it.
    pub direction: DVec3,
    /// Irradiance of a surface that faces it, W m⁻².
    pub irradiance: f64,
}

impl Sun {
    /// Half the angle under which it is seen, in radians.
    pub const RADIUS: f64 = 0.266_5 * PI / 180.0;

    /// The sun at an azimuth and elevation in degrees.
    ///
    /// # Errors
    ///
    /// [`Error::Weather`] for an azimuth that is no number, an elevation
    /// outside 0 to 90, or an irradiance that is negative or not finite.
    pub fn new(azimuth: f64, elevation: f64, irradiance: f64) -> Result<Self> {
        in_range("the sun's azimuth", azimuth, azimuth.is_finite(), "a number of degrees")?;
        let above = (0.0..=90.0).contains(&elevation);
        in_range("the sun's elevation", elevation, above, "0 to 90 degrees")?;
        let positive = irradiance.is_finite() && irradiance >= 0.0;
        in_range("the sun's irradiance", irradiance, positive, "finite and at least 0")?;
        let (azimuth, elevation) = (azimuth.to_radians(), elevation.to_radians());
        let (east, north) = (azimuth.sin(), azimuth.cos());
        let direction =
            DVec3::new(elevation.cos() * east, elevation.sin(), -elevation.cos() * north);
        Ok(Self { direction, irradiance })
    }
}

fn in_range(what: &'static str, found: f64, holds: bool, allowed: &'static str) -> Result<()> {
    if holds { Ok(()) } else { Err(Error::Weather { what, found, allowed }) }
}

/// A sky over a diffuse ground.
#[derive(Clone, Debug, PartialEq)]
pub struct Sky {
    model: SkyModel,
    sun: Option<Sun>,
    /// Of the sky, by which its relative radiance is multiplied.
    scale: f64,
    /// Its irradiance of the ground, and what that reflects.
    diffuse: f64,
    albedo: f64,
    /// Radiance of the ground.
    ground: f64,
    perez: [f64; 5],
}

impl Sky {
    /// A sky that gives a horizontal surface the irradiance `diffuse` (W m⁻², without
    /// the sun), over a ground that reflects the fraction `albedo` of all light.
    ///
    /// # Errors
    ///
    /// [`Error::Weather`] if an irradiance is negative or not finite, the albedo lies
    /// outside 0 to 1, or the all-weather model has no sun or no diffuse light.
    pub fn new(model: SkyModel, diffuse: f64, sun: Option<Sun>, albedo: f64) -> Result<Self> {
        let positive = diffuse.is_finite() && diffuse >= 0.0;
        in_range("the sky's irradiance", diffuse, positive, "finite and at least 0")?;
        in_range("the ground's albedo", albedo, (0.0..=1.0).contains(&albedo), "0 to 1")?;
        let perez = match (model, sun) {
            (SkyModel::Clear, None) => {
                in_range("the number of suns of a clear sky", 0.0, false, "1")?;
                [0.0; 5]
            }
            (SkyModel::Clear, Some(sun)) => {
                in_range("a clear sky's irradiance", diffuse, diffuse > 0.0, "above 0")?;
                perez(diffuse, &sun)
            }
            _ => [0.0; 5],
        };
        let beam = sun.map_or(0.0, |sun| sun.irradiance * sun.direction.y);
        let ground = albedo * (diffuse + beam) / PI;
        let mut sky = Self { model, sun, scale: 1.0, diffuse, albedo, ground, perez };
        sky.scale = diffuse / sky.horizontal();
        Ok(sky)
    }

    /// The sun, if there is one.
    #[must_use]
    pub fn sun(&self) -> Option<Sun> {
        self.sun
    }

    /// The same sky and ground without the sun's disc.
    #[must_use]
    pub fn without_sun(&self) -> Self {
        // The sun's direction stays: the all-weather sky is bright around it.
        let sun = self.sun.map(|sun| Sun { irradiance: 0.0, ..sun });
        Self { sun, ..self.clone() }
    }

    /// Radiance from the unit world direction `to`, of the sky without the sun, or of
    /// the ground.
    #[must_use]
    pub fn radiance(&self, to: DVec3) -> f64 {
        if to.y < 0.0 { self.ground } else { self.scale * self.relative(to) }
    }

    fn relative(&self, to: DVec3) -> f64 {
        match self.model {
            SkyModel::Uniform => 1.0,
            SkyModel::Overcast => (1.0 + 2.0 * to.y) / 3.0,
            SkyModel::Clear => {
                let [a, b, c, d, e] = self.perez;
                let cosine = self.sun.map_or(1.0, |sun| to.dot(sun.direction)).clamp(-1.0, 1.0);
                // As gendaylit does, the horizon's own brightness stops at 0.01.
                let horizon = 1.0 + a * (b / to.y.max(0.01)).exp();
                let sun = 1.0 + c * (d * cosine.acos()).exp() + e * cosine * cosine;
                (horizon * sun).max(0.0)
            }
        }
    }

    /// ∫ relative radiance × cosζ dω over the upper hemisphere, by midpoints in cos²ζ
    /// and azimuth.
    fn horizontal(&self) -> f64 {
        const N: u32 = 256;
        let mut sum = 0.0;
        for i in 0..N {
            let up = ((f64::from(i) + 0.5) / f64::from(N)).sqrt();
            let across = (1.0 - up * up).sqrt();
            for j in 0..N {
                let phi = TAU * (f64::from(j) + 0.5) / f64::from(N);
                sum += self.relative(DVec3::new(across * phi.cos(), up, across * phi.sin()));
            }
        }
        PI * sum / f64::from(N * N)
    }

    /// The radiance that falls on the *back* of a surface with this frame, at one
    /// position: in the frame's own tangent axes with −n̂ as the normal, zeros outside
    /// the UDC counted.
    ///
    /// The sun's disc is spread over the cells that it touches: its irradiance is
    /// exact, its size is that of a cell.
    #[must_use]
    pub fn behind(&self, frame: &Frame, direction: u8) -> Grid {
        const POINTS: usize = 8;
        let side = 1_usize << direction;
        let step = 2.0 / side as f64;
        let at = |m: usize, i: usize| (m as f64 + (i as f64 + 0.5) / POINTS as f64) * step - 1.0;
        let mut means: Vec<f64> = (0..side * side)
            .map(|d| {
                let (k, l) = (d % side, d / side);
                let corner = |m: usize| m as f64 / side as f64;
                let (low, high) = ([corner(k), corner(l)], [corner(k + 1), corner(l + 1)]);
                let fraction = udc_fraction(low, high);
                let (mut sum, mut count) = (0.0, 0);
                for i in 0..POINTS * POINTS {
                    let (x, y) = (at(k, i % POINTS), at(l, i / POINTS));
                    let height = 1.0 - x * x - y * y;
                    if height > 0.0 {
                        sum += self.radiance(outside(frame, DVec3::new(x, y, height.sqrt())));
                        count += 1;
                    }
                }
                if count == 0 { 0.0 } else { fraction * sum / f64::from(count) }
            })
            .collect();
        if let Some(sun) = self.sun {
            self.add_sun(frame, sun, side, &mut means);
        }
        let levels = Levels { position: 0, direction };
        let images = means.iter().map(|&l| (l > 0.0).then(|| vec![[l as f32; 3]])).collect();
        Grid::from_images(levels, images)
    }

    fn add_sun(&self, frame: &Frame, sun: Sun, side: usize, means: &mut [f64]) {
        const RINGS: u32 = 8;
        const AROUND: u32 = 16;
        let (x, y) = sun.direction.any_orthonormal_pair();
        let cell = 4.0 / (side * side) as f64;
        let index = |mu: f64| ((0.5 * (mu + 1.0) * side as f64) as usize).min(side - 1);
        for i in 0..RINGS * AROUND {
            let radius = Sun::RADIUS * ((f64::from(i % RINGS) + 0.5) / f64::from(RINGS)).sqrt();
            let phi = TAU * f64::from(i / RINGS) / f64::from(AROUND);
            let to = (sun.direction + radius * (phi.cos() * x + phi.sin() * y)).normalize();
            // The frame's own axes; z is on the outer side.
            let mu = frame.to_local(to);
            if to.y > 0.0 && mu.z < 0.0 {
                let share = sun.irradiance / f64::from(RINGS * AROUND);
                means[index(mu.y) * side + index(mu.x)] += share * -mu.z / cell;
            }
        }
    }
}

/// Such as `overcast sky of 100 W/m2 over ground of 0.2, sun of 500 W/m2 at 20, 35 degrees`.
impl fmt::Display for Sky {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let model = match self.model {
            SkyModel::Uniform => "uniform",
            SkyModel::Overcast => "overcast",
            SkyModel::Clear => "clear",
        };
        write!(f, "{model} sky of {} W/m2 over ground of {}", self.diffuse, self.albedo)?;
        if let Some(Sun { direction, irradiance }) = self.sun {
            let azimuth = direction.x.atan2(-direction.z).to_degrees().rem_euclid(360.0);
            let elevation = direction.y.clamp(-1.0, 1.0).asin().to_degrees();
            write!(f, ", sun of {irradiance} W/m2 at {azimuth:.4}, {elevation:.4} degrees")?;
        }
        Ok(())
    }
}

/// The world direction of one on a surface's back, given in the frame's tangent axes
/// with −n̂ as the normal.
fn outside(frame: &Frame, local: DVec3) -> DVec3 {
    frame.to_world(DVec3::new(local.x, local.y, -local.z))
}

/// The five parameters a to e of the all-weather model.
fn perez(diffuse: f64, sun: &Sun) -> [f64; 5] {
    // Zenith angle; the model is not for suns below the horizon.
    let z = sun.direction.y.clamp(0.0, 1.0).acos();
    let cubed = 1.041 * z.powi(3);
    let clearness = ((diffuse + sun.irradiance) / diffuse + cubed) / (1.0 + cubed);
    // Kasten's relative air mass, 1966; extraterrestrial irradiance 1367 W m⁻².
    let degrees = z.to_degrees();
    let mass = 1.0 / (z.cos() + 0.15 * (93.885 - degrees).powf(-1.253));
    let brightness = (diffuse * mass / 1367.0).max(0.01);
    let bin = CLEARNESS.iter().take_while(|&&limit| clearness >= limit).count();
    let x = |i: usize| &COEFFICIENTS[bin][4 * i..][..4];
    let linear = |x: &[f64]| x[0] + x[1] * z + brightness * (x[2] + x[3] * z);
    let (mut c, mut d) = (linear(x(2)), linear(x(3)));
    if bin == 0 {
        let (xc, xd) = (x(2), x(3));
        c = (brightness * (xc[0] + xc[1] * z)).powf(xc[2]).exp() - xc[3];
        d = -(brightness * (xd[0] + xd[1] * z)).exp() + xd[2] + brightness * xd[3];
    }
    debug_assert!(z <= FRAC_PI_2 + 1e-12, "the sun is up: {z}");
    [linear(x(0)), linear(x(1)), c, d, linear(x(4))]
}

/// Upper limits of the sky's clearness ε, overcast to clear.
const CLEARNESS: [f64; 7] = [1.065, 1.230, 1.500, 1.950, 2.800, 4.500, 6.200];

/// Perez et al., Table 1: by clearness, four numbers each for a to e.
#[rustfmt::skip]
const COEFFICIENTS: [[f64; 20]; 8] = [
    [1.3525, -0.2576, -0.2690, -1.4366, -0.7670, 0.0007, 1.2734, -0.1233, 2.8000, 0.6004,
     1.2375, 1.0000, 1.8734, 0.6297, 0.9738, 0.2809, 0.0356, -0.1246, -0.5718, 0.9938],
    [-1.2219, -0.7730, 1.4148, 1.1016, -0.2054, 0.0367, -3.9128, 0.9156, 6.9750, 0.1774,
     6.4477, -0.1239, -1.5798, -0.5081, -1.7812, 0.1080, 0.2624, 0.0672, -0.2190, -0.4285],
    [-1.1000, -0.2515, 0.8952, 0.0156, 0.2782, -0.1812, -4.5000, 1.1766, 24.7219, -13.0812,
     -37.7000, 34.8438, -5.0000, 1.5218, 3.9229, -2.6204, -0.0156, 0.1597, 0.4199, -0.5562],
    [-0.5484, -0.6654, -0.2672, 0.7117, 0.7234, -0.6219, -5.6812, 2.6297, 33.3389, -18.3000,
     -62.2500, 52.0781, -3.5000, 0.0016, 1.1477, 0.1062, 0.4659, -0.3296, -0.0876, -0.0329],
    [-0.6000, -0.3566, -2.5000, 2.3250, 0.2937, 0.0496, -5.6812, 1.8415, 21.0000, -4.7656,
     -21.5906, 7.2492, -3.5000, -0.1554, 1.4062, 0.3988, 0.0032, 0.0766, -0.0656, -0.1294],
    [-1.0156, -0.3670, 1.0078, 1.4051, 0.2875, -0.5328, -3.8500, 3.3750, 14.0000, -0.9999,
     -7.1406, 7.5469, -3.4000, -0.1078, -1.0750, 1.5702, -0.0672, 0.4016, 0.3017, -0.4844],
    [-1.0000, 0.0211, 0.5025, -0.5119, -0.3000, 0.1922, 0.7023, -1.6317, 19.0000, -5.0000,
     1.2438, -1.9094, -4.0000, 0.0250, 0.3844, 0.2656, 1.0468, -0.3788, -2.4517, 1.4656],
    [-1.0500, 0.0289, 0.4260, 0.3590, -0.3250, 0.1156, 0.7781, 0.0025, 31.0625, -14.5000,
     -46.1148, 55.3750, -7.2312, 0.4050, 13.3500, 0.6234, 1.5000, -0.6426, 1.8564, 0.5636],
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Polygon;

    /// Irradiance of a surface that looks along `normal`, from directions.
    fn irradiance(sky: &Sky, normal: DVec3) -> f64 {
        const N: u32 = 300;
        let (x, y) = normal.any_orthonormal_pair();
        let mut sum = 0.0;
        for i in 0..N * N {
            let at = |i: u32| (f64::from(i) + 0.5) / f64::from(N);
            let up = at(i % N).sqrt();
            let (across, phi) = ((1.0 - up * up).sqrt(), TAU * at(i / N));
            sum += sky.radiance(up * normal + across * (phi.cos() * x + phi.sin() * y));
        }
        PI * sum / f64::from(N * N)
    }

    /// a to e as Radiance's gendaylit prints them:
    /// `gendaylit -ang 35 20 -W DIRECT DIFFUSE`.
    #[test]
    fn parameters_are_radiance_s_own() {
        for (direct, diffuse, expected) in [
            (600.0, 100.0, [-1.078_279, -0.298_946, 13.052_934, -3.450_355, 0.298_241]),
            (800.0, 80.0, [-0.946_494, -0.137_296, 17.835_783, -5.471_069, 1.118_854]),
            (400.0, 200.0, [-1.008_223, -0.620_588, 12.828_969, -3.209_448, 0.030_076]),
            (10.0, 150.0, [0.801_417, -0.553_404, 0.743_889, -0.553_397, -0.013_555]),
            (200.0, 150.0, [-1.103_942, -0.504_955, 13.320_440, -3.248_535, 0.125_670]),
        ] {
            let sun = Sun::new(20.0, 35.0, direct).expect("in range");
            for (found, expected) in perez(diffuse, &sun).iter().zip(expected) {
                // Its air mass and extraterrestrial irradiance are another day's.
                assert!(
                    (found - expected).abs() < 0.03 * (1.0 + expected.abs()),
                    "{direct} {diffuse}: {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn every_sky_gives_the_ground_its_irradiance() {
        let sun = Some(Sun::new(200.0, 40.0, 700.0).expect("in range"));
        for model in [SkyModel::Uniform, SkyModel::Overcast, SkyModel::Clear] {
            let sky = Sky::new(model, 120.0, sun, 0.2).expect("in range");
            let found = irradiance(&sky, DVec3::Y);
            assert!((found / 120.0 - 1.0).abs() < 2e-3, "{model:?}: {found}");
        }
        // Vertical: a uniform sky gives half of it; an overcast one (1/3)/(7/9) × ½ + …
        // = 0.3955 (Moon & Spencer); the ground adds ½ ρ.
        for (model, share) in [(SkyModel::Uniform, 0.5), (SkyModel::Overcast, 0.395_5)] {
            let sky = Sky::new(model, 100.0, None, 0.2).expect("in range");
            let found = irradiance(&sky, DVec3::X);
            assert!((found - 100.0 * share - 10.0).abs() < 0.3, "{model:?}: {found}");
        }
    }

    #[test]
    fn azimuth_runs_from_north_to_east() {
        let towards = |azimuth: f64| Sun::new(azimuth, 0.0, 1.0).expect("in range").direction;
        for (azimuth, expected) in [(0.0, -DVec3::Z), (90.0, DVec3::X), (180.0, DVec3::Z)] {
            assert!((towards(azimuth) - expected).length() < 1e-12, "{azimuth}");
        }
    }

    /// Through 4 ∬ L dκ dλ: sky and sun on a window that looks south-east, from inside.
    #[test]
    fn light_on_a_window_has_its_irradiance() {
        let (x, up) = (DVec3::new(1.0, 0.0, 1.0).normalize(), DVec3::Y);
        let window = Polygon::rectangle(DVec3::ZERO, x, up).expect("a square");
        let frame = window.frame();
        let out = -frame.n;
        for azimuth in [0.0, 20.0, 60.0] {
            let sun = Sun::new(azimuth, 30.0, 600.0).expect("in range");
            let sky = Sky::new(SkyModel::Clear, 90.0, Some(sun), 0.2).expect("in range");
            let expected = irradiance(&sky, out) + 600.0 * sun.direction.dot(out).max(0.0);
            for level in [4, 6] {
                let found = sky.behind(frame, level).irradiance()[0][0];
                assert!((found / expected - 1.0).abs() < 5e-3, "{azimuth}: {found} {expected}");
            }
        }
        // Where it comes from: the brightest cell is the sun's, in the frame's axes.
        let sun = Sun::new(45.0 + 180.0, 30.0, 600.0).expect("in range");
        let sky = Sky::new(SkyModel::Uniform, 0.0, Some(sun), 0.0).expect("in range");
        let grid = sky.behind(frame, 5);
        let to = frame.to_local(sun.direction);
        let cell = |mu: f64| (16.0 * (mu + 1.0)) as usize;
        let lit = grid.mean([0, 0, cell(to.x), cell(to.y)])[0];
        assert_eq!(lit > 0.0, to.z < 0.0, "{to}");
    }

    #[test]
    fn a_sky_says_what_it_is() {
        let sun = Some(Sun::new(-20.0, 35.0, 600.0).expect("in range"));
        let sky = Sky::new(SkyModel::Clear, 90.0, sun, 0.25).expect("in range");
        assert_eq!(
            sky.to_string(),
            "clear sky of 90 W/m2 over ground of 0.25, sun of 600 W/m2 at 340.0000, 35.0000 degrees"
        );
    }

    #[test]
    fn weather_out_of_range_is_refused() {
        assert!(Sun::new(0.0, -1.0, 1.0).is_err(), "below the horizon");
        assert!(Sun::new(0.0, 10.0, f64::NAN).is_err(), "no number");
        let sun = Sun::new(0.0, 90.0, 0.0).ok();
        assert!(Sky::new(SkyModel::Clear, 1.0, sun, 0.2).is_ok(), "the zenith");
        for (model, diffuse, sun, albedo) in [
            (SkyModel::Clear, 1.0, None, 0.2),
            (SkyModel::Clear, 0.0, sun, 0.2),
            (SkyModel::Uniform, -1.0, None, 0.2),
            (SkyModel::Uniform, 1.0, None, 1.5),
        ] {
            let error = Sky::new(model, diffuse, sun, albedo).expect_err("out of range");
            assert!(matches!(error, Error::Weather { .. }), "{error}");
        }
    }
}
