//! BSDFs given as tables over patches of directions, as measured or simulated.

use super::BrdfTree;
use crate::grid::{Grid, Rgb, udc_fractions};
use crate::{Error, Levels, Result};
use glam::DVec2;
use std::f64::consts::{FRAC_PI_4, PI, TAU};

/// A ring of a Klems basis: zenith angles from that of the ring before, in equal parts
/// of azimuth, the first centred on azimuth 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ring {
    /// Its outer zenith angle, in radians.
    pub theta: f64,
    /// Patches around it, at least 1.
    pub patches: u32,
}

/// A division of the hemisphere's directions.
#[derive(Clone, Debug, PartialEq)]
pub enum Patches {
    /// Rings of equal zenith angle (J. H. Klems, *A new method for predicting the solar
    /// heat gain of complex fenestration systems*, ASHRAE Trans. 100(1), 1994).
    Klems(Vec<Ring>),
    /// 2^level × 2^level cells of the square that Shirley and Chiu's concentric map
    /// takes to the disc of (μx, μy) (P. Shirley, K. Chiu, *A low distortion map between
    /// disk and square*, JGT 2(3), 1997): all of one projected solid angle.
    Square(u8),
}

impl Patches {
    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Klems(rings) => rings.iter().map(|ring| ring.patches as usize).sum(),
            Self::Square(level) => 1 << (2 * level),
        }
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The patch of the direction with cosines μ = (μx, μy), ‖μ‖ ≤ 1.
    #[must_use]
    pub fn index(&self, mu: DVec2) -> usize {
        match self {
            Self::Klems(rings) => {
                let theta = mu.length().min(1.0).asin();
                let mut first = 0;
                for (i, ring) in rings.iter().enumerate() {
                    if theta < ring.theta || i + 1 == rings.len() {
                        let count = f64::from(ring.patches);
                        let at = (mu.y.atan2(mu.x) / TAU * count + 0.5).rem_euclid(count);
                        return first + (at as usize).min(ring.patches as usize - 1);
                    }
                    first += ring.patches as usize;
                }
                0
            }
            Self::Square(level) => {
                let side = 1_usize << level;
                let cell = |x: f64| ((x * side as f64) as usize).min(side - 1);
                let at = square_of_disc(mu);
                cell(at.x) << level | cell(at.y)
            }
        }
    }

    /// ∫ cosθ dω over a patch.
    #[must_use]
    pub fn projected(&self, patch: usize) -> f64 {
        match self {
            Self::Klems(rings) => {
                let (mut first, mut inner) = (0, 0.0_f64);
                for ring in rings {
                    let outer = ring.theta.sin().powi(2);
                    if patch < first + ring.patches as usize {
                        return PI * (outer - inner) / f64::from(ring.patches);
                    }
                    (first, inner) = (first + ring.patches as usize, outer);
                }
                0.0
            }
            Self::Square(level) => PI / f64::from(1_u32 << (2 * level)),
        }
    }

    /// Per direction cell of `level` (κ fastest), what share of its part inside the UDC
    /// lies in which patches; `side` = −1 turns directions over first. Scaled so that the
    /// cells together give each patch its projected solid angle.
    fn shares(&self, level: u8, side: f64) -> Vec<Vec<(u32, f64)>> {
        const POINTS: u32 = 16;
        let cells = 1_u32 << level;
        let step = 2.0 / f64::from(cells * POINTS);
        let mut covered = vec![0.0; self.len()];
        let fractions = udc_fractions(level);
        let mut shares: Vec<Vec<(u32, f64)>> = Vec::with_capacity(fractions.len());
        for (d, fraction) in fractions.iter().enumerate() {
            let (k, l) = (d as u32 % cells, d as u32 / cells);
            let mut patches = Vec::new();
            for i in 0..POINTS * POINTS {
                let at = |m: u32, i: u32| (f64::from(m * POINTS + i) + 0.5) * step - 1.0;
                let mu = DVec2::new(at(k, i % POINTS), at(l, i / POINTS));
                if mu.length_squared() < 1.0 {
                    patches.push(self.index(side * mu) as u32);
                }
            }
            patches.sort_unstable();
            let mut cell: Vec<(u32, f64)> = Vec::new();
            for &patch in &patches {
                let share = (patches.len() as f64).recip();
                match cell.last_mut() {
                    Some(last) if last.0 == patch => last.1 += share,
                    _ => cell.push((patch, share)),
                }
            }
            for (patch, share) in &cell {
                covered[*patch as usize] += share * fraction * 4.0 / f64::from(cells * cells);
            }
            shares.push(cell);
        }
        // Patches that no sample met have no share to scale.
        for (patch, share) in shares.iter_mut().flatten() {
            let patch = *patch as usize;
            *share *= self.projected(patch) / covered[patch];
        }
        shares
    }
}

