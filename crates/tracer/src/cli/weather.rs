//! Flags of the light that comes in through the windows.

use crate::scene::weather::{GROUND_ALBEDO, SKY_IRRADIANCE, SUN_IRRADIANCE};
use clap::{Args as ClapArgs, ValueEnum};
use wrt_core::{Sky, SkyModel, Sun};

/// Weather instead of what a scene's windows emit.
#[derive(Clone, Debug, Default, ClapArgs)]
#[command(next_help_heading = "Weather")]
pub(crate) struct Weather {
    /// Light the windows from outside by this sky. Give `render` the flags that
    /// `bake` had.
    ///
    /// Windows are the surfaces whose material has `extras.wrt.glazing`, or else all
    /// that emit; their emission gives the colour of the glass. See scenes/README.md.
    #[arg(long, value_enum, value_name = "MODEL")]
    sky: Option<Model>,

    /// Azimuth of the sun, from north (-Z) towards east (+X), and elevation, in degrees.
    /// Without --sky: a clear sky.
    ///
    /// Its light through clear glass is not baked: rays bring it when rendering, with
    /// shadows. What the glazing scatters is baked.
    #[arg(long, value_name = "AZIMUTH,ELEVATION", allow_hyphen_values = true,
          value_parser = angles)]
    sun: Option<[f64; 2]>,

    /// Irradiance of the ground by the sky without the sun, in W/m2 [default: 100].
    #[arg(long, value_name = "E")]
    sky_irradiance: Option<f64>,

    /// Irradiance by the sun of a surface that faces it, in W/m2 [default: 500].
    #[arg(long, value_name = "E", requires = "sun")]
    sun_irradiance: Option<f64>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Model {
    /// The same radiance everywhere.
    Uniform,
    /// CIE overcast: three times as bright at the zenith as at the horizon.
    Overcast,
    /// Perez all-weather, by the irradiances of sky and sun; needs --sun.
    Clear,
}

impl Weather {
    /// What was asked for, if anything.
    ///
    /// # Errors
    ///
    /// If a value is out of its range, or a clear sky has no sun.
    pub(crate) fn sky(&self) -> anyhow::Result<Option<Sky>> {
        let model = match (self.sky, self.sun) {
            (None, None) if self.sky_irradiance.is_some() => {
                anyhow::bail!("--sky-irradiance needs --sky or --sun")
            }
            (None, None) => return Ok(None),
            (Some(Model::Clear), None) => anyhow::bail!("--sky clear needs --sun"),
            (Some(Model::Uniform), _) => SkyModel::Uniform,
            (Some(Model::Overcast), _) => SkyModel::Overcast,
            (Some(Model::Clear) | None, Some(_)) => SkyModel::Clear,
        };
        let irradiance = self.sun_irradiance.unwrap_or(SUN_IRRADIANCE);
        let sun = self.sun.map(|[azimuth, elevation]| Sun::new(azimuth, elevation, irradiance));
        let diffuse = self.sky_irradiance.unwrap_or(SKY_IRRADIANCE);
        Ok(Some(Sky::new(model, diffuse, sun.transpose()?, GROUND_ALBEDO)?))
    }
}

fn angles(text: &str) -> Result<[f64; 2], String> {
    let parse = |s: &str| s.trim().parse::<f64>().ok().filter(|x| x.is_finite());
    let parts = text.split_once(',').and_then(|(a, e)| Some([parse(a)?, parse(e)?]));
    parts.ok_or_else(|| "must be AZIMUTH,ELEVATION in degrees, such as 20,35".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sun_alone_is_in_a_clear_sky_and_a_clear_sky_needs_one() {
        let weather = |sky, sun| Weather { sky, sun, ..Weather::default() }.sky();
        assert!(weather(None, None).expect("none asked for").is_none());
        let sky = weather(None, Some([20.0, 35.0])).expect("in range").expect("asked for");
        assert_eq!(sky.sun().map(|sun| sun.irradiance), Some(SUN_IRRADIANCE));
        assert!(weather(Some(Model::Clear), None).is_err(), "no sun");
        assert!(weather(None, Some([20.0, -5.0])).is_err(), "it has set");
        for bad in ["20", "a,b", "1,2,3", "nan,3"] {
            assert!(angles(bad).is_err(), "{bad}");
        }
        assert_eq!(angles("-20,35.5"), Ok([-20.0, 35.5]));
    }
}
