//! Every integration method on the same cells.

use glam::DVec3;
use wrt_core::Polygon;
use wrt_core::transport::{CellRule, Exact, Method, Support, TransportGeometry};

fn samples(name: &str) -> u32 {
    match name {
        "trapezoid4d" => 17,
        name if name.starts_with("trap") || name.starts_with("rom") || name == "visible2d" => 129,
        _ => 1 << 12,
    }
}

/// Charts in any combination, levels that differ: each method is within its own
/// estimate of the exact mean.
#[test]
fn all_methods_agree_on_mixed_charts_and_levels() {
    let tall = [[-0.2, 0.9, 0.1], [1.1, 1.0, 0.1], [1.0, 1.2, 1.3], [-0.1, 1.1, 1.2]];
    // Made planar: y follows from x and z.
    let tall = tall.map(|[x, _, z]| DVec3::new(x, 0.9 + 0.05 * x + 0.2 * z, z));
    let flat = [[0.0, 0.0], [1.0, 0.1], [0.9, 0.8], [0.1, 0.7]].map(|[x, y]| DVec3::new(x, y, 0.0));
    let makes = [Polygon::rectilinear_quad, Polygon::perspective, Polygon::bilinear];
    let cells = [
        (Support::isotropic(0, [0; 4]), Support::isotropic(1, [1, 1, 0, 1])),
        (Support::isotropic(1, [0, 0, 1, 0]), Support::isotropic(0, [0; 4])),
        (Support::isotropic(1, [1, 0, 0, 0]), Support::isotropic(1, [0, 1, 1, 1])),
    ];
    let mut seen = 0;
    for source in makes {
        for dest in makes {
            let source = source(tall).expect("convex");
            let dest = dest(flat).expect("convex");
            let geometry = TransportGeometry::new(source, dest);
            for (j, k) in cells {
                let exact = CellRule::Exact(Exact { tolerance: 1e-9 }).radiance(&geometry, j, k);
                seen += usize::from(exact.mean > 1e-3);
                for name in Method::NAMES.into_iter().filter(|name| *name != "exact") {
                    let name = format!("{name}:{}", samples(name));
                    let method: Method = name.parse().expect("a method");
                    let found = CellRule::Sampled(method).radiance(&geometry, j, k);
                    let error = (found.mean - exact.mean).abs();
                    assert!(
                        error <= found.error + exact.error,
                        "{name} {j:?} {k:?}: {found:?} {exact:?}"
                    );
                }
            }
        }
    }
    assert!(seen >= 18, "{seen} of 27 see anything");
}
