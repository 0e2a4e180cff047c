//! The `.wct` format: golden bytes, round trips, and files that are damaged.

use proptest::prelude::*;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use wrt_core::grid::Grid;
use wrt_core::wct_file::{ChartKind, MAGIC, MAJOR, Side};
use wrt_core::{Error, Keep, Levels, Patch, PatchGeometry, TreeBuilder, WctFile};

/// Two patches, one of them of a constant radiance.
pub(crate) fn tiny() -> WctFile {
    let levels = Levels { position: 1, direction: 2 };
    let image = |d: usize| {
        let texel = |p: usize| [d as f32, p as f32 * 0.25, (d * p % 3) as f32];
        (!d.is_multiple_of(5)).then(|| (0..4).map(texel).collect())
    };
    let grid = Grid::from_images(levels, (0..16).map(image).collect());
    let square = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 0.0, -1.0], [0.0, 0.0, -1.0]];
    let floor = Patch {
        name: "floor".to_owned(),
        polygon: PatchGeometry { vertices: square.to_vec(), chart: ChartKind::Rectilinear },
        side: Side::Incident,
        tree: TreeBuilder::from_grid(&grid).finish(),
        relative_error: 0.0,
        error_estimate: Some(0.001),
    };
    let constant = TreeBuilder::from_grid(&Grid::separable(
        Levels { position: 0, direction: 0 },
        vec![[0.5, 0.25, 0.125]],
        &[1.0],
    ));
    let lamp = Patch {
        name: "ceiling λ \"lamp\"".to_owned(),
        polygon: PatchGeometry { vertices: square[..3].to_vec(), chart: ChartKind::Rectilinear },
        side: Side::Outgoing,
        tree: constant.finish(),
        relative_error: 0.1,
        error_estimate: None,
    };
    WctFile {
        patches: vec![floor, lamp],
        smooth: vec![],
        generator: "test 1".to_owned(),
        input_hash: "crc32:00000000".to_owned(),
        options: [("levels".to_owned(), "1,2".to_owned())].into(),
    }
}

/// The same with the first patch quantised.
fn tiny_coded() -> WctFile {
    let mut file = tiny();
    let (tree, report) = file.patches[0].tree.quantised(0.02);
    assert!(tree.code().is_some(), "{report:?}");
    file.patches[0].tree = tree;
    file.patches[0].relative_error = report.relative_error;
    file
}

#[test]
fn a_file_comes_back_as_it_was() {
    for file in [tiny(), tiny_coded()] {
        let bytes = file.to_bytes();
        let back = WctFile::from_bytes(&bytes).expect("its own bytes");
        assert_eq!(back, file);
        assert_eq!(back.to_bytes(), bytes);
    }
}

pub(crate) fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden").join(name)
}

/// Guards files already written: what reads them must keep doing so.
#[test]
fn the_format_has_not_changed() {
    for (name, file) in [("tiny.wct", tiny()), ("tiny_coded.wct", tiny_coded())] {
        let (path, bytes) = (golden(name), file.to_bytes());
        if std::env::var_os("UPDATE_GOLDEN").is_some() {
            fs::write(&path, &bytes).expect("a writable tests/golden");
        }
        let golden = fs::read(&path).expect("UPDATE_GOLDEN=1 writes it");
        assert!(bytes == golden, "the bytes differ from {}", path.display());
    }
}

