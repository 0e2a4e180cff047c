//! glTF's metallic-roughness materials as Phong ones.
//!
//! With roughness r, metalness m, base colour c and the index of refraction η:
//!
//! ```text
//! α = r²    n = clamp(2/α² − 2, 0, 10⁵)
//! f₀ = lerp(((η−1)/(η+1))², c, m)    k_s = f₀    k_d = c (1−m) (1 − max f₀)
//! ```
//!
//! n is the Blinn-Phong exponent whose half-vector lobe has the GGX width α (B.
//! Walter et al., *Microfacet Models for Refraction through Rough Surfaces*,
//! EGSR 2007, §5.2), used for Phong's lobe as it stands. f₀ is glTF's: 0.04 for
//! η = 1.5, which a file means by saying nothing.
//!
//! Only k_d has a texture here. Where a file has one for r and m, or a base
//! colour texture on a metal, its mean stands for it.

use super::super::extras::{self, MAX_PHONG_EXPONENT, MaterialExtras};
use super::super::load::{Warnings, conserve};
use super::super::{Material, Texture, texture};
use super::accessor::Buffers;
use super::buffer;
use super::document::{get, valid};
use ::gltf::json::material::AlphaMode;
use ::gltf::json::texture::{Info, WrappingMode};
use ::gltf::json::{Image, Index, Material as Json, Root};
use anyhow::{Context as _, ensure};
use glam::{Affine2, DVec3, Mat2, Vec2, Vec3};
use std::collections::HashMap;
use std::path::Path;

/// Which of a primitive's texture coordinates a material uses, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TextureCoordinates {
    pub(super) set: u32,
    pub(super) transform: Affine2,
}

impl Default for TextureCoordinates {
    fn default() -> Self {
        Self { set: 0, transform: Affine2::IDENTITY }
    }
}

/// Images of a file, each decoded when first used.
#[derive(Debug)]
pub(super) struct Textures<'a> {
    root: &'a Root,
    buffers: &'a Buffers<'a>,
    directory: &'a Path,
    /// Image to index into `loaded`.
    index: HashMap<usize, usize>,
    pub(super) loaded: Vec<Texture>,
}

impl<'a> Textures<'a> {
    pub(super) fn new(root: &'a Root, buffers: &'a Buffers<'a>, directory: &'a Path) -> Self {
        Self { root, buffers, directory, index: HashMap::new(), loaded: Vec::new() }
    }

    fn load(&mut self, info: &Info, owner: &str, warnings: &mut Warnings) -> anyhow::Result<usize> {
        let texture = get(self.root, info.index, "texture")?;
        if let Some(sampler) = texture.sampler {
            let sampler = get(self.root, sampler, "sampler")?;
            let wrap = [valid(&sampler.wrap_s, "wrapS")?, valid(&sampler.wrap_t, "wrapT")?];
            if wrap != [WrappingMode::Repeat; 2] {
                warnings.ignored("texture wrapping other than repeat", owner);
            }
        }
        let image = texture.source.value();
        if let Some(&index) = self.index.get(&image) {
            return Ok(index);
        }
        let bytes = self.bytes(texture.source)?;
        let name = get(self.root, texture.source, "image")?;
        let name = name.name.as_deref().or(name.uri.as_deref()).unwrap_or("in the file");
        let decoded = texture::decode(&bytes).with_context(|| {
            // A data URI would fill the screen.
            let short: String = name.chars().take(80).collect();
            format!("image {image} ({short})")
        })?;
        self.loaded.push(decoded);
        self.index.insert(image, self.loaded.len() - 1);
        Ok(self.loaded.len() - 1)
    }

    /// The mean texel of a loaded texture.
    fn mean_colour(&self, index: usize) -> Vec3 {
        let texels = &self.loaded[index].texels;
        // In f64: a large texture has more texels than f32 has whole numbers.
        let sum: DVec3 = texels.iter().map(|t| t.as_dvec3()).sum();
        (sum / texels.len() as f64).as_vec3()
    }

    /// The mean of each channel of an image of numbers.
    fn mean_numbers(&self, info: &Info) -> anyhow::Result<Vec3> {
        let texture = get(self.root, info.index, "texture")?;
        texture::mean(&self.bytes(texture.source)?)
            .with_context(|| format!("image {}", texture.source.value()))
    }

    fn bytes(&self, index: Index<Image>) -> anyhow::Result<Vec<u8>> {
        let image = self.root.images.get(index.value());
        let image = image.context("a texture has no PNG or JPEG image")?;
        match (&image.uri, image.buffer_view) {
            (Some(uri), _) => buffer::resolve(uri, self.directory),
            (None, Some(view)) => self.buffers.view(view).map(<[u8]>::to_vec),
            (None, None) => anyhow::bail!("it has neither a URI nor a buffer view"),
        }
        .with_context(|| format!("image {}", index.value()))
    }
}

