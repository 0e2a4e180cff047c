//! What glTF cannot say: the `wrt` object of a glTF `extras`.
//!
//! | on | fields |
//! |---|---|
//! | material | `{"phong": {"kd": [3], "ks": [3], "n": x}, "emission": {"exponent": x, "peak": [3]}, "glazing": …}` |
//! | node | `{"receiver": true}` |
//! | scene | `{"ambient": [3], "sky": {"model": "clear", "irradiance": x, "sun": [2], "sun_irradiance": x, "ground": x}}` |
//!
//! A glazing is `{"clear": ior}`, `{"diffusing": {"kd": [3], "ks": [3], "n": x}}` or
//! `{"bsdf": "file.xml"}`.
//!
//! All are optional. A misspelt field is an error; other keys of `extras` are
//! other programs' business.

use super::{Lobe, Material, weather};
use anyhow::{Context as _, ensure};
use glam::{DVec3, Vec3};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::path::PathBuf;
use wrt_core::{Glazing, Sky, SkyModel, Sun};

/// The largest Phong exponent n: a lobe of 0.3°, below what a bake can resolve.
pub(super) const MAX_PHONG_EXPONENT: f32 = 1e5;

/// `extras.wrt` of a material.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MaterialExtras {
    phong: Option<Phong>,
    emission: Option<Emission>,
    glazing: Option<GlazingExtras>,
}

/// What a window lets through.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "lowercase")]
enum GlazingExtras {
    Clear(f64),
    Diffusing(Phong),
    Bsdf(PathBuf),
}

/// The weather.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SkyExtras {
    model: Model,
    #[serde(default = "sky_irradiance")]
    irradiance: f64,
    sun: Option<[f64; 2]>,
    #[serde(default = "sun_irradiance")]
    sun_irradiance: f64,
    #[serde(default = "ground")]
    ground: f64,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Model {
    Uniform,
    Overcast,
    Clear,
}

fn sky_irradiance() -> f64 {
    weather::SKY_IRRADIANCE
}

fn sun_irradiance() -> f64 {
    weather::SUN_IRRADIANCE
}

fn ground() -> f64 {
    weather::GROUND_ALBEDO
}

/// Replaces what metallic-roughness says of reflection.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Phong {
    kd: [f32; 3],
    ks: [f32; 3],
    n: f32,
}

/// The angular law of the material's emission.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Emission {
    #[serde(default)]
    exponent: f64,
    /// None only with an exponent of 0, for which it says nothing.
    peak: Option<[f64; 3]>,
}

/// `extras.wrt` of a node.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NodeExtras {
    #[serde(default)]
    pub(super) receiver: bool,
}

/// `extras.wrt` of a scene.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SceneExtras {
    #[serde(default)]
    ambient: [f32; 3],
    sky: Option<SkyExtras>,
}

/// `wrt` in a glTF object's `extras`, or its default.
///
/// # Errors
///
/// If it is there and not as the table above has it.
pub(super) fn read<T: DeserializeOwned + Default>(
    extras: &::gltf::json::Extras,
) -> anyhow::Result<T> {
    let Some(text) = extras else { return Ok(T::default()) };
    let mut value: serde_json::Value = serde_json::from_str(text.get())?;
    match value.get_mut("wrt") {
        None => Ok(T::default()),
        Some(wrt) => serde_json::from_value(wrt.take()).context("extras.wrt"),
    }
}

impl MaterialExtras {
    /// Writes what is said here over `material`.
    ///
    /// # Errors
    ///
    /// If a value is outside its range.
    pub(super) fn apply(&self, material: &mut Material) -> anyhow::Result<()> {
        if let Some(Phong { kd, ks, n }) = &self.phong {
            let (kd, ks) = (Vec3::from(*kd), Vec3::from(*ks));
            check_colour("phong.kd", kd)?;
            check_colour("phong.ks", ks)?;
            let most = (kd + ks).max_element();
            // One part in a million for decimals that do not add up in f32.
            ensure!(
                most <= 1.0 + 1e-6,
                "extras.wrt: phong.kd + phong.ks reaches {most}: no channel may reflect more than 1"
            );
            ensure!(
                (0.0..=MAX_PHONG_EXPONENT).contains(n),
                "extras.wrt: phong.n is {n}, outside 0 to {MAX_PHONG_EXPONENT}"
            );
            (material.kd, material.ks, material.exponent) = (kd, ks, *n);
            material.mirror = false;
            material.metallic = None;
        }
        if let Some(Emission { exponent, peak }) = &self.emission {
            ensure!(
                exponent.is_finite() && *exponent >= 0.0,
                "extras.wrt: emission.exponent is {exponent}, below 0 or infinite"
            );
            ensure!(
                peak.is_some() || *exponent == 0.0,
                "extras.wrt: emission.exponent is {exponent}, so emission.peak must say its direction"
            );
            if let Some(peak) = peak.map(DVec3::from) {
                let unit = peak.try_normalize().filter(|_| peak.is_finite());
                let unit = unit
                    .with_context(|| format!("extras.wrt: emission.peak {peak} is no direction"))?;
                material.lobe = Some(Lobe { exponent: *exponent, peak: unit, window: None });
            }
        }
        if let Some(glazing) = &self.glazing {
            glazing.apply(material).context("extras.wrt: glazing")?;
        }
        Ok(())
    }
}

