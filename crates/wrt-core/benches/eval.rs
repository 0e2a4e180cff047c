//! Time per look-up of a radiance: sampler, hashed nodes and dense array.
//!
//! ```text
//! cargo bench -p wrt-core --bench eval
//! ```
//!
//! Nanoseconds, and in brackets what they are of the dense array's own box, by order of
//! the points and the share of coefficients removed: the least of many rounds, in each
//! of which every look-up has its turn, so that whatever else the machine does hits all
//! of them. The paper hashes nodes (§7.2.2.3) and sums along a path; `hash` is that.

use std::collections::HashMap;
use std::hint::black_box;
use std::time::Instant;
use wrt_core::grid::{Grid, udc_fractions};
use wrt_core::{CHILDREN, Cell, Keep, Levels, Sampler, Tree, TreeBuilder, children};

/// The paper's 32⁴ (§7.3).
const LEVEL: u8 = 5;

const LOOKUPS: usize = 4096;

const ROUNDS: usize = 60;

/// A stained-glass window's light on a floor: panes that shift with direction,
/// under a cos⁴ lobe about a slanted axis.
fn window() -> Tree {
    let levels = Levels::isotropic(LEVEL);
    let side = 1_usize << LEVEL;
    let centre = |i: usize| (i as f64 + 0.5) / side as f64;
    let image = |(d, fraction): (usize, f64)| {
        let (k, l) = (centre(d % side), centre(d / side));
        let z = (1.0 - (2.0 * k - 1.0).powi(2) - (2.0 * l - 1.0).powi(2)).max(0.01).sqrt();
        let lobe = (0.7 * z + 0.7 * (2.0 * l - 1.0)).max(0.0).powi(4) * fraction;
        let texel = |p: usize| {
            let x = centre(p % side) + (2.0 * k - 1.0) / z;
            let y = centre(p / side) + (2.0 * l - 1.0) / z - 1.0;
            let lit = (-0.5..1.5).contains(&x) && (-0.5..1.5).contains(&y);
            let pane = (5.0 * x).floor() + 3.0 * (5.0 * y).floor();
            let radiance = if lit { lobe } else { 0.0 };
            [1.0, 2.0, 3.0].map(|c| (radiance * (0.5 + 0.5 * (pane * c).sin())) as f32)
        };
        (lobe > 0.0).then(|| (0..side * side).map(texel).collect())
    };
    let images = udc_fractions(LEVEL).into_iter().enumerate().map(image).collect();
    TreeBuilder::from_grid(&Grid::from_images(levels, images)).finish()
}