/// Converts one material.
///
/// # Errors
///
/// If a value is outside its range or a texture cannot be read.
pub(super) fn read(
    json: &Json,
    owner: &str,
    textures: &mut Textures<'_>,
    warnings: &mut Warnings,
) -> anyhow::Result<(Material, TextureCoordinates)> {
    let pbr = &json.pbr_metallic_roughness;
    let extensions = json.extensions.as_ref();
    let [r, g, b, _] = pbr.base_color_factor.0;
    let base = colour("baseColorFactor", [r, g, b])?;
    let mut metallic = fraction("metallicFactor", pbr.metallic_factor.0)?;
    let mut roughness = fraction("roughnessFactor", pbr.roughness_factor.0)?;
    if let Some(info) = &pbr.metallic_roughness_texture {
        let mean = textures.mean_numbers(info).context("metallicRoughnessTexture")?;
        metallic *= mean.z;
        roughness *= mean.y;
    }

    let mut ior = extensions.and_then(|e| e.ior.as_ref()).map_or(1.5, |i| i.ior.0);
    if ior == 0.0 {
        // The extension's way of asking for specular-glossiness's Fresnel term.
        warnings.ignored("an index of refraction of 0", owner);
        ior = 1.5;
    }
    ensure!(ior.is_finite() && ior >= 1.0, "ior is {ior}, below 1 or infinite");
    let mut dielectric = Vec3::splat(((ior - 1.0) / (ior + 1.0)).powi(2));
    if let Some(specular) = extensions.and_then(|e| e.specular.as_ref()) {
        let tint = colour("specularColorFactor", specular.specular_color_factor.0)?;
        let factor = fraction("specularFactor", specular.specular_factor.0)?;
        dielectric = (dielectric * tint).min(Vec3::ONE) * factor;
        if specular.specular_texture.is_some() || specular.specular_color_texture.is_some() {
            warnings.ignored("specular textures", owner);
        }
    }
    let transmission = extensions.and_then(|e| e.transmission.as_ref());
    if transmission.is_some_and(|t| t.transmission_texture.is_some()) {
        warnings.ignored("transmission textures", owner);
    }
    let transmission = transmission.map_or(0.0, |t| t.transmission_factor.0);
    let transmission = fraction("transmissionFactor", transmission)?;

    let strength = extensions.and_then(|e| e.emissive_strength.as_ref());
    let strength = strength.map_or(1.0, |s| s.emissive_strength.0);
    let emission = colour("emissiveFactor", json.emissive_factor.0)? * strength;
    let emission = colour("emissiveStrength times emissiveFactor", emission.into())?;

    warn_of_the_rest(json, owner, warnings)?;
    let mut coordinates = None;
    let mut texture = |info: &Option<Info>| -> anyhow::Result<Option<usize>> {
        let Some(info) = info else { return Ok(None) };
        let wanted = texture_coordinates(info)?;
        if *coordinates.get_or_insert(wanted) != wanted {
            warnings.ignored("texture coordinates of its own for an emissive texture", owner);
        }
        textures.load(info, owner, warnings).map(Some)
    };
    let base_texture = texture(&pbr.base_color_texture).context("baseColorTexture")?;
    let emission_texture = texture(&json.emissive_texture).context("emissiveTexture")?;

    let mean = base_texture.map_or(Vec3::ONE, |index| textures.mean_colour(index));
    let (kd, ks, exponent) = phong(base, base * mean, metallic, roughness, dielectric);

    let mut material = Material {
        name: json.name.clone().unwrap_or_default(),
        kd,
        ks,
        exponent,
        base_texture,
        emission,
        emission_texture,
        lobe: None,
        glazing: None,
        glazing_file: None,
        transmission,
        ior,
        mirror: metallic == 1.0 && roughness == 0.0,
        double_sided: json.double_sided,
    };
    extras::read::<MaterialExtras>(&json.extras)?.apply(&mut material)?;
    Ok((material, coordinates.unwrap_or_default()))
}

/// k_d, k_s and n of the module's formula; `metal` is the base colour of f₀.
fn phong(
    base: Vec3,
    metal: Vec3,
    metallic: f32,
    roughness: f32,
    dielectric: Vec3,
) -> (Vec3, Vec3, f32) {
    let alpha = roughness * roughness;
    // α = 0 gives +∞, which the clamp takes to the largest exponent.
    let exponent = (2.0 / (alpha * alpha) - 2.0).clamp(0.0, MAX_PHONG_EXPONENT);
    let f0 = dielectric.lerp(metal, metallic);
    let kd = base * (1.0 - metallic) * (1.0 - f0.max_element()).max(0.0);
    let (kd, ks) = conserve(kd, f0);
    (kd, ks, exponent)
}

