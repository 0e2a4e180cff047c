//! Nested Gauss rules of 1, 3, 7 and 15 points on [0, 1] (T. N. L. Patterson, *The
//! optimum addition of points to quadrature formulae*, Math. Comp. 22, 1968).

/// Nodes on [−1, 1], the non-negative half; a rule has the first 1, 2, 4 or 8.
const NODES: [f64; 8] = [
    0.0,
    0.774_596_669_241_483_4,
    0.434_243_749_346_802_56,
    0.960_491_268_708_020_3,
    0.223_386_686_428_966_9,
    0.621_102_946_737_226_4,
    0.888_459_232_872_257,
    0.993_831_963_212_755,
];

/// The rules' weights, in the order of the nodes.
const WEIGHTS: [&[f64]; 4] = [
    &[2.0],
    &[0.888_888_888_888_889, 0.555_555_555_555_555_6],
    &[
        0.450_916_538_658_474_14,
        0.268_488_089_868_333_44,
        0.401_397_414_775_962_2,
        0.104_656_226_026_467_27,
    ],
    &[
        0.225_510_499_798_206_7,
        0.134_415_255_243_784_22,
        0.200_628_529_376_989_02,
        0.051_603_282_997_079_74,
        0.219_156_858_401_587_5,
        0.171_511_909_136_391_4,
        0.092_927_195_315_124_54,
        0.017_001_719_629_940_26,
    ],
];

/// An integral and what is not known of it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Estimate {
    pub(super) value: f64,
    /// The rule's own error.
    pub(super) error: f64,
    /// What the errors of the integrand's values amount to.
    pub(super) inner: f64,
}

/// ∫₀¹ f by the first rule, of 3 points or more, whose error is within `allowed`
/// or below what the values of f are worth; `f` gives a value and its error.
///
/// For an analytic f each rule has about twice the digits of the one before, so
/// that the difference e of two is far above the error of the better. Half of
/// that gain is claimed: e √(10 e / ∫f). Two rules can agree by chance, so e is
/// taken to be no less than the difference before it, squared, over ∫f; and of
/// rules as short as 1 and 3 points e itself must be within `allowed`.
pub(super) fn integrate(allowed: f64, mut f: impl FnMut(f64) -> (f64, f64)) -> Estimate {
    // Sum of the values, and of their errors, at each pair of nodes.
    let mut values = [(0.0, 0.0); NODES.len()];
    let (mut before, mut differed) = (0.0, 0.0_f64);
    let mut best = Estimate::default();
    for (rule, weights) in WEIGHTS.iter().enumerate() {
        for i in weights.len() / 2..weights.len() {
            values[i] = f(0.5 + 0.5 * NODES[i]);
            if NODES[i] != 0.0 {
                let (value, error) = f(0.5 - 0.5 * NODES[i]);
                values[i] = (values[i].0 + value, values[i].1 + error);
            }
        }
        let pairs = weights.iter().zip(values);
        let (value, inner) = pairs.fold((0.0, 0.0), |(value, inner), (w, (v, e))| {
            (value + 0.5 * w * v, inner + 0.5 * w * e)
        });
        let mut difference = (value - before).abs();
        before = value;
        if rule == 0 {
            continue;
        }
        if rule > 1 && value != 0.0 {
            difference = difference.max(differed * differed / value.abs());
        }
        differed = difference;
        let gain = if rule == 1 || value == 0.0 {
            1.0
        } else {
            (10.0 * difference / value.abs()).sqrt().min(1.0)
        };
        best = Estimate { value, error: difference * gain, inner };
        if best.error <= allowed.max(inner) {
            break;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Degrees 5, 11 and 23: exact, and claimed to be.
    #[test]
    fn polynomials_are_integrated_exactly() {
        for degree in [0, 2, 5, 11, 23_i32] {
            let estimate = integrate(0.0, |x| (x.powi(degree), 0.0));
            let expected = 1.0 / f64::from(degree + 1);
            assert!((estimate.value - expected).abs() < 2e-16, "{degree}: {estimate:?}");
        }
    }

    /// Over functions with singularities nearer and nearer to the interval.
    #[test]
    fn errors_are_within_their_estimates() {
        for i in 1..40 {
            let pole = 3.0 / f64::from(i * i);
            let expected = (1.0 + 1.0 / pole).ln();
            for allowed in [1e-2, 1e-6, 1e-10, 1e-14] {
                let found = integrate(allowed, |x| (1.0 / (x + pole), 0.0));
                let error = (found.value - expected).abs();
                assert!(error <= found.error + 1e-14 * expected, "{pole} {allowed}: {found:?}");
            }
        }
    }

    #[test]
    fn a_loose_tolerance_takes_three_points() {
        let mut points = 0;
        let mut count = |x: f64| {
            points += 1;
            (1.0 + 0.1 * x, 0.0)
        };
        integrate(1e-2, &mut count);
        assert_eq!(points, 3);
    }
}
