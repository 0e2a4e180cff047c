//! Key frames of a glTF's cameras: channels, evaluated through the hierarchy.

use super::super::Animation;
use super::super::load::Warnings;
use super::accessor::Buffers;
use super::document::valid;
use super::nodes::{Hierarchy, Placement, label, quaternion, rigid};
use ::gltf::json::animation::{Interpolation, Property};
use ::gltf::json::{Animation as Json, Root};
use anyhow::{Context as _, ensure};
use glam::{DAffine3, DQuat, DVec3, DVec4};
use std::collections::HashMap;

/// Samples a second: a straight line between two of them is off by less than
/// a hundredth of what a camera in a hand moves.
const RATE: f64 = 60.0;

/// The most evenly spaced samples of one animation: 27 minutes at [`RATE`].
const MAX_SAMPLES: f64 = 1e5;

/// What happens to one node.
type Channels = Vec<Channel>;

/// One property of a node over time.
#[derive(Debug)]
struct Channel {
    property: Property,
    interpolation: Interpolation,
    /// Seconds, never decreasing; at least one.
    times: Vec<f64>,
    /// One a time, or three for a cubic spline: in-tangent, value, out-tangent.
    values: Vec<DVec4>,
}

/// One [`Animation`] for each of `json`'s animations and each camera it moves.
///
/// `cameras` are the nodes of the scene's cameras, in its order.
///
/// # Errors
///
/// If a channel that moves a camera is malformed.
pub(super) fn read(
    root: &Root,
    json: &[Json],
    buffers: &Buffers<'_>,
    hierarchy: &Hierarchy,
    cameras: &[usize],
    warnings: &mut Warnings,
) -> anyhow::Result<Vec<Animation>> {
    let chains: Vec<Vec<usize>> = cameras.iter().map(|&node| hierarchy.chain(node)).collect();
    let mut moves_camera = vec![false; root.nodes.len()];
    chains.iter().flatten().for_each(|&node| moves_camera[node] = true);

    let mut animations = Vec::new();
    for (i, animation) in json.iter().enumerate() {
        let name = animation.name.clone().unwrap_or_else(|| format!("animation{i}"));
        let mut channels: HashMap<usize, Channels> = HashMap::new();
        for channel in &animation.channels {
            let context = || format!("animation {name:?}");
            let node = channel.target.node.value();
            let moves = moves_camera.get(node).with_context(context);
            let moves = moves.with_context(|| format!("there is no node {node}"))?;
            let property = valid(&channel.target.path, "path").with_context(context)?;
            if !moves {
                warnings.ignored("the motion of nodes that carry no camera", &label(root, node));
            } else if property == Property::MorphTargetWeights {
                warnings.ignored("morph targets", &label(root, node));
            } else {
                let sampler = animation.samplers.get(channel.sampler.value());
                let sampler = sampler.context("a channel's sampler is not there");
                let read = sampler.and_then(|s| Channel::read(property, s, buffers));
                channels.entry(node).or_default().push(read.with_context(context)?);
            }
        }
        for (camera, chain) in chains.iter().enumerate() {
            if chain.iter().any(|node| channels.contains_key(node)) {
                let keys = sample(chain, &channels, hierarchy).with_context(|| {
                    format!("animation {name:?} of {}", label(root, cameras[camera]))
                })?;
                let duration = keys.last().map_or(0.0, |&(seconds, _)| seconds);
                animations.push(Animation { name: name.clone(), camera, duration, keys });
            }
        }
    }
    Ok(animations)
}

