//! Legendre multiwavelets on [0, 1] of any order; order 1 is Haar (B. Alpert, *A
//! Class of Bases in L² for the Sparse Representation of Integral Operators*, SIAM
//! J. Math. Anal. 24(1), 1993).

/// The highest order there is: polynomials of degree 15 within a cell.
pub const MAX_ORDER: usize = 16;

/// The two-scale relations of the orthonormal Legendre basis of an order p.
///
/// The scaling functions of the unit interval are φ_k(x) = √(2k+1) P_k(2x − 1),
/// k = 0..p; those of half c of it are √2 φ_j(2x − c). Each φ_k is a sum of the
/// halves', and p wavelets span what the halves have beyond that:
///
/// ```text
/// φ_k = Σ_c Σ_j h_c[k][j] √2 φ_j(2x − c)        ψ_k = Σ_c Σ_j g_c[k][j] √2 φ_j(2x − c)
/// ```
///
/// The 2p × 2p matrix of h and g is orthogonal to round-off. A wavelet is
/// orthogonal to all polynomials of degree below p. Alpert gives his further
/// vanishing moments by another choice of basis in the same space; nothing here
/// depends on that choice.
#[derive(Clone, Debug)]
pub struct Multiwavelet {
    order: usize,
    /// Rows k of φ, then of ψ; columns j of half 0, then of half 1.
    matrix: Vec<f64>,
}

impl Multiwavelet {
    /// The basis of p = `order`.
    ///
    /// # Panics
    ///
    /// If `order` is 0 or above [`MAX_ORDER`].
    #[must_use]
    pub fn new(order: usize) -> Self {
        assert!((1..=MAX_ORDER).contains(&order), "order {order} is not in 1..={MAX_ORDER}");
        let mut rows = Vec::with_capacity(2 * order);
        // h_c[k][j] = ∫ φ_k((y + c)/2) φ_j(y) dy / √2, exact by p Gauss points.
        let rule = gauss_legendre(order);
        for k in 0..order {
            let mut row = vec![0.0; 2 * order];
            for c in 0..2 {
                for &(y, weight) in &rule {
                    let parent = legendre(order, 0.5 * (y + c as f64))[k];
                    let child = legendre(order, y);
                    for j in 0..order {
                        row[c * order + j] +=
                            weight * parent * child[j] * std::f64::consts::FRAC_1_SQRT_2;
                    }
                }
            }
            rows.push(row);
        }
        // P_k with its sign flipped in half 0 is not smooth at ½: it has a part
        // that no polynomial has, and that is the wavelet.
        for k in 0..order {
            let mut row = rows[k].clone();
            row[..order].iter_mut().for_each(|x| *x = -*x);
            // Twice is enough (L. Giraud et al., Numer. Math. 101, 2005).
            for _ in 0..2 {
                for other in &rows {
                    let along: f64 = row.iter().zip(other).map(|(a, b)| a * b).sum();
                    row.iter_mut().zip(other).for_each(|(a, b)| *a -= along * b);
                }
            }
            let norm = row.iter().map(|x| x * x).sum::<f64>().sqrt();
            row.iter_mut().for_each(|x| *x /= norm);
            rows.push(row);
        }
        Self { order, matrix: rows.concat() }
    }

    /// p.
    #[must_use]
    pub fn order(&self) -> usize {
        self.order
    }

    /// Analyses one node: the coefficients of half 0 and of half 1 in, those of φ
    /// and of ψ out; the sum of squares stays. For order 1 this is Haar's.
    ///
    /// # Panics
    ///
    /// If `b` does not have 2p coefficients.
    pub fn pull(&self, b: &mut [f64]) {
        assert_eq!(b.len(), 2 * self.order, "two halves of {} coefficients", self.order);
        let mut out = [0.0; 2 * MAX_ORDER];
        for (out, row) in out.iter_mut().zip(self.matrix.chunks_exact(b.len())) {
            *out = row.iter().zip(&*b).map(|(m, x)| m * x).sum();
        }
        b.copy_from_slice(&out[..b.len()]);
    }

    /// Synthesises one node: the inverse of [`pull`](Self::pull).
    ///
    /// # Panics
    ///
    /// If `b` does not have 2p coefficients.
    pub fn push(&self, b: &mut [f64]) {
        assert_eq!(b.len(), 2 * self.order, "{} coefficients of φ and of ψ", self.order);
        let mut out = [0.0; 2 * MAX_ORDER];
        for (x, row) in b.iter().zip(self.matrix.chunks_exact(b.len())) {
            out.iter_mut().zip(row).for_each(|(out, m)| *out += x * m);
        }
        b.copy_from_slice(&out[..b.len()]);
    }

