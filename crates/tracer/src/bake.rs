//! A scene's light, baked: emission → transport → reflection → compression.

mod blocked;
mod check;
mod emitters;
mod flight;
mod receivers;
mod smooth;
#[cfg(test)]
mod weather_tests;

use crate::scene::{Scene, surfaces};
pub(crate) use blocked::{Blocked, blocked};
use check::{Checked, check};
pub(crate) use emitters::emissions;
use emitters::{Emitter, emitters};
pub(crate) use flight::Flight;
use glam::{DVec3, Vec2};
use rayon::prelude::*;
pub(crate) use receivers::{Receiver, receivers};
use std::{
    collections::BTreeMap,
    fmt,
    time::{Duration, Instant},
};
use wrt_core::legendre::Orders;
use wrt_core::transport::{
    BlockOptions, Method, RecursionOptions, TransportGeometry, transport_block, transport_tree,
    transport_within,
};
use wrt_core::wct_file::{ChartKind, Side};
use wrt_core::{
    Emission, Grid, Keep, Levels, Lobe, LobeMatrix, Patch, PatchGeometry, Polygon, Sampler,
    SmoothPatch, Tree, TreeBuilder, reflect,
};

/// How to bake.
#[derive(Clone, Debug)]
pub(crate) struct BakeOptions {
    /// How in a smooth basis; `None` for Haar.
    pub(crate) smooth: Option<Smooth>,
    /// Whose views alone are wanted, in a smooth basis; `None` for all.
    pub(crate) flight: Option<Flight>,
    /// Levels of the incident and of the reflected radiance.
    pub(crate) levels: Levels,
    /// Level of the emitters' pictures.
    pub(crate) emission_level: u8,
    /// How the transport is integrated.
    pub(crate) transport: Transport,
    /// What thresholding keeps.
    pub(crate) keep: Keep,
    /// Whether a relative error to be kept is spent on quantisation, for the least
    /// bytes, rather than on thresholding, for the fewest coefficients.
    pub(crate) quantise: bool,
    /// Whether the incident radiance goes into the file as well.
    pub(crate) incident: bool,
    /// Points per patch at which the result is checked; 0 for no check.
    pub(crate) checks: u32,
}

/// How to bake in a smooth basis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Smooth {
    /// The error asked of the reflected radiance.
    pub(crate) error: f64,
    /// The highest orders.
    pub(crate) orders: Orders,
}

