//! Area-preserving maps of the hemisphere's directions to the unit square, for
//! bases that are smooth in direction.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_4, PI, SQRT_2};

/// How directions lie on the unit square (s, t).
///
/// In Nusselt coordinates a radiance bends like √ at the rim, where μz is the root
/// of the distance to it. Both maps here are of constant measure and do what they
/// can about corners or about the rim, but no map does everything:
///
/// | map | constant measure | rim | rest |
/// |---|---|---|---|
/// | [`Concentric`](Self::Concentric) | cosθ dω = π ds dt | √ on the square's border | kinks on its diagonals |
/// | [`EqualArea`](Self::EqualArea) | dω = 8 ds dt | smooth | smooth; 21 % of the square is no direction of the hemisphere |
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DirectionMap {
    /// Nusselt's disc, squared by concentric circles (P. Shirley, K. Chiu, *A Low
    /// Distortion Map between Disk and Square*, J. Graphics Tools 2(3), 1997).
    Concentric,
    /// Lambert's azimuthal equal-area projection of the hemisphere, a disc, in the
    /// square around it. The sphere continues in the square's corners, so that what
    /// is smooth in direction stays so across the horizon.
    #[default]
    EqualArea,
}

impl DirectionMap {
    /// (s, t) of a unit direction of the upper hemisphere (z is the normal).
    #[must_use]
    pub fn to_square(self, mu: DVec3) -> DVec2 {
        let plane = match self {
            Self::Concentric => square_of_disc(mu.truncate()),
            // The disc's radius is √(1 − μz), and sinθ that times √(1 + μz).
            Self::EqualArea => mu.truncate() / (1.0 + mu.z.max(0.0)).sqrt(),
        };
        0.5 * (plane + DVec2::ONE)
    }

    /// The unit direction at (s, t) of the unit square; with `EqualArea`, one below
    /// the horizon in the corners.
    #[must_use]
    pub fn to_direction(self, st: DVec2) -> DVec3 {
        let plane = 2.0 * st - DVec2::ONE;
        match self {
            Self::Concentric => {
                let disc = disc_of_square(plane);
                // 1 − r² without cancellation at the rim.
                let r = plane.x.abs().max(plane.y.abs());
                disc.extend(((1.0 - r) * (1.0 + r)).max(0.0).sqrt())
            }
            Self::EqualArea => {
                let a2 = plane.length_squared();
                (plane * (2.0 - a2).max(0.0).sqrt()).extend(1.0 - a2)
            }
        }
    }

    /// cosθ dω / (ds dt) at (s, t): π, or 8 cosθ; 0 below the horizon.
    #[must_use]
    pub fn projected_measure(self, st: DVec2) -> f64 {
        match self {
            Self::Concentric => PI,
            Self::EqualArea => 8.0 * (1.0 - (2.0 * st - DVec2::ONE).length_squared()).max(0.0),
        }
    }

    /// Whether the square [low, low + width]² has directions of the hemisphere.
    #[must_use]
    pub fn has_directions(self, low: DVec2, width: f64) -> bool {
        let nearest = DVec2::splat(0.5).clamp(low, low + width);
        match self {
            Self::Concentric => true,
            Self::EqualArea => nearest.distance_squared(DVec2::splat(0.5)) < 0.25,
        }
    }

    /// The greatest angle per length on (s, t), in radians, up to a factor of 2 at
    /// the rim: how wide a lobe looks on the square.
    #[must_use]
    pub fn stretch(self) -> f64 {
        match self {
            // At the centre; the square root at the rim is not counted.
            Self::Concentric => 2.0,
            Self::EqualArea => 2.0 * SQRT_2,
        }
    }
}

/// The disc's point (radius 1) of a point of [−1, 1]².
fn disc_of_square(p: DVec2) -> DVec2 {
    if p.x.abs() > p.y.abs() {
        p.x * DVec2::from_angle(FRAC_PI_4 * (p.y / p.x))
    } else if p.y != 0.0 {
        let (sin, cos) = (FRAC_PI_4 * (p.x / p.y)).sin_cos();
        p.y * DVec2::new(sin, cos)
    } else {
        DVec2::ZERO
    }
}

