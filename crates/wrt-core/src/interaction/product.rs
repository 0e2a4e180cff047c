//! The product of a BRDF's coefficients with a radiance's (Eq. 22–27).
//!
//! For Haar a Δ tensor is zero unless one support holds the other, so that F_j and
//! B_k meet only where the nodes of both trees nest in (κ_s, λ_s). Both trees are
//! descended together, as triples of cells (X, S, R): X of position, S of incident
//! and R of reflected direction, of one depth. Where neither tree has a node below,
//! f and L are constant and the triple adds 4 |S| f L to (X, R). Where only one has,
//! the other is a factor of the first's integral over S, which is computed once a
//! node: an image of X, or of R.
//!
//! Departs from Eq. 27, which names the coefficients b_n one by one: means are
//! summed at the cells where they arise, and one pull-up makes coefficients of them.

mod operand;

use crate::grid::udc_fractions;
use crate::{CHILDREN, Cell, Levels, Tree, TreeBuilder, children, pull};
use operand::{Means, Operand, Over, measure};

/// 4 ∬ f L dκ_s dλ_s as coefficients over (u, v, κ_r, λ_r).
///
/// `brdf` runs over (κ_s, λ_s; κ_r, λ_r) as `incident` does over (u, v; κ, λ): its
/// "position" level is that of incident direction. With `within_udc` the result is 0
/// outside the UDC, and a cell on the rim has the mean with those zeros.
///
/// # Panics
///
/// If the incident direction levels of the two differ.
pub(super) fn product(brdf: &Tree, incident: &Tree, within_udc: bool) -> Tree {
    let (found, needed) = (incident.levels().direction, brdf.levels().position);
    assert_eq!(found, needed, "the BRDF's incident level is the light's");
    let levels =
        Levels { position: incident.levels().position, direction: brdf.levels().direction };
    let mut product = Product {
        light: Operand::new(incident, Over::Direction),
        brdf: Operand::new(brdf, Over::Position),
        levels,
        incident: found,
        nodes: vec![Sum::EMPTY],
        images: Vec::new(),
        fractions: if within_udc {
            (0..=levels.direction).map(udc_fractions).collect()
        } else {
            Vec::new()
        },
    };
    let root = |tree: &Tree| tree.root();
    let (l, f) = (root(incident), root(brdf));
    let mut constant = [0.0; 3];
    let (mut x, mut r) = (None, None);
    match (incident.nodes().is_empty(), brdf.nodes().is_empty()) {
        (true, true) => {
            constant = std::array::from_fn(|c| 4.0 * f64::from(l[c]) * f64::from(f[c]));
        }
        (false, true) => x = Some(scaled(&product.light.integrals[0], f)),
        (true, false) => r = Some(scaled(&product.brdf.integrals[0], l)),
        (false, false) => product.descend(0, 0, 0, 0),
    }
    let mut out = TreeBuilder::new(levels);
    let top = (!incident.nodes().is_empty() && !brdf.nodes().is_empty()).then_some(0);
    let above = [x.as_deref().map(View::of), r.as_deref().map(View::of)];
    let mean = product.emit(&mut out, top, Cell::ROOT, constant, above);
    out.add_root(mean);
    out.finish()
}

fn scaled(image: &[[f32; 3]], factor: [f32; 3]) -> Vec<[f32; 3]> {
    image.iter().map(|rgb| std::array::from_fn(|c| factor[c] * rgb[c])).collect()
}

/// What arose at the children (X, R) of a node of the result.
struct Sum {
    means: Means,
    /// Further nodes; 0 where there is none: the root is nobody's child.
    children: [u32; CHILDREN],
    /// Index + 1 into the images; 0 where there are none.
    images: [u32; CHILDREN],
}

impl Sum {
    const EMPTY: Self =
        Self { means: [[0.0; CHILDREN]; 3], children: [0; CHILDREN], images: [0; CHILDREN] };
}

/// Functions of x alone or of r alone on a cell (X, R), means over finest cells.
#[derive(Clone, Default)]
struct Images {
    x: Option<Vec<[f32; 3]>>,
    r: Option<Vec<[f32; 3]>>,
}

impl Images {
    /// Adds `factor` × `image` to one of the two.
    fn add(target: &mut Option<Vec<[f32; 3]>>, image: &[[f32; 3]], factor: [f32; 3]) {
        let sum = target.get_or_insert_with(|| vec![[0.0; 3]; image.len()]);
        for (sum, rgb) in sum.iter_mut().zip(image) {
            *sum = std::array::from_fn(|c| sum[c] + factor[c] * rgb[c]);
        }
    }
}

/// A square part of an image.
#[derive(Clone, Copy)]
struct View<'a> {
    image: &'a [[f32; 3]],
    stride: usize,
    side: usize,
}