    /// Analyses a node of the square, whose four children c = c_x + 2 c_y have p²
    /// coefficients each, x fastest: child by child in, and out the p² of the
    /// node's φφ, then the 3p² of its wavelets ψφ, φψ and ψψ.
    ///
    /// # Panics
    ///
    /// If `b` does not have 4p² coefficients.
    pub fn pull_square(&self, b: &mut [f64]) {
        self.each_axis(b, [0, 1], Self::pull);
    }

    /// Synthesises a node of the square: the inverse of
    /// [`pull_square`](Self::pull_square).
    ///
    /// # Panics
    ///
    /// If `b` does not have 4p² coefficients.
    pub fn push_square(&self, b: &mut [f64]) {
        self.each_axis(b, [1, 0], Self::push);
    }

    fn each_axis(&self, b: &mut [f64], axes: [usize; 2], step: fn(&Self, &mut [f64])) {
        let p = self.order;
        assert_eq!(b.len(), 4 * p * p, "four squares of {p}² coefficients");
        let mut pair = [0.0; 2 * MAX_ORDER];
        for axis in axes {
            let (half, stride) = if axis == 0 { (p * p, 1) } else { (2 * p * p, p) };
            let (other_half, other_stride) = if axis == 0 { (2 * p * p, p) } else { (p * p, 1) };
            for line in (0..2 * p).map(|i| i / p * other_half + i % p * other_stride) {
                let at = |i: usize| line + i / p * half + i % p * stride;
                for (i, x) in pair[..2 * p].iter_mut().enumerate() {
                    *x = b[at(i)];
                }
                step(self, &mut pair[..2 * p]);
                for (i, x) in pair[..2 * p].iter().enumerate() {
                    b[at(i)] = *x;
                }
            }
        }
    }
}

/// φ_0(x), …, φ_(p−1)(x) of the unit interval, p = `order`; zeros from there on.
#[must_use]
pub fn legendre(order: usize, x: f64) -> [f64; MAX_ORDER] {
    let mut values = [0.0; MAX_ORDER];
    let y = 2.0 * x - 1.0;
    // (k + 1) P_(k+1) = (2k + 1) y P_k − k P_(k−1).
    let (mut before, mut now) = (0.0, 1.0);
    for (k, value) in values[..order].iter_mut().enumerate() {
        let n = k as f64;
        *value = now * (2.0 * n + 1.0).sqrt();
        (before, now) = (now, ((2.0 * n + 1.0) * y * now - n * before) / (n + 1.0));
    }
    values
}

