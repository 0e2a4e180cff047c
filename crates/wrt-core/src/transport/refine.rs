//! Images of direction cells to a tolerance: midpoint rules refined until two of
//! them agree well enough, or given up where that would take too many midpoints.

use super::directions::Region;
use super::handover::Handover;
use super::slice::{Image, Room, Slices};
use super::source::Source;
use rayon::prelude::*;

/// An image of a direction cell, and what is known of it.
#[derive(Debug)]
pub(super) struct Settling {
    /// Its regions, and how many midpoints there are along each side of one.
    regions: Vec<(Region, [u32; 2])>,
    /// `None` while nothing is seen.
    pub(super) image: Option<Image>,
    /// Sum of squares over positions and channels.
    pub(super) energy: f64,
    /// √ of the sum of squared differences from the rule before.
    difference: f64,
    /// Midpoints along a side, relative to the rule before.
    finer: f64,
    /// By how much the last difference is less than the one before, as a power of h.
    order: Option<f64>,
    /// √ of the energy of the image if all of its directions saw the brightest
    /// texel; 0 if it is proven that none sees anything.
    unseen: f64,
    /// Whether midpoints are given up.
    given_up: bool,
    /// The error that better rules have left.
    left: Option<f64>,
}

/// More midpoints than this are not worth it.
const MOST_SAMPLES: u32 = 1 << 16;

/// From so many on, what more it takes to settle is believed.
const TELLING_SAMPLES: u32 = MOST_SAMPLES / 16;

/// The order p of the rules: their errors fall like h^p. Measured, for it is 1 to 3
/// as kinks and jumps lie along the midpoints, across them, or are not there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Order {
    power: f64,
    /// What estimates are multiplied by: few values may agree by chance.
    doubt: f64,
}

impl Order {
    /// What holds whatever is measured, and what is believed at most: the kinks of
    /// faint positions come in later.
    const RANGE: [f64; 2] = [1.0, 2.75];

    /// The order by which the errors of some of the `cells` fall when each side gets
    /// twice the midpoints once more; these cells keep them.
    pub(super) fn measured(
        cells: &mut [Option<Settling>],
        slices: &Slices<'_, impl Source>,
    ) -> Self {
        const LEAST_PROBES: usize = 24;
        let [least, most] = Self::RANGE;
        let lit = cells.iter().flatten().filter(|cell| cell.energy > 0.0).count();
        // An odd stride meets all rows and columns.
        let stride = (lit / LEAST_PROBES.max(lit / 32)).max(1) | 1;
        let lit: Vec<&mut Settling> =
            cells.iter_mut().flatten().filter(|cell| cell.energy > 0.0).step_by(stride).collect();
        let squares: Vec<(f64, f64, f64)> = lit
            .into_par_iter()
            .map_init(Room::default, |room, cell| {
                let before = cell.difference;
                cell.refine(slices, 2.0, room);
                let values = cell.image.iter().flatten().filter(|rgb| **rgb != [0.0; 3]).count();
                (before * before, cell.difference * cell.difference, values as f64)
            })
            .collect();
        let sum = |part: fn(&(f64, f64, f64)) -> f64| squares.iter().map(part).sum::<f64>();
        let (before, after, values) = (sum(|s| s.0), sum(|s| s.1), sum(|s| s.2));
        let order = if after > 0.0 { 0.5 * (before / after).log2() } else { most };
        let chance = values.max(1.0).sqrt().recip();
        Self { power: ((0.9 - chance) * order).clamp(least, most), doubt: 1.15 + 5.0 * chance }
    }