/// Trees of any masks and coefficients, compressed or not.
fn file() -> impl Strategy<Value = WctFile> {
    let levels =
        (0..3_u8, 0..3_u8).prop_map(|(position, direction)| Levels { position, direction });
    let patch = (levels, any::<u64>(), 0.0..0.5f64, prop::array::uniform9(any::<f32>()));
    let patches = prop::collection::vec(patch, 0..3).prop_map(|patches| {
        let patch = |(i, (levels, seed, error, x)): (usize, (Levels, u64, f64, [f32; 9]))| {
            let mut random = seed | 1;
            let mut next = || {
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (random >> 40) as f32 / 1e3
            };
            let images = (0..levels.directions())
                .map(|_| Some((0..levels.positions()).map(|_| [next(), 0.0, next()]).collect()));
            let tree =
                TreeBuilder::from_grid(&Grid::from_images(levels, images.collect())).finish();
            let (tree, relative_error) = if seed % 3 == 0 {
                let (tree, report) = tree.quantised(error);
                (tree, report.relative_error)
            } else {
                let (tree, report) = tree.compressed(Keep::RelativeError(error));
                (tree, report.relative_error)
            };
            Patch {
                name: format!("{i}{seed:x}"),
                polygon: PatchGeometry {
                    vertices: x
                        .as_chunks::<3>()
                        .0
                        .iter()
                        .map(|v| v.map(|x| f64::from(x) / 3.0))
                        .collect(),
                    chart: ChartKind::Rectilinear,
                },
                side: Side::Outgoing,
                tree,
                relative_error,
                error_estimate: (seed % 2 == 0).then_some(error),
            }
        };
        patches.into_iter().enumerate().map(patch).collect()
    });
    (patches, any::<String>(), any::<BTreeMap<String, String>>()).prop_map(
        |(patches, generator, options)| WctFile {
            patches,
            smooth: vec![],
            generator,
            input_hash: String::new(),
            options,
        },
    )
}

/// A file of this description and data with its checksums in order: what damage
/// by accident cannot look like, but intent can.
fn sealed(description: &str, data: &[u8]) -> Vec<u8> {
    let mut text = description.as_bytes().to_vec();
    text.resize(text.len().next_multiple_of(64), b' ');
    let mut header = [0; 64];
    header[..8].copy_from_slice(&MAGIC);
    header[8..10].copy_from_slice(&MAJOR.to_le_bytes());
    header[16..24].copy_from_slice(&(text.len() as u64).to_le_bytes());
    header[24..32].copy_from_slice(&((64 + text.len() + data.len()) as u64).to_le_bytes());
    header[32..36].copy_from_slice(&crc32fast::hash(&text).to_le_bytes());
    with_header_checksum([&header[..], &text, data].concat())
}

fn with_header_checksum(mut bytes: Vec<u8>) -> Vec<u8> {
    let crc = crc32fast::hash(&bytes[..60]);
    bytes[60..64].copy_from_slice(&crc.to_le_bytes());
    bytes
}

/// A file's description and data.
fn parts(bytes: &[u8]) -> (Value, Vec<u8>) {
    let len = bytes[16..24].iter().rev().fold(0, |len, &b| len << 8 | usize::from(b));
    let description = serde_json::from_slice(&bytes[64..64 + len]).expect("a description");
    (description, bytes[64 + len..].to_vec())
}

proptest! {
    #[test]
    fn any_file_comes_back_as_it_was(file in file()) {
        let bytes = file.to_bytes();
        let back = WctFile::from_bytes(&bytes);
        prop_assert_eq!(back.as_ref().ok(), Some(&file), "{:?}", back);
        prop_assert!(back.is_ok_and(|back| back.to_bytes() == bytes));
    }

    #[test]
    fn any_bytes_are_an_error(bytes: Vec<u8>) {
        prop_assert!(WctFile::from_bytes(&bytes).is_err());
        let with_header = [&tiny().to_bytes()[..64], &bytes].concat();
        prop_assert!(WctFile::from_bytes(&with_header).is_err());
    }

    #[test]
    fn any_description_is_read_or_an_error(
        at in 0.0..1.0f64, with in "\\PC{0,3}", length in 0..4_usize, data: Vec<u8>,
    ) {
        let (description, mut own) = parts(&tiny().to_bytes());
        let mut text = description.to_string();
        let start = text.floor_char_boundary((at * text.len() as f64) as usize);
        let end = text.ceil_char_boundary((start + length).min(text.len()));
        text.replace_range(start..end, &with);
        let _ = WctFile::from_bytes(&sealed(&text, &own));
        own.extend(data);
        let _ = WctFile::from_bytes(&sealed(&text, &own));
    }

    #[test]
    fn any_masks_are_read_or_an_error(masks: [u16; 6], levels in (0..20_u8, 0..20_u8)) {
        let (mut description, mut data) = parts(&tiny().to_bytes());
        for (bytes, mask) in data.as_chunks_mut::<2>().0.iter_mut().zip(masks) {
            *bytes = mask.to_le_bytes();
        }
        let crc = crc32fast::hash(&data[..10]);
        let patch = &mut description["patches"][0];
        patch["sections"]["child_mask"]["crc32"] = crc.into();
        patch["levels"] = serde_json::json!({ "position": levels.0, "direction": levels.1 });
        let _ = WctFile::from_bytes(&sealed(&description.to_string(), &data));
    }
}

