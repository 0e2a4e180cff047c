//! Flags of `tracer inspect`.

use clap::Args as ClapArgs;
use std::path::PathBuf;

/// What to print and draw.
#[derive(Debug, ClapArgs)]
pub(crate) struct Inspect {
    /// File to read.
    pub(crate) file: PathBuf,

    /// Only this patch.
    #[arg(long, value_name = "NAME")]
    pub(crate) patch: Option<String>,

    /// Print JSON instead of a table.
    #[arg(long)]
    pub(crate) json: bool,

    /// Draw the radiance in all directions: a matrix of position images, κ to the
    /// right and λ up, as .png or .exr.
    ///
    /// Patches that tile a rectangle are drawn together; else, the one with the
    /// most energy.
    #[arg(long, value_name = "FILE", help_heading = "Pictures")]
    pub(crate) matrix: Option<PathBuf>,

    /// Draw the 4 × 4 brightest neighbouring directions, enlarged.
    #[arg(long, value_name = "FILE", help_heading = "Pictures")]
    pub(crate) detail: Option<PathBuf>,

    /// Exposure of a .png, in stops; if not given, all but the brightest 1 % of
    /// the pixels that are not black are below white.
    #[arg(long, value_name = "STOPS", allow_negative_numbers = true, help_heading = "Pictures",
          value_parser = super::view::stops)]
    pub(crate) exposure: Option<f32>,
}
