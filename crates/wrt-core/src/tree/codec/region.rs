//! The Haar transform of a node of which only some children are lit: orthonormal
//! on what is lit, so that darkness costs no coefficients.
//!
//! As R. L. de Queiroz and P. A. Chou, *Compression of 3D point clouds using a
//! region-adaptive hierarchical transform*, IEEE Trans. Image Processing 25(8),
//! 2016, with the sums and differences transformed alike, so that a node lit all
//! over has the coefficients of [`pull`](crate::pull).

use crate::CHILDREN;

/// The transform for one pattern of lit volumes.
pub(super) struct Region {
    split: usize,
    /// The volumes before each dimension's step, u first, and after the last.
    volumes: [[f64; CHILDREN]; 5],
    /// Whether all children are lit equally, so that it is the usual transform.
    is_even: bool,
}

impl Region {
    /// For children with these lit volumes, 0 for a dark one, of a node that
    /// splits the dimensions in `split`.
    pub(super) fn new(split: usize, lit: [f64; CHILDREN]) -> Self {
        let is_even = crate::children(split).all(|m| lit[m] == lit[0]);
        let mut volumes = [lit; 5];
        for d in 0..4 {
            let mut next = volumes[d];
            for (low, high) in pairs(split, d) {
                let (a, b) = (next[low], next[high]);
                (next[low], next[high]) = match (a > 0.0, b > 0.0) {
                    (true, true) => (a + b, a + b),
                    _ => (a + b, 0.0),
                };
            }
            volumes[d + 1] = next;
        }
        Self { split, volumes, is_even }
    }

    /// The lit volume of the node.
    pub(super) fn volume(&self) -> f64 {
        self.volumes[4][0]
    }

    /// Bit ν: there is a coefficient ν, and so for as many as are lit, ν = 0
    /// among them.
    pub(super) fn mask(&self) -> u16 {
        (0..CHILDREN).filter(|&nu| self.volumes[4][nu] > 0.0).fold(0, |mask, nu| mask | 1 << nu)
    }

    /// Children's smoothing coefficients to the node's own.
    pub(super) fn pull(&self, b: &mut [f64; CHILDREN]) {
        if self.is_even {
            return crate::pull(b, self.split);
        }
        for d in 0..4 {
            for (low, high) in pairs(self.split, d) {
                let (s, t) = (b[low], b[high]);
                match self.step(d, low, high) {
                    Step::Turn(cos, sin) => (b[low], b[high]) = reflected(cos, sin, s, t),
                    Step::Move => (b[low], b[high]) = (t, 0.0),
                    Step::Stay => {}
                }
            }
        }
    }

    /// The inverse of [`pull`](Self::pull).
    pub(super) fn push(&self, b: &mut [f64; CHILDREN]) {
        if self.is_even {
            return crate::push(b, self.split);
        }
        for d in (0..4).rev() {
            for (low, high) in pairs(self.split, d) {
                let (s, t) = (b[low], b[high]);
                match self.step(d, low, high) {
                    // A reflection is its own inverse.
                    Step::Turn(cos, sin) => (b[low], b[high]) = reflected(cos, sin, s, t),
                    Step::Move => (b[low], b[high]) = (0.0, s),
                    Step::Stay => {}
                }
            }
        }
    }

    fn step(&self, d: usize, low: usize, high: usize) -> Step {
        let (a, b) = (self.volumes[d][low], self.volumes[d][high]);
        if b == 0.0 {
            Step::Stay
        } else if a == 0.0 {
            Step::Move
        } else {
            Step::Turn((a / (a + b)).sqrt(), (b / (a + b)).sqrt())
        }
    }
}

enum Step {
    Stay,
    /// The higher of the two alone is lit.
    Move,
    Turn(f64, f64),
}

/// Indices that differ in dimension `d` only, the lower first.
fn pairs(split: usize, d: usize) -> impl Iterator<Item = (usize, usize)> {
    let bit = 1 << d;
    let low = (0..CHILDREN).filter(move |i| i & bit == 0 && i & !split == 0);
    low.filter(move |_| split & bit != 0).map(move |low| (low, low | bit))
}

/// (s, t) in the line at the angle of (cos, sin) halved.
fn reflected(cos: f64, sin: f64, s: f64, t: f64) -> (f64, f64) {
    (cos * s + sin * t, sin * s - cos * t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::{array::uniform16, prelude::*, sample::select};

    fn splits() -> impl Strategy<Value = usize> {
        select(vec![0b1111, 0b0011, 0b1100])
    }

    /// Volumes and coefficients within `split`, about half of them dark.
    fn lit(split: usize, volumes: [i8; 16], b: [f64; 16]) -> ([f64; 16], [f64; 16]) {
        let volumes =
            std::array::from_fn(
                |m| {
                    if m & !split == 0 { f64::from(volumes[m].max(0)) } else { 0.0 }
                },
            );
        (volumes, std::array::from_fn(|m| if volumes[m] > 0.0 { b[m] } else { 0.0 }))
    }

    proptest! {
        #[test]
        fn push_inverts_pull_and_both_keep_the_energy(
            split in splits(), volumes: [i8; 16], b in uniform16(-1e3..1e3),
        ) {
            let (volumes, b) = lit(split, volumes, b);
            let region = Region::new(split, volumes);
            let energy = |b: &[f64; 16]| b.iter().map(|x| x * x).sum::<f64>();
            let mut there = b;
            region.pull(&mut there);
            prop_assert!((energy(&there) - energy(&b)).abs() <= 1e-13 * energy(&b));
            for (nu, b) in there.iter().enumerate() {
                prop_assert!(region.mask() >> nu & 1 == 1 || *b == 0.0, "nu = {nu}");
            }
            let lit = volumes.iter().filter(|v| **v > 0.0).count();
            prop_assert_eq!(region.mask().count_ones() as usize, lit);
            region.push(&mut there);
            for m in 0..16 {
                prop_assert!((there[m] - b[m]).abs() < 1e-10, "m' = {m}");
            }
        }

        #[test]
        fn a_node_lit_all_over_has_its_usual_coefficients(
            split in splits(), b in uniform16(-1e3..1e3),
        ) {
            let (volumes, b) = lit(split, [1; 16], b);
            let (mut own, mut usual) = (b, b);
            Region { is_even: false, ..Region::new(split, volumes) }.pull(&mut own);
            crate::pull(&mut usual, split);
            for nu in 0..16 {
                prop_assert!((own[nu] - usual[nu]).abs() < 1e-10, "nu = {nu}");
            }
        }

        /// The smoothing coefficient of a constant is its value times √volume.
        #[test]
        fn a_constant_has_no_other_coefficients(split in splits(), volumes: [i8; 16]) {
            let (volumes, mut b) = lit(split, volumes, volumes.map(|v| f64::from(v.max(0)).sqrt()));
            let region = Region::new(split, volumes);
            region.pull(&mut b);
            prop_assert!((b[0] - region.volume().sqrt()).abs() < 1e-10);
            // Of differences only those between sums vanish.
            for nu in [1, 2, 4, 8] {
                prop_assert!(b[nu].abs() < 1e-10, "nu = {nu}: {}", b[nu]);
            }
        }
    }
}
