//! Whole files.

use super::*;
use crate::scene::Map;
use crate::scene::texture::tests::png;
use std::collections::BTreeSet;

fn scene(obj: &str) -> Loaded {
    read(obj.as_bytes(), Path::new("nowhere")).expect("a valid OBJ")
}

/// An OBJ that uses material `m` of the MTL, beside that and a red texture.
fn with_material(mtl: &str) -> anyhow::Result<Loaded> {
    let directory = tempfile::tempdir()?;
    std::fs::write(directory.path().join("a file.mtl"), format!("newmtl m\n{mtl}\n"))?;
    std::fs::write(directory.path().join("red tile.png"), png(&[[255, 0, 0]]))?;
    let obj = format!("mtllib a file.mtl\nusemtl m\n{TRIANGLE}");
    read(obj.as_bytes(), directory.path())
}

fn material(mtl: &str) -> Material {
    let mut scene = with_material(mtl).expect("a valid material").scene;
    scene.materials.swap_remove(scene.meshes[0].material)
}

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

#[test]
fn a_concave_face_is_covered_once() {
    let loaded = scene("v 0 0 0\nv 4 -3 0\nv 1 0 0\nv 4 3 0\nf 1 2 3 4\n");
    let mesh = &loaded.scene.meshes[0];
    let at = |i: u32| mesh.positions[i as usize];
    let area = |t: &[u32; 3]| 0.5 * (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0])).z;
    // Two triangles of base 1 and height 3, where a fan would have one of −9.
    assert_eq!(mesh.triangles.iter().map(area).collect::<Vec<_>>(), [1.5, 1.5]);
}

#[test]
fn negative_indices_count_back() {
    let loaded = scene(&format!("{TRIANGLE}v 0 0 5\nv 1 0 5\nv 0 1 5\nf -3 -2 -1\n"));
    let mesh = &loaded.scene.meshes[0];
    let [_, second] = mesh.triangles[..] else { panic!("{mesh:?}") };
    let corners = second.map(|i| mesh.positions[i as usize]);
    assert_eq!(corners, [(0., 0., 5.), (1., 0., 5.), (0., 1., 5.)].map(DVec3::from));
}

#[test]
fn groups_and_materials_are_meshes_of_their_own() {
    let loaded =
        scene("v 0 0 0\nv 1 0 0\nv 0 1 0\no box\nf 1 2 3\ng lid\nf 3 2 1\ng box\nf 2 3 1\n");
    let names: Vec<&str> = loaded.scene.meshes.iter().map(|m| m.name.as_str()).collect();
    assert_eq!(names, ["box", "lid", "box#2"]);
    assert!(loaded.scene.meshes.iter().all(|m| m.material == 0), "the plain one");
    assert_eq!(loaded.scene.materials[0].kd, Material::default().kd);
}

#[test]
fn v_points_down_in_a_scene() {
    let loaded = scene("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0.25\nvt 0 1\nf 1/1 2/2 3/3\n");
    let uvs = &loaded.scene.meshes[0].uvs[0];
    assert_eq!(uvs[..], [Vec2::new(0.0, 1.0), Vec2::new(1.0, 0.75), Vec2::ZERO]);
}

#[test]
fn vertex_colours_are_made_linear() {
    let loaded = scene("v 0 0 0 1 0 0.5\nv 1 0 0 1 1 1\nv 0 1 0 0 0 0\nf 1 2 3\n");
    let colours = &loaded.scene.meshes[0].colours;
    let expected = Vec4::new(1.0, 0.0, 0.214_041, 1.0);
    assert!(colours[0].abs_diff_eq(expected, 1e-5), "{}", colours[0]);
    assert_eq!(colours[1], Vec4::ONE);
}

#[test]
fn partial_attributes_are_dropped_and_said() {
    let loaded = scene("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nf 1/1/1 2 3//1\n");
    let mesh = &loaded.scene.meshes[0];
    assert!(mesh.uvs[0].is_empty() && mesh.normals.is_empty(), "{mesh:?}");
    assert_eq!(loaded.warnings.len(), 2, "{:?}", loaded.warnings);
}

#[test]
fn phong_parameters_are_the_files() {
    let m = material("Kd 0.5 0.25 0\nKs 0.25\nNs 40\nKe 3 2 1\nmap_Ke red tile.png\nillum 2");
    assert_eq!((m.kd, m.ks), (Vec3::new(0.5, 0.25, 0.0), Vec3::splat(0.25)));
    assert_eq!((m.exponent, m.emission), (40.0, Vec3::new(3.0, 2.0, 1.0)));
    assert_eq!((m.base_texture, m.emission_texture), (None, Some(Map::of(0))));
    let bright = material("Kd 1 1 1\nKs 1 0 0\nNs 1e9");
    assert_eq!((bright.kd, bright.ks), (Vec3::splat(0.5), Vec3::new(0.5, 0.0, 0.0)));
    assert_eq!(bright.exponent, 1e5);
    assert_eq!(material("Ks 1 1 1\nillum 1").ks, Vec3::ZERO);
}

