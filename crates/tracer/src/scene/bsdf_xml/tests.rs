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

/// `pyradiance.bsdf.query(data, θ_to_light, φ, θ_out, φ)`, light from outdoors (θ > 90°).
#[test]
fn values_are_those_that_radiance_looks_up() {
    let directions = [
        ([140., 30.], [40., 210.]),
        ([140., 30.], [20., 100.]),
        ([120., 270.], [60., 90.]),
        ([120., 90.], [60., 270.]),
        ([120., 90.], [50., 90.]),
        ([135., 180.], [40., 0.]),
    ];
    let klems =
        [10.842_422_49, 0.002_170_8, 11.696_657_18, 10.307_244_3, 0.016_658_52, 0.004_212_67];
    let rank_4 =
        [16.790_721_89, 0.002_241_21, 15.291_180_61, 17.318_363_19, 0.009_713_51, 0.004_046_21];
    let rank_3 =
        [7.983_189_58, 0.004_554_43, 8.516_616_82, 8.516_563_42, 0.005_048_18, 7.983_239_65];
    for (text, expected) in [(KLEMS, klems), (RANK_4, rank_4), (RANK_3, rank_3)] {
        let bsdf = parse(text).expect("a BSDF");
        for ((to_light, leave), expected) in directions.into_iter().zip(expected) {
            let found = bsdf.eval(-cosines(to_light), cosines(leave));
            println!("{to_light:?} {leave:?}: {found} {expected}");
            assert!(
                (found / expected - 1.0).abs() < 2e-3,
                "{to_light:?} {leave:?}: {found} {expected}"
            );
        }
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

#[test]
fn the_back_alone_stands_in_by_reciprocity() {
    let whole = parse(KLEMS).expect("a BSDF");
    let back = parse(&KLEMS.replace("Transmission Front", "Nothing")).expect("the back");
    let mut compared = 0;
    for i in 0..40 {
        let at = |i: u32, step: f64| 0.95 * ((f64::from(i) * step).fract() - 0.5);
        let (travel, leave) =
            (DVec2::new(at(i, 0.618), at(i, 0.324)), DVec2::new(at(i, 0.755), at(i, 0.57)));
        let (a, b) = (whole.eval(travel, leave), back.eval(travel, leave));
        // Both are simulated by chance, with 400 samples; the straight ones are many.
        let straight = (whole.eval(travel, travel), back.eval(travel, travel));
        assert!((straight.0 / straight.1 - 1.0).abs() < 0.25, "{travel}: {straight:?}");
        compared += usize::from(a > 0.0 && b > 0.0);
    }
    assert!(compared > 20, "{compared} of 40");
}

#[test]
fn errors_name_the_element() {
    for (from, to, expected) in [
        ("<WindowElement ", "<Window ", "mismatched"),
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
        assert!(expected == "mismatched" || text.contains(expected), "{to}: {text}");
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
