//! Nested rules on [0, 1], whose difference tells the error of the longer one.

/// A node of a rule, its weight, and its weight in the shorter rule within (0
/// where it is none of that one's nodes).
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    pub(super) x: f64,
    pub(super) weight: f64,
    pub(super) coarse: f64,
}

/// The most nodes that a rule has.
pub(super) const LONGEST: usize = 15;

/// Node on [−1, 1] to node on [0, 1].
const fn node(x: f64, weight: f64, coarse: f64) -> Node {
    Node { x: 0.5 + 0.5 * x, weight: 0.5 * weight, coarse: 0.5 * coarse }
}

/// A symmetric rule from its non-positive nodes, given by their absolute values.
const fn mirrored<const HALF: usize, const N: usize>(half: [(f64, f64, f64); HALF]) -> [Node; N] {
    let mut all = [node(0.0, 0.0, 0.0); N];
    let mut i = 0;
    while i < HALF {
        let (x, weight, coarse) = half[i];
        all[i] = node(-x, weight, coarse);
        all[N - 1 - i] = node(x, weight, coarse);
        i += 1;
    }
    all
}

/// Kronrod's extension of the two-point Gauss rule: degrees 3 and 7 (A. S. Kronrod,
/// *Nodes and weights of quadrature formulas*, 1965).
const SHORT: [Node; 5] = {
    let half = [
        (0.925_820_099_772_551_5, 98.0 / 495.0, 0.0),
        (0.577_350_269_189_625_8, 27.0 / 55.0, 1.0),
        (0.0, 28.0 / 45.0, 0.0),
    ];
    mirrored(half)
};

/// Kronrod's extension of the seven-point Gauss rule: degrees 13 and 22 (R.
/// Piessens et al., *QUADPACK*, Springer, 1983).
const LONG: [Node; LONGEST] = {
    let half = [
        (0.991_455_371_120_812_6, 0.022_935_322_010_529_22, 0.0),
        (0.949_107_912_342_758_5, 0.063_092_092_629_978_55, 0.129_484_966_168_869_7),
        (0.864_864_423_359_769_1, 0.104_790_010_322_250_18, 0.0),
        (0.741_531_185_599_394_4, 0.140_653_259_715_525_92, 0.279_705_391_489_276_64),
        (0.586_087_235_467_691_1, 0.169_004_726_639_267_9, 0.0),
        (0.405_845_151_377_397_2, 0.190_350_578_064_785_4, 0.381_830_050_505_118_9),
        (0.207_784_955_007_898_47, 0.204_432_940_075_298_9, 0.0),
        (0.0, 0.209_482_141_084_727_82, 0.417_959_183_673_469_4),
    ];
    mirrored(half)
};

/// Patterson's extension of the three-point Gauss rule: degrees 5 and 11 (T. N. L.
/// Patterson, *The optimum addition of points to quadrature formulae*, Math. Comp.
/// 22, 1968).
const MEDIUM: [Node; 7] = {
    let half = [
        (0.960_491_268_708_020_3, 0.104_656_226_026_467_27, 0.0),
        (0.774_596_669_241_483_4, 0.268_488_089_868_333_44, 5.0 / 9.0),
        (0.434_243_749_346_802_56, 0.401_397_414_775_962_2, 0.0),
        (0.0, 0.450_916_538_658_474_14, 8.0 / 9.0),
    ];
    mirrored(half)
};

/// The rules, shortest first, the nodes of each increasing.
pub(super) const RULES: [&[Node]; 3] = [&SHORT, &MEDIUM, &LONG];

/// Estimated error of a longer rule that found `value` and differs by `difference`
/// from the shorter one within.
///
/// For an analytic integrand the longer rule, of about twice the degree, has twice
/// the digits: of e, relative, is left e². Half of that gain is claimed, 10 e √e:
/// what the shorter rule sees may not be what the longer one misses.
pub(super) fn error(difference: f64, value: f64) -> f64 {
    let gain = if value == 0.0 { 1.0 } else { (100.0 * difference / value.abs()).sqrt().min(1.0) };
    difference * gain
}

#[cfg(test)]
mod tests {
    use super::*;

    fn integrate(rule: usize, f: impl Fn(f64) -> f64) -> (f64, f64) {
        let sum = |weight: fn(&Node) -> f64| {
            RULES[rule].iter().map(|node| weight(node) * f(node.x)).sum::<f64>()
        };
        let value = sum(|node| node.weight);
        (value, error((value - sum(|node| node.coarse)).abs(), value))
    }

    #[test]
    fn polynomials_are_integrated_exactly() {
        for (rule, degree, coarse) in [(0, 7, 3), (1, 11, 5), (2, 22, 13)] {
            for power in 0..=degree {
                let expected = 1.0 / f64::from(power + 1);
                let (value, error) = integrate(rule, |x| x.powi(power));
                assert!((value - expected).abs() < 4e-16, "{power}: {value}");
                assert!(power > coarse || error < 1e-22, "{power}: {error}");
            }
        }
    }

    /// Over functions with singularities nearer and nearer to the interval.
    #[test]
    fn errors_are_within_their_estimates() {
        for i in 1..40 {
            let pole = 3.0 / f64::from(i * i);
            let expected = (1.0 + 1.0 / pole).ln();
            for rule in 0..RULES.len() {
                let (value, error) = integrate(rule, |x| 1.0 / (x + pole));
                let off = (value - expected).abs();
                assert!(off <= error + 1e-14 * expected, "{pole}: {value} ± {error}");
            }
        }
    }
}
