//! Images of direction cells between the kinks of what is seen, for cells that samples
//! do not settle.

use super::TransportGeometry;
use super::integrate::{Beam, Bends, integrals};
use super::oracle::{Verdict, oracle};
use super::pair::{Pair, Support};
use super::refine::{Order, Settling};
use super::slice::{Image, Slices};
use super::source::{Kinks, Source};
use crate::grid::Rgb;
use crate::{Chart, ConvexPolygon, Levels};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// A source made ready for [`Exact`](super::Exact)'s rules.
///
/// An image has a sum for each position cell, over those patches of the source that the
/// oracle cannot rule out, each with its own arrangement of kinks.
pub(super) struct Handover<'a, S> {
    geometry: &'a TransportGeometry,
    source: &'a S,
    levels: Levels,
    /// Per picture.
    patches: Vec<Vec<Patch>>,
    /// The source's, with its circles in the destination's frame.
    kinks: Kinks,
}

/// Texels of one colour that make up a rectangle.
#[derive(Clone, Debug)]
struct Patch {
    /// In the source's plane.
    shape: ConvexPolygon,
    rgb: [f64; 3],
}

/// A patch as a position cell sees it.
struct Seen<'a> {
    pair: Pair<'a>,
    /// Which of the direction cell's beams, and the patch.
    beam: usize,
    patch: usize,
}

impl<'a, S: Source> Handover<'a, S> {
    pub(super) fn new(slices: &Slices<'a, S>) -> Self {
        let (geometry, source, levels) = slices.parts();
        let side = 1 << source.level();
        let chart = geometry.source().chart();
        let patches = source.pictures().into_iter().map(|p| patches(chart, p, side)).collect();
        let [x, y, n] = geometry.source_axes();
        let mut kinks = source.kinks();
        for (axis, _) in &mut kinks.circles {
            // Light travels along −μ.
            *axis = -(x * axis.x + y * axis.y + n * axis.z);
        }
        Self { geometry, source, levels, patches, kinks }
    }

