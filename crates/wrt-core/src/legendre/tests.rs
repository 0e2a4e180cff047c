//! The whole way: a radiance, its coefficients, look-ups.

use super::*;
use crate::DirectionMap;
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// A function of position and direction as a radiance.
struct Formula<F> {
    f: F,
    scale: f64,
}

impl<F: Fn(DVec2, DVec3) -> [f64; 3] + Sync> Radiance for Formula<F> {
    type Place = DVec2;

    fn place(&self, uv: DVec2) -> DVec2 {
        uv
    }

    fn radiance(&self, place: &DVec2, mu: DVec3) -> [f64; 3] {
        (self.f)(*place, mu)
    }

    fn scale(&self) -> f64 {
        self.scale
    }
}

/// A lobe that moves and changes colour with position, over a diffuse part.
fn glossy(uv: DVec2, mu: DVec3) -> [f64; 3] {
    let peak = DVec3::new(0.8 * uv.x - 0.2, 0.5 - uv.y, 0.7).normalize();
    let lobe = (20.0 * (mu.dot(peak) - 1.0)).exp();
    [1.0, 0.5, 0.2].map(|k| 0.1 + k * lobe * (1.0 + uv.x * k))
}

/// Well-spread positions and directions, as many of a size as cosθ dω has.
fn points(count: u32) -> impl Iterator<Item = (DVec2, DVec3)> {
    (1..=count).map(|i| {
        let q =
            [0.856_674_883_854_5, 0.733_891_856_627_1, 0.628_706_721_037_8, 0.538_597_257_223_6]
                .map(|step| (0.5 + f64::from(i) * step).fract());
        let (r, phi) = (q[2].sqrt(), TAU * q[3]);
        (DVec2::new(q[0], q[1]), DVec3::new(r * phi.cos(), r * phi.sin(), (1.0 - q[2]).sqrt()))
    })
}

/// Relative RMS error of look-ups against the function.
fn error(tree: &LegendreTree, f: impl Fn(DVec2, DVec3) -> [f64; 3]) -> f64 {
    let sampler = LegendreSampler::new(tree);
    let (mut wrong, mut all) = (0.0, 0.0);
    for (uv, mu) in points(40_000) {
        for (found, exact) in sampler.radiance(uv, mu).into_iter().zip(f(uv, mu)) {
            wrong += (f64::from(found) - exact).powi(2);
            all += exact * exact;
        }
    }
    (wrong / all).sqrt()
}

#[test]
fn the_error_is_what_was_asked_for_and_what_is_told() {
    let formula = Formula { f: glossy, scale: 0.2 };
    for map in [DirectionMap::EqualArea, DirectionMap::Concentric] {
        for asked in [3e-2, 1e-2] {
            let options = ProjectOptions { error: asked, map, ..ProjectOptions::default() };
            let made = project(&formula, &options);
            assert!(made.error <= asked && made.error > 0.6 * asked, "{map:?}: {}", made.error);
            let found = error(&made.tree, glossy);
            assert!(found <= asked, "{map:?}: {found} for {asked}");
            // Some thousands of samples of a heavy-tailed error each.
            assert!((found / made.error - 1.0).abs() < 0.1, "{map:?}: {found} {}", made.error);
        }
    }
}

/// Where cells end before the error is reached.
#[test]
fn asking_for_less_than_can_be_never_gives_more() {
    let formula = Formula { f: glossy, scale: 0.2 };
    let mut last = f64::INFINITY;
    for asked in [0.3, 1e-2, 1e-3, 1e-6] {
        let options = ProjectOptions {
            error: asked,
            orders: Orders { position: 1, direction: 1 },
            levels: [2, 6],
            ..ProjectOptions::default()
        };
        let made = project(&formula, &options);
        let found = error(&made.tree, glossy);
        assert!((found / made.error - 1.0).abs() < 0.1, "{asked}: {found} {}", made.error);
        // What is left out beyond the least is a tenth of its energy.
        assert!(found < 1.06 * last, "{asked}: {found} after {last}");
        last = found;
    }
    assert!((0.01..0.3).contains(&last), "{last} with cells that small");
}

