//! glTF 2.0, as `.gltf` or `.glb`, into a [`Scene`].
//!
//! The gltf crate parses the JSON. Its own accessors index and subtract as a
//! valid file allows, and panic on others; what is read here goes by its plain
//! JSON types, so that a malformed file is an error.

mod accessor;
mod animation;
mod buffer;
mod document;
mod material;
mod nodes;
mod primitive;

pub(crate) use animation::NodePath;

use super::extras::{self, NodeExtras, SceneExtras};
use super::files::Files;
use super::load::{Names, Warnings};
use super::{Camera, LightKind, Loaded, Material, Mesh, Moved, Projection};
use super::{PunctualLight, Scene, Shape};
use ::gltf::json::camera::Type as CameraType;
use ::gltf::json::extensions::scene::khr_lights_punctual::{Light, Type as LightType};
use ::gltf::json::{Camera as JsonCamera, Root};
use accessor::Buffers;
use anyhow::{Context as _, ensure};
use document::{get, valid};
use glam::{DAffine3, DVec3, Vec3};
use material::Textures;
use nodes::{Hierarchy, label, rigid};
use std::f64::consts::{FRAC_PI_2, PI};
use std::path::Path;

/// Reads a `.gltf` or `.glb` whose files are relative to `directory`.
///
/// # Errors
///
/// If a file is missing, malformed, or requires what is not supported.
pub(super) fn read(bytes: &[u8], directory: &Path) -> anyhow::Result<Loaded> {
    let mut warnings = Warnings::default();
    let (root, chunk) = document::parse(bytes, &mut warnings)?;
    let files = Files::beside(directory);
    let buffers = Buffers::load(&root, chunk, &files)?;
    let hierarchy = Hierarchy::read(&root)?;
    let mut builder = Builder::new(&root, &buffers, &files, warnings)?;
    let moving = animation::moving(&root, &hierarchy);
    for &node in &hierarchy.order {
        let placed = builder.node(node, hierarchy.world[node], moving[node]);
        placed.with_context(|| label(&root, node))?;
    }
    let Builder { mut scene, camera_nodes, moved, textures, mut warnings, .. } = builder;
    scene.textures = textures.loaded;
    scene.ambient = ambient(&root)?;
    scene.sky = sky(&root)?;
    if root.scenes.len() > 1 {
        warnings.ignored("scenes other than the default one", "");
    }
    let nodes = animation::Nodes { root: &root, hierarchy: &hierarchy, cameras: &camera_nodes };
    scene.animations = nodes.animations(&buffers, &moved, &mut warnings)?;
    Ok(Loaded { scene, files: files.into_read(), warnings: warnings.into_lines() })
}

fn ambient(root: &Root) -> anyhow::Result<Vec3> {
    let shown = root.scene.map_or(0, |index| index.value());
    let Some(scene) = root.scenes.get(shown) else { return Ok(Vec3::ZERO) };
    let extras = extras::read::<SceneExtras>(&scene.extras);
    extras.and_then(|e| e.ambient()).with_context(|| format!("scene {shown}"))
}

fn sky(root: &Root) -> anyhow::Result<Option<wrt_core::Sky>> {
    let shown = root.scene.map_or(0, |index| index.value());
    let Some(scene) = root.scenes.get(shown) else { return Ok(None) };
    let extras = extras::read::<SceneExtras>(&scene.extras);
    extras.and_then(|e| e.sky()).with_context(|| format!("scene {shown}"))
}

/// A scene in the making.
struct Builder<'a> {
    root: &'a Root,
    buffers: &'a Buffers<'a>,
    scene: Scene,
    /// Index of the material of primitives that name none, once there is one.
    plain: Option<usize>,
    /// The node of each of the scene's cameras.
    camera_nodes: Vec<usize>,
    /// What animations can move, with its node.
    moved: Vec<(usize, Moved)>,
    textures: Textures<'a>,
    names: Names,
    warnings: Warnings,
}

impl<'a> Builder<'a> {
    fn new(
        root: &'a Root,
        buffers: &'a Buffers<'a>,
        files: &'a Files<'a>,
        mut warnings: Warnings,
    ) -> anyhow::Result<Self> {
        let mut textures = Textures::new(root, buffers, files);
        let mut scene = Scene::default();
        for (i, json) in root.materials.iter().enumerate() {
            let owner = match &json.name {
                Some(name) => format!("material {name:?}"),
                None => format!("material {i}"),
            };
            let material = material::read(json, &owner, &mut textures, &mut warnings);
            scene.materials.push(material.context(owner)?);
        }
        let (plain, names) = (None, Names::default());
        let (camera_nodes, moved) = (Vec::new(), Vec::new());
        Ok(Self { root, buffers, scene, plain, camera_nodes, moved, textures, names, warnings })
    }