/// The point of the unit square that the concentric map takes to a point of the disc.
#[must_use]
pub fn square_of_disc(p: DVec2) -> DVec2 {
    let radius = p.length().min(1.0);
    let mut phi = p.y.atan2(p.x);
    if phi < -FRAC_PI_4 {
        phi += TAU;
    }
    let (a, b) = if phi < FRAC_PI_4 {
        (radius, phi * radius / FRAC_PI_4)
    } else if phi < 3.0 * FRAC_PI_4 {
        (-(phi - 2.0 * FRAC_PI_4) * radius / FRAC_PI_4, radius)
    } else if phi < 5.0 * FRAC_PI_4 {
        (-radius, -(phi - 4.0 * FRAC_PI_4) * radius / FRAC_PI_4)
    } else {
        ((phi - 6.0 * FRAC_PI_4) * radius / FRAC_PI_4, -radius)
    };
    0.5 * (DVec2::new(a, b) + 1.0)
}

/// The point of the disc that the concentric map takes a point of the unit square to.
#[must_use]
pub fn disc_of_square(q: DVec2) -> DVec2 {
    let (a, b) = (2.0 * q.x - 1.0, 2.0 * q.y - 1.0);
    if a == 0.0 && b == 0.0 {
        return DVec2::ZERO;
    }
    let (radius, phi) = if a.abs() > b.abs() {
        (a, FRAC_PI_4 * b / a)
    } else {
        (b, 2.0 * FRAC_PI_4 - FRAC_PI_4 * a / b)
    };
    radius * DVec2::from_angle(phi)
}

/// A BRDF or BTDF as a table over patches of incident and outgoing directions.
///
/// Incident directions are found by how the light travels, (−μx, −μy) of the direction
/// to its source, so that light going straight on stays in its patch: both sides'
/// directions are in the same tangent axes.
#[derive(Clone, Debug)]
pub struct Bsdf {
    incident: Patches,
    outgoing: Patches,
    /// By outgoing patch, then by incident one; sr⁻¹.
    values: Vec<f32>,
    /// 1, or −1 where patches are found by the opposite directions.
    side: f64,
}

impl Bsdf {
    /// A table with the incident patch varying fastest.
    ///
    /// # Errors
    ///
    /// [`Error::TableSize`] and [`Error::TableValue`].
    pub fn new(incident: Patches, outgoing: Patches, values: Vec<f32>) -> Result<Self> {
        let (i, o, found) = (incident.len(), outgoing.len(), values.len());
        if i * o != found || found == 0 {
            return Err(Error::TableSize { incident: i, outgoing: o, found });
        }
        let bad = |v: &f32| !(v.is_finite() && *v >= 0.0);
        if let Some(index) = values.iter().position(bad) {
            return Err(Error::TableValue { index, found: values[index] });
        }
        Ok(Self { incident, outgoing, values, side: 1.0 })
    }

    /// The table of light that takes all paths backwards, by f(s, r) = f(r, s): from one
    /// of light that leaves by the back, that of light that enters by it.
    ///
    /// What leaves along l of light that travels along t then travels along −l and
    /// leaves along −t.
    #[must_use]
    pub fn reciprocal(self) -> Self {
        let (columns, rows) = (self.incident.len(), self.outgoing.len());
        let values = &self.values;
        let turned = (0..columns).flat_map(|i| (0..rows).map(move |o| values[o * columns + i]));
        Self {
            values: turned.collect(),
            incident: self.outgoing,
            outgoing: self.incident,
            side: -self.side,
        }
    }

    /// f for light that travels along cosines `travel` and leaves along `leave`, sr⁻¹.
    #[must_use]
    pub fn eval(&self, travel: DVec2, leave: DVec2) -> f64 {
        let i = self.incident.index(self.side * travel);
        let o = self.outgoing.index(self.side * leave);
        f64::from(self.values[o * self.incident.len() + i])
    }

    /// The share of the light of one incident patch that leaves: Σ f ∫ cosθ dω.
    #[must_use]
    pub fn hemispherical(&self, travel: DVec2) -> f64 {
        let (i, count) = (self.incident.index(self.side * travel), self.incident.len());
        let share = |o: usize| f64::from(self.values[o * count + i]) * self.outgoing.projected(o);
        (0..self.outgoing.len()).map(share).sum()
    }