impl GlazingExtras {
    fn apply(&self, material: &mut Material) -> anyhow::Result<()> {
        match self {
            Self::Clear(ior) => {
                ensure!((1.0..=4.0).contains(ior), "clear is {ior}: an index from 1 to 4");
                material.glazing = Some(Glazing::Clear { ior: *ior });
            }
            Self::Diffusing(Phong { kd, ks, n }) => {
                let [kd, ks] = [kd, ks].map(|k| k.map(f64::from));
                let phong = wrt_core::Phong::new(kd, ks, f64::from(*n))?;
                material.glazing = Some(Glazing::Diffusing(phong));
            }
            // Relative to the scene, which the loader knows.
            Self::Bsdf(file) => material.glazing_file = Some(file.clone()),
        }
        Ok(())
    }
}

impl SceneExtras {
    /// The weather outside.
    ///
    /// # Errors
    ///
    /// If a value is out of its range.
    pub(super) fn sky(&self) -> anyhow::Result<Option<Sky>> {
        let Some(sky) = &self.sky else { return Ok(None) };
        let model = match sky.model {
            Model::Uniform => SkyModel::Uniform,
            Model::Overcast => SkyModel::Overcast,
            Model::Clear => SkyModel::Clear,
        };
        let sun =
            sky.sun.map(|[azimuth, elevation]| Sun::new(azimuth, elevation, sky.sun_irradiance));
        let sun = sun.transpose().context("extras.wrt: sky")?;
        Sky::new(model, sky.irradiance, sun, sky.ground).map(Some).context("extras.wrt: sky")
    }

    /// Radiance of the ambient term.
    ///
    /// # Errors
    ///
    /// If a channel is negative or infinite.
    pub(super) fn ambient(&self) -> anyhow::Result<Vec3> {
        let ambient = Vec3::from(self.ambient);
        check_colour("ambient", ambient)?;
        Ok(ambient)
    }
}

