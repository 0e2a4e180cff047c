//! A scene's light, baked: emission → transport → reflection → compression.

mod check;
mod emitters;
mod receivers;

use crate::scene::Scene;
use check::{Checked, check};
use emitters::{Emitter, emitters};
use glam::DVec3;
use receivers::receivers;
use std::{
    collections::BTreeMap,
    time::{Duration, Instant},
};
use wrt_core::transport::{
    BlockOptions, Method, RecursionOptions, TransportGeometry, transport_block, transport_tree,
};
use wrt_core::wct_file::{ChartKind, Side};
use wrt_core::{
    Compression, Emission, Grid, Keep, Levels, Lobe, LobeMatrix, Patch, PatchGeometry, Polygon,
    Sampler, TreeBuilder, reflect,
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
        match emitter.emission.lobe() {
            Lobe::Lambertian => {}
            Lobe::Cosine { exponent, peak } => hash.points(&[*peak, DVec3::splat(*exponent)]),
            Lobe::Table { factors, x, .. } => {
                hash.points(&[x.extend(0.0)]);
                hash.add(factors.iter().flat_map(|f| f.to_le_bytes()));
            }
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
