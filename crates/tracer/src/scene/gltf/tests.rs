//! Whole files, and the helpers that make them.

use super::*;
use ::gltf::binary::{Glb, Header};
use glam::{Vec2, Vec4};
use serde_json::{Value, json};

/// `bytes` as a data URI.
pub(super) fn data_uri(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::from("data:application/octet-stream;base64,");
    for group in bytes.chunks(3) {
        let bits = (0..3).fold(0, |b, i| b << 8 | group.get(i).map_or(0, |&x| usize::from(x)));
        for i in 0..=group.len() {
            text.push(char::from(DIGITS[bits >> (18 - 6 * i) & 63]));
        }
    }
    text
}

/// A glTF with an accessor of floats for each array, and nothing else.
pub(super) fn accessors(arrays: &[(&str, &[f32])]) -> Value {
    let bytes: Vec<u8> =
        arrays.iter().flat_map(|(_, a)| a.iter().flat_map(|x| x.to_le_bytes())).collect();
    let (mut views, mut accessors, mut offset) = (Vec::new(), Vec::new(), 0);
    for (i, (shape, array)) in arrays.iter().enumerate() {
        let width = if *shape == "SCALAR" { 1 } else { usize::from(shape.as_bytes()[3] - b'0') };
        views.push(json!({"buffer": 0, "byteOffset": offset, "byteLength": 4 * array.len()}));
        accessors.push(json!({"bufferView": i, "componentType": 5126, "type": shape,
                              "count": array.len() / width}));
        offset += 4 * array.len();
    }
    json!({
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": bytes.len(), "uri": data_uri(&bytes)}],
        "bufferViews": views,
        "accessors": accessors
    })
}

pub(super) fn load_value(value: &Value) -> anyhow::Result<Loaded> {
    read(value.to_string().as_bytes(), Path::new("nowhere"))
}

