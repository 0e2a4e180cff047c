//! Key frames of a glTF's nodes: channels, evaluated through the hierarchy.

use super::super::load::Warnings;
use super::super::{Animation, Moved, Mover};
use super::accessor::Buffers;
use super::document::valid;
use super::nodes::{Hierarchy, Placement, label, quaternion, rigid};
use ::gltf::json::animation::{Interpolation, Property};
use ::gltf::json::{Animation as Json, Root};
use anyhow::{Context as _, ensure};
use glam::{DAffine3, DQuat, DVec3, DVec4};
use std::collections::HashMap;
use std::sync::Arc;

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

/// A node's way through the world: itself and its ancestors, from the root down.
#[derive(Clone, Debug)]
pub(crate) struct NodePath(Vec<(Placement, Option<Arc<Channels>>)>);

impl NodePath {
    /// Node to world at a time.
    pub(crate) fn at(&self, seconds: f64) -> DAffine3 {
        self.0.iter().fold(DAffine3::IDENTITY, |above, (rest, channels)| {
            let moved = channels.as_ref().map_or(*rest, |c| pose(*rest, c, seconds));
            above * moved.to_affine()
        })
    }

    fn channels(&self) -> impl Iterator<Item = &Channel> {
        self.0.iter().filter_map(|(_, channels)| channels.as_deref()).flatten()
    }

    fn is_still(&self) -> bool {
        self.channels().next().is_none()
    }

    /// Seconds to the last key frame.
    fn duration(&self) -> f64 {
        self.channels().filter_map(|c| c.times.last()).copied().fold(0.0, f64::max)
    }
}

/// Whether any animation of the file moves a node, itself or by an ancestor.
pub(super) fn moving(root: &Root, hierarchy: &Hierarchy) -> Vec<bool> {
    let mut moving = vec![false; root.nodes.len()];
    for channel in root.animations.iter().flat_map(|animation| &animation.channels) {
        // Those that are not there are complained of when channels are read.
        if let Some(node) = moving.get_mut(channel.target.node.value()) {
            *node = true;
        }
    }
    for &node in &hierarchy.order {
        moving[node] |= hierarchy.parent[node].is_some_and(|parent| moving[parent]);
    }
    moving
}

/// Where a file's nodes are, and which of them carry the scene's cameras, in its order.
pub(super) struct Nodes<'a> {
    pub(super) root: &'a Root,
    pub(super) hierarchy: &'a Hierarchy,
    pub(super) cameras: &'a [usize],
}

impl Nodes<'_> {
    /// One [`Animation`] for each of the file's and each camera that it moves; where it
    /// moves a mesh or a light, each other camera as well, after those.
    ///
    /// `moved` are meshes and lights with the nodes that carry them.
    ///
    /// # Errors
    ///
    /// If a channel that moves any of these is malformed.
    pub(super) fn animations(
        &self,
        buffers: &Buffers<'_>,
        moved: &[(usize, Moved)],
        warnings: &mut Warnings,
    ) -> anyhow::Result<Vec<Animation>> {
        let mut carries = vec![false; self.root.nodes.len()];
        for &node in self.cameras.iter().chain(moved.iter().map(|(node, _)| node)) {
            let mut next = Some(node).filter(|&node| !carries[node]);
            while let Some(node) = next {
                carries[node] = true;
                next = self.hierarchy.parent[node].filter(|&parent| !carries[parent]);
            }
        }
        let mut animations = Vec::new();
        for (i, json) in self.root.animations.iter().enumerate() {
            let name = json.name.clone().unwrap_or_else(|| format!("animation{i}"));
            let channels = self.channels(json, buffers, &carries, warnings);
            let channels = channels.with_context(|| format!("animation {name:?}"))?;
            let movers = moved.iter().filter_map(|(node, moved)| {
                let path = self.path(*node, &channels);
                (!path.is_still()).then(|| Mover { moved: moved.clone(), path })
            });
            let movers: Vec<Mover> = movers.collect();
            let longest = movers.iter().map(|mover| mover.path.duration()).fold(0.0, f64::max);
            let paths = self.cameras.iter().map(|&node| self.path(node, &channels)).enumerate();
            let (still, flown): (Vec<_>, Vec<_>) = paths.partition(|(_, path)| path.is_still());
            // A file without cameras is given one, which is still.
            let none = self.cameras.is_empty().then_some(0);
            let still = still.into_iter().map(|(camera, _)| camera).chain(none);
            for (camera, path) in flown {
                let keys = sample(&path).with_context(|| {
                    format!("animation {name:?} of {}", label(self.root, self.cameras[camera]))
                })?;
                let duration = keys.last().map_or(0.0, |&(seconds, _)| seconds).max(longest);
                let (name, movers) = (name.clone(), movers.clone());
                animations.push(Animation { name, camera, duration, keys, movers });
            }
            for camera in still.filter(|_| !movers.is_empty()) {
                let (name, movers) = (name.clone(), movers.clone());
                animations.push(Animation {
                    name,
                    camera,
                    duration: longest,
                    keys: Vec::new(),
                    movers,
                });
            }
        }
        Ok(animations)
    }

    /// What happens to each node that `carries` something.
    fn channels(
        &self,
        json: &Json,
        buffers: &Buffers<'_>,
        carries: &[bool],
        warnings: &mut Warnings,
    ) -> anyhow::Result<HashMap<usize, Arc<Channels>>> {
        let mut channels: HashMap<usize, Channels> = HashMap::new();
        for channel in &json.channels {
            let node = channel.target.node.value();
            let moves = carries.get(node).with_context(|| format!("there is no node {node}"))?;
            let property = valid(&channel.target.path, "path")?;
            if property == Property::MorphTargetWeights {
                warnings.ignored("morph targets", &label(self.root, node));
            } else if *moves {
                let sampler = json.samplers.get(channel.sampler.value());
                let sampler = sampler.context("a channel's sampler is not there")?;
                channels.entry(node).or_default().push(Channel::read(property, sampler, buffers)?);
            }
        }
        Ok(channels.into_iter().map(|(node, channels)| (node, channels.into())).collect())
    }

    fn path(&self, node: usize, channels: &HashMap<usize, Arc<Channels>>) -> NodePath {
        let link = |node| (self.hierarchy.local[node], channels.get(&node).cloned());
        NodePath(self.hierarchy.chain(node).into_iter().map(link).collect())
    }
}

