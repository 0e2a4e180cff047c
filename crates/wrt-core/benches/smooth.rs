//! Look-ups in a smooth basis: error against nanoseconds and bytes, for all orders.
//!
//! ```text
//! cargo bench -p wrt-core --bench smooth             # all rows
//! cargo bench -p wrt-core --bench smooth -- 4,4      # those with this in their name
//! ```
//!
//! A glossy tile under a stained-glass window, 2.5 m away: each row is a projection
//! to the error in the first column with leaves of at most those orders. Times are
//! medians of the processor time of seven runs over the same look-ups, in no order
//! and as neighbouring pixels see them; the last rows are Haar's of the same tile.

use cpu_time::ProcessTime;
use glam::{DVec2, DVec3};
use std::hint::black_box;
use wrt_core::beams::{AreaLight, Illuminant};
use wrt_core::legendre::{LegendreSampler, Orders, ProjectOptions, Reflected, project};
use wrt_core::transport::{BlockOptions, TransportGeometry, transport_block};
use wrt_core::{
    DirectionMap, Emission, Frame, Keep, Levels, Lobe, LobeMatrix, Nusselt, Phong, Polygon,
    Sampler, TreeBuilder, gather, reflect,
};

const LOOKUPS: usize = 4096;
const CHECKS: usize = 400;

fn main() {
    let window = Polygon::rectangle(DVec3::new(-0.8, 1.2, 0.0), 1.6 * DVec3::X, 1.6 * DVec3::Y);
    let window = window.expect("a rectangle");
    let lobe = Lobe::Cosine { exponent: 4.0, peak: DVec3::new(0.0, -1.0, 1.0).normalize() };
    let emission = Emission::new(7, panes(7), lobe);
    let tile = Polygon::rectangle(DVec3::new(0.0, 0.0, 3.0), DVec3::X, -DVec3::Z).expect("a tile");
    let scene = Scene {
        tile,
        phong: Phong { kd: [0.1; 3], ks: [0.6; 3], exponent: 40.0 },
        emitters: vec![(window, emission)],
    };
    println!(
        "{:<28} {:>8} {:>8} {:>9} {:>9} {:>8} {:>8} {:>8}",
        "basis", "asked", "error", "functions", "in memory", "random", "pixels", "bake"
    );
    println!(
        "{:<28} {:>8} {:>8} {:>9} {:>9} {:>8} {:>8} {:>8}",
        "", "%", "%", "", "kB", "ns", "ns", "s"
    );
    for error in [0.01, 0.005, 0.002] {
        for (position, direction) in
            [(2, 2), (2, 3), (3, 3), (3, 4), (4, 4), (5, 5), (6, 6), (7, 7)]
        {
            let orders = Orders { position, direction };
            scene.smooth(error, orders, DirectionMap::EqualArea);
        }
        scene.smooth(error, Orders { position: 4, direction: 4 }, DirectionMap::Concentric);
    }
    scene.smooth(0.05, Orders { position: 1, direction: 1 }, DirectionMap::EqualArea);
    for levels in [(4, 5), (4, 6)] {
        scene.haar(Levels { position: levels.0, direction: levels.1 });
    }
}

/// Whether rows of this name are asked for: all, if no part of a name is given.
fn wanted(name: &str) -> bool {
    let mut parts = std::env::args().skip(1).filter(|part| !part.starts_with("--")).peekable();
    parts.peek().is_none() || parts.any(|part| name.contains(&part))
}

struct Scene {
    tile: Polygon,
    phong: Phong,
    emitters: Vec<(Polygon, Emission)>,
}

impl Scene {
    fn smooth(&self, error: f64, orders: Orders, map: DirectionMap) {
        let name = format!("{map:?} {},{}", orders.position, orders.direction);
        if !wanted(&name) {
            return;
        }
        let start = ProcessTime::now();
        let lights: Vec<AreaLight> =
            self.emitters.iter().map(|(p, e)| AreaLight::new(p, e.clone())).collect();
        let lights: Vec<&dyn Illuminant> = lights.iter().map(|light| light as _).collect();
        let reflected = Reflected::new(&self.tile, &self.phong, &lights);
        let options =
            ProjectOptions { error, orders, map, cells: 100_000, ..ProjectOptions::default() };
        let made = project(&reflected, &options);
        let bake = start.elapsed().as_secs_f64();
        let sampler = LegendreSampler::new(&made.tree);
        self.row(&name, Some(error), made.tree.len(), sampler.bytes(), bake, |uv, mu| {
            sampler.radiance(uv, mu)
        });
    }

