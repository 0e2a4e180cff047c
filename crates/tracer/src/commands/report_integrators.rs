//! `tracer report integrators`: the paper's comparison of integration methods
//! (§7.1.4.3, Fig. 4 and 5) on several geometries and source functions.

use super::stdout::say;
use crate::cli::Integrators;
use crate::plot::{Curve, Plot};
use crate::report::time_to;
use anyhow::Context;
use cpu_time::ThreadTime;
use glam::{DQuat, DVec3};
use std::{fmt::Write as _, fs, path::Path};
use wrt_core::metrics::{relative_euclidean_distance, relative_maximum_departure};
use wrt_core::transport::{Integral, Integrator, Method, Pair, Support, TransportGeometry};
use wrt_core::{CHILDREN, Cell, Polygon, pull};

/// Level of the destination's smoothing functions: the paper's K = 16^(l_max + 1)
/// coefficients of l_max = 1.
const LEVEL: u8 = 2;

/// What the reference is computed with.
const REFERENCE: &str = "exact:1e-10";

/// RED that the table is made for.
const TARGETS: [f64; 3] = [1e-2, 1e-3, 1e-4];

/// Errors below are not told apart in the plots: `exact` would squeeze all others.
const FLOOR: f64 = 1e-5;

/// What all methods are measured against.
const BASELINE: &str = "trapezoid2d";

/// A method and the counts, or tolerances, it is run with.
struct Ladder {
    name: &'static str,
    colour: &'static str,
    samples: &'static [&'static str],
}

const GRIDS: &[&str] = &["5", "9", "17", "33", "65", "129"];
const COUNTS: &[&str] = &["16", "64", "256", "1024", "4096", "16384"];

const fn ladder(
    name: &'static str,
    colour: &'static str,
    samples: &'static [&'static str],
) -> Ladder {
    Ladder { name, colour, samples }
}

/// Four dimensions have the colour of two.
const LADDERS: [Ladder; 17] = [
    ladder("trapezoid2d", "#000000", GRIDS),
    ladder("trapezoid4d", "#000000", &["3", "5", "7", "9", "11"]),
    ladder("romberg-linear2d", "#e69f00", GRIDS),
    ladder("romberg-quadratic2d", "#d55e00", GRIDS),
    ladder("romberg-cubic2d", "#8b4513", &["9", "17", "33", "65", "129"]),
    ladder("montecarlo2d", "#56b4e9", COUNTS),
    ladder("montecarlo4d", "#56b4e9", COUNTS),
    ladder("stratified2d", "#0072b2", COUNTS),
    ladder("stratified4d", "#0072b2", &["16", "81", "256", "1296", "4096", "14641"]),
    ladder("halton2d", "#cc79a7", COUNTS),
    ladder("halton4d", "#cc79a7", COUNTS),
    ladder("hammersley2d", "#aa3377", COUNTS),
    ladder("hammersley4d", "#aa3377", COUNTS),
    ladder("sobol2d", "#6a3d9a", COUNTS),
    ladder("sobol4d", "#6a3d9a", COUNTS),
    ladder("visible2d", "#009e73", GRIDS),
    ladder("exact", "#ee0000", &["1e-2", "1e-6", "1e-8"]),
];

/// One source function in one geometry.
#[derive(Debug)]
struct Problem {
    geometry: &'static str,
    /// **j**: its level and offsets.
    j: String,
    /// The reference's own estimate of its RED.
    reference_error: f64,
}

/// One method with one count on one problem.
#[derive(Clone, Copy, Debug)]
struct Measurement {
    /// Indices of the problem and of the ladder.
    problem: usize,
    ladder: usize,
    /// The count, or the tolerance.
    samples: &'static str,
    evaluations: u64,
    /// CPU time for all coefficients.
    seconds: f64,
    red: f64,
    rmd: f64,
    /// The RED that the method's own error estimates amount to.
    claimed: f64,
}

