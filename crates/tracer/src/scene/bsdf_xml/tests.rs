use super::*;
use glam::DVec2;

/// Made by Radiance's programs: `tests/golden/bsdf/generate.py`.
const KLEMS: &str = include_str!("../../../../../tests/golden/bsdf/blind_kq.xml");
const RANK_4: &str = include_str!("../../../../../tests/golden/bsdf/blind_t4.xml");
const RANK_3: &str = include_str!("../../../../../tests/golden/bsdf/blind_t3.xml");

/// (μx, μy) of a direction given by zenith angle and azimuth in degrees.
fn cosines([theta, phi]: [f64; 2]) -> DVec2 {
    theta.to_radians().sin() * DVec2::from_angle(phi.to_radians())
}

/// `pyradiance.bsdf.direct_hemi`, transmitted, of the rank 3 tree, for the middles of four
/// of its table's cells: each ring of the tree's one.
#[test]
fn a_rank_3_tree_passes_what_radiance_says() {
    let bsdf = parse(RANK_3).expect("a BSDF");
    for ([x, y], expected) in [
        ([0.312_5, 0.562_5], 0.875_853_8),
        ([0.187_5, 0.812_5], 0.819_079_6),
        ([0.687_5, 0.437_5], 0.875_853_8),
        ([0.062_5, 0.312_5], 0.858_297_8),
    ] {
        let found = bsdf.hemispherical(wrt_core::disc_of_square(DVec2::new(x, y)));
        // 64 look-ups in each of 64 cells.
        assert!((found - expected).abs() < 0.02, "({x}, {y}): {found} {expected}");
    }
}

/// Directions to the light, outdoors (θ > 90°), and of leaving. None is on an edge between
/// cells, where either is right.
const DIRECTIONS: [([f64; 2], [f64; 2]); 6] = [
    ([140., 30.], [40., 210.]),
    ([140., 30.], [20., 100.]),
    ([120., 275.], [60., 95.]),
    ([120., 85.], [60., 265.]),
    ([120., 95.], [50., 85.]),
    ([135., 175.], [40., 5.]),
];

fn assert_values(bsdf: &Bsdf, expected: [f64; 6], what: &str) {
    for ((to_light, leave), expected) in DIRECTIONS.into_iter().zip(expected) {
        let found = bsdf.eval(-cosines(to_light), cosines(leave));
        assert!(
            (found / expected - 1.0).abs() < 1e-3,
            "{what}, {to_light:?} {leave:?}: {found} {expected}"
        );
    }
}

/// `pyradiance.bsdf.query(data, θ_to_light, φ, θ_out, φ)`.
#[test]
fn values_are_those_that_radiance_looks_up() {
    let klems =
        [10.842_422_49, 0.002_170_8, 11.696_657_18, 10.307_244_3, 0.016_658_52, 0.004_212_67];
    let rank_4 =
        [16.790_721_89, 0.002_241_21, 15.869_910_24, 17.318_363_19, 0.010_605_33, 0.004_046_21];
    for (what, text, expected) in [("Klems", KLEMS, klems), ("rank 4", RANK_4, rank_4)] {
        assert_values(&parse(text).expect("a BSDF"), expected, what);
    }
}

/// `pyradiance.bsdf.direct_hemi`, transmitted, for light from outdoors.
#[test]
fn transmitted_flux_is_radiance_s_own() {
    let directions =
        [[180., 0.], [140., 30.], [140., 210.], [120., 270.], [120., 90.], [160., 90.]];
    let klems = [0.879_52, 0.853_64, 0.919_77, 0.941_08, 0.811_20, 0.836_71];
    let bsdf = parse(KLEMS).expect("a BSDF");
    for (to_light, expected) in directions.into_iter().zip(klems) {
        let found = bsdf.hemispherical(-cosines(to_light));
        assert!((found - expected).abs() < 2e-3, "{to_light:?}: {found} {expected}");
    }
    // And of light in cells of direction, through the whole of the table.
    use wrt_core::{Grid, Levels};
    let level = 6;
    let side = 1_usize << level;
    for (to_light, expected) in directions.into_iter().zip(klems).skip(1) {
        let mu = cosines(to_light);
        let cell = |x: f64| (0.5 * (x + 1.0) * side as f64) as usize;
        let lit = cell(mu.y) * side + cell(mu.x);
        let images = (0..side * side).map(|d| (d == lit).then(|| vec![[1.0; 3]])).collect();
        let light = Grid::from_images(Levels { position: 0, direction: level }, images);
        let found = bsdf.apply(&light).irradiance()[0][0] / light.irradiance()[0][0];
        assert!((found - expected).abs() < 5e-3, "{to_light:?}: {found} {expected}");
    }
}

