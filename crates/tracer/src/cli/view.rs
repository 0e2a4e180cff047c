//! Flags of `tracer render` and `tracer fly`.

use clap::{Args as ClapArgs, ValueEnum};
use std::path::PathBuf;

/// What a picture holds, for `--help`.
const MODELLED: &str = "\
Modelled: emitters seen directly, with their lobes and textures; mirrors; glass, clear \
or a thin pane, with Fresnel reflection; Phong reflection of punctual lights, with hard \
shadows, range and cones; of area emitters, from the .wct file on surfaces with a patch, \
elsewhere sampled, with shadows; a constant ambient term. Base-colour, emissive, normal, \
occlusion and metallic-roughness textures, vertex colours, alpha by mask and blend, \
unlit materials.

Not modelled: shadows of objects on surfaces with a patch; light from surface to \
surface but by mirrors and glass; refraction of shadow rays; clearcoat, sheen, \
volumes, skins, morph targets. What a file has of these is named in a warning. What it \
animates is where it is at rest: `tracer fly` shows cameras, meshes and lights in motion.

A .exr holds radiance in R, G, B and, of each pixel's centre, albedo.R/G/B, normals \
N.X/Y/Z, positions P.X/Y/Z, depth along the camera's axis Z, mesh numbers id and \
places on patches wct-uv.U/V and the relative error wct-error of their radiance, \
these -1 off patches and all over with --reference, which has none. Of a crop it is the \
data window, in the whole picture's display window.";

/// How pictures become a film, for `--help`.
const FILM: &str = "\
A film from the pictures, for example:

    ffmpeg -framerate 24 -i frame.%04d.png -c:v libx264 -crf 18 -pix_fmt yuv420p flight.mp4

Ctrl-C finishes the rows begun and leaves the picture as far as it is beside the \
others, as frame.0012.partial.png; run the command again to go on.";

/// Camera rays that a pixel may have.
pub(crate) const MOST_SAMPLES: u32 = 1 << 16;

#[derive(Debug, ClapArgs)]
#[command(after_long_help = MODELLED)]
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

    #[command(flatten)]
    pub(crate) reference: Reference,
}

/// The picture without wavelets.
#[derive(Debug, ClapArgs)]
#[command(next_help_heading = "Reference")]
pub(crate) struct Reference {
    /// Sample the emitters for every camera ray instead of looking patches up,
    /// and print an estimate of the error: of the points sampled, and of there being so
    /// many camera rays a pixel.
    ///
    /// The same light as in a bake: straight from emitters to receivers, with
    /// nothing in between, so no object throws a shadow on a receiver. All else, the
    /// camera rays among it, is as without this option: what differs is the error of the
    /// wavelets.
    #[arg(long, conflicts_with = "wct")]
    pub(crate) reference: bool,

    /// Points sampled a pixel, shared by its camera rays, which are fewer if
    /// there are not four points for each.
    #[arg(long, value_name = "N", default_value_t = 256, requires = "reference",
          value_parser = clap::value_parser!(u32).range(4..=1 << 22))]
    pub(crate) spp: u32,

    /// Sample until the relative RMS error of the pixels that show a receiver is
    /// estimated to be below E, such as 0.01, instead of so many points.
    ///
    /// The error is that of the points and of the camera rays together. The latter stay as
    /// many as --samples says; where they are too few, a warning says how many to try.
    #[arg(long, value_name = "E", requires = "reference", conflicts_with = "spp",
          value_parser = error)]
    pub(crate) error: Option<f64>,
}

#[derive(Debug, ClapArgs)]
#[command(after_long_help = FILM)]
pub(crate) struct Fly {
    /// Scene to fly through: .gltf, .glb or .obj.
    pub(crate) scene: PathBuf,

    /// Animation to follow, by name; the file's first if not given.
    #[arg(long, value_name = "NAME")]
    pub(crate) animation: Option<String>,

    /// Camera to look through, by name: one that the animation moves, or any where it
    /// moves meshes or lights.
    #[arg(long, value_name = "NAME")]
    pub(crate) camera: Option<String>,

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
    /// frame.####.png. Those that exist already are skipped, unless they say that they
    /// were made with other settings or from other files, which is an error.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: String,

