//! The bytes of a `.gltf` or `.glb` as its JSON and its binary chunk.
//!
//! The gltf crate refuses, as a whole, files that ask for extensions it does
//! not know, and its validation indexes out of bounds on some malformed ones.
//! So required extensions are checked here, and every index where it is used.

use super::super::load::Warnings;
use ::gltf::binary::Glb;
use ::gltf::json::validation::Checked;
use ::gltf::json::{Index, Root, root};
use anyhow::{Context as _, bail, ensure};
use serde_json::Value;
use std::borrow::Cow;

/// Extensions whose data is used, or that need nothing from a loader.
const SUPPORTED: &[&str] = &[
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];

/// Extensions without which a file still shows its shapes in the right place.
const IGNORABLE: &[&str] = &[
    "KHR_animation_pointer",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_node_visibility",
    "KHR_xmp_json_ld",
];

/// Extensions without which there is nothing to show, and how to export a file again.
const REMEDIES: &[(&str, &str)] = &[
    ("KHR_draco_mesh_compression", "without Draco compression"),
    ("EXT_meshopt_compression", "without meshopt compression"),
    ("KHR_meshopt_compression", "without meshopt compression"),
    ("KHR_texture_basisu", "with PNG or JPEG textures in place of KTX2"),
    ("EXT_texture_webp", "with PNG or JPEG textures in place of WebP"),
    ("EXT_texture_avif", "with PNG or JPEG textures in place of AVIF"),
    ("MSFT_texture_dds", "with PNG or JPEG textures in place of DDS"),
];

/// A part of a file's bytes.
pub(super) type Chunk<'a> = Cow<'a, [u8]>;

/// Splits and parses a file's bytes.
///
/// # Errors
///
/// If they are not glTF 2.0, or require an extension that is not supported.
pub(super) fn parse<'a>(
    bytes: &'a [u8],
    warnings: &mut Warnings,
) -> anyhow::Result<(Root, Option<Chunk<'a>>)> {
    let (json, chunk) = split(bytes)?;
    let mut value: Value = serde_json::from_slice(&json).context("its JSON is malformed")?;
    let version = value.pointer("/asset/version").and_then(Value::as_str);
    let version = version.context("no glTF: its JSON has no asset.version")?;
    ensure!(version.starts_with("2."), "glTF version {version}: export it as glTF 2.0");
    check_extensions(&value, warnings)?;
    // The crate wants a list of nodes in every scene; glTF does not.
    for scene in value.get_mut("scenes").and_then(Value::as_array_mut).into_iter().flatten() {
        if let Some(scene) = scene.as_object_mut() {
            scene.entry("nodes").or_insert_with(|| Value::Array(Vec::new()));
        }
    }
    drop_pointer_channels(&mut value, warnings);
    let root = serde_json::from_value(value).context("its JSON is not that of a glTF")?;
    Ok((root, chunk))
}

/// A file's JSON and its binary chunk, if it has one.
fn split(bytes: &[u8]) -> anyhow::Result<(Chunk<'_>, Option<Chunk<'_>>)> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes.into(), None));
    }
    // The crate subtracts the header's 12 bytes from this length unchecked.
    let length = bytes.get(8..12).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    ensure!(length.is_some_and(|l| l >= 12), "the GLB ends early: it is cut short");
    let version = bytes[4..8].try_into().map(u32::from_le_bytes).unwrap_or_default();
    ensure!(version == 2, "GLB version {version}: export it as glTF 2.0");
    let glb = Glb::from_slice(bytes).context("malformed GLB")?;
    Ok((glb.json, glb.bin))
}

fn check_extensions(value: &Value, warnings: &mut Warnings) -> anyhow::Result<()> {
    let names = |key: &str| {
        let list = value.get(key).and_then(Value::as_array).into_iter().flatten();
        list.filter_map(Value::as_str).collect::<Vec<_>>()
    };
    let known = |name: &&str| SUPPORTED.contains(name) || IGNORABLE.contains(name);
    let required = names("extensionsRequired");
    let mut unknown: Vec<&str> = Vec::new();
    for name in required.into_iter().filter(|name| !known(name)) {
        if !unknown.contains(&name) {
            unknown.push(name);
        }
    }
    if !unknown.is_empty() {
        let remedy = |name: &str| REMEDIES.iter().find(|r| r.0 == name).map(|r| r.1);
        let mut without: Vec<String> = Vec::new();
        for name in &unknown {
            let remedy = match remedy(name) {
                Some(remedy) => remedy.to_owned(),
                None if unknown.len() == 1 => "without".to_owned(),
                None => format!("without {name}"),
            };
            if !without.contains(&remedy) {
                without.push(remedy);
            }
        }
        let (unknown, without) = (unknown.join(", "), without.join(" and "));
        bail!("requires {unknown}, not supported here: export it again {without}");
    }
    for name in names("extensionsUsed") {
        if !SUPPORTED.contains(&name) {
            warnings.ignored(&format!("extension {name}"), "");
        }
    }
    Ok(())
}

/// Removes animation channels that target no node, on which parsing fails.
fn drop_pointer_channels(value: &mut Value, warnings: &mut Warnings) {
    let animations = value.get_mut("animations").and_then(Value::as_array_mut);
    for animation in animations.into_iter().flatten() {
        let Some(channels) = animation.get_mut("channels").and_then(Value::as_array_mut) else {
            continue;
        };
        let before = channels.len();
        channels.retain(|channel| {
            let target = channel.get("target");
            target.is_some_and(|t| {
                t.get("node").is_some() && t.get("path").and_then(Value::as_str) != Some("pointer")
            })
        });
        if channels.len() < before {
            warnings.ignored("animation channels without a node", &named("animation", animation));
        }
    }
}