    /// The order to claim for a cell whose `own` was seen once, if it was.
    fn of(self, own: Option<f64>) -> f64 {
        let [least, most] = Self::RANGE;
        own.map_or(self.power, |own| (0.5 * (self.power + own)).clamp(least, most))
    }
}

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
        let mut settling = Self {
            regions,
            image,
            energy: 0.0,
            difference: 0.0,
            finer: 1.0,
            order: None,
            unseen: 0.0,
            given_up: false,
            left: None,
        };
        if settling.image.is_none() {
            if slices.sees_nothing(direction) {
                return None;
            }
            settling.unseen = slices.brightest();
        }
        settling.refine(slices, 2.0, room);
        Some(settling)
    }

    /// Estimated √ of the sum of squared errors.
    ///
    /// The errors of two rules, the second r times as fine, hardly know of each other
    /// where kinks make them: their difference is √(r^2p + 1) times that of the second.
    /// Where they do, it is r^p − 1 times it. In between lies what is claimed, with a
    /// p between that of all cells and this one's own.
    pub(super) fn error(&self, order: Order) -> f64 {
        if let Some(left) = self.left {
            return left;
        }
        if self.image.is_none() {
            // What all samples miss is less than what one of them would see.
            return self.unseen / f64::from(self.samples());
        }
        let gain = self.finer.powf(order.of(self.order));
        // Rules that differ by as much as they find have no order yet.
        let relative = self.difference / self.energy.sqrt();
        order.doubt * self.difference * (gain - 0.5).recip().max(3.0 * relative).min(1.0)
    }

    /// Refines until the estimated error is at most `target`, or gives up.
    pub(super) fn settle(
        &mut self,
        slices: &Slices<'_, impl Source>,
        target: f64,
        order: Order,
        room: &mut Room,
    ) {
        while self.error(order) > target {
            if self.gives_up(target, order) {
                return;
            }
            self.approach(slices, target, order, room);
        }
    }

    /// Whether midpoints have been given up.
    pub(super) fn given_up(&self) -> bool {
        self.given_up
    }

    /// Gives up if an error of `target` is likely to take more midpoints than are worth it.
    fn gives_up(&mut self, target: f64, order: Order) -> bool {
        let n = self.samples();
        let needed = f64::from(n) * (self.error(order) / target).powf(2.0 / order.power);
        self.given_up |= n >= TELLING_SAMPLES && needed > f64::from(MOST_SAMPLES);
        self.given_up
    }

    /// Takes the image that is made between kinks to an error of `target`, unless the one
    /// from midpoints is nearer.
    pub(super) fn hand_over(
        &mut self,
        handover: &Handover<'_, impl Source>,
        direction: usize,
        target: f64,
        order: Order,
    ) {
        let (image, left) = handover.image(direction, target);
        if left < self.error(order) {
            self.energy = image.as_ref().map_or(0.0, energy);
            self.image = image;
            self.left = Some(left);
        }
    }

    /// Takes as many midpoints as are likely to bring the error down to `target`.
    pub(super) fn approach(
        &mut self,
        slices: &Slices<'_, impl Source>,
        target: f64,
        order: Order,
        room: &mut Room,
    ) {
        let finer = (self.error(order) / target).powf(order.power.recip());
        self.refine(slices, finer.clamp(1.5, 4.0), room);
    }

    /// How many midpoints there are now.
    pub(super) fn samples(&self) -> u32 {
        self.regions.iter().map(|(_, n)| n[0] * n[1]).sum()
    }

    /// Takes `finer` times as many midpoints along each side.
    fn refine(&mut self, slices: &Slices<'_, impl Source>, finer: f64, room: &mut Room) {
        let before = f64::from(self.samples());
        for (_, n) in &mut self.regions {
            *n = n.map(|n| (f64::from(n) * finer).ceil() as u32);
        }
        let image = slices.image(&self.regions, room);
        self.finer = (f64::from(self.samples()) / before).sqrt();
        let sum: f64 = match (&self.image, &image) {
            (None, None) => 0.0,
            (Some(one), None) | (None, Some(one)) => energy(one),
            (Some(a), Some(b)) => {
                a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b) * (a - b)).sum()
            }
        };
        if self.difference > 0.0 && sum > 0.0 {
            let fell = self.difference / sum.sqrt();
            self.order = Some(fell.ln() / self.finer.ln());
        }
        self.difference = sum.sqrt();
        self.energy = image.as_ref().map_or(0.0, energy);
        self.image = image;
    }
}

/// Refines `cells` until the sum of their squared errors, estimated, is within `allowed`
/// of their energy. Those that would take too many midpoints are given up, and their
/// errors do not count, but for the tenth of what is allowed that is left to them.
pub(super) fn settle_all(
    cells: &mut [Option<Settling>],
    slices: &Slices<'_, impl Source>,
    allowed: f64,
    order: Order,
) {
    // A cell that needs fewer midpoints more than this waits: others overshoot.
    const WORTH: f64 = 1.25;
    let mut open: Vec<&mut Settling> = cells.iter_mut().flatten().collect();
    let mut given_up: Vec<&mut Settling> = Vec::new();
    loop {
        let energy: f64 = open.iter().chain(&given_up).map(|cell| cell.energy).sum();
        let share = if given_up.is_empty() { 1.0 } else { 0.9 };
        let total = share * allowed * energy;
        let known: Vec<(f64, f64)> =
            open.iter().map(|cell| (cell.error(order), f64::from(cell.samples()))).collect();
        if known.iter().map(|(error, _)| error * error).sum::<f64>() <= total {
            return;
        }
        let targets = targets(&known, total, order);
        let before = given_up.len();
        let mut wanted = targets.iter().zip(&known);
        given_up.extend(open.extract_if(.., |cell| {
            let (target, (error, _)) = wanted.next().expect("one a cell");
            error > target && cell.gives_up(*target, order)
        }));
        if given_up.len() > before {
            continue;
        }
        let mut due: Vec<(&mut Settling, f64)> = Vec::new();
        for worth in [WORTH, 1.0] {
            let least = worth.powf(order.power);
            let all = open.iter_mut().zip(known.iter().zip(&targets));
            due = all
                .filter(|(_, ((error, _), target))| *error > least * **target)
                .map(|(cell, (_, target))| (&mut **cell, *target))
                .collect();
            if !due.is_empty() {
                break;
            }
        }
        if due.is_empty() {
            return;
        }
        due.into_par_iter().for_each_init(Room::default, |room, (cell, target)| {
            cell.approach(slices, target, order, room);
        });
    }
}

/// The largest errors that cells may have so that the sum of their squares is
/// `total`, for the least work.
///
/// With n midpoints an error is c n^(−p/2), and Lagrange's condition for the least ∑ n
/// makes it ∝ c^(1/(p+1)).
fn targets(cells: &[(f64, f64)], total: f64, order: Order) -> Vec<f64> {
    let p = order.power;
    let constant = |error: f64, n: f64| error * n.powf(0.5 * p);
    let price: Vec<f64> =
        cells.iter().map(|&(error, n)| constant(error, n).powf((p + 1.0).recip())).collect();
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
        let targets = targets(&cells, 1e-4, Order { power: 2.0, doubt: 1.0 });
        let sum: f64 = cells.iter().zip(&targets).map(|((e, _), t)| e.min(*t).powi(2)).sum();
        assert!((sum / 1e-4 - 1.0).abs() < 1e-6, "{sum}");
        assert!(targets[2] > 1e-6 && targets[1] < targets[0], "{targets:?}");
    }
}
