//! The ray tree: radiance along a ray, after T. Whitted, *An Improved
//! Illumination Model for Shaded Display*, CACM 23(6), 1980.
//!
//! Light reaches a surface from punctual lights, from area emitters and from
//! mirrors and glass by recursive rays. Where a wavelet patch lies on the
//! surface, the patch replaces the area emitters.

mod first;
mod patch;
mod refraction;
mod turns;
mod waves;

use crate::{
    accel::{Accel, Hit},
    camera::Beam,
    emitters::{AreaEmitter, R2, lobe_factor},
    phong::{Surface, Unshadowed},
    scene::{Lobe, Scene},
};
pub(crate) use first::First;
use glam::{DVec2, DVec3, Vec3};
use patch::beside;
pub(crate) use patch::{Beside, PatchRadiance};
use refraction::Refraction;
use turns::Turn;
pub(crate) use waves::Waves;

/// Rays that can change a pixel by less than this, relative to the radiance
/// they would find, are not followed.
const MIN_WEIGHT: f32 = 1e-3;

/// What all rays of a picture share.
pub(crate) struct Whitted<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) accel: &'a Accel,
    pub(crate) patches: Option<&'a dyn PatchRadiance>,
    pub(crate) emitters: Vec<AreaEmitter>,
    /// Mirror and glass surfaces in a row; 0 sees none of them.
    pub(crate) max_depth: u32,
    /// Radiance of rays that leave the scene.
    pub(crate) background: Vec3,
}

/// One camera ray's share of randomness, and what its tree cost.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sample {
    /// Where on the emitters' cells to look, in [0, 1)².
    pub(crate) place: DVec2,
    /// Which of the pixel's camera rays it is.
    pub(crate) index: u32,
    /// How many of them share the shadow rays of weak lights; 0 and 1 for none.
    pub(crate) of: u32,
    /// The pixel's own bits.
    pub(crate) scramble: u64,
    /// Rays cast, shadow rays included.
    pub(crate) rays: u64,
    /// Patches found.
    pub(crate) look_ups: u64,
    /// What arrives, so far.
    pub(crate) radiance: Vec3,
}

/// Room for the lights of one surface.
#[derive(Debug, Default)]
struct Room {
    lights: Vec<Unshadowed>,
    /// Of those that are looked for: the radiance that each stands for, its shadow ray,
    /// and what that finds.
    wanted: Vec<Vec3>,
    rays: Vec<(DVec3, f64)>,
    visible: Vec<f32>,
}

/// How many surfaces with alpha in a row a ray sees through.
const MAX_LAYERS: u32 = 64;