fn square_of_disc(p: DVec2) -> DVec2 {
    let r = p.length().min(1.0);
    if p.x.abs() > p.y.abs() {
        let r = r.copysign(p.x);
        DVec2::new(r, r * (p.y / p.x).atan() / FRAC_PI_4)
    } else if p.y != 0.0 {
        let r = r.copysign(p.y);
        DVec2::new(r * (p.x / p.y).atan() / FRAC_PI_4, r)
    } else {
        DVec2::ZERO
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MAPS: [DirectionMap; 2] = [DirectionMap::Concentric, DirectionMap::EqualArea];

    fn direction() -> impl Strategy<Value = DVec3> {
        (0.0..1.0f64, 0.0..2.0 * PI).prop_map(|(z, phi)| {
            let sine = (1.0 - z * z).sqrt();
            DVec3::new(sine * phi.cos(), sine * phi.sin(), z)
        })
    }

    proptest! {
        #[test]
        fn the_square_s_point_gives_the_direction_back(mu in direction()) {
            for map in MAPS {
                let st = map.to_square(mu);
                prop_assert!(st.clamp(DVec2::ZERO, DVec2::ONE) == st, "{map:?}: {st}");
                // Near the horizon μz is a root of the concentric radius.
                let back = map.to_direction(st);
                prop_assert!((back - mu).length() < 1e-14 / mu.z.max(1e-8), "{map:?}: {back} {mu}");
                prop_assert!(back.is_normalized());
            }
        }

        /// |∂(μx, μy)/∂(s, t)| is cosθ dω / ds dt wherever the map has a derivative.
        #[test]
        fn the_jacobian_is_the_constant_promised(s in 0.02..0.98f64, t in 0.02..0.98f64) {
            const H: f64 = 1e-6;
            for map in MAPS {
                let at = |s: f64, t: f64| map.to_direction(DVec2::new(s, t));
                let diagonal = ((s - 0.5).abs() - (t - 0.5).abs()).abs() < 4.0 * H;
                prop_assume!(map == DirectionMap::EqualArea || !diagonal);
                let d = |a: f64, b: f64| {
                    (at(s + a, t + b) - at(s - a, t - b)).truncate() / (2.0 * H)
                };
                let jacobian = d(H, 0.0).perp_dot(d(0.0, H));
                let z = at(s, t).z;
                let expected = match map {
                    DirectionMap::Concentric => PI,
                    DirectionMap::EqualArea => 8.0 * z,
                };
                prop_assert!((jacobian - expected).abs() < 1e-7, "{map:?}: {jacobian} {expected}");
                let measure = map.projected_measure(DVec2::new(s, t));
                prop_assert!((measure - expected.max(0.0)).abs() < 1e-12, "{measure}");
            }
        }

        /// Nearby points are nearby directions, across diagonals, axes and centre.
        #[test]
        fn both_maps_are_continuous(s in 0.0..1.0f64, t in 0.0..1.0f64, phi in 0.0..2.0 * PI) {
            const STEP: f64 = 1e-7;
            let from = [DVec2::new(s, t), DVec2::splat(s), DVec2::new(0.5, t), DVec2::splat(0.5)];
            for map in MAPS {
                // Below the horizon it goes on, until all around one corner are one point.
                let above = |st: &DVec2| map.to_direction(*st).z >= 0.0;
                for st in from.into_iter().filter(above) {
                    let to = (st + STEP * DVec2::from_angle(phi)).clamp(DVec2::ZERO, DVec2::ONE);
                    let moved = (map.to_direction(to) - map.to_direction(st)).truncate().length();
                    // The maps stretch by √2 · π/2 · 2 at most, in the plane.
                    prop_assert!(moved < 4.5 * STEP, "{map:?} at {st}: {moved}");
                }
            }
        }
    }

    #[test]
    fn cells_of_the_hemisphere_are_told_from_corners() {
        let map = DirectionMap::EqualArea;
        let side = 16;
        for i in 0..side * side {
            let low = DVec2::new(f64::from(i % side), f64::from(i / side)) / f64::from(side);
            let width = 1.0 / f64::from(side);
            let samples = (0..400).map(|k| {
                low + width * DVec2::new(f64::from(k % 20) + 0.5, f64::from(k / 20) + 0.5) / 20.0
            });
            let above = samples.filter(|st| map.to_direction(*st).z > 0.0).count();
            assert_eq!(above > 0, map.has_directions(low, width), "{low}");
        }
    }

    /// ∫ cosθ dω = π over either map.
    #[test]
    fn the_projected_measure_of_the_square_is_pi() {
        const N: u32 = 400;
        for map in MAPS {
            let at = |i: u32| (f64::from(i) + 0.5) / f64::from(N);
            let sum: f64 =
                (0..N * N).map(|i| map.projected_measure(DVec2::new(at(i % N), at(i / N)))).sum();
            let mean = sum / f64::from(N * N);
            assert!((mean - PI).abs() < 1e-4, "{map:?}: {mean}");
        }
    }
}
