//! Sets of directions: from where a surface is looked at.

use crate::DirectionMap;
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, SQRT_2};

/// Cells along a side of the square.
const SIDE: usize = 128;

/// Directions on the square of a [`DirectionMap`], told apart in cells of 1/128 of its
/// side: of one that a cone touches, all are in the set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ViewSet {
    /// From t = 0 to 1; bit i of each is the i-th cell of s.
    rows: Vec<u128>,
}

impl Default for ViewSet {
    fn default() -> Self {
        Self::none()
    }
}

impl ViewSet {
    /// No direction.
    #[must_use]
    pub fn none() -> Self {
        Self { rows: vec![0; SIDE] }
    }

    /// Adds the directions within `angle` radians of the unit vector `axis`, and a few
    /// more. An axis below the horizon counts as the nearest on it.
    pub fn add_cone(&mut self, map: DirectionMap, axis: DVec3, angle: f64) {
        let level = axis.truncate().normalize_or_zero().extend(0.0);
        let axis = if axis.z >= 0.0 { axis } else { level };
        let centre = map.to_square(axis) * SIDE as f64;
        let radius = stretch(map, axis, angle) * angle * SIDE as f64;
        let last = SIDE as f64 - 1.0;
        let [first, end] = [-radius, radius].map(|r| (centre.y + r).floor().clamp(0.0, last));
        for row in first as usize..=end as usize {
            // From the row's nearest line to the disc's centre.
            let off = centre.y - centre.y.clamp(row as f64, row as f64 + 1.0);
            let half = (radius * radius - off * off).max(0.0).sqrt();
            let [low, high] = [-half, half].map(|x| (centre.x + x).floor().clamp(0.0, last) as u32);
            self.rows[row] |= mask(low, high);
        }
    }

    /// Adds the directions of `other`.
    pub(super) fn add(&mut self, other: &Self) {
        self.rows.iter_mut().zip(&other.rows).for_each(|(row, other)| *row |= other);
    }

    /// Whether it has no direction.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.iter().all(|row| *row == 0)
    }

    /// Whether the direction at (s, t) of the square is in it.
    #[must_use]
    pub fn contains(&self, st: DVec2) -> bool {
        let [x, y] = [st.x, st.y].map(|x| (x * SIDE as f64).clamp(0.0, SIDE as f64 - 1.0) as usize);
        self.rows[y] >> x & 1 == 1
    }

    /// Whether any direction of the square [low, low + width]² is in it.
    pub(super) fn meets(&self, low: DVec2, width: f64) -> bool {
        let [columns, rows] = spans(low, width);
        let mask = mask(columns.start as u32, columns.end as u32 - 1);
        self.rows[rows].iter().any(|row| row & mask != 0)
    }
}

/// The bits from `low` to `high`.
fn mask(low: u32, high: u32) -> u128 {
    (u128::MAX >> (127 - high)) & (u128::MAX << low)
}

/// The columns and the rows of cells in [low, low + width]², one of each at least.
fn spans(low: DVec2, width: f64) -> [std::ops::Range<usize>; 2] {
    [low.x, low.y].map(|low| {
        let [first, end] = [low, low + width].map(|x| (x * SIDE as f64) as usize);
        first.min(SIDE - 1)..end.clamp(first.min(SIDE - 1) + 1, SIDE)
    })
}

/// The most that (s, t) move per radian within `angle` of `axis`.
fn stretch(map: DirectionMap, axis: DVec3, angle: f64) -> f64 {
    match map {
        // Of the disc 1 at most, across, and of its square √3.1 at the diagonals.
        DirectionMap::Concentric => 0.5 * 1.77,
        // Across: √2 sin(θ/2)/sinθ = 1/(√2 cos(θ/2)) in the plane.
        DirectionMap::EqualArea => {
            let theta = (axis.z.clamp(-1.0, 1.0).acos() + angle).min(FRAC_PI_2);
            0.5 / (SQRT_2 * (0.5 * theta).cos())
        }
    }
}

/// Of how much of the positions of a cell each direction is looked from.
pub(super) struct ViewShare {
    /// 0 to 1 per cell of direction, s fastest; negative where it has no direction of
    /// the hemisphere.
    cells: Vec<f32>,
}

