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
pub(crate) use view::{Fly, MOST_SAMPLES, Render, Tone, View};
pub(crate) use weather::Weather;

use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};

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

impl Args {
    /// What was typed; ends the program where that is not to be understood, or asks for
    /// help.
    pub(crate) fn typed() -> Self {
        let mut command = with_negative_numbers(Self::command());
        let matches = command.get_matches_mut();
        Self::from_arg_matches(&matches).unwrap_or_else(|error| error.format(&mut command).exit())
    }
}

/// Lets every option take a negative number, for it to say what it takes itself: else clap
/// has advice that is of no use.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let option = |arg: clap::Arg| {
        let takes = arg.get_action().takes_values() && !arg.is_positional();
        if takes { arg.allow_negative_numbers(true) } else { arg }
    };
    command.mut_args(option).mut_subcommands(with_negative_numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_definition_is_consistent() {
        with_negative_numbers(Args::command()).debug_assert();
    }

    #[test]
    fn options_say_themselves_what_is_wrong_with_a_negative_number() {
        for (option, expected) in [
            ("--samples=-1", "-1 is not in 1..=65536"),
            ("--samples -1", "-1 is not in 1..=65536"),
            ("--noise -0.5", "must be above 0 and below 1"),
            ("--error -1", "must be a number from 1e-5 to below 1"),
            ("--crop -1,0,2,2", "must be X0,Y0,X1,Y1 in pixels"),
            ("--threads -1", "invalid value '-1' for '--threads <N>'"),
            ("--sky-irradiance -5 --size 0x0", "must be WIDTHxHEIGHT"),
        ] {
            let words = format!("tracer render a.gltf -o a.png --reference {option}");
            let command = with_negative_numbers(Args::command());
            let error = command.try_get_matches_from(words.split(' ')).expect_err(option);
            let text = error.to_string();
            assert!(text.contains(expected) && !text.contains("tip:"), "{option}: {text}");
        }
        let words = "tracer render a.gltf -o a.png --exposure -1.5 --sun -30,10";
        let found = with_negative_numbers(Args::command()).try_get_matches_from(words.split(' '));
        assert!(found.is_ok(), "{found:?}");
    }
}