impl<'a> View<'a> {
    fn of(image: &'a [[f32; 3]]) -> Self {
        let side = image.len().isqrt();
        Self { image, stride: side, side }
    }

    /// A quarter, or all where the dimensions of the image do not split.
    fn part(self, splits: bool, quarter: usize) -> Self {
        if !splits {
            return self;
        }
        let side = self.side / 2;
        let low = (quarter >> 1) * side * self.stride + (quarter & 1) * side;
        Self { image: &self.image[low..], stride: self.stride, side }
    }

    fn first(view: Option<Self>, channel: usize) -> f64 {
        view.map_or(0.0, |view| f64::from(view.image[0][channel]))
    }

    /// The sum of what came from above and what arose here.
    fn sum(
        above: Option<Self>,
        here: &'a Option<Vec<[f32; 3]>>,
        space: &'a mut Vec<[f32; 3]>,
    ) -> Option<Self> {
        match (above, here) {
            (above, None) => above,
            (None, Some(here)) => Some(Self::of(here)),
            (Some(above), Some(here)) => {
                let rows = (0..above.side)
                    .flat_map(|row| &above.image[row * above.stride..][..above.side]);
                space.extend(rows.zip(here).map(|(a, b)| [a[0] + b[0], a[1] + b[1], a[2] + b[2]]));
                Some(Self::of(space))
            }
        }
    }
}

struct Product<'a> {
    light: Operand<'a>,
    brdf: Operand<'a>,
    levels: Levels,
    /// Level of S.
    incident: u8,
    nodes: Vec<Sum>,
    images: Vec<Images>,
    /// By level, what of each direction cell is inside the UDC; none for all of it.
    fractions: Vec<Vec<f64>>,
}

impl Product<'_> {
    /// Adds what node `l` of the light and node `f` of the BRDF make together to
    /// node `out` of the result. All are of `depth`, and share their S.
    fn descend(&mut self, out: usize, l: usize, f: usize, depth: u8) {
        let weight = measure(self.incident, depth + 1);
        let (l_mask, f_mask) =
            (self.light.tree.nodes()[l].child_mask, self.brdf.tree.nodes()[f].child_mask);
        let (light, brdf) =
            (without(&self.light.means[l], l_mask), without(&self.brdf.means[f], f_mask));
        // Neither has a node below: 4 × 4 matrices, for dimensions that do not
        // split padded with zeros.
        let sums = &mut self.nodes[out].means;
        for c in 0..3 {
            for r in 0..4 {
                let mut row = [0.0_f32; 4];
                for s in 0..4 {
                    let factor = weight * brdf[c][r << 2 | s];
                    for x in 0..4 {
                        row[x] += factor * light[c][s << 2 | x];
                    }
                }
                for x in 0..4 {
                    sums[c][r << 2 | x] += row[x];
                }
            }
        }
        if l_mask == 0 && f_mask == 0 {
            return;
        }
        let x_split = if depth < self.levels.position { 4 } else { 1 };
        let s_split = if depth < self.incident { 4 } else { 1 };
        let r_split = if depth < self.levels.direction { 4 } else { 1 };
        for s in 0..s_split {
            for r in 0..r_split {
                let f_child = self.brdf.tree.nodes()[f].child(r << 2 | s);
                for x in 0..x_split {
                    let l_child = self.light.tree.nodes()[l].child(s << 2 | x);
                    let at = r << 2 | x;
                    match (l_child, f_child) {
                        (None, None) => {}
                        (Some(l), Some(f)) => {
                            let next = self.node(out, at);
                            self.descend(next, l, f, depth + 1);
                        }
                        (Some(l), None) => {
                            let factor = brdf.map(|f| f[r << 2 | s]);
                            if factor != [0.0; 3] {
                                let images = self.image(out, at);
                                let image = &self.light.integrals[l];
                                Images::add(&mut self.images[images].x, image, factor);
                            }
                        }
                        (None, Some(f)) => {
                            let factor = light.map(|l| l[s << 2 | x]);
                            if factor != [0.0; 3] {
                                let images = self.image(out, at);
                                let image = &self.brdf.integrals[f];
                                Images::add(&mut self.images[images].r, image, factor);
                            }
                        }
                    }
                }
            }
        }
    }

    /// What of a cell's directions is inside the UDC.
    fn fraction(&self, cell: Cell) -> f64 {
        let level = cell.depth.min(self.levels.direction);
        let at = usize::from(cell.m[3]) << level | usize::from(cell.m[2]);
        self.fractions.get(usize::from(level)).map_or(1.0, |of_level| of_level[at])
    }

    fn node(&mut self, parent: usize, child: usize) -> usize {
        if self.nodes[parent].children[child] == 0 {
            self.nodes[parent].children[child] = self.nodes.len() as u32;
            self.nodes.push(Sum::EMPTY);
        }
        self.nodes[parent].children[child] as usize
    }

    fn image(&mut self, parent: usize, child: usize) -> usize {
        if self.nodes[parent].images[child] == 0 {
            self.images.push(Images::default());
            self.nodes[parent].images[child] = self.images.len() as u32;
        }
        self.nodes[parent].images[child] as usize - 1
    }

    /// Adds the coefficients below `cell` to `out` and returns its smoothing
    /// coefficient. `mean`, `x` and `r` are what arose above it.
    fn emit(
        &self,
        out: &mut TreeBuilder,
        node: Option<usize>,
        cell: Cell,
        mean: [f64; 3],
        [x, r]: [Option<View<'_>>; 2],
    ) -> [f64; 3] {
        let scale = self.levels.scale(cell.depth).recip();
        // Incident light may be finer than the result: its nodes go on without a split.
        let finest = cell.depth >= self.levels.depth();
        let fraction = self.fraction(cell);
        if fraction == 0.0 {
            return [0.0; 3];
        }
        let constant = x.is_none() && r.is_none();
        let rim = fraction < 1.0 && cell.depth < self.levels.direction && mean != [0.0; 3];
        if node.is_none() && (finest || (constant && !rim)) {
            let scale = scale * fraction;
            return std::array::from_fn(|c| {
                scale * (mean[c] + View::first(x, c) + View::first(r, c))
            });
        }
        let split = self.levels.split(cell.depth);
        let mut b = [[0.0; CHILDREN]; 3];
        for m in children(split) {
            let mut mean = mean;
            let mut x = x.map(|x| x.part(split & 0b0011 != 0, m & 3));
            let mut r = r.map(|r| r.part(split & 0b1100 != 0, m >> 2));
            let (mut space_x, mut space_r) = (Vec::new(), Vec::new());
            let mut next = None;
            if let Some(node) = node {
                let node = &self.nodes[node];
                for (c, mean) in mean.iter_mut().enumerate() {
                    *mean += f64::from(node.means[c][m]);
                }
                next = (node.children[m] != 0).then_some(node.children[m] as usize);
                if node.images[m] != 0 {
                    let own = &self.images[node.images[m] as usize - 1];
                    x = View::sum(x, &own.x, &mut space_x);
                    r = View::sum(r, &own.r, &mut space_r);
                }
            }
            let value = self.emit(out, next, cell.child(split, m), mean, [x, r]);
            for (b, value) in b.iter_mut().zip(value) {
                b[m] = value;
            }
        }
        if finest {
            return [b[0][0], b[1][0], b[2][0]];
        }
        for b in &mut b {
            pull(b, split);
        }
        out.add_node(cell, &std::array::from_fn(|nu| [b[0][nu], b[1][nu], b[2][nu]]));
        [b[0][0], b[1][0], b[2][0]]
    }
}

