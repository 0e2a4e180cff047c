//! Sunlight through a piece of clear glass, for surfaces without a wavelet patch.

use crate::scene::Sunlight;
use glam::{DVec2, DVec3, Vec3};
use std::f64::consts::TAU;
use wrt_core::{Sun, cone_solid_angle};

/// Cells along a side of the picture of the glass's colour.
pub(super) const SIDE: usize = 256;

/// The sun behind a parallelogram or triangle of glass.
#[derive(Debug)]
pub(super) struct Sunbeam {
    pub(super) sunlight: Sunlight,
    /// Colour of the glass in [`SIDE`]² cells of (s, t), s fastest.
    pub(super) colours: Vec<Vec3>,
}

/// Light from one point of the sun's disc.
#[derive(Debug)]
pub(super) struct Ray {
    /// Unit.
    pub(super) to_light: DVec3,
    /// Where it passes the glass's plane: corner + s edge_u + t edge_v.
    pub(super) st: DVec2,
    /// Of a surface that faces it, W m⁻², all of the disc counted.
    pub(super) irradiance: Vec3,
}

impl Sunbeam {
    /// The light of the disc's point that `place`, in [0, 1)², stands for; `None` if it
    /// does not come through the parallelogram.
    pub(super) fn ray(&self, place: DVec2, from: DVec3, edges: [DVec3; 2]) -> Option<Ray> {
        let axis = -self.sunlight.travel;
        let (x, y) = axis.any_orthonormal_pair();
        let (radius, phi) = (Sun::RADIUS * place.x.sqrt(), TAU * place.y);
        let to_light = (axis + radius * (phi.cos() * x + phi.sin() * y)).normalize();
        let normal = edges[0].cross(edges[1]);
        let speed = to_light.dot(normal);
        // `from` is seen from the corner; the front's normal looks back at it.
        let distance = -from.dot(normal) / speed;
        if !(distance > 0.0 && distance.is_finite()) {
            return None;
        }
        let at = from + distance * to_light;
        let area = normal.length_squared();
        let st = DVec2::new(at.cross(edges[1]).dot(normal), edges[0].cross(at).dot(normal)) / area;
        if !(st.cmpge(DVec2::ZERO) & st.cmplt(DVec2::ONE)).all() {
            return None;
        }
        let cell = |x: f64| ((x * SIDE as f64) as usize).min(SIDE - 1);
        let colour = self.colours[cell(st.y) * SIDE + cell(st.x)];
        let facing = (self.sunlight.radiance * cone_solid_angle(Sun::RADIUS)) as f32;
        (colour != Vec3::ZERO).then_some(Ray { to_light, st, irradiance: facing * colour })
    }
}
