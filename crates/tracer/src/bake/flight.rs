//! From where the camera of an animation looks at surfaces.

use crate::scene::{Animation, Camera, Projection, Scene, flight, surfaces};
use anyhow::{bail, ensure};
use glam::{DAffine3, DQuat, DVec2, DVec3};
use std::f64::consts::FRAC_PI_2;
use wrt_core::legendre::ViewSet;
use wrt_core::{DirectionMap, Frame};

/// What a camera may be off its path by, where nobody says: this part of the diagonal of
/// the box around the path and the receivers.
const MARGIN: f64 = 0.02;

/// A picture's width over its height, for which the camera's field of view is taken at
/// least: what a picture shows from left to right follows from its shape.
const WIDEST: f64 = 2.0;

/// The most that a camera turns from one pose to the next, radians; twice as much is
/// added on all sides of what it sees.
const TURN: f64 = 0.02;

/// The most poses along the diagonal, however small the margin.
const POSES: f64 = 1000.0;

/// All that the cameras of an animation can see, with a margin: the same poses as those
/// of `tracer fly`, at any rate of pictures.
#[derive(Clone, Debug)]
pub(crate) struct Flight {
    name: String,
    /// Metres that a camera may be off its path by.
    margin: f64,
    /// The same off the nearest pose.
    reach: f64,
    poses: Vec<Pose>,
}

/// A camera at one time.
#[derive(Clone, Copy, Debug)]
struct Pose {
    position: DVec3,
    to_camera: DAffine3,
    /// Half the sides of what is seen, widened: at distance 1, or everywhere.
    half: DVec2,
    parallel: bool,
}

impl Flight {
    /// That of all cameras which the animation `name` moves, with a margin in metres or,
    /// if not given, of 2 % of the diagonal of the box around the path and all receivers.
    ///
    /// # Errors
    ///
    /// If there is no such animation, naming those that there are; if the margin is not
    /// at least 0 and finite.
    pub(crate) fn new(scene: &Scene, name: &str, margin: Option<f64>) -> anyhow::Result<Self> {
        let own: Vec<&Animation> = scene.animations.iter().filter(|a| a.name == name).collect();
        if own.is_empty() {
            let names: Vec<&str> = scene.animations.iter().map(|a| &*a.name).collect();
            if names.is_empty() {
                bail!("no animation named \"{name}\": the scene has none of a camera");
            }
            bail!("no animation named \"{name}\"; there are: {}", names.join(", "));
        }
        let keys = own.iter().flat_map(|animation| {
            let times = corners(animation);
            times.into_iter().map(|t| flight::camera_at(animation, scene, t).transform.translation)
        });
        let receivers = surfaces::receivers(scene);
        let receivers = receivers.iter().flat_map(|planar| planar.vertices.iter().copied());
        let points: Vec<DVec3> = keys.chain(receivers).collect();
        let [low, high] = [DVec3::min, DVec3::max].map(|f| points.iter().copied().reduce(f));
        let diagonal = high.unwrap_or_default().distance(low.unwrap_or_default());
        let margin = margin.unwrap_or(MARGIN * diagonal);
        ensure!(margin >= 0.0 && margin.is_finite(), "a margin of {margin} m: give 0 or more");
        let step = (0.5 * margin).max(diagonal / POSES);
        let poses = own.iter().flat_map(|animation| poses(animation, scene, step)).collect();
        Ok(Self { name: name.to_owned(), margin, reach: margin + 0.5 * step, poses })
    }

    /// The animation's name.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Metres that a camera may be off its path by.
    pub(crate) fn margin(&self) -> f64 {
        self.margin
    }

    /// The directions, in `frame`, towards cameras that see a point less than `within`
    /// metres away from `point`. Nothing hides anything.
    pub(crate) fn views(
        &self,
        map: DirectionMap,
        frame: &Frame,
        point: DVec3,
        within: f64,
    ) -> ViewSet {
        let mut views = ViewSet::none();
        let reach = self.reach + within;
        for pose in &self.poses {
            if let Some((axis, angle)) = pose.cone(point, reach) {
                let axis = frame.to_local(axis);
                if axis.z > -angle.sin() {
                    views.add_cone(map, axis, angle);
                }
            }
        }
        views
    }

    /// Whether a camera can be in the unit direction `to_eye` from `point` and see it.
    pub(crate) fn sees(&self, point: DVec3, to_eye: DVec3) -> bool {
        let cones = self.poses.iter().filter_map(|pose| pose.cone(point, self.reach));
        cones.into_iter().any(|(axis, angle)| axis.dot(to_eye) >= angle.cos())
    }

    /// Whether all that `camera` shows in a picture of this width over its height is
    /// what some pose sees.
    pub(crate) fn covers(&self, camera: &Camera, aspect: f64) -> bool {
        let own = Pose::new(camera, aspect, 0.0);
        self.poses.iter().any(|pose| pose.contains(&own, self.reach))
    }
}

