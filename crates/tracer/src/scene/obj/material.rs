//! MTL materials as Phong ones: k_d = Kd, k_s = Ks, n = Ns, radiance = Ke.

use super::lines;
use crate::scene::extras::MAX_PHONG_EXPONENT;
use crate::scene::files::Files;
use crate::scene::load::{Warnings, conserve};
use crate::scene::{Encoding, Map, Material, Texture};
use anyhow::{Context as _, ensure};
use glam::Vec3;
use std::cell::Cell;
use std::collections::HashMap;

/// The materials of an OBJ, in the order tobj numbers them.
#[derive(Debug, Default)]
pub(super) struct Library {
    parsed: Vec<tobj::Material>,
    given: Cell<bool>,
    pub(super) materials: Vec<Material>,
    pub(super) textures: Vec<Texture>,
}

impl Library {
    /// Reads every `mtllib` of `obj`. One that is not there is a warning, since
    /// many an OBJ has lost its own; a missing texture is an error.
    ///
    /// # Errors
    ///
    /// If an MTL is malformed or a texture cannot be read.
    pub(super) fn load(
        obj: &str,
        files: &Files<'_>,
        warnings: &mut Warnings,
    ) -> anyhow::Result<Self> {
        let mut library = Self::default();
        let mut textures = HashMap::new();
        let mut names: Vec<&str> =
            obj.lines().filter_map(|l| l.trim().strip_prefix("mtllib ")).collect();
        names.dedup();
        for name in names {
            let name = name.trim().replace('\\', "/");
            let path = files.path(&name);
            let Ok(bytes) = files.read(&name) else {
                warnings.ignored("material files that cannot be read", &path.display().to_string());
                continue;
            };
            let context = || path.display().to_string();
            let text = lines::checked_mtl(&lines::joined(&bytes)).with_context(context)?;
            let parsed = tobj::load_mtl_buf(&mut text.as_bytes());
            let (parsed, _) = parsed.context("malformed MTL").with_context(context)?;
            for material in parsed {
                let owner = format!("material {:?}", material.name);
                let mut load = |name: &str, warnings: &mut Warnings| {
                    let name = file_name(name, &owner, warnings);
                    if let Some(&index) = textures.get(&name) {
                        return Ok(index);
                    }
                    let path = files.path(&name);
                    let texture = files.read(&name).map_err(anyhow::Error::from);
                    let texture = texture.and_then(|bytes| Texture::decode(&bytes, Encoding::Srgb));
                    let texture = texture.with_context(|| format!("reading {}", path.display()))?;
                    library.textures.push(texture);
                    textures.insert(name, library.textures.len() - 1);
                    Ok(library.textures.len() - 1)
                };
                let converted = convert(&material, &owner, &mut load, warnings);
                library.materials.push(converted.context(owner).with_context(context)?);
                library.parsed.push(material);
            }
        }
        Ok(library)
    }

    /// All materials for the first file that tobj asks for, none for the rest.
    pub(super) fn for_tobj(&self) -> tobj::MTLLoadResult {
        if self.given.replace(true) {
            return Ok(Default::default());
        }
        let numbers = self.parsed.iter().enumerate().map(|(i, m)| (m.name.clone(), i));
        Ok((self.parsed.clone(), numbers.collect()))
    }
}

