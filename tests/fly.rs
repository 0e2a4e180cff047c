//! Flights and interruptions: what exists is never lost, and what is there is not
//! done again.

use crate::support::{Folder, chapel_wct, fail, scene, succeed, tracer};
use serde_json::{Value, json};
use std::fs;
use std::process::Output;

/// A flight of three pictures, 16x9.
fn try_to_fly(folder: &Folder, more: &[&str]) -> Output {
    let (chapel, output) = (scene("chapel/chapel.gltf"), folder.path("frame.##.png"));
    let args = ["fly", &chapel, "--wct", chapel_wct(), "-o", &output, "--json"];
    let quick = ["--fps", "0.2", "--size", "16x9", "--samples", "1", "--emitter-grid", "1"];
    tracer(&[&args[..], &quick, more].concat())
}

/// The same; what it prints.
fn fly(folder: &Folder, more: &[&str]) -> Value {
    let flown = try_to_fly(folder, more);
    assert!(flown.status.success(), "{flown:?}");
    serde_json::from_slice(&flown.stdout).expect("JSON")
}

#[test]
fn a_flight_goes_on_where_it_was_left() {
    let folder = Folder::new();
    let whole = fly(&folder, &[]);
    assert_eq!((&whole["rendered"], &whole["skipped"]), (&3.into(), &0.into()), "{whole}");
    assert_eq!((&whole["interrupted"], &whole["left"]), (&false.into(), &0.into()), "{whole}");
    let frames = ["frame.00.png", "frame.01.png", "frame.02.png"];
    assert_eq!(folder.names(), frames);
    let bytes = |name: &str| fs::read(folder.path(name)).expect("a picture");
    let middle = bytes(frames[1]);
    assert!(bytes(frames[0]) != middle, "the camera does not move");
    fs::remove_file(folder.path(frames[1])).expect("it is there");
    // Not to be touched: another program's picture of that size.
    let other = image::RgbImage::from_pixel(16, 9, image::Rgb([7, 8, 9]));
    other.save(folder.path(frames[0])).expect("a writable file");
    let other = bytes(frames[0]);
    let flown = try_to_fly(&folder, &[]);
    assert!(flown.status.success(), "{flown:?}");
    let rest: Value = serde_json::from_slice(&flown.stdout).expect("JSON");
    assert_eq!((&rest["rendered"], &rest["skipped"]), (&1.into(), &2.into()), "{rest}");
    let said = String::from_utf8(flown.stderr).expect("UTF-8 on stderr");
    assert_eq!(said.matches("it does not say how it was made").count(), 1, "{said}");
    assert!(said.contains("frame.00.png: it does not say"), "{said}");
    assert!(bytes(frames[1]) == middle, "another picture than before");
    assert!(bytes(frames[0]) == other, "rendered anew");
}

/// What was made with other options is neither taken for finished nor lost.
#[test]
fn pictures_of_other_settings_are_refused_by_name() {
    let folder = Folder::new();
    fly(&folder, &["--start", "1", "--end", "1"]);
    let bytes = || fs::read(folder.path("frame.01.png")).expect("a picture");
    let before = bytes();
    let refused = |more: &[&str], expected: &str| {
        let chapel = scene("chapel/chapel.gltf");
        let output = folder.path("frame.##.png");
        let args = ["fly", &chapel, "--wct", chapel_wct(), "-o", &output];
        let quick = ["--size", "16x9", "--emitter-grid", "1"];
        let complaint = fail(1, &[&args[..], &quick, more].concat());
        let said =
            complaint.contains("frame.01.png: it is there already, made with other settings");
        assert!(said, "{complaint}");
        assert!(complaint.contains(expected), "{complaint}");
    };
    refused(&["--fps", "0.2", "--samples", "1", "--exposure", "1"], "exposure 0.0, not 1.0");
    refused(&["--fps", "0.4", "--samples", "1"], "seconds 5.0, not 2.5");
    refused(&["--fps", "0.2", "--samples", "3"], "samples 1, not 3");
    assert!(bytes() == before, "not as it was");
    assert_eq!(folder.names(), ["frame.01.png"]);
}