    fn haar(&self, levels: Levels) {
        let name = format!("Haar {},{}", levels.position, levels.direction);
        if !wanted(&name) {
            return;
        }
        let start = ProcessTime::now();
        let (source, emission) = &self.emitters[0];
        let geometry = TransportGeometry::new(source.clone(), self.tile.clone());
        let incident = transport_block(&geometry, emission, levels, BlockOptions::default())
            .expect("straight grid lines");
        let lobe = LobeMatrix::phong(self.phong.exponent, levels.direction, levels.direction);
        let outgoing = reflect(&incident, &self.phong, Some(&lobe));
        let tree = TreeBuilder::from_grid(&outgoing).finish();
        let tree = tree.compressed(Keep::RelativeError(2e-3)).0;
        let bake = start.elapsed().as_secs_f64();
        let sampler = Sampler::new(&tree);
        let of = |uv: DVec2, mu: DVec3| {
            let q = Nusselt::from_direction(mu).expect("above the horizon");
            [uv.x, uv.y, q.kappa, q.lambda]
        };
        self.row(&format!("{name} box"), None, tree.len(), sampler.bytes(), bake, |uv, mu| {
            sampler.box_value(of(uv, mu))
        });
        self.row(
            &format!("{name} multilinear"),
            None,
            tree.len(),
            sampler.bytes(),
            bake,
            |uv, mu| sampler.multilinear(of(uv, mu)),
        );
    }

    fn row(
        &self,
        name: &str,
        asked: Option<f64>,
        functions: usize,
        bytes: usize,
        bake: f64,
        look_up: impl Fn(DVec2, DVec3) -> [f32; 3],
    ) {
        let frame: &Frame = self.tile.frame();
        let (mut wrong, mut all) = (0.0, 0.0);
        for &(uv, mu) in &random(CHECKS) {
            let exact = gather(&self.emitters, frame, frame.point(uv), &self.phong, mu, 128);
            for (found, exact) in look_up(uv, mu).into_iter().zip(exact) {
                wrong += (f64::from(found) - exact).powi(2);
                all += exact * exact;
            }
        }
        let error = 100.0 * (wrong / all).sqrt();
        let [scattered, coherent] = [random(LOOKUPS), pixels()].map(|points| {
            let mut times: Vec<f64> = (0..7)
                .map(|_| {
                    let start = ProcessTime::now();
                    for _ in 0..20 {
                        for &(uv, mu) in &points {
                            black_box(look_up(uv, mu));
                        }
                    }
                    start.elapsed().as_secs_f64() * 1e9 / (20 * points.len()) as f64
                })
                .collect();
            times.sort_by(f64::total_cmp);
            times[3]
        });
        let asked = asked.map_or("-".to_owned(), |e| format!("{:.1}", 100.0 * e));
        println!(
            "{name:<28} {asked:>8} {error:>8.3} {functions:>9} {:>9.1} {scattered:>8.1} {coherent:>8.1} {bake:>8.2}",
            bytes as f64 / 1e3
        );
    }
}

/// Panes of some colours in leading.
fn panes(level: u8) -> Vec<[f32; 3]> {
    let side = 1_usize << level;
    let texel = |i: usize| {
        let (x, y) = (i % side * 128 / side, i / side * 128 / side);
        let lead = x % 18 < 2 || y % 14 < 2;
        let hue = (x / 18 * 5 + y / 14 * 3) % 7;
        if lead { [0.0; 3] } else { [1.0, 0.3 * hue as f32, 0.1 + (hue % 2) as f32] }
    };
    (0..side * side).map(texel).collect()
}

/// Points of no order, as many directions of a size as cosθ dω has.
fn random(count: usize) -> Vec<(DVec2, DVec3)> {
    let mut state = 1_u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut point = || {
        let (r2, phi) = (random(), std::f64::consts::TAU * random());
        let mu = DVec3::new(r2.sqrt() * phi.cos(), r2.sqrt() * phi.sin(), (1.0 - r2).sqrt());
        (DVec2::new(random(), random()), mu)
    };
    (0..count).map(|_| point()).collect()
}

/// 64 × 64 pixels of the tile seen from 1 m above its far edge.
fn pixels() -> Vec<(DVec2, DVec3)> {
    let pixel = |i: usize| {
        let uv = DVec2::new(((i % 64) as f64 + 0.3) / 64.0, ((i / 64) as f64 + 0.6) / 64.0);
        (uv, DVec3::new(0.5 - uv.x, -0.3 - uv.y, 1.0).normalize())
    };
    (0..LOOKUPS).map(pixel).collect()
}
