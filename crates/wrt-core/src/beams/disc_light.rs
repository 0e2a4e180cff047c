//! A picture through which light of a narrow cone of directions shines: sunlight
//! through a window.

use super::{Beam, Beams, Illuminant};
use crate::{Emission, Frame, Polygon, cone_solid_angle};
use glam::{DVec2, DVec3};

/// Strips that the cone's disc is cut into.
const STRIPS: u32 = 32;

/// A part of the disc across, relative to the angle over which the integrand is
/// smooth: midpoints are then off by (½)²/24 of a bend of 1.
const FINENESS: f64 = 0.5;

/// An emitter whose light travels in a narrow cone.
///
/// What a point sees of it is the part of the picture under the cone's disc, projected
/// from the point. The disc is cut into strips along the picture's rows; of each, the
/// picture's mean is exact, by sums over rectangles, so that the irradiance is continuous
/// in the point whatever edges the picture has.
#[derive(Clone, Debug)]
pub struct DiscLight {
    frame: Frame,
    size: DVec2,
    level: u8,
    /// (2^level + 1)² sums of the texels below and to the left.
    sums: Vec<[f64; 3]>,
    /// Unit, in the world, towards the light.
    to_light: DVec3,
    /// Across the picture's rows and along them, perpendicular to `to_light`.
    across: DVec3,
    along: DVec3,
    radius: f64,
}

impl DiscLight {
    /// Prepares a picture seen in light within `cone`: axis of travel in the polygon's
    /// frame, and radius in radians.
    ///
    /// # Panics
    ///
    /// If its chart is not rectilinear.
    #[must_use]
    pub fn new(polygon: &Polygon, emission: &Emission, cone: (DVec3, f64)) -> Self {
        let Some(size) = polygon.size() else { panic!("disc lights are on rectilinear charts") };
        let frame = *polygon.frame();
        let to_light = -frame.to_world(cone.0);
        let side = 1_usize << emission.level();
        let mut sums = vec![[0.0; 3]; (side + 1) * (side + 1)];
        for (i, texel) in emission.picture().iter().enumerate() {
            let at = (i / side + 1) * (side + 1) + i % side + 1;
            sums[at] = std::array::from_fn(|c| {
                let before = sums[at - 1][c] + sums[at - side - 1][c] - sums[at - side - 2][c];
                before + f64::from(texel[c])
            });
        }
        // Light along a row of the picture: in the plane of x̂ and the axis.
        let row = (frame.x - frame.x.dot(to_light) * to_light).try_normalize();
        let along = row.unwrap_or(frame.y);
        let across = to_light.cross(along);
        let level = emission.level();
        Self { frame, size, level, sums, to_light, across, along, radius: cone.1 }
    }

    /// Where the ray from `point` towards `to` meets the picture, in (u, v).
    fn meets(&self, point: DVec3, to: DVec3) -> Option<DVec2> {
        let speed = -self.frame.n.dot(to);
        let height = self.frame.n.dot(point - self.frame.origin);
        if speed <= 0.0 || height <= 0.0 {
            return None;
        }
        let hit = point + to * (height / speed) - self.frame.origin;
        Some(DVec2::new(self.frame.x.dot(hit), self.frame.y.dot(hit)) / self.size)
    }

    /// The mean of the picture over a rectangle, dark outside the unit square.
    fn mean(&self, a: DVec2, b: DVec2) -> [f64; 3] {
        let side = f64::from(1_u32 << self.level);
        // An empty rectangle still sees the texel that it is in.
        let (mut low, mut high) = (a.min(b) * side, a.max(b) * side);
        let flat = high.cmplt(low + 1e-9);
        low = DVec2::select(flat, low - 1e-9, low);
        high = DVec2::select(flat, high + 1e-9, high);
        let area = (high - low).element_product();
        let (low, high) = (
            low.clamp(DVec2::ZERO, DVec2::splat(side)),
            high.clamp(DVec2::ZERO, DVec2::splat(side)),
        );
        if low.cmpge(high).any() {
            return [0.0; 3];
        }
        let [a, b, c, d] =
            [high, DVec2::new(low.x, high.y), DVec2::new(high.x, low.y), low].map(|p| self.sum(p));
        std::array::from_fn(|i| (a[i] - b[i] - c[i] + d[i]) / area)
    }

