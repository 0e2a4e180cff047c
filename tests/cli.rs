//! The command line: exit codes and the words a user sees.

use crate::support::{Folder, chapel_wct, fail, repository, scene, succeed, tracer};
use serde_json::{Value, json};
use std::fs;
use std::process::{Command, Output, Stdio};

#[test]
fn help_lists_the_commands_and_version_the_version() {
    let help = succeed(&["--help"]);
    for command in ["  bake ", "  render ", "  fly "] {
        assert!(help.contains(command), "no{command}in\n{help}");
    }
    assert_eq!(succeed(&["--version"]), concat!("tracer ", env!("CARGO_PKG_VERSION"), "\n"));
    let nothing = tracer(&[]);
    assert_eq!(nothing.status.code(), Some(2), "{nothing:?}");
    assert!(String::from_utf8_lossy(&nothing.stderr).contains("Usage: tracer"), "{nothing:?}");
}

/// Runs the program with `stdout` for its standard output.
fn tracer_into(stdout: impl Into<Stdio>, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_tracer"))
        .args(args)
        .stdout(stdout)
        .stderr(Stdio::piped())
        .output()
        .expect("the program to test")
}

/// As `tracer inspect … | head -1` may have it. 141 is what a shell reports of other
/// programs then: 128 and SIGPIPE.
#[cfg(unix)]
#[test]
fn a_closed_pipe_ends_the_program_without_a_word() {
    let folder = Folder::new();
    let cases = folder.path("none.json");
    fs::write(&cases, r#"{"cases": []}"#).expect("a file");
    let wct = chapel_wct();
    let all: [&[&str]; 3] =
        [&["inspect", wct], &["inspect", wct, "--json"], &["transport", &cases]];
    for args in all {
        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        let ended = tracer_into(writer, args);
        assert_eq!(ended.status.code(), Some(141), "tracer {args:?}: {ended:?}");
        assert!(ended.stderr.is_empty(), "tracer {args:?}: {ended:?}");
    }
}

#[cfg(target_os = "linux")] // for /dev/full
#[test]
fn output_that_cannot_be_written_is_an_error() {
    let full = fs::File::options().write(true).open("/dev/full").expect("always full");
    let ended = tracer_into(full, &["inspect", chapel_wct()]);
    assert_eq!(ended.status.code(), Some(1), "{ended:?}");
    let complaint = String::from_utf8_lossy(&ended.stderr);
    assert!(complaint.starts_with("tracer: writing to standard output: "), "{complaint}");
}

#[test]
fn a_bad_scene_is_named_with_the_reason() {
    let folder = Folder::new();
    let output = folder.path("a.wct");
    let bake = |path: &str| fail(1, &["bake", path, "-o", &output]);
    let missing = folder.path("missing.gltf");
    let complaint = bake(&missing);
    assert!(complaint.starts_with(&format!("tracer: reading {missing}: ")), "{complaint}");
    let toml = repository("Cargo.toml");
    let complaint = bake(&toml);
    assert!(complaint.contains("Cargo.toml: not a scene this program reads"), "{complaint}");
    let broken = folder.path("broken.gltf");
    fs::write(&broken, "{ \"asset\": ").expect("a file");
    let complaint = bake(&broken);
    assert!(complaint.starts_with("tracer: ") && complaint.contains(&broken), "{complaint}");
    assert_eq!(complaint.lines().count(), 1, "one line: {complaint}");
    assert_eq!(folder.names(), ["broken.gltf"], "nothing written");
}

#[test]
fn what_is_not_a_wct_file_is_refused() {
    let folder = Folder::new();
    let (facing, output) = (scene("facing/facing.gltf"), folder.path("a.png"));
    let render = |wct: &str| fail(1, &["render", &facing, "--wct", wct, "-o", &output]);
    let complaint = render(&repository("Cargo.toml"));
    assert!(complaint.contains("Cargo.toml: not a .wct file"), "{complaint}");
    let wct = folder.path("f.wct");
    succeed(&["bake", &facing, "--level", "1", "-o", &wct]);
    let bytes = fs::read(&wct).expect("just written");
    fs::write(&wct, &bytes[..bytes.len() / 2]).expect("a shorter file");
    let complaint = render(&wct);
    assert!(complaint.contains("f.wct: the file ends at byte"), "{complaint}");
    let complaint = render(&folder.path("missing.wct"));
    assert!(complaint.contains("missing.wct: "), "{complaint}");
    assert_eq!(folder.names(), ["f.wct"], "no picture");
}

/// Before the scene is read: what cannot be written is not worth the work.
#[test]
fn an_output_that_cannot_be_is_refused_at_once() {
    let folder = Folder::new();
    let render = |name: &str| fail(1, &["render", "no.gltf", "-o", &folder.path(name)]);
    let complaint = render("a.jpg");
    assert!(complaint.ends_with("a.jpg: name it .png or .exr\n"), "{complaint}");
    let complaint = render("no/a.png");
    assert!(complaint.ends_with("no does not exist\n"), "{complaint}");
    let complaint = fail(1, &["fly", "no.gltf", "-o", &folder.path("a.png")]);
    assert!(complaint.contains("put one row of #"), "{complaint}");
}

#[test]
fn options_out_of_range_are_usage_errors() {
    let render = |option: &str| fail(2, &["render", "a.gltf", "-o", "a.png", option]);
    for size in ["12", "0x3", "axb", "-1x4", "99999x99999"] {
        let complaint = render(&format!("--size={size}"));
        assert!(complaint.contains(&format!("invalid value '{size}'")), "{complaint}");
        assert!(complaint.contains("must be WIDTHxHEIGHT in pixels"), "{complaint}");
    }
    render("--samples=0");
    render("--spp=64");
    fail(2, &["render", "a.gltf", "-o", "a.png", "--reference", "--error", "2"]);
    let bake = |options: &[&str]| fail(2, &[&["bake", "a.gltf", "-o", "a.wct"], options].concat());
    bake(&["--level", "8"]);
    bake(&["--compress", "1"]);
    bake(&["--threshold", "-1"]);
    let complaint = bake(&["--compress", "0.5", "--threshold", "0.1"]);
    assert!(complaint.contains("cannot be used with"), "{complaint}");
    let complaint = bake(&["--recursion", "simpson2d:9"]);
    assert!(complaint.contains("is no integration method"), "{complaint}");
    let complaint = bake(&["--recursion", "trapezoid2d:8"]);
    assert!(complaint.contains("an odd number a side"), "{complaint}");
}

/// A quad scene's lamp becomes a window; what cannot be weather is refused.
#[test]
fn weather_lights_the_windows() {
    let folder = Folder::new();
    let (quad, out) = (scene("quad/quad.gltf"), folder.path("quad.wct"));
    let baked = |flags: &[&str]| {
        let args = ["bake", &quad, "-o", &out, "--error", "0.02", "--checks", "0"];
        tracer(&[&args[..], flags].concat())
    };
    let hash = |flags: &[&str]| {
        assert!(baked(flags).status.success(), "{flags:?}");
        let text = succeed(&["inspect", &out]);
        text.lines().find(|line| line.contains("fnv1a64")).expect("a hash").to_owned()
    };
    let [own, overcast, uniform] =
        [hash(&[]), hash(&["--sky", "overcast"]), hash(&["--sky", "uniform"])];
    assert!(own != overcast && overcast != uniform, "{own} {overcast} {uniform}");
    for (flags, expected) in [
        (&["--sky", "clear"][..], "--sky clear needs --sun"),
        (&["--sun", "20,-5"], "elevation"),
        (&["--sky-irradiance", "5"], "--sky-irradiance needs --sky or --sun"),
        (&["--sky", "uniform", "--sky-irradiance=-1"], "irradiance"),
    ] {
        let output = baked(flags);
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        let complaint = String::from_utf8(output.stderr).expect("UTF-8 on stderr");
        assert!(complaint.contains(expected), "{flags:?}: {complaint}");
    }
    // Shown under the sky that it was baked under, or with a word about it.
    assert!(baked(&["--sky", "overcast"]).status.success(), "a bake");
    let png = folder.path("quad.png");
    let render = |flags: &[&str]| {
        let args = ["render", &quad, "--wct", &out, "--size", "16x12", "-o", &png];
        let output = tracer(&[&args[..], flags].concat());
        assert!(output.status.success(), "{output:?}");
        String::from_utf8(output.stderr).expect("UTF-8 on stderr")
    };
    let told = "baked under overcast sky of 100 W/m2 over ground of 0.2, shown under ";
    assert!(!render(&["--sky", "overcast"]).contains("baked under"), "the same");
    for (flags, shown) in [(&["--sky", "uniform"][..], "uniform sky of 100"), (&[], "no sky")] {
        let words = render(flags);
        assert!(words.contains(&format!("{told}{shown}")), "{words}");
    }
}

#[test]
fn a_bake_does_not_take_a_pictures_name() {
    let folder = Folder::new();
    let picture = folder.path("there.PNG");
    fs::write(&picture, "a picture").expect("written");
    let complaint = fail(1, &["bake", &scene("quad/quad.gltf"), "-o", &picture]);
    assert!(complaint.contains("name it .wct"), "{complaint}");
    assert_eq!(fs::read(&picture).expect("there"), b"a picture");
}

#[test]
fn a_bake_of_another_scene_is_told_of() {
    let folder = Folder::new();
    let (quad, out, png) =
        (scene("quad/quad.gltf"), folder.path("quad.wct"), folder.path("quad.png"));
    succeed(&["bake", &quad, "-o", &out, "--error", "0.02", "--checks", "0"]);
    let words = |path: &str| {
        let output = tracer(&["render", path, "--wct", &out, "--size", "16x12", "-o", &png]);
        assert!(output.status.success(), "{output:?}");
        String::from_utf8(output.stderr).expect("UTF-8 on stderr")
    };
    let told = "windows or floors have changed since it was baked";
    assert!(!words(&quad).contains(told), "the same");
    let text = fs::read_to_string(&quad).expect("the scene");
    let original: Value = serde_json::from_str(&text).expect("JSON");
    let darken = |materials: &mut Vec<Value>, key: &[&str]| {
        for material in materials {
            let value = key.iter().try_fold(material, |value, key| value.get_mut(key));
            for x in value.and_then(Value::as_array_mut).into_iter().flatten() {
                *x = json!(0.9 * x.as_f64().expect("a number"));
            }
        }
    };
    for key in [&["emissiveFactor"][..], &["pbrMetallicRoughness", "baseColorFactor"]] {
        let mut changed = original.clone();
        darken(changed["materials"].as_array_mut().expect("materials"), key);
        let path = folder.path("changed.gltf");
        fs::write(&path, changed.to_string()).expect("written");
        assert!(words(&path).contains(told), "{key:?}");
    }
}

#[test]
fn compare_tells_how_far_apart_two_pictures_are() {
    let folder = Folder::new();
    let facing = scene("facing/facing.gltf");
    let render = |name: &str, size: &str, samples: &str| {
        let output = folder.path(name);
        succeed(&["render", &facing, "--size", size, "--samples", samples, "-o", &output]);
        output
    };
    let rough = render("rough.exr", "24x18", "1");
    let fine = render("fine.exr", "24x18", "64");
    let small = render("small.png", "12x9", "1");
    let map = folder.path("map.png");
    let compared = |a: &str, b: &str| -> Value {
        let printed = succeed(&["compare", a, b, "--json", "-o", &map]);
        serde_json::from_str(&printed).expect("JSON")
    };
    let same = compared(&fine, &fine);
    for what in ["flip", "flip_max", "relative_rms", "relative_mse"] {
        assert_eq!(same[what], 0.0, "{what} of a picture and itself: {same}");
        let found = compared(&rough, &fine)[what].as_f64().expect("a number");
        assert!((1e-6..10.0).contains(&found), "{what}: {found}");
    }
    let complaint = fail(1, &["compare", &fine, &small]);
    assert!(complaint.contains("24 x 18 pixels and"), "{complaint}");
    let complaint = fail(1, &["compare", &fine, &folder.path("missing.png")]);
    assert!(complaint.contains("missing.png"), "{complaint}");
}
