//! Integration methods by name.

use super::{
    Degree, Dimensions, Exact, Integral, Integrator, MonteCarlo, QuasiRandom, Romberg, Sequence,
    Trapezoidal,
};
use crate::{Error, Result, transport::Pair};
use std::{fmt, str::FromStr};

/// An integration method and its sample count, written `halton4d:1024`.
///
/// | name | samples |
/// |---|---|
/// | `trapezoid2d:n`, `trapezoid4d:n` | n a side, odd |
/// | `visible2d:n` | n a side, odd, on the visible box alone |
/// | `romberg-linear2d:n`, `-quadratic2d`, `-cubic2d` | n a side, 2^degree·i + 1 |
/// | `montecarlo2d:n`, `montecarlo4d:n` | n |
/// | `stratified2d:n`, `stratified4d:n` | n, a square or a fourth power |
/// | `halton2d:n`, `halton4d:n` | n, a multiple of 4 |
/// | `hammersley2d:n`, `hammersley4d:n` | n ≥ 14 |
/// | `sobol2d:n`, `sobol4d:n` | n ≥ 8, a power of two |
/// | `exact:1e-9` | instead of a count, the relative error asked for, within (0, 1) |
///
/// ```
/// use wrt_core::transport::{Integrator, Method};
///
/// let method: Method = "romberg-cubic2d:17".parse()?;
/// assert_eq!(method.name(), "romberg-cubic2d:17");
/// assert!("trapezoid2d:8".parse::<Method>().is_err()); // no coarser grid in 8 points
/// # Ok::<(), wrt_core::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Method {
    /// Regular grid.
    Trapezoidal(Trapezoidal),
    /// Extrapolated regular grids.
    Romberg(Romberg),
    /// Pseudo-random samples.
    MonteCarlo(MonteCarlo),
    /// Samples of low discrepancy.
    QuasiRandom(QuasiRandom),
    /// Gauss rules between the kinks.
    Exact(Exact),
}

impl Method {
    /// The seed of a method made from its name. Any other is as good.
    pub const SEED: u64 = 2002;

    /// Every name, without `:` and the count.
    pub const NAMES: [&'static str; 17] = [
        "trapezoid2d",
        "trapezoid4d",
        "visible2d",
        "romberg-linear2d",
        "romberg-quadratic2d",
        "romberg-cubic2d",
        "montecarlo2d",
        "montecarlo4d",
        "stratified2d",
        "stratified4d",
        "halton2d",
        "halton4d",
        "hammersley2d",
        "hammersley4d",
        "sobol2d",
        "sobol4d",
        "exact",
    ];

    fn integrator(&self) -> &dyn Integrator {
        match self {
            Self::Trapezoidal(rule) => rule,
            Self::Romberg(rule) => rule,
            Self::MonteCarlo(rule) => rule,
            Self::QuasiRandom(rule) => rule,
            Self::Exact(rule) => rule,
        }
    }
}

impl Integrator for Method {
    fn name(&self) -> String {
        self.integrator().name()
    }

    fn integrate(&self, pair: &Pair<'_>) -> Integral {
        self.integrator().integrate(pair)
    }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name())
    }
}

