//! Flags of `tracer report`.

use clap::{Args as ClapArgs, Subcommand};
use std::path::PathBuf;

#[derive(Debug, Subcommand)]
pub(crate) enum Report {
    /// Compare integration methods as the paper's Fig. 4 and 5 do.
    Integrators(Integrators),
    /// Measure rays per second.
    Rays(Rays),
}

#[derive(Debug, ClapArgs)]
pub(crate) struct Rays {
    /// Triangles of the bumpy sphere that is aimed at; rounded to whole rings.
    #[arg(long, value_name = "N", default_value_t = 100_000,
          value_parser = clap::value_parser!(u32).range(100..=20_000_000))]
    pub(crate) triangles: u32,

    /// Rays in each set.
    #[arg(long, value_name = "N", default_value_t = 1 << 20,
          value_parser = clap::value_parser!(u32).range(1..=1 << 26))]
    pub(crate) rays: u32,

    /// Repetitions, of which the median counts.
    #[arg(long, value_name = "N", default_value_t = 5,
          value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub(crate) repeats: u32,

    /// Threads to use; 0 is one per core.
    #[arg(short, long, value_name = "N", default_value_t = 1)]
    pub(crate) threads: usize,

    /// Existing folder for the mesh and the rays as raw f32 and u32, for other
    /// programs to be measured with.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) dump: Option<PathBuf>,
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
