//! A picture that shines, as a pyramid of quadrature rules of its own.

use super::{Beam, Beams, Illuminant};
use crate::multiwavelet::{MAX_ORDER, Multiwavelet, gauss_legendre, legendre};
use crate::{Emission, Frame, Polygon};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Nodes along a side of a cell: rules match all moments of degree 0 to 7.
const NODES: usize = 8;
const SQUARE: usize = NODES * NODES;

/// A cell's diagonal seen from the point, relative to the angle over which the
/// integrand is smooth. A Gaussian of standard deviation 1 is integrated over cells
/// of diagonal 4.8 with 2·10⁻⁵ of its peak left over: measured in the tests below.
/// Four nodes and 1.2, as good, take four times as many.
const FINENESS: f64 = 4.8;

/// The same in radians, for distances and cosines.
const WIDEST: f64 = 0.8;

/// Where the horizon, a kink, cuts a cell, relative to the others.
const CUT: f64 = 0.06;

/// Levels between the picture's texels and the finest cells of more of them. Below those
/// each texel has nodes of its own.
const DIRECT: u8 = 2;

/// Levels below the picture's, or below the root's: for points close by.
const EXTRA: u8 = 8;

/// A cell's weights × radiance, u fastest.
type Nodes = [[f32; 3]; SQUARE];

/// An emitter prepared for points anywhere before it.
///
/// Each cell of a quadtree over its picture has 8 × 8 Gauss nodes, with weights
/// that match the picture's moments: ∫ picture × g is exact for polynomials g of
/// degree 7 along either side, whatever edges the picture has. So the nodes need to
/// follow only what the picture is multiplied with, lobes and geometry, and not the
/// picture. Weights of a picture with edges may be negative.
#[derive(Clone, Debug)]
pub struct AreaLight {
    frame: Frame,
    size: DVec2,
    emission: Emission,
    /// Levels well above the picture's: per cell (u fastest), weight × mean radiance at
    /// each node (u fastest); `None` where it is dark.
    levels: Vec<Vec<Option<Box<Nodes>>>>,
    rule: Vec<(f64, f64)>,
    /// The angle over which the lobe changes.
    scale: f64,
}

impl AreaLight {
    /// Prepares what `polygon` emits; dark outside its outline, as the emission's
    /// picture says.
    ///
    /// # Panics
    ///
    /// If its chart is not rectilinear.
    #[must_use]
    pub fn new(polygon: &Polygon, emission: Emission) -> Self {
        let Some(size) = polygon.size() else { panic!("area lights are on rectilinear charts") };
        let rule = gauss_legendre(NODES);
        let levels = pyramid(&emission, &rule);
        let scale = emission.lobe().scale();
        Self { frame: *polygon.frame(), size, emission, levels, rule, scale }
    }

    /// The nodes of a cell with their radiance × weight × area, on the polygon.
    fn nodes(&self, level: u8, m: [u32; 2]) -> impl Iterator<Item = (DVec2, [f64; 3])> {
        let width = 0.5_f64.powi(level.into());
        let area = self.size.x * self.size.y * width * width;
        let stored = self.levels.get(usize::from(level)).map(|cells| {
            cells[(m[1] << level | m[0]) as usize].as_deref().copied().unwrap_or([[0.0; 3]; SQUARE])
        });
        let constant = if stored.is_none() { self.texel(level, m) } else { [0.0; 3] };
        (0..SQUARE).map(move |i| {
            let ((x, wx), (y, wy)) = (self.rule[i % NODES], self.rule[i / NODES]);
            let uv = (DVec2::new(f64::from(m[0]), f64::from(m[1])) + DVec2::new(x, y)) * width;
            let light = match &stored {
                Some(nodes) => nodes[i].map(|l| area * f64::from(l)),
                None => constant.map(|l| area * wx * wy * f64::from(l)),
            };
            (uv, light)
        })
    }

    /// The texel that a cell of this level, its own or one below, is in.
    fn texel(&self, level: u8, m: [u32; 2]) -> [f32; 3] {
        let (own, up) = (self.emission.level(), level - self.emission.level());
        self.emission.picture()[((m[1] >> up) << own | m[0] >> up) as usize]
    }

    /// Whether a cell of this level has neither a texel's nodes nor its own.
    fn is_between(&self, level: u8) -> bool {
        usize::from(level) >= self.levels.len() && level < self.emission.level()
    }