/// Measures, writes the files and prints who wins.
pub(crate) fn run(args: &Integrators) -> anyhow::Result<()> {
    let geometries = geometries()?;
    let (geometries, most, enough) =
        if args.quick { (&geometries[..2], 3, 0.05) } else { (&geometries[..], usize::MAX, 0.3) };
    let (mut problems, mut measurements) = (Vec::new(), Vec::new());
    for (name, geometry) in geometries {
        for level in 0..=2 {
            let j = brightest(geometry, level)?;
            let pairs: Vec<Pair<'_>> = dest_cells().map(|k| Pair::new(geometry, j, k)).collect();
            let reference = Coefficients::compute(&reference_method()?, &pairs, 0.0);
            for (ladder, Ladder { name, samples, .. }) in LADDERS.iter().enumerate() {
                for &samples in samples.iter().take(most) {
                    let method: Method = format!("{name}:{samples}").parse()?;
                    let got = Coefficients::compute(&method, &pairs, enough);
                    measurements.push(Measurement {
                        problem: problems.len(),
                        ladder,
                        samples,
                        evaluations: got.evaluations,
                        seconds: got.seconds,
                        red: relative_euclidean_distance(&got.values, &reference.values),
                        rmd: relative_maximum_departure(&got.values, &reference.values),
                        claimed: got.error / norm(&reference.values),
                    });
                }
            }
            let [u, v, kappa, lambda] = j.m;
            problems.push(Problem {
                geometry: name,
                j: format!("l{level} m{u}-{v}-{kappa}-{lambda}"),
                reference_error: reference.error / norm(&reference.values),
            });
        }
    }
    write(&args.output, &problems, &measurements)?;
    say(summary(problems.len(), &measurements))?;
    let worst = problems.iter().map(|p| p.reference_error).fold(0.0, f64::max);
    say(format_args!("The reference's own RED is estimated at {worst:.1e} or less."))?;
    Ok(())
}

/// All T_jk of one **j**, and what they took.
struct Coefficients {
    /// Of the wavelets k, coarse to fine.
    values: Vec<f64>,
    /// Norm of the errors that the method claims.
    error: f64,
    evaluations: u64,
    seconds: f64,
}