/// The camera's place from 0 s to the last key frame that moves it.
fn sample(path: &NodePath) -> anyhow::Result<Vec<(f64, DAffine3)>> {
    let duration = path.duration();
    let steps = (duration * RATE).ceil().clamp(1.0, MAX_SAMPLES);
    let mut seconds: Vec<f64> =
        (0..=steps as u32).map(|i| duration * f64::from(i) / steps).collect();
    for channel in path.channels() {
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
        let rigid = rigid(&path.at(seconds)).filter(|t| t.is_finite());
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
    fn nodes_that_carry_nothing_make_no_flight() {
        let (samplers, mut channels) = one("LINEAR", "translation");
        channels[0]["target"]["node"] = json!(2);
        let arrays: [(&str, &[f32]); 2] = [("SCALAR", &[0.0]), ("VEC3", &[1.0, 0.0, 0.0])];
        assert!(arm(&arrays, samplers, channels).expect("valid").is_empty(), "nothing moves");
    }

    #[test]
    fn a_mesh_that_moves_is_seen_by_cameras_that_do_and_that_do_not() {
        let mut value = accessors(&[
            ("SCALAR", &[0.0, 2.0]),
            ("VEC3", &[0.0, 0.0, 0.0, 0.0, 4.0, 0.0]),
            ("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]),
        ]);
        value["cameras"] =
            json!([{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}]);
        value["meshes"] = json!([{"primitives": [{"attributes": {"POSITION": 2}}]}]);
        value["nodes"] = json!([
            {"name": "still", "camera": 0},
            {"name": "lift", "children": [2, 3]},
            {"name": "cabin", "mesh": 0, "scale": [0, 1, 1]},
            {"name": "rider", "camera": 0},
        ]);
        value["animations"] = json!([{"name": "up",
            "samplers": [{"input": 0, "output": 1}],
            "channels": [{"sampler": 0, "target": {"node": 1, "path": "translation"}}]}]);
        let scene = load_value(&value).expect("valid").scene;
        let [rider, still] = &scene.animations[..] else { panic!("{:?}", scene.animations) };
        assert_eq!((rider.camera, rider.duration), (1, 2.0), "what moves comes first");
        assert_eq!((still.camera, still.duration), (0, 2.0));
        assert!(still.keys.is_empty() && !rider.keys.is_empty(), "which camera moves");
        for animation in [rider, still] {
            let [mover] = &animation.movers[..] else { panic!("{animation:?}") };
            let Moved::Mesh { index: 0, shape } = &mover.moved else { panic!("{mover:?}") };
            // Flattened at rest and in flight: nothing is inverted on the way.
            let mut mesh = crate::scene::Mesh::default();
            shape.place(mover.path.at(0.5), &mut mesh).expect("finite");
            assert_eq!(mesh.positions, [DVec3::Y, DVec3::Y, DVec3::Y * 2.0]);
        }
        // A file without cameras has one, of number 0, when all is loaded.
        value["cameras"] = json!([]);
        for node in [0, 3] {
            value["nodes"][node].as_object_mut().expect("a node").remove("camera");
        }
        value["nodes"][0] = json!({"name": "nothing"});
        let scene = load_value(&value).expect("valid").scene;
        assert_eq!(scene.animations.len(), 1);
        assert_eq!((scene.animations[0].camera, scene.animations[0].movers.len()), (0, 1));
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