/// The projection is the same function whoever evaluates it.
#[test]
fn the_sampler_is_the_sum_of_the_coefficients() {
    let formula = Formula { f: glossy, scale: 0.2 };
    for map in [DirectionMap::EqualArea, DirectionMap::Concentric] {
        for position in [1, 3, 7] {
            for direction in [1, 2, 5, 6, 7] {
                let options = ProjectOptions {
                    error: 0.03,
                    orders: Orders { position, direction },
                    map,
                    levels: [1, 3],
                    ..ProjectOptions::default()
                };
                let tree = project(&formula, &options).tree;
                let sampler = LegendreSampler::new(&tree);
                for (uv, mu) in points(40) {
                    let (found, sum) = (sampler.radiance(uv, mu), tree.eval(uv, mu));
                    for (a, b) in found.into_iter().zip(sum) {
                        // Single precision, in sums of a few hundred terms.
                        assert!((f64::from(a) - b).abs() < 1e-5, "{map:?} {a} {b}");
                    }
                }
            }
        }
    }
}

#[test]
fn diffuse_light_has_no_directional_coefficients() {
    let f = |uv: DVec2, _: DVec3| [1.0 + uv.x, uv.y * uv.y, 0.3];
    let made = project(&Formula { f, scale: f64::INFINITY }, &ProjectOptions::default());
    let census = made.tree.census();
    assert_eq!((census.positions, census.leaves, census.orders[1]), (1, 1, 1), "{census:?}");
    assert!(error(&made.tree, f) < 2e-3, "{}", error(&made.tree, f));
}

#[test]
fn a_lobe_without_position_has_one_position_of_order_one() {
    let f = |_: DVec2, mu: DVec3| [glossy(DVec2::ZERO, mu)[0]; 3];
    let made = project(&Formula { f, scale: 0.2 }, &ProjectOptions::default());
    let census = made.tree.census();
    assert_eq!((census.positions, census.orders[0]), (1, 1), "{census:?}");
    assert!(error(&made.tree, f) < 2e-3, "{}", error(&made.tree, f));
}

#[test]
fn darkness_is_one_leaf() {
    let made = project(&Formula { f: |_, _| [0.0; 3], scale: 0.1 }, &ProjectOptions::default());
    assert_eq!((made.tree.len(), made.norm_squared), (1, 0.0));
    assert_eq!(LegendreSampler::new(&made.tree).radiance(DVec2::splat(0.3), DVec3::Z), [0.0; 3]);
}

/// A shadow's edge: only the cells that it crosses are split.
#[test]
fn cells_are_split_along_an_edge_and_stay_whole_elsewhere() {
    let f = |uv: DVec2, _: DVec3| [if uv.x + 0.5 * uv.y < 0.7 { 1.0 } else { 0.25 }; 3];
    let options = ProjectOptions { error: 0.05, levels: [7, 0], ..ProjectOptions::default() };
    let made = project(&Formula { f, scale: f64::INFINITY }, &options);
    let census = made.tree.census();
    // An edge 1.1 long crosses about 2.2 · 2^l cells of level l; all have 4^l.
    let finest = 1_usize << census.levels[0];
    assert!(census.levels[0] >= 4, "{census:?}");
    assert!(census.positions < 8 * finest, "{census:?}");
    let found = error(&made.tree, f);
    // Most of the error at a jump is of degrees that were not sampled.
    assert!(found <= 0.05 && made.error <= 0.05, "{found}, told {}", made.error);
    assert!((found / made.error - 1.0).abs() < 0.1, "{found}, told {}", made.error);
}

/// Where a limit is met, the error that is told is the one there is.
#[test]
fn an_edge_that_cannot_be_resolved_is_told() {
    let f = |uv: DVec2, _: DVec3| [if uv.x + 0.5 * uv.y < 0.7 { 1.0 } else { 0.25 }; 3];
    for level in [2, 4] {
        let options = ProjectOptions { error: 0.01, levels: [level, 0], ..Default::default() };
        let made = project(&Formula { f, scale: f64::INFINITY }, &options);
        let found = error(&made.tree, f);
        assert!(made.error > 0.03, "level {level}: {}", made.error);
        assert!((found / made.error - 1.0).abs() < 0.1, "{found}, told {}", made.error);
    }
}

