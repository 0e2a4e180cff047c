//! The mean radiance over a cell by plain adaptive quadrature, in two ways. It
//! shares no code with the library: charts, clipping and rules are its own.

use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, TAU};
use wrt_core::Polygon;

/// How (u, v) is laid over a quadrilateral.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Map {
    Rect,
    Perspective,
    Bilinear,
}

/// A quadrilateral as the command's input has it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Quad {
    pub(super) verts: [DVec3; 4],
    pub(super) map: Map,
}

/// A cell: level, then offsets along u, v, κ, λ.
#[derive(Clone, Copy, Debug)]
pub(super) struct CellOf {
    pub(super) level: u8,
    pub(super) m: [u16; 4],
}

impl CellOf {
    pub(super) const WHOLE: Self = Self { level: 0, m: [0; 4] };

    /// [low, high] along dimension `d`.
    fn range(&self, d: usize) -> [f64; 2] {
        let side = 0.5_f64.powi(self.level.into());
        [f64::from(self.m[d]) * side, (f64::from(self.m[d]) + 1.0) * side]
    }
}

impl Quad {
    pub(super) fn polygon(&self) -> wrt_core::Result<Polygon> {
        match self.map {
            Map::Rect => Polygon::rectilinear_quad(self.verts),
            Map::Perspective => Polygon::perspective(self.verts),
            Map::Bilinear => Polygon::bilinear(self.verts),
        }
    }

    /// x̂, ŷ, n̂.
    pub(super) fn frame(&self) -> [DVec3; 3] {
        let [v0, v1, _, _] = self.verts;
        let x = (v1 - v0).normalize();
        let n = x.cross(self.second_edge()).normalize();
        [x, n.cross(x), n]
    }

    fn second_edge(&self) -> DVec3 {
        let [v0, v1, v2, v3] = self.verts;
        if (v1 - v0).cross(v3 - v0).length() == 0.0 { v2 - v0 } else { v3 - v0 }
    }

    /// Weights of the corners that make a bilinear mix projective: each is the area
    /// of the triangle of the other three.
    fn weights(&self) -> [f64; 4] {
        let [p0, p1, p2, p3] = self.verts;
        let area = |a: DVec3, b: DVec3, c: DVec3| (b - a).cross(c - a).length();
        match self.map {
            Map::Perspective => {
                [area(p1, p2, p3), area(p0, p2, p3), area(p0, p1, p3), area(p0, p1, p2)]
            }
            _ => [1.0; 4],
        }
    }

    /// The world point at (u, v), relative to vertex 0.
    fn point(&self, u: f64, v: f64) -> DVec3 {
        let v0 = self.verts[0];
        if self.map == Map::Rect {
            let [x, y, _] = self.frame();
            return x * (self.verts[1] - v0).length() * u + y * self.second_edge().length() * v;
        }
        let b = [(1.0 - u) * (1.0 - v), u * (1.0 - v), u * v, (1.0 - u) * v];
        let w = self.weights();
        let total: f64 = (0..4).map(|i| b[i] * w[i]).sum();
        (0..4).map(|i| (self.verts[i] - v0) * (b[i] * w[i])).sum::<DVec3>() / total
    }

    /// The outline of a position cell, relative to vertex 0.
    fn outline(&self, cell: &CellOf) -> Vec<DVec3> {
        let ([u0, u1], [v0, v1]) = (cell.range(0), cell.range(1));
        let corners = [(u0, v0), (u1, v0), (u1, v1), (u0, v1)];
        let outline = corners.map(|(u, v)| self.point(u, v)).to_vec();
        if self.map == Map::Rect { self.within(outline) } else { outline }
    }

    /// The part inside the quadrilateral itself.
    fn within(&self, mut outline: Vec<DVec3>) -> Vec<DVec3> {
        let [_, _, n] = self.frame();
        for i in 0..4 {
            let (a, b) = (self.verts[i] - self.verts[0], self.verts[(i + 1) % 4] - self.verts[0]);
            let inward = n.cross(b - a);
            // Rounding of a rectangle's own corners is not clipped.
            let slack = 1e-13 * inward.length() * self.second_edge().length();
            outline = clip(&outline, |p| inward.dot(p - a) + slack);
        }
        outline
    }
}

