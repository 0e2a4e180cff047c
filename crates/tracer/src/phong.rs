//! Phong reflection and local illumination: what a surface does with light that
//! comes straight from a punctual light or from the ambient term.

mod surface;
mod unshadowed;

pub(crate) use surface::Surface;
pub(crate) use unshadowed::{Source, Unshadowed};

use crate::scene::{LightKind, PunctualLight};
use glam::{DVec3, Vec3};
use std::f64::consts::FRAC_1_PI;

/// [`wrt_core::Phong`] in single precision, about a normal in the world.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Phong {
    pub(crate) kd: Vec3,
    pub(crate) ks: Vec3,
    pub(crate) exponent: f64,
}

impl Phong {
    /// Whether nothing is reflected, so that no light need be looked for.
    pub(crate) fn is_black(&self) -> bool {
        self.kd == Vec3::ZERO && self.ks == Vec3::ZERO
    }

    /// f_r in sr⁻¹ for unit vectors that point away from the surface.
    pub(crate) fn reflectance(&self, normal: DVec3, to_light: DVec3, to_eye: DVec3) -> Vec3 {
        let diffuse = self.kd * FRAC_1_PI as f32;
        if self.ks == Vec3::ZERO {
            return diffuse;
        }
        let mirrored = 2.0 * normal.dot(to_light) * normal - to_light;
        diffuse + self.ks * wrt_core::phong_lobe(self.exponent, mirrored.dot(to_eye)) as f32
    }
}