    /// Adds what `node` carries, and notes it where the node is `moving`.
    fn node(&mut self, node: usize, world: DAffine3, moving: bool) -> anyhow::Result<()> {
        let json = &self.root.nodes[node];
        let owner = label(self.root, node);
        let NodeExtras { receiver } = extras::read(&json.extras)?;
        if json.skin.is_some() {
            self.warnings.ignored("skins", &owner);
        }
        if let Some(index) = json.mesh {
            let first = self.scene.meshes.len();
            let shapes = self.mesh(node, get(self.root, index, "mesh")?, world, receiver)?;
            let moved = (first..).zip(shapes.into_iter().filter(|_| moving));
            let moved = moved.map(|(index, shape)| Moved::Mesh { index, shape: shape.into() });
            self.moved.extend(moved.map(|moved| (node, moved)));
        } else if receiver {
            self.warnings.ignored("receiver marks on nodes without a mesh", &owner);
        }
        if let Some(index) = json.camera {
            let camera = get(self.root, index, "camera")?;
            let number = self.scene.cameras.len().to_string();
            let name = json.name.clone().or(camera.name.clone()).unwrap_or(number);
            self.scene.cameras.push(camera_of(camera, name, &world)?);
            self.camera_nodes.push(node);
        }
        let light = json.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref());
        if let Some(light) = light {
            let light = punctual(get(self.root, light.light, "light")?, &world)?;
            if moving {
                self.moved.push((node, Moved::Light(self.scene.lights.len())));
            }
            self.scene.lights.push(light);
        }
        Ok(())
    }

    /// Adds a mesh for each primitive and returns their shapes.
    fn mesh(
        &mut self,
        node: usize,
        json: &::gltf::json::Mesh,
        world: DAffine3,
        receiver: bool,
    ) -> anyhow::Result<Vec<Shape>> {
        let mut shapes = Vec::new();
        let owner = label(self.root, node);
        let given = self.root.nodes[node].name.as_ref().or(json.name.as_ref());
        let name = given.cloned().unwrap_or_else(|| format!("node{node}"));
        for (i, primitive) in json.primitives.iter().enumerate() {
            let material = match primitive.material {
                Some(index) => {
                    get(self.root, index, "material")?;
                    index.value()
                }
                None => self.plain_material(),
            };
            let warnings = &mut self.warnings;
            let context = || format!("primitive {i}");
            let read = primitive::read(self.buffers, primitive, &owner, warnings);
            if let Some((shape, mut mesh)) = read.with_context(context)? {
                shape.place(world, &mut mesh).with_context(context)?;
                let name = self.names.unique(&name);
                self.scene.meshes.push(Mesh { name, material, receiver, ..mesh });
                shapes.push(shape);
            }
        }
        Ok(shapes)
    }

    /// The material of primitives without one.
    ///
    /// Departs from glTF, whose default is a white metal: half-grey Lambertian
    /// is what a modelling program shows for no material.
    fn plain_material(&mut self) -> usize {
        *self.plain.get_or_insert_with(|| {
            self.scene.materials.push(Material::default());
            self.scene.materials.len() - 1
        })
    }
}

fn camera_of(json: &JsonCamera, name: String, world: &DAffine3) -> anyhow::Result<Camera> {
    let (projection, aspect) = match valid(&json.type_, "type")? {
        CameraType::Perspective => {
            let camera = json.perspective.as_ref().context("its camera has no perspective")?;
            let yfov = f64::from(camera.yfov);
            ensure!(yfov > 0.0 && yfov < PI, "yfov is {yfov}, outside 0 to π");
            (Projection::Perspective { yfov }, camera.aspect_ratio.map(f64::from))
        }
        CameraType::Orthographic => {
            let camera = json.orthographic.as_ref().context("its camera has no orthographic")?;
            // Some exporters turn the picture over by a negative size.
            let [x, y] = [camera.xmag, camera.ymag].map(|m| f64::from(m).abs());
            ensure!(y > 0.0 && y.is_finite(), "ymag is {y}, which no picture has");
            (Projection::Orthographic { half_height: y }, Some(x / y))
        }
    };
    if let Some(a) = aspect {
        ensure!(a > 0.0 && a.is_finite(), "its aspect ratio is {a}, which no picture has");
    }
    let transform = rigid(world).context("its camera has no direction: it is scaled to nothing")?;
    Ok(Camera { name, transform, projection, aspect })
}

fn punctual(json: &Light, world: &DAffine3) -> anyhow::Result<PunctualLight> {
    let intensity = Vec3::from(json.color) * json.intensity;
    let valid_intensity = intensity.is_finite() && intensity.min_element() >= 0.0;
    ensure!(valid_intensity, "its light's colour times intensity is {intensity}");
    let range = json.range.map(f64::from);
    if let Some(range) = range {
        ensure!(range > 0.0, "its light's range is {range}");
    }
    let kind = match valid(&json.type_, "type")? {
        LightType::Point => LightKind::Point,
        LightType::Directional => LightKind::Directional,
        LightType::Spot => {
            let spot = json.spot.as_ref().context("its spot light has no cone")?;
            let (inner, outer) =
                (f64::from(spot.inner_cone_angle), f64::from(spot.outer_cone_angle));
            // The largest f32 angle is a little past π/2.
            let ordered = 0.0 <= inner && inner < outer && outer <= FRAC_PI_2 + 1e-6;
            ensure!(
                ordered,
                "its spot light's cones are {inner} and {outer}: 0 ≤ inner < outer ≤ π/2"
            );
            LightKind::Spot { inner, outer }
        }
    };
    let mut light =
        PunctualLight { intensity, position: DVec3::ZERO, direction: DVec3::NEG_Z, kind, range };
    light.place(world)?;
    Ok(light)
}

#[cfg(test)]
mod tests;
