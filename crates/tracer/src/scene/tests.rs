//! This project's own scenes, as their `README.md` has them.

use super::flight::camera_at;
use super::surfaces::{emitters, receivers};
use super::*;
use std::path::Path;

/// A file under `scenes/`, which loads without a warning.
fn shipped(name: &str) -> Scene {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/");
    let Loaded { scene, warnings, .. } =
        load(Path::new(&format!("{root}{name}"))).expect("a valid scene");
    assert!(warnings.is_empty(), "{name}: {warnings:?}");
    scene
}

#[test]
fn a_scene_says_which_files_it_was_read_from() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/");
    let read_from = |name: &str| {
        let path = Path::new(folder).join(name);
        let files = load(&path).expect("a valid scene").files;
        assert_eq!(files[0], path);
        let mut names: Vec<_> =
            files.iter().filter_map(|file| file.file_name()?.to_str()).collect();
        names.sort_unstable();
        names.join(" ")
    };
    let expected = "chapel.bin chapel.gltf flags.png wall.png window.png wood.png";
    assert_eq!(read_from("chapel/chapel.gltf"), expected);
    assert_eq!(read_from("quad/quad.obj"), "quad.mtl quad.obj");
    assert_eq!(read_from("facing/facing.gltf"), "facing.gltf");
}

#[test]
fn the_chapel_has_its_window_tiles_and_flight() {
    let scene = shipped("chapel/chapel.gltf");
    let receivers = receivers(&scene);
    assert_eq!(receivers.len(), 16);
    for tile in &receivers {
        assert!(tile.name.starts_with("tile_") && tile.is_rectangle(), "{tile:?}");
        assert!((tile.area() - 1.0).abs() < 1e-6, "{}: {}", tile.name, tile.area());
        assert!(tile.normal().abs_diff_eq(DVec3::Y, 1e-6), "{}", tile.name);
    }
    let emitters = emitters(&scene);
    let [window] = &emitters[..] else { panic!("{emitters:?}") };
    assert!((window.area() - 2.56).abs() < 1e-5, "1.6 m squared, not {}", window.area());
    assert_eq!((window.name.as_str(), window.uvs.len()), ("window", 4));
    let lobe = scene.materials[scene.meshes[window.mesh].material].lobe.as_ref().expect("authored");
    assert!((lobe.peak.y + 0.5_f64.sqrt()).abs() < 1e-6, "45° down: {}", lobe.peak);
    let names: Vec<&str> = scene.cameras.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["nave", "window", "low", "top", "fly"]);
    let [flight] = &scene.animations[..] else { panic!("{:?}", scene.animations) };
    assert_eq!((flight.name.as_str(), flight.camera, flight.duration), ("flight", 4, 10.0));
    let ends = [0.0, 10.0].map(|t| camera_at(flight, &scene, t).transform);
    assert!(ends[0].abs_diff_eq(ends[1], 1e-5), "back to its start: {ends:?}");
}

#[test]
fn the_quad_is_the_same_from_both_formats() {
    for name in ["quad/quad.gltf", "quad/quad.obj"] {
        let scene = shipped(name);
        let (emitters, receivers) = (emitters(&scene), receivers(&scene));
        let ([lamp], [floor]) = (&emitters[..], &receivers[..]) else {
            panic!("{name}: {emitters:?} {receivers:?}")
        };
        assert!((lamp.area() - 1.0).abs() < 1e-6, "{name}: {}", lamp.area());
        assert!((floor.area() - 4.0).abs() < 1e-6, "{name}: {}", floor.area());
        let material = |mesh: usize| &scene.materials[scene.meshes[mesh].material];
        let emission = material(lamp.mesh).emission;
        assert!(emission.abs_diff_eq(Vec3::new(6.0, 5.0, 3.0), 1e-5), "{name}: {emission}");
        let Material { kd, ks, exponent, .. } = material(floor.mesh);
        assert!(kd.abs_diff_eq(Vec3::new(0.48, 0.48, 0.528), 1e-4), "{name}: {kd}");
        assert!(ks.abs_diff_eq(Vec3::splat(0.04), 1e-5), "{name}: {ks}");
        assert!((exponent - 30.0).abs() < 0.01, "{name}: {exponent}");
    }
}

#[test]
fn the_facing_squares_see_each_other() {
    let scene = shipped("facing/facing.gltf");
    let (emitters, receivers) = (emitters(&scene), receivers(&scene));
    assert_eq!((emitters.len(), receivers.len()), (1, 1));
    let (above, below) = (&emitters[0], &receivers[0]);
    assert!((above.vertices[0].y - below.vertices[0].y - 1.0).abs() < 1e-6, "1 m apart");
    assert!(above.normal().abs_diff_eq(-below.normal(), 1e-6), "face to face");
}