    /// Animated PNG to make of the pictures, which must be .png themselves: .png or .apng.
    #[arg(long, value_name = "FILE")]
    pub(crate) video: Option<PathBuf>,

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

    /// Width and height in pixels, each 65536 at most and 2^28 pixels together; 960 wide
    /// and of the camera's shape if not given.
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub(crate) size: Option<(usize, usize)>,

    /// Part to render: left, top, right and bottom in pixels, the latter two
    /// excluded. It is as in the whole picture.
    #[arg(long, value_name = "X0,Y0,X1,Y1", allow_hyphen_values = true, value_parser = crop)]
    pub(crate) crop: Option<[usize; 4]>,

    /// Camera rays per pixel; with --noise, at most.
    #[arg(long, value_name = "N", default_value_t = 16,
          value_parser = clap::value_parser!(u32).range(1..=i64::from(MOST_SAMPLES)))]
    pub(crate) samples: u32,

    /// Sample each pixel as often as its standard error needs to be this part of its
    /// radiance, or of 0.02 W m⁻² sr⁻¹ if it is darker. The first 8 rays of it and of
    /// its neighbours say how often that is.
    #[arg(long, value_name = "X", value_parser = noise)]
    pub(crate) noise: Option<f32>,

    /// Exposure of a .png, in stops.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true,
          value_parser = stops)]
    pub(crate) exposure: f32,

    /// Tone curve of a .png.
    #[arg(long, value_enum, default_value_t = Tone::Neutral)]
    pub(crate) tone: Tone,

    /// Mirror and glass surfaces in a row.
    #[arg(long, value_name = "N", default_value_t = 8)]
    pub(crate) depth: u32,

    /// Cells along a side of each emitter that lights surfaces without a patch.
    ///
    /// A shadow ray each; those that give little to a pixel are shared out among its
    /// samples, as are those to lights, but not with --noise. Of meshes that shine in more
    /// than 256 triangles and parallelograms together, each sample looks for some cells
    /// only, drawn so that they give the light of all in the mean.
    #[arg(long, value_name = "N", default_value_t = 4,
          value_parser = clap::value_parser!(u32).range(1..=256))]
    pub(crate) emitter_grid: u32,

    /// Threads to use; 0 is one per core. The picture does not depend on it.
    #[arg(short, long, value_name = "N", default_value_t = 0)]
    pub(crate) threads: usize,

    /// Another seed gives another noise, where there is any.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) seed: u64,

    /// Print what it took as JSON.
    #[arg(long)]
    pub(crate) json: bool,
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

fn noise(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(x) if 0.0 < x && x < 1.0 => Ok(x),
        _ => Err("must be above 0 and below 1, such as 0.01".to_owned()),
    }
}

pub(super) fn stops(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(x) if (-64.0..=64.0).contains(&x) => Ok(x),
        _ => Err("must be a number from -64 to 64".to_owned()),
    }
}

fn crop(text: &str) -> Result<[usize; 4], String> {
    let sides: Option<Vec<usize>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match sides.as_deref() {
        Some(&[x0, y0, x1, y1]) if x0 < x1 && y0 < y1 => Ok([x0, y0, x1, y1]),
        _ => Err("must be X0,Y0,X1,Y1 in pixels with X0 < X1 and Y0 < Y1".to_owned()),
    }
}

fn error(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(x) if (1e-5..1.0).contains(&x) => Ok(x),
        _ => Err("must be a number from 1e-5 to below 1".to_owned()),
    }
}

fn size(text: &str) -> Result<(usize, usize), String> {
    let side = |s: &str| s.parse().ok().filter(|n| (1..=65_536).contains(n));
    let parts = text.split_once('x').and_then(|(w, h)| Some((side(w)?, side(h)?)));
    parts.filter(|(w, h)| w * h <= 1 << 28).ok_or_else(|| {
        "must be WIDTHxHEIGHT in pixels, such as 960x720, each up to 65536 and 2^28 in all"
            .to_owned()
    })
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

    #[test]
    fn crops_are_two_corners_in_order() {
        assert_eq!(crop("1, 2,3,4"), Ok([1, 2, 3, 4]));
        for bad in ["", "1,2,3", "1,2,1,4", "1,4,3,2", "-1,0,2,2", "1,2,3,4,5"] {
            assert!(crop(bad).is_err(), "{bad}");
        }
    }
}
