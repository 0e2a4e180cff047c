//! How likely a bit is, learnt from the bits before it: predictions from several
//! contexts, mixed in the logistic domain (M. Mahoney, *Adaptive weighing of
//! context models for lossless data compression*, Florida Tech. CS-2005-16, 2005).
//!
//! All in integers, so that every machine reads what any has written.

use super::range::{Coder, PRECISION};

/// ln(p / (1 − p)) in units of 1/256, for probabilities of 12 bits, and back.
struct Logistic {
    stretch: Vec<i16>,
}

/// The largest magnitude in the logistic domain, just below 8.
const LIMIT: i32 = 2047;

/// 2¹² / (1 + e^(−x/256)), interpolated between steps of ½.
fn squash(x: i32) -> i32 {
    const STEPS: [i32; 33] = [
        1, 2, 3, 6, 10, 16, 27, 45, 73, 120, 194, 310, 488, 747, 1101, 1546, 2047, 2549, 2994,
        3348, 3607, 3785, 3901, 3975, 4022, 4050, 4068, 4079, 4085, 4089, 4092, 4093, 4094,
    ];
    let x = x.clamp(-LIMIT, LIMIT);
    let (step, part) = (((x >> 7) + 16) as usize, x & 127);
    (STEPS[step] * (128 - part) + STEPS[step + 1] * part + 64) >> 7
}

impl Logistic {
    fn new() -> Self {
        // The inverse of `squash`: the least x that reaches each probability.
        let mut stretch = Vec::with_capacity(1 << PRECISION);
        for x in -LIMIT..=LIMIT {
            while (stretch.len() as i32) <= squash(x) {
                stretch.push(x as i16);
            }
        }
        stretch.resize(1 << PRECISION, LIMIT as i16);
        Self { stretch }
    }
}

/// A probability that a bit is 1, of 16 bits, and how many bits it has seen.
#[derive(Clone, Copy)]
struct Estimate {
    one: u16,
    seen: u8,
}

/// Estimates stop adapting more slowly after this many bits: statistics drift
/// from level to level of a tree.
const MEMORY: u8 = 250;

impl Estimate {
    const EVEN: Self = Self { one: 1 << 15, seen: 0 };

    fn learn(&mut self, bit: bool, rates: &[i32]) {
        let target = if bit { 65_535 } else { 0 };
        let one = i32::from(self.one);
        self.one = (one + (((target - one) * rates[usize::from(self.seen)]) >> 15)) as u16;
        self.seen = (self.seen + 1).min(MEMORY);
    }
}

/// A kind of bit, predicted from `N` contexts.
pub(super) struct Model<const N: usize> {
    logistic: Logistic,
    /// 2¹⁵ / (bits seen + 1.5).
    rates: Vec<i32>,
    /// By context.
    estimates: [Vec<Estimate>; N],
    /// By what the mixing goes by; of 16 fractional bits.
    weights: Vec<[i32; N]>,
}

/// How fast weights follow.
const LEARNING: i32 = 6;

impl<const N: usize> Model<N> {
    /// A model whose contexts are numbered below `sizes`, with `mixes` sets of
    /// weights.
    pub(super) fn new(sizes: [usize; N], mixes: usize) -> Self {
        let even = (1 << 16) * 2 / (N as i32 + 2);
        Self {
            logistic: Logistic::new(),
            rates: (0..=i32::from(MEMORY)).map(|n| (2 << 15) / (2 * n + 3)).collect(),
            estimates: sizes.map(|size| vec![Estimate::EVEN; size]),
            weights: vec![[even; N]; mixes],
        }
    }

    /// Codes `bit` in these contexts and learns from it.
    pub(super) fn code(
        &mut self,
        coder: &mut impl Coder,
        contexts: [usize; N],
        mix: usize,
        bit: bool,
    ) -> bool {
        let inputs: [i32; N] = std::array::from_fn(|i| {
            let one = self.estimates[i][contexts[i]].one >> (16 - PRECISION);
            i32::from(self.logistic.stretch[usize::from(one)])
        });
        let weights = &mut self.weights[mix];
        let sum: i64 =
            inputs.iter().zip(&*weights).map(|(&x, &w)| i64::from(x) * i64::from(w)).sum();
        let one = squash((sum >> 16).clamp(-i64::from(LIMIT), i64::from(LIMIT)) as i32);
        let bit = coder.bit(one as u32, bit);
        let error = ((i32::from(bit) << PRECISION) - one) * LEARNING;
        for (weight, x) in weights.iter_mut().zip(inputs) {
            *weight = weight.saturating_add((x * error + (1 << 15)) >> 16);
        }
        for (estimates, at) in self.estimates.iter_mut().zip(contexts) {
            estimates[at].learn(bit, &self.rates);
        }
        bit
    }
}
