//! Reflection gives back no more than it got.

use crate::support::chapel::Chapel;
use crate::support::{Folder, scene, succeed};
use wrt_core::{Grid, Levels, LobeMatrix, Phong, WctFile, reflect};

/// 4 Σ L Δκ Δλ, summed over the positions.
fn flux(grid: &Grid) -> [f64; 3] {
    grid.irradiance().iter().fold([0.0; 3], |sum, e| std::array::from_fn(|c| sum[c] + e[c]))
}

/// k_d E ≤ M ≤ (k_d + k_s) E for every baked tile: the diffuse part is exact, and
/// the lobe reflects k_s at normal incidence and less at any other.
#[test]
fn baked_tiles_reflect_between_their_diffuse_part_and_all_of_it() {
    // Single precision, summed over 64 × 256 cells.
    const ROUNDING: f64 = 1e-5;
    let folder = Folder::new();
    let output = folder.path("chapel.wct");
    let options = ["--level", "3", "--direction-level", "4", "--threshold", "0", "--checks", "0"];
    let args = ["bake", &scene("chapel/chapel.gltf"), "--incident", "-o", &output];
    succeed(&[&args[..], &options].concat());
    let file = WctFile::read(&output).expect("a .wct file");
    for tile in &Chapel::read().tiles {
        let name = &tile.name;
        let of = |name: &str| flux(&file.patch(name).expect("a patch").tree.to_grid());
        let (incident, reflected) = (of(&format!("{name}.incident")), of(name));
        for c in 0..3 {
            let share = reflected[c] / incident[c];
            assert!(incident[c] > 0.0, "{name}: {incident:?}");
            let (least, most) = (tile.kd[c], tile.kd[c] + tile.ks[c]);
            assert!(share > least - ROUNDING && share < most + ROUNDING, "{name}, {c}: {share}");
            assert!(most <= 1.0, "{name} makes light");
        }
    }
}

/// Light from a single direction cell, whichever: both materials of the chapel.
/// The lobes reflect at most 0.995 of their k_s, next to the normal.
#[test]
fn no_direction_is_reflected_with_a_gain() {
    let levels = Levels { position: 0, direction: 4 };
    for (kd, ks, exponent) in [([0.78, 0.73, 0.64], 0.1, 8.0), ([0.1, 0.1, 0.12], 0.6, 40.0)] {
        let phong = Phong { kd, ks: [ks; 3], exponent };
        let lobe = LobeMatrix::phong(exponent, 4, 4);
        for lit in 0..levels.directions() {
            let images = (0..levels.directions()).map(|s| (s == lit).then(|| vec![[1.0; 3]]));
            let incident = Grid::from_images(levels, images.collect());
            let (given, taken) = (flux(&incident), flux(&reflect(&incident, &phong, Some(&lobe))));
            for c in 0..3 {
                let (share, most) = (taken[c] / given[c], kd[c] + ks);
                assert!(share < most, "n = {exponent}, cell {lit}: {share} of {most}");
            }
        }
    }
}
