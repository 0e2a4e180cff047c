//! Reflected radiance in a smooth basis, straight from the emitters.

use super::check::{Checked, check};
use super::emitters::emitters;
use super::receivers::{Receiver, receivers};
use super::{BakeOptions, Baked, Clock, Flight, Hash, Smooth, Stage};
use crate::scene::Scene;
use glam::{DVec2, DVec3};
use wrt_core::beams::{AreaLight, Illuminant};
use wrt_core::legendre::{
    LegendreSampler, ProjectOptions, Projected, Radiance, Reflected, ViewSet, project,
};
use wrt_core::wct_file::ChartKind;
use wrt_core::{DirectionMap, Emission, Frame, PatchGeometry, Polygon, SmoothPatch};

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
    let flight = options.flight.as_ref();
    let (mut energy, mut lost) = (0.0, 0.0);
    let mut checked = Checked::default();
    progress(0, receivers.len());
    for (i, receiver) in receivers.iter().enumerate() {
        hash.receiver(receiver);
        let made = clock.time(Stage::Reflect, || {
            let reflected = Reflected::new(&receiver.polygon, &receiver.phong, &lights);
            let frame = receiver.polygon.frame();
            let size = receiver.polygon.size().unwrap_or_default();
            let options = ProjectOptions { error, orders, ..ProjectOptions::default() };
            project(&Watched { reflected, frame, size, flight }, &options)
        });
        let Projected { tree, error: told, norm_squared, is_seen } = made;
        baked.after += tree.len();
        if is_seen {
            baked.seen += 1;
            energy += norm_squared;
            lost += norm_squared * told * told;
        }
        if is_seen && told > error {
            baked.warnings.push(format!(
                "receiver \"{}\": {:.2} % is the best that the basis does, where {:.2} % is asked for",
                receiver.planar.name,
                100.0 * told,
                100.0 * error
            ));
        }
        let mut patch = patch(receiver, tree, told);
        if options.checks > 0 && is_seen {
            let own = clock.time(Stage::Check, || {
                let sampler = LegendreSampler::new(&patch.tree);
                let look_up =
                    |q: [f64; 4], to_eye| sampler.radiance(DVec2::new(q[0], q[1]), to_eye);
                check(receiver, &direct, flight, &look_up, options.checks)
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
    baked.input_hash = hash.to_string();
    Ok(baked)
}

/// What a surface reflects, looked at by the cameras of a flight or, if there is none,
/// from everywhere.
struct Watched<'a> {
    reflected: Reflected<'a>,
    frame: &'a Frame,
    size: DVec2,
    flight: Option<&'a Flight>,
}

impl<'a> Radiance for Watched<'a> {
    type Place = <Reflected<'a> as Radiance>::Place;

    fn place(&self, uv: DVec2) -> Self::Place {
        self.reflected.place(uv)
    }

    fn radiance(&self, place: &Self::Place, mu: DVec3) -> [f64; 3] {
        self.reflected.radiance(place, mu)
    }

    fn is_plain(&self, place: &Self::Place, axis: DVec3, radius: f64) -> bool {
        self.reflected.is_plain(place, axis, radius)
    }

    fn scale(&self) -> f64 {
        self.reflected.scale()
    }

    fn views(&self, map: DirectionMap, uv: DVec2, reach: f64) -> Option<ViewSet> {
        let point = self.frame.point(uv * self.size);
        let within = (reach * self.size).length();
        self.flight.map(|flight| flight.views(map, self.frame, point, within))
    }
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