/// Points of no order, and points as neighbouring pixels see them.
fn points() -> [(&'static str, Vec<[f64; 4]>); 2] {
    let mut state = 1_u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut anywhere = || {
        let (r, phi) = (0.5 * random().sqrt(), std::f64::consts::TAU * random());
        [random(), random(), 0.5 + r * phi.cos(), 0.5 + r * phi.sin()]
    };
    let scattered = (0..LOOKUPS).map(|_| anywhere()).collect();
    // 64 × 64 pixels of a floor seen from 1 m above its far edge.
    let pixel = |i: usize| {
        let (u, v) = (((i % 64) as f64 + 0.3) / 64.0, ((i / 64) as f64 + 0.6) / 64.0);
        let eye = [0.5 - u, 1.3 - v, 1.0_f64];
        let length = eye.iter().map(|x| x * x).sum::<f64>().sqrt();
        [u, v, 0.5 + 0.5 * eye[0] / length, 0.5 + 0.5 * eye[1] / length]
    };
    [("random", scattered), ("coherent", (0..LOOKUPS).map(pixel).collect())]
}

/// Nodes found by hashing their index, coefficients summed along the path.
struct Hashed {
    levels: Levels,
    root: [f64; 3],
    nodes: HashMap<Cell, Vec<(usize, [f32; 3])>>,
}

impl Hashed {
    fn new(tree: &Tree) -> Self {
        let levels = tree.levels();
        let mut cells = vec![Cell::ROOT; tree.nodes().len()];
        let mut nodes = HashMap::new();
        for (i, node) in tree.nodes().iter().enumerate() {
            for m in children(levels.split(cells[i].depth)) {
                if let Some(child) = node.child(m) {
                    cells[child] = cells[i].child(levels.split(cells[i].depth), m);
                }
            }
            let stored = (1..CHILDREN).filter_map(|nu| Some((nu, node.coefficient(nu)?)));
            nodes.insert(cells[i], stored.map(|(nu, at)| (nu, tree.coefficients()[at])).collect());
        }
        Self { levels, root: tree.root().map(f64::from), nodes }
    }

    fn eval(&self, q: [f64; 4]) -> [f64; 3] {
        let mut value = self.root;
        let mut cell = Cell::ROOT;
        while cell.depth < self.levels.depth() {
            let Some(stored) = self.nodes.get(&cell) else { break };
            let cells = f64::from(2_u32 << cell.depth);
            let m_prime = (0..4).fold(0, |m, d| m | ((q[d] * cells) as usize & 1) << d);
            let scale = self.levels.scale(cell.depth);
            for (nu, b) in stored {
                let sign = if (nu & m_prime).count_ones() & 1 == 0 { scale } else { -scale };
                for (value, b) in value.iter_mut().zip(b) {
                    *value += sign * f64::from(*b);
                }
            }
            cell = cell.child(self.levels.split(cell.depth), m_prime);
        }
        value
    }
}

/// All finest cells, uncompressed; the UDC's rim is not looked after.
struct Array(Vec<[f32; 3]>);

impl Array {
    fn new(tree: &Tree) -> Self {
        let grid = tree.to_grid();
        let at = |i: usize, d: u32| i >> (d * u32::from(LEVEL)) & 31;
        let mean = |i| grid.mean([at(i, 0), at(i, 1), at(i, 2), at(i, 3)]);
        Self((0..CHILDREN.pow(LEVEL.into())).map(mean).collect())
    }

    fn box_value(&self, q: [f64; 4]) -> [f32; 3] {
        let m = q.map(|x| (x * 32.0).min(31.0) as usize);
        self.0[m[3] << 15 | m[2] << 10 | m[1] << 5 | m[0]]
    }

    fn multilinear(&self, q: [f64; 4]) -> [f32; 3] {
        let axes = q.map(|x| {
            let at = (x * 32.0 - 0.5).clamp(0.0, 31.0);
            let low = (at as usize).min(30);
            (low, (at - low as f64) as f32)
        });
        let mut sum = [0.0; 3];
        for corner in 0..16_usize {
            let (mut at, mut weight) = (0, 1.0);
            for (d, (low, share)) in axes.into_iter().enumerate() {
                let high = corner >> d & 1;
                at |= (low + high) << (5 * d);
                weight *= if high == 1 { share } else { 1.0 - share };
            }
            for (sum, x) in sum.iter_mut().zip(self.0[at]) {
                *sum += weight * x;
            }
        }
        sum
    }
}

/// Seconds of one round of look-ups.
fn timed<T>(points: &[[f64; 4]], look_up: impl Fn([f64; 4]) -> T) -> f64 {
    let start = Instant::now();
    for q in points {
        black_box(look_up(*black_box(q)));
    }
    start.elapsed().as_secs_f64()
}

fn main() {
    let tree = window();
    let full = CHILDREN.pow(LEVEL.into());
    let array = Array::new(&tree);
    let names = ["array box", "array linear", "box", "multilinear", "hash"];
    print!("{:<9} {:>7} {:>9}", "points", "removed", "in memory");
    names.iter().for_each(|name| print!(" {name:>13}"));
    println!();
    for (order, points) in points() {
        for removed in [0.0, 90.0, 95.0, 99.0, 99.5] {
            let tree = match removed {
                0.0 => tree.clone(),
                percent => {
                    let kept = (full as f64 * (1.0 - percent / 100.0)) as usize;
                    tree.compressed(Keep::Count(kept)).0
                }
            };
            let (sampler, hashed) = (Sampler::new(&tree), Hashed::new(&tree));
            let mut least = [f64::INFINITY; 5];
            for _ in 0..ROUNDS {
                let round = [
                    timed(&points, |q| array.box_value(q)),
                    timed(&points, |q| array.multilinear(q)),
                    timed(&points, |q| sampler.box_value(q)),
                    timed(&points, |q| sampler.multilinear(q)),
                    timed(&points, |q| hashed.eval(q)),
                ];
                least = std::array::from_fn(|i| least[i].min(round[i]));
            }
            let percent = 100.0 - 100.0 * tree.len() as f64 / full as f64;
            print!("{order:<9} {percent:>5.1} % {:>6} kB", sampler.bytes() / 1000);
            for time in least {
                print!(" {:>6.1} ({:>4.1})", 1e9 * time / LOOKUPS as f64, time / least[0]);
            }
            println!();
        }
    }
}
