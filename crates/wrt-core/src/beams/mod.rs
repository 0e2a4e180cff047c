//! The light that arrives at one point, as beams: nodes and weights of a quadrature
//! over whatever shines on it.

mod area_light;
mod disc_light;
mod glossy;

pub use area_light::AreaLight;
pub use disc_light::DiscLight;
pub use glossy::Glossy;

use crate::Frame;
use glam::DVec3;
use std::ops::Range;

/// Light from one direction, standing for what arrives from around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// Unit, in the receiving surface's frame, z > 0.
    pub to_light: DVec3,
    /// L cosθ dω on the surface, W m⁻². Single beams may be negative: see
    /// [`AreaLight`].
    pub irradiance: [f64; 3],
}

/// What arrives at one point, in bundles of nearby directions.
#[derive(Clone, Debug, Default)]
pub struct Beams {
    beams: Vec<Beam>,
    bundles: Vec<Bundle>,
}

/// Beams within a cone.
#[derive(Clone, Debug, PartialEq)]
pub struct Bundle {
    /// Unit, in the surface's frame.
    pub axis: DVec3,
    /// The cosine of the greatest angle between the axis and a beam.
    pub cosine: f64,
    range: Range<usize>,
}

impl Beams {
    /// Adds a bundle about `axis` (a unit vector of the surface's frame); one
    /// without beams is left out.
    pub fn push(&mut self, axis: DVec3, beams: impl IntoIterator<Item = Beam>) {
        let start = self.beams.len();
        self.beams.extend(beams);
        let range = start..self.beams.len();
        if !range.is_empty() {
            let cosines = self.beams[range.clone()].iter().map(|beam| beam.to_light.dot(axis));
            let cosine = cosines.fold(1.0, f64::min);
            self.bundles.push(Bundle { axis, cosine, range });
        }
    }

    /// The bundles, each with its beams.
    pub fn bundles(&self) -> impl Iterator<Item = (&Bundle, &[Beam])> {
        self.bundles.iter().map(|bundle| (bundle, &self.beams[bundle.range.clone()]))
    }

    /// How many beams there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.beams.len()
    }

    /// Whether it is dark.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.beams.is_empty()
    }

    /// Σ L cosθ dω, W m⁻².
    #[must_use]
    pub fn irradiance(&self) -> [f64; 3] {
        self.beams
            .iter()
            .fold([0.0; 3], |sum, beam| std::array::from_fn(|c| sum[c] + beam.irradiance[c]))
    }
}

/// Something that shines on a surface.
pub trait Illuminant: Sync {
    /// Adds the light that arrives at the world's `point` on a surface with
    /// `frame`'s axes, to `beams`.
    ///
    /// Σ g(to light) irradiance is then ∫ g L cosθ dω for any g that is smooth over
    /// angles of `scale` radians, such as a lobe of that standard deviation.
    fn illuminate(&self, frame: &Frame, point: DVec3, scale: f64, beams: &mut Beams);
}