impl Whitted<'_> {
    /// Radiance that arrives along `beam`.
    #[cfg(test)]
    fn radiance(&self, beam: &Beam, sample: &mut Sample) -> Vec3 {
        sample.radiance = Vec3::ZERO;
        self.trace(&[*beam], std::slice::from_mut(sample), &mut Waves::default());
        sample.radiance
    }

    /// What `beam` meets next after the distance `from`.
    fn next(&self, beam: &Beam, from: f64) -> Option<Hit> {
        self.accel.closest(beam.origin, beam.direction, from, f64::INFINITY)
    }

    /// Radiance that the surface itself sends to the eye, from its front only.
    fn emitted(&self, surface: &Surface<'_>, hit: &Hit) -> Vec3 {
        let material = surface.material;
        if !hit.front || surface.emission == Vec3::ZERO {
            return Vec3::ZERO;
        }
        let lobe = material.lobe.as_ref().map_or(1.0, |lobe| {
            if let Some(window) = &lobe.window {
                return window.radiance(surface.to_eye);
            }
            let matrix = self.scene.meshes[hit.mesh].transform.matrix3;
            let peak = (matrix * lobe.peak).normalize_or_zero();
            lobe_factor(&Lobe { peak, ..lobe.clone() }, surface.to_eye)
        });
        surface.emission * lobe as f32
    }

    /// Radiance that the surface reflects of lights and emitters.
    fn local(
        &self,
        surface: &Surface<'_>,
        hit: &Hit,
        beam: &Beam,
        depth: u32,
        sample: &mut Sample,
        room: &mut Room,
    ) -> Vec3 {
        let mut unshadowed = surface.ambient(self.scene.ambient);
        let lights = &mut room.lights;
        lights.clear();
        lights.extend(self.scene.lights.iter().filter_map(|light| surface.lit_by(light)));
        // Another place on each emitter and at each depth.
        let (first, count) = (sample.place, self.emitters.len() as f64);
        let place = |i: usize| (first + (i as f64 + f64::from(depth) * count) * R2).fract_gl();
        // Patches do not hold it.
        let sunlight = |(i, emitter): (usize, &AreaEmitter)| emitter.sunlight(surface, place(i));
        lights.extend(self.emitters.iter().enumerate().filter_map(sunlight));
        let patch = self.patches.filter(|_| hit.front).and_then(|patches| {
            let beside = beside(beam, hit);
            let (position, to_eye) = (surface.position, surface.to_eye);
            patches.outgoing_over(hit.mesh, hit.triangle, position, to_eye, &beside, sample)
        });
        if let Some(outgoing) = patch {
            sample.look_ups += 1;
            unshadowed += outgoing;
        } else if !surface.brdf.is_black() {
            for (i, emitter) in self.emitters.iter().enumerate() {
                emitter.illuminate(surface, place(i), lights);
            }
        }
        let total = unshadowed + lights.iter().map(|light| light.radiance).sum::<Vec3>();
        let turn = Turn { of: sample.of, index: sample.index, scramble: sample.scramble };
        let start = self.accel.leave(surface.position, surface.geometric, surface.geometric);
        room.wanted.clear();
        room.rays.clear();
        for (i, light) in lights.iter().enumerate() {
            let weight = turn.weight(i, light, total.max_element());
            if weight > 0.0 {
                room.wanted.push(weight * light.radiance);
                room.rays.push(light.source.seen_from(start));
            }
        }
        self.accel.visibility_of(start, &room.rays, &mut room.visible);
        sample.rays += room.rays.len() as u64;
        let arrived =
            room.wanted.iter().zip(&room.visible).map(|(wanted, visible)| wanted * visible);
        arrived.fold(unshadowed, |sum, light| sum + light)
    }

    /// Calls `follow` with the beams by mirror reflection and by refraction, and what of
    /// the radiance that they find goes back along the beam.
    fn secondary(&self, surface: &Surface<'_>, beam: &Beam, mut follow: impl FnMut(Beam, Vec3)) {
        let material = surface.material;
        let clear = material.transmission.clamp(0.0, 1.0);
        let about = mirror_normal(surface, beam.direction);
        let mirrored =
            |direction: DVec3| (direction - 2.0 * direction.dot(about) * about).normalize();
        let (position, geometric) = (surface.position, surface.geometric);
        if clear > 0.0 {
            let bent = Refraction::new(surface, beam.direction);
            let reflected = Vec3::splat(bent.fresnel as f32 * clear);
            follow(beam.turned(position, geometric, mirrored), reflected);
            if let Some(refracted) = bent.direction {
                let colour = material.filter.unwrap_or(surface.colour);
                let weight = (1.0 - bent.fresnel as f32) * clear * colour;
                // Beside the ray, as it is bent; past the critical angle, along with it.
                let bend = |direction: DVec3| {
                    Refraction::new(surface, direction).direction.unwrap_or(refracted)
                };
                follow(beam.turned(position, geometric, bend), weight);
            }
        } else if material.mirror {
            follow(beam.turned(position, geometric, mirrored), material.ks);
        }
    }
}

