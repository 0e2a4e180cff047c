//! The chapel as its glTF file says, lit by brute force: every texel of the
//! window is a small lamp. No wavelets, and no code of either crate.

use super::scene;
use glam::{DQuat, DVec2, DVec3};
use serde_json::Value;
use std::f64::consts::{PI, TAU};
use std::fs;

/// What the tiles are lit by, and the tiles.
pub(crate) struct Chapel {
    pub(crate) document: Value,
    pub(crate) tiles: Vec<Tile>,
    window: Window,
}

/// A square of the floor with sides along x and z, on y = 0.
pub(crate) struct Tile {
    pub(crate) name: String,
    pub(crate) kd: [f64; 3],
    pub(crate) ks: [f64; 3],
    n: f64,
    pub(crate) low: DVec2,
    pub(crate) high: DVec2,
}

/// A textured rectangle that shines with a cosⁿ lobe.
struct Window {
    /// The texture's upper left corner, and its sides.
    corner: DVec3,
    across: DVec3,
    down: DVec3,
    normal: DVec3,
    peak: DVec3,
    exponent: f64,
    width: usize,
    height: usize,
    /// Radiance along the peak, rows from the top.
    texels: Vec<[f64; 3]>,
}

/// A pinhole of the file.
pub(crate) struct Camera {
    origin: DVec3,
    rotation: DQuat,
    half_height: f64,
}

impl Chapel {
    pub(crate) fn read() -> Self {
        let text = fs::read_to_string(scene("chapel/chapel.gltf")).expect("the chapel");
        let document: Value = serde_json::from_str(&text).expect("glTF is JSON");
        let is_tile = |node: &&Value| node["extras"]["wrt"]["receiver"] == true;
        let tiles = list(&document["nodes"]).iter().filter(is_tile);
        let tiles: Vec<Tile> = tiles.map(|node| Tile::read(&document, node)).collect();
        assert_eq!(tiles.len(), 16, "tiles in the chapel");
        let window = Window::read(&document);
        Self { document, tiles, window }
    }

    /// The tile that holds `point` at least `margin` from its sides.
    pub(crate) fn tile_at(&self, point: DVec2, margin: f64) -> Option<&Tile> {
        self.tiles.iter().find(|tile| {
            let (from_low, to_high) = (point - tile.low, tile.high - point);
            from_low.min(to_high).min_element() >= margin
        })
    }

    /// Irradiance of the floor at (x, 0, z): ∫ L cosθ_s cosθ_d / r² dA.
    pub(crate) fn irradiance(&self, point: DVec2) -> [f64; 3] {
        self.window.gather(point, |_| [1.0; 3])
    }

    /// Radiance that `tile` reflects at (x, 0, z) towards the unit vector `to_eye`.
    pub(crate) fn reflected(&self, tile: &Tile, point: DVec2, to_eye: DVec3) -> [f64; 3] {
        self.window.gather(point, |to_light| {
            let mirrored = DVec3::new(-to_light.x, to_light.y, -to_light.z);
            let cosine = mirrored.dot(to_eye).max(0.0);
            let lobe = (tile.n + 2.0) / TAU * cosine.powf(tile.n);
            std::array::from_fn(|c| tile.kd[c] / PI + tile.ks[c] * lobe)
        })
    }

    pub(crate) fn camera(&self, name: &str) -> Camera {
        let node = named(&self.document, name);
        let camera = &self.document["cameras"][index(&node["camera"])]["perspective"];
        Camera {
            origin: vector(&node["translation"]),
            rotation: DQuat::from_array(numbers(&node["rotation"])).normalize(),
            half_height: (0.5 * number(&camera["yfov"])).tan(),
        }
    }
}

impl Tile {
    fn read(document: &Value, node: &Value) -> Self {
        let primitive = &document["meshes"][index(&node["mesh"])]["primitives"][0];
        let positions = &document["accessors"][index(&primitive["attributes"]["POSITION"])];
        let corner = |key: &str| {
            let corner = vector(&positions[key]) + vector(&node["translation"]);
            assert_eq!(corner.y, 0.0, "a tile lies on the floor");
            DVec2::new(corner.x, corner.z)
        };
        let material = &document["materials"][index(&primitive["material"])];
        let phong = &material["extras"]["wrt"]["phong"];
        Self {
            name: node["name"].as_str().expect("a name").to_owned(),
            kd: numbers(&phong["kd"]),
            ks: numbers(&phong["ks"]),
            n: number(&phong["n"]),
            low: corner("min"),
            high: corner("max"),
        }
    }
}

