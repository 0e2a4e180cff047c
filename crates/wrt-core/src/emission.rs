//! Emitters: a picture times a cosine lobe (§7.3).

use crate::grid::{Grid, Rgb};
use crate::{Levels, Nusselt};
use glam::{DVec2, DVec3};
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
    /// A factor per direction cell, as a window lit from outside has it.
    Table {
        /// The level of the cells.
        level: u8,
        /// 4^`level` means over the cells' parts inside the UDC, κ fastest.
        factors: Arc<[f32]>,
        /// The unit vector (in the polygon's x̂, ŷ) that κ of the cells runs along.
        x: DVec2,
    },
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
            Self::Cosine { exponent, peak } => {
                let cosine = travel.dot(*peak);
                if cosine > 0.0 { cosine.powf(*exponent) } else { 0.0 }
            }
            Self::Table { level, factors, x } => {
                let side = 1_usize << level;
                let cell = |mu: f64| ((0.5 * (mu + 1.0) * side as f64) as usize).min(side - 1);
                let mu = travel.truncate();
                f64::from(factors[cell(x.perp_dot(mu)) << level | cell(x.dot(mu))])
            }
        }
    }
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
        let cases =
            [(Lobe::Lambertian, std::f64::consts::PI), (normal, std::f64::consts::TAU / 3.0)];
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
        assert_eq!((along(-0.1, 0.8), along(0.8, 0.1), along(0.1, -0.8)), (5.0, 0.0, 0.0));
        assert_eq!(lobe.eval(DVec3::new(-0.1, 0.8, -0.5)), 0.0, "behind");
    }
}