/// Files of the same names with something else in them make other pictures.
#[test]
fn a_flight_does_not_go_on_from_other_files() {
    let folder = Folder::new();
    let (own, wct, output) = (folder.path("a.wct"), folder.path("b.wct"), folder.path("#.exr"));
    fs::copy(chapel_wct(), &own).expect("a copy");
    for name in ["chapel.gltf", "chapel.bin", "flags.png", "wall.png", "window.png", "wood.png"] {
        fs::copy(scene(&format!("chapel/{name}")), folder.path(name)).expect("a copy");
    }
    let chapel = folder.path("chapel.gltf");
    let quick = ["--end", "0", "--size", "8x6", "--samples", "1", "--emitter-grid", "1"];
    let args = [&["fly", &chapel, "--wct", &own, "-o", &output][..], &quick].concat();
    succeed(&args);
    succeed(&args);
    // A texture is content of the scene, whose own file is as it was.
    fs::copy(scene("chapel/flags.png"), folder.path("wall.png")).expect("a copy");
    let complaint = fail(1, &args);
    let expected =
        "0.exr: it is there already, made with other settings (another content of the scene)";
    assert!(complaint.contains(expected), "{complaint}");
    fs::copy(scene("chapel/wall.png"), folder.path("wall.png")).expect("a copy");
    succeed(&args);
    succeed(&["convert", &own, "--error", "0.1", "-o", &wct]);
    fs::rename(&wct, &own).expect("in its place");
    let complaint = fail(1, &args);
    let expected =
        "0.exr: it is there already, made with other settings (another content of the wct)";
    assert!(complaint.contains(expected), "{complaint}");
}

#[test]
fn a_part_of_a_flight_becomes_a_video() {
    let folder = Folder::new();
    let video = folder.path("all.png");
    fly(&folder, &["--start", "1", "--end", "2", "--video", &video]);
    assert_eq!(folder.names(), ["all.png", "frame.01.png", "frame.02.png"]);
    let file = std::io::BufReader::new(fs::File::open(&video).expect("the video"));
    let mut reader = png::Decoder::new(file).read_info().expect("a PNG");
    let animation = *reader.info().animation_control().expect("an animation");
    assert_eq!(animation.num_frames, 2);
    for name in ["frame.01.png", "frame.02.png"] {
        let mut pixels = vec![0; reader.output_buffer_size().expect("a small picture")];
        reader.next_frame(&mut pixels).expect("a picture");
        let frame = image::open(folder.path(name)).expect("a PNG").into_rgb8();
        assert!(pixels == frame.into_raw(), "{name} is not in the video");
    }
    let chapel = scene("chapel/chapel.gltf");
    let output = folder.path("frame.##.png");
    let args = ["fly", &chapel, "--wct", chapel_wct(), "-o", &output, "--fps", "0.2"];
    let complaint = fail(1, &[&args[..], &["--end", "3"]].concat());
    assert!(complaint.contains("the flight has pictures 0 to 2"), "{complaint}");
    let complaint = fail(1, &args);
    assert!(complaint.contains("frame.01.png: it is there already, 16x9 pixels"), "{complaint}");
    let frame = folder.path("frame.01.png");
    let small = [&args[..], &["--size", "16x9"]].concat();
    let complaint = fail(1, &[&small[..], &["--video", &frame]].concat());
    assert!(complaint.contains("that is one of the pictures"), "{complaint}");
    // Other films are ffmpeg's to make, of the pictures that these flags ask for.
    let film = folder.path("all.webp");
    let complaint = fail(1, &[&small[..], &["--start", "1", "--video", &film]].concat());
    let frames = folder.path("frame.%02d.png");
    let expected = format!("ffmpeg -framerate 0.2 -start_number 1 -i {frames} {film}");
    assert!(complaint.contains("name it .png or .apng"), "{complaint}");
    assert!(complaint.contains(&expected), "{complaint}");
    let apng = folder.path("all.apng");
    fly(&folder, &["--start", "1", "--end", "2", "--video", &apng]);
    let same = fs::read(&apng).expect("the video") == fs::read(&video).expect("the video");
    assert!(same, "all.apng is not all.png");
}

