use super::*;
use crate::TreeBuilder;
use crate::grid::{Grid, udc_fractions};
use proptest::prelude::*;

fn levels() -> impl Strategy<Value = Levels> {
    (0..4_u8, 0..4_u8).prop_map(|(position, direction)| Levels { position, direction })
}

/// Light that is dark in some cells, smooth or rough, within the UDC or anywhere.
fn tree() -> impl Strategy<Value = Tree> {
    let within_udc = any::<bool>();
    let rough = any::<bool>();
    (levels(), any::<u64>(), 0.0..1.0f32, rough, within_udc).prop_map(
        |(levels, seed, lit, rough, within_udc)| {
            let mut state = seed | 1;
            let mut random = move || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (state >> 40) as f32 / (1 << 24) as f32
            };
            let image = |(d, fraction): (usize, f64)| {
                (fraction > 1e-9 || !within_udc).then(|| {
                    let texel = |p: usize| {
                        let smooth = (d as f32 * 0.1).sin() + (p as f32 * 0.07).cos() + 2.0;
                        let value = if rough { random() } else { smooth };
                        if random() < lit { [value, 0.5 * value, 0.7] } else { [0.0; 3] }
                    };
                    (0..levels.positions()).map(texel).collect()
                })
            };
            let fractions = udc_fractions(levels.direction).into_iter().enumerate();
            TreeBuilder::from_grid(&Grid::from_images(levels, fractions.map(image).collect()))
                .finish()
        },
    )
}

fn measured(tree: &Tree, other: &Tree) -> f64 {
    match tree.norm_squared() {
        0.0 => 0.0,
        norm => (tree.difference(other).squared / norm).sqrt(),
    }
}

