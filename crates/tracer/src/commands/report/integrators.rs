//! Integration methods, single coefficients: the paper's Fig. 4 and 5.

use super::Bench;
use crate::cli::Integrators;
use crate::report::Section;
use anyhow::Context as _;
use std::fs;

pub(super) fn measure(bench: &Bench) -> anyhow::Result<Section> {
    let folder = bench.output.join("integrators");
    let args = Integrators { output: folder.clone(), quick: bench.quick };
    crate::commands::report_integrators::run(&args)?;
    let picture = |name: &str| {
        let path = folder.join(name);
        fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))
    };
    Ok(Section {
        id: "integrators",
        title: "Integrating single coefficients",
        text: vec![
            "The paper's comparison (§7.1.4.3, Fig. 4 and 5): one source function against all functions of a destination, by each rule with growing counts. Left CPU time, right evaluations of the integrand, which no machine changes. What is further down and left is better; exact splits the integral at its kinks and is drawn on the frame.".to_owned(),
            "All rows: integrators/integrators.csv.".to_owned(),
        ],
        pictures: vec![picture("red_time.svg")?, picture("red_evaluations.svg")?],
        ..Section::default()
    })
}
