//! Emitters: a picture times a cosine lobe (§7.3).

use crate::grid::{Grid, Rgb};
use crate::{Levels, Nusselt};
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;
use std::sync::Arc;

/// How emitted radiance depends on direction.
#[derive(Clone, Debug, PartialEq)]
pub enum Lobe {
    /// The same in every direction.
    Lambertian,
    /// max(0, μ·peak)ⁿ for light that travels along μ.
    Cosine {
        /// n ≥ 0.
        exponent: f64,
        /// Unit direction of travel at the peak, in the polygon's frame.
        peak: DVec3,
    },
    /// A factor per direction cell, as a window lit from outside has it; linear in κ and
    /// λ between the cells' centres.
    Table {
        /// The level of the cells.
        level: u8,
        /// 4^`level` means over the cells' parts inside the UDC, κ fastest.
        factors: Arc<[f32]>,
        /// The unit vector (in the polygon's x̂, ŷ) that κ of the cells runs along.
        x: DVec2,
    },
    /// 1 within a narrow cone and 0 outside it, as sunlight through clear glass has it.
    Disc {
        /// Unit direction of travel of the cone's axis, in the polygon's frame.
        axis: DVec3,
        /// The angle between the axis and the cone, in radians.
        radius: f64,
    },
}

/// max(0, cosθ)ⁿ. Whole exponents are the common ones, and several times as fast.
#[must_use]
#[inline]
pub fn cosine_power(cosine: f64, exponent: f64) -> f64 {
    if cosine <= 0.0 {
        return 0.0;
    }
    let whole = exponent as i32;
    if f64::from(whole) == exponent && (0..=256).contains(&whole) {
        cosine.powi(whole)
    } else {
        cosine.powf(exponent)
    }
}

impl Lobe {
    /// The factor for light that travels along the unit vector `travel` (in the
    /// polygon's frame); 0 behind the polygon.
    #[must_use]
    pub fn eval(&self, travel: DVec3) -> f64 {
        if travel.z <= 0.0 {
            return 0.0;
        }
        match self {
            Self::Lambertian => 1.0,
            Self::Cosine { exponent, peak } => cosine_power(travel.dot(*peak), *exponent),
            Self::Table { level, factors, x } => {
                let mu = travel.truncate();
                bilinear(*level, factors, [x.dot(mu), x.perp_dot(mu)])
            }
            Self::Disc { axis, radius } => {
                if travel.dot(*axis) >= radius.cos() {
                    1.0
                } else {
                    0.0
                }
            }
        }
    }

    /// The angle in radians over which it changes by about itself.
    ///
    /// A table's is its cells' size over the root mean square of the differences
    /// between neighbours, relative to that of its factors.
    #[must_use]
    pub fn scale(&self) -> f64 {
        match self {
            Self::Lambertian => 1.0,
            Self::Cosine { exponent, .. } => exponent.max(1.0).sqrt().recip(),
            Self::Table { level, factors, .. } => {
                let side = 1_usize << level;
                let all: f64 = factors.iter().map(|f| f64::from(*f).powi(2)).sum();
                let step = |a: usize, b: usize| f64::from(factors[a] - factors[b]).powi(2);
                let centre = |m: usize| (2 * m + 1) as f64 / side as f64 - 1.0;
                // Where the UDC ends factors do too; that is no change of theirs.
                let inside =
                    |i: usize| centre(i % side).hypot(centre(i / side)) < 1.0 - 2.0 / side as f64;
                let steps: f64 = (0..side * (side - 1))
                    .map(|i| {
                        let (along, across) = (i % side, i / side);
                        let (k, l) = (along * side + across, along * side + across + 1);
                        let down =
                            if inside(i) && inside(i + side) { step(i, i + side) } else { 0.0 };
                        down + if inside(k) && inside(l) { step(k, l) } else { 0.0 }
                    })
                    .sum();
                let cell = 2.0 / side as f64;
                if steps > 0.0 { (cell * (all / steps).sqrt()).min(1.0) } else { 1.0 }
            }
            Self::Disc { radius, .. } => *radius,
        }
    }

    /// The axis and radius in radians of the cone that all of its light travels in, if
    /// that is narrow.
    #[must_use]
    pub fn cone(&self) -> Option<(DVec3, f64)> {
        match self {
            Self::Disc { axis, radius } => Some((*axis, *radius)),
            _ => None,
        }
    }
}

