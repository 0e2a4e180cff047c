//! Light of very many cells by way of some: a cut through their hierarchy.
//!
//! The cut is that of Walter et al. (see [`hierarchy`](super::hierarchy)), by a bound on
//! what each cluster may give. A cluster is not shone for by one cell that is fixed
//! beforehand but by one drawn at each surface, so that the light is right in the mean and
//! shows no bands (C. Yuksel, *Stochastic Lightcuts*, HPG 2019); from the cluster down, a
//! half is taken with a probability in proportion to what it might give, after A. Conty
//! Estevez and C. Kulla, *Importance Sampling of Many Lights with Adaptive Tree
//! Splitting*, HPG 2018.

use super::R2;
use super::hierarchy::{Hierarchy, Node, Span};
use crate::phong::{Source, Surface, Unshadowed};
use glam::{DVec2, DVec3};
use std::{
    cmp::Ordering,
    collections::BinaryHeap,
    f64::consts::{FRAC_1_PI, PI, TAU},
};
use wrt_core::cosine_power;

/// Clusters are halved until none may give more than this share of what all together may.
///
/// A bumpy sphere of 19 880 triangles over a floor with two boxes, in 48x36 pixels of 16
/// samples each, against all cells at the same camera rays, relative RMS, and CPU time,
/// which is 19 s for all cells with shared shadow rays:
///
/// ```text
/// 1/16: 0.30 %, 0.80 s    1/32: 0.19 %, 1.5 s    1/64: 0.10 %, 2.5 s    1/128: 0.06 %, 4.4 s
/// ```
const SHARE: f64 = 1.0 / 64.0;

/// Most clusters of a cut.
const MOST: usize = 256;

/// What a surface asks of a cluster: how it reflects, at its brightest channel.
#[derive(Debug)]
struct Receiver {
    position: DVec3,
    normal: DVec3,
    /// Unit, the mirror direction of that to the eye.
    mirrored: DVec3,
    /// Of f_r, sr⁻¹: the constant part, and the lobe's peak.
    diffuse: f64,
    gloss: f64,
    exponent: f64,
}

/// What a cluster might give to a surface: reflected radiance without shadows, emission
/// lobes at their peak.
#[derive(Clone, Copy, Debug)]
struct Potential {
    /// It gives no more than that.
    bound: f64,
    /// Of that size if it is far away; 0 only where the bound is.
    likely: f64,
}

/// A cluster of the cut, greater the more it may give.
#[derive(Debug)]
struct Cluster {
    bound: f64,
    span: Span,
}

impl Ord for Cluster {
    fn cmp(&self, other: &Self) -> Ordering {
        self.bound.total_cmp(&other.bound).then_with(|| self.span.cmp(&other.span))
    }
}

impl PartialOrd for Cluster {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Cluster {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Cluster {}

impl Receiver {
    fn new(surface: &Surface<'_>) -> Self {
        let (brdf, normal, to_eye) = (surface.brdf, surface.normal, surface.to_eye);
        Self {
            position: surface.position,
            normal,
            mirrored: 2.0 * normal.dot(to_eye) * normal - to_eye,
            diffuse: f64::from(brdf.kd.max_element()) * FRAC_1_PI,
            gloss: f64::from(brdf.ks.max_element()) * (brdf.exponent + 2.0) / TAU,
            exponent: brdf.exponent,
        }
    }

