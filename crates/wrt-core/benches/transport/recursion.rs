//! What the paper's recursion costs, and how far it is off, at levels that it would
//! take hours for: measured on a random sample of its work.
//!
//! The recursion (§7.2.4) integrates each pair of a finest destination cell and a
//! finest lit source cell once, unless the oracle settles the pair or one of its
//! ancestors. So the sum over *all* destination cells of the time that the pairs of
//! each take is a lower bound on its cost: questions to the oracle, wavelets and the
//! tree are left out. The mean over cells drawn evenly (seeded) estimates it without
//! bias, with a standard error. RED on the same cells is against `exact`; source
//! radiance is the same on both sides.

use cpu_time::ProcessTime;
use glam::{DVec2, DVec3};
use wrt_core::transport::{
    Exact, Integrator, Method, Pair, Support, TransportGeometry, Verdict, oracle,
};
use wrt_core::{Emission, Nusselt};

/// A destination cell and the source cells that it sees any of.
struct Seen {
    dest: Support,
    /// Radiance of each, and whether the recursion integrates the pair: if not, the
    /// oracle has proven that all rays come from there.
    sources: Vec<(Support, [f64; 3], bool)>,
    /// Mean radiance, by exact integrals.
    reference: [f64; 3],
}

/// Cells of one level of one geometry, drawn at random, with their true radiance.
pub(super) struct Sample<'a> {
    geometry: &'a TransportGeometry,
    cells: Vec<Seen>,
    /// All cells, of which these are some.
    population: f64,
    /// CPU seconds of the exact reference, per cell of the sample.
    exact: Vec<f64>,
}

/// A mean per cell times the number of cells, and its standard error.
#[derive(Clone, Copy)]
pub(super) struct Total {
    pub(super) value: f64,
    pub(super) standard_error: f64,
}

impl Total {
    fn of(each: &[f64], population: f64) -> Self {
        let n = each.len() as f64;
        let mean = each.iter().sum::<f64>() / n;
        let variance = each.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let standard_error = (variance / n).sqrt() * population;
        Self { value: mean * population, standard_error }
    }

    /// What is exceeded with a probability of 97.5 %.
    pub(super) fn at_least(&self) -> f64 {
        self.value - 1.96 * self.standard_error
    }
}

/// Xorshift of 64 bits (G. Marsaglia, *Xorshift RNGs*, 2003).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }
}

impl<'a> Sample<'a> {
    /// `count` destination cells of `level` that see some lit source cell, and as
    /// many dark ones as are met on the way.
    pub(super) fn draw(
        geometry: &'a TransportGeometry,
        source: &Emission,
        level: u8,
        count: usize,
        tolerance: f64,
    ) -> Self {
        let mut random = Random(0x9e37_79b9_7f4a_7c15 ^ u64::from(level));
        let (mut cells, mut exact, mut lit) = (Vec::new(), Vec::new(), 0);
        let rule = Exact { tolerance };
        while lit < count {
            let bits = random.next();
            let side = (1_u16 << level) - 1;
            let m = std::array::from_fn(|d| (bits >> (13 * d + 7)) as u16 & side);
            let dest = Support::isotropic(level, m);
            let mut seen = Seen { dest, sources: Vec::new(), reference: [0.0; 3] };
            let clock = ProcessTime::now();
            see(geometry, source, Support::isotropic(0, [0; 4]), &mut seen, level);
            lit += usize::from(!seen.sources.is_empty());
            seen.reference = seen.radiance(geometry, &rule).0;
            exact.push(clock.elapsed().as_secs_f64());
            cells.push(seen);
        }
        Self { geometry, cells, population: 16.0_f64.powi(i32::from(level)), exact }
    }

    /// How many cells were drawn.
    pub(super) fn len(&self) -> usize {
        self.cells.len()
    }

    /// What `exact` would take for all cells.
    pub(super) fn exact(&self) -> Total {
        Total::of(&self.exact, self.population)
    }

    /// RED of `rule` over every `stride`-th cell from `first` on, the CPU seconds that
    /// its integrals take over all cells, and how many they are.
    pub(super) fn measure(&self, rule: &Method, first: usize, stride: usize) -> (f64, Total, f64) {
        let (mut difference, mut size, mut integrals) = (0.0, 0.0, 0);
        let mut seconds = Vec::new();
        for seen in self.cells.iter().skip(first).step_by(stride) {
            let clock = ProcessTime::now();
            let (found, count) = seen.radiance(self.geometry, rule);
            seconds.push(clock.elapsed().as_secs_f64());
            integrals += count;
            for (found, expected) in found.iter().zip(seen.reference) {
                difference += (found - expected).powi(2);
                size += expected * expected;
            }
        }
        let integrals = integrals as f64 / seconds.len() as f64 * self.population;
        ((difference / size).sqrt(), Total::of(&seconds, self.population), integrals)
    }
}

impl Seen {
    /// Mean radiance over the cell and how many pairs were integrated.
    fn radiance(&self, geometry: &TransportGeometry, rule: &dyn Integrator) -> ([f64; 3], u64) {
        let (mut sum, mut count) = ([0.0; 3], 0);
        for (j, radiance, integrated) in &self.sources {
            let share = if *integrated {
                count += 1;
                let t = rule.integrate(&Pair::new(geometry, *j, self.dest)).value;
                t * self.dest.scale() / j.scale()
            } else {
                1.0
            };
            sum = std::array::from_fn(|c| sum[c] + share * radiance[c]);
        }
        (sum, count)
    }
}

/// Adds the cells of the finest level within `j` that `seen` may see and that are lit.
fn see(geometry: &TransportGeometry, source: &Emission, j: Support, seen: &mut Seen, finest: u8) {
    let verdict = oracle(&Pair::new(geometry, j, seen.dest));
    if verdict == Verdict::Zero {
        return;
    }
    let level = j.levels.position;
    if level < finest {
        for m_prime in 0..16 {
            let m = std::array::from_fn(|d| 2 * j.m[d] + (m_prime >> d & 1));
            see(geometry, source, Support::isotropic(level + 1, m), seen, finest);
        }
        return;
    }
    let radiance = radiance(source, j);
    if radiance == [0.0; 3] {
        return;
    }
    // The recursion stops above, too, where an ancestor settles it.
    let above = (0..finest).map(|depth| {
        let up = seen.dest.m.map(|m| m >> (finest - depth));
        oracle(&Pair::new(geometry, j, Support::isotropic(depth, up)))
    });
    match above.chain([verdict]).find(|verdict| *verdict != Verdict::Unknown) {
        Some(Verdict::Zero) => {}
        Some(_) => seen.sources.push((j, radiance, false)),
        None => seen.sources.push((j, radiance, true)),
    }
}

/// Mean radiance of a source cell: its texel times the mean of the lobe.
fn radiance(source: &Emission, j: Support) -> [f64; 3] {
    const SIDE: u32 = 8;
    let position = usize::from(j.m[1]) << source.level() | usize::from(j.m[0]);
    let texel = source.picture()[position];
    let [low, high] = j.cosines();
    let lobe = source.lobe();
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(SIDE);
    let directions = (0..SIDE * SIDE).filter_map(|i| {
        let mu = low + (high - low) * DVec2::new(at(i % SIDE), at(i / SIDE));
        let q = 0.5 * (mu + 1.0);
        Nusselt { kappa: q.x, lambda: q.y }.to_direction()
    });
    let mean = directions.map(|mu: DVec3| lobe.eval(mu)).sum::<f64>() / f64::from(SIDE * SIDE);
    texel.map(|x| f64::from(x) * mean)
}
