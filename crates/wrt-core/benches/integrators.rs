//! Time per transport coefficient of each integration method, at counts as near
//! to each other as the methods allow: `cargo bench --bench integrators`.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use glam::DVec3;
use std::hint::black_box;
use wrt_core::Polygon;
use wrt_core::transport::{Integrator, Method, Pair, Support, TransportGeometry};

/// About 256 samples each.
const METHODS: [&str; 16] = [
    "trapezoid2d:17",
    "trapezoid4d:5",
    "visible2d:17",
    "romberg-linear2d:17",
    "romberg-quadratic2d:17",
    "romberg-cubic2d:17",
    "montecarlo2d:256",
    "montecarlo4d:256",
    "stratified2d:256",
    "stratified4d:256",
    "halton2d:256",
    "halton4d:256",
    "hammersley2d:256",
    "hammersley4d:256",
    "sobol2d:256",
    "sobol4d:256",
];

fn coefficient(c: &mut Criterion) {
    let rectangle = |origin, u, v| Polygon::rectangle(origin, u, v).expect("a rectangle");
    let floor = rectangle(DVec3::ZERO, DVec3::Z, DVec3::X);
    let window = rectangle(DVec3::new(0.0, 0.5, -1.0), DVec3::X, DVec3::Y);
    let geometry = TransportGeometry::new(window, floor);
    // Seen whole, and cut by the direction grids of both ends.
    let whole = [Support::isotropic(0, [0; 4]); 2];
    let cut = [Support::isotropic(1, [0, 1, 0, 0]), Support::isotropic(1, [0, 0, 0, 1])];
    for (name, [j, k]) in [("whole", whole), ("cut", cut)] {
        let pair = Pair::new(&geometry, j, k);
        let mut group = c.benchmark_group(format!("coefficient/{name}"));
        for method in METHODS {
            let method: Method = method.parse().expect("a known method");
            let id = BenchmarkId::from_parameter(method);
            group.bench_function(id, |b| b.iter(|| method.integrate(black_box(&pair))));
        }
        group.finish();
    }
}

criterion_group!(benches, coefficient);
criterion_main!(benches);