#[test]
fn every_truncation_is_named() {
    let bytes = tiny_coded().to_bytes();
    for len in 0..bytes.len() {
        let result = WctFile::from_bytes(&bytes[..len]);
        let found = len as u64;
        assert!(
            matches!(&result, Err(Error::Truncated { found: f, .. }) if *f == found),
            "{len} bytes: {result:?}"
        );
    }
    let long = [&bytes[..], &[0]].concat();
    let error = WctFile::from_bytes(&long).expect_err("a byte too many");
    assert!(error.to_string().starts_with("the file's length is"), "{error}");
}

#[test]
fn every_flipped_bit_is_found() {
    for mut bytes in [tiny().to_bytes(), tiny_coded().to_bytes()] {
        for bit in 0..8 * bytes.len() {
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert!(WctFile::from_bytes(&bytes).is_err(), "bit {bit}");
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
    }
}

/// Damage with the checksums in order, as no accident makes it.
#[test]
fn every_flipped_bit_of_a_code_is_read_or_an_error() {
    let (mut description, data) = parts(&tiny_coded().to_bytes());
    let section = description["patches"][0]["sections"]["tree"].clone();
    let (offset, nbytes) = (section["offset"].as_u64(), section["nbytes"].as_u64());
    let (Some(0), Some(nbytes)) = (offset, nbytes) else { panic!("{section}") };
    for bit in 0..8 * nbytes as usize {
        let mut data = data.clone();
        data[bit / 8] ^= 1 << (bit % 8);
        let crc = crc32fast::hash(&data[..nbytes as usize]);
        description["patches"][0]["sections"]["tree"]["crc32"] = crc.into();
        if let Ok(file) = WctFile::from_bytes(&sealed(&description.to_string(), &data)) {
            assert_eq!(WctFile::from_bytes(&file.to_bytes()).ok(), Some(file), "bit {bit}");
        }
    }
}

/// What is wrong with `tiny` once the value at `pointer` is `value`.
fn complaint(pointer: &str, value: Value) -> String {
    complaint_of(&tiny(), pointer, value)
}

fn complaint_of(file: &WctFile, pointer: &str, value: Value) -> String {
    let (mut description, data) = parts(&file.to_bytes());
    let (parent, key) = pointer.rsplit_once('/').expect("a pointer");
    description.pointer_mut(parent).expect("the tiny file has it")[key] = value;
    match WctFile::from_bytes(&sealed(&description.to_string(), &data)) {
        Ok(_) => "none".to_owned(),
        Err(error) => error.to_string(),
    }
}

#[test]
fn what_no_writer_produces_is_named_with_its_place() {
    let section = "/patches/0/sections/nu_mask";
    let of = |key: &str| format!("{section}/{key}");
    let cases = [
        ("/basis/order", json!(2), "basis is `haar of order 2 over nusselt`"),
        ("/basis/directions", json!("concentric"), "knows only `haar of order 1 over nusselt`"),
        ("/colour_space", json!("ACEScg"), "colour_space is `ACEScg`"),
        ("/units", json!("cd m^-2"), "units is `cd m^-2`"),
        ("/patches", json!({}), "invalid type: map, expected a sequence"),
        ("/patches/0/chart", json!("spherical"), "unknown variant `spherical`, expected one of"),
        ("/patches/0/side", json!("both"), "unknown variant `both`"),
        (
            "/patches/0/levels/position",
            json!(17),
            "patches[0].levels.position is 17 in the description at byte 64, but must be at most 16",
        ),
        ("/patches/0/levels/direction", json!(300), "expected u8"),
        (
            "/patches/0/levels/direction",
            json!(1),
            "masks 0xffff, 0x777e that depth 0 does not allow",
        ),
        (
            "/patches/0/name",
            json!("ceiling λ \"lamp\""),
            "patch `ceiling λ \"lamp\"` at byte 64: an earlier patch has the same name",
        ),
        ("/patches/0/nodes", json!(u64::MAX), "patches[0].nodes is 18446744073709551615"),
        ("/patches/0/nodes", json!(4), "patches[0].sections.child_mask.shape is [17]"),
        ("/patches/0/coefficients", json!(1), "coefficients.shape is"),
        ("/patches/0/root", json!([0, 0]), "invalid length 2"),
        ("/patches/0/root", json!([1e300, 0, 0]), "number out of range"),
        ("/patches/0/relative_error", json!(-1), "its relative_error is -1"),
        ("/patches/0/vertices", json!([[0, 0, 0]]), "1 vertices, where 3 to 1024 are allowed"),
        (
            &of("codec"),
            json!("zstd"),
            "nu_mask.codec is `zstd` in the description at byte 64, but this build knows only `raw`",
        ),
        (&of("dtype"), json!("u32"), "nu_mask.dtype is u32"),
        (&of("shape"), json!([1_u64 << 40]), "nu_mask.shape is [1099511627776]"),
        (
            &of("offset"),
            json!(0),
            "nu_mask.offset is 0 in the description at byte 64, but must be at least 34, where another section ends",
        ),
        (&of("offset"), json!(65), "a multiple of 64"),
        (&of("offset"), json!(1_u64 << 63), "nu_mask.offset is 9223372036854775808"),
        (&of("nbytes"), json!(u64::MAX), "nu_mask.nbytes is 18446744073709551615"),
        (&of("nbytes"), json!(12), "nu_mask at byte"),
        (&of("crc32"), json!(0), "patches[0].sections.nu_mask at byte"),
        (section, Value::Null, "invalid type: null"),
    ];
    for (pointer, value, expected) in cases {
        let found = complaint(pointer, value);
        assert!(found.contains(expected), "{pointer}: {found}");
    }
}

#[test]
fn what_no_writer_says_of_a_code_is_named_with_its_place() {
    let of = |key: &str| format!("/patches/0/sections/tree/{key}");
    let cases = [
        (
            of("codec"),
            json!("region-legendre"),
            "tree.codec is `region-legendre` in the description at byte 64, but this build knows only `region-haar`",
        ),
        (of("dtype"), json!("u16"), "tree.dtype is u16"),
        (of("shape"), json!([1_u64 << 60]), "tree.shape is [1152921504606846976]"),
        ("/patches/0/nodes".to_owned(), json!(1), "patches[0].nodes is 1"),
        ("/patches/0/coefficients".to_owned(), json!(1), "patches[0].coefficients is 1"),
        ("/patches/0/root".to_owned(), json!([0, 0, 0]), "patches[0].root is [0.0, 0.0, 0.0]"),
        ("/patches/0/levels/direction".to_owned(), json!(3), "patch `floor` at byte"),
    ];
    for (pointer, value, expected) in cases {
        let found = complaint_of(&tiny_coded(), &pointer, value);
        assert!(found.contains(expected), "{pointer}: {found}");
    }
}

#[test]
fn what_a_later_minor_version_adds_is_skipped() {
    let future = json!({ "codec": "later", "crc32": 0, "dtype": "?", "nbytes": 0, "offset": 0, "shape": [] });
    for pointer in ["/weather", "/patches/1/weather", "/patches/0/sections/bounds", "/sections"] {
        let value = if pointer == "/sections" { json!({ "x": future }) } else { future.clone() };
        assert_eq!(complaint(pointer, value), "none", "{pointer}");
    }
    let mut bytes = tiny().to_bytes();
    bytes[10] = 9;
    assert!(WctFile::from_bytes(&with_header_checksum(bytes)).is_ok(), "minor version 9");
}

#[test]
fn a_later_major_version_is_refused_by_number() {
    let mut bytes = tiny().to_bytes();
    bytes[8] = 2;
    let error = WctFile::from_bytes(&with_header_checksum(bytes)).expect_err("version 2");
    assert_eq!(error.to_string(), "format version 2, but this build reads up to 1");
}

#[test]
fn descriptions_that_are_not_json_are_named_with_the_place() {
    let deep = "[".repeat(100_000);
    for (text, expected) in [
        ("{\"basis\":\u{0}", "the description at byte 73 cannot be read: expected value"),
        (&deep, "invalid type: sequence"),
        (&format!("{{\"x\":{deep}"), "cannot be read"),
        ("", "EOF while parsing"),
        ("{} {}", "missing field"),
    ] {
        let error = WctFile::from_bytes(&sealed(text, &[])).expect_err("not a description");
        assert!(error.to_string().contains(expected), "{error}");
    }
    let mut bytes = sealed("{\"generator\":\"?\"}", &[]);
    bytes[78] = 0xff;
    let crc = crc32fast::hash(&bytes[64..]);
    bytes[32..36].copy_from_slice(&crc.to_le_bytes());
    let error = WctFile::from_bytes(&with_header_checksum(bytes)).expect_err("not UTF-8");
    assert!(error.to_string().contains("invalid unicode code point"), "{error}");
}

/// Only files called `name` are in `folder`.
fn assert_alone(folder: &Path, name: &str) {
    let entries = fs::read_dir(folder).expect("the folder");
    let names: Vec<_> = entries.map(|entry| entry.expect("an entry").file_name()).collect();
    assert_eq!(names, [name], "in {}", folder.display());
}

#[test]
fn a_failed_write_leaves_the_old_file_and_nothing_else() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("old.wct");
    tiny().write(&path).expect("a first write");
    let mut twice = tiny();
    twice.patches.push(twice.patches[0].clone());
    let error = twice.write(&path).expect_err("two patches of one name");
    assert_eq!(error.to_string(), "patch `floor`: an earlier patch has the same name");
    assert_eq!(WctFile::read(&path).expect("the old file"), tiny());
    assert_alone(folder.path(), "old.wct");
    // A rename onto a folder fails after everything has been written.
    let inner = tempfile::tempdir().expect("a folder");
    let path = inner.path().join("taken");
    fs::create_dir(&path).expect("a folder");
    assert!(tiny().write(&path).is_err(), "a folder is in the way");
    assert_alone(inner.path(), "taken");
}

