//! A scene's light, baked: emission → transport → reflection → compression.

use crate::scene::{
    Material, Scene, Texture,
    surfaces::{self, PlanarPolygon},
};
use anyhow::{Context as _, bail};
use glam::{DMat3, DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::{
    collections::BTreeMap,
    time::{Duration, Instant},
};
use wrt_core::transport::{
    BlockOptions, Method, RecursionOptions, TransportGeometry, transport_block, transport_tree,
};
use wrt_core::wct_file::{ChartKind, Side};
use wrt_core::{
    Compression, Emission, Grid, Keep, Levels, Lobe, LobeMatrix, Nusselt, Patch, PatchGeometry,
    Phong, Polygon, Sampler, TreeBuilder, gather, reflect,
};

/// How to bake.
#[derive(Clone, Debug)]
pub(crate) struct BakeOptions {
    /// Levels of the incident and of the reflected radiance.
    pub(crate) levels: Levels,
    /// Level of the emitters' pictures.
    pub(crate) emission_level: u8,
    /// How the transport is integrated.
    pub(crate) transport: Transport,
    /// What thresholding keeps.
    pub(crate) keep: Keep,
    /// Whether the incident radiance goes into the file as well.
    pub(crate) incident: bool,
    /// Points per patch at which the result is checked; 0 for no check.
    pub(crate) checks: u32,
}

/// How the transport is integrated.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Transport {
    /// Whole blocks by area-exact resampling.
    Block(BlockOptions),
    /// The paper's recursion, each coefficient by this rule.
    Recursion(Method),
}

/// A bake's steps, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stage {
    Project,
    Transport,
    Reflect,
    Compress,
    Check,
}

impl Stage {
    pub(crate) const ALL: [Self; 5] =
        [Self::Project, Self::Transport, Self::Reflect, Self::Compress, Self::Check];

    /// What it is called in a report.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Project => "projection",
            Self::Transport => "transport",
            Self::Reflect => "reflection",
            Self::Compress => "compression",
            Self::Check => "check",
        }
    }
}

/// What a bake made, and what it cost.
#[derive(Debug)]
pub(crate) struct Baked {
    pub(crate) patches: Vec<Patch>,
    /// Of the reflected radiance, summed over the patches.
    pub(crate) before: usize,
    pub(crate) after: usize,
    /// Coefficients that the full basis would have.
    pub(crate) full: usize,
    /// ‖dropped‖ / ‖L‖ over all patches.
    pub(crate) dropped: f64,
    /// Relative RMS error of the reflected radiance as it will be looked up,
    /// against direct quadrature at random points and directions; `None` if
    /// unchecked or dark.
    pub(crate) error: Option<f64>,
    /// Wall time per stage.
    pub(crate) times: [Duration; Stage::ALL.len()],
    /// Hash of the polygons, pictures and materials that went in.
    pub(crate) input_hash: u64,
    pub(crate) warnings: Vec<String>,
}

struct Emitter {
    polygon: Polygon,
    emission: Emission,
    /// Twice as fine, for the check.
    fine: Emission,
}

struct Receiver {
    planar: PlanarPolygon,
    polygon: Polygon,
    phong: Phong,
}

