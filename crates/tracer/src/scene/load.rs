//! A scene file of any known format, and what its loaders share.

use super::{Camera, LightKind, Material, Projection, PunctualLight, Scene};
use anyhow::Context as _;
use glam::{DAffine3, DMat3, DVec3, Vec3};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// A scene, and what its file asked for in vain.
#[derive(Debug)]
pub(crate) struct Loaded {
    pub(crate) scene: Scene,
    /// Those that it was read from, its own first.
    pub(crate) files: Vec<PathBuf>,
    /// One line for each feature that was ignored; for a command to print.
    pub(crate) warnings: Vec<String>,
}

/// Reads the scene in `path`; the extension says which format it is in.
///
/// The scene has at least one camera: where the file has none, one named
/// `default` sees all of it.
///
/// # Errors
///
/// If the file cannot be read, is malformed, or requires what is not supported.
pub(crate) fn load(path: &Path) -> anyhow::Result<Loaded> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
    let read = match extension.to_ascii_lowercase().as_str() {
        "gltf" | "glb" => super::gltf::read,
        "obj" => super::obj::read,
        _ => anyhow::bail!(
            "{}: not a scene this program reads: export it as .gltf, .glb or .obj",
            path.display()
        ),
    };
    let directory = path.parent().unwrap_or(Path::new(""));
    let loaded = std::fs::read(path).map_err(Into::into).and_then(|bytes| read(&bytes, directory));
    let mut loaded = loaded.with_context(|| format!("reading {}", path.display()))?;
    loaded.files.insert(0, path.to_owned());
    for material in &mut loaded.scene.materials {
        let Some(file) = material.glazing_file.take() else { continue };
        let glazing = directory.join(&file);
        let bsdf = super::bsdf_xml::read(&glazing).with_context(|| {
            format!(
                "reading {}: material \"{}\": {}",
                path.display(),
                material.name,
                file.display()
            )
        })?;
        loaded.files.push(glazing);
        material.glazing = Some(wrt_core::Glazing::Tabulated(bsdf.into()));
    }
    if loaded.scene.cameras.is_empty() {
        let camera = overview(&loaded.scene);
        loaded.scene.cameras.push(camera);
    }
    Ok(loaded)
}

/// A camera that sees every mesh, from the front (+z), the right and above.
fn overview(scene: &Scene) -> Camera {
    let positions = || scene.meshes.iter().flat_map(|m| &m.positions);
    let low = positions().copied().reduce(DVec3::min).unwrap_or(DVec3::NEG_ONE);
    let high = positions().copied().reduce(DVec3::max).unwrap_or(DVec3::ONE);
    let radius = 0.5 * (high - low).length();
    let radius = if radius > 0.0 { radius } else { 1.0 };
    let yfov = 40.0_f64.to_radians();
    // Not along an axis, from where flat things are seen edge on.
    let back = DVec3::new(0.5, 0.5, 1.0).normalize();
    // The sphere about the bounding box touches the frustum's planes.
    let eye = 0.5 * (low + high) + radius / (0.5 * yfov).sin() * back;
    let right = DVec3::Y.cross(back).normalize();
    let axes = DMat3::from_cols(right, back.cross(right), back);
    let transform = DAffine3::from_mat3_translation(axes, eye);
    let projection = Projection::Perspective { yfov };
    Camera { name: "default".to_owned(), transform, projection, aspect: None }
}

impl Scene {
    /// Gives a scene without any light three that shine from about the first camera,
    /// and some from all round; says whether it did.
    ///
    /// A white surface that looks over the camera's left shoulder is shown as white.
    pub(crate) fn light_default(&mut self) -> bool {
        const AMBIENT: f32 = 0.2;
        /// Where light travels, in the camera's axes, and its irradiance over π: from
        /// over the left shoulder, from the right, and from behind for the outlines.
        const LIGHTS: [([f64; 3], f32); 3] =
            [([0.4, -0.6, -1.0], 0.6), ([-1.0, -0.1, -0.6], 0.3), ([0.2, -1.0, 0.8], 0.4)];
        let shines = |m: &Material| m.emission != Vec3::ZERO || m.unlit;
        let lit = !self.lights.is_empty()
            || self.ambient != Vec3::ZERO
            || self.meshes.iter().any(|mesh| shines(&self.materials[mesh.material]));
        let Some(camera) = self.cameras.first().filter(|_| !lit) else { return false };
        self.ambient = Vec3::splat(AMBIENT);
        self.lights.extend(LIGHTS.map(|(direction, irradiance)| PunctualLight {
            intensity: Vec3::splat(irradiance * std::f32::consts::PI),
            position: camera.transform.translation,
            direction: camera.transform.transform_vector3(direction.into()).normalize(),
            kind: LightKind::Directional,
            range: None,
        }));
        true
    }
}

/// Scales `kd` and `ks` by one factor, so that no channel reflects more than it
/// receives: `max(kd + ks) ≤ 1`.
pub(super) fn conserve(kd: Vec3, ks: Vec3) -> (Vec3, Vec3) {
    let scale = 1.0 / (kd + ks).max_element().max(1.0);
    (kd * scale, ks * scale)
}

/// Features of a file that have no effect here, each once.
#[derive(Debug, Default)]
pub(super) struct Warnings(Vec<Ignored>);