/// When the camera's motion changes, both ends among them.
fn corners(animation: &Animation) -> Vec<f64> {
    let within = |t: &f64| (0.0..animation.duration).contains(t);
    let keys = animation.keys.iter().map(|key| key.0).filter(within);
    let mut times: Vec<f64> = [0.0].into_iter().chain(keys).chain([animation.duration]).collect();
    times.dedup();
    times
}

/// Poses at most `step` metres and [`TURN`] apart.
fn poses(animation: &Animation, scene: &Scene, step: f64) -> Vec<Pose> {
    let at = |t: f64| flight::camera_at(animation, scene, t);
    let pose = |t: f64| {
        let camera = at(t);
        Pose::new(&camera, camera.aspect.unwrap_or_default().max(WIDEST), TURN)
    };
    let times = corners(animation);
    let mut poses = Vec::new();
    for pair in times.windows(2) {
        let [from, to] = [pair[0], pair[1]].map(|t| at(t).transform);
        let turn = |place: &DAffine3| DQuat::from_mat3(&place.matrix3);
        let moved = from.translation.distance(to.translation) / step;
        let turned = turn(&from).angle_between(turn(&to)) / TURN;
        // A camera that rests has one pose, and none moves by nothing between two.
        let parts = moved.max(turned).ceil();
        let time = |i: f64| pair[0] + (pair[1] - pair[0]) * i / parts;
        poses.extend((0..parts as u32).map(|i| pose(time(f64::from(i)))));
    }
    poses.push(pose(animation.duration));
    poses
}

impl Pose {
    /// Of a picture of this width over its height, `wider` radians on all sides.
    fn new(camera: &Camera, aspect: f64, wider: f64) -> Self {
        let (half_height, parallel) = match camera.projection {
            Projection::Perspective { yfov } => ((0.5 * yfov).tan(), false),
            Projection::Orthographic { half_height } => (half_height, true),
        };
        let half = DVec2::new(half_height * aspect, half_height);
        // Short of a right angle, where it would be all that is in front.
        let widen = |x: f64| (x.atan() + wider).min(FRAC_PI_2 - 1e-3).tan().max(x);
        Self {
            position: camera.transform.translation,
            to_camera: camera.transform.inverse(),
            half: if parallel { half } else { DVec2::new(widen(half.x), widen(half.y)) },
            parallel,
        }
    }

    /// The directions towards the camera from `point`, if that is seen from less than
    /// `reach` metres off this pose: a unit axis and an angle around it.
    fn cone(&self, point: DVec3, reach: f64) -> Option<(DVec3, f64)> {
        let seen = self.to_camera.transform_point3(point);
        let depth = -seen.z;
        if depth < -reach {
            return None;
        }
        for (x, half) in [(seen.x, self.half.x), (seen.y, self.half.y)] {
            let outside = if self.parallel {
                x.abs() - half - TURN * depth
            } else {
                (x.abs() - half * depth) / (1.0 + half * half).sqrt()
            };
            if outside > reach {
                return None;
            }
        }
        if self.parallel {
            return Some((self.to_camera.matrix3.row(2).normalize(), TURN));
        }
        let to = self.position - point;
        let distance = to.length();
        if distance <= reach {
            return Some((DVec3::Y, std::f64::consts::PI));
        }
        Some((to / distance, (reach / distance).asin()))
    }

