//! A binary arithmetic coder: bits in, or out, at the cost of their probability.
//!
//! Carryless, as in M. Mahoney's `lpaq` (2007): an interval `[low, high]` of 32
//! bits is divided in proportion, and leading bytes that its ends share are final.

/// Either end of the coder: what is written by one is read by the other, through
/// the same calls.
pub(super) trait Coder {
    /// A bit that is 1 with probability `one` / 2¹². A writer takes `bit` and
    /// returns it; a reader returns what was written.
    fn bit(&mut self, one: u32, bit: bool) -> bool;

    /// Whether a reader has been asked for more than there is: what it has read since is
    /// worth nothing.
    fn has_run_out(&self) -> bool {
        false
    }

    /// The low `count` bits of `value`, each as likely 0 as 1.
    fn even_bits(&mut self, count: u32, value: u32) -> u32 {
        (0..count).rev().fold(0, |read, i| {
            read << 1 | u32::from(self.bit(1 << (PRECISION - 1), value >> i & 1 == 1))
        })
    }
}

/// Bits of a probability.
pub(super) const PRECISION: u32 = 12;

/// Where the interval is divided: below is a 1.
fn middle(low: u32, high: u32, one: u32) -> u32 {
    low + ((u64::from(high - low) * u64::from(one)) >> PRECISION) as u32
}

/// Writes.
pub(super) struct Encoder {
    low: u32,
    high: u32,
    bytes: Vec<u8>,
}

impl Encoder {
    pub(super) fn new() -> Self {
        Self { low: 0, high: u32::MAX, bytes: Vec::new() }
    }

    /// All bytes, once there is nothing more to write.
    pub(super) fn finish(mut self) -> Vec<u8> {
        self.bytes.extend(self.low.to_be_bytes());
        self.bytes
    }
}

impl Coder for Encoder {
    fn bit(&mut self, one: u32, bit: bool) -> bool {
        let middle = middle(self.low, self.high, one);
        if bit {
            self.high = middle;
        } else {
            self.low = middle + 1;
        }
        while (self.low ^ self.high) >> 24 == 0 {
            self.bytes.push((self.high >> 24) as u8);
            self.low <<= 8;
            self.high = self.high << 8 | 255;
        }
        bit
    }
}

/// Reads.
pub(super) struct Decoder<'a> {
    low: u32,
    high: u32,
    code: u32,
    rest: &'a [u8],
    /// Bytes asked for past the end.
    missing: usize,
}

impl<'a> Decoder<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = Self { low: 0, high: u32::MAX, code: 0, rest: bytes, missing: 0 };
        for _ in 0..4 {
            decoder.shift();
        }
        decoder
    }

    fn shift(&mut self) {
        let byte = match self.rest.split_first() {
            Some((&byte, rest)) => {
                self.rest = rest;
                byte
            }
            None => {
                self.missing += 1;
                0
            }
        };
        self.code = self.code << 8 | u32::from(byte);
    }

    /// Whether all has been read, and no more.
    pub(super) fn is_at_end(&self) -> bool {
        self.rest.is_empty() && self.missing == 0
    }
}

impl Coder for Decoder<'_> {
    fn has_run_out(&self) -> bool {
        self.missing > 0
    }

    fn bit(&mut self, one: u32, _: bool) -> bool {
        let middle = middle(self.low, self.high, one);
        let bit = self.code <= middle;
        if bit {
            self.high = middle;
        } else {
            self.low = middle + 1;
        }
        while (self.low ^ self.high) >> 24 == 0 {
            self.low <<= 8;
            self.high = self.high << 8 | 255;
            self.shift();
        }
        bit
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn bits_come_back_and_cost_what_they_should(
            bits in prop::collection::vec((1..4095_u32, any::<bool>()), 0..2000),
        ) {
            let mut encoder = Encoder::new();
            let mut cost = 0.0;
            for &(one, bit) in &bits {
                encoder.bit(one, bit);
                let p = f64::from(one) / 4096.0;
                cost -= if bit { p.log2() } else { (1.0 - p).log2() };
            }
            let bytes = encoder.finish();
            // Four bytes end it; rounding the interval loses little.
            prop_assert!(8.0 * (bytes.len() as f64 - 4.0) <= 1.001 * cost + 8.0, "{cost} bits");
            let mut decoder = Decoder::new(&bytes);
            for &(one, bit) in &bits {
                prop_assert_eq!(decoder.bit(one, false), bit);
            }
            prop_assert!(decoder.is_at_end());
        }
    }

    #[test]
    fn the_end_is_noticed() {
        let mut encoder = Encoder::new();
        (0..100).for_each(|i| assert_eq!(encoder.even_bits(7, i), i));
        let bytes = encoder.finish();
        let mut decoder = Decoder::new(&bytes[..bytes.len() - 1]);
        (0..99).for_each(|i| assert_eq!(decoder.even_bits(7, 0), i));
        decoder.even_bits(7, 0);
        assert!(!decoder.is_at_end(), "a byte is missing");
    }
}