/// The same look-up in the same files without their `Transmission Front`: a simulation of
/// light that goes out, read backwards.
#[test]
fn the_back_alone_stands_in_as_it_does_in_radiance() {
    let klems = [10.129_042, 0.002_652, 11.846_832, 9.254_355, 0.014_439, 0.002_373];
    let rank_4 = [15.820_314, 0.007_409, 17.609_797, 13.341_03, 0.010_988, 0.002_385];
    for (what, text, expected) in [("Klems", KLEMS, klems), ("rank 4", RANK_4, rank_4)] {
        let back = parse(&text.replace("Transmission Front", "Nothing")).expect("the back");
        assert_values(&back, expected, what);
    }
}

#[test]
fn errors_name_the_element() {
    for (from, to, expected) in [
        ("<WindowElement ", "<Window ", "expected 'Window' tag"),
        ("Columns", "Pillars", "<IncidentDataStructure> is \"Pillars\""),
        (
            "<AngleBasisName>LBNL/Klems Quarter",
            "<AngleBasisName>mine",
            "no <AngleBasis> has the <AngleBasisName>",
        ),
        ("Transmission", "Emission", "nothing passes"),
        ("<nPhis>8", "<nPhis>0", "<nPhis> is 0"),
        ("<nPhis>8", "<nPhis>7", "<ScatteringData>"),
        ("<UpperTheta>90", "<UpperTheta>80", "<AngleBasis> ends before 90"),
        ("<UpperTheta>90", "<UpperTheta>up", "<UpperTheta> is \"up\", not a number"),
    ] {
        assert!(KLEMS.contains(from), "{from} is in the file");
        let error = parse(&KLEMS.replace(from, to)).expect_err(to);
        let text = format!("{error:#}");
        assert!(text.contains(expected), "{to}: {text}");
    }
    let at = RANK_4.find('{').expect("a tree");
    for (tree, expected) in [
        ("{", "ends early"),
        ("{ 1 2 3 }", "no power of 16"),
        ("{ x }", "no number"),
        ("{ 1 } 2", "after the end"),
        ("1", "must be"),
        ("{ { 1 } }", "1 of 16 branches"),
        ("{ -1 }", "value 0 of the BSDF is -1"),
    ] {
        let end = at + RANK_4[at..].find('<').expect("the element's end");
        let text = [&RANK_4[..at], tree, &RANK_4[end..]].concat();
        let error = format!("{:#}", parse(&text).expect_err(tree));
        assert!(error.contains("<ScatteringData>") && error.contains(expected), "{tree}: {error}");
    }
    let deep = format!("{}1{}", "{".repeat(50_000), "}".repeat(50_000));
    let end = at + RANK_4[at..].find('<').expect("the element's end");
    let error = parse(&[&RANK_4[..at], &deep, &RANK_4[end..]].concat()).expect_err("too deep");
    assert!(format!("{error:#}").contains("more than 6 levels"), "{error:#}");
}

#[test]
fn every_truncation_is_an_error() {
    for text in [KLEMS, RANK_4, RANK_3] {
        let whole = text.trim_end().len();
        // Prime, so that cuts fall everywhere in tags and numbers; and all of the start.
        for end in (0..2000).chain((2000..whole).step_by(211)) {
            assert!(parse(&text[..end.min(whole - 1)]).is_err(), "{end} bytes");
        }
    }
}

/// Bytes exchanged: an error or a BSDF, never a panic.
#[test]
fn damaged_files_are_survived() {
    let mut state = 12_345_u64;
    let mut random = move |below: usize| {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    for text in [KLEMS, RANK_4, RANK_3] {
        for _ in 0..100 {
            let mut bytes = text.as_bytes().to_vec();
            for _ in 0..1 + random(5) {
                let at = random(bytes.len());
                bytes[at] = b"<>{}/ 0-e\"x"[random(11)];
            }
            let text = String::from_utf8(bytes).expect("ASCII");
            let _ = parse(&text);
        }
    }
}
