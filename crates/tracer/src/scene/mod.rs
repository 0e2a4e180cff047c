//! A scene as plain data, whatever file it came from.
//!
//! World space is right-handed, in metres, +Y up. Colours and radiances are
//! linear Rec. 709; radiance is in W m⁻² sr⁻¹.

mod bsdf_xml;
mod cutout;
mod extras;
mod files;
pub(crate) mod flight;
mod gltf;
mod load;
mod metallic;
mod obj;
mod shape;
pub(crate) mod surfaces;
mod texture;
pub(crate) mod weather;

pub(crate) use cutout::Cutout;
pub(crate) use gltf::NodePath;
pub(crate) use load::{Loaded, load};
pub(crate) use metallic::MetallicRoughness;
pub(crate) use shape::Shape;
pub(crate) use texture::{Encoding, Texture, Wrap, srgb_to_linear};

use anyhow::Context as _;
use glam::{Affine2, DAffine3, DVec3, Vec2, Vec3, Vec4};
use std::path::PathBuf;
use std::sync::Arc;
use wrt_core::{Frame, Glazing, Sky};

/// Everything a file says about what there is to see.
#[derive(Debug, Default)]
pub(crate) struct Scene {
    /// One per node and primitive, in the file's order.
    pub(crate) meshes: Vec<Mesh>,
    pub(crate) materials: Vec<Material>,
    pub(crate) textures: Vec<Texture>,
    pub(crate) cameras: Vec<Camera>,
    pub(crate) lights: Vec<PunctualLight>,
    pub(crate) animations: Vec<Animation>,
    /// Radiance of the ambient term, the same from everywhere.
    pub(crate) ambient: Vec3,
    /// The weather outside, which lights the windows.
    pub(crate) sky: Option<Sky>,
}

/// Triangles of one material, in world space.
#[derive(Debug, Default)]
pub(crate) struct Mesh {
    /// The node's name; what a `.wct` patch is bound by.
    pub(crate) name: String,
    pub(crate) positions: Vec<DVec3>,
    /// Unit shading normals, one a vertex; empty for flat shading.
    pub(crate) normals: Vec<Vec3>,
    /// Texture coordinates of sets 0 and 1, one a vertex; empty if there are none.
    pub(crate) uvs: [Vec<Vec2>; 2],
    /// Linear colours and alpha that multiply the material's, one a vertex; empty
    /// for white.
    pub(crate) colours: Vec<Vec4>,
    /// Unit tangents of the normal map, w the bitangent's sign; empty where they
    /// follow from the texture coordinates.
    pub(crate) tangents: Vec<Vec4>,
    /// Counter-clockwise seen from the front.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Index into [`Scene::materials`].
    pub(crate) material: usize,
    /// Marked `receiver` in the file.
    pub(crate) receiver: bool,
    /// Local to world, for directions authored in local coordinates.
    pub(crate) transform: DAffine3,
}

/// Phong reflection, mirror and emission of a surface.
#[derive(Clone, Debug)]
pub(crate) struct Material {
    pub(crate) name: String,
    /// Diffuse reflectance k_d, multiplied by `base_texture`.
    pub(crate) kd: Vec3,
    /// Specular reflectance k_s.
    pub(crate) ks: Vec3,
    /// Phong exponent n ≥ 0.
    pub(crate) exponent: f32,
    pub(crate) base_texture: Option<Map>,
    /// What k_d, k_s and n follow from at each point, where textures make more
    /// than k_d vary. The values above are then those of the textures' means.
    pub(crate) metallic: Option<MetallicRoughness>,
    /// Tangent-space normals, and what scales their x and y.
    pub(crate) normal_map: Option<(Map, f32)>,
    /// Reduces the ambient term: the red channel, and how much of it counts.
    pub(crate) occlusion: Option<(Map, f32)>,
    pub(crate) alpha: Alpha,
    /// Shows its base colour as it is: it radiates that and reflects nothing, nor
    /// does it light anything.
    pub(crate) unlit: bool,
    /// Radiance emitted at the lobe's peak, multiplied by `emission_texture`.
    pub(crate) emission: Vec3,
    pub(crate) emission_texture: Option<Map>,
    /// `None`: Lambertian.
    pub(crate) lobe: Option<Lobe>,
    /// What a window lets through of the light from outside.
    pub(crate) glazing: Option<Glazing>,
    /// The same as a BSDF's file, relative to the scene's, until that is read.
    pub(crate) glazing_file: Option<PathBuf>,
    /// Fraction of the light at normal incidence that passes, 0 for opaque.
    pub(crate) transmission: f32,
    /// What light that passes is multiplied by; `None`: by the diffuse colour.
    pub(crate) filter: Option<Vec3>,
    pub(crate) ior: f32,
    /// Reflects as a perfect mirror, times k_s.
    pub(crate) mirror: bool,
    pub(crate) double_sided: bool,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: String::new(),
            kd: Vec3::splat(0.5),
            ks: Vec3::ZERO,
            exponent: 0.0,
            base_texture: None,
            metallic: None,
            normal_map: None,
            occlusion: None,
            alpha: Alpha::Opaque,
            unlit: false,
            emission: Vec3::ZERO,
            emission_texture: None,
            lobe: None,
            glazing: None,
            glazing_file: None,
            transmission: 0.0,
            filter: None,
            ior: 1.5,
            mirror: false,
            double_sided: false,
        }
    }
}

