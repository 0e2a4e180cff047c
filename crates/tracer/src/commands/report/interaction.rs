//! Reflection: error and time by level and exponent.

use super::{Bench, relative_rms};
use crate::report::{Chart, Point, Section, Series, Table, Value, cpu_time};
use glam::DVec3;
use wrt_core::transport::{BlockOptions, TransportGeometry, transport_block};
use wrt_core::{
    Emission, Levels, Lobe, LobeMatrix, Nusselt, Phong, Polygon, Sampler, TreeBuilder, gather,
    reflect, sobol,
};

pub(super) fn measure(bench: &Bench) -> anyhow::Result<Section> {
    // Small enough that its light hardly varies with position: what is left is
    // direction.
    let floor = Polygon::rectangle(DVec3::ZERO, 0.02 * DVec3::Z, 0.02 * DVec3::X)?;
    let lamp = Polygon::rectangle(DVec3::new(-0.8, 1.2, -1.5), 1.6 * DVec3::X, 1.6 * DVec3::Y)?;
    let emission = Emission::new(0, vec![[1.0; 3]], Lobe::Lambertian);
    let geometry = TransportGeometry::new(lamp.clone(), floor.clone());
    let emitters = [(lamp, emission.clone())];
    let points = bench.choose(200, 1000);
    let directions: Vec<Nusselt> = (0..points)
        .map(|i| Nusselt { kappa: sobol(i, 0, 11), lambda: sobol(i, 1, 12) })
        .filter(|q| q.to_direction().is_some())
        .collect();
    let (mut rows, mut time, mut box_time) = (Vec::new(), Vec::new(), Vec::new());
    for n in [1.0, 8.0, 40.0, 400.0] {
        let phong = Phong { kd: [0.2; 3], ks: [0.6; 3], exponent: n };
        let position = floor.frame().point(0.5 * floor.size().unwrap_or_default());
        let exact: Vec<f64> = directions
            .iter()
            .filter_map(|q| q.to_direction())
            .map(|eye| gather(&emitters, floor.frame(), position, &phong, eye, 128)[0])
            .collect();
        let (mut linear, mut boxes) = (Vec::new(), Vec::new());
        for direction in 3..=bench.choose(5, 6) {
            let levels = Levels { position: 0, direction };
            let incident = transport_block(&geometry, &emission, levels, BlockOptions::default())?;
            let ((lobe, _), matrix_cost) = cpu_time(1, || {
                let lobe = LobeMatrix::phong(n, direction, direction);
                // Columns are made when they are first needed.
                let first = reflect(&incident, &phong, Some(&lobe));
                (lobe, first)
            });
            let (outgoing, cost) =
                cpu_time(bench.runs(), || reflect(&incident, &phong, Some(&lobe)));
            let sampler = Sampler::new(&TreeBuilder::from_grid(&outgoing).finish());
            let error = |look_up: &dyn Fn([f64; 4]) -> [f32; 3]| {
                let found = directions.iter().map(|q| look_up([0.5, 0.5, q.kappa, q.lambda])[0]);
                relative_rms(found.map(f64::from).zip(exact.iter().copied()))
            };
            let multilinear = error(&|q| sampler.multilinear(q));
            let nearest = error(&|q| sampler.box_value(q));
            rows.push(vec![
                Value::Number(n),
                Value::Count(direction.into()),
                Value::Percent(multilinear),
                Value::Percent(nearest),
                Value::Number(1e3 * matrix_cost.median),
                Value::Number(1e3 * cost.median),
            ]);
            let x = 1e3 * matrix_cost.median;
            linear.push(Point { x, y: multilinear, range: None });
            boxes.push(Point { x, y: nearest, range: None });
        }
        time.push(Series { name: format!("n = {n}"), points: linear });
        box_time.push(Series { name: format!("n = {n}"), points: boxes });
    }
    let chart = |title: &str, series| Chart {
        title: title.to_owned(),
        axes: ["CPU time, ms: lobe matrix and one reflection", "relative RMS error"],
        series,
        ..Chart::default()
    };
    Ok(Section {
        id: "interaction",
        title: "Surface interaction",
        text: vec!["Radiance that a small Phong surface (k_d = 0.2, k_s = 0.6) reflects of a 1.6 m window, as looked up in random directions, against quadrature. Points are direction levels from 3 upwards. The lobe matrix is made once per exponent and level, whatever the number of tiles; one reflection at one position is in the table. A lobe is about 1/√n wide: cells must be smaller before errors fall.".to_owned()],
        charts: vec![chart("Looked up between cells", time), chart("Looked up in the nearest cell", box_time)],
        tables: vec![Table {
            name: "interaction",
            caption: "By exponent and direction level.".to_owned(),
            head: vec![
                "exponent n",
                "direction level",
                "error, multilinear",
                "error, nearest cell",
                "matrix and first reflection, ms",
                "one reflection, ms",
            ],
            rows,
        }],
        ..Section::default()
    })
}
