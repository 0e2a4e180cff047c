//! How much of the light that a bake carries goes through objects.

use super::{Receiver, check::spread, emissions, receivers};
use crate::accel::Accel;
use crate::phong::Source;
use crate::scene::Scene;
use glam::DVec2;
use rayon::prelude::*;
use wrt_core::{Emission, Polygon};

/// Points of a receiver, and those of all emitters that each of them looks for.
const POINTS: usize = 64;
const LOOKS: usize = 64;

/// What objects keep from the receivers: nothing of it is taken off a bake, in which light
/// goes straight from emitters to receivers.
#[derive(Clone, Debug, Default)]
pub(crate) struct Blocked {
    /// Of the irradiance of all receivers together, 0 to 1.
    pub(crate) share: f64,
    /// Of that receiver's which loses most, and its name.
    pub(crate) worst: (f64, String),
}

/// Irradiance in arbitrary units, and what of it would arrive.
#[derive(Clone, Copy, Default)]
struct Light {
    all: f64,
    arrived: f64,
}

impl Light {
    fn share(self) -> f64 {
        if self.all > 0.0 { (1.0 - self.arrived / self.all).clamp(0.0, 1.0) } else { 0.0 }
    }
}

/// Looks along lines from well-spread points of each receiver to such of each emitter:
/// within some 3 % of all light, and the same for any number of threads.
///
/// # Errors
///
/// If a polygon cannot be used; by name.
pub(crate) fn blocked(scene: &Scene, accel: &Accel) -> anyhow::Result<Blocked> {
    /// Finer than what stands in the way is likely to be told from.
    const LEVEL: u8 = 5;
    let emitters = emissions(scene, Some(LEVEL))?;
    let receivers = receivers(scene, &mut Vec::new())?;
    let (mut sum, mut worst) = (Light::default(), (0.0, String::new()));
    for receiver in &receivers {
        let points = (0..POINTS).into_par_iter().map(|i| at_point(i, receiver, &emitters, accel));
        let points: Vec<Light> = points.collect();
        let own = points.iter().fold(Light::default(), |sum, point| Light {
            all: sum.all + point.all,
            arrived: sum.arrived + point.arrived,
        });
        if own.share() > worst.0 {
            worst = (own.share(), receiver.planar.name.clone());
        }
        // Points of larger receivers stand for more.
        let area = receiver.polygon.area();
        sum = Light { all: sum.all + area * own.all, arrived: sum.arrived + area * own.arrived };
    }
    Ok(Blocked { share: sum.share(), worst })
}

/// At the `i`-th point of a receiver.
fn at_point(
    i: usize,
    receiver: &Receiver,
    emitters: &[(Polygon, Emission)],
    accel: &Accel,
) -> Light {
    let frame = receiver.polygon.frame();
    let size = receiver.polygon.size().unwrap_or_default();
    let [u, v, ..] = spread(i as u64);
    let point = frame.point(DVec2::new(u, v) * size);
    let start = accel.leave(point, frame.n, frame.n);
    let each = LOOKS.div_ceil(emitters.len()).max(2);
    let (mut rays, mut weights) = (Vec::new(), Vec::new());
    for (polygon, emission) in emitters {
        let (source, size) = (polygon.frame(), polygon.size().unwrap_or_default());
        let side = 1_usize << emission.level();
        for k in 0..each {
            let [.., s, t] = spread((i * each + k) as u64);
            let st = DVec2::new(s, t);
            let cell = (st * side as f64).as_uvec2().min(glam::UVec2::splat(side as u32 - 1));
            let radiance = emission.picture()[cell.y as usize * side + cell.x as usize];
            let from = source.point(st * size);
            let path = from - point;
            let towards = path.normalize_or_zero();
            let (leaves, arrives) = (-source.n.dot(towards), frame.n.dot(towards));
            if leaves <= 0.0 || arrives <= 0.0 {
                continue;
            }
            let lobe = emission.lobe().eval(source.to_local(-towards));
            let brightness: f64 = radiance.into_iter().map(f64::from).sum();
            let kernel = leaves * arrives / path.length_squared();
            let weight = brightness * lobe * kernel * size.element_product();
            if weight > 0.0 {
                weights.push(weight);
                rays.push(Source::Point(from).seen_from(start));
            }
        }
    }
    let mut visible = Vec::new();
    accel.visibility_of(start, &rays, &mut visible);
    let arrived = weights.iter().zip(&visible).map(|(weight, seen)| weight * f64::from(*seen));
    Light { all: weights.iter().sum(), arrived: arrived.sum() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, surfaces::rectangle};
    use glam::{DVec3, Vec3};

    /// A floor 4 m a side, a small lamp 2 m over its middle, and at half the height a
    /// board over half of what the lamp lights, whose mirror image on the other side is
    /// open.
    fn under_a_board(board: bool) -> Blocked {
        let lamp = Material { emission: Vec3::ONE, ..Material::default() };
        let (x, z) = (DVec3::X, DVec3::Z);
        let mut meshes = vec![
            rectangle("floor", DVec3::new(-2.0, 0.0, -2.0), z * 4.0, x * 4.0, 0),
            rectangle("lamp", DVec3::new(-0.05, 2.0, -0.05), x * 0.1, z * 0.1, 1),
        ];
        if board {
            meshes.push(rectangle("board", DVec3::new(0.0, 1.0, -2.0), z * 4.0, x * 2.0, 0));
        }
        meshes[0].receiver = true;
        let scene =
            Scene { meshes, materials: vec![Material::default(), lamp], ..Scene::default() };
        blocked(&scene, &Accel::new(&scene)).expect("planes")
    }

    #[test]
    fn a_board_over_half_a_floor_keeps_half_of_the_light() {
        let found = under_a_board(true);
        assert!((found.share - 0.5).abs() < 0.03, "{found:?}");
        assert_eq!(found.worst, (found.share, "floor".to_owned()));
    }

    #[test]
    fn neither_the_lamp_nor_the_floor_is_in_its_own_way() {
        assert_eq!(under_a_board(false).share, 0.0);
    }
}
