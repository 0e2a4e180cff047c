//! Flags of `tracer bake`.

use anyhow::bail;
use clap::{Args as ClapArgs, Parser, ValueEnum};
use std::path::PathBuf;
use wrt_core::legendre::Orders;
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

    #[command(flatten)]
    pub(crate) need: Need,

    /// Haar: store the incident radiance of each receiver too, as NAME.incident.
    #[arg(long)]
    pub(crate) incident: bool,

    /// Haar: store masks and 32-bit coefficients as they are, for other programs to read,
    /// instead of quantised and entropy-coded in 5 to 20 times fewer bytes.
    #[arg(long)]
    pub(crate) raw: bool,

    /// Threads to use; 0 is one per core. The result does not depend on it.
    #[arg(short, long, value_name = "N", default_value_t = 0)]
    pub(crate) threads: usize,
}

/// For whom to bake.
#[derive(Clone, Debug, ClapArgs)]
#[command(next_help_heading = "Need")]
pub(crate) struct Need {
    /// Smooth: keep the error only where the cameras of the animation NAME look, at any
    /// rate of pictures, for pictures up to twice as wide as high. Half the bytes, for a
    /// flight alone.
    ///
    /// For all other positions and directions there is a coarser approximation, off by
    /// up to some 30 %. The file says for which animation it is, and `render` and `fly` warn
    /// where a camera sees more. What objects hide counts as seen. What is seen in
    /// mirrors and through refracting glass does not: it may be coarser.
    #[arg(long, value_name = "NAME")]
    pub(crate) for_animation: Option<String>,

    /// Metres that a camera may be off the animation's path, and a point outside its
    /// picture. If not given: 2 % of the diagonal of the box around the path and all
    /// receivers.
    #[arg(long, value_name = "M", requires = "for_animation", value_parser = margin,
          allow_negative_numbers = true)]
    pub(crate) margin: Option<f64>,
}

/// What a patch's radiance is expanded in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Basis {
    /// Legendre polynomials on cells that follow the radiance: for radiance that
    /// leaves surfaces.
    Smooth,
    /// The paper's boxes, of equal levels everywhere.
    Haar,
}

/// How finely to bake.
#[derive(Clone, Debug, ClapArgs)]
#[command(next_help_heading = "Accuracy")]
pub(crate) struct Accuracy {
    /// What the radiance is expanded in. If not given: haar where an option asks for
    /// it that is haar's alone, and smooth otherwise.
    #[arg(long, value_enum)]
    pub(crate) basis: Option<Basis>,

    /// Smooth: relative RMS error of the radiance of each patch, over its positions
    /// and the directions that see it, as a fraction; 0.002 if not given.
    ///
    /// Decides the size and the orders of all cells, and how coefficients are rounded.
    #[arg(long, value_name = "E", value_parser = error)]
    pub(crate) error: Option<f64>,

    /// Smooth: highest orders of the polynomials in position and in direction, each 1 to
    /// 7: degrees + 1. Higher ones take fewer bytes and longer look-ups.
    #[arg(long, value_name = "P,Q", default_value = "4,4", value_parser = orders)]
    pub(crate) orders: Orders,

    /// Haar: level of position and direction: 2^L cells along each of u, v, κ, λ.
    ///
    /// Time and memory grow up to 16-fold for each level. If not given: 4 for
    /// position and 6 for direction, which is as many cells as level 5 where
    /// reflected light needs them.
    #[arg(long, value_name = "L", value_parser = clap::value_parser!(u8).range(..=7))]
    pub(crate) level: Option<u8>,

    /// Haar: another level for direction (κ, λ) than for position.
    #[arg(long, value_name = "L", value_parser = clap::value_parser!(u8).range(..=8))]
    pub(crate) direction_level: Option<u8>,

    /// Haar: relative L² error that quantisation (with --raw, thresholding) may add,
    /// per patch; 0 keeps all; 0.002 if not given.
    #[arg(long, value_name = "E", value_parser = fraction)]
    pub(crate) threshold: Option<f64>,

