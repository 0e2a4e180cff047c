//! Flags of `tracer compare`.

use super::Tone;
use clap::Args as ClapArgs;
use std::path::PathBuf;

/// Which pictures, and how they are shown.
#[derive(Debug, ClapArgs)]
pub(crate) struct Compare {
    /// Picture to judge: .png, or .exr of linear radiance.
    pub(crate) test: PathBuf,

    /// Picture to judge it by, of the same size.
    pub(crate) reference: PathBuf,

    /// Picture of FLIP to write, .png or .exr: black where no difference is seen,
    /// through purple and orange to white.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,

    /// Exposure at which a .exr is seen, in stops.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true,
          value_parser = super::view::stops)]
    pub(crate) exposure: f32,

    /// Tone curve through which a .exr is seen.
    #[arg(long, value_enum, default_value_t = Tone::Neutral)]
    pub(crate) tone: Tone,

    /// Pixels a degree of the visual angle; that of a screen 3840 pixels wide seen
    /// from its width away if not given.
    #[arg(long, value_name = "N", value_parser = density)]
    pub(crate) density: Option<f32>,

    /// Print JSON instead of a table.
    #[arg(long)]
    pub(crate) json: bool,
}

fn density(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(x) if (1.0..=1000.0).contains(&x) => Ok(x),
        _ => Err("must be from 1 to 1000".to_owned()),
    }
}
