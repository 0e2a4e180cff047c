//! Irradiance and power flux straight from coefficients, with no inverse
//! transform (§6.1, §6.2, Eq. 12–14).

use crate::{Cell, Levels, Polygon, Tree, TreeBuilder, children};

/// Irradiance (or, of outgoing radiance, exitance) over (u, v) as 2-D Haar
/// coefficients, W m⁻².
///
/// Kept as a [`Tree`] whose direction level is 0: its ν runs over u and v alone.
#[derive(Clone, Debug, PartialEq)]
pub struct Irradiance {
    tree: Tree,
}

impl Irradiance {
    /// E = 4 Σ_j b_j ⟨B_j | 1⟩_κλ (Eq. 12).
    ///
    /// ∫ψ = 0 removes every ν with a wavelet in κ or λ; each of the rest adds
    /// 4 · 2^(−l_d) b_j to the coefficient of its (ν, l, m_u, m_v), with l_d the
    /// level of its direction cell.
    #[must_use]
    pub fn of(radiance: &Tree) -> Self {
        let Levels { position, direction } = radiance.levels();
        let mut sum = TreeBuilder::new(Levels { position, direction: 0 });
        sum.add_root(radiance.root().map(|b| 4.0 * f64::from(b)));
        for (node, cell) in radiance.nodes().iter().zip(radiance.cells()) {
            if cell.depth >= position {
                continue;
            }
            let weight = 4.0 / f64::from(1_u32 << u32::from(cell.depth.min(direction)));
            let mut b = [[0.0; 3]; crate::CHILDREN];
            let mut any = false;
            for (nu, b) in b.iter_mut().enumerate().take(4).skip(1) {
                if let Some(at) = node.coefficient(nu) {
                    *b = radiance.coefficients()[at].map(|x| weight * f64::from(x));
                    any = true;
                }
            }
            if any {
                let [u, v, ..] = cell.m;
                sum.add_node(Cell { depth: cell.depth, m: [u, v, 0, 0] }, &b);
            }
        }
        Self { tree: sum.finish() }
    }

    /// Its coefficients: a tree of direction level 0.
    #[must_use]
    pub fn tree(&self) -> &Tree {
        &self.tree
    }

    /// E at (u, v), each in [0, 1), on the chart's whole unit square.
    #[must_use]
    pub fn eval(&self, u: f64, v: f64) -> [f64; 3] {
        self.tree.eval([u, v, 0.0, 0.0])
    }

    /// The power Φ = ∬ E |∂(x, y)/∂(u, v)| du dv through the polygon's outline, W
    /// (Eq. 13, 14).
    ///
    /// ⟨B_j | J⟩ is a signed sum of the plane areas of a node's quarters, in
    /// closed form for all charts: lines of constant u or v are straight in each.
    /// For a rectangle it is the paper's Φ = 4 W H b₀ (§7.1.1.1).
    #[must_use]
    pub fn flux(&self, polygon: &Polygon) -> [f64; 3] {
        let area = |level: u8, m: [u16; 2]| -> f64 {
            polygon.cell(level, m).iter().map(crate::ConvexPolygon::area).sum()
        };
        let mut flux = self.tree.root().map(|b| f64::from(b) * area(0, [0; 2]));
        if polygon.fills_chart() && polygon.size().is_some() {
            return flux;
        }
        const SPLIT: usize = 0b0011;
        for (node, cell) in self.tree.nodes().iter().zip(self.tree.cells()) {
            let scale = f64::from(1_u32 << u32::from(cell.depth));
            let mut areas = [0.0; crate::CHILDREN];
            for m_prime in children(SPLIT) {
                let Cell { depth, m: [u, v, ..] } = cell.child(SPLIT, m_prime);
                areas[m_prime] = area(depth, [u, v]);
            }
            for nu in children(SPLIT).skip(1) {
                let Some(at) = node.coefficient(nu) else { continue };
                let sign =
                    |m: usize| if (nu & m).count_ones().is_multiple_of(2) { 1.0 } else { -1.0 };
                let inner: f64 = children(SPLIT).map(|m| sign(m) * areas[m]).sum();
                for (flux, b) in flux.iter_mut().zip(self.tree.coefficients()[at]) {
                    *flux += scale * inner * f64::from(b);
                }
            }
        }
        flux
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Chart, Grid, Keep, grid::udc_fractions};
    use glam::{DVec2, DVec3};
    use proptest::prelude::*;
    use std::f64::consts::PI;

