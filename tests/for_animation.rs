//! Bakes for the views of one animation: their pictures, and what is told of others.

use crate::support::picture::{Picture, relative_rms};
use crate::support::{Folder, fail, scene, succeed, tracer};
use glam::{DQuat, DVec3};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use std::sync::OnceLock;
use wrt_core::WctFile;

/// Where the camera is at 0, 1, 2 and 3 s, and what it looks at: it goes along the floor
/// of `quad` and has the emitter above its picture.
const POSES: [([f64; 3], [f64; 3]); 4] = [
    ([-0.8, 1.8, 1.5], [-0.1, 0.0, -0.2]),
    ([-0.3, 1.8, 1.6], [0.1, 0.0, -0.2]),
    ([0.2, 1.7, 1.6], [0.1, 0.0, -0.1]),
    ([0.7, 1.7, 1.6], [0.2, 0.0, 0.0]),
];

/// Cameras at rest at each of these and half-way between.
const STILLS: usize = 2 * POSES.len() - 1;

/// `quad` with a floor that is glossy, an animation `pass` of the camera `fly` and a
/// camera at rest at each of its keys and between them, `pose0` to `pose6`; and one,
/// `aside`, that is elsewhere.
fn flown(path: &dyn Fn(&str) -> String) -> String {
    let text = fs::read_to_string(scene("quad/quad.gltf")).expect("the quad");
    let mut document: Value = serde_json::from_str(&text).expect("glTF is JSON");
    for material in document["materials"].as_array_mut().expect("materials") {
        let phong = json!({ "kd": [0.3, 0.3, 0.3], "ks": [0.5, 0.5, 0.5], "n": 30.0 });
        material["extras"] = json!({ "wrt": { "phong": phong } });
    }
    let poses = POSES.map(|(eye, at)| look(eye.into(), at.into()));
    let mut nodes = vec![node("fly", poses[0])];
    for i in 0..STILLS {
        let [(from, turn), (to, end)] = [poses[i / 2], poses[i.div_ceil(2)]];
        let half = 0.5 * (i % 2) as f64;
        nodes.push(node(&format!("pose{i}"), (from.lerp(to, half), turn.slerp(end, half))));
    }
    nodes.push(node("aside", look(DVec3::new(2.2, 1.6, -0.3), DVec3::ZERO)));
    let first = document["nodes"].as_array().expect("nodes").len();
    let camera = json!({ "type": "perspective",
        "perspective": { "yfov": 0.45, "znear": 0.05, "aspectRatio": 4.0 / 3.0 } });
    document["cameras"] = json!([camera]);
    for (i, node) in nodes.into_iter().enumerate() {
        document["nodes"].as_array_mut().expect("nodes").push(node);
        let own = document["scenes"][0]["nodes"].as_array_mut().expect("the scene's nodes");
        own.push(json!(first + i));
    }
    let mut numbers: Vec<f32> = vec![0.0, 1.0, 2.0, 3.0];
    numbers.extend(poses.iter().flat_map(|p| p.0.as_vec3().to_array()));
    numbers.extend(poses.iter().flat_map(|p| p.1.as_quat().to_array()));
    let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
    fs::write(path("flight.bin"), &bytes).expect("the keys");
    let mut add = |list: &str, item: Value| {
        let list = &mut document[list];
        if list.is_null() {
            *list = json!([]);
        }
        let list = list.as_array_mut().expect("a list");
        list.push(item);
        list.len() - 1
    };
    let buffer = add("buffers", json!({ "uri": "flight.bin", "byteLength": bytes.len() }));
    let mut accessor = |offset: usize, length: usize, kind: &str| {
        let view = json!({ "buffer": buffer, "byteOffset": offset, "byteLength": length });
        let view = add("bufferViews", view);
        let range = (kind == "SCALAR").then(|| json!({ "min": [0.0], "max": [3.0] }));
        let mut item =
            json!({ "bufferView": view, "componentType": 5126, "count": 4, "type": kind });
        if let Some(range) = range {
            item["min"] = range["min"].clone();
            item["max"] = range["max"].clone();
        }
        add("accessors", item)
    };
    let times = accessor(0, 16, "SCALAR");
    let places = accessor(16, 48, "VEC3");
    let turns = accessor(64, 64, "VEC4");
    let sampler = |output: usize| json!({ "input": times, "output": output });
    let channel = |sampler: usize, path: &str| json!({ "sampler": sampler, "target": { "node": first, "path": path } });
    add(
        "animations",
        json!({ "name": "pass", "samplers": [sampler(places), sampler(turns)],
            "channels": [channel(0, "translation"), channel(1, "rotation")] }),
    );
    let path = path("flown.gltf");
    fs::write(&path, document.to_string()).expect("the edited scene");
    path
}