impl FromStr for Method {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let unknown = || Error::UnknownMethod {
            found: name.to_owned(),
            known: "trapezoid, montecarlo, stratified, halton, hammersley or sobol, then 2d or 4d; \
                    visible2d; romberg-linear2d, -quadratic2d or -cubic2d; then a colon and the \
                    samples, as in halton4d:1024; or exact and a tolerance below 1, as in \
                    exact:1e-9",
        };
        let (rule, samples) = name.split_once(':').ok_or_else(unknown)?;
        if rule == "exact" {
            let tolerance: f64 = samples.parse().map_err(|_| unknown())?;
            let fits = tolerance > 0.0 && tolerance < 1.0;
            return fits.then_some(Self::Exact(Exact { tolerance })).ok_or_else(unknown);
        }
        let samples = samples.parse().map_err(|_| unknown())?;
        let (rule, dimensions) = if let Some(rule) = rule.strip_suffix("2d") {
            (rule, Dimensions::Two)
        } else {
            (rule.strip_suffix("4d").ok_or_else(unknown)?, Dimensions::Four)
        };
        let quasi = |sequence| {
            QuasiRandom::new(sequence, dimensions, samples, Self::SEED).map(Self::QuasiRandom)
        };
        let romberg = |degree| Romberg::new(degree, samples).map(Self::Romberg);
        match (rule, dimensions) {
            ("trapezoid", _) => Trapezoidal::new(dimensions, samples).map(Self::Trapezoidal),
            ("visible", Dimensions::Two) => Trapezoidal::visible(samples).map(Self::Trapezoidal),
            ("romberg-linear", Dimensions::Two) => romberg(Degree::Linear),
            ("romberg-quadratic", Dimensions::Two) => romberg(Degree::Quadratic),
            ("romberg-cubic", Dimensions::Two) => romberg(Degree::Cubic),
            ("montecarlo", _) => {
                MonteCarlo::plain(dimensions, samples, Self::SEED).map(Self::MonteCarlo)
            }
            ("stratified", _) => {
                MonteCarlo::stratified(dimensions, samples, Self::SEED).map(Self::MonteCarlo)
            }
            ("halton", _) => quasi(Sequence::Halton),
            ("hammersley", _) => quasi(Sequence::Hammersley),
            ("sobol", _) => quasi(Sequence::Sobol),
            _ => Err(unknown()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::facts::{FACING, facing};
    use super::*;

    /// 4097 and 65 for grids, a fourth power for strata, a power of two for nets.
    fn samples(name: &str) -> &'static str {
        match name {
            "exact" => "1e-6",
            "trapezoid4d" => "17",
            name if name.starts_with("trap") || name.starts_with("rom") || name == "visible2d" => {
                "65"
            }
            _ => "4096",
        }
    }

    #[test]
    fn every_name_is_its_own_and_finds_the_form_factor() {
        let (geometry, [j, k]) = facing();
        let pair = Pair::new(&geometry, j, k);
        for name in Method::NAMES {
            let name = format!("{name}:{}", samples(name));
            let method: Method = name.parse().expect("a known name");
            assert_eq!(method.to_string(), name);
            let got = method.integrate(&pair);
            // Estimates are of one standard error, or of the last refinement.
            let error = (got.value - FACING).abs();
            assert!(error < 4.0 * got.error, "{name}: off by {error:e}, {got:?}");
            assert!(got.error < 0.1 * FACING, "{name}: {got:?}");
        }
    }

    /// Exchanging u with v and κ with λ on both squares changes nothing.
    #[test]
    fn swapped_axes_give_the_same_coefficient() {
        use crate::transport::Support;
        let (geometry, _) = facing();
        // The source's u runs along the destination's v: its cells are swapped already.
        let t = |method: &Method, j: [u16; 4], k: [u16; 4]| {
            let (j, k) = (Support::isotropic(1, j), Support::isotropic(1, k));
            method.integrate(&Pair::new(&geometry, j, k))
        };
        for name in Method::NAMES {
            let method: Method = format!("{name}:{}", samples(name)).parse().expect("known");
            let one = t(&method, [0, 1, 1, 0], [1, 1, 1, 0]);
            let two = t(&method, [1, 0, 0, 1], [1, 1, 0, 1]);
            let error = (one.value - two.value).abs();
            assert!(one.value > 0.0, "{name} sees nothing");
            assert!(error <= 4.0 * (one.error + two.error), "{name}: {one:?} {two:?}");
        }
    }

    #[test]
    fn other_names_are_refused() {
        for name in
            ["", "trapezoid2d", "simpson2d:9", "visible4d:9", "romberg-cubic4d:9", "halton3d:4"]
        {
            let error = name.parse::<Method>().expect_err(name);
            assert!(matches!(error, Error::UnknownMethod { .. }), "{name}: {error}");
        }
        let error = "halton2d:6".parse::<Method>().expect_err("no multiple of 4");
        assert!(matches!(error, Error::SampleCount { .. }), "{error}");
    }
}