/// A cosⁿ emission lobe about a direction, or weather seen through a window.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Lobe {
    /// n: radiance ∝ max(0, μ·peak)ⁿ for light that travels along μ.
    pub(crate) exponent: f64,
    /// Unit direction of travel at the peak, in the mesh's local coordinates.
    pub(crate) peak: DVec3,
    /// Replaces both where it is given.
    pub(crate) window: Option<Window>,
}

/// The light that comes through a window from outside, in the world.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Window {
    /// Its normal is the window's inner one, ŷ points as far up as it can.
    pub(crate) frame: Frame,
    /// All of the light but sunlight that goes straight through clear glass.
    pub(crate) light: wrt_core::Lobe,
    pub(crate) sunlight: Option<Sunlight>,
}

/// Sunlight behind a pane of clear glass, without the glass's colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sunlight {
    /// Unit direction of travel of the light from the sun's centre.
    pub(crate) travel: DVec3,
    /// Of the sun's disc.
    pub(crate) radiance: f64,
}

/// What a surface hides, by its alpha: a factor, times the base texture's, times
/// the vertices'.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) enum Alpha {
    /// All, whatever its alpha.
    #[default]
    Opaque,
    /// All where alpha is at least `cutoff`, elsewhere nothing.
    Mask { factor: f32, cutoff: f32 },
    /// The part alpha of what is behind it.
    Blend { factor: f32 },
}

/// A texture as one material uses it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Map {
    /// Index into [`Scene::textures`].
    pub(crate) texture: usize,
    /// Index into [`Mesh::uvs`].
    pub(crate) set: usize,
    /// From the mesh's texture coordinates to the texture's (`KHR_texture_transform`).
    pub(crate) transform: Affine2,
}

impl Map {
    /// `texture` by the first set of texture coordinates, as they are.
    pub(crate) fn of(texture: usize) -> Self {
        Self { texture, set: 0, transform: Affine2::IDENTITY }
    }
}

impl Mesh {
    /// The texture coordinates that `map` has for `vertex`; (0, 0) if there are none.
    pub(crate) fn uv(&self, map: &Map, vertex: usize) -> Vec2 {
        let uv = self.uvs[map.set].get(vertex).copied().unwrap_or_default();
        map.transform.transform_point2(uv)
    }
}

/// Looks along −z of `transform`, +y up.
#[derive(Clone, Debug)]
pub(crate) struct Camera {
    /// Its node's name.
    pub(crate) name: String,
    /// Camera to world, without scale.
    pub(crate) transform: DAffine3,
    pub(crate) projection: Projection,
    /// Width over height that the author had in mind.
    pub(crate) aspect: Option<f64>,
}

/// How a [`Camera`] brings the world to its picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Projection {
    Perspective {
        /// Vertical field of view, radians.
        yfov: f64,
    },
    Orthographic {
        /// Half of what the picture shows from top to bottom, metres.
        half_height: f64,
    },
}

/// KHR_lights_punctual.
#[derive(Clone, Debug)]
pub(crate) struct PunctualLight {
    /// Colour times intensity: W sr⁻¹ (point, spot) or W m⁻² (directional).
    pub(crate) intensity: Vec3,
    pub(crate) position: DVec3,
    /// Direction the light travels in (spot, directional).
    pub(crate) direction: DVec3,
    pub(crate) kind: LightKind,
    /// No light past this distance.
    pub(crate) range: Option<f64>,
}

impl PunctualLight {
    /// Puts the light where its node is, shining along the node's −z.
    ///
    /// # Errors
    ///
    /// If it needs a direction and `world` leaves none.
    pub(crate) fn place(&mut self, world: &DAffine3) -> anyhow::Result<()> {
        let direction = (world.matrix3 * DVec3::NEG_Z).try_normalize();
        self.direction = match self.kind {
            LightKind::Point => direction.unwrap_or(DVec3::NEG_Z),
            _ => direction.context("its light has no direction: it is scaled to nothing")?,
        };
        self.position = world.translation;
        Ok(())
    }
}

/// Which law a [`PunctualLight`] follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum LightKind {
    Point,
    Directional,
    /// Half angles, radians.
    Spot {
        inner: f64,
        outer: f64,
    },
}

/// A flight: one camera, still or with key frames, among things that move.
#[derive(Clone, Debug)]
pub(crate) struct Animation {
    pub(crate) name: String,
    /// Index into [`Scene::cameras`].
    pub(crate) camera: usize,
    /// Seconds.
    pub(crate) duration: f64,
    /// The camera's transform, sampled finely enough to interpolate linearly:
    /// pairs of (seconds, camera to world), increasing in time. Empty for a still one.
    pub(crate) keys: Vec<(f64, DAffine3)>,
    /// What else moves meanwhile.
    pub(crate) movers: Vec<Mover>,
}

/// A mesh or light on its way.
#[derive(Clone, Debug)]
pub(crate) struct Mover {
    pub(crate) moved: Moved,
    /// Of its node.
    pub(crate) path: NodePath,
}

/// What a [`Mover`] moves.
#[derive(Clone, Debug)]
pub(crate) enum Moved {
    Mesh {
        /// Index into [`Scene::meshes`].
        index: usize,
        shape: Arc<Shape>,
    },
    /// Index into [`Scene::lights`].
    Light(usize),
}

#[cfg(test)]
mod tests;
