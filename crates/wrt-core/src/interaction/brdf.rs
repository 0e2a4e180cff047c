//! BRDFs and BTDFs as coefficients over (κ_s, λ_s, κ_r, λ_r) (§6.4).

use super::cells::{DirectionCell, cells};
use super::phong::{LobeSample, phong_lobe};
use super::{LobeMatrix, Phong, product};
use crate::{CHILDREN, Cell, Keep, Levels, Tree, TreeBuilder, children, pull};
use std::f64::consts::{FRAC_1_PI, PI, TAU};

/// A BRDF or BTDF in the mixed basis F_j, projected once for a material.
///
/// Its tree has (κ_s, λ_s) in the place of position and (κ_r, λ_r) in that of
/// direction; for Haar, which is its own dual, F_j is B_j. Outside the UDC, where no
/// light is, f has whatever values take the fewest coefficients: [`reflect`] keeps
/// the result inside.
///
/// [`reflect`]: Self::reflect
#[derive(Clone, Debug)]
pub struct BrdfTree {
    tree: Tree,
}

impl BrdfTree {
    /// A Phong BRDF, refined where it varies by more than `tolerance` and then
    /// thresholded; never beyond `levels` (incident, reflected). `lobe` has the
    /// lobe's means over the finest cells.
    ///
    /// ‖f − f̃‖ ≤ `tolerance` ‖f‖ against the means over the finest cells.
    ///
    /// # Panics
    ///
    /// If the lobe's exponent is not `phong`'s.
    #[must_use]
    pub fn phong(phong: &Phong, lobe: &LobeMatrix, tolerance: f64) -> Self {
        assert_eq!(lobe.exponent(), phong.exponent, "the matrix is of this lobe");
        let levels = Levels { position: lobe.incident_level(), direction: lobe.outgoing_level() };
        let n = phong.exponent;
        let diffuse = phong.kd.map(|kd| kd * FRAC_1_PI);
        let glossy = phong.ks.iter().copied().fold(0.0, f64::max);
        let norm = diffuse.iter().map(|d| d * d).sum::<f64>().sqrt() * PI / 4.0
            + phong.ks.iter().map(|k| k * k).sum::<f64>().sqrt() * lobe_norm(n);
        // Half of the squared error to refinement, half to thresholding.
        let allowed = tolerance * std::f64::consts::FRAC_1_SQRT_2;
        let value = |f: f64| std::array::from_fn(|c| diffuse[c] + phong.ks[c] * f);
        let constant = |s: &DirectionCell, r: &DirectionCell| {
            let (least, most) = r.mirror_angle(s);
            let (high, low) = (phong_lobe(n, least.cos()), phong_lobe(n, most.cos()));
            (glossy * 0.5 * (high - low) * 3.0_f64.sqrt() <= allowed * norm)
                .then(|| value(r.mean_lobe(s, n)))
        };
        let finest = |s: usize, r: usize| value(lobe.mean(s, r));
        let tree = project(levels, &constant, &finest);
        Self { tree: tree.compressed(Keep::RelativeError(allowed)).0 }
    }

    /// Any BRDF or BTDF by its means over pairs of finest cells (κ fastest), each
    /// over its part inside the UDC, thresholded to a relative L² error of
    /// `tolerance`.
    #[must_use]
    pub fn from_means(
        levels: Levels,
        mean: &dyn Fn(usize, usize) -> [f64; 3],
        tolerance: f64,
    ) -> Self {
        let tree = project(levels, &|_, _| None, mean);
        Self { tree: tree.compressed(Keep::RelativeError(tolerance)).0 }
    }

    /// Its coefficients, (κ_s, λ_s) as position and (κ_r, λ_r) as direction.
    #[must_use]
    pub fn tree(&self) -> &Tree {
        &self.tree
    }

    /// The radiance reflected (or let through) of `incident`, 0 outside the UDC, by
    /// the nesting nodes of both trees (Eq. 22–27).
    ///
    /// # Panics
    ///
    /// If the direction level of `incident` is not the BRDF's incident one.
    #[must_use]
    pub fn reflect(&self, incident: &Tree) -> Tree {
        product::product(&self.tree, incident, true)
    }
}

