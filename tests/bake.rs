//! Baking: the same bytes each time, known answers, and failures that harm nothing.

use crate::support::chapel::Chapel;
use crate::support::picture::relative_rms;
use crate::support::{Folder, fail, scene, succeed};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::f64::consts::{FRAC_1_PI, PI};
use std::fs;
use wrt_core::metrics::relative_euclidean_distance;
use wrt_core::transport::{BlockOptions, TransportGeometry, transport_block};
use wrt_core::wct_file::Side;
use wrt_core::{Emission, Grid, Levels, Lobe, Polygon, WctFile};

/// Bakes a scene of the repository with `options`, and reads the result.
fn bake(path: &str, options: &[&str]) -> WctFile {
    let folder = Folder::new();
    let output = folder.path("baked.wct");
    succeed(&[&["bake", &scene(path), "-o", &output, "--checks", "0"], options].concat());
    WctFile::read(&output).expect("a .wct file")
}

fn grid(file: &WctFile, patch: &str) -> Grid {
    file.patch(patch).expect("a patch of that name").tree.to_grid()
}

/// Radiance of all finest cells, position fastest.
fn means(grid: &Grid) -> Vec<f64> {
    let levels = grid.levels();
    let (p, d) = (1_usize << levels.position, 1_usize << levels.direction);
    let cells = 0..levels.positions() * levels.directions();
    let offsets = cells.map(|i| [i % p, i / p % p, i / (p * p) % d, i / (p * p * d)]);
    offsets.flat_map(|m| grid.mean(m).map(f64::from)).collect()
}

/// The mean over positions of 4 Σ L Δκ Δλ.
fn mean_flux_density(grid: &Grid) -> [f64; 3] {
    let densities = grid.irradiance();
    let sum = |c: usize| densities.iter().map(|e| e[c]).sum::<f64>();
    [0, 1, 2].map(|c| sum(c) / densities.len() as f64)
}

#[test]
fn the_bytes_depend_on_the_scene_alone() {
    let folder = Folder::new();
    let chapel = scene("chapel/chapel.gltf");
    let bytes = |threads: &str, name: &str| {
        let output = folder.path(name);
        let options = ["--level", "3", "--checks", "4", "--incident", "--threads", threads];
        succeed(&[&["bake", &chapel, "-o", &output], &options[..]].concat());
        fs::read(&output).expect("just written")
    };
    let one = bytes("1", "one");
    assert!(bytes("2", "two") == one, "1 and 2 threads differ");
    assert!(bytes("2", "again") == one, "two runs differ");
}

#[test]
fn compression_removes_what_it_is_told_to() {
    let file = bake("chapel/chapel.gltf", &["--level", "3", "--compress", "0.95"]);
    assert_eq!(file.patches.len(), 16, "a patch a tile");
    for patch in &file.patches {
        // 5 % of 8⁴, rounded up; every tile has that many that are not zero.
        assert_eq!(patch.tree.len(), 205, "{}", patch.name);
        assert!((0.0..1.0).contains(&patch.relative_error), "{}", patch.relative_error);
    }
}

#[test]
fn the_summary_says_what_was_made() {
    let folder = Folder::new();
    let output = folder.path("f.wct");
    let facing = scene("facing/facing.gltf");
    let table = succeed(&["bake", &facing, "--level", "2", "--compress", "0.75", "-o", &output]);
    let row = |what: &str| {
        let row = table.lines().find_map(|line| line.strip_prefix(what));
        row.unwrap_or_else(|| panic!("no \"{what}\" in\n{table}")).trim().to_owned()
    };
    assert_eq!(row("patches"), "1");
    assert_eq!(row("coefficients, full basis"), "256 × RGB");
    assert_eq!(row("  kept"), "64 (25.00 %)");
    assert_eq!(row("compression"), "75.00 % removed");
    assert!(
        row("error when looked up").ends_with("% relative RMS against direct quadrature, sampled")
    );
    for stage in ["projection", "transport", "reflection", "compression", "check"] {
        assert!(row(&format!("time, {stage}")).ends_with(" s"), "{table}");
    }
    assert!(row("time in all").ends_with(" s"), "{table}");
}

