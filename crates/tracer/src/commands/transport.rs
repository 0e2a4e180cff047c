//! `tracer transport`: single cells of transported radiance, from and to JSON.
//!
//! A case that cannot be computed gets an `error` in the output, beside the
//! others' results; only a file that is no JSON at all fails the command.

use super::stdout::say;
use crate::cli;
use crate::threads::in_pool;
use anyhow::{Context as _, bail};
use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::{Value, value::RawValue};
use std::io::Read as _;
use wrt_core::transport::{CellRule, Exact, Support, TransportGeometry};
use wrt_core::{Error, Levels, Polygon};

/// The input. Cases stay text until each is read on its own.
#[derive(Deserialize)]
struct Input<'a> {
    #[serde(borrow)]
    cases: Vec<&'a RawValue>,
}

/// What a bad case is still told apart by.
#[derive(Deserialize)]
struct Named {
    #[serde(default)]
    name: Value,
}

#[derive(Deserialize)]
struct Case {
    source: Quad,
    dest: Quad,
    emission: Emission,
    dest_level: u64,
    /// (m_u, m_v, m_κ, m_λ) of each cell to compute.
    k: Vec<[u64; 4]>,
}

#[derive(Deserialize)]
struct Quad {
    verts: Vec<[f64; 3]>,
    map: Map,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Map {
    Rect,
    Perspective,
    Bilinear,
}

#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "lowercase")]
enum Emission {
    /// The same radiance from everywhere into all directions.
    Constant { rgb: [f64; 3] },
    /// Radiance 1 in all channels within one source cell, 0 elsewhere.
    Cell { level: u64, m: [u64; 4] },
}

#[derive(Serialize)]
struct Output {
    cases: Vec<CaseResult>,
}

#[derive(Serialize)]
struct CaseResult {
    name: Value,
    #[serde(flatten)]
    result: Outcome,
}

#[derive(Serialize)]
#[serde(rename_all = "lowercase")]
enum Outcome {
    Cells(Vec<CellResult>),
    Error(String),
}

#[derive(Serialize)]
struct CellResult {
    k: [u64; 4],
    /// Mean radiance over the cell.
    rgb: [f64; 3],
    /// Estimated |found − true| / true; `null` stands for ∞.
    rel_err_est: f64,
    /// How many times the integrand was evaluated.
    evaluations: u64,
}

/// A case whose every number has been checked.
struct Checked {
    geometry: TransportGeometry,
    source: Support,
    rgb: [f64; 3],
    cells: Vec<([u64; 4], Support)>,
}

pub(crate) fn run(args: &cli::Transport) -> anyhow::Result<()> {
    let rule = match (args.method, args.tolerance) {
        (CellRule::Exact(_), Some(tolerance)) => CellRule::Exact(Exact { tolerance }),
        (CellRule::Sampled(method), Some(_)) => {
            bail!("--tolerance is for --method exact: {method} takes a number of samples")
        }
        (rule, None) => rule,
    };
    let name = args.cases.display();
    let mut text = String::new();
    if args.cases.as_os_str() == "-" {
        std::io::stdin().read_to_string(&mut text).context("reading standard input")?;
    } else {
        text = std::fs::read_to_string(&args.cases).with_context(|| format!("reading {name}"))?;
    }
    let text = without_non_numbers(&text);
    let input: Input<'_> =
        serde_json::from_str(&text).with_context(|| format!("{name} is no list of cases"))?;
    let cases = in_pool(args.threads, || {
        input.cases.par_iter().map(|case| compute(case.get(), &rule)).collect()
    })?;
    say(serde_json::to_string(&Output { cases }).context("writing the results")?)
}

fn compute(text: &str, rule: &CellRule) -> CaseResult {
    let name = serde_json::from_str(text).map_or(Value::Null, |named: Named| named.name);
    let result = match check(text) {
        Ok(case) => Outcome::Cells(
            case.cells.par_iter().map(|&(k, dest)| case.radiance(k, dest, rule)).collect(),
        ),
        Err(error) => Outcome::Error(format!("{error:#}")),
    };
    CaseResult { name, result }
}

impl Checked {
    fn radiance(&self, k: [u64; 4], dest: Support, rule: &CellRule) -> CellResult {
        let cell = rule.radiance(&self.geometry, self.source, dest);
        CellResult {
            k,
            rgb: self.rgb.map(|emitted| emitted * cell.mean),
            rel_err_est: cell.relative_error(),
            evaluations: cell.evaluations,
        }
    }
}

fn check(text: &str) -> anyhow::Result<Checked> {
    let case: Case = serde_json::from_str(text)?;
    let source = case.source.polygon().context("source")?;
    let dest = case.dest.polygon().context("dest")?;
    let (source_cell, rgb) = match case.emission {
        Emission::Constant { rgb } => (Support::isotropic(0, [0; 4]), rgb),
        Emission::Cell { level, m } => (cell(level, m).context("emission")?, [1.0; 3]),
    };
    let cells = case.k.iter().map(|&k| {
        let cell = cell(case.dest_level, k).with_context(|| format!("k = {k:?}"))?;
        Ok((k, cell))
    });
    let cells = cells.collect::<anyhow::Result<_>>()?;
    Ok(Checked { geometry: TransportGeometry::new(source, dest), source: source_cell, rgb, cells })
}

impl Quad {
    fn polygon(&self) -> Result<Polygon, Error> {
        let found = self.verts.len();
        let Ok(verts) = <[[f64; 3]; 4]>::try_from(&self.verts[..]) else {
            return Err(Error::VertexCount { found, needed: "exactly 4" });
        };
        let verts = verts.map(DVec3::from);
        match self.map {
            Map::Rect => Polygon::rectilinear_quad(verts),
            Map::Perspective => Polygon::perspective(verts),
            Map::Bilinear => Polygon::bilinear(verts),
        }
    }
}

fn cell(level: u64, m: [u64; 4]) -> anyhow::Result<Support> {
    let Some(level) = u8::try_from(level).ok().filter(|&l| l <= Levels::MAX) else {
        bail!("level {level} is above {}", Levels::MAX);
    };
    let cells = 1_u64 << level;
    let mut offsets = [0; 4];
    for (offset, m) in offsets.iter_mut().zip(m) {
        match u16::try_from(m) {
            Ok(m) if u64::from(m) < cells => *offset = m,
            _ => bail!("offset {m} at level {level}, which has {cells} cells a side"),
        }
    }
    Ok(Support::isotropic(level, offsets))
}

/// The text with `null` for NaN and ±Infinity, which some writers put into JSON:
/// the case then fails for that number, not the file.
fn without_non_numbers(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let (mut in_string, mut rest) = (false, text);
    while let Some(c) = rest.chars().next() {
        let token = ["-Infinity", "Infinity", "NaN"].into_iter().find(|t| rest.starts_with(t));
        if let Some(token) = token.filter(|_| !in_string) {
            out.push_str("null");
            rest = &rest[token.len()..];
            continue;
        }
        // A quote behind a backslash does not end its string.
        let length = if in_string && c == '\\' {
            1 + rest[1..].chars().next().map_or(0, char::len_utf8)
        } else {
            in_string ^= c == '"';
            c.len_utf8()
        };
        out.push_str(&rest[..length]);
        rest = &rest[length..];
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_bare_non_numbers_become_null() {
        let text = r#"{"NaN": [NaN, -Infinity, 1], "a\"Infinity": "é NaN\\"} Infinity"#;
        let expected = r#"{"NaN": [null, null, 1], "a\"Infinity": "é NaN\\"} null"#;
        assert_eq!(without_non_numbers(text), expected);
    }

    #[test]
    fn a_bad_case_says_what_is_wrong() {
        let square = r#"{"verts": [[0,0,0],[1,0,0],[1,1,0],[0,1,0]], "map": "rect"}"#;
        let case = |source: &str, emission: &str, level: &str, k: &str| {
            format!(
                r#"{{"name": "c", "source": {source}, "dest": {square}, "emission": {emission},
                     "dest_level": {level}, "k": {k}}}"#
            )
        };
        let constant = r#"{"type": "constant", "rgb": [1, 1, 1]}"#;
        let good = case(square, constant, "1", "[[0,1,0,1]]");
        assert!(check(&good).is_ok(), "{good}");
        let three = r#"{"verts": [[0,0,0],[1,0,0],[1,1,0]], "map": "rect"}"#;
        for (bad, part) in [
            (case(three, constant, "1", "[]"), "3 vertices"),
            (case(&square.replace("rect", "spherical"), constant, "1", "[]"), "spherical"),
            (case(&square.replace("[1,0,0]", "[1,null,0]"), constant, "1", "[]"), "null"),
            (case(&square.replace("[1,0,0]", "[1,1e999,0]"), constant, "1", "[]"), "range"),
            (case(square, constant, "17", "[[0,0,0,0]]"), "level 17"),
            (case(square, constant, "1", "[[0,2,0,0]]"), "offset 2"),
            (case(square, constant, "1", "[[0,-1,0,0]]"), "-1"),
            (
                case(square, r#"{"type": "cell", "level": 3, "m": [8,0,0,0]}"#, "0", "[]"),
                "offset 8",
            ),
        ] {
            let Err(error) = check(&bad) else { panic!("{bad} is accepted") };
            assert!(format!("{error:#}").contains(part), "{error:#}");
        }
    }
}
