//! Flags of `tracer report`.

use clap::{Args as ClapArgs, Subcommand};
use std::path::PathBuf;

#[derive(Debug, ClapArgs)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct Report {
    #[command(subcommand)]
    pub(crate) part: Option<ReportPart>,

    #[command(flatten)]
    pub(crate) all: Everything,
}

#[derive(Debug, Subcommand)]
pub(crate) enum ReportPart {
    /// Compare integration methods as the paper's Fig. 4 and 5 do.
    Integrators(Integrators),
    /// Count what geometry alone decides, and check it by quadrature.
    Oracle(Oracle),
    /// Measure rays per second.
    Rays(Rays),
}

/// All parts, on one page.
#[derive(Debug, ClapArgs)]
pub(crate) struct Everything {
    /// Folder for index.html and a .csv file for each table; made if it does not
    /// exist.
    #[arg(short, long, value_name = "FOLDER", required = true)]
    pub(crate) output: Option<PathBuf>,

    /// Folder with the repository's scenes.
    #[arg(long, value_name = "FOLDER", default_value = "scenes")]
    pub(crate) scenes: PathBuf,

    /// Small pictures and few runs: about two minutes instead of an hour.
    #[arg(long)]
    pub(crate) quick: bool,

    /// Only these sections, by the name in their address on the page.
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    pub(crate) only: Vec<String>,
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

#[derive(Debug, ClapArgs)]
pub(crate) struct Oracle {
    /// Folder for oracle.csv; made if it does not exist.
    #[arg(short, long, value_name = "FOLDER")]
    pub(crate) output: PathBuf,

    /// The first four pairs of levels only.
    #[arg(long)]
    pub(crate) quick: bool,
}