/// What was kept is told in words, of files that have it otherwise too, and is up to date
/// after another compression.
#[test]
fn a_file_says_what_is_kept_of_it() {
    let folder = Folder::new();
    let (own, other) = (folder.path("own.wct"), folder.path("other.wct"));
    let facing = scene("facing/facing.gltf");
    succeed(&["bake", &facing, "-o", &own, "--level", "2", "--checks", "0"]);
    let keep = |path: &str| WctFile::read(path).expect("a file").options["keep"].clone();
    assert_eq!(keep(&own), "relative error 0.002");
    succeed(&["convert", &own, "--error", "0.01", "-o", &other]);
    assert_eq!(keep(&other), "relative error 0.002, then relative error 0.01");
    let mut old = WctFile::read(&own).expect("a file");
    old.options.insert("keep".to_owned(), "RelativeError(0.002)".to_owned());
    old.write(&own).expect("written");
    let told = succeed(&["inspect", &own]);
    assert!(told.contains("keep          relative error 0.002\n"), "{told}");
    succeed(&["convert", &own, "--raw", "-o", &other]);
    assert_eq!(keep(&other), "relative error 0.002");
    succeed(&["convert", &own, "--error", "0.01", "-o", &own]);
    assert_eq!(keep(&own), "relative error 0.002, then relative error 0.01");
    for args in [&["bake", &facing][..], &["convert", &own, "--raw"]] {
        let complaint = fail(1, &[args, &["-o", &folder.path("")]].concat());
        assert!(complaint.contains("is a folder: name a .wct in it"), "{complaint}");
    }
}

#[test]
fn a_failed_bake_leaves_the_old_file() {
    let folder = Folder::new();
    let facing = scene("facing/facing.gltf");
    let text = fs::read_to_string(&facing).expect("the scene");
    let mut document: Value = serde_json::from_str(&text).expect("glTF is JSON");
    document["materials"][0]["emissiveFactor"] = json!([0, 0, 0]);
    let dark = folder.path("dark.gltf");
    fs::write(&dark, document.to_string()).expect("the edited scene");
    let old = folder.path("old.wct");
    fs::write(&old, "old").expect("a file");
    let complaint = fail(1, &["bake", &dark, "-o", &old]);
    assert!(complaint.contains("dark.gltf: nothing emits light"), "{complaint}");

    let nowhere = folder.path("no/a.wct");
    let complaint = fail(1, &["bake", &facing, "-o", &nowhere]);
    let expected = format!("{nowhere}: the folder {} does not exist", folder.path("no"));
    assert!(complaint.contains(&expected), "{complaint}");

    let taken = folder.path("taken.wct");
    fs::create_dir(&taken).expect("a folder");
    let complaint = fail(1, &["bake", &facing, "--level", "1", "-o", &taken]);
    assert_eq!(complaint, format!("tracer: {taken} is a folder: name a .wct in it\n"));

    // More than a file's name may have, which only writing it finds.
    let long = folder.path(&format!("{}.wct", "a".repeat(300)));
    let complaint = fail(1, &["bake", &facing, "--level", "1", "-o", &long]);
    assert!(complaint.starts_with(&format!("tracer: writing {long}: ")), "{complaint}");

    assert_eq!(fs::read(&old).expect("still there"), b"old");
    assert_eq!(folder.names(), ["dark.gltf", "old.wct", "taken.wct"], "leftovers");
}

/// Irradiance of the tiles' cells by their incident patches, against a sum over
/// the window's texels at 2 × 2 points of each cell.
///
/// Measured with 16 samples along a direction cell: 0.08 %, of which the four
/// points leave 0.1 % beneath the window, where irradiance bends most. With 64
/// the farthest tile alone is within 0.013 %; with the 4 that are the default it
/// is 4.6 % off, for from there the whole window is in a few direction cells.
#[test]
fn incident_patches_have_the_irradiance_of_the_window() {
    let chapel = Chapel::read();
    let options = [
        "--level",
        "3",
        "--direction-level",
        "4",
        "--threshold",
        "0",
        "--incident",
        "--samples",
        "16",
    ];
    let file = bake("chapel/chapel.gltf", &options);
    assert_eq!(file.patches.len(), 32, "two patches a tile");
    let tiles = ["tile_00", "tile_12", "tile_31"];
    let (mut found, mut cells) = (Vec::new(), Vec::new());
    for name in tiles {
        let tile = chapel.tiles.iter().find(|tile| tile.name == name).expect("in the scene");
        let patch = file.patch(&format!("{name}.incident")).expect("an incident patch");
        assert_eq!(patch.side, Side::Incident, "{name}");
        let polygon = patch.polygon.to_polygon().expect("a rectangle");
        let size = polygon.size().expect("a rectilinear chart");
        let irradiance = patch.tree.to_grid().irradiance();
        for (i, &irradiance) in irradiance.iter().enumerate().step_by(9) {
            let at = DVec2::new((i % 8) as f64, (i / 8) as f64);
            let points = [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]].map(|within| {
                let point = polygon.frame().point((at + DVec2::from(within)) / 8.0 * size);
                DVec2::new(point.x, point.z)
            });
            let inside =
                points.iter().all(|p| (*p - tile.low).min(tile.high - *p).min_element() > 0.0);
            assert!(inside, "{name}: {points:?}");
            found.push(irradiance);
            cells.push(points);
        }
    }
    let mean = |points: &[DVec2; 4]| {
        let all = points.map(|point| chapel.irradiance(point));
        std::array::from_fn(|c| all.iter().map(|e| e[c]).sum::<f64>() / 4.0)
    };
    let expected: Vec<[f64; 3]> = cells.par_iter().map(mean).collect();
    let error = relative_rms(&found, &expected);
    eprintln!("irradiance of {} cells: relative RMS {:.4} %", cells.len(), 100.0 * error);
    assert!(error < 2e-3, "{error}");
}

