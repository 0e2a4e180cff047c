//! Flags of `tracer report`.

use clap::{Args as ClapArgs, Subcommand};
use std::path::PathBuf;

#[derive(Debug, Subcommand)]
pub(crate) enum Report {
    /// Compare integration methods as the paper's Fig. 4 and 5 do.
    Integrators(Integrators),
    /// Count what geometry alone decides, and check it by quadrature.
    Oracle(Oracle),
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

#[derive(Debug, ClapArgs)]
pub(crate) struct Oracle {
    /// Folder for oracle.csv; made if it does not exist.
    #[arg(short, long, value_name = "FOLDER")]
    pub(crate) output: PathBuf,

    /// The first four pairs of levels only.
    #[arg(long)]
    pub(crate) quick: bool,
}
