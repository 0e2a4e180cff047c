//! Flags of `tracer convert`.

use super::bake::fraction;
use clap::Args as ClapArgs;
use std::path::PathBuf;

/// What to store how.
#[derive(Debug, ClapArgs)]
#[command(group = clap::ArgGroup::new("how").required(true))]
pub(crate) struct Convert {
    /// The .wct file to read.
    pub(crate) input: PathBuf,

    /// The .wct file to write.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,

    /// Masks and 32-bit coefficients as they are, for other programs to read.
    #[arg(long, group = "how")]
    pub(crate) raw: bool,

    /// Haar: quantised and entropy-coded, with at most this relative L² error, per patch,
    /// on top of what the file has. A smooth file is baked again instead.
    #[arg(long, value_name = "E", group = "how", value_parser = fraction)]
    pub(crate) error: Option<f64>,
}