/// F of opposed unit squares at distance 1 (J. R. Howell, *A Catalog of Radiation
/// Heat Transfer Configuration Factors*, C-11).
const FACING: f64 = 0.199_824_895_698_387_46;

#[test]
fn facing_squares_exchange_their_form_factor() {
    let file = bake("facing/facing.gltf", &["--level", "4", "--threshold", "0", "--incident"]);
    let incident = mean_flux_density(&grid(&file, "receiver.incident"));
    // A Lambertian receiver's radiance is its exitance over π; L_e = 1, k_d = ½.
    let outgoing = mean_flux_density(&grid(&file, "receiver")).map(|m| m * FRAC_1_PI);
    for c in 0..3 {
        assert!((incident[c] - PI * FACING).abs() < 2e-4, "irradiance {incident:?}");
        assert!((outgoing[c] - 0.5 * FACING).abs() < 2e-4, "radiance {outgoing:?}");
    }
}

/// The recursion carries the emitter's tree, whose direction cells at level 2 cut
/// the rim of the hemisphere coarsely; the block carries the emission itself. Given
/// the same cells they differ by the quadrature alone, which shrinks with the
/// recursion's points a side. They share no quadrature and no order of summation.
#[test]
fn the_paper_s_recursion_agrees_with_whole_blocks() {
    let baked = |options: &[&str]| {
        let all = [&["--level", "2", "--threshold", "0", "--incident"], options].concat();
        bake("facing/facing.gltf", &all)
    };
    let incident = |file: &WctFile| means(&grid(file, "receiver.incident"));
    let file = baked(&["--samples", "32"]);
    let receiver = file.patches[0].polygon.to_polygon().expect("a square");
    let emitter = Polygon::rectangle(DVec3::new(-0.5, 1.0, -0.5), DVec3::X, DVec3::Z);
    let geometry = TransportGeometry::new(emitter.expect("a square"), receiver);
    let cells = Emission::new(0, vec![[1.0; 3]], Lobe::Lambertian).project(2);
    let samples = BlockOptions { samples: 32 };
    let of_cells = means(
        &transport_block(&geometry, &cells, Levels::isotropic(2), samples)
            .expect("straight grid lines"),
    );
    let errors = ["trapezoid2d:5", "trapezoid2d:17", "trapezoid2d:65"].map(|rule| {
        let recursion = incident(&baked(&["--recursion", rule]));
        [&of_cells, &incident(&file)].map(|block| relative_euclidean_distance(&recursion, block))
    });
    eprintln!("recursion against block, of cells and of the emission: {errors:.4?}");
    assert!(errors.windows(2).all(|e| e[1][0] < 0.5 * e[0][0]), "{errors:?}");
    assert!(errors[0][0] < 5e-2 && errors[2][0] < 4e-3, "{errors:?}");
    assert!(errors[2][1] < 2.5e-2, "the cells of the rim: {errors:?}");
}

/// The same scene with and without glTF, neither with extras. The one writes its
/// roughness with four digits, the other its exponent whole: n differs by 10⁻³.
#[test]
fn quad_is_the_same_from_gltf_and_from_obj() {
    let [gltf, obj] = ["quad/quad.gltf", "quad/quad.obj"].map(|path| bake(path, &["--level", "3"]));
    let [a, b] = [&gltf, &obj].map(|file| means(&grid(file, "floor")));
    assert_eq!(gltf.patches[0].polygon, obj.patches[0].polygon, "where it lies");
    assert!(a.iter().any(|&x| x > 0.1), "it is lit");
    let error = relative_euclidean_distance(&b, &a);
    assert!(error < 1e-3, "{error}");
}