#[cfg(target_os = "linux")] // for /proc
mod stopped {
    use super::*;
    use std::process::{Child, Command, Stdio};
    use std::time::Duration;

    /// Starts a picture that takes minutes, in 4000 rows that take little each; there
    /// is stone wherever it looks.
    fn start(command: &str, output: &str, more: &[&str]) -> Child {
        Command::new(env!("CARGO_BIN_EXE_tracer"))
            .args([command, &scene("chapel/chapel.gltf"), "--wct", chapel_wct(), "-o", output])
            .args(["--size", "8x4000", "--samples", "1000", "--threads", "1"])
            .args(more)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program to test")
    }

    /// Sends `signal` to a picture in the making, once the program listens.
    fn stopped_by(signal: &str, mut child: Child) -> Output {
        while !listens(child.id()) {
            let ended = child.try_wait().expect("a child");
            assert!(ended.is_none(), "it ended before it listened: {ended:?}");
            std::thread::sleep(Duration::from_millis(50));
        }
        // `nohup` would be of no use.
        let heard = mask(&child.id().to_string(), "SigCgt");
        assert_eq!(heard & HANG_UP, 0, "it listens to SIGHUP");
        // Time for a row or two.
        std::thread::sleep(Duration::from_secs(1));
        let sent = Command::new("kill").args([signal, &child.id().to_string()]).status();
        assert!(sent.expect("kill").success(), "it has ended before");
        child.wait_with_output().expect("its end")
    }

    /// Signal masks of a process, 0 if there is none.
    fn mask(process: &str, kind: &str) -> u64 {
        let status = fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
        let mask = status.lines().find_map(|line| line.strip_prefix(kind)?.strip_prefix(':'));
        mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
    }

    /// SIGINT and SIGTERM in such a mask: bit n − 1 is signal n.
    const HEARD: u64 = 1 << 1 | 1 << 14;
    /// SIGHUP.
    const HANG_UP: u64 = 1;

    fn listens(process: u32) -> bool {
        mask(&process.to_string(), "SigCgt") & HEARD == HEARD
    }

    #[test]
    fn ctrl_c_keeps_the_picture_that_was_there() {
        keeps_the_picture_that_was_there("-INT");
    }

    #[test]
    fn what_an_interrupted_flight_took_is_told_as_json() {
        let folder = Folder::new();
        let child = start("fly", &folder.path("#.png"), &["--fps", "0.2", "--json"]);
        let ended = stopped_by("-INT", child);
        let complaint = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(1), "{complaint}");
        assert!(complaint.contains("stopped with 0 pictures rendered and 3 left"), "{complaint}");
        let told: Value = serde_json::from_slice(&ended.stdout).expect("JSON");
        assert_eq!((&told["interrupted"], &told["left"]), (&true.into(), &3.into()), "{told}");
        assert_eq!((&told["rendered"], &told["skipped"]), (&0.into(), &0.into()), "{told}");
        assert_eq!(folder.names(), ["0.partial.png"]);
    }

    /// As batch systems and service managers send it.
    #[test]
    fn a_request_to_terminate_keeps_the_picture_that_was_there() {
        keeps_the_picture_that_was_there("-TERM");
    }

    fn keeps_the_picture_that_was_there(signal: &str) {
        let folder = Folder::new();
        let output = folder.path("a.png");
        fs::write(&output, "hours of work").expect("a file");
        let ended = stopped_by(signal, start("render", &output, &[]));
        let complaint = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(1), "{complaint}");
        let left = complaint.split("a.partial.png: stopped with ").nth(1);
        let left: Option<usize> = left.and_then(|rest| rest.split(' ').next()?.parse().ok());
        let left = left.unwrap_or_else(|| panic!("rows left: {complaint}"));
        assert_eq!(folder.names(), ["a.partial.png", "a.png"], "what is there");
        assert_eq!(fs::read(&output).expect("still there"), b"hours of work", "{complaint}");
        let partial = image::open(folder.path("a.partial.png")).expect("a PNG").into_rgb8();
        assert_eq!(partial.dimensions(), (8, 4000), "a whole picture");
        // Between the rows said to be left, which are black, is what was done: nothing
        // if the signal came before the first row.
        let lit = partial.rows().filter(|row| row.clone().any(|p| p.0 != [0; 3])).count();
        assert_eq!(lit, 4000 - left, "{complaint}");
    }

    #[test]
    fn a_killed_program_leaves_nothing_half_written() {
        let folder = Folder::new();
        let output = folder.path("a.png");
        fs::write(&output, "hours of work").expect("a file");
        stopped_by("-KILL", start("render", &output, &[]));
        assert_eq!(folder.names(), ["a.png"]);
        assert_eq!(fs::read(&output).expect("still there"), b"hours of work");
    }
}