    /// The sum up to a point, in texels.
    fn sum(&self, at: DVec2) -> [f64; 3] {
        let side = 1_usize << self.level;
        let corner = |x: f64| (x as usize).min(side - 1);
        let (i, j) = (corner(at.x), corner(at.y));
        let (s, t) = (at.x - i as f64, at.y - j as f64);
        let sums = |i: usize, j: usize| self.sums[j * (side + 1) + i];
        let [a, b, c, d] = [sums(i, j), sums(i + 1, j), sums(i, j + 1), sums(i + 1, j + 1)];
        std::array::from_fn(|k| {
            (1.0 - t) * (a[k] + s * (b[k] - a[k])) + t * (c[k] + s * (d[k] - c[k]))
        })
    }
}

impl Illuminant for DiscLight {
    fn illuminate(&self, frame: &Frame, point: DVec3, scale: f64, beams: &mut Beams) {
        if self.frame.n.dot(point - self.frame.origin) <= 0.0
            || self.meets(point, self.to_light).is_none()
        {
            return;
        }
        // As many parts along a strip, and groups of strips, as the integrand can tell.
        let parts =
            (2.0 * self.radius / (FINENESS * scale)).ceil().clamp(1.0, f64::from(STRIPS / 2));
        let parts = if self.radius < 0.1 * scale { 1 } else { parts as u32 };
        let step = 2.0 / f64::from(STRIPS);
        let half = |s: f64| (1.0 - s * s).max(0.0).sqrt();
        let middle = |strip: u32| (f64::from(strip) + 0.5) * step - 1.0;
        let total: f64 = (0..STRIPS).map(|strip| half(middle(strip))).sum();
        let at = |s: f64, t: f64| self.to_light + self.radius * (s * self.across + t * self.along);
        let mut found =
            vec![Beam { to_light: DVec3::ZERO, irradiance: [0.0; 3] }; (parts * parts) as usize];
        for strip in 0..STRIPS {
            let s = middle(strip);
            let reach = half(s);
            let share = cone_solid_angle(self.radius) * reach / total / f64::from(parts);
            for part in 0..parts {
                let bound = |part: u32| reach * (2.0 * f64::from(part) / f64::from(parts) - 1.0);
                let (from, to) = (bound(part), bound(part + 1));
                let to_light = at(s, 0.5 * (from + to)).normalize();
                let arrives = frame.n.dot(to_light);
                let corners = [at(s - 0.5 * step, from), at(s + 0.5 * step, to)];
                let [a, b] = corners.map(|to| self.meets(point, to));
                let (Some(a), Some(b)) = (a, b) else { continue };
                if arrives <= 0.0 {
                    continue;
                }
                let beam = &mut found[(strip * parts / STRIPS * parts + part) as usize];
                for (sum, mean) in beam.irradiance.iter_mut().zip(self.mean(a, b)) {
                    *sum += share * arrives * mean;
                }
                beam.to_light += share * to_light;
            }
        }
        let lit = found.into_iter().filter(|beam| beam.irradiance != [0.0; 3]);
        let beam =
            |beam: Beam| Beam { to_light: frame.to_local(beam.to_light.normalize()), ..beam };
        beams.push(frame.to_local(self.to_light), lit.map(beam));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Lobe, Phong, gather};

    const FLOOR: Frame = Frame { origin: DVec3::ZERO, x: DVec3::X, y: DVec3::NEG_Z, n: DVec3::Y };
    const RADIUS: f64 = 0.02;

