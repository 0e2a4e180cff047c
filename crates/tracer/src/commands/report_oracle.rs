//! `tracer report oracle`: how often geometry alone decides a transport coefficient
//! (§7.2.4.1), and that quadrature agrees where it does.

use super::report_integrators::geometries;
use super::stdout::say;
use crate::cli::Oracle;
use anyhow::Context as _;
use rayon::prelude::*;
use std::{fmt::Write as _, fs};
use wrt_core::transport::{
    Exact, Integrator as _, Pair, Support, TransportGeometry, Verdict, oracle,
};

/// Pairs of cells that are asked about at each level, at the most.
const MOST_PAIRS: usize = 1 << 16;

/// Relative error that the quadrature is asked for.
const TOLERANCE: f64 = 1e-9;

/// Levels of source and destination cells: the recursion carries coarse cells of a
/// smooth source to the finest ones of the destination.
const LEVELS: [[u8; 2]; 7] = [[0, 1], [1, 1], [2, 2], [0, 3], [2, 3], [0, 5], [2, 5]];

/// The answers at two levels of one geometry.
#[derive(Clone, Copy, Debug, Default)]
struct Answers {
    zero: usize,
    whole: usize,
    unknown: usize,
    /// The largest |answer − quadrature|, in units of the largest T_jk there can be.
    departure: f64,
    /// How many answers differ by more than the quadrature's own error.
    wrong: usize,
}

impl Answers {
    fn of(pair: &Pair<'_>, most: f64) -> Self {
        let mut answers = Self::default();
        let answer = match oracle(pair) {
            Verdict::Unknown => return Self { unknown: 1, ..answers },
            Verdict::Zero => {
                answers.zero = 1;
                0.0
            }
            Verdict::Whole(t) => {
                answers.whole = 1;
                t
            }
        };
        let found = Exact { tolerance: TOLERANCE }.integrate(pair);
        let off = (found.value - answer).abs();
        answers.departure = off / most;
        answers.wrong = usize::from(off > found.error + f64::EPSILON * most);
        answers
    }

    fn and(self, other: Self) -> Self {
        Self {
            zero: self.zero + other.zero,
            whole: self.whole + other.whole,
            unknown: self.unknown + other.unknown,
            departure: self.departure.max(other.departure),
            wrong: self.wrong + other.wrong,
        }
    }

    fn pairs(&self) -> usize {
        self.zero + self.whole + self.unknown
    }
}

/// Asks, writes `oracle.csv` and prints the table.
pub(crate) fn run(args: &Oracle) -> anyhow::Result<()> {
    let levels = if args.quick { &LEVELS[..4] } else { &LEVELS[..] };
    let mut csv =
        String::from("geometry,source_level,dest_level,pairs,zero,whole,unknown,departure,wrong\n");
    say(format_args!(
        "{:12} {:>6} {:>6} {:>8} {:>8} {:>8} {:>10} {:>6}",
        "geometry", "levels", "pairs", "zero", "whole", "unknown", "departure", "wrong"
    ))?;
    for (name, geometry) in geometries()? {
        for &[source, dest] in levels {
            let answers = ask(&geometry, source, dest);
            let Answers { zero, whole, unknown, departure, wrong } = answers;
            let pairs = answers.pairs();
            let share = |part: usize| format!("{:.2} %", 100.0 * part as f64 / pairs as f64);
            say(format_args!(
                "{name:12} {:>6} {pairs:6} {:>8} {:>8} {:>8} {departure:10.1e} {wrong:6}",
                format!("{source}, {dest}"),
                share(zero),
                share(whole),
                share(unknown)
            ))?;
            writeln!(
                csv,
                "{name},{source},{dest},{pairs},{zero},{whole},{unknown},{departure:.3e},{wrong}"
            )?;
        }
    }
    let folder = &args.output;
    fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let path = folder.join("oracle.csv");
    super::save(&path, &csv)
}

/// All pairs of two levels' cells, or as many of them well spread.
fn ask(geometry: &TransportGeometry, source: u8, dest: u8) -> Answers {
    let bits = 4 * u32::from(source);
    let all = 1_u64 << (bits + 4 * u32::from(dest));
    let asked = all.min(MOST_PAIRS as u64);
    let cell = |level: u8, i: u64| {
        let side = u32::from(level);
        let m = [0, 1, 2, 3].map(|d| (i >> (side * d) & ((1 << side) - 1)) as u16);
        Support::isotropic(level, m)
    };
    (0..asked)
        .into_par_iter()
        .map(|i| {
            // An odd factor visits each pair once; the golden ratio spreads them.
            let i = if asked == all { i } else { i.wrapping_mul(0x9e37_79b9_7f4a_7c15) % all };
            let (j, k) = (cell(source, i & ((1 << bits) - 1)), cell(dest, i >> bits));
            let pair = Pair::new(geometry, j, k);
            // T = 4^(l_j + l_k) ∬ G A, with A and ∬ at most those of the cell.
            let most = pair.scale() / (k.scale() * k.scale());
            Answers::of(&pair, most)
        })
        .reduce(Answers::default, Answers::and)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every answer, over many pairs of cells of five geometries, is quadrature's.
    #[test]
    fn no_answer_is_wrong() {
        for (name, geometry) in geometries().expect("geometries") {
            let answers = [[1, 1], [0, 3]].map(|[j, k]| ask(&geometry, j, k));
            assert_eq!((answers[0].pairs(), answers[1].pairs()), (256, 4096));
            assert!(answers[0].zero > 0, "{name}: {answers:?}");
            assert_eq!(answers.map(|a| a.wrong), [0, 0], "{name}: {answers:?}");
            let near = name != "far tile" && name != "facing";
            assert!(answers[1].whole > 0 || !near, "{name}: {answers:?}");
        }
    }
}