#[derive(Debug)]
struct Ignored {
    what: String,
    /// The first thing that has it; empty for the whole file.
    owner: String,
    count: usize,
}

impl Warnings {
    /// Notes that `owner` has `what` to no effect.
    pub(super) fn ignored(&mut self, what: &str, owner: &str) {
        match self.0.iter_mut().find(|w| w.what == what) {
            Some(warning) => warning.count += 1,
            None => {
                let (what, owner) = (what.to_owned(), owner.to_owned());
                self.0.push(Ignored { what, owner, count: 1 });
            }
        }
    }

    /// `ignored normal textures (material "oak" and 2 more)`, and so on.
    pub(super) fn into_lines(self) -> Vec<String> {
        let line = |Ignored { what, owner, count }: Ignored| match (owner.as_str(), count) {
            ("", _) => format!("ignored {what}"),
            (_, 1) => format!("ignored {what} ({owner})"),
            _ => format!("ignored {what} ({owner} and {} more)", count - 1),
        };
        self.0.into_iter().map(line).collect()
    }
}

/// Gives each mesh a name of its own, since a `.wct` patch is bound by name.
#[derive(Debug, Default)]
pub(super) struct Names(HashMap<String, usize>);

impl Names {
    /// `name`, or `name#2`, `name#3`, … where it is taken.
    pub(super) fn unique(&mut self, name: &str) -> String {
        let mut candidate = name.to_owned();
        while self.0.contains_key(&candidate) {
            let uses = self.0.entry(name.to_owned()).or_insert(1);
            *uses += 1;
            candidate = format!("{name}#{uses}");
        }
        self.0.insert(candidate.clone(), 1);
        candidate
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Mesh;

    #[test]
    fn unknown_extension_is_named_with_the_remedy() {
        let error = load(Path::new("a/model.fbx")).expect_err("FBX is not read");
        let text = format!("{error:#}");
        assert_eq!(
            text,
            "a/model.fbx: not a scene this program reads: export it as .gltf, .glb or .obj"
        );
    }

    #[test]
    fn missing_file_is_named() {
        for name in ["no/such.gltf", "no/such.GLB", "no/such.obj"] {
            let error = load(Path::new(name)).expect_err("there is no such file");
            let text = format!("{error:#}");
            assert!(text.starts_with(&format!("reading {name}: ")), "{text}");
        }
    }

    #[test]
    fn overview_sees_every_corner() {
        let (low, high) = (DVec3::new(-1.0, 0.0, -7.0), DVec3::new(3.0, 2.0, 11.0));
        let corners = |i: usize| {
            let pick = |axis: usize| if i >> axis & 1 == 0 { low[axis] } else { high[axis] };
            DVec3::new(pick(0), pick(1), pick(2))
        };
        let positions: Vec<DVec3> = (0..8).map(corners).collect();
        let mesh = Mesh { positions: positions.clone(), ..Mesh::default() };
        let camera = overview(&Scene { meshes: vec![mesh], ..Scene::default() });
        let Projection::Perspective { yfov } = camera.projection else { panic!("{camera:?}") };
        let tangent = (0.5 * yfov).tan();
        for p in positions {
            let q = camera.transform.inverse().transform_point3(p);
            assert!(q.z < 0.0, "{p} is behind the camera");
            assert!(q.x.abs() <= -q.z * tangent, "{p} is beside the picture");
            assert!(q.y.abs() <= -q.z * tangent, "{p} is above or below the picture");
        }
        assert!(camera.transform.translation.y > 2.0, "not from above");
        assert!(camera.transform.translation.z > 11.0, "not from the front");
    }

    #[test]
    fn a_scene_without_light_gets_one() {
        let mesh = Mesh::default();
        let mut scene =
            Scene { meshes: vec![mesh], materials: vec![Material::default()], ..Scene::default() };
        scene.cameras.push(overview(&scene));
        assert!(scene.light_default() && scene.lights.len() == 3, "{scene:?}");
        assert!(scene.lights[0].direction.y < 0.0, "from above");
        assert!(!scene.light_default(), "now it has one");
        scene.lights.clear();
        scene.ambient = Vec3::ZERO;
        scene.materials[0].emission = Vec3::X;
        assert!(!scene.light_default(), "it shines itself");
    }

    #[test]
    fn conserving_keeps_the_ratio() {
        let (kd, ks) = conserve(Vec3::new(1.0, 0.5, 0.0), Vec3::splat(1.0));
        assert_eq!((kd, ks), (Vec3::new(0.5, 0.25, 0.0), Vec3::splat(0.5)));
        let dim = (Vec3::splat(0.3), Vec3::splat(0.4));
        assert_eq!(conserve(dim.0, dim.1), dim);
    }

    #[test]
    fn repeated_names_are_numbered() {
        let mut names = Names::default();
        let given = ["wall", "wall", "wall#2", "wall", "door"].map(|n| names.unique(n));
        assert_eq!(given, ["wall", "wall#2", "wall#2#2", "wall#3", "door"]);
    }

    #[test]
    fn a_feature_is_reported_once() {
        let mut warnings = Warnings::default();
        warnings.ignored("skins", "node \"a\"");
        warnings.ignored("skins", "node \"b\"");
        warnings.ignored("extension X", "");
        let lines = warnings.into_lines();
        assert_eq!(lines, ["ignored skins (node \"a\" and 1 more)", "ignored extension X"]);
    }
}