/// The same coefficients from one thread and from three.
#[test]
fn the_coefficients_do_not_depend_on_threads() {
    let formula = Formula { f: glossy, scale: 0.2 };
    let options = ProjectOptions { error: 0.02, ..ProjectOptions::default() };
    let [one, three] = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("threads").install(|| project(&formula, &options).tree)
    });
    assert_eq!(one, three);
}

#[test]
fn the_horizon_and_the_borders_can_be_looked_up() {
    let formula = Formula { f: glossy, scale: 0.2 };
    for map in [DirectionMap::EqualArea, DirectionMap::Concentric] {
        let options = ProjectOptions { error: 0.02, map, ..ProjectOptions::default() };
        let sampler = LegendreSampler::new(&project(&formula, &options).tree);
        for i in 0..720 {
            let mu = DVec2::from_angle(TAU * f64::from(i) / 720.0).extend(0.0);
            for uv in [DVec2::ZERO, DVec2::ONE, DVec2::new(-0.1, 2.0)] {
                let found = f64::from(sampler.radiance(uv, mu)[0]);
                let exact = glossy(uv.clamp(DVec2::ZERO, DVec2::ONE), mu)[0];
                assert!((found - exact).abs() < 0.25, "{map:?} {mu}: {found} {exact}");
            }
        }
    }
}

#[test]
fn shapes_that_no_tree_has_are_refused() {
    let from = |shape: &[u8], step: f64, quanta: usize| {
        let map = DirectionMap::EqualArea;
        LegendreTree::from_parts(map, shape.to_vec(), step, vec![1; quanta]).err()
    };
    let leaf = 0x08;
    assert_eq!(from(&[1, leaf], 1.0, 3), None);
    assert_eq!(from(&[1, 0, leaf, leaf, 2, leaf], 1.0, 9), None);
    let deep = [vec![0; 13], vec![1, leaf]].concat();
    let cases: [(&[u8], f64, usize, &str); 9] = [
        (&[], 1.0, 0, "stops early"),
        (&[1], 1.0, 0, "stops early"),
        (&[1, leaf, leaf], 1.0, 6, "goes on for 1 bytes"),
        (&[leaf], 1.0, 3, "byte 8"),
        (&[1, 1], 1.0, 0, "byte 1"),
        (&[1, 0x80], 1.0, 0, "byte 128"),
        (&deep, 1.0, 3, "deeper than 12"),
        (&[1, leaf], 0.0, 3, "its step is 0"),
        (&[1, leaf], 1e38, 3, "reach 1"),
    ];
    for (shape, step, quanta, expected) in cases {
        let found = from(shape, step, quanta).unwrap_or_default();
        assert!(found.contains(expected), "{shape:?}: {found:?}");
    }
    assert!(from(&[1, leaf], 1.0, 4).is_some_and(|e| e.contains("4 coefficients")), "too many");
}

/// A window of coloured panes over the floor, and what it shines with.
fn window() -> (crate::Polygon, crate::Emission) {
    let window =
        crate::Polygon::rectangle(DVec3::new(-0.8, 1.2, 0.0), 1.6 * DVec3::X, 1.6 * DVec3::Y);
    let pane = |i: usize| [1.0 + (i % 8 % 3) as f32, (i / 8 % 2) as f32, 0.5];
    let peak = DVec3::new(0.0, -1.0, 1.0).normalize();
    let lobe = crate::Lobe::Cosine { exponent: 4.0, peak };
    (window.expect("a rectangle"), crate::Emission::new(3, (0..64).map(pane).collect(), lobe))
}