impl ViewShare {
    /// Of positions with weights of sum 1.
    pub(super) fn new<'a>(
        map: DirectionMap,
        sets: impl IntoIterator<Item = (&'a ViewSet, f64)>,
    ) -> Self {
        let width = 1.0 / SIDE as f64;
        let low = |i: usize| DVec2::new((i % SIDE) as f64, (i / SIDE) as f64) * width;
        let inside = |i| map.has_directions(low(i), width);
        let start = |i| if inside(i) { 0.0 } else { -1.0 };
        let mut cells: Vec<f32> = (0..SIDE * SIDE).map(start).collect();
        for (set, weight) in sets {
            for (row, cells) in set.rows.iter().zip(cells.chunks_exact_mut(SIDE)) {
                let mut left = *row;
                while left != 0 {
                    let column = left.trailing_zeros() as usize;
                    if cells[column] >= 0.0 {
                        cells[column] += weight as f32;
                    }
                    left &= left - 1;
                }
            }
        }
        Self { cells }
    }

    /// The mean over the directions in [low, low + width]²; 0 if there are none.
    pub(super) fn mean(&self, low: DVec2, width: f64) -> f64 {
        let [columns, rows] = spans(low, width);
        let (mut sum, mut count) = (0.0, 0_u32);
        for row in rows {
            for &share in &self.cells[row * SIDE..][columns.clone()] {
                if share >= 0.0 {
                    sum += f64::from(share);
                    count += 1;
                }
            }
        }
        sum / f64::from(count.max(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    fn direction(z: f64, phi: f64) -> DVec3 {
        let sine = (1.0 - z * z).sqrt();
        DVec3::new(sine * phi.cos(), sine * phi.sin(), z)
    }

    /// `angle` away from `axis`.
    fn aside(axis: DVec3, angle: f64, turn: f64) -> DVec3 {
        let (x, y) = axis.any_orthonormal_pair();
        axis * angle.cos() + (x * turn.cos() + y * turn.sin()) * angle.sin()
    }

    proptest! {
        #[test]
        fn a_cone_has_all_its_directions(
            z in -0.3..1.0f64, phi in 0.0..TAU, angle in 0.0..1.2f64,
            off in 0.0..1.0f64, turn in 0.0..TAU,
        ) {
            let axis = direction(z, phi);
            let mu = aside(axis, off * angle, turn);
            prop_assume!(mu.z >= 0.0);
            for map in [DirectionMap::EqualArea, DirectionMap::Concentric] {
                let mut set = ViewSet::none();
                set.add_cone(map, axis, angle);
                let st = map.to_square(mu);
                prop_assert!(set.contains(st), "{map:?} {st}");
                prop_assert!(set.meets((st * 8.0).floor().min(DVec2::splat(7.0)) / 8.0, 0.125), "{st}");
            }
        }

        /// Twice the angle and a cell away it is over.
        #[test]
        fn a_cone_has_few_others(
            z in 0.0..1.0f64, phi in 0.0..TAU, angle in 0.02..0.3f64, turn in 0.0..TAU,
        ) {
            let axis = direction(z, phi);
            let mu = aside(axis, 2.0 * angle + 0.05, turn);
            prop_assume!(mu.z >= 0.0);
            let map = DirectionMap::EqualArea;
            let mut set = ViewSet::none();
            set.add_cone(map, axis, angle);
            prop_assert!(!set.contains(map.to_square(mu)), "{mu}");
        }
    }

    #[test]
    fn shares_are_means_over_positions_and_directions() {
        let map = DirectionMap::EqualArea;
        let (mut all, none) = (ViewSet::none(), ViewSet::none());
        all.add_cone(map, DVec3::Z, FRAC_PI_2);
        let share = ViewShare::new(map, [(&all, 0.25), (&none, 0.75)]);
        for (low, width) in [(DVec2::ZERO, 1.0), (DVec2::splat(0.5), 0.25), (DVec2::ZERO, 0.25)] {
            assert!((share.mean(low, width) - 0.25).abs() < 1e-6, "{low} {width}");
        }
        // Finer than the set's own cells, and where there is no direction at all.
        assert!((share.mean(DVec2::splat(0.5), 1.0 / 512.0) - 0.25).abs() < 1e-6, "a part");
        assert_eq!(share.mean(DVec2::ZERO, 0.125), 0.0);
        assert!(none.is_empty() && !all.is_empty() && !none.meets(DVec2::ZERO, 1.0), "empty");
    }
}