fn named(what: &str, value: &Value) -> String {
    let name = value.get("name").and_then(Value::as_str);
    name.map_or_else(|| what.to_owned(), |name| format!("{what} {name:?}"))
}

/// The object an index of the file names.
///
/// # Errors
///
/// If there is none; `what` says what it should have been.
pub(super) fn get<'a, T>(root: &'a Root, index: Index<T>, what: &str) -> anyhow::Result<&'a T>
where
    Root: root::Get<T>,
{
    root.get(index).with_context(|| format!("there is no {what} {}", index.value()))
}

/// The value of a field that has only some valid values.
///
/// # Errors
///
/// If it has another.
pub(super) fn valid<T: Clone>(checked: &Checked<T>, what: &str) -> anyhow::Result<T> {
    match checked {
        Checked::Valid(value) => Ok(value.clone()),
        Checked::Invalid => bail!("{what} has a value that glTF does not know"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn parse_value(value: &Value) -> (anyhow::Result<Root>, Vec<String>) {
        let mut warnings = Warnings::default();
        let bytes = value.to_string().into_bytes();
        let root = parse(&bytes, &mut warnings).map(|(root, _)| root);
        (root, warnings.into_lines())
    }

    fn error_of(bytes: &[u8]) -> String {
        let result = parse(bytes, &mut Warnings::default());
        format!("{:#}", result.expect_err("not a valid glTF"))
    }

    #[test]
    fn unknown_required_extensions_are_all_named() {
        let (root, _) = parse_value(&json!({
            "asset": {"version": "2.0"},
            "extensionsRequired": ["KHR_materials_ior", "KHR_draco_mesh_compression", "EXT_x"]
        }));
        let text = format!("{:#}", root.expect_err("two are unknown"));
        let expected = "requires KHR_draco_mesh_compression, EXT_x, not supported here: \
                        export it again without Draco compression and without EXT_x";
        assert_eq!(text, expected);
        let twice = ["KHR_draco_mesh_compression", "EXT_meshopt_compression"];
        let all = [twice, twice, ["KHR_meshopt_compression"; 2]].concat();
        let (root, _) =
            parse_value(&json!({"asset": {"version": "2.0"}, "extensionsRequired": all}));
        let text = format!("{:#}", root.expect_err("none is known"));
        let expected = "requires KHR_draco_mesh_compression, EXT_meshopt_compression, \
                        KHR_meshopt_compression, not supported here: export it again without \
                        Draco compression and without meshopt compression";
        assert_eq!(text, expected);
    }

    #[test]
    fn known_required_extensions_load_even_where_the_crate_refuses_them() {
        let (root, warnings) = parse_value(&json!({
            "asset": {"version": "2.0"},
            "extensionsUsed": ["KHR_materials_specular", "VENDOR_thing"],
            "extensionsRequired": ["KHR_materials_specular", "KHR_mesh_quantization"]
        }));
        assert!(root.is_ok(), "{root:?}");
        assert_eq!(warnings, ["ignored extension VENDOR_thing"]);
    }

    #[test]
    fn a_scene_may_have_no_nodes() {
        let (root, _) = parse_value(&json!({"asset": {"version": "2.0"}, "scenes": [{}]}));
        assert!(root.expect("valid glTF").scenes[0].nodes.is_empty(), "none");
    }

    #[test]
    fn pointer_channels_are_dropped_with_one_warning() {
        let channel = |target: Value| json!({"sampler": 0, "target": target});
        let (root, warnings) = parse_value(&json!({
            "asset": {"version": "2.0"},
            "animations": [{
                "name": "glow",
                "samplers": [],
                "channels": [
                    channel(json!({"path": "pointer"})),
                    channel(json!({"path": "translation"})),
                    channel(json!({"path": "translation", "node": 3}))
                ]
            }]
        }));
        let root = root.expect("what is left is valid");
        assert_eq!(root.animations[0].channels.len(), 1);
        assert_eq!(warnings, ["ignored animation channels without a node (animation \"glow\")"]);
    }

    #[test]
    fn other_files_and_versions_are_refused() {
        assert!(error_of(b"# obj").starts_with("its JSON is malformed"), "{}", error_of(b"# obj"));
        assert_eq!(error_of(b"{}"), "no glTF: its JSON has no asset.version");
        let old = br#"{"asset": {"version": "1.0"}}"#;
        assert_eq!(error_of(old), "glTF version 1.0: export it as glTF 2.0");
        let odd = br#"{"asset": {"version": "2.0"}, "meshes": 3}"#;
        assert!(error_of(odd).starts_with("its JSON is not that of a glTF"), "{}", error_of(odd));
    }

    #[test]
    fn short_glb_headers_are_errors() {
        assert_eq!(error_of(b"glTF"), "the GLB ends early: it is cut short");
        for length in [0_u32, 11, 12, 20, u32::MAX] {
            let bytes = [b"glTF".as_slice(), &2_u32.to_le_bytes(), &length.to_le_bytes()].concat();
            assert!(!error_of(&bytes).is_empty(), "a header of length {length} and nothing else");
        }
    }
}