/// Reflected light straight from the emitter, against a sum over its texels.
#[test]
fn a_tile_under_a_window_is_that_of_direct_quadrature() {
    use crate::beams::AreaLight;
    use crate::{Phong, Polygon, gather};
    let (window, emission) = window();
    let light = AreaLight::new(&window, emission.clone());
    let tile = Polygon::rectangle(DVec3::new(0.2, 0.0, 2.5), DVec3::X, -DVec3::Z).expect("a tile");
    let emitters = [(window, emission)];
    let materials = [(0.8, 0.1, 8.0), (0.1, 0.6, 40.0), (0.1, 0.6, 1000.0), (0.5, 0.0, 0.0)];
    for (kd, ks, exponent) in materials {
        let phong = Phong { kd: [kd; 3], ks: [ks; 3], exponent };
        let lights: [&dyn crate::beams::Illuminant; 1] = [&light];
        let reflected = Reflected::new(&tile, &phong, &lights);
        let options = ProjectOptions { error: 0.01, ..ProjectOptions::default() };
        let made = project(&reflected, &options);
        let sampler = LegendreSampler::new(&made.tree);
        let (mut wrong, mut all) = (0.0, 0.0);
        for (uv, mu) in points(300) {
            let exact = gather(&emitters, tile.frame(), tile.frame().point(uv), &phong, mu, 64);
            for (found, exact) in sampler.radiance(uv, mu).into_iter().zip(exact) {
                wrong += (f64::from(found) - exact).powi(2);
                all += exact * exact;
            }
        }
        let found = (wrong / all).sqrt();
        assert!(found < 0.01, "n = {exponent}: {found}, told {}", made.error);
        assert!(found > 0.0025, "n = {exponent}: {found}: more was paid for than asked");
    }
}

/// Relative RMS of the jump between pairs of look-ups that are next to each other.
fn jump(pairs: impl Iterator<Item = [[f32; 3]; 2]>) -> f64 {
    let (mut steps, mut all) = (0.0, 0.0);
    for (a, b) in pairs.flat_map(|[a, b]| a.into_iter().zip(b)) {
        let [a, b] = [a, b].map(f64::from);
        steps += (a - b).powi(2);
        all += 0.5 * (a * a + b * b);
    }
    (steps / all).sqrt()
}

/// A glossy radiance that is looked at from within a cone of directions that turns with
/// u, on the half v < ½ alone.
struct Looked {
    angle: f64,
}

impl Looked {
    fn axis(uv: DVec2) -> DVec3 {
        DVec3::new(0.6 - 0.4 * uv.x, 0.2, 0.7).normalize()
    }

    fn is_seen(&self, uv: DVec2, mu: DVec3) -> bool {
        uv.y < 0.5 && Self::axis(uv).dot(mu) > self.angle.cos()
    }
}

impl Radiance for Looked {
    type Place = DVec2;

    fn place(&self, uv: DVec2) -> DVec2 {
        uv
    }

    fn radiance(&self, place: &DVec2, mu: DVec3) -> [f64; 3] {
        glossy(*place, mu)
    }

    fn scale(&self) -> f64 {
        0.2
    }

    fn views(&self, map: DirectionMap, uv: DVec2, reach: f64) -> Option<ViewSet> {
        let mut views = ViewSet::none();
        if uv.y < 0.5 + reach && self.angle > 0.0 {
            // The axis turns by less than 1 a unit of u.
            views.add_cone(map, Self::axis(uv), self.angle + reach);
        }
        Some(views)
    }
}

/// Relative RMS error where a point is, and where it is not, among those looked at.
fn errors(tree: &LegendreTree, looked: &Looked) -> [f64; 2] {
    let sampler = LegendreSampler::new(tree);
    let mut sums = [[0.0; 2]; 2];
    for (uv, mu) in points(100_000) {
        let [wrong, all] = &mut sums[usize::from(!looked.is_seen(uv, mu))];
        for (found, exact) in sampler.radiance(uv, mu).into_iter().zip(glossy(uv, mu)) {
            *wrong += (f64::from(found) - exact).powi(2);
            *all += exact * exact;
        }
    }
    sums.map(|[wrong, all]| (wrong / all).sqrt())
}

