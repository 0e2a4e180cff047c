//! The error budget: which part of the error is whose.

use super::estimates::true_error;
use super::{Bench, baked};
use crate::report::{Section, Table, Value};

pub(super) fn measure(bench: &Bench) -> anyhow::Result<Section> {
    let scene = bench.scene("chapel/chapel.gltf")?;
    let (position, direction) = bench.choose((2, 4), (4, 6));
    let text = |level: u8| level.to_string();
    let flags = |position: u8, direction: u8, rest: &[&str]| -> Vec<String> {
        let levels = ["--level", &text(position), "--direction-level", &text(direction)];
        let all = levels.iter().chain(&["--checks", "0"]).chain(rest);
        all.map(|flag| (*flag).to_owned()).collect()
    };
    let same = |rest: &[&str]| flags(position, direction, rest);
    let cases = [
        ("nothing: as it is", same(&[])),
        ("positions: twice as many cells a side", flags(position + 1, direction, &[])),
        ("directions: twice as many cells a side", flags(position, direction + 1, &[])),
        ("quadrature: a tenth of the transport's error", same(&["--transport-error", "1e-4"])),
        ("compression: all coefficients kept", same(&["--threshold", "0"])),
    ];
    let mut rows: Vec<Vec<Value>> = Vec::new();
    let mut whole = 0.0;
    for (what, flags) in &cases {
        let flags: Vec<&str> = flags.iter().map(String::as_str).collect();
        let bake = baked(&scene, &flags)?;
        let error = true_error(&scene, &bake.texture, bench.choose(64, 512))?;
        if rows.is_empty() {
            whole = error;
        }
        let part = (whole * whole - error * error).max(0.0).sqrt();
        rows.push(vec![
            (*what).into(),
            Value::Percent(error),
            if rows.is_empty() { Value::Nothing } else { Value::Percent(part) },
            Value::Count(bake.coefficients),
            Value::Count(bake.bytes),
            Value::Number(bake.seconds),
        ]);
    }
    Ok(Section {
        id: "budget",
        title: "Whose error it is",
        text: vec![format!(
            "The chapel baked in the Haar basis at position level {position} and direction level {direction}, and again with one thing refined at a time: what the error loses, in squares, is that thing's part. Cells are what projection, interaction and look-up have in common, for all three work with means over cells; they cannot be told apart without changing the cells. Parts of equal size would be money well spent: the largest is where to refine next. The smooth basis has no such knobs: --error shares its error out by itself."
        )],
        tables: vec![Table {
            name: "budget",
            caption: "Relative RMS error of reflected radiance as looked up.".to_owned(),
            head: vec!["refined", "error", "part", "coefficients", "bytes", "bake, CPU s"],
            rows,
        }],
        ..Section::default()
    })
}
