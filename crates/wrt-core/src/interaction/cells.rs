//! Direction cells as samples and as cones of directions.

use glam::{DVec2, DVec3};

/// A cell of (κ, λ), or of a block of them, inside the UDC.
#[derive(Clone, Debug)]
pub(super) struct DirectionCell {
    /// Midpoints of equal parts; none outside the UDC.
    pub(super) directions: Vec<DVec3>,
    /// A direction within the cell and the greatest angle to any other, in radians.
    centre: DVec3,
    radius: f64,
    /// Angle across a side, in radians; large at the rim.
    pub(super) diameter: f64,
    /// 4 Δκ Δλ of the whole cell.
    pub(super) weight: f64,
    /// Its lowest cosines (μx, μy).
    low: DVec2,
}

/// The cells of a level, κ fastest, with `points(diameter)`² samples in each.
pub(super) fn cells(level: u8, points: impl Fn(f64) -> u32) -> Vec<DirectionCell> {
    let side = 1_u32 << level;
    let width = 2.0 / f64::from(side);
    let cell = |k: u32, l: u32| {
        let low = DVec2::new(f64::from(k), f64::from(l)) * width - 1.0;
        let corners = boundary(low, width);
        let centre = corners.iter().sum::<DVec3>().normalize_or_zero();
        let radius = corners.iter().map(|d| d.angle_between(centre)).fold(0.0, f64::max);
        let diameter = std::f64::consts::SQRT_2 * radius;
        let points = points(diameter);
        let mut directions: Vec<DVec3> = midpoints(low, width, points).collect();
        // A rim cell whose samples all miss still needs one.
        if directions.is_empty() && !corners.is_empty() {
            directions.push(centre);
        }
        DirectionCell { directions, centre, radius, diameter, weight: width * width, low }
    };
    (0..side).flat_map(|l| (0..side).map(move |k| (k, l))).map(|(k, l)| cell(k, l)).collect()
}

fn midpoints(low: DVec2, width: f64, points: u32) -> impl Iterator<Item = DVec3> {
    let at = move |i: u32| (f64::from(i) + 0.5) * width / f64::from(points);
    (0..points * points).filter_map(move |i| lift(low + DVec2::new(at(i % points), at(i / points))))
}

/// The direction of cosines μ inside the UDC.
fn lift(mu: DVec2) -> Option<DVec3> {
    let height = 1.0 - mu.length_squared();
    (height > 0.0).then(|| mu.extend(height.sqrt()))
}

/// Directions on a lattice over a cell's part inside the UDC, its edge and the rim
/// included; none if the two do not meet.
fn boundary(low: DVec2, width: f64) -> Vec<DVec3> {
    const STEPS: u32 = 4;
    let inside = |mu: DVec2| {
        let high = low + width;
        (mu.cmpge(low) & mu.cmple(high)).all()
    };
    let at = |i: u32| f64::from(i) / f64::from(STEPS) * width;
    let lattice = (0..=STEPS)
        .flat_map(|i| (0..=STEPS).map(move |j| (i, j)))
        .filter_map(|(i, j)| lift(low + DVec2::new(at(i), at(j))));
    let rim = (0..=STEPS).flat_map(|i| {
        let mu = low + at(i);
        let root = |x: f64| (1.0 - x * x).max(0.0).sqrt();
        let (x, y) = (root(mu.y), root(mu.x));
        [DVec2::new(x, mu.y), DVec2::new(-x, mu.y), DVec2::new(mu.x, y), DVec2::new(mu.x, -y)]
    });
    let rim = rim.filter(|&mu| inside(mu) && mu.length_squared() <= 1.0 + 1e-12);
    let mut all: Vec<DVec3> = lattice.collect();
    if !all.is_empty() {
        all.extend(rim.map(|mu| mu.extend(0.0).normalize()));
    }
    all
}

impl DirectionCell {
    /// Whether no direction lies in it.
    pub(super) fn is_empty(&self) -> bool {
        self.directions.is_empty()
    }

    /// The mean over the cell of a function of the cosine to the normal.
    pub(super) fn mean(&self, value: impl Fn(f64) -> f64) -> f64 {
        const POINTS: u32 = 8;
        let (sum, count) = midpoints(self.low, self.weight.sqrt(), POINTS)
            .fold((0.0, 0), |(sum, count), d| (sum + value(d.z), count + 1));
        if count == 0 { value(self.centre.z) } else { sum / f64::from(count) }
    }

    /// Bounds of the angle between the mirror image of a direction of `incident` and
    /// one of this cell, in radians.
    pub(super) fn mirror_angle(&self, incident: &Self) -> (f64, f64) {
        let mirrored = DVec3::new(-incident.centre.x, -incident.centre.y, incident.centre.z);
        let angle = mirrored.angle_between(self.centre);
        let reach = self.radius + incident.radius;
        ((angle - reach).max(0.0), (angle + reach).min(std::f64::consts::PI))
    }
}
