//! What blocks transport: a source as pictures by direction.

use crate::grid::{Grid, Rgb};
use crate::{Emission, Lobe, Nusselt};
use glam::DVec3;

/// Radiance that leaves a source: for each direction a picture and a factor.
pub trait Source: Sync {
    /// The pictures, each 4^[`level`](Self::level) long, u fastest.
    fn pictures(&self) -> Vec<&[Rgb]>;

    /// The level of the pictures.
    fn level(&self) -> u8;

    /// Which picture is seen, times what, in light that travels along the unit
    /// vector `travel` of the source's frame (z > 0).
    fn slice(&self, travel: DVec3) -> Option<(usize, f64)>;

    /// The axis (in the source's frame) and the radius in radians of a cone that all
    /// light travels in, if there is a narrow one: other directions are then left out.
    fn cone(&self) -> Option<(DVec3, f64)> {
        None
    }

    /// Where [`slice`](Self::slice) is not smooth.
    fn kinks(&self) -> Kinks;
}

/// Where the picture that a source shows changes with the direction, and how its factor
/// does.
#[derive(Clone, Debug, PartialEq)]
pub struct Kinks {
    /// Circles n·travel = c (n of unit length, in the source's frame) at which the
    /// picture changes, or the factor or any derivative of it jumps.
    pub circles: Vec<(DVec3, f64)>,
    /// The angle in radians over which the factor changes by about itself elsewhere; what
    /// circles bound is no more than some sixty times as large wherever anything is seen.
    pub scale: f64,
    /// Whether the factor of either side of a circle has an analytic continuation to the
    /// other, so that there is no root on it.
    pub analytic: bool,
}

/// Where lobes of cosines end: what is fainter, relative to the peak, counts as nothing.
const FAINTEST: f64 = 1e-30;

impl Source for Emission {
    fn pictures(&self) -> Vec<&[Rgb]> {
        vec![self.picture()]
    }

    fn level(&self) -> u8 {
        self.level()
    }

    fn slice(&self, travel: DVec3) -> Option<(usize, f64)> {
        let factor = self.lobe().eval(travel);
        let least = if matches!(self.lobe(), Lobe::Cosine { .. }) { FAINTEST } else { 0.0 };
        (factor > least).then_some((0, factor))
    }

    fn cone(&self) -> Option<(DVec3, f64)> {
        self.lobe().cone()
    }

    fn kinks(&self) -> Kinks {
        let (mut circles, mut scale, mut analytic) = (Vec::new(), 1.0, true);
        match self.lobe() {
            Lobe::Lambertian => {}
            Lobe::Cosine { exponent, peak } => {
                circles.push((*peak, FAINTEST.powf(exponent.recip())));
                scale = self.lobe().scale();
                analytic = exponent.fract() == 0.0;
            }
            Lobe::Table { level, x, .. } => {
                // Linear between the cells' centres, constant from the outermost ones on.
                let side = f64::from(1_u32 << level);
                let centres = (0..1_u32 << level).map(|m| f64::from(2 * m + 1) / side - 1.0);
                circles
                    .extend(centres.flat_map(|c| [(x.extend(0.0), c), (x.perp().extend(0.0), c)]));
            }
            Lobe::Disc { axis, radius } => circles.push((*axis, radius.cos())),
        }
        Kinks { circles, scale, analytic }
    }
}

impl Source for Grid {
    fn pictures(&self) -> Vec<&[Rgb]> {
        self.images().iter().map(Vec::as_slice).collect()
    }

    fn level(&self) -> u8 {
        self.levels().position
    }

    fn slice(&self, travel: DVec3) -> Option<(usize, f64)> {
        let q = Nusselt::from_direction(travel)?;
        let level = self.levels().direction;
        let side = 1_usize << level;
        let cell = |x: f64| ((x * side as f64) as usize).min(side - 1);
        self.slice(cell(q.lambda) << level | cell(q.kappa)).map(|(i, f)| (i, f64::from(f)))
    }

    fn kinks(&self) -> Kinks {
        let side = 1_u32 << self.levels().direction;
        let lines = (1..side).map(|m| f64::from(2 * m) / f64::from(side) - 1.0);
        let circles = lines.flat_map(|c| [(DVec3::X, c), (DVec3::Y, c)]).collect();
        Kinks { circles, scale: 1.0, analytic: true }
    }
}