fn check_colour(field: &str, colour: Vec3) -> anyhow::Result<()> {
    let valid = colour.is_finite() && colour.min_element() >= 0.0;
    ensure!(valid, "extras.wrt: {field} is {colour}: each channel must be finite and at least 0");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    fn extras(value: &Value) -> ::gltf::json::Extras {
        Some(serde_json::value::to_raw_value(value).expect("JSON to text"))
    }

    fn material(wrt: Value) -> anyhow::Result<Material> {
        let mut material = Material { mirror: true, ..Material::default() };
        read::<MaterialExtras>(&extras(&json!({ "wrt": wrt })))?.apply(&mut material)?;
        Ok(material)
    }

    #[test]
    fn phong_and_lobe_replace_what_was_there() {
        let m = material(json!({
            "phong": {"kd": [0.1, 0.2, 0.3], "ks": [0.9, 0.5, 0.0], "n": 40},
            "emission": {"exponent": 8, "peak": [0, -3, 4]}
        }));
        let m = m.expect("every value is in range");
        assert_eq!((m.kd, m.ks), (Vec3::new(0.1, 0.2, 0.3), Vec3::new(0.9, 0.5, 0.0)));
        assert_eq!(m.exponent, 40.0);
        assert!(!m.mirror, "a Phong lobe is no mirror");
        let lobe = m.lobe.expect("authored");
        assert_eq!(lobe.exponent, 8.0);
        assert!(lobe.peak.abs_diff_eq(DVec3::new(0.0, -0.6, 0.8), 1e-15), "{lobe:?}");
    }

    #[test]
    fn no_exponent_and_no_peak_are_lambertian() {
        let m = material(json!({"emission": {}})).expect("the defaults");
        assert_eq!(m.lobe, None);
    }

    #[test]
    fn absent_or_foreign_extras_change_nothing() {
        for value in [json!({}), json!({"other": {"wrt": 1}}), json!(7), json!("wrt")] {
            let node: NodeExtras = read(&extras(&value)).expect("nothing of ours is here");
            assert!(!node.receiver, "{value}");
        }
        let scene: SceneExtras = read(&None).expect("no extras at all");
        assert_eq!(scene.ambient().expect("zero is in range"), Vec3::ZERO);
    }

    #[test]
    fn node_and_scene_are_read() {
        let node: NodeExtras =
            read(&extras(&json!({"wrt": {"receiver": true}, "prop": 1}))).expect("a receiver");
        assert!(node.receiver, "marked so");
        let scene: SceneExtras =
            read(&extras(&json!({"wrt": {"ambient": [0.5, 0, 1]}}))).expect("an ambient term");
        assert_eq!(scene.ambient().expect("in range"), Vec3::new(0.5, 0.0, 1.0));
    }

    #[test]
    fn weather_and_glass_are_read() {
        let m = material(json!({"glazing": {"clear": 1.5}})).expect("glass");
        assert!(matches!(m.glazing, Some(Glazing::Clear { ior: 1.5 })), "{:?}", m.glazing);
        let milk =
            json!({"glazing": {"diffusing": {"kd": [0.5, 0.5, 0.5], "ks": [0, 0, 0], "n": 0}}});
        assert!(matches!(material(milk).expect("milk").glazing, Some(Glazing::Diffusing(_))));
        for (glazing, expected) in [
            (json!({"clear": 0.5}), "an index from 1 to 4"),
            (json!({"diffusing": {"kd": [1, 1, 1], "ks": [1, 1, 1], "n": 0}}), "at most 1"),
            (json!({"frosted": 1}), "unknown variant"),
        ] {
            let error = material(json!({ "glazing": glazing })).expect_err("no glass");
            assert!(format!("{error:#}").contains(expected), "{error:#}");
        }
        let sky = |sky: Value| -> anyhow::Result<Option<Sky>> {
            read::<SceneExtras>(&extras(&json!({"wrt": {"sky": sky}})))?.sky()
        };
        let clear = sky(json!({"model": "clear", "sun": [20, 35], "sun_irradiance": 600}));
        let sun = clear.expect("in range").expect("a sky").sun().expect("a sun");
        assert_eq!(sun.irradiance, 600.0);
        for (value, expected) in [
            (json!({"model": "clear"}), "suns"),
            (json!({"model": "foggy"}), "foggy"),
            (json!({"model": "uniform", "sun": [0, 100]}), "elevation"),
            (json!({"model": "uniform", "irradiance": -1}), "irradiance"),
        ] {
            let error = sky(value).expect_err("no weather");
            assert!(format!("{error:#}").contains(expected), "{error:#}");
        }
    }

    #[test]
    fn wrong_types_and_names_are_reported() {
        for (wrt, expected) in [
            (json!({"phomg": {}}), "unknown field `phomg`"),
            (json!({"phong": {"kd": [0, 0, 0], "n": 1}}), "missing field `ks`"),
            (json!({"phong": {"kd": [0, 0], "ks": [0, 0, 0], "n": 1}}), "length 2"),
            (json!({"emission": {"exponent": "8", "peak": [0, 0, 1]}}), "string \"8\""),
            (json!([]), "extras.wrt"),
        ] {
            let error = material(wrt.clone()).expect_err("not as documented");
            let text = format!("{error:#}");
            if wrt != json!([]) {
                assert!(text.starts_with("extras.wrt: ") && text.contains(expected), "{text}");
            }
        }
    }

    #[test]
    fn values_out_of_range_are_reported() {
        let phong = |kd: f32, ks: f32, n: f32| json!({"phong": {"kd": [kd, kd, kd], "ks": [ks, ks, ks], "n": n}});
        let lobe = |exponent: f64, peak: f64| json!({"emission": {"exponent": exponent, "peak": [0.0, 0.0, peak]}});
        for (wrt, expected) in [
            (phong(-0.1, 0.0, 1.0), "phong.kd is"),
            (phong(0.0, -0.1, 1.0), "phong.ks is"),
            (phong(0.7, 0.4, 1.0), "no channel may reflect more than 1"),
            (phong(0.7, 0.3, -1.0), "phong.n is -1, outside 0 to 100000"),
            (phong(0.7, 0.3, 1.1e5), "phong.n is 110000, outside 0 to 100000"),
            (lobe(1.0, 0.0), "is no direction"),
            (lobe(-1.0, 1.0), "emission.exponent is -1, below 0"),
            (json!({"emission": {"exponent": 2}}), "emission.peak must say"),
        ] {
            let text = format!("{:#}", material(wrt).expect_err("out of range"));
            assert!(text.starts_with("extras.wrt: ") && text.contains(expected), "{text}");
        }
        let scene: SceneExtras =
            read(&extras(&json!({"wrt": {"ambient": [0, -1, 0]}}))).expect("three numbers");
        assert!(scene.ambient().is_err(), "negative light");
        assert!(material(phong(0.7, 0.3, 1e5)).is_ok(), "the limits themselves are in range");
    }
}
