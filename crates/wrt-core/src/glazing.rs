//! What a window lets through: the transmission half of Eq. 1, from its outer side to
//! its inner one.

use crate::Levels;
use crate::grid::Grid;
use crate::interaction::{Bsdf, Interface, LobeMatrix, Phong, reflect};
use std::sync::Arc;

/// The BTDF of a window, without the colour of its glass.
///
/// Light on the outer side is in the window's tangent axes with −n̂ as its normal, so
/// that light which goes straight on flips about (½, ½) as in a mirror: a lobe about
/// that direction is a BRDF's lobe about the mirror direction.
#[derive(Clone, Debug)]
pub enum Glazing {
    /// A flat pane: nothing is bent, and with all reflections between its sides
    /// (1 − F)/(1 + F) passes, F being Fresnel's reflectance of one.
    Clear {
        /// Refractive index; 1 lets all pass.
        ior: f64,
    },
    /// k_d passes in all directions alike, k_s about the straight one.
    Diffusing(Phong),
    /// Measured or computed elsewhere.
    Tabulated(Arc<Bsdf>),
}

impl Glazing {
    /// The radiance that leaves the inner side; `outside` is on the outer one.
    #[must_use]
    pub fn transmit(&self, outside: &Grid) -> Grid {
        let Levels { direction, .. } = outside.levels();
        match self {
            Self::Clear { ior } => {
                let surface = Interface { eta_incident: 1.0, eta_transmitted: *ior };
                surface.pass(outside, |f| (1.0 - f) / (1.0 + f))
            }
            Self::Diffusing(phong) => {
                let lobe = phong
                    .is_glossy()
                    .then(|| LobeMatrix::phong(phong.exponent, direction, direction));
                reflect(outside, phong, lobe.as_ref())
            }
            Self::Tabulated(bsdf) => bsdf.apply(outside),
        }
    }

    /// The fraction of light that goes straight on when it meets the pane at an angle
    /// with this cosine; `None` if it is scattered.
    #[must_use]
    pub fn straight(&self, cosine: f64) -> Option<f64> {
        let Self::Clear { ior } = self else { return None };
        let surface = Interface { eta_incident: 1.0, eta_transmitted: *ior };
        let f = surface.reflectance(cosine.clamp(0.0, 1.0));
        Some((1.0 - f) / (1.0 + f))
    }

    /// Whether light that comes from one direction leaves in one.
    #[must_use]
    pub fn is_clear(&self) -> bool {
        matches!(self, Self::Clear { .. })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Sky, SkyModel, Sun, grid::udc_fractions};
    use glam::DVec3;
    use std::f64::consts::PI;

    fn furnace(direction: u8) -> Grid {
        let lobe: Vec<f32> = udc_fractions(direction).iter().map(|&f| f as f32).collect();
        Grid::separable(Levels { position: 0, direction }, vec![[1.0; 3]], &lobe)
    }

    fn flux(grid: &Grid) -> f64 {
        grid.irradiance()[0][0]
    }

    #[test]
    fn glass_without_a_surface_lets_all_light_straight_through() {
        let frame = crate::Polygon::rectangle(DVec3::ZERO, DVec3::X, DVec3::Y);
        let frame = *frame.expect("a square").frame();
        let sun = Sun::new(30.0, 40.0, 500.0).expect("in range");
        let sky = Sky::new(SkyModel::Clear, 80.0, Some(sun), 0.2).expect("in range");
        let outside = sky.behind(&frame, 5);
        let inside = Glazing::Clear { ior: 1.0 }.transmit(&outside);
        assert!((flux(&inside) / flux(&outside) - 1.0).abs() < 1e-6, "all of it");
        // Sunlight travels on: away from the sun, to the side of +n̂.
        let travel = frame.to_local(-sun.direction);
        let cell = |mu: f64| (16.0 * (mu + 1.0)) as usize;
        let beam = inside.mean([0, 0, cell(travel.x), cell(travel.y)])[0];
        let most = (0..1024).map(|d| inside.mean([0, 0, d % 32, d / 32])[0]).fold(0.0, f32::max);
        assert!(travel.z > 0.0 && beam > 0.3 * most, "{beam} of {most}");
    }

    /// (1 − F)/(1 + F) at normal incidence: 2n/(n² + 1).
    #[test]
    fn a_pane_passes_its_closed_form() {
        let inside = Glazing::Clear { ior: 1.5 }.transmit(&furnace(5));
        let centre = inside.mean([0, 0, 16, 16])[0];
        assert!((centre - 3.0 / 3.25).abs() < 1e-4, "{centre}");
        assert!(flux(&inside) < 0.87 * PI && flux(&inside) > 0.8 * PI, "{}", flux(&inside));
    }

    #[test]
    fn milk_glass_passes_its_share_in_all_directions() {
        let milk = Phong::new([0.6; 3], [0.0; 3], 0.0).expect("in range");
        let inside = Glazing::Diffusing(milk).transmit(&furnace(4));
        assert!((flux(&inside) / (0.6 * PI) - 1.0).abs() < 1e-6, "{}", flux(&inside));
    }
}
