//! How likely a bit is, learnt from the bits before it: predictions from several
//! contexts, mixed in the logistic domain (M. Mahoney, *Adaptive weighing of
//! context models for lossless data compression*, Florida Tech. CS-2005-16, 2005).
//!
//! All in integers, so that every machine reads what any has written.

use super::range::{Coder, PRECISION};

/// The largest magnitude in the logistic domain, just below 8.
const LIMIT: i32 = 2047;

/// 2¹² / (1 + e^(−x/256)), interpolated between steps of ½.
const fn squash(x: i32) -> i32 {
    const STEPS: [i32; 33] = [
        1, 2, 3, 6, 10, 16, 27, 45, 73, 120, 194, 310, 488, 747, 1101, 1546, 2047, 2549, 2994,
        3348, 3607, 3785, 3901, 3975, 4022, 4050, 4068, 4079, 4085, 4089, 4092, 4093, 4094,
    ];
    debug_assert!(-LIMIT <= x && x <= LIMIT, "within the logistic domain");
    let (step, part) = (((x >> 7) + 16) as usize, x & 127);
    (STEPS[step] * (128 - part) + STEPS[step + 1] * part + 64) >> 7
}

/// ln(p / (1 − p)) in units of 1/256, for probabilities of 12 bits: the inverse of
/// [`squash`], the least x that reaches each probability.
static STRETCH: [i16; 1 << PRECISION] = {
    let mut stretch = [LIMIT as i16; 1 << PRECISION];
    let (mut x, mut next) = (-LIMIT, 0);
    while x <= LIMIT {
        while next as i32 <= squash(x) {
            stretch[next] = x as i16;
            next += 1;
        }
        x += 1;
    }
    stretch
};

/// A probability that a bit is 1, of 16 bits, in the lower half, and how many bits it
/// has seen, in the upper.
///
/// The probability's highest bit is flipped: so ½ is 0, and memory that comes as zeros
/// is not touched until a context is met.
#[derive(Clone, Copy)]
struct Estimate(u32);

/// Estimates stop adapting more slowly after this many bits: statistics drift
/// from level to level of a tree.
const MEMORY: u32 = 250;

/// By bits seen n: 2¹⁵ / (n + 1.5).
static RATES: [i32; MEMORY as usize + 1] = {
    let mut rates = [0; MEMORY as usize + 1];
    let mut n = 0;
    while n < rates.len() {
        rates[n] = (2 << 15) / (2 * n as i32 + 3);
        n += 1;
    }
    rates
};

impl Estimate {
    fn one(self) -> i32 {
        (self.0 & 0xffff ^ 0x8000) as i32
    }

    fn learnt(self, bit: bool) -> Self {
        let target = if bit { 65_535 } else { 0 };
        let (one, seen) = (self.one(), self.0 >> 16);
        let one = one + (((target - one) * RATES[seen as usize]) >> 15);
        Self((seen + 1).min(MEMORY) << 16 | one as u32 ^ 0x8000)
    }
}

/// A kind of bit, predicted from `N` contexts.
pub(super) struct Model<const N: usize> {
    /// [`Estimate`]s by context.
    estimates: [Vec<u32>; N],
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
        Self { estimates: sizes.map(|size| vec![0; size]), weights: vec![[even; N]; mixes] }
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
            let one = Estimate(self.estimates[i][contexts[i]]).one() >> (16 - PRECISION);
            i32::from(STRETCH[one as usize])
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
            estimates[at] = Estimate(estimates[at]).learnt(bit).0;
        }
        bit
    }
}
