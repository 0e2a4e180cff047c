//! Sobol's sequence, Owen-scrambled: points that fill the unit cube evenly.
//!
//! Directions of S. Joe & F. Kuo, *Constructing Sobol sequences with better
//! two-dimensional projections*, SIAM J. Sci. Comput. 30, 2008; scrambled by
//! hashing (B. Burley, *Practical hash-based Owen scrambling*, JCGT 9(4), 2020).

/// Coordinate `d` of point `i`, in (0, 1), scrambled by `seed`.
///
/// Any 2^n points in succession from a multiple of 2^n fill each dimension's 2^n
/// intervals once, and with another independent seed for each dimension the mean
/// of a function over them is an unbiased estimate of its integral.
///
/// # Panics
///
/// If `d` is past the four dimensions that there are.
#[must_use]
pub fn sobol(i: u32, d: usize, seed: u32) -> f64 {
    fraction(owen_scrambled(point(i, d), seed))
}

/// The middle of a 32-bit number's interval of [0, 1).
fn fraction(bits: u32) -> f64 {
    (f64::from(bits) + 0.5) * 2.0_f64.powi(-32)
}

/// Point `i` of Sobol's sequence in dimension `d`, as 32 bits past the point.
fn point(mut i: u32, d: usize) -> u32 {
    let mut x = 0;
    while i > 0 {
        x ^= DIRECTIONS[d][i.trailing_zeros() as usize];
        i &= i - 1;
    }
    x
}

/// Direction numbers of the first four dimensions.
const DIRECTIONS: [[u32; 32]; 4] = [
    // The first is the radical inverse in base 2: all its m are 1.
    directions(0, 0, [1, 1, 1]),
    // Degree s, coefficients a and initial m of new-joe-kuo-6.21201.
    directions(1, 0, [1, 0, 0]),
    directions(2, 1, [1, 3, 0]),
    directions(3, 1, [1, 3, 1]),
];

/// v_k = m_k / 2^k of a primitive polynomial of degree `s` with inner
/// coefficients `a`:
///
/// ```text
/// m_k = 2 a_1 m_k−1 ⊕ 4 a_2 m_k−2 ⊕ … ⊕ 2^s m_k−s ⊕ m_k−s
/// ```
const fn directions(s: usize, a: u32, initial: [u32; 3]) -> [u32; 32] {
    let mut v = [0; 32];
    let mut k = 0;
    while k < 32 {
        v[k] = if s == 0 {
            1 << (31 - k)
        } else if k < s {
            initial[k] << (31 - k)
        } else {
            // In terms of v the factors 2^i drop out, and the last term is shifted.
            let mut x = v[k - s] ^ (v[k - s] >> s);
            let mut i = 1;
            while i < s {
                if a >> (s - 1 - i) & 1 == 1 {
                    x ^= v[k - i];
                }
                i += 1;
            }
            x
        };
        k += 1;
    }
    v
}

/// Each bit flipped or not as a hash of those above it says (Burley's `nested
/// uniform scramble`, with the hash of Laine & Karras).
fn owen_scrambled(x: u32, seed: u32) -> u32 {
    let mut x = x.reverse_bits().wrapping_add(seed);
    for odd in [0x6c50_b47c, 0xb82f_1e52, 0xc7af_e638, 0x8d22_f6e6] {
        x ^= x.wrapping_mul(odd);
    }
    x.reverse_bits()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 2^n points of any two of the first dimensions that form a (0, n, 2)-net: one
    /// in each elementary interval, scrambled or not.
    #[test]
    fn sobol_stays_a_net_when_scrambled() {
        let cells = |x: u32, bits: u32| if bits == 0 { 0 } else { x >> (32 - bits) };
        for scramble in [None, Some((0x1234_5678, 0x9abc_def0))] {
            for bits in 0..=8 {
                let mut seen = [false; 256];
                for i in 0..256 {
                    let (x, y) = match scramble {
                        None => (point(i, 0), point(i, 1)),
                        Some((a, b)) => {
                            (owen_scrambled(point(i, 0), a), owen_scrambled(point(i, 1), b))
                        }
                    };
                    seen[(cells(x, bits) << (8 - bits) | cells(y, 8 - bits)) as usize] = true;
                }
                assert!(seen.iter().all(|&s| s), "2^{bits} intervals along the first");
            }
        }
    }

    /// Every dimension of Sobol' alone visits each of 2^n intervals once.
    #[test]
    fn each_dimension_of_sobol_is_stratified() {
        for d in 0..4 {
            let mut seen = [false; 1024];
            for i in 0..1024 {
                seen[(point(i, d) >> 22) as usize] = true;
            }
            assert!(seen.iter().all(|&s| s), "dimension {d}");
        }
        // By hand from m = 1, 3: v₁ = ½, v₂ = ¾, and their exclusive or.
        assert_eq!([1, 2, 3].map(|i| fraction(point(i, 2)) as f32), [0.5, 0.75, 0.25]);
    }
}