fn convert(
    mtl: &tobj::Material,
    owner: &str,
    load: &mut dyn FnMut(&str, &mut Warnings) -> anyhow::Result<usize>,
    warnings: &mut Warnings,
) -> anyhow::Result<Material> {
    let mut texture = |name: Option<&String>| name.map(|n| load(n, warnings)).transpose();
    let base_texture = texture(mtl.diffuse_texture.as_ref()).context("map_Kd")?;
    let emission_texture = texture(mtl.unknown_param.get("map_Ke")).context("map_Ke")?;
    for (present, what) in [
        (mtl.specular_texture.is_some() || mtl.shininess_texture.is_some(), "specular textures"),
        (mtl.normal_texture.is_some(), "normal textures"),
        (mtl.dissolve_texture.is_some(), "transparency textures"),
    ] {
        if present {
            warnings.ignored(what, owner);
        }
    }
    // A texture alone means the texture as it is.
    let colour = |value: Option<[f32; 3]>, texture: Option<usize>, default: Vec3| {
        value.map_or(if texture.is_some() { Vec3::ONE } else { default }, Vec3::from)
    };
    let default = Material::default();
    let model = mtl.illumination_model.unwrap_or(2);
    let kd = colour(mtl.diffuse, base_texture, default.kd);
    // Models 0 and 1 have no highlight, whatever Ks says.
    let ks = if model < 2 { Vec3::ZERO } else { colour(mtl.specular, None, Vec3::ZERO) };
    let (kd, ks) = conserve(kd, ks);
    let exponent = mtl.shininess.unwrap_or(0.0);
    ensure!(!exponent.is_nan(), "Ns is not a number");

    let tr = mtl.unknown_param.get("Tr").and_then(|t| t.parse::<f32>().ok());
    let opaque = mtl.dissolve.or(tr.map(|t| 1.0 - t)).unwrap_or(1.0);
    ensure!((0.0..=1.0).contains(&opaque), "d (or 1 − Tr) is {opaque}, outside 0 to 1");
    // Models 4, 6, 7 and 9 are of glass, which many files leave at d = 1.
    let glass = matches!(model, 4 | 6 | 7 | 9);
    // Of glass k_d says nothing, and is often 0: Tf colours it.
    let filter = mtl.unknown_param.get("Tf").map(|text| filter(text));
    if filter == Some(None) {
        warnings.ignored("Tf outside 0 to 1", owner);
    }
    let filter = filter.flatten().unwrap_or(Vec3::ONE);
    let transmission = if glass && opaque == 1.0 { 1.0 } else { 1.0 - opaque };
    Ok(Material {
        name: mtl.name.clone(),
        kd,
        ks,
        exponent: exponent.clamp(0.0, MAX_PHONG_EXPONENT),
        base_texture: base_texture.map(Map::of),
        emission: colour(mtl.emissive, emission_texture, Vec3::ZERO),
        emission_texture: emission_texture.map(Map::of),
        transmission,
        filter: (transmission > 0.0).then_some(filter),
        // Exporters write 0 or 0.001 for "not glass".
        ior: mtl.optical_density.filter(|n| n.is_finite() && *n >= 1.0).unwrap_or(default.ior),
        mirror: matches!(model, 3 | 5) && ks != Vec3::ZERO,
        ..default
    })
}

/// The colour of a `Tf` line, if it is one.
fn filter(text: &str) -> Option<Vec3> {
    let numbers: Option<Vec<f32>> = text.split_whitespace().map(|x| x.parse().ok()).collect();
    let rgb = match numbers?[..] {
        [grey] => Vec3::splat(grey),
        [r, g, b] => Vec3::new(r, g, b),
        _ => return None,
    };
    (rgb.cmpge(Vec3::ZERO).all() && rgb.cmple(Vec3::ONE).all()).then_some(rgb)
}

/// The file of a `map_` line, without the options before it.
fn file_name(line: &str, owner: &str, warnings: &mut Warnings) -> String {
    let mut rest = line.trim();
    while rest.starts_with('-') {
        warnings.ignored("texture options", owner);
        let option = rest.split(' ').next().unwrap_or_default();
        rest = rest[option.len()..].trim_start();
        let value = |w: &str| w.parse::<f32>().is_ok() || matches!(w, "on" | "off");
        // Of an option's values each is a number or a switch, save -imfchan's.
        let mut letter = option == "-imfchan";
        while let Some((word, after)) = rest.split_once(' ') {
            if !value(word) && !std::mem::take(&mut letter) {
                break;
            }
            rest = after;
        }
    }
    rest.replace('\\', "/")
}