/// The means of the children that have no node of their own.
fn without(means: &Means, mask: u16) -> Means {
    let mut means = *means;
    if mask != 0 {
        for channel in &mut means {
            for (m, mean) in channel.iter_mut().enumerate() {
                if mask >> m & 1 == 1 {
                    *mean = 0.0;
                }
            }
        }
    }
    means
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Grid, Keep};
    use proptest::prelude::*;

    fn random(seed: u64) -> impl FnMut() -> f32 {
        let mut state = seed | 1;
        move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1 << 24) as f32
        }
    }

    /// A tree with a few per cent to all of its coefficients.
    fn tree(levels: Levels, seed: u64, kept: f64) -> Tree {
        let mut random = random(seed);
        let images = (0..levels.directions())
            .map(|_| Some((0..levels.positions()).map(|_| [random(), random(), 1.0]).collect()))
            .collect();
        let full = TreeBuilder::from_grid(&Grid::from_images(levels, images)).finish();
        let count = (kept * full.len() as f64) as usize;
        full.compressed(Keep::Count(count.max(1))).0
    }

    /// 4 Σ_s |S| f(s, r) L(x, s), with every cell of all three.
    fn dense(brdf: &Tree, incident: &Tree) -> Vec<[f64; 3]> {
        let (f, l) = (brdf.to_grid(), incident.to_grid());
        let side = |level: u8| 1_usize << level;
        let (s, r) = (side(brdf.levels().position), side(brdf.levels().direction));
        let x = side(incident.levels().position);
        let mut out = Vec::new();
        for i in 0..r * r * x * x {
            let (x, r) = ([i % x, i / x % x], [i / (x * x) % r, i / (x * x) / r]);
            let mut sum = [0.0; 3];
            for j in 0..s * s {
                let s = [j % s, j / s];
                let (f, l) = (f.mean([s[0], s[1], r[0], r[1]]), l.mean([x[0], x[1], s[0], s[1]]));
                for c in 0..3 {
                    sum[c] += 4.0 / (side(brdf.levels().position).pow(2) as f64)
                        * f64::from(f[c])
                        * f64::from(l[c]);
                }
            }
            out.push(sum);
        }
        out
    }

    fn assert_equal(found: &Tree, expected: &[[f64; 3]]) {
        let grid = found.to_grid();
        let Levels { position, direction } = found.levels();
        let (x, r) = (1_usize << position, 1_usize << direction);
        let norm = expected.iter().flatten().fold(0.0_f64, |most, v| most.max(v.abs()));
        for (i, expected) in expected.iter().enumerate() {
            let m = [i % x, i / x % x, i / (x * x) % r, i / (x * x) / r];
            for (a, b) in grid.mean(m).iter().zip(expected) {
                // Single precision, over a few hundred terms.
                assert!((f64::from(*a) - b).abs() < 3e-6 * norm, "{m:?}: {a} {b}, of {norm}");
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn the_product_is_the_dense_matrix_s(
            position in 0..3_u8, incident in 0..4_u8, outgoing in 0..4_u8,
            seed: u64, kept in (0.0..1.3f64, 0.0..1.3f64),
        ) {
            let light = tree(Levels { position, direction: incident }, seed, kept.0.min(1.0));
            let brdf = Levels { position: incident, direction: outgoing };
            let brdf = tree(brdf, seed ^ 0xabcd, kept.1.min(1.0));
            assert_equal(&product(&brdf, &light, false), &dense(&brdf, &light));
        }
    }

    /// ξ^β_lm of one dimension: value on each of 2³ cells.
    fn xi(beta: usize, l: u8, m: u16) -> [f64; 8] {
        std::array::from_fn(|i| {
            let inside = i >> (3 - l) == usize::from(m);
            let sign = if beta == 1 && i >> (2 - l) & 1 == 1 { -1.0 } else { 1.0 };
            if inside { sign * f64::from(1_u32 << u32::from(l)).sqrt() } else { 0.0 }
        })
    }

    /// A basis function: ν, level, **m**.
    type Index = (usize, u8, [u16; 4]);

    /// Δ^στ_jk = ⟨ξ_j(σ) | ξ_k(τ)⟩.
    fn delta(j: Index, sigma: usize, k: Index, tau: usize) -> f64 {
        let a = xi(j.0 >> sigma & 1, j.1, j.2[sigma]);
        let b = xi(k.0 >> tau & 1, k.1, k.2[tau]);
        a.iter().zip(b).map(|(a, b)| a * b / 8.0).sum()
    }

    fn coefficients(tree: &Tree) -> Vec<(Index, f64)> {
        let mut all = vec![((0, 0, [0; 4]), f64::from(tree.root()[0]))];
        for (node, cell) in tree.nodes().iter().zip(tree.cells()) {
            for nu in 1..16 {
                if let Some(at) = node.coefficient(nu) {
                    let b = f64::from(tree.coefficients()[at][0]);
                    all.push(((nu, cell.depth, cell.m), b));
                }
            }
        }
        all
    }

    /// b_n = 4 Σ_j Σ_k f_j b_k Δ02 Δ13 Δ00 Δ11 Δ22 Δ33, as Eq. 23 and 27 have it.
    #[test]
    fn coefficients_are_those_of_eq_27() {
        let (light, brdf) =
            (tree(Levels::isotropic(2), 3, 0.2), tree(Levels::isotropic(2), 8, 0.2));
        let found = product(&brdf, &light, false);
        let found: std::collections::BTreeMap<Index, f64> =
            coefficients(&found).into_iter().collect();
        let mut indices = vec![(0, 0, [0; 4])];
        for l in 0..2_u8 {
            let cells = 1_u16 << (4 * l);
            for (cell, nu) in (0..cells).flat_map(|cell| (1..16).map(move |nu| (cell, nu))) {
                let m = std::array::from_fn(|d| cell >> (l * d as u8) & ((1 << l) - 1));
                indices.push((nu, l, m));
            }
        }
        let mut pairs = Vec::new();
        for (j, f) in coefficients(&brdf) {
            for (k, b) in coefficients(&light) {
                let nest = delta(j, 0, k, 2) * delta(j, 1, k, 3);
                if nest != 0.0 {
                    pairs.push((j, k, 4.0 * f * b * nest));
                }
            }
        }
        for n in indices {
            let inner = |&(j, k, weight): &(Index, Index, f64)| {
                weight
                    * delta(k, 0, n, 0)
                    * delta(k, 1, n, 1)
                    * delta(j, 2, n, 2)
                    * delta(j, 3, n, 3)
            };
            let expected: f64 = pairs.iter().map(inner).sum();
            let found = found.get(&n).copied().unwrap_or(0.0);
            assert!((found - expected).abs() < 3e-6, "{n:?}: {found} {expected}");
        }
    }
}