impl Coefficients {
    /// The coefficients of `pairs`, which are in the order of [`dest_cells`], and
    /// the median CPU time of five runs, or of fewer once they took `enough` seconds.
    fn compute(method: &dyn Integrator, pairs: &[Pair<'_>], enough: f64) -> Self {
        let mut seconds = Vec::new();
        let integrals = loop {
            let clock = ThreadTime::now();
            let integrals: Vec<Integral> = pairs.iter().map(|p| method.integrate(p)).collect();
            seconds.push(clock.elapsed().as_secs_f64());
            if seconds.len() == 5 || seconds.iter().sum::<f64>() > enough {
                break integrals;
            }
        };
        seconds.sort_by(f64::total_cmp);
        let errors: Vec<f64> = integrals.iter().map(|i| i.error).collect();
        Self {
            values: wavelets(integrals.iter().map(|i| i.value).collect()),
            // The basis is orthonormal: errors of smoothing coefficients have the
            // norm of those of wavelets.
            error: norm(&errors),
            evaluations: integrals.iter().map(|i| i.evaluations).sum(),
            seconds: seconds[seconds.len() / 2],
        }
    }
}

fn norm(values: &[f64]) -> f64 {
    values.iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// The finest cells of the destination, the sixteen of a node together.
fn dest_cells() -> impl Iterator<Item = Support> {
    (0..1_usize << (4 * LEVEL)).map(|i| {
        let steps = (0..LEVEL).rev().map(|step| i >> (4 * step) & 15);
        Support::isotropic(LEVEL, steps.fold(Cell::ROOT, |cell, m| cell.child(15, m)).m)
    })
}

/// Analyses all levels: smoothing coefficients in the order of [`dest_cells`] in,
/// wavelet coefficients out, with the root's smoothing coefficient (Eq. 20).
fn wavelets(mut b: Vec<f64>) -> Vec<f64> {
    let mut stride = 1;
    while stride < b.len() {
        for node in b.chunks_mut(CHILDREN * stride) {
            let mut children: [f64; CHILDREN] = std::array::from_fn(|m| node[m * stride]);
            pull(&mut children, 15);
            for (m, child) in children.into_iter().enumerate() {
                node[m * stride] = child;
            }
        }
        stride *= CHILDREN;
    }
    b
}

fn reference_method() -> anyhow::Result<Method> {
    Ok(REFERENCE.parse()?)
}

/// Unit squares, the destination a floor of normal +y.
pub(super) fn geometries() -> anyhow::Result<Vec<(&'static str, TransportGeometry)>> {
    let floor = Polygon::rectangle(DVec3::ZERO, DVec3::Z, DVec3::X)?;
    let source = |origin, u, v| -> anyhow::Result<TransportGeometry> {
        Ok(TransportGeometry::new(Polygon::rectangle(origin, u, v)?, floor.clone()))
    };
    let rotation = DQuat::from_rotation_y(0.4) * DQuat::from_rotation_x(0.3);
    let turned = |v: DVec3| rotation * v;
    Ok(vec![
        // A window above the floor, its axes those of the floor.
        ("aligned", source(DVec3::new(0.0, 0.5, -0.5), DVec3::X, DVec3::Y)?),
        ("tilted", source(DVec3::new(0.1, 0.4, -0.6), turned(DVec3::X), turned(DVec3::Y))?),
        ("facing", source(DVec3::Y, DVec3::X, DVec3::Z)?),
        ("shared edge", source(DVec3::ZERO, DVec3::X, DVec3::Y)?),
        ("far tile", source(DVec3::new(0.5, 0.5, -6.0), DVec3::X, DVec3::Y)?),
    ])
}

/// The source function of this level that gives the destination most.
fn brightest(geometry: &TransportGeometry, level: u8) -> anyhow::Result<Support> {
    let method: Method = "visible2d:17".parse()?;
    let side = 1_u16 << level;
    let root = Support::isotropic(0, [0; 4]);
    let cells = (0..usize::from(side).pow(4)).map(|i| {
        let m = std::array::from_fn(|d| (i >> (usize::from(level) * d)) as u16 % side);
        Support::isotropic(level, m)
    });
    let light = |j: &Support| method.integrate(&Pair::new(geometry, *j, root)).value;
    let best = cells.max_by(|a, b| light(a).total_cmp(&light(b)));
    best.context("a level has at least one cell")
}

/// Writes the table of measurements and the four plots.
fn write(folder: &Path, problems: &[Problem], measurements: &[Measurement]) -> anyhow::Result<()> {
    let save = |name: &str, text: &str| super::save(&folder.join(name), text);
    fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let mut csv = String::from(
        "geometry,j,method,samples,evaluations,cpu_seconds,red,rmd,claimed_red,reference_error\n",
    );
    for m in measurements {
        let (problem, name) = (&problems[m.problem], LADDERS[m.ladder].name);
        writeln!(
            csv,
            "{},{},{name},{},{},{:.6e},{:.6e},{:.6e},{:.6e},{:.3e}",
            problem.geometry,
            problem.j,
            m.samples,
            m.evaluations,
            m.seconds,
            m.red,
            m.rmd,
            m.claimed,
            problem.reference_error
        )?;
    }
    save("integrators.csv", &csv)?;
    type Field = fn(&Measurement) -> f64;
    let errors: [(&str, &str, Field); 2] = [
        ("red", "relative Euclidean distance", |m| m.red),
        ("rmd", "relative maximum departure", |m| m.rmd),
    ];
    let costs: [(&str, &str, Field); 2] = [
        ("time", "CPU time for all coefficients, s", |m| m.seconds),
        ("evaluations", "integrand evaluations", |m| m.evaluations as f64),
    ];
    for (error_name, error_label, error) in errors {
        for (cost_name, cost_label, cost) in costs {
            let title = format!(
                "Transport coefficients: geometric mean of {} problems, K = {}",
                problems.len(),
                1 << (4 * LEVEL)
            );
            let curves = curves(measurements, |m| [cost(m), error(m)]);
            let plot = Plot { title, labels: [cost_label, error_label], curves, floor: FLOOR };
            let svg = plot.to_svg().context("no measurement to plot")?;
            save(&format!("{error_name}_{cost_name}.svg"), &svg)?;
        }
    }
    Ok(())
}

/// A curve for each method: the geometric mean over the problems of each count.
fn curves(measurements: &[Measurement], point: impl Fn(&Measurement) -> [f64; 2]) -> Vec<Curve> {
    let curve = |(index, ladder): (usize, &Ladder)| {
        let at = |samples: &&str| {
            let these = measurements.iter().filter(|m| m.ladder == index && m.samples == *samples);
            let points: Vec<[f64; 2]> = these.map(&point).collect();
            (!points.is_empty())
                .then(|| [0, 1].map(|d| geometric_mean(points.iter().map(|p| p[d]))))
        };
        Curve {
            name: ladder.name.to_owned(),
            points: ladder.samples.iter().filter_map(at).collect(),
            colour: ladder.colour,
            dashed: ladder.name.ends_with("4d"),
        }
    };
    LADDERS.iter().enumerate().map(curve).collect()
}

fn geometric_mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), v| (sum + v.ln(), count + 1.0));
    (sum / count).exp()
}