    fn potential(&self, node: &Node) -> Potential {
        let [radius, power] = [node.radius, node.power].map(f64::from);
        // No cell shines from more than a hemisphere.
        let most = PI * f64::from(node.radiance);
        let path = node.centre.as_dvec3() - self.position;
        let squared = path.length_squared();
        if squared <= radius * radius {
            let reflectance = self.diffuse + self.gloss;
            let likely = reflectance * most.min(power / (radius * radius));
            return Potential { bound: reflectance * most, likely };
        }
        let distance = squared.sqrt();
        let to_light = path / distance;
        let sin = radius / distance;
        let cos = (1.0 - sin * sin).sqrt();
        let cos_d = nearest(self.normal.dot(to_light), [cos, sin]);
        let [cone_cos, cone_sin] = [node.cos, node.sin].map(f64::from);
        // The sum of the cone's angle and of the sphere's: past a half turn anything goes.
        let wide = [cone_cos * cos - cone_sin * sin, cone_sin * cos + cone_cos * sin];
        let facing = -node.axis.as_dvec3().dot(to_light);
        let cos_s = if wide[1] < 0.0 { 1.0 } else { nearest(facing, wide) };
        if cos_d <= 0.0 || cos_s <= 0.0 {
            return Potential { bound: 0.0, likely: 0.0 };
        }
        let lobe = if self.gloss > 0.0 {
            let cosine = nearest(self.mirrored.dot(to_light), [cos, sin]);
            self.gloss * cosine_power(cosine, self.exponent)
        } else {
            0.0
        };
        let factor = (self.diffuse + lobe) * cos_d * cos_s;
        let nearest = (distance - radius).powi(2);
        Potential {
            bound: factor * most.min(power / nearest),
            likely: factor * most.min(power / squared),
        }
    }
}

/// The cosine of an angle, `cosine`, less another of which cosine and sine are given, or
/// 1 if that is the larger.
fn nearest(cosine: f64, [cos, sin]: [f64; 2]) -> f64 {
    if cosine >= cos { 1.0 } else { cosine * cos + (1.0 - cosine * cosine).max(0.0).sqrt() * sin }
}

impl Hierarchy {
    /// As [`AreaEmitter::illuminate`](super::AreaEmitter::illuminate): one cell for each
    /// cluster of a cut.
    pub(super) fn illuminate(
        &self,
        surface: &Surface<'_>,
        place: DVec2,
        lights: &mut Vec<Unshadowed>,
    ) {
        let receiver = Receiver::new(surface);
        lights.extend(self.cut(&receiver).into_iter().filter_map(|span| {
            // Another place in each cluster.
            let place = (place + span.node as f64 * R2).fract_gl();
            self.drawn(span, &receiver, surface, place)
        }));
    }

    /// The clusters, in the tree's order: those side by side give much the same light.
    fn cut(&self, receiver: &Receiver) -> Vec<Span> {
        let cluster = |span: Span| {
            let bound = receiver.potential(self.node(span)).bound;
            (bound > 0.0).then_some(Cluster { bound, span })
        };
        let mut whole = BinaryHeap::with_capacity(MOST);
        whole.extend(cluster(self.root()));
        let mut total: f64 = whole.iter().map(|cluster| cluster.bound).sum();
        let mut cells = Vec::new();
        while whole.len() + cells.len() < MOST
            && let Some(top) = whole.peek()
            && top.bound > SHARE * total
            && let Some(Cluster { bound, span }) = whole.pop()
        {
            if span.count == 1 {
                cells.push(span);
                continue;
            }
            let halves = span.halves().map(cluster);
            total -= bound;
            total += halves.iter().flatten().map(|half| half.bound).sum::<f64>();
            whole.extend(halves.into_iter().flatten());
        }
        cells.extend(whole.into_iter().map(|cluster| cluster.span));
        cells.sort_unstable();
        cells
    }

    /// The light of a cell of the cluster, over the probability with which `place`, in
    /// [0, 1)², leads to it.
    fn drawn(
        &self,
        cluster: Span,
        receiver: &Receiver,
        surface: &Surface<'_>,
        place: DVec2,
    ) -> Option<Unshadowed> {
        let (mut span, mut u, mut probability) = (cluster, place.x, 1.0);
        while span.count > 1 {
            let halves = span.halves();
            let [left, right] = halves.map(|half| receiver.potential(self.node(half)).likely);
            if left + right <= 0.0 {
                return None;
            }
            let share = left / (left + right);
            // What is left of u is spread evenly again.
            if u < share {
                (span, u, probability) = (halves[0], u / share, probability * share);
            } else {
                let rest = 1.0 - share;
                (span, u, probability) = (halves[1], (u - share) / rest, probability * rest);
            }
        }
        let (flat, cell) = self.cell(span.first);
        let place = DVec2::new(u.min(1.0 - f64::EPSILON), place.y);
        let light = flat.light_of(cell, surface, place)?;
        let source = match light.source {
            Source::Point(point) => Source::Drawn(point),
            other => other,
        };
        Some(Unshadowed { radiance: light.radiance / probability as f32, source })
    }
}

#[cfg(test)]
mod tests;