/// The part of a convex polygon where the affine `side` is not negative.
fn clip(polygon: &[DVec3], side: impl Fn(DVec3) -> f64) -> Vec<DVec3> {
    let mut out = Vec::new();
    for (i, &a) in polygon.iter().enumerate() {
        let b = polygon[(i + 1) % polygon.len()];
        let (s, t) = (side(a), side(b));
        if s >= 0.0 {
            out.push(a);
        }
        if (s < 0.0) != (t < 0.0) {
            out.push(a + (b - a) * (s / (s - t)));
        }
    }
    out
}

/// Kronrod nodes, their weights, and Gauss weights at the odd ones (QUADPACK).
const KRONROD: [(f64, f64, f64); 8] = [
    (0.991_455_371_120_812_6, 0.022_935_322_010_529_22, 0.0),
    (0.949_107_912_342_758_5, 0.063_092_092_629_978_55, 0.129_484_966_168_869_7),
    (0.864_864_423_359_769_1, 0.104_790_010_322_250_18, 0.0),
    (0.741_531_185_599_394_4, 0.140_653_259_715_525_92, 0.279_705_391_489_276_64),
    (0.586_087_235_467_691_1, 0.169_004_726_639_267_9, 0.0),
    (0.405_845_151_377_397_2, 0.190_350_578_064_785_4, 0.381_830_050_505_118_9),
    (0.207_784_955_007_898_47, 0.204_432_940_075_298_9, 0.0),
    (0.0, 0.209_482_141_084_727_82, 0.417_959_183_673_469_4),
];

/// ∫ f over [a, b], halved until two rules agree to `tolerance` over the whole.
fn integral(f: &mut dyn FnMut(f64) -> f64, a: f64, b: f64, tolerance: f64, depth: u32) -> f64 {
    let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
    let (mut fine, mut coarse) = (0.0, 0.0);
    for (x, kronrod, gauss) in KRONROD {
        let both = if x == 0.0 { f(middle) } else { f(middle - half * x) + f(middle + half * x) };
        fine += kronrod * both;
        coarse += gauss * both;
    }
    let (fine, coarse) = (fine * half, coarse * half);
    if (fine - coarse).abs() <= tolerance || depth == 0 {
        return fine;
    }
    let tolerance = 0.5 * tolerance;
    integral(f, a, middle, tolerance, depth - 1) + integral(f, middle, b, tolerance, depth - 1)
}

/// As [`integral`], over the pieces between sorted `cuts`.
fn pieces(f: &mut dyn FnMut(f64) -> f64, cuts: &[f64], tolerance: f64, depth: u32) -> f64 {
    let span = cuts[cuts.len() - 1] - cuts[0];
    let share = |w: &[f64]| tolerance * ((w[1] - w[0]) / span).max(1e-2);
    cuts.windows(2).filter(|w| w[0] < w[1]).map(|w| integral(f, w[0], w[1], share(w), depth)).sum()
}

/// Constant emission from a source's position cell, directions in full: the mean
/// over the dest's position cell of a quarter of Lambert's projected solid angle.
pub(super) fn by_position(
    source: &Quad,
    j: &CellOf,
    dest: &Quad,
    k: &CellOf,
    tolerance: f64,
) -> f64 {
    let offset = source.verts[0] - dest.verts[0];
    let outline: Vec<DVec3> = source.outline(j).iter().map(|p| p + offset).collect();
    let ([_, _, n], [_, _, ns]) = (dest.frame(), source.frame());
    let seen = |p: DVec3| {
        if ns.dot(p - offset) <= 0.0 || outline.is_empty() {
            return 0.0;
        }
        let above = clip(&outline, |q| n.dot(q - p));
        let edge = |i: usize| {
            let (a, b) = (above[i] - p, above[(i + 1) % above.len()] - p);
            let cross = a.cross(b);
            let sine = cross.length();
            if sine == 0.0 { 0.0 } else { sine.atan2(a.dot(b)) * n.dot(cross) / sine }
        };
        // Counter-clockwise from its front is clockwise seen from p.
        -0.125 * (0..above.len()).map(edge).sum::<f64>()
    };
    let ([u0, u1], [v0, v1]) = (k.range(0), k.range(1));
    let (width, height) = (u1 - u0, v1 - v0);
    let row = |v: f64| {
        let ends = [dest.point(u0, v), dest.point(u1, v)];
        let inside = if dest.map == Map::Rect { dest.within(ends.to_vec()) } else { ends.to_vec() };
        let Some(&first) = inside.first() else { return 0.0 };
        let long = ends[1] - ends[0];
        let at = |p: DVec3| u0 + width * (p - ends[0]).dot(long) / long.length_squared();
        let [a, b] = if dest.map == Map::Rect {
            let along = inside.iter().map(|&p| at(p));
            [along.clone().fold(at(first), f64::min), along.fold(at(first), f64::max)]
        } else {
            [u0, u1]
        };
        let side = |u: f64| ns.dot(dest.point(u, v) - offset);
        let mut cuts = vec![a, 0.5 * (a + b), b];
        // Where the row passes the source's plane the integrand has a kink.
        if side(a) * side(b) < 0.0 {
            let (mut low, mut high) = (a, b);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if side(low) * side(middle) <= 0.0 { high = middle } else { low = middle }
            }
            cuts = vec![a, low, b];
        }
        pieces(&mut |u| seen(dest.point(u, v)), &cuts, 0.1 * tolerance * width, 20)
    };
    let cuts = [v0, 0.5 * (v0 + v1), v1];
    pieces(&mut { row }, &cuts, tolerance * width * height, 20) / (width * height)
}

