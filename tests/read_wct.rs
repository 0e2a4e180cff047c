//! The second implementation of the format, `read_wct.py`, agrees with the first.

use crate::support::{Folder, scene, succeed};
use crate::wct_file::golden;
use glam::DVec2;
use std::ffi::OsString;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};
use wrt_core::{Nusselt, SmoothPatch, WctFile};

/// A Python with NumPy, if there is one.
fn python() -> Option<OsString> {
    let python = std::env::var_os("PYTHON").unwrap_or_else(|| "python3".into());
    let has_numpy = Command::new(&python).args(["-c", "import numpy"]).output();
    if has_numpy.is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    println!("skipped: no {} with numpy (PYTHON=... names another)", python.display());
    None
}

/// Points (u, v, κ, λ) of no order, some outside the unit directional circle.
fn points() -> Vec<[f64; 4]> {
    (0..64_u32).map(|i| [3, 5, 7, 11].map(|k| f64::from(i * k % 64) / 64.0 + 0.003)).collect()
}

/// The radiance that Python finds at [`points`].
fn read(python: &OsString, file: &Path, patch: &str) -> Vec<[f64; 3]> {
    let lines = points().into_iter().map(|q| q.map(|x| x.to_string()).join(" ") + "\n");
    let mut child = Command::new(python)
        .arg(golden("../read_wct.py"))
        .args([file.as_os_str(), patch.as_ref()])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("python starts");
    let mut stdin = child.stdin.take().expect("a pipe");
    stdin.write_all(lines.collect::<String>().as_bytes()).expect("python reads");
    drop(stdin);
    let output = child.wait_with_output().expect("python ends");
    let printed = String::from_utf8(output.stdout).expect("UTF-8");
    assert_eq!(printed.lines().count(), points().len(), "{printed}");
    let rgb = |line: &str| {
        let rgb: Vec<f64> = line.split(' ').map(|x| x.parse().expect("a number")).collect();
        rgb.try_into().expect("three numbers")
    };
    printed.lines().map(rgb).collect()
}

#[test]
fn python_evaluates_boxes_the_same() {
    let Some(python) = python() else { return };
    for patch in crate::wct_file::tiny().patches {
        let found = read(&python, &golden("tiny.wct"), &patch.name);
        for (found, q) in found.into_iter().zip(points()) {
            for (a, b) in found.into_iter().zip(patch.tree.eval(q)) {
                // Sums of the same single-precision numbers in another order.
                assert!((a - b).abs() < 1e-12, "{q:?}: {a} {b}");
            }
        }
    }
}

/// Of the golden file, and of a bake that `convert --raw` has passed on.
#[test]
fn python_evaluates_polynomials_the_same() {
    let Some(python) = python() else { return };
    let folder = Folder::new();
    let [baked, raw] = ["baked.wct", "raw.wct"].map(|name| folder.path(name));
    let options = ["--error", "0.01", "--orders", "3,5", "--checks", "0"];
    succeed(&[&["bake", &scene("quad/quad.gltf"), "-o", &baked], &options[..]].concat());
    succeed(&["convert", &baked, "--raw", "-o", &raw]);
    let agree = |path: &Path, patch: &SmoothPatch| {
        let found = read(&python, path, &patch.name);
        let (mut lit, greatest) = (0, patch.tree.norm_squared().sqrt());
        for (found, [u, v, kappa, lambda]) in found.into_iter().zip(points()) {
            let Some(mu) = (Nusselt { kappa, lambda }).to_direction() else {
                assert_eq!(found, [0.0; 3], "no direction");
                continue;
            };
            lit += 1;
            for (a, b) in found.into_iter().zip(patch.tree.eval(DVec2::new(u, v), mu)) {
                // The same sums in another order, of polynomials up to degree 4.
                assert!((a - b).abs() < 1e-10 * greatest, "{u} {v} {mu}: {a} {b}");
            }
        }
        assert!(lit > 30, "{lit} points are directions");
    };
    let path = golden("tiny_smooth.wct");
    agree(&path, &WctFile::read(&path).expect("golden").smooth[0]);
    let file = WctFile::read(&raw).expect("just written");
    assert!(file.smooth[0].tree.census().leaves > 4, "a tree to descend");
    agree(raw.as_ref(), &file.smooth[0]);
}
