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

use std::process::ExitCode;

fn main() -> ExitCode {
    match run(&cli::Args::typed()) {
        Ok(()) => ExitCode::SUCCESS,
        // As of a program that SIGPIPE ends: whoever closed the pipe has what it wanted.
        Err(error) if error.is::<commands::Closed>() => ExitCode::from(commands::Closed::EXIT_CODE),
        Err(error) => {
            eprintln!("tracer: {}", on_one_line(&error));
            ExitCode::FAILURE
        }
    }
}

/// What was being done, then why not. Of errors that say what their cause says, and hand it
/// on as well, once.
fn on_one_line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if line.is_empty() {
            line = cause;
        } else if !line.ends_with(&cause) {
            line = format!("{line}: {cause}");
        }
    }
    line
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

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::{Context as _, anyhow};

    #[test]
    fn a_cause_is_told_once() {
        let error = anyhow!("no such file").context("IO: no such file").context("reading a.exr");
        assert_eq!(on_one_line(&error), "reading a.exr: IO: no such file");
        let error = Err::<(), _>(anyhow!("b")).context("a").expect_err("one");
        assert_eq!(on_one_line(&error), "a: b");
    }
}