    /// A window of 2 × 1.5 m, 1 m above the floor, its light slanting down and aside.
    fn window(picture: Vec<[f32; 3]>) -> (Polygon, Emission) {
        let polygon =
            Polygon::rectangle(DVec3::new(-1.0, 1.0, 0.0), 2.0 * DVec3::X, 1.5 * DVec3::Y);
        let axis = DVec3::new(0.3, -0.8, 1.0).normalize();
        let level = (picture.len().ilog2() / 2) as u8;
        let lobe = Lobe::Disc { axis, radius: RADIUS };
        (polygon.expect("a rectangle"), Emission::new(level, picture, lobe))
    }

    fn light(polygon: &Polygon, emission: &Emission) -> DiscLight {
        DiscLight::new(polygon, emission, emission.lobe().cone().expect("a disc"))
    }

    fn irradiance(light: &DiscLight, point: DVec3, scale: f64) -> [f64; 3] {
        let mut beams = Beams::default();
        light.illuminate(&FLOOR, point, scale, &mut beams);
        beams.irradiance()
    }

    /// The beam's prism meets the floor in a rectangle's image: inside it the irradiance
    /// is L ω cosθ, outside nothing, and half of it on the edge.
    #[test]
    fn a_beam_lands_where_geometry_says() {
        let (polygon, emission) = window(vec![[1.0; 3]]);
        let light = light(&polygon, &emission);
        let travel = DVec3::new(0.3, -0.8, 1.0);
        let lands = |x: f64, y: f64| {
            let from = DVec3::new(x, y, 0.0);
            from + travel * (from.y / -travel.y)
        };
        let full = cone_solid_angle(RADIUS) * -travel.normalize().y;
        for (x, y, expected) in [
            (0.0, 1.7, 1.0),
            (-0.9, 1.1, 1.0),
            (1.0, 1.7, 0.5),
            (0.2, 1.0, 0.5),
            (0.2, 2.5, 0.5),
            (-1.1, 1.7, 0.0),
            (0.0, 0.9, 0.0),
        ] {
            let point = lands(x, y) * DVec3::new(1.0, 0.0, 1.0);
            let found = irradiance(&light, point, 1.0)[0] / full;
            assert!((found - expected).abs() < 0.01, "({x}, {y}): {found}");
        }
        assert_eq!(irradiance(&light, DVec3::new(0.0, 0.0, -1.0), 1.0), [0.0; 3], "behind");
    }

    /// Against directions of the disc one by one, for lobes wider and narrower than it.
    #[test]
    fn few_beams_do_for_many_directions() {
        let panes = (0..64 * 64_usize).map(|i| {
            let (x, y) = (i % 64, i / 64);
            if x.is_multiple_of(9) || y.is_multiple_of(7) {
                [0.0; 3]
            } else {
                [1.0, (x / 9) as f32, 0.2]
            }
        });
        let (polygon, emission) = window(panes.collect());
        let light = light(&polygon, &emission);
        let source = [(polygon, emission)];
        for exponent in [8.0, 400.0, 20_000.0] {
            let phong = Phong { kd: [0.2; 3], ks: [0.5; 3], exponent };
            for (x, z) in [(0.7, 2.0), (0.45, 1.6), (1.1, 2.6)] {
                let point = DVec3::new(x, 0.0, z);
                let mirror = DVec3::new(-0.3 + 0.2 / f64::sqrt(exponent), 0.8, -1.0).normalize();
                let eye = FLOOR.to_local(mirror) * DVec3::new(-1.0, -1.0, 1.0);
                let exact = gather(&source, &FLOOR, point, &phong, eye, 256);
                let mut beams = Beams::default();
                light.illuminate(&FLOOR, point, phong.exponent.sqrt().recip(), &mut beams);
                let mut found = [0.0; 3];
                for beam in beams.bundles().flat_map(|(_, beams)| beams) {
                    let f = phong.eval(beam.to_light, eye);
                    found = std::array::from_fn(|c| found[c] + f[c] * beam.irradiance[c]);
                }
                for c in 0..3 {
                    assert!(
                        (found[c] / exact[c] - 1.0).abs() < 0.01,
                        "n = {exponent} at ({x}, {z}): {found:?} {exact:?}"
                    );
                }
                assert!(exponent > 10.0 || beams.len() == 1, "{} beams", beams.len());
            }
        }
    }
}