/// The normal that a mirror reflects about. Where the interpolated one would send
/// the ray into the surface, the triangle's own decides.
fn mirror_normal(surface: &Surface<'_>, direction: DVec3) -> DVec3 {
    let n = surface.normal;
    let reflected = direction - 2.0 * direction.dot(n) * n;
    if reflected.dot(surface.geometric) > 0.0 { n } else { surface.geometric }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Alpha, LightKind, Material, Mesh, PunctualLight};

    const LAMP: Vec3 = Vec3::new(2.0, 3.0, 5.0);

    /// A 20 m square at height `y` that faces up or down.
    fn square(y: f64, up: bool, material: usize) -> Mesh {
        let corners = [[-10.0, 10.0], [10.0, 10.0], [10.0, -10.0], [-10.0, -10.0]];
        let triangles = if up { [[0, 1, 2], [0, 2, 3]] } else { [[0, 2, 1], [0, 3, 2]] };
        Mesh {
            positions: corners.map(|[x, z]| DVec3::new(x, y, z)).to_vec(),
            triangles: triangles.to_vec(),
            material,
            ..Mesh::default()
        }
    }

    fn black() -> Material {
        Material { kd: Vec3::ZERO, ..Material::default() }
    }

    /// What a ray from `eye` along `direction` finds.
    fn seen(scene: &Scene, patches: Option<&dyn PatchRadiance>, eye: DVec3, to: DVec3) -> Vec3 {
        let accel = Accel::new(scene);
        let whitted = Whitted {
            scene,
            accel: &accel,
            patches,
            emitters: AreaEmitter::all(scene, 8),
            max_depth: 8,
            background: Vec3::new(0.25, 0.0, 0.0),
        };
        let mut sample = Sample { place: DVec2::splat(0.5), ..Sample::default() };
        whitted.radiance(&Beam::thin(eye, to.normalize()), &mut sample)
    }

    /// A lamp at height 4 over a square of `material` at height 0.
    fn lamp_over(material: Material) -> Scene {
        Scene {
            meshes: vec![square(0.0, true, 0), square(4.0, false, 1)],
            materials: vec![material, Material { emission: LAMP, ..black() }],
            ..Scene::default()
        }
    }

    #[test]
    fn mirror_shows_ks_of_what_it_reflects() {
        let ks = Vec3::new(0.5, 0.25, 1.0);
        let scene = lamp_over(Material { ks, mirror: true, ..black() });
        let eye = DVec3::new(0.0, 1.0, 0.0);
        assert_eq!(seen(&scene, None, eye, DVec3::new(1.0, -1.0, 0.0)), ks * LAMP);
        assert_eq!(seen(&scene, None, eye, DVec3::Y), LAMP);
        assert_eq!(seen(&scene, None, eye, DVec3::X), Vec3::new(0.25, 0.0, 0.0), "background");
    }

    #[test]
    fn facing_mirrors_end_at_the_depth_limit() {
        let mirror = Material { ks: Vec3::ONE, mirror: true, ..black() };
        let mut scene = lamp_over(mirror);
        scene.meshes[1].material = 0;
        assert_eq!(seen(&scene, None, DVec3::Y, DVec3::Y), Vec3::ZERO);
    }

    /// A lamp of 8 x 8 cells, half of it behind a screen: each camera ray of a pixel looks
    /// for some of them, all together as if each looked for all.
    #[test]
    fn camera_rays_of_a_pixel_share_the_shadow_rays() {
        let mut scene = lamp_over(Material::default());
        let mut screen = square(2.0, true, 0);
        screen.positions.iter_mut().for_each(|p| p.x += 10.3);
        scene.meshes.push(screen);
        let accel = Accel::new(&scene);
        let whitted = Whitted {
            scene: &scene,
            accel: &accel,
            patches: None,
            emitters: AreaEmitter::all(&scene, 8),
            max_depth: 8,
            background: Vec3::ZERO,
        };
        let eye = Beam::thin(DVec3::Y, DVec3::new(0.0, -1.0, 0.1).normalize());
        let seen = |index, of| {
            let place = DVec2::splat(0.5);
            let mut sample = Sample { place, index, of, scramble: 11, ..Sample::default() };
            (whitted.radiance(&eye, &mut sample), sample.rays)
        };
        let (all, rays) = seen(0, 1);
        assert_eq!(rays, 65, "one to the floor and one to each cell");
        assert!(all.min_element() > 0.0, "{all}");
        let turns: Vec<(Vec3, u64)> = (3..11).map(|index| seen(index, 8)).collect();
        let mean = turns.iter().map(|turn| turn.0).sum::<Vec3>() / 8.0;
        assert!(mean.abs_diff_eq(all, 1e-5 * all.max_element()), "{mean}, not {all}");
        let shared: u64 = turns.iter().map(|turn| turn.1).sum();
        assert!(shared < 8 * rays / 3, "{shared} rays");
    }

    fn glass() -> Material {
        Material { kd: Vec3::ONE, transmission: 1.0, ior: 1.5, ..Material::default() }
    }

    /// At normal incidence F = ((η−1)/(η+1))² = 0.04 for η = 1.5.
    #[test]
    fn glass_reflects_and_refracts_by_fresnel() {
        let mut scene = lamp_over(glass());
        let from_below = seen(&scene, None, DVec3::NEG_Y, DVec3::Y);
        // A ray from inside the solid: nothing but background is in there.
        let expected = 0.96 * LAMP + 0.04 * Vec3::new(0.25, 0.0, 0.0);
        assert!((from_below - expected).length() < 1e-6, "{from_below}");
        let from_above = seen(&scene, None, DVec3::Y, DVec3::NEG_Y);
        let expected = 0.04 * LAMP + 0.96 * Vec3::new(0.25, 0.0, 0.0);
        assert!((from_above - expected).length() < 1e-6, "{from_above}");
        // A thin pane reflects 2F/(1+F).
        scene.materials[0].double_sided = true;
        let pane = seen(&scene, None, DVec3::Y, DVec3::NEG_Y);
        let f = 0.08 / 1.04;
        let expected = f * LAMP + (1.0 - f) * Vec3::new(0.25, 0.0, 0.0);
        assert!((pane - expected).length() < 1e-6, "{pane}");
    }

    /// The critical angle of η = 1.5 is 41.81°.
    #[test]
    fn glass_reflects_totally_beyond_the_critical_angle() {
        let mut scene = lamp_over(glass());
        scene.meshes.push(square(-2.0, true, 2));
        let floor = Vec3::new(0.0, 0.0, 7.0);
        scene.materials.push(Material { emission: floor, ..black() });
        let from_inside = |degrees: f64| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            seen(&scene, None, DVec3::NEG_Y, DVec3::new(sin, cos, 0.0))
        };
        assert_eq!(from_inside(42.0), floor);
        let refracted = from_inside(41.0);
        assert!(refracted.x > 0.0 && refracted.z > 5.0 * 0.5, "{refracted}");
        // Snell: the refracted ray lands where sin t = 1.5 sin i says.
        let sin = 1.5 * 20.0_f64.to_radians().sin();
        let accel = Accel::new(&scene);
        let (s, c) = 20.0_f64.to_radians().sin_cos();
        let hit = accel
            .closest(DVec3::NEG_Y, DVec3::new(s, c, 0.0), 0.0, 9.0)
            .expect("the glass from inside");
        let direction = DVec3::new(s, c, 0.0);
        let bent = Refraction::new(&Surface::new(&scene, &hit, -direction), direction);
        let bent = bent.direction.expect("below the critical angle");
        assert!((bent.x - sin).abs() < 1e-12 && bent.y > 0.0, "{bent}");
    }

    /// White in a white world: glass neither adds nor takes.
    #[test]
    fn clear_glass_conserves_energy_in_a_uniform_world() {
        let scene = Scene {
            meshes: vec![square(0.0, true, 0)],
            materials: vec![glass()],
            ..Scene::default()
        };
        for x in [0.0, 0.5, 1.0, 3.0] {
            let seen = seen(&scene, None, DVec3::Y, DVec3::new(x, -1.0, 0.2));
            assert!((seen.x - 0.25).abs() < 1e-6, "{seen}");
        }
    }

    struct Everywhere(Vec3);

    impl PatchRadiance for Everywhere {
        fn outgoing(&self, mesh: usize, _: u32, _: DVec3, _: DVec3, _: &Sample) -> Option<Vec3> {
            (mesh == 0).then_some(self.0)
        }
    }

    #[test]
    fn patch_replaces_area_emitters_on_its_front_and_nothing_else() {
        let mut scene = lamp_over(Material { kd: Vec3::ONE, ..Material::default() });
        scene.ambient = Vec3::splat(0.125);
        let patch = Everywhere(Vec3::splat(10.0));
        let above = DVec3::new(0.0, 1.0, 0.0);
        assert_eq!(seen(&scene, Some(&patch), above, DVec3::NEG_Y), Vec3::splat(10.125));
        let gathered = seen(&scene, None, above, DVec3::NEG_Y);
        assert!(gathered.x > 0.5 * LAMP.x && gathered.x < LAMP.x + 0.125, "{gathered}");
        let below = seen(&scene, Some(&patch), -above, DVec3::Y);
        assert_eq!(below, Vec3::splat(0.125), "the back has no patch");
    }

    #[test]
    fn alpha_shows_what_is_behind_by_its_rest() {
        let pane = |factor: f32| Material {
            kd: Vec3::ZERO,
            emission: Vec3::splat(8.0),
            alpha: Alpha::Blend { factor },
            ..Material::default()
        };
        let lamp = Material { emission: LAMP, ..black() };
        let scene = |factor| Scene {
            meshes: vec![square(1.0, true, 0), square(0.5, true, 0), square(0.0, true, 1)],
            materials: vec![pane(factor), lamp.clone()],
            ..Scene::default()
        };
        let down = |scene: &Scene| seen(scene, None, DVec3::Y * 2.0, DVec3::NEG_Y);
        assert_eq!(down(&scene(0.0)), LAMP);
        assert_eq!(down(&scene(1.0)), Vec3::splat(8.0));
        // Two panes: ¼ · 8 + ¾ · (¼ · 8 + ¾ · lamp).
        let expected = Vec3::splat(2.0 + 1.5) + 0.5625 * LAMP;
        assert!((down(&scene(0.25)) - expected).length() < 1e-5, "{}", down(&scene(0.25)));
        // Half the light of a lamp above comes through to the floor.
        let floor = |factor| {
            let mut scene = scene(factor);
            scene.meshes.remove(0);
            scene.materials = vec![pane(factor), Material { kd: Vec3::ONE, ..Material::default() }];
            scene.materials[0].emission = Vec3::ZERO;
            scene.lights.push(PunctualLight {
                intensity: Vec3::ONE,
                position: DVec3::ZERO,
                direction: DVec3::NEG_Y,
                kind: LightKind::Directional,
                range: None,
            });
            // Off the panes' diagonals, where a shadow ray meets both triangles.
            seen(&scene, None, DVec3::new(0.3, 0.25, 0.1), DVec3::NEG_Y)
        };
        assert!((floor(0.5) - 0.5 * floor(0.0)).length() < 1e-6, "{}", floor(0.5));
    }
}