/// Where somebody looks, the error is what was asked for and what is told; elsewhere the
/// same radiance, coarser; and functions are fewer than for all.
#[test]
fn what_nobody_looks_at_is_coarse() {
    let looked = Looked { angle: 0.15 };
    for map in [DirectionMap::EqualArea, DirectionMap::Concentric] {
        for asked in [1e-2, 3e-3] {
            let options = ProjectOptions { error: asked, map, ..ProjectOptions::default() };
            let made = project(&looked, &options);
            let whole = project(&Formula { f: glossy, scale: 0.2 }, &options);
            let [seen, rest] = errors(&made.tree, &looked);
            eprintln!(
                "{map:?} {asked}: {seen:.2e} {rest:.2e} {} {}",
                made.tree.len(),
                whole.tree.len()
            );
            assert!(made.is_seen && made.error <= asked, "{map:?}: {}", made.error);
            assert!(seen <= 1.1 * asked, "{map:?}: {seen} for {asked}");
            assert!((asked..3.0 * UNSEEN_ERROR).contains(&rest), "{map:?}: {rest} unseen");
            assert!(2 * made.tree.len() < whole.tree.len(), "{map:?}: {}", made.tree.len());
        }
    }
}

#[test]
fn what_nobody_looks_at_at_all_is_coarse_and_not_dark() {
    let looked = Looked { angle: 0.0 };
    for asked in [1e-3, 0.2] {
        let options = ProjectOptions { error: asked, ..ProjectOptions::default() };
        let made = project(&looked, &options);
        let [_, rest] = errors(&made.tree, &looked);
        let wanted = UNSEEN_ERROR.max(2.0 * asked);
        assert!(!made.is_seen && made.error <= wanted, "{}", made.error);
        assert!((0.25 * wanted..wanted).contains(&rest), "{rest} for {wanted}");
    }
}

/// Where two tiles of a material meet, or two cells of a tile, the radiance steps by the
/// difference of two errors, each at the ends of polynomials, where they are greatest:
/// within twice what was asked for.
#[test]
fn seams_are_of_the_size_of_the_error() {
    use crate::beams::{AreaLight, Illuminant};
    use crate::{Phong, Polygon};
    let (window, emission) = window();
    let light = AreaLight::new(&window, emission);
    let lights: [&dyn Illuminant; 1] = [&light];
    for (ks, exponent) in [(0.1, 8.0), (0.6, 40.0)] {
        let phong = Phong { kd: [0.7 - ks; 3], ks: [ks; 3], exponent };
        for asked in [0.02, 0.005] {
            let [left, right] = [-0.8, 0.2].map(|x| {
                let corner = DVec3::new(x, 0.0, 2.5);
                let tile = Polygon::rectangle(corner, DVec3::X, -DVec3::Z).expect("a tile");
                let reflected = Reflected::new(&tile, &phong, &lights);
                let options = ProjectOptions { error: asked, ..Default::default() };
                let made = project(&reflected, &options);
                (LegendreSampler::new(&made.tree), made.tree.census())
            });
            let look =
                |at: &LegendreSampler, u: f64, v: f64, mu: DVec3| at.radiance(DVec2::new(u, v), mu);
            let tiles = jump(
                points(1000)
                    .map(|(uv, mu)| [look(&left.0, 1.0, uv.y, mu), look(&right.0, 0.0, uv.y, mu)]),
            );
            const H: f64 = 1e-8;
            // In the middle, where there is a border if there is any.
            let cells = jump(points(1000).map(|(uv, mu)| {
                [look(&left.0, 0.5 - H, uv.y, mu), look(&left.0, 0.5 + H, uv.y, mu)]
            }));
            let map = DirectionMap::EqualArea;
            let directions = points(1000).filter_map(|(uv, mu)| {
                let st = map.to_square(mu);
                let [a, b] = [0.5 - H, 0.5 + H].map(|s| map.to_direction(DVec2::new(s, st.y)));
                (a.z > 0.0 && b.z > 0.0)
                    .then(|| [look(&left.0, uv.x, uv.y, a), look(&left.0, uv.x, uv.y, b)])
            });
            let directions = jump(directions);
            eprintln!(
                "n = {exponent}, {asked}: {tiles:.2e} {cells:.2e} {directions:.2e} {:?}",
                left.1
            );
            let steps = [("tiles", tiles), ("positions", cells), ("directions", directions)];
            for (what, step) in steps {
                assert!(step <= 2.0 * asked, "n = {exponent}, {what}: {step} for {asked}");
            }
        }
    }
}
