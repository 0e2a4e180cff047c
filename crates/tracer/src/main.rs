//! `tracer`: bakes scenes to wavelet radiance and renders them from it.

mod accel;
mod bake;
mod camera;
mod cli;
mod commands;
mod emitters;
mod film;
mod flip;
mod phong;
mod plot;
mod reference;
mod render;
mod report;
mod scene;
mod threads;
mod wct_texture;
mod whitted;

use clap::Parser as _;
use std::process::ExitCode;

fn main() -> ExitCode {
    match run(&cli::Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        // As of a program that SIGPIPE ends: whoever closed the pipe has what it wanted.
        Err(error) if error.is::<commands::Closed>() => ExitCode::from(commands::Closed::EXIT_CODE),
        Err(error) => {
            // `{:#}` prints the chain on one line: what was being done, then why not.
            eprintln!("tracer: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &cli::Args) -> anyhow::Result<()> {
    match &args.command {
        cli::Command::Bake(args) => commands::bake::run(args),
        cli::Command::Render(args) => commands::render::run(args),
        cli::Command::Fly(args) => commands::fly::run(args),
        cli::Command::Compare(args) => commands::compare::run(args),
        cli::Command::Convert(args) => commands::convert::run(args),
        cli::Command::Inspect(args) => commands::inspect::run(args),
        cli::Command::Report(report) => match report {
            cli::Report { part: Some(cli::ReportPart::Integrators(args)), .. } => {
                commands::report_integrators::run(args)
            }
            cli::Report { part: Some(cli::ReportPart::Oracle(args)), .. } => {
                commands::report_oracle::run(args)
            }
            cli::Report { part: None, all } => commands::report::run(all),
            cli::Report { part: Some(cli::ReportPart::Rays(args)), .. } => {
                commands::report_rays::run(args)
            }
        },
        cli::Command::Transport(args) => commands::transport::run(args),
    }
}
