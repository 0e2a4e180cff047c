//! Reflected radiance at a point by plain quadrature over the emitters: no
//! wavelets, no transport. What everything else is measured against.

use crate::emission::cone_directions;
use crate::{Emission, Phong, Polygon, cone_solid_angle};
use glam::{DVec2, DVec3};

/// The radiance that a surface at `point` with `frame`'s axes reflects towards
/// `to_eye` (a unit vector of the frame, z > 0) of the light of `emitters`, with
/// `cells`² midpoints on each emitter's chart, or in its cone of directions where that is
/// narrow. No occlusion.
///
/// ∫ f_r L_e cosθ_s cosθ_d / r² dA.
///
/// # Panics
///
/// If an emitter's chart is not rectilinear.
#[must_use]
pub fn gather(
    emitters: &[(Polygon, Emission)],
    frame: &crate::Frame,
    point: DVec3,
    phong: &Phong,
    to_eye: DVec3,
    cells: u32,
) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for (polygon, emission) in emitters {
        let Some(size) = polygon.size() else { panic!("gathering needs rectilinear charts") };
        let mut add = |uv: DVec2, towards: DVec3, weight: f64| {
            let light = emission.eval(uv, polygon.frame().to_local(-towards));
            let reflectance = phong.eval(frame.to_local(towards), to_eye);
            for c in 0..3 {
                sum[c] += light[c] * reflectance[c] * weight;
            }
        };
        if let Some((axis, radius)) = emission.lobe().cone() {
            // A narrow cone falls between midpoints of the chart: its directions instead.
            let (rings, around) = (cells.div_ceil(4), cells);
            let share = cone_solid_angle(radius) / f64::from(rings * around);
            let axis = -polygon.frame().to_world(axis);
            for towards in cone_directions(axis, radius, rings, around) {
                let (leaves, arrives) = (-polygon.frame().n.dot(towards), frame.n.dot(towards));
                let height = polygon.frame().n.dot(point - polygon.frame().origin);
                if leaves > 0.0 && arrives > 0.0 && height > 0.0 {
                    let hit = point + towards * (height / leaves) - polygon.frame().origin;
                    let uv = polygon.frame().to_local(hit).truncate() / size;
                    // Rounding must not take the outermost ones out of the cone.
                    let inside = towards.lerp(axis, 1e-9).normalize();
                    add(uv, inside, share * arrives);
                }
            }
            continue;
        }
        let area = size.x * size.y / f64::from(cells * cells);
        for i in 0..cells * cells {
            let at = DVec2::new(f64::from(i % cells), f64::from(i / cells)) + 0.5;
            let uv = at / f64::from(cells);
            let to = polygon.frame().point(uv * size) - point;
            let r2 = to.length_squared();
            let towards = to / r2.sqrt();
            let (leaves, arrives) = (-polygon.frame().n.dot(towards), frame.n.dot(towards));
            if leaves <= 0.0 || arrives <= 0.0 {
                continue;
            }
            add(uv, towards, leaves * arrives / r2 * area);
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Lobe;

    /// A unit square 1 above a point under its corner: E = ½(…)·2 for L = 1, the
    /// classical corner factor (Howell B-3 with a = b = c).
    #[test]
    fn a_square_over_its_corner_gives_the_textbook_irradiance() {
        let lamp = Polygon::rectangle(DVec3::new(0., 1., 1.), DVec3::X, -DVec3::Y);
        let lamp = lamp.expect("a rectangle");
        let floor = Polygon::rectangle(DVec3::ZERO, DVec3::X, DVec3::Y).expect("a square");
        let emission = Emission::new(0, vec![[1.0; 3]], Lobe::Lambertian);
        let white = Phong { kd: [1.0; 3], ks: [0.0; 3], exponent: 0.0 };
        let found =
            gather(&[(lamp, emission)], floor.frame(), DVec3::ZERO, &white, DVec3::Z, 400)[0];
        // F = (1/π) · (1/√2) atan(1/√2); radiosity F equals π L_r / π.
        let expected = (0.5_f64.sqrt() * 0.5_f64.sqrt().atan()) / std::f64::consts::PI;
        assert!((found / expected - 1.0).abs() < 1e-5, "{found} {expected}");
    }
}