/// Between the centres of the 4^`level` cells; constant from the outermost ones on.
fn bilinear(level: u8, factors: &[f32], mu: [f64; 2]) -> f64 {
    let side = 1_usize << level;
    let [(k, s), (l, t)] = mu.map(|mu| {
        let at = (0.5 * (mu + 1.0) * side as f64 - 0.5).clamp(0.0, (side - 1) as f64);
        ((at as usize).min(side.saturating_sub(2)), at)
    });
    let (s, t) = (s - k as f64, t - l as f64);
    let factor =
        |k: usize, l: usize| f64::from(factors[l.min(side - 1) << level | k.min(side - 1)]);
    let row = |l: usize| factor(k, l) * (1.0 - s) + factor(k + 1, l) * s;
    row(l) * (1.0 - t) + row(l + 1) * t
}

/// Unit directions that stand for equal parts of the cone about `axis`, which has a
/// radius of `radius` radians: `rings` times `around` of them.
pub(crate) fn cone_directions(
    axis: DVec3,
    radius: f64,
    rings: u32,
    around: u32,
) -> impl Iterator<Item = DVec3> {
    let (x, y) = axis.any_orthonormal_pair();
    (0..rings * around).map(move |i| {
        let share = (f64::from(i % rings) + 0.5) / f64::from(rings);
        let cosine = 1.0 - share * (1.0 - radius.cos());
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        // Rings turn against each other, so that no row of them lines up.
        let turn = f64::from(i / rings) + share;
        let phi = TAU * turn / f64::from(around);
        cosine * axis + sine * (phi.cos() * x + phi.sin() * y)
    })
}

/// Solid angle of a cone of `radius` radians.
#[must_use]
pub fn cone_solid_angle(radius: f64) -> f64 {
    // 2π (1 − cos r) without the cancellation.
    2.0 * TAU * (0.5 * radius).sin().powi(2)
}

/// Emitted radiance L_e(u, v, μ) = picture(u, v) × lobe(μ): what a window or a
/// lamp sends into the room.
#[derive(Clone, Debug)]
pub struct Emission {
    level: u8,
    picture: Vec<Rgb>,
    lobe: Lobe,
}

impl Emission {
    /// An emission whose picture has 2^`level` cells a side (u fastest), each the
    /// mean radiance at the lobe's peak over that cell.
    ///
    /// # Panics
    ///
    /// If `picture` is not 4^`level` long.
    #[must_use]
    pub fn new(level: u8, picture: Vec<Rgb>, lobe: Lobe) -> Self {
        assert_eq!(picture.len(), 1 << (2 * level), "4^level texels");
        Self { level, picture, lobe }
    }

    /// The level of its picture.
    #[must_use]
    pub fn level(&self) -> u8 {
        self.level
    }

    /// Mean radiance at the peak over each cell, u fastest.
    #[must_use]
    pub fn picture(&self) -> &[Rgb] {
        &self.picture
    }

    /// Its dependence on direction.
    #[must_use]
    pub fn lobe(&self) -> &Lobe {
        &self.lobe
    }

    /// Radiance at (u, v) for light that travels along `travel`, 0 outside the
    /// unit square.
    #[must_use]
    pub fn eval(&self, uv: DVec2, travel: DVec3) -> [f64; 3] {
        let side = 1_usize << self.level;
        let cell = |x: f64| (0.0..1.0).contains(&x).then_some((x * side as f64) as usize);
        let (Some(u), Some(v)) = (cell(uv.x), cell(uv.y)) else { return [0.0; 3] };
        let lobe = self.lobe.eval(travel);
        self.picture[v << self.level | u].map(|x| lobe * f64::from(x))
    }

