//! The command line: what may be typed, and nothing that acts on it.

use clap::{Args as ClapArgs, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;
use wrt_core::transport::{CellRule, Exact, Method};

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
    /// Compute single cells of transported radiance, with their error estimates.
    Transport(Transport),
    /// Measure the program itself.
    #[command(subcommand)]
    Report(Report),
}

#[derive(Debug, ClapArgs)]
pub(crate) struct Bake {
    /// Scene to bake: .gltf, .glb or .obj.
    pub(crate) scene: PathBuf,

    /// The .wct file to write.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,

    #[command(flatten)]
    pub(crate) accuracy: Accuracy,

    /// Store the incident radiance of each receiver too, as NAME.incident.
    #[arg(long)]
    pub(crate) incident: bool,

    /// Threads to use; 0 is one per core. The result does not depend on it.
    #[arg(short, long, value_name = "N", default_value_t = 0)]
    pub(crate) threads: usize,
}

/// How finely to bake.
#[derive(Clone, Debug, ClapArgs)]
#[command(next_help_heading = "Accuracy")]
pub(crate) struct Accuracy {
    /// Level of position and direction: 2^L cells along each of u, v, κ, λ.
    ///
    /// Time and memory grow up to 16-fold for each level. If not given: 4 for
    /// position and 6 for direction, which is as many cells as level 5 where
    /// reflected light needs them.
    #[arg(long, value_name = "L", value_parser = clap::value_parser!(u8).range(..=7))]
    pub(crate) level: Option<u8>,

    /// Another level for direction (κ, λ) than for position.
    #[arg(long, value_name = "L", value_parser = clap::value_parser!(u8).range(..=8))]
    pub(crate) direction_level: Option<u8>,

    /// Relative L² error that thresholding may add, per patch; 0 keeps all.
    #[arg(long, value_name = "E", default_value_t = 2e-3, value_parser = fraction)]
    pub(crate) threshold: f64,

    /// Remove this fraction of the full basis instead: 0.95 keeps 5 % of the
    /// coefficients of each patch.
    #[arg(long, value_name = "F", conflicts_with = "threshold", value_parser = fraction)]
    pub(crate) compress: Option<f64>,

    /// Directions sampled along each side of a direction cell.
    #[arg(long, value_name = "N", default_value_t = 8,
          value_parser = clap::value_parser!(u32).range(1..=64))]
    pub(crate) samples: u32,

    /// Transport by the paper's recursion with this integration rule, such as
    /// trapezoid2d:5, instead of whole blocks. Slow.
    #[arg(long, value_name = "RULE")]
    pub(crate) recursion: Option<Method>,

    /// Points per patch at which the result is checked against direct quadrature;
    /// 0 leaves the error unestimated.
    #[arg(long, value_name = "N", default_value_t = 64,
          value_parser = clap::value_parser!(u32).range(..=100_000))]
    pub(crate) checks: u32,
}

impl Accuracy {
    /// The levels of position and of direction.
    pub(crate) fn levels(&self) -> (u8, u8) {
        let position = self.level.unwrap_or(4);
        (position, self.direction_level.or(self.level).unwrap_or(6))
    }
}

impl Default for Accuracy {
    /// What clap gives where nothing is typed.
    fn default() -> Self {
        #[derive(Parser)]
        struct Nothing {
            #[command(flatten)]
            accuracy: Accuracy,
        }
        Nothing::parse_from(["tracer"]).accuracy
    }
}

#[derive(Debug, ClapArgs)]
pub(crate) struct Render {
    /// Scene to render: .gltf, .glb or .obj.
    pub(crate) scene: PathBuf,

    /// Camera to look through, by name; the file's first if not given.
    #[arg(long, value_name = "NAME")]
    pub(crate) camera: Option<String>,

    /// Picture to write: .png, or .exr for linear radiance.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,