    /// The radiance that leaves of `incident`, at its levels, zeros outside the UDC
    /// counted: fluxes of patches times the table, spread over the cells.
    #[must_use]
    pub fn apply(&self, incident: &Grid) -> Grid {
        let levels = incident.levels();
        let level = levels.direction;
        let weight = 4.0 / levels.directions() as f64;
        let own = self.incident.shares(level, -self.side);
        let mut flux = vec![vec![[0.0; 3]; levels.positions()]; self.incident.len()];
        for (s, shares) in own.iter().enumerate() {
            let Some((image, scale)) = incident.slice(s) else { continue };
            // The shares of one cell may not sum to 1 after scaling; its light does.
            let sum: f64 = shares.iter().map(|share| share.1).sum();
            for &(patch, share) in shares {
                let factor = weight * f64::from(scale) * share / sum;
                for (flux, rgb) in flux[patch as usize].iter_mut().zip(&incident.images()[image]) {
                    *flux = std::array::from_fn(|c| flux[c] + factor * f64::from(rgb[c]));
                }
            }
        }
        let lit: Vec<usize> =
            (0..flux.len()).filter(|&i| flux[i].iter().any(|rgb| *rgb != [0.0; 3])).collect();
        let leaving: Vec<Vec<[f64; 3]>> = (0..self.outgoing.len())
            .map(|o| {
                let mut sum = vec![[0.0; 3]; levels.positions()];
                for &i in &lit {
                    let f = f64::from(self.values[o * self.incident.len() + i]);
                    for (sum, flux) in sum.iter_mut().zip(&flux[i]) {
                        *sum = std::array::from_fn(|c| sum[c] + f * flux[c]);
                    }
                }
                sum
            })
            .collect();
        let fractions = udc_fractions(level);
        let shares = self.outgoing.shares(level, self.side);
        let image = |(r, shares): (usize, &Vec<(u32, f64)>)| -> Option<Vec<Rgb>> {
            let mut sum = vec![[0.0; 3]; levels.positions()];
            for &(patch, share) in shares {
                for (sum, l) in sum.iter_mut().zip(&leaving[patch as usize]) {
                    *sum = std::array::from_fn(|c| sum[c] + fractions[r] * share * l[c]);
                }
            }
            let any = sum.iter().any(|rgb| *rgb != [0.0; 3]);
            any.then(|| sum.iter().map(|rgb| rgb.map(|x| x as f32)).collect())
        };
        Grid::from_images(levels, shares.iter().enumerate().map(image).collect())
    }