proptest! {
    #[test]
    fn the_error_asked_for_is_kept_and_reported(tree in tree(), error in 1e-4..0.3f64) {
        let (small, report) = tree.quantised(error);
        prop_assert!(report.relative_error <= error, "{report:?}");
        let found = measured(&tree, &small);
        prop_assert!((found - report.relative_error).abs() <= 1e-12, "{found} {report:?}");
        let largest = tree.difference(&small).largest;
        prop_assert!((largest - report.largest_error).abs() <= 1e-12, "{largest} {report:?}");
        if let Some(code) = small.code() {
            prop_assert_eq!(small.largest_error(), Some(report.largest_error));
            let again = Tree::from_code(tree.levels(), code);
            prop_assert_eq!(again.as_ref(), Ok(&small));
        }
    }

    #[test]
    fn any_bits_are_a_tree_or_an_error(
        levels in (0..18_u8, 0..18_u8), bits in prop::collection::vec(any::<u8>(), 0..200),
        within_udc: bool,
    ) {
        let levels = Levels { position: levels.0, direction: levels.1 };
        let header = [1.0_f64, 0.0, 3.0, 1.0, 0.5].into_iter().flat_map(f64::to_le_bytes);
        let axes = [1.0_f32, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let mut bytes: Vec<u8> = header.collect();
        bytes.extend(axes.into_iter().flat_map(f32::to_le_bytes));
        bytes.push(within_udc.into());
        bytes.extend(bits);
        if let Ok(tree) = Tree::from_code(levels, &bytes) {
            prop_assert!(tree.norm_squared().is_finite());
            prop_assert_eq!(tree.code(), Some(&bytes[..]));
        }
    }

    #[test]
    fn any_header_is_a_tree_or_an_error(
        tree in tree(), at in 0..HEADER, with in prop::collection::vec(any::<u8>(), 1..8),
    ) {
        let Some(mut bytes) = tree.quantised(0.05).0.code().map(<[u8]>::to_vec) else {
            return Ok(());
        };
        for (byte, with) in bytes[at..].iter_mut().zip(with) {
            *byte = with;
        }
        if let Ok(tree) = Tree::from_code(tree.levels(), &bytes) {
            prop_assert!(tree.norm_squared().is_finite());
        }
    }

    #[test]
    fn every_truncation_is_an_error(tree in tree()) {
        let small = tree.quantised(0.05).0;
        let Some(bytes) = small.code() else { return Ok(()) };
        let step = (bytes.len() / 50).max(1);
        for len in (0..bytes.len()).step_by(step) {
            prop_assert!(Tree::from_code(tree.levels(), &bytes[..len]).is_err(), "{len} bytes");
        }
        let longer = [bytes, &[0]].concat();
        prop_assert!(Tree::from_code(tree.levels(), &longer).is_err());
    }
}

/// A window seen from a floor: most directions are dark.
fn window(level: u8) -> Tree {
    let levels = Levels::isotropic(level);
    let side = 1_usize << level;
    let centre = |i: usize| (i as f64 + 0.5) / side as f64;
    let image = |(d, fraction): (usize, f64)| {
        let (k, l) = (centre(d % side), centre(d / side));
        let lit = fraction == 1.0 && (0.5..0.8).contains(&l) && (0.3..0.7).contains(&k);
        let texel = |p: usize| {
            let shade = 2.0 + (5.0 * (centre(p % side) + k)).sin() + (7.0 * l).cos();
            if centre(p / side) < 2.0 * k { [shade as f32, 1.0, 0.1] } else { [0.0; 3] }
        };
        lit.then(|| (0..side * side).map(texel).collect())
    };
    let images = udc_fractions(level).into_iter().enumerate().map(image).collect();
    TreeBuilder::from_grid(&Grid::from_images(levels, images)).finish()
}

#[test]
fn darkness_stays_dark() {
    let tree = window(4);
    let (small, report) = tree.quantised(0.02);
    assert!(report.relative_error > 0.015, "the error is used: {report:?}");
    let (before, after) = (tree.to_grid(), small.to_grid());
    for i in 0..1_usize << 16 {
        let m = [i & 15, i >> 4 & 15, i >> 8 & 15, i >> 12];
        let dark = before.mean(m).iter().all(|x| x.abs() < 1e-6);
        assert!(!dark || after.mean(m).iter().all(|x| x.abs() < 1e-6), "{m:?}");
    }
}

#[test]
fn it_takes_a_fraction_of_what_thresholding_does() {
    let tree = window(4);
    let (thresholded, _) = tree.compressed(crate::Keep::RelativeError(0.01));
    let raw = 4 * thresholded.nodes().len() + 12 * thresholded.coefficients().len();
    let coded = tree.quantised(0.01).0.code().map_or(usize::MAX, <[u8]>::len);
    assert!(8 * coded < raw, "{coded} bytes, and {raw} without");
}

#[test]
fn what_no_writer_produces_is_named() {
    let small = window(2).quantised(0.05).0;
    let code = small.code().expect("its code").to_vec();
    let with = |at: usize, bytes: &[u8]| {
        let mut code = code.clone();
        code[at..at + bytes.len()].copy_from_slice(bytes);
        Tree::from_code(small.levels(), &code).expect_err("no writer produces it")
    };
    for (at, bytes, expected) in [
        (0, 0.0_f64.to_le_bytes(), "a step of 0"),
        (0, (-1.0_f64).to_le_bytes(), "a step of -1"),
        (8, f64::NAN.to_le_bytes(), "a largest error of NaN"),
        (16, f64::INFINITY.to_le_bytes(), "a root of [inf"),
        (40, [255; 8], "axes of colour of [[NaN"),
        (0, 1e300_f64.to_le_bytes(), "a coefficient is not finite"),
    ] {
        let found = with(at, &bytes);
        assert!(found.starts_with(expected), "{found}");
    }
    assert_eq!(with(76, &[2]), "2 where 0 or 1 says whether light is within the UDC");
    assert_eq!(
        Tree::from_code(small.levels(), &code[..76]).expect_err("no header"),
        "76 bytes, of which the first 77 are a header"
    );
    assert_eq!(
        Tree::from_code(Levels { position: 17, direction: 2 }, &code).expect_err("levels"),
        "levels above 16"
    );
}

/// Bits that never end a tree are stopped by its number of nodes.
#[test]
fn nodes_are_bounded_by_bytes() {
    let code = window(2).quantised(0.05).0;
    let mut bytes = code.code().expect("its code")[..HEADER].to_vec();
    bytes.extend([0; 1000]);
    let most = NODES_PER_BYTE * bytes.len();
    let error = Tree::from_code(Levels::isotropic(16), &bytes).expect_err("too many nodes");
    assert_eq!(error, format!("{} bytes for more than {most} nodes", bytes.len()));
}