    #[command(flatten)]
    pub(crate) view: View,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct Fly {
    /// Scene to fly through: .gltf, .glb or .obj.
    pub(crate) scene: PathBuf,

    /// Animation to follow, by name; the file's first if not given.
    #[arg(long, value_name = "NAME")]
    pub(crate) animation: Option<String>,

    /// Pictures a second.
    #[arg(long, default_value_t = 24.0, value_parser = rate)]
    pub(crate) fps: f64,

    /// First picture, from 0.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) start: usize,

    /// Last picture; that of the animation's end if not given.
    #[arg(long, value_name = "N")]
    pub(crate) end: Option<usize>,

    /// Pictures to write, with one row of # for the number, such as
    /// frame.####.png. Those that exist already are skipped.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: String,

    #[command(flatten)]
    pub(crate) view: View,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct Transport {
    /// Cases to compute: a .json file, or - for standard input.
    pub(crate) cases: PathBuf,

    /// `exact`, or an integration rule such as trapezoid2d:17.
    #[arg(long, value_name = "RULE", default_value = "exact", value_parser = rule)]
    pub(crate) method: CellRule,

    /// Relative error that `exact` aims at; 1e-10 if not given.
    #[arg(long, value_name = "T", value_parser = tolerance)]
    pub(crate) tolerance: Option<f64>,

    /// Threads to use; 0 is one per core. The result does not depend on it.
    #[arg(short, long, value_name = "N", default_value_t = 0)]
    pub(crate) threads: usize,
}

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

/// How a picture is made, whatever it is of.
#[derive(Debug, ClapArgs)]
pub(crate) struct View {
    /// Radiance made by `tracer bake` from the same scene. Without it the scene
    /// is baked in memory first.
    #[arg(long, value_name = "FILE")]
    pub(crate) wct: Option<PathBuf>,

    /// Width and height in pixels; 960 wide and of the camera's shape if not given.
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub(crate) size: Option<(usize, usize)>,

    /// Camera rays per pixel.
    #[arg(long, visible_alias = "spp", value_name = "N", default_value_t = 16,
          value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub(crate) samples: u32,

    /// Exposure of a .png, in stops.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub(crate) exposure: f32,

    /// Tone curve of a .png.
    #[arg(long, value_enum, default_value_t = Tone::Neutral)]
    pub(crate) tone: Tone,

    /// Mirror and glass surfaces in a row.
    #[arg(long, value_name = "N", default_value_t = 8)]
    pub(crate) depth: u32,

    /// Cells along a side of each emitter that lights surfaces without a patch;
    /// one shadow ray each.
    #[arg(long, value_name = "N", default_value_t = 4,
          value_parser = clap::value_parser!(u32).range(1..=256))]
    pub(crate) emitter_grid: u32,

    /// Threads to use; 0 is one per core. The picture does not depend on it.
    #[arg(short, long, value_name = "N", default_value_t = 0)]
    pub(crate) threads: usize,

    /// Another seed gives another noise, where there is any.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) seed: u64,
}

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
    #[arg(long, value_name = "STOPS", allow_negative_numbers = true, help_heading = "Pictures")]
    pub(crate) exposure: Option<f32>,
}

/// How radiance is fitted to a display.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum Tone {
    /// Clamp.
    None,
    /// Khronos PBR Neutral.
    Neutral,
    /// AgX.
    Agx,
}

fn rule(text: &str) -> Result<CellRule, String> {
    if text == "exact" {
        return Ok(CellRule::Exact(Exact { tolerance: 1e-10 }));
    }
    text.parse::<Method>().map(CellRule::from).map_err(|error| error.to_string())
}

fn tolerance(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(x) if 0.0 < x && x < 1.0 => Ok(x),
        _ => Err("must be a number above 0 and below 1".to_owned()),
    }
}

fn fraction(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(x) if (0.0..1.0).contains(&x) => Ok(x),
        _ => Err("must be a number from 0 to below 1".to_owned()),
    }
}

fn rate(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(x) if 0.0 < x && x <= 1e6 => Ok(x),
        _ => Err("must be a positive number of pictures a second".to_owned()),
    }
}

fn size(text: &str) -> Result<(usize, usize), String> {
    let side = |s: &str| s.parse().ok().filter(|n| (1..=65_536).contains(n));
    let parts = text.split_once('x').and_then(|(w, h)| Some((side(w)?, side(h)?)));
    parts
        .filter(|(w, h)| w * h <= 1 << 28)
        .ok_or_else(|| "must be WIDTHxHEIGHT in pixels, such as 960x720".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory as _;

    #[test]
    fn the_definition_is_consistent() {
        Args::command().debug_assert();
    }

    #[test]
    fn sizes_are_width_then_height() {
        assert_eq!(size("640x480"), Ok((640, 480)));
        for bad in ["640", "0x3", "axb", "70000x2", "65536x65536"] {
            assert!(size(bad).is_err(), "{bad}");
        }
    }
}
