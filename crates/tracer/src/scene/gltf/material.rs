//! glTF's materials as Phong ones: metallic-roughness by [`MetallicRoughness`],
//! specular-glossiness directly.
//!
//! Where textures make k_s and n vary, they do so when rendered; a bake, which
//! reflects each patch by one BRDF, takes the textures' means.

use super::super::extras::{self, MaterialExtras};
use super::super::files::Files;
use super::super::load::{Warnings, conserve};
use super::super::{Alpha, Encoding, Map, Material, MetallicRoughness, Texture, Wrap, metallic};
use super::accessor::Buffers;
use super::buffer;
use super::document::{get, valid};
use ::gltf::json::extensions::texture::TextureTransform;
use ::gltf::json::material::AlphaMode;
use ::gltf::json::texture::{Info, MagFilter, WrappingMode};
use ::gltf::json::{Image, Index, Material as Json, Root, Texture as JsonTexture};
use anyhow::{Context as _, ensure};
use glam::{Affine2, Mat2, Vec2, Vec3};
use serde_json::Value;
use std::collections::HashMap;

/// Roughness up to which what light passes looks clear.
const CLEAR: f32 = 0.05;

/// Roughness up to which a surface is a mirror: its lobe is half a degree wide, as the sun
/// is, and a highlight of it would show lamps and not what else there is.
const MIRROR: f32 = 0.1;

/// Textures of a file, each decoded when first used.
#[derive(Debug)]
pub(super) struct Textures<'a> {
    root: &'a Root,
    buffers: &'a Buffers<'a>,
    files: &'a Files<'a>,
    /// Image and what its numbers are, to its first texture in `loaded`.
    images: HashMap<(usize, Encoding), usize>,
    /// Texture and what its numbers are, to index into `loaded`.
    index: HashMap<(usize, Encoding), usize>,
    pub(super) loaded: Vec<Texture>,
}

impl<'a> Textures<'a> {
    pub(super) fn new(root: &'a Root, buffers: &'a Buffers<'a>, files: &'a Files<'a>) -> Self {
        let (images, index) = (HashMap::new(), HashMap::new());
        Self { root, buffers, files, images, index, loaded: Vec::new() }
    }

    /// What a material's `info` means.
    fn map(
        &mut self,
        info: &Info,
        encoding: Encoding,
        owner: &str,
        warnings: &mut Warnings,
    ) -> anyhow::Result<Map> {
        let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
        self.placed(info.index, info.tex_coord, transform, encoding, owner, warnings)
    }

    fn placed(
        &mut self,
        texture: Index<JsonTexture>,
        set: u32,
        transform: Option<&TextureTransform>,
        encoding: Encoding,
        owner: &str,
        warnings: &mut Warnings,
    ) -> anyhow::Result<Map> {
        let set = transform.and_then(|t| t.tex_coord).unwrap_or(set);
        if set > 1 {
            warnings.ignored("texture coordinates beyond sets 0 and 1", owner);
        }
        let transform = transform.map_or(Affine2::IDENTITY, affine);
        ensure!(transform.is_finite(), "KHR_texture_transform is not finite");
        let set = if set == 1 { 1 } else { 0 };
        Ok(Map { texture: self.load(texture, encoding)?, set, transform })
    }

    fn load(&mut self, index: Index<JsonTexture>, encoding: Encoding) -> anyhow::Result<usize> {
        let texture = get(self.root, index, "texture")?;
        if let Some(&known) = self.index.get(&(index.value(), encoding)) {
            return Ok(known);
        }
        let image = texture.source.value();
        let mut loaded = match self.images.get(&(image, encoding)) {
            Some(&first) => self.loaded[first].clone(),
            None => self.decode(texture.source, encoding)?,
        };
        (loaded.wrap, loaded.nearest) = ([Wrap::Repeat; 2], false);
        if let Some(sampler) = texture.sampler {
            let sampler = get(self.root, sampler, "sampler")?;
            let wrap = [valid(&sampler.wrap_s, "wrapS")?, valid(&sampler.wrap_t, "wrapT")?];
            loaded.wrap = wrap.map(|wrap| match wrap {
                WrappingMode::Repeat => Wrap::Repeat,
                WrappingMode::MirroredRepeat => Wrap::Mirror,
                WrappingMode::ClampToEdge => Wrap::Clamp,
            });
            let filter = sampler.mag_filter.as_ref().map(|f| valid(f, "magFilter")).transpose()?;
            loaded.nearest = filter == Some(MagFilter::Nearest);
        }
        self.loaded.push(loaded);
        let new = self.loaded.len() - 1;
        self.images.entry((image, encoding)).or_insert(new);
        self.index.insert((index.value(), encoding), new);
        Ok(new)
    }

