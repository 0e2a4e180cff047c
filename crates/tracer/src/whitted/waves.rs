//! The rays of several ray trees, a generation at a time: what all of them meet is looked for
//! together.

use super::{MAX_LAYERS, MIN_WEIGHT, Room, Sample, Whitted};
use crate::{
    accel::{Found, Hit, Ray},
    camera::Beam,
    phong::Surface,
};
use glam::{DVec3, Vec3};

/// A ray of a tree that has yet to meet something.
#[derive(Clone, Debug)]
pub(super) struct Waiting {
    beam: Beam,
    /// How far along the beam what it has passed is.
    from: f64,
    /// Which tree it is of.
    tree: usize,
    /// Mirror and glass surfaces on its way so far.
    depth: u32,
    /// What arrives at the eye of the radiance that it finds.
    arriving: Vec3,
    /// The most of that, over channels, and of surfaces with alpha that were passed.
    weight: f32,
    /// Surfaces with alpha that were passed in a row.
    layers: u32,
}

/// Rays on their way, and room for what they need.
#[derive(Debug, Default)]
pub(crate) struct Waves {
    waiting: Vec<Waiting>,
    next: Vec<Waiting>,
    directions: Vec<DVec3>,
    rays: Vec<Ray>,
    found: Vec<Option<Found>>,
    room: Room,
}

impl Whitted<'_> {
    /// Adds the radiance that arrives along each of `beams` to its sample's. What is with
    /// it among the beams changes nothing.
    pub(crate) fn trace(&self, beams: &[Beam], samples: &mut [Sample], waves: &mut Waves) {
        self.find_first(beams, waves);
        let first = |(tree, beam): (usize, &Beam)| Waiting {
            beam: *beam,
            from: 0.0,
            tree,
            depth: 0,
            arriving: Vec3::ONE,
            weight: 1.0,
            layers: 0,
        };
        waves.waiting.clear();
        waves.waiting.extend(beams.iter().enumerate().map(first));
        while !waves.waiting.is_empty() {
            let mut next = std::mem::take(&mut waves.next);
            for (ray, found) in waves.waiting.drain(..).zip(&waves.found) {
                let hit = found.map(|found| self.accel.hit(&found, ray.beam.direction));
                let sample = &mut samples[ray.tree];
                self.meet(ray, hit, sample, &mut waves.room, &mut next);
            }
            waves.next = std::mem::replace(&mut waves.waiting, next);
            let ray = |waiting: &Waiting| {
                let Beam { origin, direction, .. } = waiting.beam;
                Ray { origin, direction, from: waiting.from }
            };
            waves.rays.clear();
            waves.rays.extend(waves.waiting.iter().map(ray));
            self.accel.find_each(&waves.rays, &mut waves.found);
        }
    }

    /// What each of `beams` meets first. Those from one point go together.
    fn find_first(&self, beams: &[Beam], waves: &mut Waves) {
        let origin = beams.first().map_or(DVec3::ZERO, |beam| beam.origin);
        if beams.iter().all(|beam| beam.origin == origin) {
            waves.directions.clear();
            waves.directions.extend(beams.iter().map(|beam| beam.direction));
            self.accel.find_of(origin, &waves.directions, &mut waves.found);
        } else {
            let ray =
                |beam: &Beam| Ray { origin: beam.origin, direction: beam.direction, from: 0.0 };
            waves.rays.clear();
            waves.rays.extend(beams.iter().map(ray));
            self.accel.find_each(&waves.rays, &mut waves.found);
        }
    }

    /// Adds what `ray` finds at `hit`, or where it meets nothing, to its sample, and the
    /// rays that go on from there to `next`.
    fn meet(
        &self,
        mut ray: Waiting,
        hit: Option<Hit>,
        sample: &mut Sample,
        room: &mut Room,
        next: &mut Vec<Waiting>,
    ) {
        sample.rays += 1;
        let Some(hit) = hit else {
            sample.radiance += ray.arriving * self.background;
            return;
        };
        let beam = &ray.beam;
        let footprint = beam.footprint(hit.position, hit.normal);
        let surface = Surface::over(self.scene, &hit, -beam.direction, footprint);
        let radiance = if surface.material.unlit {
            surface.emission
        } else {
            self.secondary(&surface, beam, |turned, weight| {
                next.extend(self.follow(&surface, &ray, hit.opacity, turned, weight));
            });
            let local = self.local(&surface, &hit, beam, ray.depth, sample, room);
            self.emitted(&surface, &hit) + local
        };
        sample.radiance += hit.opacity * ray.arriving * radiance;
        // What is behind it.
        let clear = 1.0 - hit.opacity;
        ray.layers += 1;
        ray.arriving *= clear;
        ray.weight *= clear;
        ray.from = hit.t;
        if ray.weight >= MIN_WEIGHT && ray.layers < MAX_LAYERS {
            next.push(ray);
        }
    }

    /// The ray that goes on as `turned`, with `weight` times what it finds, unless the
    /// branch ends here.
    fn follow(
        &self,
        surface: &Surface<'_>,
        ray: &Waiting,
        opacity: f32,
        turned: Beam,
        weight: Vec3,
    ) -> Option<Waiting> {
        let next = Waiting {
            depth: ray.depth + 1,
            weight: ray.weight * opacity * weight.max_element(),
            arriving: opacity * ray.arriving * weight,
            from: 0.0,
            tree: ray.tree,
            layers: 0,
            beam: Beam {
                origin: self.accel.leave(surface.position, surface.geometric, turned.direction),
                ..turned
            },
        };
        (next.depth <= self.max_depth && next.weight >= MIN_WEIGHT).then_some(next)
    }
}
