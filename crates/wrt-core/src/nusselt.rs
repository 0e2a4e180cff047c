//! Nusselt coordinates: directions of a hemisphere as points of the unit square
//! (§3, Eq. 2–5).

use glam::{DVec2, DVec3};

/// A direction of the upper hemisphere, as a point (κ, λ) of the unit square.
///
/// The hemisphere fills the *unit directional circle* (UDC), the disc of radius
/// ½ about (½, ½); the square's corners are no direction at all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nusselt {
    /// κ = (μx + 1) / 2.
    pub kappa: f64,
    /// λ = (μy + 1) / 2.
    pub lambda: f64,
}

impl Nusselt {
    /// dω cos θ per dκ dλ: the constant "4" of Eq. 5.
    pub const MEASURE: f64 = 4.0;

    /// The coordinates of a unit `direction` in the surface's frame (z is the
    /// normal), or `None` if it points below the surface.
    ///
    /// (κ, λ) = ((μx + 1) / 2, (μy + 1) / 2), Eq. 3.
    ///
    /// ```
    /// use glam::DVec3;
    /// use wrt_core::Nusselt;
    ///
    /// let normal = Nusselt::from_direction(DVec3::Z).unwrap();
    /// assert_eq!((normal.kappa, normal.lambda), (0.5, 0.5));
    /// assert_eq!(Nusselt::from_direction(-DVec3::Z), None);
    /// ```
    #[must_use]
    pub fn from_direction(direction: DVec3) -> Option<Self> {
        debug_assert!(direction.is_normalized(), "not a unit vector: {direction}");
        let q = 0.5 * (direction.truncate() + DVec2::ONE);
        (direction.z >= 0.0).then_some(Self { kappa: q.x, lambda: q.y })
    }

    /// The unit direction in the surface's frame, or `None` outside the UDC.
    ///
    /// μz = √(1 − μx² − μy²); the hemisphere decides the root's sign (§3).
    #[must_use]
    pub fn to_direction(self) -> Option<DVec3> {
        let mu = 2.0 * DVec2::new(self.kappa, self.lambda) - DVec2::ONE;
        let mu_z_squared = 1.0 - mu.length_squared();
        (mu_z_squared >= 0.0).then(|| mu.extend(mu_z_squared.sqrt()))
    }
}

/// The part of a rectangle [κ₀, κ₁] × [λ₀, λ₁] of Nusselt coordinates that lies
/// inside the UDC, as a fraction of the rectangle; in closed form.
#[must_use]
pub fn udc_fraction(low: [f64; 2], high: [f64; 2]) -> f64 {
    let area = (high[0] - low[0]) * (high[1] - low[1]);
    let [x0, y0, x1, y1] = [low[0], low[1], high[0], high[1]].map(|q| 2.0 * q - 1.0);
    let inside = quadrant(x1, y1) - quadrant(x0, y1) - quadrant(x1, y0) + quadrant(x0, y0);
    (0.25 * inside / area).clamp(0.0, 1.0)
}

/// Signed area of the unit disc over [0, x] × [0, y]: odd in x and in y.
fn quadrant(x: f64, y: f64) -> f64 {
    let (a, b) = (x.abs().min(1.0), y.abs().min(1.0));
    // ∫ √(1 − t²) dt
    let arc = |t: f64| 0.5 * (t * (1.0 - t * t).max(0.0).sqrt() + t.asin());
    // The disc's edge is above b until `turn`, then below it.
    let turn = (1.0 - b * b).max(0.0).sqrt();
    let area = if a <= turn { a * b } else { turn * b + arc(a) - arc(turn) };
    area * x.signum() * y.signum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    /// E = 4 ∬ L dκ dλ = π L for uniform L: the UDC's area, π/4, times four.
    #[test]
    fn uniform_radiance_gives_irradiance_pi() {
        const N: u32 = 1000;
        let cell = 1.0 / f64::from(N);
        let centre = |i: u32| (f64::from(i) + 0.5) * cell;
        let inside = (0..N * N)
            .filter(|i| {
                let q = Nusselt { kappa: centre(i % N), lambda: centre(i / N) };
                q.to_direction().is_some()
            })
            .count();
        let irradiance = Nusselt::MEASURE * inside as f64 * cell * cell;
        // The circle crosses O(N) of the N² cells, each of area 1/N².
        let tolerance = Nusselt::MEASURE * PI * cell;
        assert!((irradiance - PI).abs() < tolerance, "{irradiance}");
    }

    /// ∬ cosθ sinθ dθ dφ over a spherical patch = 4 × its area in (κ, λ).
    #[test]
    fn cosine_weighted_solid_angle_is_four_times_the_nusselt_area() {
        // The ring θ ∈ [a, b]: ∫ cosθ dω = π (sin²b − sin²a).
        let (a, b) = (0.3_f64, 1.1_f64);
        const N: u32 = 2000;
        let centre = |i: u32| (f64::from(i) + 0.5) / f64::from(N);
        let area = (0..N * N)
            .filter_map(|i| Nusselt { kappa: centre(i % N), lambda: centre(i / N) }.to_direction())
            .filter(|mu| (b.cos()..a.cos()).contains(&mu.z))
            .count() as f64
            / f64::from(N * N);
        let expected = PI * (b.sin().powi(2) - a.sin().powi(2));
        assert!((4.0 * area - expected).abs() < 4.0 * PI * 2.0 / f64::from(N), "{area}");
    }

    #[test]
    fn fraction_of_the_whole_square_is_pi_over_four() {
        assert!((udc_fraction([0.0; 2], [1.0; 2]) - PI / 4.0).abs() < 1e-15, "closed form");
    }

    proptest! {
        /// Splitting a rectangle does not change the disc's area in it.
        #[test]
        fn fractions_add_up(x in 0.01..0.99f64, y in 0.01..0.99f64) {
            let part = |a: [f64; 2], b: [f64; 2]| {
                udc_fraction(a, b) * (b[0] - a[0]) * (b[1] - a[1])
            };
            let sum = part([0.0, 0.0], [x, y]) + part([x, 0.0], [1.0, y])
                + part([0.0, y], [x, 1.0]) + part([x, y], [1.0, 1.0]);
            prop_assert!((sum - PI / 4.0).abs() < 1e-14);
        }

        #[test]
        fn direction_round_trip(x in -0.7..0.7f64, y in -0.7..0.7f64) {
            let mu = DVec3::new(x, y, (1.0 - x * x - y * y).sqrt());
            let back = Nusselt::from_direction(mu).and_then(Nusselt::to_direction);
            prop_assert!(back.is_some_and(|b| (b - mu).length() < 1e-14));
        }
    }
}
