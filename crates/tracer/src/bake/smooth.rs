//! Reflected radiance in a smooth basis, straight from the emitters.

use super::check::{Checked, check};
use super::emitters::emitters;
use super::receivers::{Receiver, receivers};
use super::{BakeOptions, Baked, Clock, Hash, Smooth, Stage};
use crate::scene::Scene;
use wrt_core::beams::{AreaLight, Illuminant};
use wrt_core::legendre::{LegendreSampler, ProjectOptions, Projected, Reflected, project};
use wrt_core::wct_file::ChartKind;
use wrt_core::{Emission, PatchGeometry, Polygon, SmoothPatch};

/// Bakes all receivers with the same relative error each.
pub(super) fn bake(
    scene: &Scene,
    options: &BakeOptions,
    Smooth { error, orders }: Smooth,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> anyhow::Result<Baked> {
    let mut clock = Clock::default();
    let mut baked = Baked::default();
    let mut hash = Hash::default();
    let (emitters, receivers, lights) = clock.time(Stage::Project, || {
        let emitters = emitters(scene, options)?;
        let light = |e: &super::Emitter| AreaLight::new(&e.polygon, e.fine.clone());
        let lights: Vec<AreaLight> = emitters.iter().map(light).collect();
        anyhow::Ok((emitters, receivers(scene, &mut baked.warnings)?, lights))
    })?;
    emitters.iter().for_each(|emitter| hash.emitter(emitter));
    let lights: Vec<&dyn Illuminant> = lights.iter().map(|light| light as _).collect();
    // A picture half as fine as the lights' is another quadrature.
    let direct: Vec<(Polygon, Emission)> =
        emitters.into_iter().map(|e| (e.polygon, e.emission)).collect();
    let (mut energy, mut lost) = (0.0, 0.0);
    let mut checked = Checked::default();
    progress(0, receivers.len());
    for (i, receiver) in receivers.iter().enumerate() {
        hash.receiver(receiver);
        let Projected { tree, error: told, norm_squared } = clock.time(Stage::Reflect, || {
            let reflected = Reflected::new(&receiver.polygon, &receiver.phong, &lights);
            let options = ProjectOptions { error, orders, ..ProjectOptions::default() };
            project(&reflected, &options)
        });
        baked.after += tree.len();
        energy += norm_squared;
        lost += norm_squared * told * told;
        if told > error {
            baked.warnings.push(format!(
                "receiver \"{}\": {:.2} % is the best that the basis does, where {:.2} % is asked for",
                receiver.planar.name,
                100.0 * told,
                100.0 * error
            ));
        }
        let mut patch = patch(receiver, tree, told);
        if options.checks > 0 {
            let own = clock.time(Stage::Check, || {
                let sampler = LegendreSampler::new(&patch.tree);
                let look_up =
                    |q: [f64; 4], to_eye| sampler.radiance(glam::DVec2::new(q[0], q[1]), to_eye);
                check(receiver, &direct, &look_up, options.checks)
            });
            patch.error_estimate = own.relative();
            checked.add(&own);
        }
        baked.smooth.push(patch);
        progress(i + 1, receivers.len());
    }
    baked.dropped = if energy > 0.0 { (lost / energy).sqrt() } else { 0.0 };
    baked.error = checked.relative();
    baked.times = clock.times;
    baked.input_hash = hash.0;
    Ok(baked)
}

fn patch(receiver: &Receiver, tree: wrt_core::legendre::LegendreTree, told: f64) -> SmoothPatch {
    let vertices = receiver.planar.vertices.iter().map(|v| v.to_array()).collect();
    SmoothPatch {
        name: receiver.planar.name.clone(),
        polygon: PatchGeometry { vertices, chart: ChartKind::Rectilinear },
        tree,
        relative_error: told,
        error_estimate: None,
    }
}
