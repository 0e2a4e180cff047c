//! The command line: what may be typed, and nothing that acts on it.

mod bake;
mod compare;
mod convert;
mod inspect;
mod report;
mod transport;
mod view;
mod weather;

pub(crate) use bake::{Accuracy, Bake, Basis};
pub(crate) use compare::Compare;
pub(crate) use convert::Convert;
pub(crate) use inspect::Inspect;
pub(crate) use report::{Everything, Integrators, Oracle, Rays, Report, ReportPart};
pub(crate) use transport::Transport;
pub(crate) use view::{Fly, Render, Tone, View};
pub(crate) use weather::Weather;

use clap::{Parser, Subcommand};

/// Renders scenes lit by precomputed wavelet radiance.
///
/// `bake` computes once how light from windows and lamps leaves each receiving
/// surface, for every position and direction; `render` then looks it up like a
/// texture, so that further views are cheap and free of noise.
#[derive(Debug, Parser)]
#[command(version, about, arg_required_else_help = true)]
pub(crate) struct Args {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Compute the light that a scene's receivers reflect and write it to a .wct file.
    Bake(Bake),
    /// Render a picture of a scene, sampling a .wct file.
    Render(Render),
    /// Render the pictures of a camera's flight.
    Fly(Fly),
    /// Show what a .wct file holds, as a table, as JSON or as pictures.
    Inspect(Inspect),
    /// Store a .wct file's radiance another way: smaller, or for other programs.
    Convert(Convert),
    /// Say how far apart two pictures are, and where.
    Compare(Compare),
    /// Compute single cells of transported radiance, with their error estimates.
    Transport(Transport),
    /// Measure this build on this machine: speed against error, for every part.
    Report(Report),
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory as _;

    #[test]
    fn the_definition_is_consistent() {
        Args::command().debug_assert();
    }
}
