//! `tracer convert`: the same radiance, stored another way.

use super::stdout::say;
use crate::cli;
use anyhow::{Context as _, ensure};
use rayon::prelude::*;
use wrt_core::WctFile;

/// Reads, converts, writes.
pub(crate) fn run(args: &cli::Convert) -> anyhow::Result<()> {
    let mut file =
        WctFile::read(&args.input).with_context(|| format!("reading {}", args.input.display()))?;
    ensure!(
        file.smooth.is_empty() || args.error.is_none(),
        "{}: polynomials are as exact as they were baked: bake again with another --error",
        args.input.display()
    );
    file.patches.par_iter_mut().for_each(|patch| match args.error {
        Some(error) => {
            let (tree, quantisation) = patch.tree.quantised(error);
            // Errors of one after the other add up at worst, to first order.
            patch.relative_error += quantisation.relative_error;
            let measured = patch.error_estimate.map(|e| e.hypot(quantisation.relative_error));
            patch.error_estimate = measured;
            patch.tree = tree;
        }
        None => patch.tree = patch.tree.without_code(),
    });
    if let (Some(error), Some(keep)) = (args.error, file.options.get_mut("keep")) {
        keep.push_str(&format!(", of that relative error {error}"));
    }
    let storage = if args.raw { "raw" } else { "quantised" };
    file.options.insert("storage".to_owned(), storage.to_owned());
    file.write(&args.output).with_context(|| format!("writing {}", args.output.display()))?;
    let bytes = |path| super::bytes(std::fs::metadata(path).map_or(0, |m| m.len()));
    say(format_args!("{:<24} {} to {}", "file", bytes(&args.input), bytes(&args.output)))?;
    let worst = file.patches.iter().map(|patch| patch.relative_error).fold(0.0, f64::max);
    say(format_args!(
        "{:<24} {:.3} % relative L2, of the worst patch",
        "error of compression",
        100.0 * worst
    ))?;
    Ok(())
}
