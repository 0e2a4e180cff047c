//! How far a vector of coefficients is from a reference (§7.1.4.3).

/// Relative Euclidean distance, RED: ‖b − b_ref‖₂ / ‖b_ref‖₂.
///
/// The basis is orthonormal, so that the smoothing coefficients of one level and
/// the wavelet coefficients above it give the same RED. 0 if the two are equal,
/// infinite if only the reference is zero.
///
/// # Panics
///
/// If the lengths differ.
#[must_use]
pub fn relative_euclidean_distance(values: &[f64], reference: &[f64]) -> f64 {
    let norm = |x: f64, y: f64| x + y * y;
    ratio(
        differences(values, reference).fold(0.0, norm).sqrt(),
        reference.iter().copied().fold(0.0, norm).sqrt(),
    )
}

/// Relative maximum departure, RMD: max |b − b_ref| / max |b_ref|.
///
/// It depends on the basis: the paper takes it of wavelet coefficients.
///
/// # Panics
///
/// If the lengths differ.
#[must_use]
pub fn relative_maximum_departure(values: &[f64], reference: &[f64]) -> f64 {
    let largest = |x: f64, y: f64| x.max(y.abs());
    ratio(
        differences(values, reference).fold(0.0, largest),
        reference.iter().copied().fold(0.0, largest),
    )
}

fn differences(values: &[f64], reference: &[f64]) -> impl Iterator<Item = f64> {
    let (found, expected) = (values.len(), reference.len());
    assert_eq!(found, expected, "{found} coefficients against a reference of {expected}");
    values.iter().zip(reference).map(|(v, r)| v - r)
}

fn ratio(difference: f64, size: f64) -> f64 {
    if difference == 0.0 { 0.0 } else { difference / size }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_right_triangle_has_its_hypotenuse() {
        let (b, reference) = ([3.0, 4.0, 12.0], [0.0, 0.0, 12.0]);
        assert_eq!(relative_euclidean_distance(&b, &reference), 5.0 / 12.0);
        assert_eq!(relative_maximum_departure(&b, &reference), 4.0 / 12.0);
    }

    #[test]
    fn nothing_against_nothing_is_exact_and_something_is_infinitely_wrong() {
        assert_eq!(relative_euclidean_distance(&[0.0], &[0.0]), 0.0);
        assert_eq!(relative_euclidean_distance(&[1.0], &[0.0]), f64::INFINITY);
        assert_eq!(relative_maximum_departure(&[1.0], &[0.0]), f64::INFINITY);
    }
}
