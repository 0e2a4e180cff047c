//! Flags of `tracer transport`.

use clap::Args as ClapArgs;
use std::path::PathBuf;
use wrt_core::transport::{CellRule, Exact, Method};

#[derive(Debug, ClapArgs)]
pub(crate) struct Transport {
    /// Cases to compute: a .json file, or - for standard input.
    pub(crate) cases: PathBuf,

    /// `exact`, or an integration rule such as trapezoid2d:17.
    #[arg(long, value_name = "RULE", default_value = "exact", value_parser = rule)]
    pub(crate) method: CellRule,

    /// Relative error that `exact` aims at; 1e-10 if not given.
    #[arg(long, value_name = "T", value_parser = tolerance)]
    pub(crate) tolerance: Option<f64>,

    /// Threads to use; 0 is one per core. The result does not depend on it.
    #[arg(short, long, value_name = "N", default_value_t = 0)]
    pub(crate) threads: usize,
}

fn rule(text: &str) -> Result<CellRule, String> {
    if text == "exact" {
        return Ok(CellRule::Exact(Exact { tolerance: 1e-10 }));
    }
    text.parse::<Method>().map(CellRule::from).map_err(|error| error.to_string())
}

fn tolerance(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(x) if 0.0 < x && x < 1.0 => Ok(x),
        _ => Err("must be a number above 0 and below 1".to_owned()),
    }
}