    fn is_dark(&self, level: u8, m: [u32; 2]) -> bool {
        match self.levels.get(usize::from(level)) {
            Some(cells) => cells[(m[1] << level | m[0]) as usize].is_none(),
            None if self.is_between(level) => false,
            None => self.texel(level, m) == [0.0; 3],
        }
    }
}

impl Illuminant for AreaLight {
    fn illuminate(&self, frame: &Frame, point: DVec3, scale: f64, beams: &mut Beams) {
        // Before its front only.
        if self.frame.n.dot(point - self.frame.origin) <= 0.0 {
            return;
        }
        let least = (FINENESS * scale.min(self.scale)).min(WIDEST);
        let finest = self.emission.level() + EXTRA;
        let at = |uv: DVec2| self.frame.point(uv * self.size) - point;
        let mut open = vec![(0_u8, [0_u32; 2])];
        while let Some((level, m)) = open.pop() {
            if self.is_dark(level, m) {
                continue;
            }
            let width = 0.5_f64.powi(level.into());
            let to = at((DVec2::new(f64::from(m[0]), f64::from(m[1])) + 0.5) * width);
            let (distance, diagonal) = (to.length(), self.size.length() * width);
            let height = frame.n.dot(to);
            if height <= -0.5 * diagonal {
                continue;
            }
            let cut = height < 0.5 * diagonal;
            let wanted = least * distance * if cut { CUT } else { 1.0 };
            if diagonal > wanted && level < finest || self.is_between(level) {
                let children = [[1, 1], [0, 1], [1, 0], [0, 0]];
                open.extend(children.map(|c| (level + 1, [2 * m[0] + c[0], 2 * m[1] + c[1]])));
                continue;
            }
            let beam = |(uv, light): (DVec2, [f64; 3])| {
                let to = at(uv);
                let squared = to.length_squared();
                let towards = to / squared.sqrt();
                let (leaves, arrives) = (-self.frame.n.dot(towards), frame.n.dot(towards));
                if leaves <= 0.0 || arrives <= 0.0 {
                    return None;
                }
                let lobe = self.emission.lobe().eval(self.frame.to_local(-towards));
                let weight = lobe * leaves * arrives / squared;
                let to_light = frame.to_local(towards);
                Some(Beam { to_light, irradiance: light.map(|l| weight * l) })
            };
            let axis = frame.to_local(to / distance);
            beams.push(axis, self.nodes(level, m).filter_map(beam));
        }
    }
}

/// Coefficients of a cell, per channel, x fastest.
type Coefficients = [[f64; SQUARE]; 3];

/// Node values of the levels from [`DIRECT`] above the picture's up.
fn pyramid(emission: &Emission, rule: &[(f64, f64)]) -> Vec<Vec<Option<Box<Nodes>>>> {
    let own = emission.level();
    if own == 0 {
        return Vec::new();
    }
    let basis = Multiwavelet::new(NODES);
    let phi: Vec<_> = rule.iter().map(|(x, _)| legendre(NODES, *x)).collect();
    let finest = own.saturating_sub(DIRECT);
    let mut cells = from_texels(emission, finest, rule);
    let mut levels = Vec::new();
    for level in (0..=finest).rev() {
        if level < finest {
            cells = parents(&cells, 1 << level, &basis);
        }
        let width = 0.5_f64.powi(level.into());
        let nodes = |b: &Option<Box<Coefficients>>| {
            b.as_deref().map(|b| Box::new(node_values(b, rule, &phi, width)))
        };
        levels.push(cells.par_iter().map(nodes).collect());
    }
    levels.reverse();
    levels
}