fn warn_of_the_rest(json: &Json, owner: &str, warnings: &mut Warnings) -> anyhow::Result<()> {
    let pbr = &json.pbr_metallic_roughness;
    let alpha = valid(&json.alpha_mode, "alphaMode")? != AlphaMode::Opaque;
    let metal_texture = pbr.base_color_texture.is_some() && pbr.metallic_factor.0 > 0.0;
    for (present, what) in [
        (json.normal_texture.is_some(), "normal textures"),
        (json.occlusion_texture.is_some(), "occlusion textures"),
        (
            pbr.metallic_roughness_texture.is_some(),
            "metallic-roughness textures but for their mean",
        ),
        (metal_texture, "base colour textures but for their mean in a metal's reflection"),
        (alpha, "alpha"),
    ] {
        if present {
            warnings.ignored(what, owner);
        }
    }
    Ok(())
}

/// KHR_texture_transform: uv′ = offset + R S uv, R a turn that is
/// counter-clockwise as seen, with v down.
fn texture_coordinates(info: &Info) -> anyhow::Result<TextureCoordinates> {
    let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
    let Some(t) = transform else {
        return Ok(TextureCoordinates { set: info.tex_coord, ..Default::default() });
    };
    let turn = Mat2::from_angle(-t.rotation.0);
    let matrix = turn * Mat2::from_diagonal(Vec2::from(t.scale.0));
    let transform = Affine2::from_mat2_translation(matrix, Vec2::from(t.offset.0));
    ensure!(transform.is_finite(), "KHR_texture_transform is not finite");
    Ok(TextureCoordinates { set: t.tex_coord.unwrap_or(info.tex_coord), transform })
}

fn colour(field: &str, value: [f32; 3]) -> anyhow::Result<Vec3> {
    let value = Vec3::from(value);
    let valid = value.is_finite() && value.min_element() >= 0.0;
    ensure!(valid, "{field} is {value}: each channel must be finite and at least 0");
    Ok(value)
}