/// How the transport is integrated.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Transport {
    /// Whole blocks by area-exact resampling, to this relative L² error.
    Within(f64),
    /// The same with a fixed number of samples.
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
#[derive(Debug, Default)]
pub(crate) struct Baked {
    pub(crate) patches: Vec<Patch>,
    pub(crate) smooth: Vec<SmoothPatch>,
    /// Of the reflected radiance, summed over the patches.
    pub(crate) before: usize,
    pub(crate) after: usize,
    /// Smooth patches that somebody looks at: all, if not baked for a flight. The errors
    /// are theirs.
    pub(crate) seen: usize,
    /// Coefficients that the full basis would have; 0 for a smooth one, which has no
    /// end.
    pub(crate) full: usize,
    /// ‖left out‖ / ‖L‖ over all patches.
    pub(crate) dropped: f64,
    /// Relative RMS error of the reflected radiance as it will be looked up,
    /// against direct quadrature at random points and directions; `None` if
    /// unchecked or dark.
    pub(crate) error: Option<f64>,
    /// Relative L² error of the incident radiance over all patches, as transport
    /// estimates it; `None` if it does not, or all is dark.
    pub(crate) transport_error: Option<f64>,
    /// Wall time per stage.
    pub(crate) times: [Duration; Stage::ALL.len()],
    /// Hash of the polygons, pictures and materials that went in.
    pub(crate) input_hash: String,
    pub(crate) warnings: Vec<String>,
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
    if let Some(how) = options.smooth {
        return smooth::bake(scene, options, how, progress);
    }
    let mut clock = Clock::default();
    let mut warnings = Vec::new();
    let (emitters, receivers) = clock.time(Stage::Project, || {
        anyhow::Ok((emitters(scene, options)?, receivers(scene, &mut warnings)?))
    })?;
    let mut hash = Hash::default();
    emitters.iter().for_each(|emitter| hash.emitter(emitter));
    let direct: Vec<(Polygon, Emission)> =
        emitters.iter().map(|e| (e.polygon.clone(), e.fine.clone())).collect();
    let mut lobes: BTreeMap<u64, LobeMatrix> = BTreeMap::new();
    let mut baked = Baked { warnings, ..Baked::default() };
    let (mut energy, mut lost) = (0.0, 0.0);
    let (mut arrived, mut off) = (0.0, Some(0.0));
    let mut checked = Checked::default();
    // Of each of as many as are compressed at once: transported, reflected.
    let mut waiting: Vec<(&Receiver, Side, Grid)> = Vec::new();
    progress(0, receivers.len());
    for (i, receiver) in receivers.iter().enumerate() {
        hash.receiver(receiver);
        let (incident, error) =
            clock.time(Stage::Transport, || transport(&emitters, &receiver.polygon, options))?;
        arrived += incident.norm_squared();
        off = off.zip(error).map(|(off, error)| off + error * error);
        let outgoing = clock.time(Stage::Reflect, || {
            let direction = options.levels.direction;
            let lobe = receiver.phong.is_glossy().then(|| {
                &*lobes.entry(receiver.phong.exponent.to_bits()).or_insert_with(|| {
                    LobeMatrix::phong(receiver.phong.exponent, direction, direction)
                })
            });
            reflect(&incident, &receiver.phong, lobe)
        });
        if options.incident {
            waiting.push((receiver, Side::Incident, incident));
        }
        waiting.push((receiver, Side::Outgoing, outgoing));
        if waiting.len() >= rayon::current_num_threads() || i + 1 == receivers.len() {
            let compressed: Vec<_> = clock.time(Stage::Compress, || {
                waiting.par_iter().map(|(_, _, grid)| compress(grid, options)).collect()
            });
            for ((receiver, side, _), (tree, compression)) in waiting.drain(..).zip(compressed) {
                if side == Side::Outgoing {
                    baked.before += compression.before;
                    baked.after += compression.after;
                    baked.full += options.levels.positions() * options.levels.directions();
                    let norm = compression.norm_squared;
                    energy += norm;
                    lost += norm * compression.relative_error.powi(2);
                }
                let error_estimate = if side == Side::Outgoing && options.checks > 0 {
                    clock.time(Stage::Check, || {
                        let sampler = Sampler::new(&tree);
                        let look_up = |q: [f64; 4], _| sampler.multilinear(q);
                        let own = check(receiver, &direct, None, &look_up, options.checks);
                        checked.add(&own);
                        own.relative()
                    })
                } else {
                    None
                };
                let name = &receiver.planar.name;
                let vertices = receiver.planar.vertices.iter().map(|v| v.to_array()).collect();
                baked.patches.push(Patch {
                    name: match side {
                        Side::Incident => format!("{name}.incident"),
                        Side::Outgoing => name.clone(),
                    },
                    polygon: PatchGeometry { vertices, chart: ChartKind::Rectilinear },
                    side,
                    tree,
                    relative_error: compression.relative_error,
                    error_estimate,
                });
            }
        }
        progress(i + 1, receivers.len());
    }
    baked.dropped = if energy > 0.0 { (lost / energy).sqrt() } else { 0.0 };
    baked.error = checked.relative();
    baked.transport_error = off.filter(|_| arrived > 0.0).map(|off| (off / arrived).sqrt());
    baked.times = clock.times;
    baked.input_hash = hash.to_string();
    Ok(baked)
}

/// What compressing one patch did.
struct Compressed {
    before: usize,
    after: usize,
    norm_squared: f64,
    relative_error: f64,
}

fn compress(grid: &Grid, options: &BakeOptions) -> (Tree, Compressed) {
    let full = TreeBuilder::from_grid(grid).finish();
    let (tree, relative_error) = match options.keep {
        Keep::RelativeError(error) if options.quantise => {
            let (tree, quantisation) = full.quantised(error);
            (tree, quantisation.relative_error)
        }
        keep => {
            let (tree, compression) = full.compressed(keep);
            (tree, compression.relative_error)
        }
    };
    let (before, after) = (full.len(), tree.len());
    let norm_squared = full.norm_squared();
    (tree, Compressed { before, after, norm_squared, relative_error })
}

