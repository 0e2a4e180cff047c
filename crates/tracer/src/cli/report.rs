//! Flags of `tracer report`.

use clap::{Args as ClapArgs, Subcommand};
use std::path::PathBuf;

#[derive(Debug, Subcommand)]
pub(crate) enum Report {
    /// Compare integration methods as the paper's Fig. 4 and 5 do.
    Integrators(Integrators),
}

#[derive(Debug, ClapArgs)]
pub(crate) struct Integrators {
    /// Folder for integrators.csv and the plots; made if it does not exist.
    #[arg(short, long, value_name = "FOLDER")]
    pub(crate) output: PathBuf,

    /// Two geometries and few samples: seconds instead of minutes.
    #[arg(long)]
    pub(crate) quick: bool,
}