/// Any cells: over direction in polar coordinates about the dest's normal, the
/// overlap of positions from projected outlines.
pub(super) fn by_direction(
    source: &Quad,
    j: &CellOf,
    dest: &Quad,
    k: &CellOf,
    tolerance: f64,
) -> f64 {
    let ([x, y, n], [xs, ys, ns]) = (dest.frame(), source.frame());
    let local = |p: DVec3| DVec3::new(p.dot(x), p.dot(y), p.dot(n));
    let offset = local(source.verts[0] - dest.verts[0]);
    let (xs, ys, ns) = (local(xs), local(ys), local(ns));
    let from: Vec<DVec3> = source.outline(j).iter().map(|&p| local(p) + offset).collect();
    let from = clip(&from, |p| p.z);
    let to: Vec<DVec3> = dest.outline(k).iter().map(|&p| local(p)).collect();
    let to = clip(&to, |p| ns.dot(p - offset));
    if from.is_empty() || to.is_empty() {
        return 0.0;
    }
    let cosines = |range: [f64; 2]| range.map(|c| 2.0 * c - 1.0);
    let (kx, ky) = (cosines(k.range(2)), cosines(k.range(3)));
    let (jx, jy) = (cosines(j.range(2)), cosines(j.range(3)));
    let within = |c: f64, [low, high]: [f64; 2]| low <= c && c < high;
    let overlap = |mu: DVec3| {
        if -ns.dot(mu) <= 0.0 || !within(-xs.dot(mu), jx) || !within(-ys.dot(mu), jy) {
            return 0.0;
        }
        let shadow: Vec<DVec3> = from.iter().map(|p| p - mu * (p.z / mu.z)).collect();
        let mut common = to.clone();
        for (i, &a) in shadow.iter().enumerate() {
            // A source's outline is clockwise on the dest's plane.
            let e = a - shadow[(i + 1) % shadow.len()];
            common = clip(&common, |p| e.truncate().perp_dot((p - a).truncate()));
        }
        if common.len() < 3 { 0.0 } else { area(dest, k, &common, x, y) }
    };
    // Corner to corner directions bound the support, and guide the rule to it.
    let (mut turns, mut tilts) = (Vec::new(), Vec::new());
    for s in &from {
        for d in &to {
            let mu = (s - d).normalize_or_zero();
            turns.push(mu.y.atan2(mu.x).rem_euclid(TAU));
            tilts.push(mu.z.clamp(0.0, 1.0).acos());
        }
    }
    let corners = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(a, b)| DVec2::new(kx[a], ky[b]));
    turns.extend(corners.map(|c| c.y.atan2(c.x).rem_euclid(TAU)));
    // So do the corners of the source's direction cell.
    for (a, b) in [(0, 0), (1, 0), (1, 1), (0, 1)] {
        let height = (1.0 - jx[a] * jx[a] - jy[b] * jy[b]).max(0.0).sqrt();
        let mu = -(xs * jx[a] + ys * jy[b] + ns * height).normalize();
        turns.push(mu.y.atan2(mu.x).rem_euclid(TAU));
        tilts.push(mu.z.clamp(0.0, 1.0).acos());
    }
    turns.extend((0..=4).map(|i| f64::from(i) * FRAC_PI_2));
    turns.sort_by(f64::total_cmp);
    tilts.sort_by(f64::total_cmp);
    let size = 0.25_f64.powi((2 * k.level).into());
    let turn = |phi: f64| {
        let (sine, cosine) = phi.sin_cos();
        // The radii at which the ray is inside the box and the circle.
        let (mut low, mut high) = (0.0_f64, 1.0_f64);
        for (d, [a, b]) in [(cosine, kx), (sine, ky)] {
            if d == 0.0 {
                continue;
            }
            let (near, far) = if d > 0.0 { (a / d, b / d) } else { (b / d, a / d) };
            (low, high) = (low.max(near), high.min(far));
        }
        if low >= high {
            return 0.0;
        }
        let (a, b) = (low.asin(), high.asin());
        let mut cuts = vec![a];
        cuts.extend(tilts.iter().filter(|&&t| a < t && t < b));
        // Jumps hide from the rule between its last node and a piece's end.
        for (axis, range) in [(xs, jx), (ys, jy)] {
            let (sine_part, cosine_part) = (-axis.x * cosine - axis.y * sine, -axis.z);
            let (size, middle) = (sine_part.hypot(cosine_part), sine_part.atan2(cosine_part));
            for c in range {
                let half = (c / size).acos();
                cuts.extend([middle - half, middle + half].iter().filter(|&&t| a < t && t < b));
            }
        }
        cuts.push(b);
        cuts.sort_by(f64::total_cmp);
        let mut f = |theta: f64| {
            let (s, c) = theta.sin_cos();
            0.25 * s * c * overlap(DVec3::new(s * cosine, s * sine, c))
        };
        pieces(&mut f, &cuts, 0.02 * tolerance * size, 24)
    };
    pieces(&mut { turn }, &turns, tolerance * size, 14) / size
}

