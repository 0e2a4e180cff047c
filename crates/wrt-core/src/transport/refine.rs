//! Images of direction cells to a tolerance: midpoint rules refined until two of
//! them agree well enough.

use super::block::Source;
use super::directions::Region;
use super::slice::{Image, Room, Slices};

/// An image of a direction cell, and what is known of it.
#[derive(Debug)]
pub(super) struct Settling {
    /// Its regions, and how many midpoints there are along each side of one.
    regions: Vec<(Region, [u32; 2])>,
    /// `None` while nothing is seen.
    pub(super) image: Option<Image>,
    /// Sum of squares over positions and channels.
    pub(super) energy: f64,
    /// Estimated √ of the sum of squared errors.
    pub(super) error: f64,
    /// √ of the energy of the image if all of its directions saw the brightest
    /// texel; 0 if it is proven that none sees anything.
    unseen: f64,
}

/// Where refinement ends: the estimate then says what is left.
const MOST_SAMPLES: u32 = 1 << 16;

impl Settling {
    /// The image of a direction cell (κ fastest) from two rules, the second twice as
    /// fine; `None` if the cell is blind.
    pub(super) fn begin(
        slices: &Slices<'_, impl Source>,
        direction: usize,
        room: &mut Room,
    ) -> Option<Self> {
        // Midpoints per texel that a footprint moves: half of what most tolerances
        // turn out to need, so that the first rule costs little.
        const DENSITY: f64 = 0.5;
        let count = |texels: f64| (DENSITY * texels).ceil().clamp(3.0, 8.0) as u32;
        let regions = slices.regions(direction).into_iter();
        let regions = regions.map(|region| (region, slices.travel(&region).map(count)));
        let regions: Vec<(Region, [u32; 2])> = regions.collect();
        if regions.is_empty() {
            return None;
        }
        let image = slices.image(&regions, room);
        let mut settling = Self { regions, image, energy: 0.0, error: 0.0, unseen: 0.0 };
        if settling.image.is_none() {
            if slices.is_blind(direction) {
                return None;
            }
            settling.unseen = slices.brightest();
        }
        settling.refine(slices, 2.0, room);
        Some(settling)
    }

    /// Refines until the estimated error is at most `target`.
    pub(super) fn settle(
        &mut self,
        slices: &Slices<'_, impl Source>,
        target: f64,
        room: &mut Room,
    ) {
        // Errors fall with the square of the midpoints along a side, or nearly.
        while self.error > target && self.samples() < MOST_SAMPLES {
            let finer = (self.error / target).powf(0.45);
            self.refine(slices, finer.clamp(1.4, 4.0), room);
        }
    }

    /// How many midpoints there are now.
    pub(super) fn samples(&self) -> u32 {
        self.regions.iter().map(|(_, n)| n[0] * n[1]).sum()
    }

    /// Takes `finer` times as many midpoints along each side.
    ///
    /// If errors fall like h^p, two rules with h₁ > h₂ differ by (ρ⁻¹ − 1) times the
    /// error of the second, ρ = (h₂/h₁)^p. With kinks p is 2 to 3, as they lie along
    /// the grid or across it; jumps between the cells of a source leave 1 to 3/2. The
    /// lower figures are claimed.
    fn refine(&mut self, slices: &Slices<'_, impl Source>, finer: f64, room: &mut Room) {
        let power = if slices.source().is_continuous() { 2.0 } else { 1.0 };
        let before = f64::from(self.samples());
        for (_, n) in &mut self.regions {
            *n = n.map(|n| (f64::from(n) * finer).ceil() as u32);
        }
        let image = slices.image(&self.regions, room);
        let coarser = (before / f64::from(self.samples())).sqrt();
        let rho = coarser.powf(power);
        let sum: f64 = match (&self.image, &image) {
            (None, None) => 0.0,
            (Some(one), None) | (None, Some(one)) => energy(one),
            (Some(a), Some(b)) => {
                a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b) * (a - b)).sum()
            }
        };
        let difference = sum.sqrt();
        self.error = match &image {
            // What all samples miss is less than what one of them would see.
            None => self.unseen / f64::from(self.samples()),
            // Rules that differ by as much as they find have no order yet.
            Some(image) => {
                let relative = difference / energy(image).sqrt();
                difference * (rho / (1.0 - rho)).max((3.0 * relative).min(1.0))
            }
        };
        self.energy = image.as_ref().map_or(0.0, energy);
        self.image = image;
    }
}

/// The largest errors that cells may have so that the sum of their squares is
/// `total`, for the least work: ∝ (error × midpoints)^⅓, where error × midpoints
/// stays as it is while a cell is refined (Lagrange's condition for ∑ midpoints).
pub(super) fn targets(cells: &[(f64, f64)], total: f64) -> Vec<f64> {
    let price: Vec<f64> = cells.iter().map(|(error, n)| (error * n).cbrt()).collect();
    let capped = |factor: f64| {
        let all = cells.iter().zip(&price);
        all.map(|((error, _), price)| error.min(factor * price).powi(2)).sum::<f64>()
    };
    let most = cells.iter().zip(&price).map(|((e, _), p)| if *p > 0.0 { e / p } else { 0.0 });
    let (mut low, mut high) = (0.0, most.fold(0.0, f64::max));
    if capped(high) > total {
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if capped(middle) > total { high = middle } else { low = middle }
        }
        high = low;
    }
    price.iter().map(|price| high * price).collect()
}

fn energy(image: &Image) -> f64 {
    image.iter().flatten().map(|x| x * x).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_meet_the_total_and_leave_good_cells_alone() {
        let cells = [(1.0, 16.0), (0.1, 16.0), (1e-6, 16.0)];
        let targets = targets(&cells, 1e-4);
        let sum: f64 = cells.iter().zip(&targets).map(|((e, _), t)| e.min(*t).powi(2)).sum();
        assert!((sum / 1e-4 - 1.0).abs() < 1e-6, "{sum}");
        assert!(targets[2] > 1e-6 && targets[1] < targets[0], "{targets:?}");
    }
}