/// At `eye`, its −z towards `at`, upright.
fn look(eye: DVec3, at: DVec3) -> (DVec3, DQuat) {
    let back = (eye - at).normalize();
    let right = DVec3::Y.cross(back).normalize();
    (eye, DQuat::from_mat3(&glam::DMat3::from_cols(right, back.cross(right), back)))
}

fn node(name: &str, (place, turn): (DVec3, DQuat)) -> Value {
    json!({ "name": name, "camera": 0, "translation": place.to_array(),
        "rotation": turn.to_array() })
}

const ERROR: &str = "0.02";

/// Bakes to [`ERROR`], with more options.
fn bake(scene: &str, output: &str, more: &[&str]) -> WctFile {
    let options = ["--error", ERROR, "--checks", "0"];
    succeed(&[&["bake", scene, "-o", output], &options[..], more].concat());
    WctFile::read(output).expect("a file")
}

/// [`flown`] and what is baked of it for its animation, made once for all tests.
fn baked() -> &'static [String; 2] {
    static BAKED: OnceLock<[String; 2]> = OnceLock::new();
    BAKED.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("for_animation");
        fs::create_dir_all(&folder).expect("a folder for tests");
        let path = |name: &str| folder.join(name).to_str().expect("a UTF-8 path").to_owned();
        let (scene, wct) = (flown(&path), path("own.wct"));
        bake(&scene, &wct, &["--for-animation", "pass"]);
        [scene, wct]
    })
}

/// A camera's picture and what the program says beside, by `wct` or, without, by sums
/// over points of the emitter.
fn picture(folder: &Folder, scene: &str, camera: &str, wct: Option<&str>) -> (Picture, String) {
    let output = folder.path("picture.exr");
    let how = wct.map_or(vec!["--reference", "--error", "0.001"], |wct| vec!["--wct", wct]);
    let args = ["render", scene, "--camera", camera, "-o", &output, "--size", "48x36"];
    let found = tracer(&[&args[..], &how].concat());
    assert!(found.status.success(), "{camera}: {found:?}");
    (Picture::exr(&output), String::from_utf8(found.stderr).expect("UTF-8 on stderr"))
}

/// Pictures from keys of the flight and from between them, all together, against sums
/// over the emitter; and one from elsewhere, which is coarse, said to be so, and not dark.
#[test]
fn pictures_of_the_flight_keep_the_error_and_others_are_told_of() {
    let folder = Folder::new();
    let [scene, wct] = baked();
    let own = WctFile::read(wct).expect("a file");
    let whole = bake(scene, &folder.path("whole.wct"), &[]);
    let functions = |file: &WctFile| file.smooth.iter().map(|p| p.tree.len()).sum::<usize>();
    eprintln!("{} functions of {}", functions(&own), functions(&whole));
    assert!(3 * functions(&own) < 2 * functions(&whole), "{} are kept", functions(&own));
    let (mut found, mut expected) = (Vec::new(), Vec::new());
    for i in 0..STILLS {
        let camera = format!("pose{i}");
        let (picture_by_wct, said) = picture(&folder, scene, &camera, Some(wct));
        assert!(!said.contains("warning"), "{camera}: {said}");
        found.extend(picture_by_wct.pixels);
        expected.extend(picture(&folder, scene, &camera, None).0.pixels);
    }
    let error = relative_rms(&found, &expected);
    let (aside, said) = picture(&folder, scene, "aside", Some(wct));
    let coarse = relative_rms(&aside.pixels, &picture(&folder, scene, "aside", None).0.pixels);
    eprintln!("relative RMS {error:.2e}, aside {coarse:.2e}");
    assert!(error < 0.02, "{error}");
    assert!(error < coarse && coarse < 0.25, "aside: {coarse}");
    let warning = "baked for animation \"pass\", of which the view of camera \"aside\" is not";
    assert_eq!(said.matches(warning).count(), 1, "{said}");
}