    /// Its coefficients over direction cells, to a relative L² error of `tolerance`.
    #[must_use]
    pub fn project(&self, levels: Levels, tolerance: f64) -> BrdfTree {
        let incident = self.incident.shares(levels.position, -self.side);
        let outgoing = self.outgoing.shares(levels.direction, self.side);
        let mean = |s: usize, r: usize| {
            let total: f64 = incident[s].iter().map(|share| share.1).sum();
            let mut sum = 0.0;
            for &(o, b) in &outgoing[r] {
                for &(i, a) in &incident[s] {
                    let at = o as usize * self.incident.len() + i as usize;
                    sum += a / total * b * f64::from(self.values[at]);
                }
            }
            [sum; 3]
        };
        BrdfTree::from_means(levels, &mean, tolerance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TreeBuilder;
    use proptest::prelude::*;

    /// The full Klems basis, 145 patches.
    fn klems() -> Patches {
        let rings = [
            (5., 1),
            (15., 8),
            (25., 16),
            (35., 20),
            (45., 24),
            (55., 24),
            (65., 24),
            (75., 16),
            (90., 12),
        ];
        let ring = |(theta, patches): (f64, u32)| Ring { theta: theta.to_radians(), patches };
        Patches::Klems(rings.map(ring).to_vec())
    }

    fn furnace(direction: u8) -> Grid {
        let lobe: Vec<f32> = udc_fractions(direction).iter().map(|&f| f as f32).collect();
        Grid::separable(Levels { position: 0, direction }, vec![[1.0; 3]], &lobe)
    }

    #[test]
    fn patches_cover_the_hemisphere() {
        for patches in [klems(), Patches::Square(3)] {
            let sum: f64 = (0..patches.len()).map(|i| patches.projected(i)).sum();
            assert!((sum - PI).abs() < 1e-12, "{sum}");
        }
        assert_eq!(klems().len(), 145);
    }

    proptest! {
        #[test]
        fn the_concentric_map_has_its_inverse(x in 0.001..0.999f64, y in 0.001..0.999f64) {
            let q = DVec2::new(x, y);
            prop_assert!((square_of_disc(disc_of_square(q)) - q).length() < 1e-12);
        }
    }

    /// Albedo ρ in every table: flux out = ρ flux in, to rounding, at any level.
    #[test]
    fn a_diffuse_table_keeps_its_albedo() {
        for patches in [klems(), Patches::Square(3)] {
            let count = patches.len();
            let values = vec![(0.7 / PI) as f32; count * count];
            let table = Bsdf::new(patches.clone(), patches, values).expect("a table");
            assert!((table.hemispherical(DVec2::new(0.3, 0.2)) - 0.7).abs() < 1e-6);
            for level in [3, 5] {
                let out = table.apply(&furnace(level)).irradiance()[0][0];
                assert!((out / (0.7 * PI) - 1.0).abs() < 1e-5, "level {level}: {out}");
            }
        }
    }

    /// A table of the identity: light goes on in its patch, and no energy is lost.
    #[test]
    fn light_that_goes_straight_on_stays_in_its_patch() {
        let patches = klems();
        let count = patches.len();
        let mut values = vec![0.0; count * count];
        for i in 0..count {
            values[i * count + i] = patches.projected(i).recip() as f32;
        }
        let table = Bsdf::new(patches.clone(), patches.clone(), values).expect("a table");
        let levels = Levels { position: 0, direction: 5 };
        // From the left and a little above: it leaves to the right and a little below.
        let (k, l) = (6, 18);
        let images = (0..1024).map(|d| (d == l << 5 | k).then(|| vec![[1.0; 3]])).collect();
        let light = Grid::from_images(levels, images);
        let out = table.apply(&light);
        let (given, left) = (light.irradiance()[0][0], out.irradiance()[0][0]);
        assert!((left / given - 1.0).abs() < 1e-5, "{left} of {given}");
        assert!(out.mean([0, 0, 31 - k, 31 - l])[0] > 0.0, "opposite");
        assert_eq!(out.mean([0, 0, k, l])[0], 0.0, "not back");
        // In coefficients as in cells.
        let tree = table.project(Levels::isotropic(5), 0.0);
        let product = tree.reflect(&TreeBuilder::from_grid(&light).finish()).to_grid();
        for d in 0..1024 {
            let m = [0, 0, d % 32, d / 32];
            let (a, b) = (out.mean(m)[0], product.mean(m)[0]);
            assert!((a - b).abs() < 1e-4 * out.mean([0, 0, 31 - k, 31 - l])[0], "{m:?}: {a} {b}");
        }
    }

    /// f(t → l) = f(−l → −t), in look-ups and in what is done to light.
    #[test]
    fn the_reciprocal_table_takes_paths_backwards() {
        let (incident, outgoing) = (klems(), Patches::Square(2));
        let count = incident.len() * outgoing.len();
        let values = (0..count).map(|i| ((i * 7919) % 101) as f32 / 100.0).collect();
        let table = Bsdf::new(incident, outgoing, values).expect("a table");
        let back = table.clone().reciprocal();
        for i in 0..50 {
            let at = |step: f64| 1.4 * ((f64::from(i) * step).fract() - 0.5);
            let (t, l) = (DVec2::new(at(0.618), at(0.324)), DVec2::new(at(0.755), at(0.57)));
            assert_eq!(table.eval(t, l), back.eval(-l, -t), "{t} {l}");
        }
        // The light of a furnace that enters leaves either way: ∬ f is the same, but for
        // what 512 samples across the disc see of the patches that light enters by.
        let through = |table: &Bsdf| table.apply(&furnace(5)).irradiance()[0][0];
        let (a, b) = (through(&table), through(&back));
        assert!((a / b - 1.0).abs() < 1.0 / 512.0, "{a} {b}");
    }

    #[test]
    fn tables_that_do_not_fit_are_refused() {
        let table = |values| Bsdf::new(Patches::Square(1), Patches::Square(1), values);
        assert!(matches!(table(vec![0.0; 15]), Err(Error::TableSize { .. })), "15 of 16");
        let mut values = vec![0.0; 16];
        values[7] = -1.0;
        assert!(matches!(table(values), Err(Error::TableValue { index: 7, .. })), "negative");
    }
}