/// Who is how much faster than the baseline at each target.
fn summary(problems: usize, measurements: &[Measurement]) -> String {
    let runs = |problem: usize, ladder: usize| -> Vec<[f64; 2]> {
        let these = measurements.iter().filter(|m| m.problem == problem && m.ladder == ladder);
        these.map(|m| [m.seconds, m.red]).collect()
    };
    let baseline = LADDERS.iter().position(|l| l.name == BASELINE).unwrap_or(0);
    let mut text = format!(
        "How many times faster than {BASELINE} a RED is reached: geometric mean of the problems\n\
         where it is reached, and how many of the {problems} those are; > where {BASELINE}'s finest\n\
         grid does not reach it.\n\n{:20}",
        ""
    );
    let mut rows: Vec<String> = LADDERS.iter().map(|l| format!("{:20}", l.name)).collect();
    let mut winners = format!("{:20}", "fastest");
    for target in TARGETS {
        text += &format!("{:>22}", format!("RED {target:.0e}"));
        let mut best = (0, 0.0, "none");
        for (index, ladder) in LADDERS.iter().enumerate() {
            let mut at_least = "";
            let ratios: Vec<f64> = (0..problems)
                .filter_map(|problem| {
                    let seconds = time_to(&runs(problem, index), target)?;
                    let baseline = runs(problem, baseline);
                    let longest = baseline.last()?[0];
                    let theirs = time_to(&baseline, target).unwrap_or_else(|| {
                        at_least = ">";
                        longest
                    });
                    Some(theirs / seconds)
                })
                .collect();
            if ratios.is_empty() {
                rows[index] += &format!("{:>22}", "-");
                continue;
            }
            let ratio = geometric_mean(ratios.iter().copied());
            rows[index] += &format!("{:>22}", format!("{at_least}{ratio:.2} ({})", ratios.len()));
            if (ratios.len(), ratio) > (best.0, best.1) {
                best = (ratios.len(), ratio, ladder.name);
            }
        }
        winners += &format!("{:>22}", best.2);
    }
    format!("{text}\n{}\n{winners}\n", rows.join("\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wavelets_have_the_norm_of_the_smoothing_coefficients() {
        let smoothing: Vec<f64> = dest_cells().map(|k| f64::from(k.m[0] * 3 + k.m[3])).collect();
        let b = wavelets(smoothing.clone());
        let mean = smoothing.iter().sum::<f64>() / smoothing.len() as f64;
        // A level-l smoothing coefficient is 4^−l of a mean.
        assert!((b[0] - mean * 16.0).abs() < 1e-9, "{}", b[0]);
        assert!((norm(&b) / norm(&smoothing) - 1.0).abs() < 1e-14, "orthonormal");
        let linear = b.iter().filter(|b| b.abs() > 1e-9).count();
        // One wavelet along u and one along λ, at the root and at each child.
        assert_eq!(linear, 1 + 2 * 17, "wavelets of a linear function");
    }

    #[test]
    fn all_methods_are_compared() {
        let mut names: Vec<&str> = LADDERS.iter().map(|l| l.name).collect();
        let mut known = Method::NAMES.to_vec();
        names.sort_unstable();
        known.sort_unstable();
        assert_eq!(names, known);
        for Ladder { name, samples, .. } in LADDERS {
            for samples in samples {
                let method: Result<Method, _> = format!("{name}:{samples}").parse();
                assert!(method.is_ok(), "{method:?}");
            }
        }
    }
}
