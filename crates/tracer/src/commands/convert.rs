//! `tracer convert`: the same radiance, stored another way.

use super::keep::{KEEP, in_words};
use super::stdout::say;
use crate::cli;
use anyhow::{Context as _, ensure};
use rayon::prelude::*;
use std::collections::BTreeMap;
use wrt_core::WctFile;

/// Reads, converts, writes.
pub(crate) fn run(args: &cli::Convert) -> anyhow::Result<()> {
    super::bake::check_output(&args.output)?;
    let mut file =
        WctFile::read(&args.input).with_context(|| format!("reading {}", args.input.display()))?;
    ensure!(
        file.smooth.is_empty() || args.error.is_none(),
        "{}: polynomials are as exact as they were baked: bake again with another --error",
        args.input.display()
    );
    let length = |path| super::bytes(std::fs::metadata(path).map_or(0, |m| m.len()));
    // The output may be the input.
    let before = length(&args.input);
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
    // A smooth patch has no other storage.
    if !file.patches.is_empty() {
        record(&mut file.options, args);
    }
    file.write(&args.output).with_context(|| format!("writing {}", args.output.display()))?;
    say(format_args!("{:<24} {before} to {}", "file", length(&args.output)))?;
    let errors = file.patches.iter().map(|patch| patch.relative_error);
    let worst = errors.chain(file.smooth.iter().map(|p| p.relative_error)).fold(0.0, f64::max);
    say(format_args!(
        "{:<24} {:.3} % relative L2, of the worst patch",
        "error of compression",
        100.0 * worst
    ))?;
    Ok(())
}

/// Brings the options of a file to what was made of it.
fn record(options: &mut BTreeMap<String, String>, args: &cli::Convert) {
    let storage = if args.raw { "raw" } else { "quantised" };
    options.insert("storage".to_owned(), storage.to_owned());
    let kept = options.get(KEEP).map(|keep| in_words(keep));
    let keep = match (kept, args.error) {
        (kept, None) => kept,
        (None, Some(error)) => Some(format!("relative error {error}")),
        (Some(kept), Some(error)) => Some(format!("{kept}, then relative error {error}")),
    };
    options.extend(keep.map(|keep| (KEEP.to_owned(), keep)));
}