    /// The image of a direction cell (κ fastest), `None` if nothing is seen, and the
    /// estimated √ of the sum of its squared errors, at most `target` if that can be had.
    pub(super) fn image(&self, direction: usize, target: f64) -> (Option<Image>, f64) {
        let dest_box = self.cell(0, [0; 2], direction).cosines();
        let bends = Bends::meeting(self.kinks.circles.iter().copied(), dest_box);
        let factors: Vec<_> = self
            .pictures(dest_box)
            .into_iter()
            .map(|picture| {
                let factor = move |mu: DVec3| {
                    let (shown, factor) = self.source.slice(self.geometry.source_direction(mu))?;
                    (shown == picture).then_some(factor)
                };
                (picture, factor)
            })
            .collect();
        let Kinks { scale, analytic, .. } = self.kinks;
        let beams: Vec<(usize, Beam<'_>)> = factors
            .iter()
            .map(|(picture, factor)| (*picture, Beam { factor, bends: &bends, scale, analytic }))
            .collect();
        let mut leaves = Vec::new();
        let all = beams.iter().enumerate();
        let all = all.flat_map(|(i, (p, _))| (0..self.patches[*p].len()).map(move |j| (i, j)));
        self.descend(0, [0; 2], direction, &beams, &all.collect::<Vec<_>>(), &mut leaves);
        if leaves.is_empty() {
            return (None, 0.0);
        }
        let share = target / (leaves.len() as f64).sqrt();
        let means: Vec<([f64; 3], f64)> =
            leaves.par_iter().map(|(_, seen)| self.mean(seen, &beams, share)).collect();
        let mut image = vec![[0.0; 3]; self.levels.positions()];
        let mut error = 0.0;
        for ((position, _), (mean, off)) in leaves.iter().zip(means) {
            image[*position] = mean;
            error += off * off;
        }
        let lit = image.iter().any(|rgb| *rgb != [0.0; 3]);
        (lit.then_some(image), error.sqrt())
    }

    /// The pictures that can be seen from directions of a box of (μx, μy).
    fn pictures(&self, dest_box: [DVec2; 2]) -> Vec<usize> {
        let [_, _, n] = self.geometry.source_axes();
        // Nothing is seen beyond the source's own horizon.
        let circles = self.kinks.circles.iter().copied().chain([(n, 0.0)]);
        let parts = Bends::meeting(circles, dest_box).parts(dest_box);
        let seen = |mu: DVec3| self.source.slice(self.geometry.source_direction(mu));
        let mut all: Vec<usize> = parts.into_iter().filter_map(seen).map(|(i, _)| i).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Appends the position cells, and what they may see of the patches `maybe`.
    fn descend(
        &self,
        level: u8,
        [u, v]: [u16; 2],
        direction: usize,
        beams: &[(usize, Beam<'_>)],
        maybe: &[(usize, usize)],
        leaves: &mut Vec<(usize, Vec<Seen<'a>>)>,
    ) {
        let dest = self.cell(level, [u, v], direction);
        let side = 1_u32 << level;
        let at = |m: u16| f64::from(m) / f64::from(side);
        let shape = quad(
            self.geometry.dest().chart(),
            DVec2::new(at(u), at(v)),
            DVec2::new(at(u + 1), at(v + 1)),
        );
        let whole = Support::isotropic(0, [0; 4]);
        let mut seen = Vec::new();
        for &(beam, patch) in maybe {
            let source = self.patches[beams[beam].0][patch].shape;
            let pair = Pair::between(self.geometry, &[source], whole, &[shape], dest);
            if oracle(&pair) != Verdict::Zero {
                seen.push(Seen { pair, beam, patch });
            }
        }
        if seen.is_empty() {
            return;
        }
        if level == self.levels.position {
            leaves.push((usize::from(v) << level | usize::from(u), seen));
            return;
        }
        let maybe: Vec<(usize, usize)> = seen.into_iter().map(|s| (s.beam, s.patch)).collect();
        for i in 0..4 {
            let m = [2 * u + (i & 1), 2 * v + (i >> 1)];
            self.descend(level + 1, m, direction, beams, &maybe, leaves);
        }
    }

    /// The mean over a cell of what it sees, and its estimated error, `allowed` at most if
    /// that can be had.
    fn mean(
        &self,
        seen: &[Seen<'_>],
        beams: &[(usize, Beam<'_>)],
        allowed: f64,
    ) -> ([f64; 3], f64) {
        let density = self.levels.scale(self.levels.depth()).powi(2);
        let rgb = |seen: &Seen<'_>| self.patches[beams[seen.beam].0][seen.patch].rgb;
        let terms: Vec<_> = seen
            .iter()
            .map(|seen| (&seen.pair, &beams[seen.beam].1, DVec3::from(rgb(seen)).length()))
            .collect();
        let (values, error) = integrals(&terms, allowed / density);
        let mut mean = [0.0; 3];
        for (seen, value) in seen.iter().zip(values) {
            for (mean, x) in mean.iter_mut().zip(rgb(seen)) {
                *mean += x * value * density;
            }
        }
        (mean, error * density)
    }

    /// A position cell of a `level` with the directions of a cell.
    fn cell(&self, level: u8, [u, v]: [u16; 2], direction: usize) -> Support {
        let levels = Levels { position: level, direction: self.levels.direction };
        let (k, l) = (direction & ((1 << levels.direction) - 1), direction >> levels.direction);
        Support { levels, m: [u, v, k as u16, l as u16] }
    }
}

/// Has the images made anew of all `cells` that were given up: to what the others leave of
/// the sum of squared errors that is `allowed`, relative to the energy.
pub(super) fn hand_over<S: Source>(
    cells: &mut [Option<Settling>],
    slices: &Slices<'_, S>,
    allowed: f64,
    order: Order,
) {
    // The energies of the images made anew are not those known now.
    const ROOM: f64 = 0.99;
    let energy: f64 = cells.iter().flatten().map(|cell| cell.energy).sum();
    let total = ROOM * allowed * energy;
    let (due, settled): (Vec<_>, Vec<_>) = cells
        .iter_mut()
        .enumerate()
        .filter_map(|(direction, cell)| Some((direction, cell.as_mut()?)))
        .partition(|(_, cell)| cell.given_up());
    if due.is_empty() {
        return;
    }
    let spent: f64 = settled.iter().map(|(_, cell)| cell.error(order).powi(2)).sum();
    let left = (total - spent).max(0.01 * total);
    let target = (left / due.len() as f64).sqrt();
    let handover = Handover::new(slices);
    due.into_par_iter().for_each(|(direction, cell)| {
        cell.hand_over(&handover, direction, target, order);
    });
}

/// The part of a plane between two corners of (u, v).
fn quad(chart: &Chart, low: DVec2, high: DVec2) -> ConvexPolygon {
    let corners = [low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)];
    ConvexPolygon::new(&corners.map(|uv| chart.to_plane(uv)))
}

/// A picture with `side` texels a side as rectangles of one colour.
fn patches(chart: &Chart, picture: &[Rgb], side: usize) -> Vec<Patch> {
    let mut taken: Vec<bool> = picture.iter().map(|rgb| *rgb == [0.0; 3]).collect();
    let mut out = Vec::new();
    for first in 0..picture.len() {
        if taken[first] {
            continue;
        }
        let rgb = picture[first];
        let (u, v) = (first % side, first / side);
        let free = |taken: &[bool], u: usize, v: usize| {
            !taken[v * side + u] && picture[v * side + u] == rgb
        };
        let end_u = (u..side).find(|&u| !free(&taken, u, v)).unwrap_or(side);
        let row = |v: usize| (u..end_u).all(|u| free(&taken, u, v));
        let end_v = (v..side).find(|&v| !row(v)).unwrap_or(side);
        for v in v..end_v {
            taken[v * side + u..v * side + end_u].fill(true);
        }
        let at = |u: usize, v: usize| DVec2::new(u as f64, v as f64) / side as f64;
        let shape = quad(chart, at(u, v), at(end_u, end_v));
        out.push(Patch { shape, rgb: rgb.map(f64::from) });
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::slice::Way;
    use super::super::{CellRule, Exact};
    use super::*;
    use crate::{Emission, Lobe, Polygon};
    use std::f64::consts::PI;

    fn rectangle(origin: [f64; 3], u: [f64; 3], v: [f64; 3]) -> Polygon {
        Polygon::rectangle(origin.into(), u.into(), v.into()).expect("a rectangle")
    }

    fn floor() -> Polygon {
        rectangle([0., 0., 0.], [1., 0., 0.], [0., 1., 0.])
    }

    fn tilted() -> TransportGeometry {
        let source = rectangle([-0.3, 0.7, 1.2], [0., 0.8, -0.6], [0.8, 0.36, 0.48]);
        TransportGeometry::new(source, floor())
    }

    /// All of the unit square sees it in directions up to 60° and beyond.
    fn sky() -> TransportGeometry {
        let source = rectangle([-9., 10., 1.], [20., 0., 0.], [0., -20., 0.]);
        TransportGeometry::new(source, floor())
    }

    /// The images of all direction cells, and their errors.
    fn images(
        geometry: &TransportGeometry,
        source: &impl Source,
        levels: Levels,
        target: f64,
    ) -> Vec<(Image, f64)> {
        let slices = Slices::new(geometry, source, levels, Way::Fastest).expect("straight lines");
        let handover = Handover::new(&slices);
        (0..levels.directions())
            .map(|d| {
                let (image, error) = handover.image(d, target);
                (image.unwrap_or_else(|| vec![[0.0; 3]; levels.positions()]), error)
            })
            .collect()
    }

    fn distance(a: &Image, b: &Image) -> f64 {
        let squares = a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| (a - b).powi(2));
        squares.sum::<f64>().sqrt()
    }

    fn picture(level: u8) -> Vec<Rgb> {
        let texel = |i: u16| [f32::from(i % 5), f32::from(i % 3), f32::from(u8::from(i % 4 > 1))];
        (0..1 << (2 * level)).map(texel).collect()
    }

    /// A grid of direction cells against the coefficients of each of its cells.
    #[test]
    fn images_of_a_grid_are_the_sums_of_its_coefficients() {
        let geometry = tilted();
        let source = Emission::new(1, picture(1), Lobe::Cosine { exponent: 2.0, peak: DVec3::Z });
        let source = source.project(1);
        let levels = Levels { position: 1, direction: 1 };
        let rule = CellRule::Exact(Exact { tolerance: 1e-10 });
        let found = images(&geometry, &source, levels, 1e-8);
        for (d, (image, error)) in found.iter().enumerate() {
            let mut expected = vec![[0.0; 3]; 4];
            for (p, expected) in expected.iter_mut().enumerate() {
                let m = |i: usize| [(i & 1) as u16, (i >> 1 & 1) as u16];
                let ([u, v], [k, l]) = (m(p), m(d));
                for j in 0..16 {
                    let ([ju, jv], [jk, jl]) = (m(j), m(j >> 2));
                    let j = Support { levels, m: [ju, jv, jk, jl] };
                    let dest = Support { levels, m: [u, v, k, l] };
                    let mean = rule.radiance(&geometry, j, dest).mean;
                    let texel = source.mean([ju, jv, jk, jl].map(usize::from));
                    for (expected, x) in expected.iter_mut().zip(texel) {
                        *expected += mean * f64::from(x);
                    }
                }
            }
            // Factors times pictures are rounded once more in `mean`.
            let off = distance(image, &expected);
            let size = distance(&expected, &vec![[0.0; 3]; 4]);
            assert!(*error <= 1e-8 * (1.0 + 1e-6) && off <= error + 1e-7 * size, "{d}: {off}");
        }
    }

    /// Nodes and weights on [0, 1]: the eight-point Gauss rule on either half.
    fn gauss() -> Vec<(f64, f64)> {
        let half = [
            (0.183_434_642_495_649_8, 0.362_683_783_378_362),
            (0.525_532_409_916_329, 0.313_706_645_877_887_3),
            (0.796_666_477_413_626_7, 0.222_381_034_453_374_48),
            (0.960_289_856_497_536_2, 0.101_228_536_290_376_26),
        ];
        let all =
            half.iter().flat_map(|&(x, w)| [(0.5 - 0.5 * x, 0.5 * w), (0.5 + 0.5 * x, 0.5 * w)]);
        all.flat_map(|(x, w)| [(0.5 * x, 0.5 * w), (0.5 + 0.5 * x, 0.5 * w)]).collect()
    }

    /// ∬ L cosθ cosθ′ / 4r² over both polygons: the mean over all directions from areas
    /// alone. The source is cut, for each point, where the lobe ends.
    fn from_areas(geometry: &TransportGeometry, emission: &Emission, cut: Option<DVec3>) -> f64 {
        let [x, y, n] = geometry.source_axes();
        let (source, dest) = (geometry.source(), geometry.dest());
        let mut sum = 0.0;
        for (u, wu) in gauss() {
            for (v, wv) in gauss() {
                let p = dest.chart().to_plane(DVec2::new(u, v)).extend(0.0);
                let mut shape = ConvexPolygon::new(source.outline());
                if let Some(peak) = cut {
                    let peak = x * peak.x + y * peak.y + n * peak.z;
                    shape = shape.clipped(|s| peak.dot(p - geometry.source_to_dest(s)));
                }
                let corners = shape.vertices();
                for i in 1..corners.len() - 1 {
                    let (a, b, c) = (corners[0], corners[i], corners[i + 1]);
                    for (s, ws) in gauss() {
                        for (t, wt) in gauss() {
                            let q = a + s * (b - a + t * (c - b));
                            let to = geometry.source_to_dest(q) - p;
                            let mu = to.normalize();
                            let area = s * (b - a).perp_dot(c - b) * ws * wt;
                            let factor = emission.lobe().eval(geometry.source_direction(mu));
                            let cosines = mu.z * -mu.dot(n);
                            sum += wu * wv * area * factor * cosines / (4.0 * to.length_squared());
                        }
                    }
                }
            }
        }
        sum
    }

    /// Lobes without an end, with one across the source, and narrow.
    #[test]
    fn cosine_lobes_agree_with_integrals_over_areas() {
        let away = DVec3::new(0.6, -0.64, 0.48);
        let lobes = [
            (4.0, DVec3::new(0.28, 0.0, 0.96), false),
            (1.0, away.normalize(), true),
            (2.5, DVec3::new(0.28, 0.0, 0.96), false),
            (60.0, DVec3::new(0.0, 0.6, 0.8), false),
        ];
        let geometry = tilted();
        for (exponent, peak, cut) in lobes {
            let emission = Emission::new(0, vec![[1.0; 3]], Lobe::Cosine { exponent, peak });
            let expected = from_areas(&geometry, &emission, cut.then_some(peak));
            let levels = Levels { position: 0, direction: 1 };
            for target in [1e-4, 1e-7] {
                let found = images(&geometry, &emission, levels, target * expected);
                let mean = 0.25 * found.iter().map(|(image, _)| image[0][0]).sum::<f64>();
                let error = 0.25 * found.iter().map(|(_, error)| error).sum::<f64>();
                let off = (mean - expected).abs();
                assert!(
                    off <= error + 1e-8 * expected && error <= 4.0 * target * expected,
                    "{exponent} {peak}: {mean} ± {error}, {expected}"
                );
            }
        }
    }

    /// Over a cell as large as the table's own, what is linear between centres has 1/8,
    /// 6/8 and 1/8 of three factors along either side.
    #[test]
    fn tables_have_the_means_of_their_hats() {
        let level = 3;
        let factors: Vec<f32> = (0..64_u16).map(|i| f32::from(1 + i * i % 7)).collect();
        let lobe = Lobe::Table { level, factors: factors.clone().into(), x: DVec2::X };
        let emission = Emission::new(0, vec![[1.0, 0.5, 2.0]], lobe);
        let levels = Levels { position: 1, direction: level };
        let found = images(&sky(), &emission, levels, 1e-9);
        for (k, l) in [(3, 3), (4, 3), (3, 4), (5, 4)] {
            let mut expected = 0.0;
            for (dk, wk) in [(0, 0.125), (1, 0.75), (2, 0.125)] {
                for (dl, wl) in [(0, 0.125), (1, 0.75), (2, 0.125)] {
                    // The light travels along (−μx, μy) of the source's frame.
                    let (k, l) = (7 - (k + dk - 1), l + dl - 1);
                    expected += wk * wl * f64::from(factors[l << 3 | k]);
                }
            }
            let (image, error) = &found[l << 3 | k];
            for mean in image {
                assert!((mean[0] - expected).abs() < 2e-9 && *error < 2e-9, "{mean:?} {expected}");
                assert!((mean[2] - 2.0 * expected).abs() < 4e-9, "{mean:?} {expected}");
            }
        }
    }

    /// ∬ cosθ dω over a cone of radius r about an axis at α from the normal is
    /// π sin²r cosα.
    #[test]
    fn a_disc_has_its_flux() {
        let axis = DVec3::new(0.3, 0.2, 0.0);
        let axis = axis.with_z((1.0 - axis.length_squared()).sqrt());
        for radius in [0.3_f64, 0.02, 0.004_65] {
            let emission = Emission::new(0, vec![[1.0; 3]], Lobe::Disc { axis, radius });
            let expected = PI * radius.sin().powi(2) * axis.z / 4.0;
            let levels = Levels { position: 0, direction: 2 };
            let found = images(&sky(), &emission, levels, 1e-9 * expected);
            let mean = found.iter().map(|(image, _)| image[0][0]).sum::<f64>() / 16.0;
            let error = found.iter().map(|(_, error)| error).sum::<f64>() / 16.0;
            // The circle's cosine has 10⁻¹⁶ / r² of it left.
            let circle = 1e-15 / (radius * radius);
            let off = (mean / expected - 1.0).abs();
            assert!(
                off <= error / expected + circle && error <= 4e-9 * expected,
                "{radius}: {mean} ± {error}, {expected}"
            );
        }
    }

    /// ∫ cosⁿθ cosθ dω = 2π / (n + 2).
    #[test]
    fn needles_have_their_flux() {
        for exponent in [20.0, 1e3, 1e6] {
            let lobe = Lobe::Cosine { exponent, peak: DVec3::Z };
            let emission = Emission::new(0, vec![[1.0; 3]], lobe);
            let expected = 0.5 * PI / (exponent + 2.0);
            for direction in [0, 1] {
                let levels = Levels { position: 0, direction };
                let found = images(&sky(), &emission, levels, 1e-9 * expected);
                let cells = levels.directions() as f64;
                let mean = found.iter().map(|(image, _)| image[0][0]).sum::<f64>() / cells;
                let error = found.iter().map(|(_, error)| error).sum::<f64>() / cells;
                assert!(
                    (mean - expected).abs() <= error && error <= 4e-9 * expected,
                    "{exponent}: {mean} ± {error}, {expected}"
                );
            }
        }
    }

    #[test]
    fn patches_cover_each_texel_once() {
        let chart = Chart::Rectilinear { width: 1.0, height: 1.0 };
        let picture = picture(4);
        let patches = patches(&chart, &picture, 16);
        let lit = picture.iter().filter(|rgb| **rgb != [0.0; 3]).count();
        assert!(patches.len() <= lit);
        for (i, rgb) in picture.iter().enumerate() {
            let at = DVec2::new((i % 16) as f64 + 0.5, (i / 16) as f64 + 0.5) / 16.0;
            let around =
                |patch: &&Patch| patch.shape.edges().all(|(a, b)| (b - a).perp_dot(at - a) > 0.0);
            let found: Vec<&Patch> = patches.iter().filter(around).collect();
            match found[..] {
                [] => assert_eq!(*rgb, [0.0; 3]),
                [patch] => assert_eq!(patch.rgb, rgb.map(f64::from)),
                _ => panic!("{i} lies in {}", found.len()),
            }
        }
        let plain = super::patches(&chart, &vec![[1.0; 3]; 256], 16);
        assert_eq!(plain.len(), 1, "one colour is one patch");
    }
}