/// A card and a lamp on an arm over a floor; the arm and the card are where
/// `placed` says, and move as `moves` says.
fn mobile(folder: &Folder, name: &str, placed: [Value; 2], moves: bool, more: &Value) -> String {
    let floats: &[&[f32]] = &[
        // The floor's corners and the card's, two triangles each.
        &[-3., 0., 3., 3., 0., 3., 3., 0., -3., -3., 0., 3., 3., 0., -3., -3., 0., -3.],
        &[-0.5, 0., 0., 0.5, 0., 0., 0.5, 1., 0., -0.5, 0., 0., 0.5, 1., 0., -0.5, 1., 0.],
        // Times; the arm's places by steps, the card's turns and scales.
        &[0.0, 1.0, 2.0],
        &[0., 2., 0., 1., 2., 0.5, 1., 3., 1.],
        &[0., 0., 0., 1., 0., 0.6, 0., 0.8, 0., 0.8, 0., 0.6],
        // By a spline: in-tangent, value, out-tangent.
        &[
            0., 0., 0., 0., 0., 0., 1., 0., 1., 0., 0., 0., 1., 2., 1., 0., 0., 0., 0., 0., 0., 2.,
            1., -1., 0., 0., 0.,
        ],
    ];
    let bytes: Vec<u8> = floats.concat().iter().flat_map(|x| x.to_le_bytes()).collect();
    fs::write(folder.path("mobile.bin"), &bytes).expect("a writable folder");
    let mut start = 0;
    let (mut views, mut accessors) = (Vec::new(), Vec::new());
    for (i, array) in floats.iter().enumerate() {
        let (shape, width) = [("VEC3", 3), ("SCALAR", 1), ("VEC4", 4)][[0, 0, 1, 0, 2, 0][i]];
        views.push(json!({"buffer": 0, "byteOffset": start, "byteLength": 4 * array.len()}));
        accessors.push(json!({"bufferView": i, "componentType": 5126, "type": shape,
                              "count": array.len() / width}));
        start += 4 * array.len();
    }
    let [mut arm, mut card] = placed;
    (arm["name"], arm["children"]) = ("arm".into(), json!([1]));
    (card["name"], card["mesh"]) = ("card".into(), json!(1));
    let mut value = json!({
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": bytes.len(), "uri": "mobile.bin"}],
        "bufferViews": views, "accessors": accessors,
        "materials": [{"name": "grey", "doubleSided": true}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]},
                   {"primitives": [{"attributes": {"POSITION": 1}, "material": 0}]}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.9, "znear": 0.1}}],
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": {"lights": [
            {"type": "spot", "intensity": 30, "spot": {"outerConeAngle": 1.2}}]}},
        "nodes": [
            arm,
            {"name": "lamp", "rotation": [-0.6, 0, 0, 0.8],
             "extensions": {"KHR_lights_punctual": {"light": 0}}},
            card,
            {"name": "floor", "mesh": 0},
            {"name": "eye", "camera": 0, "translation": [0, 1, 6]}
        ],
        "scenes": [{"nodes": [0, 2, 3, 4], "extras": {"wrt": {"ambient": [0.1, 0.1, 0.1]}}}],
        "scene": 0
    });
    if moves {
        value["animations"] = json!([{"name": "turn", "samplers": [
            {"input": 2, "output": 3, "interpolation": "STEP"},
            {"input": 2, "output": 4, "interpolation": "LINEAR"},
            {"input": 2, "output": 5, "interpolation": "CUBICSPLINE"},
        ], "channels": [
            {"sampler": 0, "target": {"node": 0, "path": "translation"}},
            {"sampler": 1, "target": {"node": 2, "path": "rotation"}},
            {"sampler": 2, "target": {"node": 2, "path": "scale"}},
        ]}]);
    }
    for (pointer, new) in more.as_object().into_iter().flatten() {
        *value.pointer_mut(pointer).expect("there is one") = new.clone();
    }
    let path = folder.path(name);
    fs::write(&path, value.to_string()).expect("a writable folder");
    path
}

