//! Golden pictures: each shows one thing, and is compared with how it was by FLIP
//! (mean, 0 to 1) and by relative MSE, as `tracer compare` measures them. Where
//! physics has a say, tests elsewhere hold the program to that; these guard against
//! change.
//!
//! A picture that is off fails and leaves itself and FLIP's map in `target/tmp`. Look
//! at both; if the change is meant, accept what there is now by
//!
//!     UPDATE_GOLDEN=1 cargo test -p tracer --test integration images

use crate::support::{Folder, chapel_wct, repository, scene, succeed};
use serde_json::Value;
use std::fs;
use std::path::Path;

/// How far from its golden a picture may be.
///
/// The same program gives the same bytes. Another compiler or processor may round
/// otherwise and so send a sample to the other side of an edge: with n samples a
/// pixel that is up to 1/n of a contrast in a pixel here and there. [`Bounds::EDGES`]
/// has room for some one pixel of a thousand; another seed, which is what any change
/// of sampling amounts to, is ten times as far off
/// ([`the_bounds_tell_another_seed`]).
struct Bounds {
    flip: f64,
    relative_mse: f64,
}

impl Bounds {
    /// Of pictures with edges and a few samples a pixel.
    const EDGES: Self = Self { flip: 1e-3, relative_mse: 2e-4 };

    /// Of pictures with light from a bake of boxes, which integrates transport to 1 %:
    /// another way to do that is as right. All of a picture 1 % brighter is 0.022 of
    /// FLIP and 7.7·10⁻⁵ of relative MSE, another seed 0.04 and 0.02; two ways of
    /// integrating were 0.002 and 10⁻⁵ apart.
    const BAKED: Self = Self { flip: 5e-3, relative_mse: 5e-5 };

    /// Of pictures of one smooth surface, where no sample has an edge to cross:
    /// rounding of f32 radiance, and of the file's coefficients.
    const SMOOTH: Self = Self { flip: 1e-4, relative_mse: 1e-8 };

    fn hold(&self, found: &Value) -> bool {
        let at = |what: &str| found[what].as_f64().expect("a number");
        at("flip") <= self.flip && at("relative_mse") <= self.relative_mse
    }
}

/// What `tracer compare` says of two pictures.
fn compared(found: &str, expected: &str, map: &str) -> Value {
    let printed = succeed(&["compare", found, expected, "--json", "-o", map]);
    serde_json::from_str(&printed).expect("JSON")
}

/// Renders `golden`, a file of `tests/golden`, by `render` with these arguments, and
/// compares.
fn check(golden: &str, bounds: &Bounds, args: &[&str]) {
    let kept = repository(&format!("tests/golden/{golden}"));
    let folder = Folder::new();
    let output = folder.path(golden);
    succeed(&[&["render"], args, &["-o", &output]].concat());
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        fs::copy(&output, &kept).expect("a writable tests/golden");
    }
    assert!(Path::new(&kept).exists(), "{kept} is missing; UPDATE_GOLDEN=1 writes it");
    let map = folder.path("flip.png");
    let found = compared(&output, &kept, &map);
    if !bounds.hold(&found) {
        let keep = |from: &str, name: String| {
            let to = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
            fs::copy(from, &to).expect("a writable target folder");
            to.display().to_string()
        };
        let (now, map) =
            (keep(&output, golden.to_owned()), keep(&map, format!("{golden}.flip.png")));
        panic!("{golden} has changed: {found}\nnow: {now}\nFLIP: {map}\n(see tests/images.rs)");
    }
}

/// Everything together: the window, its light on the floor, lamps and their shadows,
/// textures, the tone curve.
#[test]
fn the_chapel_looks_as_it_did() {
    let chapel = scene("chapel/chapel.gltf");
    let look = ["--wct", chapel_wct(), "--camera", "nave", "--size", "200x150"];
    let display = ["--samples", "4", "--exposure", "1.5"];
    check("chapel.png", &Bounds::BAKED, &[&[&chapel[..]], &look[..], &display].concat());
}

/// The reflection of the window in the tiles: the part of a patch's radiance that
/// changes most with direction.
#[test]
fn the_window_is_reflected_as_it_was() {
    let chapel = scene("chapel/chapel.gltf");
    let look = ["--wct", chapel_wct(), "--camera", "low", "--size", "160x120"];
    let display = ["--samples", "4", "--exposure", "0.5"];
    check("reflection.png", &Bounds::BAKED, &[&[&chapel[..]], &look[..], &display].concat());
}

/// Radiance in numbers, with no tone curve between: an emitter over a floor, of known
/// irradiance (`scenes/README.md`; `smooth.rs` holds the floor to it).
const QUAD: [&str; 4] = ["--size", "32x24", "--samples", "16"];

#[test]
fn an_emitter_and_its_floor_look_as_they_did() {
    check("quad.exr", &Bounds::EDGES, &[&[&scene("quad/quad.gltf")[..]], &QUAD[..]].concat());
}

/// A surface without an edge in view: what changes here is radiance itself.
#[test]
fn a_floor_alone_looks_as_it_did() {
    let crop = ["--size", "256x192", "--crop", "98,122,122,138", "--samples", "4"];
    check("floor.exr", &Bounds::SMOOTH, &[&[&scene("quad/quad.gltf")[..]], &crop[..]].concat());
}

/// A bound that lets another seed through would let most changes through.
#[test]
fn the_bounds_tell_another_seed() {
    let folder = Folder::new();
    let quad = scene("quad/quad.gltf");
    let picture = |seed: &str| {
        let output = folder.path(&format!("{seed}.exr"));
        let args = ["render", &quad, "--seed", seed, "-o", &output];
        succeed(&[&args[..], &QUAD].concat());
        output
    };
    let found = compared(&picture("0"), &picture("1"), &folder.path("map.png"));
    assert!(!Bounds::EDGES.hold(&found), "{found}");
}