/// The area in (u, v) of a convex polygon in the dest's plane.
fn area(dest: &Quad, k: &CellOf, polygon: &[DVec3], x: DVec3, y: DVec3) -> f64 {
    if dest.map == Map::Rect {
        let twice: f64 = (1..polygon.len() - 1)
            .map(|i| (polygon[i] - polygon[0]).cross(polygon[i + 1] - polygon[0]).z)
            .sum();
        let size = (dest.verts[1] - dest.verts[0]).length() * dest.second_edge().length();
        return 0.5 * twice.abs() / size;
    }
    // Rows of constant v are straight in every chart.
    let ([u0, u1], [v0, v1]) = (k.range(0), k.range(1));
    let flat = |p: DVec3| DVec2::new(p.dot(x), p.dot(y));
    let centre = polygon.iter().sum::<DVec3>() / polygon.len() as f64;
    let mut row = |v: f64| {
        let (mut low, mut high) = (u0, u1);
        for (i, &a) in polygon.iter().enumerate() {
            let e = (polygon[(i + 1) % polygon.len()] - a).truncate();
            let sign = e.perp_dot((centre - a).truncate()).signum();
            let side = |u: f64| sign * e.perp_dot(flat(dest.point(u, v)) - a.truncate());
            let (s, t) = (side(u0), side(u1));
            if s < 0.0 && t < 0.0 {
                return 0.0;
            }
            if (s < 0.0) == (t < 0.0) {
                continue;
            }
            // Weighted ends: in a perspective row, side × weight is linear in u.
            let w = dest.weights();
            let weight = |u: f64| {
                (1.0 - u) * (1.0 - v) * w[0]
                    + u * (1.0 - v) * w[1]
                    + u * v * w[2]
                    + (1.0 - u) * v * w[3]
            };
            let (s, t) = (s * weight(u0), t * weight(u1));
            let root = u0 + (u1 - u0) * (s / (s - t));
            if s < 0.0 { low = low.max(root) } else { high = high.min(root) }
        }
        (high - low).max(0.0)
    };
    pieces(&mut row, &[v0, v1], 1e-6 * (u1 - u0) * (v1 - v0), 8)
}