/// Direction to `light`, distance, and its irradiance on a plane that faces it,
/// as KHR_lights_punctual has it; `None` where no light arrives.
fn arriving(light: &PunctualLight, position: DVec3) -> Option<(DVec3, f64, Vec3)> {
    if light.kind == LightKind::Directional {
        return Some((-light.direction.try_normalize()?, f64::INFINITY, light.intensity));
    }
    let path = light.position - position;
    let distance = path.length();
    let to_light = path.try_normalize()?;
    let window = light.range.map_or(1.0, |range| (1.0 - (distance / range).powi(4)).max(0.0));
    let cone = match light.kind {
        LightKind::Spot { inner, outer } => {
            let cosine = -to_light.dot(light.direction.try_normalize()?);
            // 0.001 is the extension's, against equal angles.
            let ramp = (cosine - outer.cos()) / (inner.cos() - outer.cos()).max(0.001);
            ramp.clamp(0.0, 1.0).powi(2)
        }
        LightKind::Point | LightKind::Directional => 1.0,
    };
    let falloff = window * cone / (distance * distance);
    (falloff > 0.0).then(|| (to_light, distance, light.intensity * falloff as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::Accel;
    use crate::scene::{Material, Mesh, Scene};
    use std::f64::consts::{PI, TAU};

    /// A square of side 200 m in the plane y = 0 that faces up.
    fn ground(material: Material) -> Scene {
        let corners = [[-100.0, 100.0], [100.0, 100.0], [100.0, -100.0], [-100.0, -100.0]];
        Scene {
            meshes: vec![Mesh {
                positions: corners.map(|[x, z]| DVec3::new(x, 0.0, z)).to_vec(),
                triangles: vec![[0, 1, 2], [0, 2, 3]],
                ..Mesh::default()
            }],
            materials: vec![material],
            ..Scene::default()
        }
    }

    fn grey(kd: f32) -> Material {
        Material { kd: Vec3::splat(kd), ..Material::default() }
    }

    fn light(kind: LightKind, intensity: f32, position: DVec3) -> PunctualLight {
        PunctualLight {
            intensity: Vec3::splat(intensity),
            position,
            direction: DVec3::NEG_Y,
            kind,
            range: None,
        }
    }

    /// Radiance seen straight from above at the origin.
    fn seen(scene: &Scene, light: &PunctualLight) -> f32 {
        let accel = Accel::new(scene);
        let hit = accel.closest(DVec3::Y, DVec3::NEG_Y, 0.0, 2.0).expect("the ground");
        let surface = Surface::new(scene, &hit, DVec3::Y);
        let light = surface.lit_by(light);
        light.map_or(0.0, |light| light.shadowed(&surface, &accel).x)
    }

    #[test]
    fn point_light_above_a_lambertian_plane_gives_kd_over_pi_intensity_over_height_squared() {
        let scene = ground(grey(0.6));
        let above = light(LightKind::Point, 50.0, DVec3::new(0.0, 4.0, 0.0));
        let expected = 0.6 / std::f32::consts::PI * 50.0 / 16.0;
        assert!((seen(&scene, &above) / expected - 1.0).abs() < 1e-6, "{}", seen(&scene, &above));
        // At 60° the distance doubles and the cosine halves.
        let aside = light(LightKind::Point, 50.0, DVec3::new(48.0_f64.sqrt(), 4.0, 0.0));
        assert!((seen(&scene, &aside) / expected - 0.125).abs() < 1e-6, "{}", seen(&scene, &aside));
        let below = light(LightKind::Point, 50.0, DVec3::new(0.0, -4.0, 0.0));
        assert_eq!(seen(&scene, &below), 0.0);
    }

    #[test]
    fn range_and_cone_end_where_they_say() {
        let scene = ground(grey(1.0));
        let at = |kind, x: f64, range| PunctualLight {
            range,
            ..light(kind, 1.0, DVec3::new(x, 1.0, 0.0))
        };
        let free = seen(&scene, &at(LightKind::Point, 0.0, None));
        let windowed = seen(&scene, &at(LightKind::Point, 0.0, Some(2.0)));
        assert!((windowed / free - 15.0 / 16.0).abs() < 1e-6, "{windowed} of {free}");
        assert_eq!(seen(&scene, &at(LightKind::Point, 0.0, Some(0.99))), 0.0);
        let spot = LightKind::Spot { inner: 0.2, outer: 0.5 };
        assert_eq!(seen(&scene, &at(spot, 0.0, None)), free);
        assert_eq!(seen(&scene, &at(spot, 0.51_f64.tan(), None)), 0.0);
        let middle = (0.5 * (0.2_f64.cos() + 0.5_f64.cos())).acos().tan();
        let ratio = seen(&scene, &at(spot, middle, None))
            / seen(&scene, &at(LightKind::Point, middle, None));
        assert!((ratio - 0.25).abs() < 1e-6, "half way up the ramp, squared: {ratio}");
    }

    #[test]
    fn directional_light_gives_its_irradiance_and_casts_shadows() {
        let mut scene = ground(grey(0.5));
        let sun = light(LightKind::Directional, 3.0, DVec3::ZERO);
        let expected = 0.5 / std::f32::consts::PI * 3.0;
        assert!((seen(&scene, &sun) - expected).abs() < 1e-6, "{}", seen(&scene, &sun));
        let roof = scene.meshes[0].positions.iter().map(|p| p + 5.0 * DVec3::Y).collect();
        let triangles = scene.meshes[0].triangles.clone();
        scene.meshes.push(Mesh { positions: roof, triangles, ..Mesh::default() });
        assert_eq!(seen(&scene, &sun), 0.0);
    }

    /// With the eye along the normal, ∫ max(0, R·V)ⁿ cosθ dω = 2π/(n+2).
    #[test]
    fn specular_lobe_reflects_ks_of_light_from_everywhere() {
        let (steps, exponent) = (2000, 30.0);
        let brdf = Phong { kd: Vec3::splat(0.25), ks: Vec3::splat(0.5), exponent };
        let h = 0.5 * PI / f64::from(steps);
        let reflected: f64 = (0..steps)
            .map(|i| {
                let (sin, cos) = ((f64::from(i) + 0.5) * h).sin_cos();
                let to_light = DVec3::new(sin, 0.0, cos);
                let f = brdf.reflectance(DVec3::Z, to_light, DVec3::Z).x;
                f64::from(f) * cos * TAU * sin * h
            })
            .sum();
        assert!((reflected - 0.75).abs() < 1e-4, "{reflected}");
    }

    #[test]
    fn reflectance_is_reciprocal() {
        let brdf = Phong { kd: Vec3::splat(0.2), ks: Vec3::new(0.3, 0.4, 0.5), exponent: 7.0 };
        let a = DVec3::new(0.3, -0.2, 0.9).normalize();
        let b = DVec3::new(-0.5, 0.1, 0.4).normalize();
        let (there, back) = (brdf.reflectance(DVec3::Z, a, b), brdf.reflectance(DVec3::Z, b, a));
        assert!((there - back).length() < 1e-6, "{there} and {back}");
    }
}