    /// Haar: remove this fraction of the full basis instead: 0.95 keeps 5 % of the
    /// coefficients of each patch, as they are.
    #[arg(long, value_name = "F", conflicts_with = "threshold", value_parser = fraction)]
    pub(crate) compress: Option<f64>,

    /// Haar: relative L² error that transport may have, per emitter and patch: each
    /// direction cell is sampled as finely as that takes; 0.01 if not given.
    #[arg(long, value_name = "E", value_parser = tolerance)]
    pub(crate) transport_error: Option<f64>,

    /// Haar: sample this many directions along each side of a direction cell instead,
    /// whatever the error.
    #[arg(long, value_name = "N", conflicts_with = "transport_error",
          value_parser = clap::value_parser!(u32).range(1..=64))]
    pub(crate) samples: Option<u32>,

    /// Haar: transport by the paper's recursion with this integration rule, such as
    /// trapezoid2d:5, instead of whole blocks. Slow.
    #[arg(long, value_name = "RULE", conflicts_with_all = ["transport_error", "samples"])]
    pub(crate) recursion: Option<Method>,

    /// Points per patch at which the result is checked against direct quadrature;
    /// 0 leaves the error unestimated.
    #[arg(long, value_name = "N", default_value_t = 64,
          value_parser = clap::value_parser!(u32).range(..=100_000))]
    pub(crate) checks: u32,
}

impl Accuracy {
    /// The basis that is asked for.
    ///
    /// # Errors
    ///
    /// If options of both bases are given.
    pub(crate) fn basis(&self) -> anyhow::Result<Basis> {
        let haar = [
            ("--level", self.level.is_some()),
            ("--direction-level", self.direction_level.is_some()),
            ("--threshold", self.threshold.is_some()),
            ("--compress", self.compress.is_some()),
            ("--transport-error", self.transport_error.is_some()),
            ("--samples", self.samples.is_some()),
            ("--recursion", self.recursion.is_some()),
        ];
        let haar = haar.into_iter().find_map(|(name, given)| given.then_some(name));
        match (self.basis, haar) {
            (Some(Basis::Smooth), Some(option)) => {
                bail!("{option} is for --basis haar; a smooth basis takes --error")
            }
            (None, Some(option)) if self.error.is_some() => {
                bail!("{option} is for the Haar basis, which --error is not")
            }
            (Some(Basis::Haar), _) | (None, Some(_)) if self.orders != Orders::default() => {
                bail!("--orders is for --basis smooth; the Haar basis has order 1")
            }
            (Some(Basis::Haar), _) if self.error.is_some() => {
                bail!("--error is for --basis smooth; the Haar basis takes --level")
            }
            (Some(basis), _) => Ok(basis),
            (None, Some(_)) => Ok(Basis::Haar),
            (None, None) => Ok(Basis::Smooth),
        }
    }

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

fn orders(text: &str) -> Result<Orders, String> {
    let parse = |part: &str| part.trim().parse().ok().filter(|p| (1..=7).contains(p));
    text.split_once(',')
        .and_then(|(p, q)| Some(Orders { position: parse(p)?, direction: parse(q)? }))
        .ok_or_else(|| "must be two numbers from 1 to 7 with a comma between".to_owned())
}

fn error(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(x) if (1e-5..=0.5).contains(&x) => Ok(x),
        _ => Err("must be a number from 1e-5 to 0.5".to_owned()),
    }
}

fn margin(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x >= 0.0 && x.is_finite() => Ok(x),
        _ => Err("must be a length of 0 or more, in metres".to_owned()),
    }
}

pub(super) fn fraction(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(x) if (0.0..1.0).contains(&x) => Ok(x),
        _ => Err("must be a number from 0 to below 1".to_owned()),
    }
}

fn tolerance(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(x) if (1e-6..1.0).contains(&x) => Ok(x),
        _ => Err("must be a number from 1e-6 to below 1".to_owned()),
    }
}