/// The cells of `level`, by what each texel adds to each coefficient.
fn from_texels(
    emission: &Emission,
    level: u8,
    rule: &[(f64, f64)],
) -> Vec<Option<Box<Coefficients>>> {
    let (own, up) = (emission.level(), emission.level() - level);
    // ∫ φ_k over each of a cell's texels along a side: their polynomials' rule is exact.
    let across = 1_usize << up;
    let part = 1.0 / across as f64;
    let integrals: Vec<[f64; NODES]> = (0..across)
        .map(|t| {
            let mut sums = [0.0; NODES];
            for &(x, weight) in rule {
                let phi = legendre(NODES, (t as f64 + x) * part);
                (0..NODES).for_each(|k| sums[k] += weight * part * phi[k]);
            }
            sums
        })
        .collect();
    let width = 0.5_f64.powi(level.into());
    let cell = |i: usize| {
        let (x, y) = ((i & ((1 << level) - 1)) << up, (i >> level) << up);
        let mut b: Option<Box<Coefficients>> = None;
        for (row, of_y) in integrals.iter().enumerate() {
            for (column, of_x) in integrals.iter().enumerate() {
                let rgb = emission.picture()[(y + row) << own | (x + column)];
                if rgb == [0.0; 3] {
                    continue;
                }
                let b = b.get_or_insert_with(|| Box::new([[0.0; SQUARE]; 3]));
                for (b, l) in b.iter_mut().zip(rgb) {
                    for (b, of_y) in b.chunks_exact_mut(NODES).zip(of_y) {
                        let l = f64::from(l) * width * of_y;
                        b.iter_mut().zip(of_x).for_each(|(b, of_x)| *b += l * of_x);
                    }
                }
            }
        }
        b
    };
    (0..1_usize << (2 * level)).into_par_iter().map(cell).collect()
}

/// The level above, `side` cells along a side.
fn parents(
    cells: &[Option<Box<Coefficients>>],
    side: usize,
    basis: &Multiwavelet,
) -> Vec<Option<Box<Coefficients>>> {
    let parent = |i: usize| {
        let (x, y) = (i % side, i / side);
        let child = |c: usize| cells[(2 * y + c / 2) * 2 * side + 2 * x + c % 2].as_deref();
        if (0..4).all(|c| child(c).is_none()) {
            return None;
        }
        let mut b = Box::new([[0.0; SQUARE]; 3]);
        for channel in 0..3 {
            let mut four = [0.0; 4 * SQUARE];
            for (c, part) in four.chunks_exact_mut(SQUARE).enumerate() {
                if let Some(child) = child(c) {
                    part.copy_from_slice(&child[channel]);
                }
            }
            basis.pull_square(&mut four);
            b[channel].copy_from_slice(&four[..SQUARE]);
        }
        Some(b)
    };
    (0..side * side).into_par_iter().map(parent).collect()
}

