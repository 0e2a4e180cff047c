//! What the paper reports of its transport, small: the window over the floor
//! (§7.3, Fig. 13) and the trapezoidal rule (§7.1.4.3, Fig. 4).

use wrt_core::metrics::relative_euclidean_distance;
use wrt_core::transport::{
    BlockOptions, Exact, Integrator as _, Method, Pair, Support, TransportGeometry, transport_block,
};
use wrt_core::{Emission, Levels, Lobe, Polygon};

/// An upright square of side 1 that looks along +y over a square floor.
fn window_over_floor() -> TransportGeometry {
    let rectangle = |origin: [f64; 3], u: [f64; 3], v: [f64; 3]| {
        Polygon::rectangle(origin.into(), u.into(), v.into()).expect("a rectangle")
    };
    let window = rectangle([0.5, -0.2, 0.4], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
    let floor = rectangle([-0.5, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
    TransportGeometry::new(window, floor)
}

/// Every cell of `level` in four dimensions.
fn cells(level: u8) -> impl Iterator<Item = [u16; 4]> {
    let side = 1_usize << level;
    (0..side.pow(4)).map(move |i| [0, 1, 2, 3].map(|d| (i / side.pow(d) % side) as u16))
}

#[test]
fn the_trapezoidal_rule_converges_to_the_exact_coefficients() {
    let geometry = window_over_floor();
    let source = Support::isotropic(1, [0, 1, 1, 0]);
    let pairs: Vec<Pair<'_>> =
        cells(1).map(|m| Pair::new(&geometry, source, Support::isotropic(1, m))).collect();
    let exact = Exact { tolerance: 1e-9 };
    let reference: Vec<f64> = pairs.iter().map(|pair| exact.integrate(pair).value).collect();
    assert!(reference.iter().filter(|&&t| t > 0.0).count() >= 4, "{reference:?}");
    let errors = [5, 17, 65, 257].map(|n| {
        let method: Method = format!("trapezoid2d:{n}").parse().expect("a known rule");
        let values: Vec<f64> = pairs.iter().map(|pair| method.integrate(pair).value).collect();
        relative_euclidean_distance(&values, &reference)
    });
    eprintln!("RED of trapezoid2d at 5, 17, 65, 257 a side: {errors:.5?}");
    // G jumps along the cell's own arcs, so that no more than first order in the
    // spacing, a quarter at each step, is promised; half of that is asked for.
    assert!(errors.windows(2).all(|e| e[1] < 0.5 * e[0]), "{errors:?}");
    assert!(errors[3] < 8e-3, "{errors:?}");
}

/// Coefficients of level 3 one by one, to round-off, against the same out of a
/// block: T_jk · 4^(l_j − l_k) is the mean in cell j for a source that is 1 on k.
#[test]
fn whole_blocks_have_the_exact_coefficients() {
    let geometry = window_over_floor();
    let source = Support::isotropic(0, [0; 4]);
    let levels = Levels::isotropic(3);
    // A third of the 4096, coprime to every power of two.
    let probes: Vec<[u16; 4]> = cells(3).step_by(3).collect();
    let exact = Exact { tolerance: 1e-9 };
    let mean = |&m: &[u16; 4]| {
        let dest = Support::isotropic(3, m);
        exact.integrate(&Pair::new(&geometry, source, dest)).value * dest.scale() / source.scale()
    };
    let reference: Vec<f64> = probes.iter().map(mean).collect();
    let lit = reference.iter().filter(|&&t| t > 0.0).count();
    assert!(lit > 100, "only {lit} of {} see the window", probes.len());
    let window = Emission::new(0, vec![[1.0; 3]], Lobe::Lambertian);
    let red = |samples| {
        let block = transport_block(&geometry, &window, levels, BlockOptions { samples })
            .expect("straight grid lines");
        let values: Vec<f64> =
            probes.iter().map(|m| f64::from(block.mean(m.map(usize::from))[0])).collect();
        relative_euclidean_distance(&values, &reference)
    };
    let errors = [BlockOptions::default().samples, 16, 64].map(red);
    eprintln!("RED of blocks at 4, 16, 64 samples a side: {errors:.5?}");
    assert!(errors[0] < 2e-2, "{errors:?}");
    // First order where the window's outline crosses a cell is the least there is.
    assert!(errors.windows(2).all(|e| e[1] < 0.4 * e[0]), "{errors:?}");
}