/// Bakes all receivers of the scene. `progress` is told when a receiver is done,
/// of how many.
///
/// # Errors
///
/// If nothing emits or receives, or a polygon cannot be used; by name.
pub(crate) fn bake(
    scene: &Scene,
    options: &BakeOptions,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> anyhow::Result<Baked> {
    let mut clock = Clock::default();
    let mut warnings = Vec::new();
    let (emitters, receivers) = clock.time(Stage::Project, || {
        anyhow::Ok((emitters(scene, options)?, receivers(scene, &mut warnings)?))
    })?;
    let mut hash = Hash::default();
    for emitter in &emitters {
        hash.points(&emitter.polygon.vertices());
        hash.add(emitter.fine.picture().iter().flatten().flat_map(|x| x.to_le_bytes()));
        if let Lobe::Cosine { exponent, peak } = emitter.emission.lobe() {
            hash.points(&[peak, DVec3::splat(exponent)]);
        }
    }
    let direct: Vec<(Polygon, Emission)> =
        emitters.iter().map(|e| (e.polygon.clone(), e.fine.clone())).collect();
    let mut lobes: BTreeMap<u64, LobeMatrix> = BTreeMap::new();
    let mut baked = Baked {
        patches: Vec::new(),
        before: 0,
        after: 0,
        full: 0,
        dropped: 0.0,
        error: None,
        times: [Duration::ZERO; Stage::ALL.len()],
        input_hash: 0,
        warnings,
    };
    let (mut energy, mut lost) = (0.0, 0.0);
    let mut checked = Checked::default();
    progress(0, receivers.len());
    for (i, receiver) in receivers.iter().enumerate() {
        hash.points(&receiver.polygon.vertices());
        hash.points(&[receiver.phong.kd.into(), receiver.phong.ks.into()]);
        hash.points(&[DVec3::splat(receiver.phong.exponent)]);
        let incident =
            clock.time(Stage::Transport, || transport(&emitters, &receiver.polygon, options));
        let outgoing = clock.time(Stage::Reflect, || {
            let direction = options.levels.direction;
            let lobe = receiver.phong.is_glossy().then(|| {
                &*lobes.entry(receiver.phong.exponent.to_bits()).or_insert_with(|| {
                    LobeMatrix::phong(receiver.phong.exponent, direction, direction)
                })
            });
            reflect(&incident, &receiver.phong, lobe)
        });
        let mut add = |grid: &Grid, side, name: String| -> Compression {
            let full = TreeBuilder::from_grid(grid).finish();
            let (tree, compression) = full.compressed(options.keep);
            if side == Side::Outgoing {
                baked.before += compression.before;
                baked.after += compression.after;
                baked.full += options.levels.positions() * options.levels.directions();
                let norm = full.norm_squared();
                energy += norm;
                lost += norm * compression.relative_error.powi(2);
            }
            let vertices = receiver.planar.vertices.iter().map(|v| v.to_array()).collect();
            baked.patches.push(Patch {
                name,
                polygon: PatchGeometry { vertices, chart: ChartKind::Rectilinear },
                side,
                tree,
                relative_error: compression.relative_error,
                error_estimate: None,
            });
            compression
        };
        clock.time(Stage::Compress, || {
            let name = &receiver.planar.name;
            if options.incident {
                add(&incident, Side::Incident, format!("{name}.incident"));
            }
            add(&outgoing, Side::Outgoing, name.clone());
        });
        if options.checks > 0 {
            clock.time(Stage::Check, || {
                let Some(patch) = baked.patches.last_mut() else { return };
                let sampler = Sampler::new(&patch.tree);
                let own = check(receiver, &direct, &sampler, options.checks);
                patch.error_estimate = own.relative();
                checked.add(&own);
            });
        }
        progress(i + 1, receivers.len());
    }
    baked.dropped = if energy > 0.0 { (lost / energy).sqrt() } else { 0.0 };
    baked.error = checked.relative();
    baked.times = clock.times;
    baked.input_hash = hash.0;
    Ok(baked)
}

/// Incident radiance of all emitters on one receiver.
fn transport(emitters: &[Emitter], receiver: &Polygon, options: &BakeOptions) -> Grid {
    let levels = options.levels;
    let grids = emitters.iter().map(|emitter| {
        let geometry = TransportGeometry::new(emitter.polygon.clone(), receiver.clone());
        match &options.transport {
            Transport::Block(block) => {
                transport_block(&geometry, &emitter.emission, levels, *block)
            }
            Transport::Recursion(method) => {
                let source = emitter.emission.project(levels.direction);
                let tree = TreeBuilder::from_grid(&source).finish();
                let recursion = RecursionOptions { integrator: method, oracle: true };
                transport_tree(&geometry, &tree, levels, &recursion).0.finish().to_grid()
            }
        }
    });
    Grid::sum(levels, grids)
}

/// Squared error and squared reference, summed over checks.
#[derive(Clone, Copy, Debug, Default)]
struct Checked {
    error: f64,
    reference: f64,
}

impl Checked {
    fn add(&mut self, other: &Self) {
        self.error += other.error;
        self.reference += other.reference;
    }

    fn relative(&self) -> Option<f64> {
        (self.reference > 0.0).then(|| (self.error / self.reference).sqrt())
    }
}

/// Looks the patch up at well-spread points and directions and compares with
/// direct quadrature over the emitters: the error that a picture will have.
fn check(
    receiver: &Receiver,
    emitters: &[(Polygon, Emission)],
    sampler: &Sampler,
    count: u32,
) -> Checked {
    // A Kronecker sequence in four dimensions (M. Roberts, 2018).
    const STEP: [f64; 4] = [
        0.856_674_883_854_502_9,
        0.733_891_856_627_125_8,
        0.628_706_721_037_808_8,
        0.538_597_257_223_608_1,
    ];
    let size = receiver.polygon.size().unwrap_or_default();
    let parts: Vec<Checked> = (1..=count)
        .into_par_iter()
        .filter_map(|i| {
            let q = STEP.map(|step| (0.5 + f64::from(i) * step).fract());
            let to_eye = Nusselt { kappa: q[2], lambda: q[3] }.to_direction()?;
            let frame = receiver.polygon.frame();
            let point = frame.point(DVec2::new(q[0], q[1]) * size);
            let cells = 1 << emitters.iter().map(|e| e.1.level()).max().unwrap_or(0);
            let exact = gather(emitters, frame, point, &receiver.phong, to_eye, cells);
            let found = sampler.multilinear(q);
            let mut sum = Checked::default();
            for (exact, found) in exact.iter().zip(found) {
                sum.error += (exact - f64::from(found)).powi(2);
                sum.reference += exact * exact;
            }
            Some(sum)
        })
        .collect();
    let mut sum = Checked::default();
    // In order, for the same bits from any number of threads.
    parts.iter().for_each(|part| sum.add(part));
    sum
}

fn emitters(scene: &Scene, options: &BakeOptions) -> anyhow::Result<Vec<Emitter>> {
    let found = surfaces::emitters(scene);
    if found.is_empty() {
        bail!(
            "nothing emits light: give a planar surface an emissive material (emissiveFactor, or Ke in an MTL file)"
        );
    }
    let emitter = |planar: &PlanarPolygon| {
        let polygon = Polygon::rectilinear(&planar.vertices)
            .with_context(|| format!("the emitter \"{}\"", planar.name))?;
        let mesh = &scene.meshes[planar.mesh];
        let material = &scene.materials[mesh.material];
        let lobe = match material.lobe {
            None => Lobe::Lambertian,
            Some(lobe) => {
                let peak = (mesh.transform.matrix3 * lobe.peak).normalize();
                Lobe::Cosine { exponent: lobe.exponent, peak: polygon.frame().to_local(peak) }
            }
        };
        let picture =
            |level| Emission::new(level, picture(scene, planar, material, &polygon, level), lobe);
        let emission = picture(options.emission_level);
        let fine = picture(options.emission_level + 1);
        Ok(Emitter { polygon, emission, fine })
    };
    found.iter().map(emitter).collect()
}

/// Mean emitted radiance over each cell of the polygon's chart, u fastest.
fn picture(
    scene: &Scene,
    planar: &PlanarPolygon,
    material: &Material,
    polygon: &Polygon,
    level: u8,
) -> Vec<[f32; 3]> {
    let texture = material.emission_texture.map(|i| &scene.textures[i]);
    let to_uv = texture.and_then(|_| texture_map(planar, polygon));
    let side = 1_usize << level;
    let texels = texture.map_or(1, |t| t.width.max(t.height));
    // A sample per texel; a clipped outline needs some even without a picture.
    let samples = texels.div_ceil(side).clamp(if polygon.fills_chart() { 1 } else { 8 }, 64);
    let size = polygon.size().unwrap_or_default();
    let cell = |i: usize| {
        let low = DVec2::new((i % side) as f64, (i / side) as f64);
        let mut sum = Vec3::ZERO;
        for s in 0..samples * samples {
            let at = DVec2::new((s % samples) as f64, (s / samples) as f64) + 0.5;
            let point = (low + at / samples as f64) / side as f64 * size;
            if !polygon.fills_chart() && !contains(polygon.outline(), point) {
                continue;
            }
            sum += match (texture, &to_uv) {
                (Some(texture), Some(map)) => texel(texture, (*map * point.extend(1.0)).truncate()),
                _ => Vec3::ONE,
            };
        }
        (material.emission * sum / (samples * samples) as f32).to_array()
    };
    (0..side * side).into_par_iter().map(cell).collect()
}

/// The affine map from the polygon's plane to texture coordinates, from its
/// first corners that span the plane; `None` without texture coordinates.
fn texture_map(planar: &PlanarPolygon, polygon: &Polygon) -> Option<DMat3> {
    let frame = polygon.frame();
    let plane = |v: &DVec3| frame.to_local(*v - frame.origin).truncate();
    let corner = |i: usize| {
        let uv: Vec2 = *planar.uvs.get(i)?;
        Some((plane(planar.vertices.get(i)?), uv.as_dvec2()))
    };
    let (a, b) = (corner(0)?, corner(1)?);
    (2..planar.vertices.len()).find_map(|i| {
        let c = corner(i)?;
        let columns = |p: DVec2, q: DVec2, r: DVec2| {
            DMat3::from_cols(p.extend(1.0), q.extend(1.0), r.extend(1.0))
        };
        let from = columns(a.0, b.0, c.0);
        (from.determinant().abs() > 1e-12).then(|| columns(a.1, b.1, c.1) * from.inverse())
    })
}

/// The texel at `uv`, repeating; a picture averages many of them.
fn texel(texture: &Texture, uv: DVec2) -> Vec3 {
    let at = |x: f64, n: usize| ((x.rem_euclid(1.0) * n as f64) as usize).min(n - 1);
    texture.texels[at(uv.y, texture.height) * texture.width + at(uv.x, texture.width)]
}

/// Whether a simple outline holds the point (even-odd rule).
fn contains(outline: &[DVec2], p: DVec2) -> bool {
    (0..outline.len()).fold(false, |inside, i| {
        let (a, b) = (outline[i], outline[(i + 1) % outline.len()]);
        let crosses =
            (a.y > p.y) != (b.y > p.y) && p.x < (b.x - a.x) * (p.y - a.y) / (b.y - a.y) + a.x;
        inside != crosses
    })
}

fn receivers(scene: &Scene, warnings: &mut Vec<String>) -> anyhow::Result<Vec<Receiver>> {
    let found = surfaces::receivers(scene);
    if found.is_empty() {
        bail!(
            "nothing receives light: mark a node's extras with \"wrt\": {{\"receiver\": true}}, or put a rectangle before the emitter"
        );
    }
    let receiver = |planar: PlanarPolygon| {
        let polygon = Polygon::rectilinear(&planar.vertices)
            .with_context(|| format!("the receiver \"{}\"", planar.name))?;
        let material = &scene.materials[scene.meshes[planar.mesh].material];
        if material.base_texture.is_some() {
            warnings.push(format!(
                "receiver \"{}\": the base-colour texture of material \"{}\" is not baked, only its factor",
                planar.name, material.name
            ));
        }
        let phong = Phong {
            kd: material.kd.as_dvec3().to_array(),
            // A mirror's k_s is the raytracer's recursive ray, not the patch's.
            ks: if material.mirror { [0.0; 3] } else { material.ks.as_dvec3().to_array() },
            exponent: f64::from(material.exponent),
        };
        Ok(Receiver { planar, polygon, phong })
    };
    found.into_iter().map(receiver).collect()
}

/// Wall time by stage.
#[derive(Default)]
struct Clock {
    times: [Duration; Stage::ALL.len()],
}

impl Clock {
    fn time<T>(&mut self, stage: Stage, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let out = work();
        self.times[stage as usize] += start.elapsed();
        out
    }
}

/// FNV-1a, 64 bits (G. Fowler, L. Noll, P. Vo): says "the same input", no more.
struct Hash(u64);

impl Default for Hash {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Hash {
    fn add(&mut self, bytes: impl IntoIterator<Item = u8>) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    fn points(&mut self, points: &[DVec3]) {
        self.add(points.iter().flat_map(|p| p.to_array()).flat_map(f64::to_le_bytes));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Mesh;

    /// A texture of four texels on a square whose texture coordinates turn it by a
    /// quarter: the picture turns with them.
    #[test]
    fn a_picture_follows_the_texture_coordinates() {
        let texels = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::ONE].to_vec();
        let planar = PlanarPolygon {
            mesh: 0,
            name: "window".to_owned(),
            vertices: vec![DVec3::ZERO, DVec3::X, DVec3::new(1., 1., 0.), DVec3::Y],
            uvs: vec![Vec2::X, Vec2::ONE, Vec2::Y, Vec2::ZERO],
            triangles: vec![0, 1],
        };
        let scene = Scene {
            meshes: vec![Mesh::default()],
            textures: vec![Texture { width: 2, height: 2, texels }],
            ..Scene::default()
        };
        let material = Material {
            emission: Vec3::splat(2.0),
            emission_texture: Some(0),
            ..Material::default()
        };
        let polygon = Polygon::rectilinear(&planar.vertices).expect("a square");
        let picture = picture(&scene, &planar, &material, &polygon, 1);
        // Corner 0 (u = v = 0) has texture (1, 0): texel 1; corner 1 (1, 1): texel 3.
        assert_eq!(picture[0], [0.0, 2.0, 0.0]);
        assert_eq!(picture[1], [2.0, 2.0, 2.0]);
        assert_eq!(picture[2], [2.0, 0.0, 0.0]);
        assert_eq!(picture[3], [0.0, 0.0, 2.0]);
    }

    #[test]
    fn a_triangle_s_picture_is_dark_outside_it() {
        let planar = PlanarPolygon {
            mesh: 0,
            name: "lamp".to_owned(),
            vertices: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
            uvs: vec![],
            triangles: vec![0],
        };
        let material = Material { emission: Vec3::ONE, ..Material::default() };
        let polygon = Polygon::rectilinear(&planar.vertices).expect("a triangle");
        let picture = picture(&Scene::default(), &planar, &material, &polygon, 2);
        let area: f32 = picture.iter().map(|rgb| rgb[0]).sum::<f32>() / 16.0;
        assert!((area - 0.5).abs() < 0.02, "half the square: {area}");
        assert_eq!((picture[0][0], picture[15][0]), (1.0, 0.0));
    }
}
