//! A camera's flight: key frames into one camera for each picture, and the scene about
//! it as it is then.

use super::{Animation, Camera, Moved, Scene};
use anyhow::Context as _;
use glam::{DAffine3, DQuat};

/// How far, in pictures, the last one may be past the end: a glTF rounds its
/// times to f32, which for the ten-thousandth picture is this much.
const SLACK: f64 = 1e-3;

/// The times of a flight's pictures in seconds: both ends, and `fps` a second.
///
/// `⌊duration · fps⌋ + 1` of them.
///
/// # Panics
///
/// If `fps` is not positive and finite.
pub(crate) fn times(animation: &Animation, fps: f64) -> impl ExactSizeIterator<Item = f64> {
    assert!(fps > 0.0 && fps.is_finite(), "{fps} pictures a second");
    let last = (animation.duration * fps + SLACK).floor() as u32;
    (0..last.saturating_add(1)).map(move |i| f64::from(i) / fps)
}

/// The camera of `animation` at a time; before and after it, as at its ends.
///
/// Between two keys the place moves along a line and the axes turn at a
/// constant rate.
///
/// # Panics
///
/// If `animation` is of a camera that `scene` does not have.
pub(crate) fn camera_at(animation: &Animation, scene: &Scene, seconds: f64) -> Camera {
    let mut camera = scene.cameras[animation.camera].clone();
    let keys = &animation.keys;
    let next = keys.partition_point(|key| key.0 <= seconds);
    match (next.checked_sub(1).map(|i| &keys[i]), keys.get(next)) {
        (Some((before, from)), Some((after, to))) => {
            let t = (seconds - before) / (after - before);
            camera.transform = between(from, to, t);
        }
        (Some((_, end)), None) | (None, Some((_, end))) => camera.transform = *end,
        // No keys, no motion.
        (None, None) => {}
    }
    camera
}

/// Brings what `animation` moves beside its camera to where it is at a time; returns
/// whether any of it is a mesh.
///
/// # Errors
///
/// If something is then nowhere: not finite, or a light without a direction.
///
/// # Panics
///
/// If `animation` is of another scene.
pub(crate) fn pose(animation: &Animation, scene: &mut Scene, seconds: f64) -> anyhow::Result<bool> {
    let mut meshes = false;
    for mover in &animation.movers {
        let world = mover.path.at(seconds);
        match &mover.moved {
            Moved::Mesh { index, shape } => {
                let mesh = &mut scene.meshes[*index];
                shape.place(world, mesh).with_context(|| {
                    format!("\"{}\" of animation \"{}\" at {seconds} s", mesh.name, animation.name)
                })?;
                meshes = true;
            }
            Moved::Light(index) => scene.lights[*index].place(&world).with_context(|| {
                format!("light {index} of animation \"{}\" at {seconds} s", animation.name)
            })?,
        }
    }
    Ok(meshes)
}

fn between(from: &DAffine3, to: &DAffine3, t: f64) -> DAffine3 {
    let turn = |place: &DAffine3| DQuat::from_mat3(&place.matrix3);
    DAffine3::from_rotation_translation(
        turn(from).slerp(turn(to), t),
        from.translation.lerp(to.translation, t),
    )
}

#[cfg(test)]
mod tests {
    use super::super::Projection;
    use super::*;
    use glam::DVec3;
    use std::f64::consts::FRAC_PI_2;

    /// A quarter turn about y and 4 m along x, from 1 s to 3 s.
    fn quarter_turn() -> (Animation, Scene) {
        let place = |angle: f64, x: f64| {
            DAffine3::from_rotation_translation(DQuat::from_rotation_y(angle), DVec3::X * x)
        };
        let keys = vec![(1.0, place(0.0, 0.0)), (3.0, place(FRAC_PI_2, 4.0))];
        let animation =
            Animation { name: "turn".into(), camera: 0, duration: 3.0, keys, movers: Vec::new() };
        let transform = DAffine3::IDENTITY;
        let projection = Projection::Perspective { yfov: 1.0 };
        let camera = Camera { name: "eye".into(), transform, projection, aspect: Some(1.5) };
        (animation, Scene { cameras: vec![camera], ..Scene::default() })
    }

    #[test]
    fn half_way_is_half_the_turn_and_half_the_line() {
        let (animation, scene) = quarter_turn();
        let camera = camera_at(&animation, &scene, 2.0);
        assert_eq!((camera.name.as_str(), camera.aspect), ("eye", Some(1.5)));
        let view = camera.transform.transform_vector3(DVec3::NEG_Z);
        let expected = DVec3::new(-1.0, 0.0, -1.0).normalize();
        assert!(view.abs_diff_eq(expected, 1e-12), "{view}");
        assert!(camera.transform.translation.abs_diff_eq(DVec3::X * 2.0, 1e-12), "half of 4 m");
    }

    #[test]
    fn outside_its_keys_the_camera_rests_at_their_ends() {
        let (animation, scene) = quarter_turn();
        for (seconds, x) in [(-1.0, 0.0), (0.0, 0.0), (1.0, 0.0), (3.0, 4.0), (99.0, 4.0)] {
            let camera = camera_at(&animation, &scene, seconds);
            assert_eq!(camera.transform.translation.x, x, "at {seconds} s");
        }
        let still = Animation { keys: Vec::new(), ..animation };
        assert_eq!(camera_at(&still, &scene, 1.0).transform, DAffine3::IDENTITY);
    }

    #[test]
    fn pictures_include_both_ends() {
        let (mut animation, _) = quarter_turn();
        let at = |animation: &Animation, fps| times(animation, fps).collect::<Vec<_>>();
        assert_eq!(at(&animation, 1.0), [0.0, 1.0, 2.0, 3.0]);
        // 239 frames of 1/24 s, in f32 as a glTF has it.
        animation.duration = f64::from(239.0_f32 / 24.0);
        assert_eq!(times(&animation, 24.0).len(), 240);
        animation.duration = 0.0;
        assert_eq!(at(&animation, 24.0), [0.0]);
    }
}