#[test]
fn what_an_animation_moves_is_seen_as_if_authored_where_it_is() {
    let folder = Folder::new();
    let rest = || [json!({"translation": [0, 2, 0]}), json!({})];
    let flight = mobile(&folder, "flight.gltf", rest(), true, &json!({}));
    let quick = ["--size", "48x36", "--samples", "2"];
    let output = folder.path("frame.#.png");
    let printed =
        succeed(&[&["fly", &flight, "-o", &output, "--fps", "1", "--json"][..], &quick].concat());
    let printed: Value = serde_json::from_str(&printed).expect("JSON");
    assert_eq!((&printed["rendered"], &printed["animation"]), (&3.into(), &"turn".into()));
    let turned = [[0.0, 0.0, 0.0, 1.0], [0.0, 0.6, 0.0, 0.8], [0.0, 0.8, 0.0, 0.6]];
    let scaled = [[1.0, 0.0, 1.0], [1.0, 2.0, 1.0], [2.0, 1.0, -1.0]];
    let placed = [[0.0, 2.0, 0.0], [1.0, 2.0, 0.5], [1.0, 3.0, 1.0]];
    let mut frames = Vec::new();
    for i in 0..3 {
        let authored =
            [json!({"translation": placed[i]}), json!({"rotation": turned[i], "scale": scaled[i]})];
        let still = mobile(&folder, "still.gltf", authored, false, &json!({}));
        let output = folder.path("still.png");
        succeed(&[&["render", &still, "-o", &output][..], &quick].concat());
        let pixels = |path| image::open(path).expect("a PNG").into_rgb8().into_raw();
        let frame = pixels(folder.path(&format!("frame.{i}.png")));
        assert!(frame == pixels(output), "picture {i} is another");
        assert!(frame.iter().any(|&p| p > 100), "picture {i} is dark");
        assert!(!frames.contains(&frame), "picture {i} is as one before");
        frames.push(frame);
    }
}

#[test]
fn what_moves_although_it_is_baked_is_told() {
    let folder = Folder::new();
    let lamp = json!({"name": "grey", "doubleSided": true, "emissiveFactor": [1, 1, 1]});
    let mut more = json!({"/meshes/0/primitives/0/material": 0, "/materials": [{}, lamp]});
    more["/meshes/1/primitives/0/material"] = json!(1);
    let rest = || [json!({"translation": [0, 2, 0]}), json!({})];
    let output = folder.path("frame.#.png");
    let told = |path: &str| {
        let wct = folder.path("mobile.wct");
        succeed(&["bake", path, "-o", &wct, "--basis", "haar", "--level", "1", "--checks", "0"]);
        let args = ["fly", path, "--wct", &wct, "-o", &output, "--end", "0", "--size", "8x6"];
        let flown = tracer(&args);
        assert!(flown.status.success(), "{flown:?}");
        fs::remove_file(folder.path("frame.0.png")).expect("a picture");
        String::from_utf8(flown.stderr).expect("UTF-8 on stderr")
    };
    let said = told(&mobile(&folder, "emitter.gltf", rest(), true, &more));
    assert!(said.contains("the emitter \"card\" moves, and the bake holds still"), "{said}");
    assert!(!said.contains("\"floor\" moves"), "{said}");
    // The same with the parts exchanged: the floor shines on the card.
    more["/meshes/0/primitives/0/material"] = json!(1);
    more["/meshes/1/primitives/0/material"] = json!(0);
    let said = told(&mobile(&folder, "receiver.gltf", rest(), true, &more));
    assert!(said.contains("\"card\" moves, and the bake holds still"), "{said}");
    assert!(!said.contains("the emitter"), "{said}");
}
