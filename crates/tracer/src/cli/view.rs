//! Flags of `tracer render` and `tracer fly`.

use clap::{Args as ClapArgs, ValueEnum};
use std::path::PathBuf;

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

/// How a picture is made, whatever it is of.
#[derive(Debug, ClapArgs)]
pub(crate) struct View {
    /// Radiance made by `tracer bake` from the same scene. Without it the scene
    /// is baked in memory first.
    #[arg(long, value_name = "FILE")]
    pub(crate) wct: Option<PathBuf>,

    #[command(flatten)]
    pub(crate) weather: super::Weather,

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

    #[test]
    fn sizes_are_width_then_height() {
        assert_eq!(size("640x480"), Ok((640, 480)));
        for bad in ["640", "0x3", "axb", "70000x2", "65536x65536"] {
            assert!(size(bad).is_err(), "{bad}");
        }
    }
}