#[test]
fn a_flight_is_told_once_of_views_that_it_was_not_baked_for() {
    let folder = Folder::new();
    let [scene, wct] = baked();
    let fly = |size: &str, name: &str| {
        let output = folder.path(name);
        let args = ["fly", scene, "--wct", wct, "-o", &output, "--fps", "3"];
        let found = tracer(&[&args[..], &["--size", size, "--samples", "1"]].concat());
        assert!(found.status.success(), "{found:?}");
        String::from_utf8(found.stderr).expect("UTF-8 on stderr")
    };
    assert_eq!(fly("24x18", "own.##.png"), "");
    assert_eq!(fly("36x18", "wide.##.png"), "");
    assert_eq!(fly("72x18", "wider.##.png").matches("warning").count(), 1);
}

#[test]
fn a_file_says_for_which_animation_it_is() {
    let folder = Folder::new();
    let ([scene, _], wct) = (baked(), folder.path("own.wct"));
    let for_pass = ["--for-animation", "pass", "--margin", "0.25", "--error", "0.3"];
    succeed(&[&["bake", scene, "-o", &wct, "--checks", "0"], &for_pass[..]].concat());
    let file = WctFile::read(&wct).expect("a file");
    assert_eq!(file.options["animation"], "pass");
    let json = succeed(&["inspect", &wct, "--json"]);
    let json: Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(json["options"]["animation"], "pass");
    assert_eq!(json["options"]["animation_margin"], "0.25");
    let table = succeed(&["inspect", &wct]);
    assert!(table.lines().any(|l| l.starts_with("animation ") && l.ends_with("pass")), "{table}");
}

#[test]
fn bytes_for_an_animation_depend_on_the_scene_alone() {
    let folder = Folder::new();
    let ([scene, wct], output) = (baked(), folder.path("own.wct"));
    bake(scene, &output, &["--for-animation", "pass", "--threads", "1"]);
    let [one, all] = [&output, wct].map(|path| fs::read(path).expect("just written"));
    assert!(one == all, "1 and all threads differ");
}

#[test]
fn what_cannot_be_baked_for_an_animation_is_refused() {
    let folder = Folder::new();
    let ([flown, _], output) = (baked(), folder.path("a.wct"));
    let refused = |code: i32, scene: &str, options: &[&str]| {
        fail(code, &[&["bake", scene, "-o", &output], options].concat())
    };
    let complaint = refused(1, flown, &["--for-animation", "past"]);
    assert!(complaint.contains("no animation named \"past\"; there are: pass"), "{complaint}");
    assert!(complaint.contains("flown.gltf"), "{complaint}");
    let complaint = refused(1, &scene("quad/quad.gltf"), &["--for-animation", "pass"]);
    assert!(complaint.contains("the scene has none"), "{complaint}");
    for margin in ["-0.1", "NaN", "inf", "wide"] {
        let options = ["--for-animation", "pass", "--margin", margin];
        let complaint = refused(2, flown, &options);
        assert!(complaint.contains("a length of 0 or more, in metres"), "{margin}: {complaint}");
    }
    let complaint = refused(2, flown, &["--margin", "0.1"]);
    assert!(complaint.contains("--for-animation"), "{complaint}");
    for haar in [["--basis", "haar"], ["--level", "3"]] {
        let complaint = refused(1, flown, &[&["--for-animation", "pass"], &haar[..]].concat());
        assert!(complaint.contains("--for-animation is for the smooth basis"), "{complaint}");
    }
    assert!(!folder.names().contains(&"a.wct".to_owned()), "{:?}", folder.names());
}