impl Window {
    fn read(document: &Value) -> Self {
        let node = named(document, "window");
        let offset = vector(&node["translation"]);
        let primitive = &document["meshes"][index(&node["mesh"])]["primitives"][0];
        let attribute = |key: &str| floats(document, index(&primitive["attributes"][key]));
        let (positions, uvs) = (attribute("POSITION"), attribute("TEXCOORD_0"));
        let at = |uv: [f64; 2]| {
            let corner = uvs.chunks_exact(2).position(|found| *found == uv);
            let corner = corner.expect("the picture fills the window");
            offset + DVec3::from_slice(&positions[3 * corner..])
        };
        let corner = at([0.0, 0.0]);
        let material = &document["materials"][index(&primitive["material"])];
        let emission = &material["extras"]["wrt"]["emission"];
        let strength = &material["extensions"]["KHR_materials_emissive_strength"];
        let strength = number(&strength["emissiveStrength"]);
        let factor: [f64; 3] = numbers(&material["emissiveFactor"]);
        let image = image::open(scene("chapel/window.png")).expect("the window").into_rgb8();
        let texel = |p: &image::Rgb<u8>| -> [f64; 3] {
            std::array::from_fn(|c| strength * factor[c] * linear(f64::from(p.0[c]) / 255.0))
        };
        Self {
            corner,
            across: at([1.0, 0.0]) - corner,
            down: at([0.0, 1.0]) - corner,
            normal: DVec3::from_slice(&attribute("NORMAL")),
            peak: vector(&emission["peak"]).normalize(),
            exponent: number(&emission["exponent"]),
            width: image.width() as usize,
            height: image.height() as usize,
            texels: image.pixels().map(texel).collect(),
        }
    }

    /// Σ L f(to the light) cosθ_s cosθ_d / r² ΔA over the texels, at (x, 0, z).
    fn gather(&self, point: DVec2, f: impl Fn(DVec3) -> [f64; 3]) -> [f64; 3] {
        let point = DVec3::new(point.x, 0.0, point.y);
        let texels = (self.width * self.height) as f64;
        let area = self.across.cross(self.down).length() / texels;
        let mut sum = [0.0; 3];
        for (i, texel) in self.texels.iter().enumerate() {
            let s = ((i % self.width) as f64 + 0.5) / self.width as f64;
            let t = ((i / self.width) as f64 + 0.5) / self.height as f64;
            let to = self.corner + s * self.across + t * self.down - point;
            let r2 = to.length_squared();
            let to_light = to / r2.sqrt();
            let (leaves, arrives) = (-to_light.dot(self.normal), to_light.y);
            let lobe = -to_light.dot(self.peak);
            if leaves <= 0.0 || arrives <= 0.0 || lobe <= 0.0 {
                continue;
            }
            let weight = lobe.powf(self.exponent) * leaves * arrives / r2 * area;
            let f = f(to_light);
            for c in 0..3 {
                sum[c] += weight * texel[c] * f[c];
            }
        }
        sum
    }
}

impl Camera {
    /// Where the ray through the centre of pixel (x, y) meets the floor, as
    /// (x, z), and the unit vector back to the eye.
    pub(crate) fn floor(&self, pixel: [usize; 2], size: [usize; 2]) -> Option<(DVec2, DVec3)> {
        let [x, y] = pixel.map(|i| i as f64 + 0.5);
        let [width, height] = size.map(|n| n as f64);
        let scale = 2.0 * self.half_height / height;
        let local = DVec3::new((x - 0.5 * width) * scale, (0.5 * height - y) * scale, -1.0);
        let ray = (self.rotation * local).normalize();
        let distance = -self.origin.y / ray.y;
        let hit = self.origin + distance * ray;
        (distance > 0.0 && distance.is_finite()).then(|| (DVec2::new(hit.x, hit.z), -ray))
    }
}

/// The sRGB transfer function, IEC 61966-2-1.
fn linear(encoded: f64) -> f64 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

fn list(value: &Value) -> &[Value] {
    value.as_array().expect("a list")
}

fn number(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

fn index(value: &Value) -> usize {
    usize::try_from(value.as_u64().expect("an index")).expect("a small index")
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    let numbers: Vec<f64> = list(value).iter().map(number).collect();
    numbers.try_into().expect("so many numbers")
}

fn vector(value: &Value) -> DVec3 {
    DVec3::from_array(numbers(value))
}

fn named<'a>(document: &'a Value, name: &str) -> &'a Value {
    let mut nodes = list(&document["nodes"]).iter();
    nodes.find(|node| node["name"] == name).expect("a node of that name")
}

/// An accessor's floats, from `chapel.bin`.
fn floats(document: &Value, accessor: usize) -> Vec<f64> {
    let accessor = &document["accessors"][accessor];
    assert_eq!(accessor["componentType"], 5126, "32-bit floats");
    let view = &document["bufferViews"][index(&accessor["bufferView"])];
    let start = view["byteOffset"].as_u64().unwrap_or(0) as usize;
    let bytes = fs::read(scene("chapel/chapel.bin")).expect("the chapel's meshes");
    let bytes = &bytes[start..start + index(&view["byteLength"])];
    bytes.as_chunks().0.iter().map(|&b| f64::from(f32::from_le_bytes(b))).collect()
}