    /// Whether `other` is within `reach` of it and shows nothing that it does not.
    fn contains(&self, other: &Self, reach: f64) -> bool {
        let offset = self.to_camera.transform_point3(other.position);
        let turned = self.to_camera * other.to_camera.inverse();
        let sides = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]];
        let corners = sides.map(|side| other.half * DVec2::from(side));
        if self.parallel != other.parallel {
            return false;
        }
        if self.parallel {
            let forward = turned.transform_vector3(DVec3::NEG_Z);
            let is_seen = |corner: &DVec2| {
                let at = turned.transform_point3(corner.extend(0.0));
                (at.truncate().abs() - self.half).max_element() <= reach
            };
            return -forward.z >= TURN.cos() && corners.iter().all(is_seen);
        }
        let is_seen = |corner: &DVec2| {
            let along = turned.transform_vector3(corner.extend(-1.0));
            (along.truncate().abs() + along.z * self.half).max_element() <= 0.0
        };
        offset.length() <= reach && corners.iter().all(is_seen)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    const SPEED: f64 = 2.0;

    /// A camera that goes along x from 0 to 4 m in 2 s at a height of 1 m, looking down,
    /// 90° from top to bottom.
    fn along(projection: Projection) -> Scene {
        let place = |x: f64| {
            DAffine3::from_rotation_translation(
                DQuat::from_rotation_x(-FRAC_PI_2),
                DVec3::new(x, 1.0, 0.0),
            )
        };
        let keys = vec![(0.0, place(0.0)), (2.0, place(2.0 * SPEED))];
        let name = "along".into();
        let animation = Animation { name, camera: 0, duration: 2.0, keys, movers: Vec::new() };
        let camera =
            Camera { name: "eye".into(), transform: place(0.0), projection, aspect: Some(1.0) };
        Scene { cameras: vec![camera], animations: vec![animation], ..Scene::default() }
    }

    fn perspective() -> Scene {
        along(Projection::Perspective { yfov: FRAC_PI_2 })
    }

    /// y is the normal of the floor.
    fn floor() -> Frame {
        let corners =
            [DVec3::ZERO, DVec3::new(1.0, 0.0, 0.0), DVec3::new(1.0, 0.0, -1.0), DVec3::NEG_Z];
        *wrt_core::Polygon::rectilinear(&corners).expect("a square").frame()
    }

    #[test]
    fn every_picture_of_the_flight_is_covered_and_none_beside_it() {
        for projection in [
            Projection::Perspective { yfov: FRAC_PI_2 },
            Projection::Orthographic { half_height: 0.7 },
        ] {
            let scene = along(projection);
            let flight = Flight::new(&scene, "along", Some(0.1)).expect("its name");
            let at = |t: f64| flight::camera_at(&scene.animations[0], &scene, t);
            for i in 0..=100 {
                let camera = at(0.02 * f64::from(i));
                assert!(flight.covers(&camera, 1.0) && flight.covers(&camera, WIDEST), "{i}");
                assert!(!flight.covers(&camera, 1.3 * WIDEST), "{i}: too wide");
                let mut aside = camera.clone();
                aside.transform.translation.y += 0.09;
                assert!(flight.covers(&aside, 1.0), "{i}: within the margin");
                let mut turned = camera.clone();
                turned.transform *= DAffine3::from_rotation_x(0.2);
                assert!(!flight.covers(&turned, 1.0), "{i}: turned");
            }
            let mut before = at(0.0);
            before.transform.translation.x -= 0.3;
            assert_eq!(
                flight.covers(&before, 1.0),
                // Within the breadth of a picture twice as wide.
                matches!(projection, Projection::Orthographic { .. }),
            );
        }
    }

    /// By closed form: a point of the floor sees the camera pass over it while it is in
    /// the picture, which is twice as wide (along x) as its height.
    #[test]
    fn a_point_is_seen_from_the_stretch_of_path_that_has_it_in_its_picture() {
        let flight = Flight::new(&perspective(), "along", Some(0.05)).expect("its name");
        let (map, frame) = (DirectionMap::EqualArea, floor());
        for (x, z) in [(2.0, 0.0), (0.5, 0.8), (3.9, -0.3), (2.0, -0.98)] {
            let point = DVec3::new(x, 0.0, z);
            let views = flight.views(map, &frame, point, 0.0);
            for i in 0..=400 {
                let eye = DVec3::new(0.01 * f64::from(i), 1.0, 0.0);
                let to_eye = (eye - point).normalize();
                let st = map.to_square(frame.to_local(to_eye));
                let inside = (eye.x - x).abs() < 2.0;
                assert!(!inside || views.contains(st) && flight.sees(point, to_eye), "{eye}");
                let outside = (eye.x - x).abs() > 2.4;
                assert!(!outside || !flight.sees(point, to_eye), "{eye}");
            }
            // Off the path, beyond the margin.
            let to_eye = (DVec3::new(x, 1.0, 0.25) - point).normalize();
            assert!(!flight.sees(point, to_eye), "{point}");
            assert!(!views.contains(map.to_square(frame.to_local(to_eye))), "{point}");
        }
        // Out of every picture, above the camera, and below the floor.
        for point in [[2.0, 0.0, 1.3], [-2.5, 0.0, 0.0], [2.0, 1.2, 0.0]] {
            assert!(flight.views(map, &frame, point.into(), 0.0).is_empty(), "{point:?}");
        }
        let under = Frame { n: -frame.n, ..frame };
        assert!(flight.views(map, &under, DVec3::X, 0.0).is_empty(), "from below");
    }

    #[test]
    fn points_around_one_have_no_views_that_it_has_not() {
        let flight = Flight::new(&perspective(), "along", Some(0.05)).expect("its name");
        let (map, frame) = (DirectionMap::EqualArea, floor());
        let centre = DVec3::new(1.0, 0.0, 1.0);
        let around = flight.views(map, &frame, centre, 0.2);
        for i in 0..64 {
            let off = 0.199 * DVec2::from_angle(0.1 * f64::from(i));
            let own = flight.views(map, &frame, centre + DVec3::new(off.x, 0.0, off.y), 0.0);
            for k in 0..10_000 {
                let st = DVec2::new(f64::from(k % 100) + 0.5, f64::from(k / 100) + 0.5) / 100.0;
                assert!(!own.contains(st) || around.contains(st), "{off} {st}");
            }
        }
    }

    #[test]
    fn a_margin_that_is_none_is_refused_and_none_given_is_a_part_of_the_scene() {
        let scene = perspective();
        for margin in [-0.1, f64::NAN, f64::INFINITY] {
            assert!(Flight::new(&scene, "along", Some(margin)).is_err(), "{margin}");
        }
        let margin = |m| Flight::new(&scene, "along", m).expect("its name").margin();
        assert!((margin(None) - 0.02 * 4.0).abs() < 1e-12, "of a path of 4 m");
        assert_eq!(margin(Some(0.0)), 0.0);
    }
}