/// The path to write to, for the child process of the test below.
const KILLED_WRITER: &str = "WCT_KILLED_WRITER";

#[test]
fn a_killed_writer_leaves_a_whole_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("old.wct");
    for run in 0..20 {
        let mut child = Command::new(std::env::current_exe().expect("this program"))
            .args(["--exact", "--ignored", "wct_file::writes_until_killed"])
            .env(KILLED_WRITER, &path)
            .stdout(Stdio::null())
            .spawn()
            .expect("this program again");
        let started = Instant::now();
        while !path.exists() && started.elapsed() < Duration::from_secs(60) {
            std::thread::sleep(Duration::from_millis(1));
        }
        std::thread::sleep(Duration::from_micros(700 * run));
        child.kill().expect("a running child");
        child.wait().expect("a child");
        let file = WctFile::read(&path).expect("one of the files written");
        assert!(file.generator.starts_with("writer"), "{}", file.generator);
    }
}

#[test]
#[ignore = "endless: the child process of a_killed_writer_leaves_a_whole_file"]
fn writes_until_killed() {
    let Some(path) = std::env::var_os(KILLED_WRITER) else { return };
    for i in 0_u64.. {
        let generator = format!("writer {i}{}", " ".repeat(i as usize % 7 * 100_000));
        WctFile { generator, ..tiny() }.write(&path).expect("a write");
    }
}