/// Weight × what the polynomial of these coefficients is, at each node.
fn node_values(
    b: &Coefficients,
    rule: &[(f64, f64)],
    phi: &[[f64; MAX_ORDER]],
    width: f64,
) -> Nodes {
    let mut nodes = [[0.0; 3]; SQUARE];
    for (c, b) in b.iter().enumerate() {
        for (x, (phi_x, (_, weight_x))) in phi.iter().zip(rule).enumerate() {
            let rows: [f64; NODES] = std::array::from_fn(|l| {
                b[l * NODES..][..NODES].iter().zip(phi_x).map(|(b, phi)| b * phi).sum()
            });
            for (y, (phi_y, (_, weight_y))) in phi.iter().zip(rule).enumerate() {
                let sum: f64 = rows.iter().zip(phi_y).map(|(row, phi)| row * phi).sum();
                nodes[y * NODES + x][c] = (weight_x * weight_y / width * sum) as f32;
            }
        }
    }
    nodes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Lobe, Phong, gather};

    /// Panes and leading: edges everywhere.
    fn panes(level: u8) -> Vec<[f32; 3]> {
        let side = 1_usize << level;
        let texel = |i: usize| {
            let (x, y) = (i % side * 64 / side, i / side * 64 / side);
            let lead = x.is_multiple_of(9) || y.is_multiple_of(7);
            let hue = (x / 9 * 5 + y / 7 * 3) % 7;
            if lead { [0.0; 3] } else { [1.0, 0.3 * hue as f32, 0.1 + (hue % 2) as f32] }
        };
        (0..side * side).map(texel).collect()
    }

    fn window(lobe: Lobe) -> (Polygon, Emission) {
        // 1.6 m a side, upright, 1.2 m above the floor y = 0, shining along +z.
        let polygon =
            Polygon::rectangle(DVec3::new(-0.8, 1.2, 0.0), 1.6 * DVec3::X, 1.6 * DVec3::Y);
        (polygon.expect("a rectangle"), Emission::new(6, panes(6), lobe))
    }

    const FLOOR: Frame = Frame { origin: DVec3::ZERO, x: DVec3::X, y: DVec3::NEG_Z, n: DVec3::Y };

    /// Radiance that a surface at `point` reflects, by beams.
    fn reflected(light: &AreaLight, point: DVec3, phong: &Phong, eye: DVec3) -> ([f64; 3], usize) {
        let mut beams = Beams::default();
        let scale = phong.exponent.max(1.0).sqrt().recip();
        light.illuminate(&FLOOR, point, scale, &mut beams);
        let mut sum = [0.0; 3];
        for beam in beams.bundles().flat_map(|(_, beams)| beams) {
            let f = phong.eval(beam.to_light, eye);
            for c in 0..3 {
                sum[c] += f[c] * beam.irradiance[c];
            }
        }
        (sum, beams.len())
    }

    /// Against midpoints, many more, of the same picture.
    #[test]
    fn few_beams_do_for_many_texels() {
        let slanted = Lobe::Cosine { exponent: 4.0, peak: DVec3::new(0.0, -1.0, 1.0).normalize() };
        let mut worst = 0.0_f64;
        for lobe in [Lobe::Lambertian, slanted] {
            let (polygon, emission) = window(lobe);
            let light = AreaLight::new(&polygon, emission.clone());
            let source = [(polygon, emission)];
            for exponent in [1.0, 8.0, 40.0, 400.0] {
                let phong = Phong { kd: [0.1; 3], ks: [0.6; 3], exponent };
                for (x, z) in [(0.0, 0.4), (0.3, 2.0), (-1.2, 3.5)] {
                    let point = DVec3::new(x, 0.0, z);
                    let mirror = (DVec3::new(0.1, 1.8, 0.0) - point).normalize();
                    let eye = FLOOR.to_local(mirror) * DVec3::new(-1.0, -1.0, 1.0);
                    let (found, beams) = reflected(&light, point, &phong, eye);
                    let cells = if exponent > 100.0 { 512 } else { 256 };
                    let exact = gather(&source, &FLOOR, point, &phong, eye, cells);
                    for c in 0..3 {
                        worst = worst.max((found[c] / exact[c] - 1.0).abs());
                    }
                    assert!(exponent > 100.0 || beams <= 4096, "{beams} beams for n = {exponent}");
                }
            }
        }
        // The midpoints' own error, h²/24 of a bend of n/r², is 10⁻⁵ here.
        assert!(worst < 2e-4, "{worst}");
    }

    /// The corner factor (J. R. Howell, *A Catalog of Radiation Heat Transfer
    /// Configuration Factors*, B-3), for a lamp that crosses the horizon and for
    /// points near enough to be lit by parts of a texel.
    #[test]
    fn a_lamp_that_crosses_the_horizon_gives_the_textbook_irradiance() {
        // A square of side 2 perpendicular to the floor, half of it below.
        let polygon =
            Polygon::rectangle(DVec3::new(0.0, -1.0, 0.0), DVec3::X, 2.0 * DVec3::Y).expect("flat");
        let light = AreaLight::new(&polygon, Emission::new(0, vec![[1.0; 3]], Lobe::Lambertian));
        for distance in [2.0, 0.5, 0.1, 0.02] {
            let mut beams = Beams::default();
            light.illuminate(&FLOOR, DVec3::new(0.0, 0.0, distance), 1.0, &mut beams);
            let found = beams.irradiance()[0];
            // B-4: dA in a plane perpendicular to the rectangle, before its corner.
            let (x, y) = (1.0 / distance, 1.0 / distance);
            let root = (1.0_f64 + y * y).sqrt();
            let expected = 0.5 * (x.atan() - (x / root).atan() / root);
            assert!((found / expected - 1.0).abs() < 2e-3, "{distance}: {found} {expected}");
        }
    }

    #[test]
    fn nothing_shines_backwards_or_from_below() {
        let (polygon, emission) = window(Lobe::Lambertian);
        let light = AreaLight::new(&polygon, emission);
        let mut beams = Beams::default();
        light.illuminate(&FLOOR, DVec3::new(0.0, 0.0, -1.0), 1.0, &mut beams);
        light.illuminate(&FLOOR, DVec3::new(0.0, 4.0, 1.0), 1.0, &mut beams);
        assert!(beams.is_empty(), "{} beams", beams.len());
    }
}