    /// Pseudo-random radiance, some directions dark.
    fn grid(levels: Levels, seed: u64) -> Grid {
        let mut state = seed | 1;
        let mut random = move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1 << 24) as f32
        };
        let images = (0..levels.directions())
            .map(|_| {
                let mut texel = || [random(), random(), 0.25];
                let image: Vec<_> = (0..levels.positions()).map(|_| texel()).collect();
                (image[0][0] < 0.8).then_some(image)
            })
            .collect();
        Grid::from_images(levels, images)
    }

    fn polygons() -> Vec<Polygon> {
        let at = |x: f64, y: f64| DVec3::new(3.0 + x, -y, 2.0 + y);
        let quad = [at(0., 0.), at(2., 0.1), at(2.3, 1.5), at(-0.2, 1.0)];
        let ell = [at(0., 0.), at(2., 0.), at(2., 0.7), at(0.9, 0.7), at(0.9, 1.6), at(0., 1.6)];
        vec![
            Polygon::rectangle(at(0., 0.), DVec3::X * 2.0, DVec3::new(0., -1., 1.))
                .expect("a rectangle"),
            Polygon::rectilinear(&ell).expect("an L"),
            Polygon::perspective(quad).expect("convex"),
            Polygon::bilinear(quad).expect("convex"),
            Polygon::bilinear([quad[0], quad[1], quad[2], quad[2]]).expect("a triangle"),
        ]
    }

    proptest! {
        #[test]
        fn irradiance_is_the_sum_over_direction_cells(
            position in 0..4_u8, direction in 0..4_u8, seed: u64,
        ) {
            let grid = grid(Levels { position, direction }, seed);
            let e = Irradiance::of(&TreeBuilder::from_grid(&grid).finish());
            let side = 1 << position;
            for (i, expected) in grid.irradiance().into_iter().enumerate() {
                let at = |i: usize| (i as f64 + 0.5) / side as f64;
                let found = e.eval(at(i % side), at(i / side));
                for (a, b) in found.iter().zip(expected) {
                    // Single precision of coefficients up to 4 · 0.8.
                    prop_assert!((a - b).abs() < 2e-6, "{a} {b}");
                }
            }
        }

        /// Φ = ∬ E dA summed cell by cell, on every chart.
        #[test]
        fn flux_is_irradiance_over_the_polygon_s_area(seed: u64) {
            let grid = grid(Levels { position: 3, direction: 2 }, seed);
            let e = Irradiance::of(&TreeBuilder::from_grid(&grid).finish());
            for polygon in polygons() {
                let mut expected = [0.0; 3];
                for (i, e) in grid.irradiance().into_iter().enumerate() {
                    let pieces = polygon.cell(3, [i as u16 % 8, i as u16 / 8]);
                    let area: f64 = pieces.iter().map(crate::ConvexPolygon::area).sum();
                    for c in 0..3 {
                        expected[c] += e[c] * area;
                    }
                }
                for (a, b) in e.flux(&polygon).iter().zip(expected) {
                    prop_assert!((a - b).abs() < 1e-5 * b, "{polygon:?}: {a} {b}");
                }
            }
        }
    }

    /// Uniform radiance 1 from everywhere: E = π at every point, so Φ = π A.
    #[test]
    fn uniform_radiance_carries_pi_times_the_area() {
        let lobe: Vec<f32> = udc_fractions(4).iter().map(|&f| f as f32).collect();
        let levels = Levels { position: 2, direction: 4 };
        let grid = Grid::separable(levels, vec![[1.0; 3]; 16], &lobe);
        let e = Irradiance::of(&TreeBuilder::from_grid(&grid).finish());
        assert!(e.tree().is_empty(), "the same everywhere: one coefficient");
        for polygon in polygons() {
            let (flux, expected) = (e.flux(&polygon)[0], PI * polygon.area());
            assert!((flux / expected - 1.0).abs() < 1e-6, "{polygon:?}: {flux} {expected}");
        }
    }

    /// The Jacobian in Eq. 14 is the chart's own, by a midpoint rule in (u, v): exact
    /// for a bilinear chart, whose Jacobian is linear, O(h²) for a perspective one.
    #[test]
    fn flux_weighs_cells_by_the_chart_s_jacobian() {
        let grid = grid(Levels { position: 4, direction: 1 }, 7);
        let e = Irradiance::of(&TreeBuilder::from_grid(&grid).finish());
        for polygon in polygons().into_iter().filter(Polygon::fills_chart) {
            const N: usize = 256;
            let at = |i: usize| (i as f64 + 0.5) / N as f64;
            let sum: f64 = (0..N * N)
                .map(|i| {
                    let (u, v) = (at(i % N), at(i / N));
                    e.eval(u, v)[0] * polygon.chart().jacobian(DVec2::new(u, v))
                })
                .sum();
            let (flux, expected) = (e.flux(&polygon)[0], sum / (N * N) as f64);
            let exact = !matches!(polygon.chart(), Chart::Perspective { .. });
            let tolerance = if exact { 1e-10 } else { 1e-5 };
            assert!((flux / expected - 1.0).abs() < tolerance, "{polygon:?}: {flux} {expected}");
        }
    }

    /// Thresholding never touches the root, so a rectangle keeps its flux.
    #[test]
    fn compression_keeps_a_rectangle_s_flux_exactly() {
        let tree = TreeBuilder::from_grid(&grid(Levels::isotropic(3), 5)).finish();
        let small = tree.compressed(Keep::Count(40)).0;
        let rectangle = &polygons()[0];
        let flux = |tree| Irradiance::of(tree).flux(rectangle);
        assert_eq!(flux(&small), flux(&tree));
    }
}