    fn decode(&self, index: Index<Image>, encoding: Encoding) -> anyhow::Result<Texture> {
        let bytes = self.bytes(index)?;
        let image = get(self.root, index, "image")?;
        let name = image.name.as_deref().or(image.uri.as_deref()).unwrap_or("in the file");
        Texture::decode(&bytes, encoding).with_context(|| {
            // A data URI would fill the screen.
            let short: String = name.chars().take(80).collect();
            format!("image {} ({short})", index.value())
        })
    }

    /// The mean of the texture of `map`.
    fn mean(&self, map: Option<Map>) -> Vec3 {
        map.map_or(Vec3::ONE, |map| self.loaded[map.texture].mean().truncate())
    }

    fn bytes(&self, index: Index<Image>) -> anyhow::Result<Vec<u8>> {
        let image = self.root.images.get(index.value());
        let image = image.context("a texture has no PNG or JPEG image")?;
        match (&image.uri, image.buffer_view) {
            (Some(uri), _) => buffer::resolve(uri, self.files),
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
) -> anyhow::Result<Material> {
    let extensions = json.extensions.as_ref();
    let mut material = Material {
        name: json.name.clone().unwrap_or_default(),
        unlit: extensions.is_some_and(|e| e.unlit.is_some()),
        double_sided: json.double_sided,
        ..Material::default()
    };
    reflection(json, owner, &mut material, textures, warnings)?;

    let transmission = extensions.and_then(|e| e.transmission.as_ref());
    if transmission.is_some_and(|t| t.transmission_texture.is_some()) {
        warnings.ignored("transmission textures", owner);
    }
    let transmission = transmission.map_or(0.0, |t| t.transmission_factor.0);
    material.transmission = fraction("transmissionFactor", transmission)?;
    if transmission > 0.0 && json.pbr_metallic_roughness.roughness_factor.0 > CLEAR {
        warnings.ignored("the roughness of what light passes, which is clear here", owner);
    }

    let strength = extensions.and_then(|e| e.emissive_strength.as_ref());
    let strength = strength.map_or(1.0, |s| s.emissive_strength.0);
    let emission = colour("emissiveFactor", json.emissive_factor.0)? * strength;
    material.emission = colour("emissiveStrength times emissiveFactor", emission.into())?;
    let emissive = json.emissive_texture.as_ref();
    let emissive = emissive.map(|info| textures.map(info, Encoding::Srgb, owner, warnings));
    material.emission_texture = emissive.transpose().context("emissiveTexture")?;
    if material.unlit {
        // The extension leaves nothing but the base colour.
        (material.emission, material.emission_texture) = (Vec3::ZERO, None);
    }

    if let Some(info) = &json.normal_texture {
        let transform = transform_of(info.extensions.as_ref().map(|e| &e.others))?;
        let (index, set, transform) = (info.index, info.tex_coord, transform.as_ref());
        let map = textures.placed(index, set, transform, Encoding::Linear, owner, warnings);
        material.normal_map = Some((map.context("normalTexture")?, info.scale));
    }
    if let Some(info) = &json.occlusion_texture {
        let transform = transform_of(info.extensions.as_ref().map(|e| &e.others))?;
        let (index, set, transform) = (info.index, info.tex_coord, transform.as_ref());
        let map = textures.placed(index, set, transform, Encoding::Linear, owner, warnings);
        let strength = fraction("occlusionTexture.strength", info.strength.0)?;
        material.occlusion = Some((map.context("occlusionTexture")?, strength));
    }
    extras::read::<MaterialExtras>(&json.extras)?.apply(&mut material)?;
    Ok(material)
}

/// Sets what of `material` says how it reflects, and its alpha.
fn reflection(
    json: &Json,
    owner: &str,
    material: &mut Material,
    textures: &mut Textures<'_>,
    warnings: &mut Warnings,
) -> anyhow::Result<()> {
    let extensions = json.extensions.as_ref();
    let pbr = &json.pbr_metallic_roughness;
    let glossy = extensions.and_then(|e| e.pbr_specular_glossiness.as_ref());
    let (factor, base) = match glossy {
        Some(glossy) => (glossy.diffuse_factor.0, &glossy.diffuse_texture),
        None => (pbr.base_color_factor.0, &pbr.base_color_texture),
    };
    let [r, g, b, opacity] = factor;
    let base_colour = colour("baseColorFactor", [r, g, b])?;
    let base = base.as_ref().map(|info| textures.map(info, Encoding::Srgb, owner, warnings));
    material.base_texture = base.transpose().context("baseColorTexture")?;
    let opacity = fraction("the alpha of baseColorFactor", opacity)?;
    material.alpha = match valid(&json.alpha_mode, "alphaMode")? {
        AlphaMode::Opaque => Alpha::Opaque,
        AlphaMode::Mask => {
            let cutoff = json.alpha_cutoff.as_ref().map_or(0.5, |c| c.0);
            Alpha::Mask { factor: opacity, cutoff }
        }
        AlphaMode::Blend => Alpha::Blend { factor: opacity },
    };
    if let Some(glossy) = glossy {
        let specular = colour("specularFactor", glossy.specular_factor.0)?;
        let gloss = fraction("glossinessFactor", glossy.glossiness_factor.0)?;
        if glossy.specular_glossiness_texture.is_some() {
            warnings.ignored("specular-glossiness textures", owner);
        }
        let specular = specular.min(Vec3::ONE);
        let diffuse = base_colour * (1.0 - specular.max_element());
        (material.kd, material.ks) = conserve(diffuse, specular);
        material.exponent = metallic::exponent(1.0 - gloss);
        return Ok(());
    }

    let mut ior = extensions.and_then(|e| e.ior.as_ref()).map_or(1.5, |i| i.ior.0);
    if ior == 0.0 {
        // The extension's way of asking for specular-glossiness's Fresnel term.
        warnings.ignored("an index of refraction of 0", owner);
        ior = 1.5;
    }
    ensure!(ior.is_finite() && ior >= 1.0, "ior is {ior}, below 1 or infinite");
    material.ior = ior;
    let mut dielectric = Vec3::splat(((ior - 1.0) / (ior + 1.0)).powi(2));
    if let Some(specular) = extensions.and_then(|e| e.specular.as_ref()) {
        let tint = colour("specularColorFactor", specular.specular_color_factor.0)?;
        let factor = fraction("specularFactor", specular.specular_factor.0)?;
        dielectric = (dielectric * tint).min(Vec3::ONE) * factor;
        if specular.specular_texture.is_some() || specular.specular_color_texture.is_some() {
            warnings.ignored("specular textures", owner);
        }
    }
    let map = pbr.metallic_roughness_texture.as_ref();
    let map = map.map(|info| textures.map(info, Encoding::Linear, owner, warnings));
    let map = map.transpose().context("metallicRoughnessTexture")?;
    let metal = MetallicRoughness {
        base: base_colour,
        metallic: fraction("metallicFactor", pbr.metallic_factor.0)?,
        roughness: fraction("roughnessFactor", pbr.roughness_factor.0)?,
        dielectric,
        map,
    };
    let base_varies = material.base_texture.is_some();
    if map.is_some() || (base_varies && metal.metallic > 0.0) || material.unlit {
        material.metallic = Some(metal);
    }
    let numbers = textures.mean(map);
    let numbers = [numbers.y, numbers.z];
    let mean = textures.mean(material.base_texture);
    (material.kd, material.ks, material.exponent) = metal.phong(mean, numbers);
    // The renderer multiplies k_d by the texture, whose mean is in it already.
    let textured = material.kd / mean;
    material.kd = Vec3::select(mean.cmpgt(Vec3::ZERO), textured, Vec3::ZERO);
    material.mirror = metal.roughness * numbers[0] <= MIRROR && material.ks != Vec3::ZERO;
    Ok(())
}

/// `KHR_texture_transform` among extensions that the gltf crate leaves as JSON.
fn transform_of(
    others: Option<&serde_json::Map<String, Value>>,
) -> anyhow::Result<Option<TextureTransform>> {
    let value = others.and_then(|o| o.get("KHR_texture_transform"));
    let read = value.map(|v| serde_json::from_value(v.clone()));
    read.transpose().context("KHR_texture_transform")
}

/// uv′ = offset + R S uv, R a turn that is counter-clockwise as seen, with v down.
fn affine(t: &TextureTransform) -> Affine2 {
    let turn = Mat2::from_angle(-t.rotation.0);
    let matrix = turn * Mat2::from_diagonal(Vec2::from(t.scale.0));
    Affine2::from_mat2_translation(matrix, Vec2::from(t.offset.0))
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
    use super::super::super::texture;
    use super::*;
    use serde_json::json;
    use std::path::Path;

    fn convert(material: Value) -> (anyhow::Result<(Material, Vec<Texture>)>, Vec<String>) {
        let red = super::super::tests::data_uri(&texture::tests::png(&[[255, 0, 0]]));
        let root: Root = serde_json::from_value(json!({
            "asset": {"version": "2.0"},
            "textures": [{"source": 0}, {}, {"source": 1}, {"source": 0, "sampler": 0}],
            "samplers": [{"wrapS": 33071, "magFilter": 9728}],
            "images": [{"uri": red}, {"uri": "not%20there.png"}],
            "materials": [material]
        }))
        .expect("glTF JSON");
        let files = Files::beside(Path::new("dir"));
        let buffers = Buffers::load(&root, None, &files).expect("no buffers");
        let mut textures = Textures::new(&root, &buffers, &files);
        let mut warnings = Warnings::default();
        let result = read(&root.materials[0], "material 0", &mut textures, &mut warnings);
        (result.map(|material| (material, textures.loaded)), warnings.into_lines())
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
        assert_eq!((m.exponent, m.metallic), (30.0, None));
        assert!(!m.mirror && !m.double_sided, "{m:?}");
    }

    #[test]
    fn what_is_smooth_is_a_mirror() {
        let m = material(json!({"doubleSided": true, "pbrMetallicRoughness": {
            "baseColorFactor": [0.9, 0.8, 0.7, 1.0], "metallicFactor": 1.0, "roughnessFactor": 0.0}}));
        assert_eq!((m.kd, m.ks), (Vec3::ZERO, Vec3::new(0.9, 0.8, 0.7)));
        assert_eq!(m.exponent, 1e5);
        assert!(m.mirror && m.double_sided, "{m:?}");
        for (roughness, mirror) in [(0.1, true), (0.11, false)] {
            let stone = material(json!({"pbrMetallicRoughness": {
                "metallicFactor": 0.0, "roughnessFactor": roughness}}));
            assert_eq!(stone.mirror, mirror, "a dielectric of roughness {roughness}");
            assert!(stone.kd.x > 0.9, "with its own colour: {}", stone.kd);
        }
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
    fn specular_glossiness_is_phong_already() {
        let m = material(json!({"extensions": {"KHR_materials_pbrSpecularGlossiness": {
            "diffuseFactor": [0.5, 0.25, 0.0, 1.0], "specularFactor": [0.5, 0.0, 0.0],
            "glossinessFactor": 0.5}}}));
        assert_eq!((m.kd, m.ks), (Vec3::new(0.25, 0.125, 0.0), Vec3::new(0.5, 0.0, 0.0)));
        assert_eq!(m.exponent, 30.0);
    }

    #[test]
    fn emission_is_factor_times_strength() {
        let m = material(json!({
            "emissiveFactor": [1.0, 0.5, 0.0], "emissiveTexture": {"index": 0},
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 8.0}}}));
        assert_eq!(m.emission, Vec3::new(8.0, 4.0, 0.0));
        assert_eq!(m.emission_texture, Some(Map::of(0)));
    }

    #[test]
    fn each_texture_has_its_own_coordinates() {
        let m = material(json!({
            "normalTexture": {"index": 0, "scale": 0.5, "extensions": {
                "KHR_texture_transform": {"scale": [4.0, 4.0], "texCoord": 1}}},
            "occlusionTexture": {"index": 0, "strength": 0.25},
            "pbrMetallicRoughness": {"baseColorTexture": {
            "index": 0, "texCoord": 1,
            "extensions": {"KHR_texture_transform": {
                "offset": [10.0, 20.0], "rotation": std::f32::consts::FRAC_PI_2, "scale": [2.0, 3.0]}}}}}));
        let base = m.base_texture.expect("it has one");
        assert_eq!(base.set, 1);
        // +u turns to −v, which is up: counter-clockwise as seen. +v turns to +u.
        let corner = base.transform.transform_point2(Vec2::ONE);
        assert!(corner.abs_diff_eq(Vec2::new(13.0, 18.0), 1e-5), "{corner}");
        let (normal, scale) = m.normal_map.expect("it has one");
        assert_eq!((normal.set, normal.transform.matrix2.x_axis.x, scale), (1, 4.0, 0.5));
        let (occlusion, strength) = m.occlusion.expect("it has one");
        assert_eq!((occlusion.set, strength), (0, 0.25));
        assert_ne!(occlusion.texture, base.texture, "numbers, not colours");
        assert_eq!(occlusion.texture, normal.texture, "decoded once");
    }

    #[test]
    fn samplers_wrap_and_filter() {
        let (result, warnings) = convert(json!({"emissiveTexture": {"index": 3}}));
        let (_, textures) = result.expect("a valid material");
        assert_eq!((textures[0].wrap, textures[0].nearest), ([Wrap::Clamp, Wrap::Repeat], true));
        assert!(warnings.is_empty(), "{warnings:?}");
    }

    #[test]
    fn alpha_follows_its_mode() {
        let with = |mode: &str| {
            material(json!({"alphaMode": mode, "pbrMetallicRoughness":
                            {"baseColorFactor": [1.0, 1.0, 1.0, 0.25]}}))
            .alpha
        };
        assert_eq!(with("OPAQUE"), Alpha::Opaque);
        assert_eq!(with("MASK"), Alpha::Mask { factor: 0.25, cutoff: 0.5 });
        assert_eq!(with("BLEND"), Alpha::Blend { factor: 0.25 });
        assert!(material(json!({"extensions": {"KHR_materials_unlit": {}}})).unlit, "unlit");
    }

    #[test]
    fn textures_of_a_metal_count_where_they_are_and_on_average() {
        // The texture is red: r and m are 0 times their factors.
        let m = material(json!({"pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.5, 0.5, 1.0], "metallicRoughnessTexture": {"index": 0}}}));
        assert!(m.kd.abs_diff_eq(Vec3::splat(0.48), 1e-6) && m.mirror, "{m:?}");
        assert!(m.metallic.is_some_and(|m| m.map.is_some()), "{m:?}");
        // f₀ takes the red; k_d's own texture is not counted twice.
        let m = material(json!({"pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.5, 0.5, 1.0], "baseColorTexture": {"index": 0}}}));
        assert_eq!((m.kd, m.ks), (Vec3::ZERO, Vec3::new(0.5, 0.0, 0.0)));
        assert!(m.metallic.is_some_and(|m| m.map.is_none()), "{m:?}");
        let m = material(json!({
            "extras": {"wrt": {"phong": {"kd": [0.1, 0.1, 0.1], "ks": [0.2, 0.2, 0.2], "n": 9}}},
            "pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": 0}}}));
        assert_eq!(m.metallic, None, "Phong parameters are final");
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
    fn frosted_glass_is_clear_and_that_is_said() {
        let glass = |roughness: f32| {
            convert(json!({
                "pbrMetallicRoughness": {"roughnessFactor": roughness, "metallicFactor": 0.0},
                "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1.0}}}))
        };
        assert_eq!(glass(0.0).1, [""; 0]);
        let said = "ignored the roughness of what light passes, which is clear here (material 0)";
        assert_eq!(glass(0.5).1, [said]);
    }

    #[test]
    fn what_is_ignored_is_said() {
        let (result, warnings) = convert(json!({
            "emissiveTexture": {"index": 0, "texCoord": 2},
            "extensions": {"KHR_materials_transmission": {"transmissionTexture": {"index": 0}}}}));
        assert!(result.is_ok(), "{result:?}");
        assert_eq!(
            warnings,
            [
                "ignored transmission textures (material 0)",
                "ignored texture coordinates beyond sets 0 and 1 (material 0)"
            ]
        );
    }
}