/// Incident radiance of all emitters on one receiver, and the estimated norm of its
/// error: no more than the sum of those of the emitters.
fn transport(
    emitters: &[Emitter],
    receiver: &Polygon,
    options: &BakeOptions,
) -> wrt_core::Result<(Grid, Option<f64>)> {
    let levels = options.levels;
    let mut error = Some(0.0);
    let grids: Vec<Grid> = emitters
        .iter()
        .map(|emitter| -> wrt_core::Result<Grid> {
            let geometry = TransportGeometry::new(emitter.polygon.clone(), receiver.clone());
            match &options.transport {
                Transport::Within(tolerance) => {
                    let found = transport_within(&geometry, &emitter.emission, levels, *tolerance)?;
                    let norm = found.grid.norm_squared().sqrt();
                    error = error.map(|error| error + found.relative_error * norm);
                    Ok(found.grid)
                }
                Transport::Block(block) => {
                    error = None;
                    transport_block(&geometry, &emitter.emission, levels, *block)
                }
                Transport::Recursion(method) => {
                    error = None;
                    let source = emitter.emission.project(levels.direction);
                    let tree = TreeBuilder::from_grid(&source).finish();
                    let recursion = RecursionOptions { integrator: method, oracle: true };
                    Ok(transport_tree(&geometry, &tree, levels, &recursion).0.finish().to_grid())
                }
            }
        })
        .collect::<wrt_core::Result<_>>()?;
    Ok((Grid::sum(levels, grids), error))
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

/// Says which windows and floors a scene has: where they are, what shines and what
/// reflects. Radiance baked from others is not this scene's.
pub(crate) fn fingerprint(scene: &Scene) -> String {
    /// Places of a texture along each side.
    const SIDE: u16 = 64;
    let mut hash = Hash::default();
    for emitter in surfaces::emitters(scene) {
        let material = &scene.materials[scene.meshes[emitter.mesh].material];
        hash.points(&emitter.vertices);
        hash.points(&[material.emission.as_dvec3()]);
        if let Some(lobe) = &material.lobe {
            hash.points(&[lobe.peak, DVec3::splat(lobe.exponent)]);
        }
        if let Some(map) = &material.emission_texture {
            let centre = |i: u16| (f32::from(i) + 0.5) / f32::from(SIDE);
            for (i, j) in (0..SIDE).flat_map(|j| (0..SIDE).map(move |i| (i, j))) {
                let colour = scene.textures[map.texture].at(Vec2::new(centre(i), centre(j)));
                hash.add(colour.to_array().into_iter().flat_map(f32::to_le_bytes));
            }
        }
    }
    for receiver in surfaces::receivers(scene) {
        let material = &scene.materials[scene.meshes[receiver.mesh].material];
        hash.points(&receiver.vertices);
        hash.points(&[material.kd.as_dvec3(), material.ks.as_dvec3()]);
        hash.points(&[DVec3::splat(f64::from(material.exponent))]);
    }
    hash.to_string()
}

/// A hash of a file's content.
pub(crate) fn hash_of(bytes: impl IntoIterator<Item = u8>) -> String {
    let mut hash = Hash::default();
    hash.add(bytes);
    hash.to_string()
}

/// FNV-1a, 64 bits (G. Fowler, L. Noll, P. Vo): says "the same input", no more.
struct Hash(u64);

impl fmt::Display for Hash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "fnv1a64:{:016x}", self.0)
    }
}

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

    fn emitter(&mut self, emitter: &Emitter) {
        self.points(&emitter.polygon.vertices());
        self.add(emitter.fine.picture().iter().flatten().flat_map(|x| x.to_le_bytes()));
        match emitter.emission.lobe() {
            Lobe::Lambertian => {}
            Lobe::Cosine { exponent, peak } => self.points(&[*peak, DVec3::splat(*exponent)]),
            Lobe::Table { factors, x, .. } => {
                self.points(&[x.extend(0.0)]);
                self.add(factors.iter().flat_map(|f| f.to_le_bytes()));
            }
            Lobe::Disc { axis, radius } => self.points(&[*axis, DVec3::splat(*radius)]),
        }
    }

    fn receiver(&mut self, receiver: &Receiver) {
        self.points(&receiver.polygon.vertices());
        self.points(&[receiver.phong.kd.into(), receiver.phong.ks.into()]);
        self.points(&[DVec3::splat(receiver.phong.exponent)]);
    }

    fn points(&mut self, points: &[DVec3]) {
        self.add(points.iter().flat_map(|p| p.to_array()).flat_map(f64::to_le_bytes));
    }
}