/// The camera's place from 0 s to the last key frame that moves it.
fn sample(
    chain: &[usize],
    channels: &HashMap<usize, Channels>,
    hierarchy: &Hierarchy,
) -> anyhow::Result<Vec<(f64, DAffine3)>> {
    let moving = || chain.iter().filter_map(|node| channels.get(node)).flatten();
    let duration = moving().filter_map(|c| c.times.last()).copied().fold(0.0, f64::max);
    let steps = (duration * RATE).ceil().clamp(1.0, MAX_SAMPLES);
    let mut seconds: Vec<f64> =
        (0..=steps as u32).map(|i| duration * f64::from(i) / steps).collect();
    for channel in moving() {
        for &time in channel.times.iter().filter(|&&t| t > 0.0) {
            seconds.push(time);
            if channel.interpolation == Interpolation::Step {
                // A jump, as close to one as a line between two times can be.
                seconds.push(time.next_down());
            }
        }
    }
    seconds.sort_by(f64::total_cmp);
    seconds.dedup();
    let key = |seconds| {
        let world = chain.iter().fold(DAffine3::IDENTITY, |above, node| {
            let rest = hierarchy.local[*node];
            let moved = channels.get(node).map_or(rest, |c| pose(rest, c, seconds));
            above * moved.to_affine()
        });
        let rigid = rigid(&world).filter(|t| t.is_finite());
        Ok((seconds, rigid.with_context(|| format!("at {seconds} s it has no direction"))?))
    };
    seconds.into_iter().map(key).collect()
}

/// A node's placement with its animated properties replaced.
fn pose(rest: Placement, channels: &Channels, seconds: f64) -> Placement {
    let (mut translation, mut rotation, mut scale) = match rest {
        Placement::Parts { translation, rotation, scale } => (translation, rotation, scale),
        // Not allowed by glTF, yet only a sheared matrix would lose by it.
        Placement::Matrix(matrix) => {
            let (scale, rotation, translation) = matrix.to_scale_rotation_translation();
            (translation, rotation, scale)
        }
    };
    for channel in channels {
        let value = channel.at(seconds);
        match channel.property {
            Property::Translation => translation = value.truncate(),
            Property::Scale => scale = value.truncate(),
            Property::Rotation => rotation = DQuat::from_vec4(value),
            Property::MorphTargetWeights => {}
        }
    }
    Placement::Parts { translation, rotation, scale }
}

impl Channel {
    fn read(
        property: Property,
        sampler: &::gltf::json::animation::Sampler,
        buffers: &Buffers<'_>,
    ) -> anyhow::Result<Self> {
        let interpolation = valid(&sampler.interpolation, "interpolation")?;
        let times = buffers.floats::<1>(sampler.input)?;
        let times: Vec<f64> = times.into_iter().map(|[t]| f64::from(t)).collect();
        ensure!(!times.is_empty(), "a channel has no key frames");
        let increasing = times.is_sorted() && times.iter().all(|t| t.is_finite());
        ensure!(increasing, "the times of its key frames do not increase");
        let values: Vec<DVec4> = if property == Property::Rotation {
            let values = buffers.floats::<4>(sampler.output)?;
            values.into_iter().map(|v| DVec4::from(v.map(f64::from))).collect()
        } else {
            let values = buffers.floats::<3>(sampler.output)?;
            values.into_iter().map(|v| DVec3::from(v.map(f64::from)).extend(0.0)).collect()
        };
        let per_key = if interpolation == Interpolation::CubicSpline { 3 } else { 1 };
        let (keys, expected) = (values.len(), times.len() * per_key);
        ensure!(keys == expected, "{keys} values where {expected} belong to its key frames");
        ensure!(values.iter().all(|v| v.is_finite()), "a value is not finite");
        let channel = Self { property, interpolation, times, values };
        if property == Property::Rotation {
            let turns = (0..channel.times.len())
                .all(|k| quaternion(channel.value(k).as_vec4().to_array()).is_some());
            ensure!(turns, "a rotation is zero");
        }
        Ok(channel)
    }

    /// The value of key frame `k`.
    fn value(&self, k: usize) -> DVec4 {
        match self.interpolation {
            Interpolation::CubicSpline => self.values[3 * k + 1],
            _ => self.values[k],
        }
    }

