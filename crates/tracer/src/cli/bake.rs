//! Flags of `tracer bake`.

use clap::{Args as ClapArgs, Parser};
use std::path::PathBuf;
use wrt_core::transport::Method;

#[derive(Debug, ClapArgs)]
pub(crate) struct Bake {
    /// Scene to bake: .gltf, .glb or .obj.
    pub(crate) scene: PathBuf,

    /// The .wct file to write.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,

    #[command(flatten)]
    pub(crate) accuracy: Accuracy,

    #[command(flatten)]
    pub(crate) weather: super::Weather,

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

fn fraction(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(x) if (0.0..1.0).contains(&x) => Ok(x),
        _ => Err("must be a number from 0 to below 1".to_owned()),
    }
}
