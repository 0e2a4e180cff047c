//! Smooth patches in a table, and as cells to be drawn.

use glam::{DVec2, DVec3};
use rayon::prelude::*;
use serde_json::{Value, json};
use wrt_core::grid::{Grid, udc_fractions};
use wrt_core::legendre::LegendreSampler;
use wrt_core::wct_file::Side;
use wrt_core::{Levels, Nusselt, Patch, SmoothPatch, TreeBuilder};

/// Levels at which smooth patches are drawn.
const DRAWN: Levels = Levels { position: 4, direction: 5 };

/// Its cells, orders and errors.
pub(super) fn json(patch: &SmoothPatch) -> Value {
    let census = patch.tree.census();
    json!({
        "name": patch.name,
        "side": "outgoing",
        "vertices": patch.polygon.vertices,
        "directions": patch.tree.map(),
        "levels": { "position": census.levels[0], "direction": census.levels[1] },
        "orders": { "position": census.orders[0], "direction": census.orders[1] },
        "positions": census.positions,
        "leaves": census.leaves,
        "coefficients": patch.tree.len(),
        "relative_error": patch.relative_error,
        "error_estimate": patch.error_estimate,
    })
}

/// A heading and a row per patch.
pub(super) fn rows(patches: &[SmoothPatch]) -> Vec<Vec<String>> {
    let heading = [
        "smooth patch",
        "directions",
        "positions",
        "leaves",
        "levels",
        "orders",
        "coefficients",
        "left out",
        "error",
    ];
    let row = |patch: &SmoothPatch| {
        let census = patch.tree.census();
        let pair = |[a, b]: [usize; 2]| format!("{a},{b}");
        vec![
            patch.name.clone(),
            format!("{:?}", patch.tree.map()),
            census.positions.to_string(),
            census.leaves.to_string(),
            pair(census.levels.map(usize::from)),
            pair(census.orders),
            patch.tree.len().to_string(),
            format!("{:.3} %", 100.0 * patch.relative_error),
            patch.error_estimate.map_or("-".to_owned(), |e| format!("{:.2} %", 100.0 * e)),
        ]
    };
    let heading = heading.map(str::to_owned).to_vec();
    std::iter::once(heading).chain(patches.iter().map(row)).collect()
}

/// The radiance at the middle of each cell, as the patch of boxes that is drawn.
pub(super) fn drawn(patch: &SmoothPatch) -> Patch {
    let sampler = LegendreSampler::new(&patch.tree);
    let side = |level: u8| 1_usize << level;
    let middle = |i: usize, level: u8| {
        let cells = side(level);
        DVec2::new((i % cells) as f64 + 0.5, (i / cells) as f64 + 0.5) / cells as f64
    };
    let image = |(d, fraction): (usize, f64)| {
        let q = middle(d, DRAWN.direction);
        // A cell on the rim is seen by the direction nearest to its middle.
        let mu = 2.0 * q - 1.0;
        let mu = if mu.length() < 1.0 { mu } else { mu * (0.999 / mu.length()) };
        let q = Nusselt { kappa: 0.5 * (mu.x + 1.0), lambda: 0.5 * (mu.y + 1.0) };
        let to_eye: DVec3 = q.to_direction()?;
        let texel = |p: usize| {
            let radiance = sampler.radiance(middle(p, DRAWN.position), to_eye);
            radiance.map(|x| x * fraction as f32)
        };
        (fraction > 0.0).then(|| (0..DRAWN.positions()).map(texel).collect())
    };
    let fractions = udc_fractions(DRAWN.direction).into_par_iter().enumerate();
    let grid = Grid::from_images(DRAWN, fractions.map(image).collect());
    Patch {
        name: patch.name.clone(),
        polygon: patch.polygon.clone(),
        side: Side::Outgoing,
        tree: TreeBuilder::from_grid(&grid).finish(),
        relative_error: patch.relative_error,
        error_estimate: patch.error_estimate,
    }
}