/// The nodes and weights of Gauss's rule of `points` points on [0, 1], nodes
/// increasing: exact for polynomials of degree 2 `points` − 1.
///
/// # Panics
///
/// If `points` is 0.
#[must_use]
pub fn gauss_legendre(points: usize) -> Vec<(f64, f64)> {
    assert!(points > 0, "a rule has points");
    let n = points as f64;
    // P_n and its derivative.
    let polynomial = |y: f64| {
        let (mut before, mut now) = (0.0, 1.0);
        for k in 0..points {
            let k = k as f64;
            (before, now) = (now, ((2.0 * k + 1.0) * y * now - k * before) / (k + 1.0));
        }
        (now, n * (y * now - before) / (y * y - 1.0))
    };
    let node = |i: usize| {
        // F. G. Tricomi's estimate of the root, then Newton's steps to round-off.
        let mut y = (std::f64::consts::PI * (i as f64 + 0.75) / (n + 0.5)).cos();
        for _ in 0..8 {
            let (value, slope) = polynomial(y);
            y -= value / slope;
        }
        let slope = polynomial(y).1;
        (0.5 * (1.0 - y), 1.0 / ((1.0 - y * y) * slope * slope))
    };
    (0..points).map(node).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn gauss_s_rule_integrates_powers_exactly() {
        for points in 1..=MAX_ORDER + 1 {
            let rule = gauss_legendre(points);
            for power in 0..2 * points as i32 {
                let sum: f64 = rule.iter().map(|(x, w)| w * x.powi(power)).sum();
                let exact = 1.0 / f64::from(power + 1);
                assert!((sum - exact).abs() < 1e-14, "{points} points, x^{power}: {sum}");
            }
        }
    }

    #[test]
    fn scaling_functions_are_orthonormal() {
        let rule = gauss_legendre(MAX_ORDER);
        for j in 0..MAX_ORDER {
            for k in 0..MAX_ORDER {
                let product = |&(x, w): &(f64, f64)| {
                    let phi = legendre(MAX_ORDER, x);
                    w * phi[j] * phi[k]
                };
                let inner: f64 = rule.iter().map(product).sum();
                let expected = f64::from(u8::from(j == k));
                assert!((inner - expected).abs() < 1e-13, "⟨φ_{j} | φ_{k}⟩ = {inner}");
            }
        }
    }

    #[test]
    fn two_scale_matrices_are_orthogonal_to_round_off() {
        for order in 1..=MAX_ORDER {
            let basis = Multiwavelet::new(order);
            let n = 2 * order;
            for i in 0..n {
                for j in 0..n {
                    let row = |i: usize| &basis.matrix[i * n..(i + 1) * n];
                    let inner: f64 = row(i).iter().zip(row(j)).map(|(a, b)| a * b).sum();
                    let expected = f64::from(u8::from(i == j));
                    assert!((inner - expected).abs() < 1e-14, "order {order}: {i}, {j}: {inner}");
                }
            }
        }
    }

    #[test]
    fn order_one_is_haar() {
        let s = std::f64::consts::FRAC_1_SQRT_2;
        let mut b = [1.0, 0.0];
        Multiwavelet::new(1).pull(&mut b);
        assert!((b[0] - s).abs() < 1e-15 && (b[1].abs() - s).abs() < 1e-15, "{b:?}");
    }

    /// Coefficients of a function on half c of the unit interval, by a rule that is
    /// exact for it.
    fn project(order: usize, c: usize, f: impl Fn(f64) -> f64) -> Vec<f64> {
        let mut b = vec![0.0; order];
        for (y, w) in gauss_legendre(MAX_ORDER + 1) {
            let value = f(0.5 * (y + c as f64)) * std::f64::consts::FRAC_1_SQRT_2;
            for (b, phi) in b.iter_mut().zip(legendre(order, y)) {
                *b += w * value * phi;
            }
        }
        b
    }

    #[test]
    fn wavelets_vanish_on_polynomials_below_the_order_and_not_at_it() {
        for order in 1..=8 {
            let basis = Multiwavelet::new(order);
            let details = |power: usize| {
                let f = |x: f64| x.powi(power as i32);
                let mut b = [project(order, 0, f), project(order, 1, f)].concat();
                basis.pull(&mut b);
                b[order..].iter().map(|x| x * x).sum::<f64>().sqrt()
            };
            for power in 0..order {
                assert!(details(power) < 1e-14, "order {order}: x^{power}: {}", details(power));
            }
            assert!(details(order) > 1e-8, "order {order}: x^{order} has a detail");
        }
    }

    proptest! {
        #[test]
        fn push_inverts_pull_and_both_keep_the_energy(
            order in 1..=10_usize, seed in proptest::collection::vec(-1.0..1.0f64, 400),
        ) {
            let basis = Multiwavelet::new(order);
            let energy = |b: &[f64]| b.iter().map(|x| x * x).sum::<f64>();
            let line = &seed[..2 * order];
            let mut b = line.to_vec();
            basis.pull(&mut b);
            prop_assert!((energy(&b) - energy(line)).abs() < 1e-13 * energy(line));
            basis.push(&mut b);
            prop_assert!(b.iter().zip(line).all(|(a, b)| (a - b).abs() < 1e-13));
            let square = &seed[..4 * order * order];
            let mut b = square.to_vec();
            basis.pull_square(&mut b);
            prop_assert!((energy(&b) - energy(square)).abs() < 1e-13 * energy(square));
            basis.push_square(&mut b);
            prop_assert!(b.iter().zip(square).all(|(a, b)| (a - b).abs() < 1e-13));
        }
    }

    /// The square's φφ coefficients are those of the function on the whole square.
    #[test]
    fn the_square_s_scaling_coefficients_are_the_function_s_own() {
        const ORDER: usize = 3;
        let f = |x: f64, y: f64| 1.0 + 2.0 * x * x - 3.0 * x * y + y;
        let rule = gauss_legendre(8);
        let project = |cell: [f64; 2], width: f64| {
            let mut b = vec![0.0; ORDER * ORDER];
            for &(s, ws) in &rule {
                for &(t, wt) in &rule {
                    let value = f(cell[0] + width * s, cell[1] + width * t) * ws * wt * width;
                    let (x, y) = (legendre(ORDER, s), legendre(ORDER, t));
                    for i in 0..ORDER * ORDER {
                        b[i] += value * x[i % ORDER] * y[i / ORDER];
                    }
                }
            }
            b
        };
        let mut b: Vec<f64> = (0..4)
            .flat_map(|c| project([0.5 * (c % 2) as f64, 0.5 * (c / 2) as f64], 0.5))
            .collect();
        Multiwavelet::new(ORDER).pull_square(&mut b);
        let whole = project([0.0; 2], 1.0);
        for (i, (found, expected)) in b.iter().zip(&whole).enumerate() {
            assert!((found - expected).abs() < 1e-14, "{i}: {found} {expected}");
        }
        assert!(b[ORDER * ORDER..].iter().all(|d| d.abs() < 1e-14), "f is a quadratic");
    }
}