    /// Its projection onto cells: the lobe's means over the direction cells of
    /// level `direction`, zeros outside the UDC counted (§4, Eq. 16).
    #[must_use]
    pub fn project(&self, direction: u8) -> Grid {
        const SAMPLES: u32 = 16;
        let side = 1_u32 << direction;
        if let Lobe::Disc { axis, radius } = self.lobe {
            let mut lobe = vec![0.0; (side * side) as usize];
            // Too narrow to be met by samples of cells: cosθ dω = 4 dκ dλ.
            let (rings, around) = (SAMPLES, 4 * SAMPLES);
            let cell = 4.0 / f64::from(side * side);
            let share = cone_solid_angle(radius) / f64::from(rings * around) / cell;
            for travel in cone_directions(axis, radius, rings, around).filter(|t| t.z > 0.0) {
                let at = |mu: f64| ((0.5 * (mu + 1.0) * f64::from(side)) as u32).min(side - 1);
                lobe[(at(travel.y) * side + at(travel.x)) as usize] += (share * travel.z) as f32;
            }
            let levels = Levels { position: self.level, direction };
            return Grid::separable(levels, self.picture.clone(), &lobe);
        }
        let step = 1.0 / f64::from(side * SAMPLES);
        let mean = |k: u32, l: u32| {
            let mut sum = 0.0;
            for i in 0..SAMPLES * SAMPLES {
                let at = |m: u32, s: u32| (f64::from(m * SAMPLES + s) + 0.5) * step;
                let q = Nusselt { kappa: at(k, i % SAMPLES), lambda: at(l, i / SAMPLES) };
                sum += q.to_direction().map_or(0.0, |travel| self.lobe.eval(travel));
            }
            (sum / f64::from(SAMPLES * SAMPLES)) as f32
        };
        let lobe: Vec<f32> = (0..side)
            .flat_map(|l| (0..side).map(move |k| (k, l)))
            .map(|(k, l)| mean(k, l))
            .collect();
        Grid::separable(Levels { position: self.level, direction }, self.picture.clone(), &lobe)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A Lambertian emitter's exitance is π L; a cos¹ lobe about the normal sends
    /// ∫ cos²θ dω = 2π/3.
    #[test]
    fn projected_lobes_carry_their_flux() {
        let normal = Lobe::Cosine { exponent: 1.0, peak: DVec3::Z };
        let cases = [(Lobe::Lambertian, std::f64::consts::PI), (normal, TAU / 3.0)];
        for (lobe, expected) in cases {
            let grid = Emission::new(0, vec![[1.0; 3]], lobe.clone()).project(5);
            let exitance = grid.irradiance()[0][0];
            assert!((exitance / expected - 1.0).abs() < 1e-3, "{lobe:?}: {exitance}");
        }
    }

    /// Light along +x of the table's axes, which are turned by a quarter.
    #[test]
    fn a_table_is_looked_up_in_its_own_axes() {
        let mut factors = vec![0.0; 16];
        factors[2 << 2 | 3] = 5.0;
        let lobe = Lobe::Table { level: 2, factors: factors.into(), x: DVec2::Y };
        let along = |x: f64, y: f64| lobe.eval(DVec3::new(x, y, (1.0 - x * x - y * y).sqrt()));
        assert_eq!((along(-0.25, 0.75), along(0.75, 0.25), along(0.25, -0.75)), (5.0, 0.0, 0.0));
        assert_eq!((along(-0.25, 0.5), along(0.0, 0.5)), (2.5, 1.25), "between centres");
        assert_eq!(lobe.eval(DVec3::new(-0.25, 0.75, -0.5)), 0.0, "behind");
    }

    /// κ itself: its differences are 1/8 and its root mean square 1/√3, so it changes by
    /// as much over 0.25 · 8/√3 of cosine. A table of one value does not change.
    #[test]
    fn a_table_s_scale_is_how_fast_it_changes() {
        let table = |f: fn(usize) -> f32| Lobe::Table {
            level: 5,
            factors: (0..1024).map(f).collect(),
            x: DVec2::X,
        };
        assert_eq!(table(|_| 3.0).scale(), 1.0);
        let slow = table(|i| 10.0 + (i % 32) as f32 / 32.0).scale();
        let fast = table(|i| ((i % 32) % 2) as f32).scale();
        assert!(slow == 1.0 && (0.04..0.07).contains(&fast), "{slow} {fast}");
    }

    /// ∫ cosθ dω over a cone of radius r about a direction at 60° is ω cos 60° (1 − …r²).
    #[test]
    fn a_disc_s_projection_has_its_flux_in_its_cells() {
        let axis = DVec3::new(0.0, 0.75_f64.sqrt(), 0.5);
        let (lobe, radius) = (Lobe::Disc { axis, radius: 0.004 }, 0.004);
        let grid = Emission::new(0, vec![[2.0; 3]], lobe.clone()).project(4);
        let expected = 2.0 * 0.5 * cone_solid_angle(radius);
        let found = grid.irradiance()[0][0];
        assert!((found / expected - 1.0).abs() < 1e-4, "{found} {expected}");
        let at = |mu: f64| (8.0 * (mu + 1.0)) as usize;
        assert!(grid.mean([0, 0, at(axis.x + 1e-9), at(axis.y)])[0] > 0.0, "where it points");
        let travel = |angle: f64| (axis + angle * DVec3::X).normalize();
        assert_eq!((lobe.eval(travel(0.0039)), lobe.eval(travel(0.0041))), (1.0, 0.0));
    }
}