fn fraction(field: &str, value: f32) -> anyhow::Result<f32> {
    ensure!((0.0..=1.0).contains(&value), "{field} is {value}, outside 0 to 1");
    Ok(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    fn convert(material: Value) -> (anyhow::Result<(Material, TextureCoordinates)>, Vec<String>) {
        let red = super::super::tests::data_uri(&texture::tests::png(&[[255, 0, 0]]));
        let root: Root = serde_json::from_value(json!({
            "asset": {"version": "2.0"},
            "textures": [{"source": 0}, {}, {"source": 1}, {"source": 0, "sampler": 0}],
            "samplers": [{"wrapS": 33071}],
            "images": [{"uri": red}, {"uri": "not%20there.png"}],
            "materials": [material]
        }))
        .expect("glTF JSON");
        let buffers = Buffers::load(&root, None, Path::new("")).expect("no buffers");
        let mut textures = Textures::new(&root, &buffers, Path::new("dir"));
        let mut warnings = Warnings::default();
        let result = read(&root.materials[0], "material 0", &mut textures, &mut warnings);
        (result, warnings.into_lines())
    }

    fn material(value: Value) -> Material {
        convert(value).0.expect("a valid material").0
    }

    #[test]
    fn a_dielectric_reflects_four_percent() {
        let m = material(json!({"pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.25, 0.0, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.5}}));
        assert!(m.ks.abs_diff_eq(Vec3::splat(0.04), 1e-6), "{}", m.ks);
        assert!(m.kd.abs_diff_eq(Vec3::new(0.48, 0.24, 0.0), 1e-6), "{}", m.kd);
        // α = ¼, n = 2 · 16 − 2.
        assert_eq!(m.exponent, 30.0);
        assert!(!m.mirror && !m.double_sided, "{m:?}");
    }

    #[test]
    fn a_smooth_metal_is_a_mirror() {
        let m = material(json!({"doubleSided": true, "pbrMetallicRoughness": {
            "baseColorFactor": [0.9, 0.8, 0.7, 1.0], "metallicFactor": 1.0, "roughnessFactor": 0.0}}));
        assert_eq!((m.kd, m.ks), (Vec3::ZERO, Vec3::new(0.9, 0.8, 0.7)));
        assert_eq!(m.exponent, 1e5);
        assert!(m.mirror && m.double_sided, "{m:?}");
        let rough = material(json!({}));
        // glTF's defaults: a white metal of roughness 1, for which n = 0.
        assert_eq!((rough.ks, rough.exponent, rough.mirror), (Vec3::ONE, 0.0, false));
    }

    #[test]
    fn glass_has_an_index_and_a_transmission() {
        let m = material(json!({
            "pbrMetallicRoughness": {"metallicFactor": 0.0},
            "extensions": {"KHR_materials_ior": {"ior": 1.0},
                           "KHR_materials_transmission": {"transmissionFactor": 0.75}}}));
        assert_eq!((m.ior, m.transmission), (1.0, 0.75));
        // No step in the index, no reflection.
        assert_eq!((m.kd, m.ks), (Vec3::ONE, Vec3::ZERO));
    }

    #[test]
    fn emission_is_factor_times_strength() {
        let m = material(json!({
            "emissiveFactor": [1.0, 0.5, 0.0], "emissiveTexture": {"index": 0},
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 8.0}}}));
        assert_eq!(m.emission, Vec3::new(8.0, 4.0, 0.0));
        assert_eq!(m.emission_texture, Some(0));
    }

    #[test]
    fn energy_is_conserved_for_every_material() {
        for i in 0..=10 {
            for j in 0..=10 {
                let (metallic, base) = (i as f32 / 10.0, Vec3::new(1.0, j as f32 / 10.0, 0.0));
                for dielectric in [0.0, 0.04, 0.5, 1.0] {
                    let (kd, ks, _) = phong(base, base, metallic, 0.5, Vec3::splat(dielectric));
                    assert!((kd + ks).max_element() <= 1.0 + 1e-6, "{kd} + {ks}");
                }
            }
        }
    }

    #[test]
    fn texture_transform_scales_turns_and_shifts() {
        let (result, _) = convert(json!({"pbrMetallicRoughness": {"baseColorTexture": {
            "index": 0, "texCoord": 1,
            "extensions": {"KHR_texture_transform": {
                "offset": [10.0, 20.0], "rotation": std::f32::consts::FRAC_PI_2, "scale": [2.0, 3.0]}}}}}));
        let (_, coordinates) = result.expect("a valid material");
        assert_eq!(coordinates.set, 1);
        // +u turns to −v, which is up: counter-clockwise as seen. +v turns to +u.
        let corner = coordinates.transform.transform_point2(Vec2::ONE);
        assert!(corner.abs_diff_eq(Vec2::new(13.0, 18.0), 1e-5), "{corner}");
    }

    #[test]
    fn textures_of_a_metal_count_by_their_mean() {
        // The texture is red: r and m are 0 times their factors, f₀ takes the red.
        let m = material(json!({"pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.5, 0.5, 1.0], "metallicRoughnessTexture": {"index": 0}}}));
        assert!(m.kd.abs_diff_eq(Vec3::splat(0.48), 1e-6) && !m.mirror, "{m:?}");
        let m = material(json!({"pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.5, 0.5, 1.0], "baseColorTexture": {"index": 0}}}));
        assert_eq!((m.kd, m.ks), (Vec3::ZERO, Vec3::new(0.5, 0.0, 0.0)));
    }

    #[test]
    fn problems_are_named() {
        for (value, expected) in [
            (json!({"pbrMetallicRoughness": {"metallicFactor": 1.5}}), "metallicFactor is 1.5"),
            (json!({"emissiveFactor": [-1.0, 0.0, 0.0]}), "emissiveFactor is"),
            (json!({"alphaMode": "GLOW"}), "alphaMode has a value"),
            (json!({"emissiveTexture": {"index": 9}}), "emissiveTexture: there is no texture 9"),
            (json!({"emissiveTexture": {"index": 1}}), "has no PNG or JPEG image"),
            (json!({"emissiveTexture": {"index": 2}}), "cannot read dir/not there.png"),
            (json!({"extras": {"wrt": {"lobe": 1}}}), "unknown field `lobe`"),
            (json!({"extensions": {"KHR_materials_ior": {"ior": 0.5}}}), "ior is 0.5"),
        ] {
            let text = format!("{:#}", convert(value).0.expect_err("not valid"));
            assert!(text.contains(expected), "{text}");
        }
    }

    #[test]
    fn what_is_ignored_is_said() {
        let (result, warnings) = convert(json!({
            "alphaMode": "BLEND", "normalTexture": {"index": 0},
            "emissiveTexture": {"index": 3}}));
        assert!(result.is_ok(), "{result:?}");
        assert_eq!(
            warnings,
            [
                "ignored normal textures (material 0)",
                "ignored alpha (material 0)",
                "ignored texture wrapping other than repeat (material 0)"
            ]
        );
    }
}