#[test]
fn mirrors_and_glass_go_by_the_illumination_model() {
    let mirror = material("Kd 0 0 0\nKs 0.9 0.9 0.9\nillum 5");
    assert!(mirror.mirror && mirror.transmission == 0.0, "{mirror:?}");
    let glass = material("Kd 0 0 0\nNi 1.33\nillum 7");
    assert_eq!((glass.transmission, glass.ior, glass.mirror), (1.0, 1.33, false));
    assert_eq!(glass.filter, Some(Vec3::ONE), "clear, for all that Kd says");
    assert_eq!(material("d 0.25\nTf 0.5 1 0.25").filter, Some(Vec3::new(0.5, 1.0, 0.25)));
    assert_eq!(material("Tf 0.5\nillum 7").filter, Some(Vec3::splat(0.5)));
    assert_eq!(material("Tf 2 1 1\nillum 7").filter, Some(Vec3::ONE));
    assert_eq!(material("Kd 1 1 1\nTf 0.5").filter, None, "opaque");
    assert_eq!(material("d 0.25").transmission, 0.75);
    assert_eq!(material("Tr 0.25\nNi 0.001").transmission, 0.25);
}

#[test]
fn textures_are_found_by_name_without_options() {
    let loaded = with_material("map_Kd -s 2 2 1 -clamp on red tile.png").expect("valid");
    assert_eq!(loaded.scene.textures[0].mean().truncate(), Vec3::X);
    assert_eq!(loaded.scene.materials[0].kd, Vec3::ONE);
    assert_eq!(loaded.warnings, ["ignored texture options (material \"m\" and 1 more)"]);
}

#[test]
fn problems_are_named() {
    for (mtl, expected) in [
        ("map_Kd blue.png", "material \"m\": map_Kd: reading "),
        ("map_Kd blue.png", "blue.png: No such file"),
        ("Kd 1 2", "a file.mtl: line 2: Kd needs one or three numbers"),
        ("d 2", "d (or 1 − Tr) is 2"),
        ("Ns x", "a file.mtl: malformed MTL"),
    ] {
        let text = format!("{:#}", with_material(mtl).expect_err("not valid"));
        assert!(text.contains(expected), "{text}");
    }
    for (obj, expected) in [
        ("v 1 2\n", "malformed OBJ"),
        ("v nan 0 0\nf 1 1 1\n", "a vertex is not finite"),
        ("v 0 0 0\nf 1 2 3\n", "line 2: \"2\": there are 1 vertices so far"),
    ] {
        let text = format!("{:#}", read(obj.as_bytes(), Path::new("")).expect_err("not valid"));
        assert!(text.contains(expected), "{text}");
    }
}

#[test]
fn a_lost_material_file_is_a_warning() {
    let loaded = scene(&format!("mtllib lost.mtl\nusemtl gone\n{TRIANGLE}"));
    assert_eq!(loaded.warnings, ["ignored material files that cannot be read (nowhere/lost.mtl)"]);
}

#[test]
fn two_material_files_keep_their_materials() {
    let directory = tempfile::tempdir().expect("a temporary directory");
    for (file, name, kd) in [("a.mtl", "a", 0.25), ("b.mtl", "b", 0.75)] {
        let text = format!("newmtl {name}\nKd {kd}\n");
        std::fs::write(directory.path().join(file), text).expect("a file");
    }
    let obj = "mtllib a.mtl\nmtllib b.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n\
               usemtl b\nf 1 2 3\nusemtl a\nf 1 2 3\n";
    let Loaded { scene, .. } = read(obj.as_bytes(), directory.path()).expect("valid");
    let kd: Vec<f32> = scene.meshes.iter().map(|m| scene.materials[m.material].kd.x).collect();
    assert_eq!(kd, [0.75, 0.25]);
}

#[test]
fn truncated_and_damaged_files_do_not_panic() {
    let obj = "mtllib m.mtl\no a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0 1\nvt 0 0\nvt 1 1\nvn 0 0 1\n\
               usemtl m\nf 1/1/1 2/2/1 3/1/1 4/2/1\nl 1 2\ng b\nf -4 -3 -2\nf 1//1 2//1 3//1\n";
    let mtl = "newmtl m\nKd 0.5 0.5 0.5\nKs 0.1\nNs 10\nNi 1.5\nd 0.5\nTr 0.5\nillum 7\n\
               map_Kd -s 1 1 1 t.png\nKe 1 1 1\n";
    let directory = tempfile::tempdir().expect("a temporary directory");
    std::fs::write(directory.path().join("t.png"), png(&[[9, 9, 9]])).expect("a file");
    let write = |mtl: &[u8]| std::fs::write(directory.path().join("m.mtl"), mtl).expect("a file");
    let loads = |obj: &[u8]| read(obj, directory.path()).is_ok();
    write(mtl.as_bytes());
    assert!(loads(obj.as_bytes()), "undamaged, it loads");
    let mut outcomes = BTreeSet::new();
    for damaged in damages(obj, b"\n /-0119.\\\xff\0") {
        outcomes.insert(loads(&damaged));
    }
    for damaged in damages(mtl, b"\n -9e\\\0") {
        write(&damaged);
        outcomes.insert(loads(obj.as_bytes()));
    }
    assert_eq!(outcomes.len(), 2, "some load, some do not, none panic");
}

/// `text` cut anywhere, and with each of its bytes replaced by each of `bytes`.
fn damages(text: &str, bytes: &[u8]) -> Vec<Vec<u8>> {
    let mut all: Vec<Vec<u8>> = (0..text.len()).map(|n| text.as_bytes()[..n].to_vec()).collect();
    for at in 0..text.len() {
        all.extend(bytes.iter().map(|&byte| {
            let mut damaged = text.as_bytes().to_vec();
            damaged[at] = byte;
            damaged
        }));
    }
    all
}