/// ‖(n+2)/(2π) max(0, R·V)ⁿ‖ over both discs.
///
/// ∬ f² dκ dλ = ((n+2)/2π)² ¼ ∫ cos²ⁿα cosθ dω, and the last integral is the albedo
/// of exponent 2n but for its normalisation.
fn lobe_norm(exponent: f64) -> f64 {
    const STEPS: u32 = 64;
    let sample = LobeSample::new(2.0 * exponent);
    // ∫ dκ dλ = ¼ ∫ cosθ dω = (π/4) ∫ d(cos²θ).
    let cosine = |i: u32| ((f64::from(i) + 0.5) / f64::from(STEPS)).sqrt();
    let mean = (0..STEPS).map(|i| sample.albedo(cosine(i))).sum::<f64>() / f64::from(STEPS);
    let peak = (exponent + 2.0) / TAU;
    (PI / 4.0 * peak * peak * 0.25 * mean * TAU / (2.0 * exponent + 2.0)).sqrt()
}

type Constant<'a> = &'a dyn Fn(&DirectionCell, &DirectionCell) -> Option<[f64; 3]>;

/// The tree of a function of two directions: `constant` gives its value on a block
/// where it may pass for constant, `finest` on a pair of finest cells.
fn project(
    levels: Levels,
    constant: Constant<'_>,
    finest: &dyn Fn(usize, usize) -> [f64; 3],
) -> Tree {
    let pyramid = |level: u8| (0..=level).map(|l| cells(l, |_| 2)).collect();
    let mut projection = Projection {
        levels,
        incident: pyramid(levels.position),
        outgoing: pyramid(levels.direction),
        constant,
        finest,
        out: TreeBuilder::new(levels),
    };
    let root = projection.descend(Cell::ROOT).unwrap_or_default();
    projection.out.add_root(root);
    projection.out.finish()
}

struct Projection<'a> {
    levels: Levels,
    /// By level.
    incident: Vec<Vec<DirectionCell>>,
    outgoing: Vec<Vec<DirectionCell>>,
    constant: Constant<'a>,
    finest: &'a dyn Fn(usize, usize) -> [f64; 3],
    out: TreeBuilder,
}

impl Projection<'_> {
    /// Adds the coefficients below `cell`; its mean, or `None` outside the UDC.
    fn descend(&mut self, cell: Cell) -> Option<[f64; 3]> {
        let levels = self.levels;
        let (a, b) = (cell.depth.min(levels.position), cell.depth.min(levels.direction));
        let m = cell.m.map(usize::from);
        let (s, r) = (m[1] << a | m[0], m[3] << b | m[2]);
        let pair = (&self.incident[usize::from(a)][s], &self.outgoing[usize::from(b)][r]);
        if pair.0.is_empty() || pair.1.is_empty() {
            return None;
        }
        if cell.depth == levels.depth() {
            return Some((self.finest)(s, r));
        }
        if let Some(value) = (self.constant)(pair.0, pair.1) {
            return Some(value);
        }
        let split = levels.split(cell.depth);
        let values: [Option<[f64; 3]>; CHILDREN] = std::array::from_fn(|m| {
            if m & !split == 0 { self.descend(cell.child(split, m)) } else { None }
        });
        let inside = values.iter().flatten().count();
        if inside == 0 {
            return None;
        }
        // Children outside the UDC follow the others, which costs no coefficient
        // where f is smooth.
        let mean: [f64; 3] = std::array::from_fn(|c| {
            values.iter().flatten().map(|v| v[c]).sum::<f64>() / inside as f64
        });
        let scale = levels.scale(cell.depth + 1).recip();
        let mut nodes = [[0.0; 3]; CHILDREN];
        let mut root = [0.0; 3];
        for c in 0..3 {
            let mut channel = [0.0; CHILDREN];
            for m in children(split) {
                channel[m] = scale * values[m].map_or(mean[c], |v| v[c]);
            }
            pull(&mut channel, split);
            root[c] = channel[0] * levels.scale(cell.depth);
            for nu in 1..CHILDREN {
                nodes[nu][c] = channel[nu];
            }
        }
        if nodes.iter().any(|b| *b != [0.0; 3]) {
            self.out.add_node(cell, &nodes);
        }
        Some(root)
    }
}
