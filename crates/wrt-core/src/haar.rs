//! The Haar analysis and synthesis of one node (§5, Eq. 10, §7.2.4.3).

/// Children of a node that splits all four dimensions: 2⁴.
pub const CHILDREN: usize = 16;

/// Analyses one node: its children's smoothing coefficients in, the node's own
/// coefficients out, in place.
///
/// On entry `b[m']` is child m′'s smoothing coefficient ⟨L | B₀₍ₗ₊₁₎₍₂ₘ₊ₘ′₎⟩; on
/// return `b[nu]` is ⟨L | B_νlm⟩. In both, bits 0 to 3 of the index belong to u,
/// v, κ and λ; only indices within `split`, the dimensions that the node splits,
/// are touched. Eq. 10 with Haar's h = (½, ½) and g = (½, −½):
///
/// ```text
/// b_ν = Σ_m′ W_νm′ s_m′,    W_νm′ = 2^(−|split|/2) (−1)^popcount(ν & m′)
/// ```
///
/// which for all four dimensions has the paper's ¼. W is orthogonal, so the sum
/// of squares is unchanged, and symmetric, so it is its own inverse: see
/// [`push`].
///
/// ```
/// let mut b = [0.25; wrt_core::CHILDREN]; // L = 1 seen from level 1
/// wrt_core::pull(&mut b, 0b1111);
/// assert_eq!(b[0], 1.0);
/// assert!(b[1..].iter().all(|&w| w == 0.0));
/// ```
pub fn pull(b: &mut [f64; CHILDREN], split: usize) {
    // One butterfly per dimension: the filters are separable.
    if split == CHILDREN - 1 {
        // Known loops, which become registers.
        butterflies::<1>(b);
        butterflies::<2>(b);
        butterflies::<4>(b);
        butterflies::<8>(b);
    } else {
        for bit in [1, 2, 4, 8].into_iter().filter(|bit| split & bit != 0) {
            for low in (0..CHILDREN).filter(|i| i & bit == 0 && i & !split == 0) {
                butterfly(b, low, bit);
            }
        }
    }
    let scale =
        [1.0, std::f64::consts::FRAC_1_SQRT_2, 0.5, 0.5 * std::f64::consts::FRAC_1_SQRT_2, 0.25]
            [split.count_ones() as usize];
    for x in b {
        *x *= scale;
    }
}

#[inline(always)]
fn butterflies<const BIT: usize>(b: &mut [f64; CHILDREN]) {
    for low in (0..CHILDREN).filter(|i| i & BIT == 0) {
        butterfly(b, low, BIT);
    }
}

#[inline(always)]
fn butterfly(b: &mut [f64; CHILDREN], low: usize, bit: usize) {
    let (s, t) = (b[low], b[low | bit]);
    b[low] = s + t;
    b[low | bit] = s - t;
}

/// Synthesises one node: the inverse of [`pull`].
pub fn push(b: &mut [f64; CHILDREN], split: usize) {
    // W is symmetric as well as orthogonal. This holds for Haar alone; a wider
    // wavelet needs its own synthesis here.
    pull(b, split);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::{array::uniform16, prelude::*, sample::select};

    /// Eq. 10 as written, with no butterfly.
    fn pull_by_definition(s: &[f64; CHILDREN], split: usize) -> [f64; CHILDREN] {
        let scale = f64::from(1_u32 << split.count_ones()).sqrt().recip();
        std::array::from_fn(|nu| {
            let sign =
                |m: usize| if (nu & m).count_ones().is_multiple_of(2) { scale } else { -scale };
            crate::index::children(split).map(|m| sign(m) * s[m]).sum()
        })
    }

    fn coefficients() -> impl Strategy<Value = [f64; CHILDREN]> {
        uniform16(-1e6..1e6)
    }

    fn splits() -> impl Strategy<Value = usize> {
        select(vec![0b1111, 0b0011, 0b1100])
    }

    /// Rounding in sixteen terms of size `b`.
    fn tolerance(b: &[f64; CHILDREN]) -> f64 {
        16.0 * f64::EPSILON * b.iter().map(|x| x.abs()).sum::<f64>()
    }

    proptest! {
        #[test]
        fn pull_matches_its_definition(s in coefficients(), split in splits()) {
            let mut fast = s;
            pull(&mut fast, split);
            let slow = pull_by_definition(&s, split);
            for nu in crate::index::children(split) {
                prop_assert!((fast[nu] - slow[nu]).abs() <= tolerance(&s), "nu = {nu}");
            }
        }

        #[test]
        fn push_inverts_pull(s in coefficients(), split in splits()) {
            let mut b = s;
            pull(&mut b, split);
            push(&mut b, split);
            for m in crate::index::children(split) {
                prop_assert!((b[m] - s[m]).abs() <= tolerance(&s), "m = {m}");
            }
        }

        #[test]
        fn pull_keeps_the_sum_of_squares(s in coefficients(), split in splits()) {
            let energy = |b: &[f64; 16]| -> f64 {
                crate::index::children(split).map(|i| b[i] * b[i]).sum()
            };
            let mut b = s;
            pull(&mut b, split);
            prop_assert!((energy(&b) - energy(&s)).abs() <= 1e-14 * energy(&s));
        }
    }

    /// ⟨B_ν | B_ν′⟩ = δ, with the functions integrated cell by cell.
    #[test]
    fn the_functions_of_a_node_are_orthonormal() {
        // B_ν on child m′ of the root, from the analysis of unit impulses.
        let impulse = |m: usize| std::array::from_fn(|i| f64::from(u8::from(i == m)));
        let value = |nu: usize, m: usize| 4.0 * pull_by_definition(&impulse(m), 0b1111)[nu];
        for nu in 0..16 {
            for other in 0..16 {
                let inner: f64 = (0..16).map(|m| value(nu, m) * value(other, m) / 16.0).sum();
                assert_eq!(inner, f64::from(u8::from(nu == other)), "{nu} {other}");
            }
        }
    }
}
