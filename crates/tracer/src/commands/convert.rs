//! `tracer convert`: the same radiance, stored another way.

use super::stdout::say;
use crate::cli;
use anyhow::Context as _;
use rayon::prelude::*;
use wrt_core::WctFile;

/// Reads, converts, writes.
pub(crate) fn run(args: &cli::Convert) -> anyhow::Result<()> {
    let mut file =
        WctFile::read(&args.input).with_context(|| format!("reading {}", args.input.display()))?;
    file.patches.par_iter_mut().for_each(|patch| match args.error {
        Some(error) => {
            let (tree, quantisation) = patch.tree.quantised(error);
            // Errors of one after the other add up at worst, to first order.
            patch.relative_error += quantisation.relative_error;
            patch.tree = tree;
        }
        None => patch.tree = patch.tree.without_code(),
    });
    let storage = if args.raw { "raw" } else { "quantised" };
    file.options.insert("storage".to_owned(), storage.to_owned());
    file.write(&args.output).with_context(|| format!("writing {}", args.output.display()))?;
    let bytes = |path| std::fs::metadata(path).map_or(0, |m| m.len()) as f64 / 1e6;
    say(format_args!(
        "{:<24} {:.2} MB to {:.2} MB",
        "file",
        bytes(&args.input),
        bytes(&args.output)
    ))?;
    let worst = file.patches.iter().map(|patch| patch.relative_error).fold(0.0, f64::max);
    say(format_args!(
        "{:<24} {:.3} % relative L2, of the worst patch",
        "error of compression",
        100.0 * worst
    ))?;
    Ok(())
}