/// A unit square of four vertices as a strip, with normals and coordinates.
fn square() -> Value {
    let mut value = accessors(&[
        ("VEC3", &[0., 0., 0., 1., 0., 0., 0., 1., 0., 1., 1., 0.]),
        ("VEC3", &[0., 0., 1., 0., 0., 1., 0., 0., 1., 0., 0., 1.]),
        ("VEC2", &[0., 1., 1., 1., 0., 0., 1., 0.]),
    ]);
    value["meshes"] = json!([{"primitives": [{
        "mode": 5, "attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}}]}]);
    value["nodes"] = json!([{"name": "pane", "mesh": 0}]);
    value
}

/// Everything at once: hierarchy, camera, light, texture, animation, extras.
fn rich() -> Value {
    let mut value = square();
    let texture = data_uri(&crate::scene::texture::tests::png(&[[255, 0, 0], [0, 0, 255]]));
    value["images"] = json!([{"uri": texture}]);
    value["textures"] = json!([{"source": 0}]);
    value["materials"] = json!([{
        "name": "glass", "emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0},
        "extras": {"wrt": {"emission": {"exponent": 4, "peak": [0, 0, 1]}}}}]);
    value["meshes"][0]["primitives"][0]["material"] = json!(0);
    value["cameras"] = json!([{"type": "perspective",
                               "perspective": {"yfov": 0.8, "znear": 0.1, "aspectRatio": 1.5}}]);
    value["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "spot", "color": [1, 0.5, 0], "intensity": 10, "range": 4,
         "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.5}}]}});
    value["nodes"] = json!([
        {"name": "root", "children": [1, 2, 3], "translation": [0, 0, 5]},
        {"name": "pane", "mesh": 0, "scale": [2, 3, 1], "extras": {"wrt": {"receiver": true}}},
        {"name": "eye", "camera": 0, "scale": [9, 9, 9]},
        {"name": "lamp", "extensions": {"KHR_lights_punctual": {"light": 0}}}
    ]);
    value["scenes"] = json!([{"nodes": [0], "extras": {"wrt": {"ambient": [0.5, 0.25, 0]}}}]);
    value["animations"] = json!([{
        "samplers": [{"input": 3, "output": 4}],
        "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}]}]);
    let moves = accessors(&[("SCALAR", &[0.0, 1.0]), ("VEC3", &[0., 0., 5., 0., 0., 7.])]);
    value["buffers"].as_array_mut().expect("a list").push(moves["buffers"][0].clone());
    for i in 0..2 {
        let mut view = moves["bufferViews"][i].clone();
        view["buffer"] = json!(1);
        value["bufferViews"].as_array_mut().expect("a list").push(view);
        let mut accessor = moves["accessors"][i].clone();
        accessor["bufferView"] = json!(3 + i);
        value["accessors"].as_array_mut().expect("a list").push(accessor);
    }
    value
}

/// `value` as a GLB, its first buffer in the binary chunk.
fn glb(mut value: Value) -> Vec<u8> {
    let uri = value["buffers"][0]["uri"].take();
    let uri = uri.as_str().expect("a data URI");
    let bin = buffer::resolve(uri, &Files::beside(Path::new(""))).expect("valid base64");
    let first = value["buffers"][0].as_object_mut().expect("an object");
    first.remove("uri");
    let header = Header { magic: *b"glTF", version: 2, length: 0 };
    let json = value.to_string().into_bytes();
    Glb { header, json: json.into(), bin: Some(bin.into()) }.to_vec().expect("to memory")
}

#[test]
fn a_strip_has_its_attributes() {
    let loaded = load_value(&square()).expect("valid");
    let mesh = &loaded.scene.meshes[0];
    assert_eq!(mesh.name, "pane");
    assert_eq!(mesh.triangles, [[0, 1, 2], [1, 3, 2]]);
    assert_eq!(mesh.normals, [Vec3::Z; 4]);
    assert_eq!(mesh.uvs[0][3], Vec2::X);
    // No material: the plain one.
    assert_eq!(loaded.scene.materials[mesh.material].kd, Vec3::splat(0.5));
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
}

#[test]
fn a_rich_scene_has_all_its_parts() {
    for bytes in [rich().to_string().into_bytes(), glb(rich())] {
        let Loaded { scene, warnings, files } = read(&bytes, Path::new("nowhere")).expect("valid");
        assert!(warnings.is_empty(), "{warnings:?}");
        assert!(files.is_empty(), "all is in it: {files:?}");
        let mesh = &scene.meshes[0];
        assert!(mesh.receiver, "marked so");
        assert_eq!(mesh.positions[3], DVec3::new(2.0, 3.0, 5.0));
        assert_eq!(mesh.transform.transform_point3(DVec3::ONE), DVec3::new(2.0, 3.0, 6.0));
        let material = &scene.materials[mesh.material];
        assert_eq!((material.name.as_str(), material.emission), ("glass", Vec3::ONE));
        assert_eq!(material.lobe.as_ref().map(|l| (l.exponent, l.peak)), Some((4.0, DVec3::Z)));
        assert_eq!(scene.textures[0].nearest(Vec2::ZERO).truncate(), Vec3::X);
        let camera = &scene.cameras[0];
        assert_eq!((camera.name.as_str(), camera.aspect), ("eye", Some(1.5)));
        assert_eq!(camera.transform, DAffine3::from_translation(DVec3::Z * 5.0));
        let light = &scene.lights[0];
        assert_eq!(light.intensity, Vec3::new(10.0, 5.0, 0.0));
        assert_eq!((light.position, light.direction), (DVec3::Z * 5.0, DVec3::NEG_Z));
        assert_eq!(light.range, Some(4.0));
        let LightKind::Spot { inner, outer } = light.kind else { panic!("{light:?}") };
        assert!((inner - 0.1).abs() < 1e-6 && (outer - 0.5).abs() < 1e-6, "{light:?}");
        assert_eq!(scene.ambient, Vec3::new(0.5, 0.25, 0.0));
        let fly = &scene.animations[0];
        assert_eq!((fly.name.as_str(), fly.duration, fly.keys.len()), ("animation0", 1.0, 61));
        assert_eq!(fly.keys[60].1.translation, DVec3::Z * 7.0);
    }
}

#[test]
fn a_mirrored_node_keeps_its_front() {
    let mut value = square();
    value["nodes"][0]["scale"] = json!([-1, 1, 1]);
    let mesh = &load_value(&value).expect("valid").scene.meshes[0];
    let [a, b, c] = mesh.triangles[0].map(|i| mesh.positions[i as usize]);
    assert!((b - a).cross(c - a).z > 0.0, "the front still looks along +z");
}

#[test]
fn instances_and_primitives_have_names_of_their_own() {
    let mut value = square();
    let primitive = value["meshes"][0]["primitives"][0].clone();
    value["meshes"][0]["name"] = json!("shape");
    value["meshes"][0]["primitives"] = json!([primitive, primitive]);
    value["nodes"] = json!([{"name": "pane", "mesh": 0}, {"mesh": 0}]);
    let loaded = load_value(&value).expect("valid");
    let names: Vec<&str> = loaded.scene.meshes.iter().map(|m| m.name.as_str()).collect();
    assert_eq!(names, ["pane", "pane#2", "shape", "shape#2"]);
}

/// Puts `new` where a JSON pointer says.
fn set(value: &mut Value, path: &str, new: Value) {
    let (parent, key) = path.rsplit_once('/').expect("a pointer");
    match value.pointer_mut(parent).expect("it is there") {
        Value::Array(list) => list[key.parse::<usize>().expect("an index")] = new,
        object => object[key] = new,
    }
}

#[test]
fn malformed_parts_are_named() {
    let cases: &[(&str, Value, &str)] = &[
        ("/nodes/0/mesh", json!(4), "node \"pane\": there is no mesh 4"),
        (
            "/meshes/0/primitives/0/attributes/POSITION",
            json!(9),
            "POSITION: there is no accessor 9",
        ),
        ("/meshes/0/primitives/0/mode", json!(9), "mode has a value"),
        ("/meshes/0/primitives/0/material", json!(3), "there is no material 3"),
        ("/meshes/0/primitives/0/indices", json!(2), "indices: accessor 2 holds F32"),
        ("/accessors/0/count", json!(5), "5 elements reach past the end of buffer view 0"),
        ("/accessors/1/count", json!(3), "NORMAL: 3 for 4 vertices"),
        ("/accessors/2/count", json!(3), "TEXCOORD_0: 3 for 4 vertices"),
        ("/bufferViews/0/buffer", json!(1), "there is no buffer 1"),
        ("/buffers/0/byteLength", json!(9999), "buffer 0: it holds 128 bytes, fewer than"),
        ("/buffers/0/uri", json!("lost.bin"), "buffer 0: cannot read nowhere/lost.bin"),
        ("/buffers/0/uri", json!(null), "the file no binary chunk left"),
        ("/nodes/0/camera", json!(0), "there is no camera 0"),
        ("/scene", json!(2), "there is no scene 2"),
        ("/nodes/0/extras", json!({"wrt": {"reciever": true}}), "unknown field `reciever`"),
    ];
    for (path, bad, expected) in cases {
        let mut value = square();
        set(&mut value, path, bad.clone());
        let error = load_value(&value).expect_err("malformed");
        let text = format!("{error:#}");
        assert!(text.contains(expected), "{path}: {text}");
    }
}

#[test]
fn indices_and_positions_are_checked() {
    let mut value = accessors(&[("VEC3", &[0., 0., 0., 1., 0., 0., 0., f32::NAN, 0.])]);
    value["meshes"] = json!([{"primitives": [{"attributes": {"POSITION": 0}}]}]);
    value["nodes"] = json!([{"mesh": 0}]);
    let text = format!("{:#}", load_value(&value).expect_err("not a number"));
    assert_eq!(text, "node 0: primitive 0: POSITION: vertex 2 is not finite");

    let mut value = square();
    // The bytes of a float 1.0 read as an index.
    let index = json!({"bufferView": 0, "byteOffset": 12, "componentType": 5125,
                       "type": "SCALAR", "count": 3});
    value["accessors"].as_array_mut().expect("a list").push(index);
    value["meshes"][0]["primitives"][0]["indices"] = json!(3);
    let text = format!("{:#}", load_value(&value).expect_err("past the last vertex"));
    assert!(text.ends_with("indices: there is no vertex 1065353216, only 4 of them"), "{text}");
}

#[test]
fn cameras_and_lights_out_of_range_are_errors() {
    for (path, bad, expected) in [
        ("/cameras/0/perspective/yfov", json!(0), "node \"eye\": yfov is 0"),
        ("/cameras/0/perspective/yfov", json!(4), "yfov is 4"),
        ("/cameras/0/perspective/aspectRatio", json!(-1), "aspect ratio is -1,"),
        ("/cameras/0/perspective", json!(null), "its camera has no perspective"),
        ("/cameras/0/type", json!("fisheye"), "type has a value"),
        ("/nodes/2/scale", json!([0, 0, 0]), "its camera has no direction"),
        ("/nodes/3/scale", json!([0, 0, 0]), "its light has no direction"),
        ("/extensions/KHR_lights_punctual/lights/0/intensity", json!(-1), "intensity is"),
        ("/extensions/KHR_lights_punctual/lights/0/spot", json!(null), "has no cone"),
        ("/extensions/KHR_lights_punctual/lights/0/spot/innerConeAngle", json!(1), "cones are 1"),
        ("/scenes/0/extras/wrt/ambient/0", json!(-1), "scene 0: extras.wrt: ambient is"),
    ] {
        let mut value = rich();
        set(&mut value, path, bad);
        let text = format!("{:#}", load_value(&value).expect_err("out of range"));
        assert!(text.contains(expected), "{path}: {text}");
    }
}

#[test]
fn what_is_not_supported_is_said_once() {
    let mut value = rich();
    value["meshes"][0]["primitives"] = json!([
        {"mode": 0, "attributes": {"POSITION": 0}},
        {"mode": 1, "attributes": {"POSITION": 0, "COLOR_1": 0}}
    ]);
    value["extensionsUsed"] = json!(["KHR_lights_punctual", "KHR_materials_clearcoat"]);
    value["scenes"].as_array_mut().expect("a list").push(json!({"nodes": []}));
    let loaded = load_value(&value).expect("what is left is valid");
    assert!(loaded.scene.meshes.is_empty(), "nothing left");
    assert_eq!(
        loaded.warnings,
        [
            "ignored extension KHR_materials_clearcoat",
            "ignored points and lines (node \"pane\" and 1 more)",
            "ignored vertex colours beyond the first (node \"pane\")",
            "ignored scenes other than the default one",
        ]
    );
}

#[test]
fn an_orthographic_camera_shows_its_magnification() {
    let mut value = rich();
    let magnification = json!({"xmag": 3, "ymag": -2, "zfar": 10, "znear": 0.1});
    value["cameras"][0] = json!({"type": "orthographic", "orthographic": magnification});
    let camera = &load_value(&value).expect("valid").scene.cameras[0];
    assert_eq!(camera.projection, Projection::Orthographic { half_height: 2.0 });
    assert_eq!(camera.aspect, Some(1.5));
}

#[test]
fn vertices_have_colours_tangents_and_two_sets_of_texture_coordinates() {
    let corners = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let mut value = accessors(&[
        ("VEC3", &corners),
        ("VEC3", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]),
        ("VEC3", &[0.5; 9]),
        ("VEC4", &[1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0]),
        ("VEC2", &[0.25; 6]),
    ]);
    value["meshes"] = json!([{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1,
        "COLOR_0": 2, "TANGENT": 3, "TEXCOORD_1": 4}}]}]);
    value["nodes"] = json!([{"mesh": 0, "scale": [-2.0, 1.0, 1.0]}]);
    let mesh = &load_value(&value).expect("valid").scene.meshes[0];
    assert_eq!(mesh.colours, [Vec4::new(0.5, 0.5, 0.5, 1.0); 3]);
    // The reflection turns the tangent, and the bitangent with it.
    assert_eq!(mesh.tangents, [Vec4::new(-1.0, 0.0, 0.0, -1.0); 3]);
    assert!(mesh.uvs[0].is_empty(), "there is no set 0");
    assert_eq!(mesh.uvs[1], [Vec2::splat(0.25); 3]);
}

#[test]
fn truncated_and_damaged_files_do_not_panic() {
    let whole = glb(rich());
    let (mut loads, mut fails) = (0, 0);
    let mut attempt = |bytes: &[u8]| match read(bytes, Path::new("nowhere")) {
        Ok(_) => loads += 1,
        Err(_) => fails += 1,
    };
    for len in 0..whole.len() {
        attempt(&whole[..len]);
    }
    for at in 0..whole.len() {
        // A digit more or less in the JSON is where indices go astray.
        for byte in [whole[at] ^ 1, whole[at] ^ 0x80, whole[at].wrapping_add(8), b'9', 0, 0xff] {
            let mut damaged = whole.clone();
            damaged[at] = byte;
            attempt(&damaged);
        }
    }
    assert!(loads > 0 && fails > whole.len(), "{loads} load, {fails} do not, none panic");
}