    /// The value at a time; before the first key frame and after the last, theirs.
    ///
    /// A rotation is returned as a unit quaternion. glTF 2.0, appendix C.
    fn at(&self, seconds: f64) -> DVec4 {
        let next = self.times.partition_point(|&t| t <= seconds);
        let value = if next == 0 {
            self.value(0)
        } else if next == self.times.len() {
            self.value(next - 1)
        } else {
            let (k, span) = (next - 1, self.times[next] - self.times[next - 1]);
            let t = (seconds - self.times[k]) / span;
            match (self.interpolation, self.property) {
                (Interpolation::Step, _) => self.value(k),
                (Interpolation::Linear, Property::Rotation) => {
                    let turn = |k| DQuat::from_vec4(self.value(k)).normalize();
                    turn(k).slerp(turn(next), t).into()
                }
                (Interpolation::Linear, _) => self.value(k).lerp(self.value(next), t),
                (Interpolation::CubicSpline, _) => {
                    let (t2, t3) = (t * t, t * t * t);
                    let (leaving, arriving) = (self.values[3 * k + 2], self.values[3 * next]);
                    self.value(k) * (2.0 * t3 - 3.0 * t2 + 1.0)
                        + leaving * (span * (t3 - 2.0 * t2 + t))
                        + self.value(next) * (3.0 * t2 - 2.0 * t3)
                        + arriving * (span * (t3 - t2))
                }
            }
        };
        match self.property {
            // A spline can pass through zero, where no turn is meant.
            Property::Rotation => value.try_normalize().unwrap_or(DVec4::W),
            _ => value,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{accessors, load_value};
    use super::*;
    use serde_json::{Value, json};

    /// A camera under an arm that is 2 m long, both animated as `channels` say.
    fn arm(
        arrays: &[(&str, &[f32])],
        samplers: Value,
        channels: Value,
    ) -> anyhow::Result<Vec<Animation>> {
        let mut value = accessors(arrays);
        value["cameras"] =
            json!([{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}]);
        value["nodes"] = json!([
            {"name": "arm", "children": [1]},
            {"name": "eye", "translation": [0, 0, 2], "camera": 0},
            {"name": "fan"}
        ]);
        value["animations"] = json!([{"name": "fly", "samplers": samplers, "channels": channels}]);
        load_value(&value).map(|loaded| loaded.scene.animations)
    }

    fn one(interpolation: &str, path: &str) -> (Value, Value) {
        (
            json!([{"input": 0, "output": 1, "interpolation": interpolation}]),
            json!([{"sampler": 0, "target": {"node": 0, "path": path}}]),
        )
    }

    fn at(animation: &Animation, seconds: f64) -> DVec3 {
        let key = animation.keys.iter().find(|k| k.0 >= seconds).expect("before the end");
        assert!((key.0 - seconds).abs() < 1e-9, "no sample at {seconds}");
        key.1.translation
    }

    #[test]
    fn an_ancestors_rotation_swings_the_camera() {
        let (samplers, channels) = one("LINEAR", "rotation");
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let turns = [0.0, 0.0, 0.0, 1.0, 0.0, half, 0.0, half];
        let arrays: [(&str, &[f32]); 2] = [("SCALAR", &[0.0, 1.0]), ("VEC4", &turns)];
        let animations = arm(&arrays, samplers, channels).expect("valid");
        let [fly] = &animations[..] else { panic!("one camera, one animation") };
        assert_eq!((fly.name.as_str(), fly.camera, fly.duration), ("fly", 0, 1.0));
        // A quarter turn about y takes the arm from +z to +x; half way, to 45°.
        let diagonal = 2.0_f64.sqrt();
        for (seconds, expected) in [
            (0.0, DVec3::Z * 2.0),
            (0.5, DVec3::new(diagonal, 0.0, diagonal)),
            (1.0, DVec3::X * 2.0),
        ] {
            let eye = at(fly, seconds);
            assert!(eye.abs_diff_eq(expected, 1e-6), "{seconds} s: {eye}");
        }
        assert!(fly.keys.is_sorted_by(|a, b| a.0 < b.0), "times increase");
    }

    #[test]
    fn a_step_jumps_at_its_key_frame() {
        let (samplers, channels) = one("STEP", "translation");
        let arrays: [(&str, &[f32]); 2] =
            [("SCALAR", &[0.0, 0.25, 1.0]), ("VEC3", &[0.0; 9].map(|x: f32| x))];
        let mut shifts = [0.0_f32; 9];
        (shifts[3], shifts[6]) = (5.0, 7.0);
        let arrays = [arrays[0], ("VEC3", &shifts[..])];
        let fly = &arm(&arrays, samplers, channels).expect("valid")[0];
        assert_eq!(at(fly, 0.25).x, 5.0);
        assert_eq!(at(fly, 0.25_f64.next_down()).x, 0.0);
        assert_eq!(at(fly, 1.0_f64.next_down()).x, 5.0);
        assert_eq!(at(fly, 1.0).x, 7.0);
    }

    #[test]
    fn a_cubic_spline_follows_its_tangents() {
        let (samplers, channels) = one("CUBICSPLINE", "translation");
        // x = t³ over 2 s: values 0 and 8, slopes 0 and 12 a second.
        let mut spline = [0.0_f32; 18];
        (spline[12], spline[9]) = (8.0, 12.0);
        let arrays: [(&str, &[f32]); 2] = [("SCALAR", &[0.0, 2.0]), ("VEC3", &spline)];
        let fly = &arm(&arrays, samplers, channels).expect("valid")[0];
        for &(seconds, place) in &fly.keys {
            assert!((place.translation.x - seconds.powi(3)).abs() < 1e-9, "at {seconds} s");
        }
        assert_eq!(fly.keys.len(), 121);
    }

    #[test]
    fn nodes_without_a_camera_are_left_where_they_are() {
        let (samplers, mut channels) = one("LINEAR", "translation");
        channels[0]["target"]["node"] = json!(2);
        let arrays: [(&str, &[f32]); 2] = [("SCALAR", &[0.0]), ("VEC3", &[1.0, 0.0, 0.0])];
        assert!(arm(&arrays, samplers, channels).expect("valid").is_empty(), "nothing moves");
    }

    #[test]
    fn a_late_or_endless_animation_starts_at_zero_and_is_bounded() {
        let (samplers, channels) = one("LINEAR", "translation");
        let arrays: [(&str, &[f32]); 2] =
            [("SCALAR", &[5.0, 1e30]), ("VEC3", &[1.0, 0.0, 0.0, 3.0, 0.0, 0.0])];
        let fly = &arm(&arrays, samplers, channels).expect("valid")[0];
        assert_eq!(fly.keys[0].0, 0.0);
        assert_eq!(at(fly, 0.0).x, 1.0);
        assert!(fly.keys.len() < 100_010, "{} keys", fly.keys.len());
    }

    #[test]
    fn malformed_channels_are_errors() {
        let moved: &[f32] = &[0.0; 6];
        for (times, shape, values, expected) in [
            (&[1.0, 0.5][..], "VEC3", moved, "do not increase"),
            (&[0.0, f32::NAN][..], "VEC3", moved, "do not increase"),
            (&[0.0][..], "VEC3", moved, "2 values where 1 belong"),
            (&[0.0, 1.0][..], "VEC3", &[f32::INFINITY; 6][..], "a value is not finite"),
            (&[0.0, 1.0, 2.0][..], "VEC2", moved, "it is a Vec2, not of 3 components"),
            (&[][..], "VEC3", &[][..], "has no key frames"),
        ] {
            let (samplers, channels) = one("LINEAR", "translation");
            let result = arm(&[("SCALAR", times), (shape, values)], samplers, channels);
            let text = format!("{:#}", result.expect_err("malformed"));
            assert!(text.contains("animation \"fly\"") && text.contains(expected), "{text}");
        }
        for (path, node, sampler, expected) in [
            ("translation", 9, 0, "there is no node 9"),
            ("translation", 0, 9, "a channel's sampler is not there"),
            ("sideways", 0, 0, "path has a value"),
            ("rotation", 0, 0, "not of 4 components"),
        ] {
            let (samplers, mut channels) = one("LINEAR", path);
            channels[0]["target"]["node"] = json!(node);
            channels[0]["sampler"] = json!(sampler);
            let result = arm(&[("SCALAR", &[0.0, 1.0]), ("VEC3", moved)], samplers, channels);
            let text = format!("{:#}", result.expect_err("malformed"));
            assert!(text.contains(expected), "{text}");
        }
        let (samplers, channels) = one("LINEAR", "scale");
        let result = arm(&[("SCALAR", &[0.0, 1.0]), ("VEC3", moved)], samplers, channels);
        let text = format!("{:#}", result.expect_err("scaled to nothing"));
        assert!(text.contains("at 0 s it has no direction"), "{text}");
    }
}
