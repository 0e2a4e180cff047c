//! How many threads work.

use anyhow::Context as _;

/// Runs `work` on a pool of so many threads; 0 is one per core.
///
/// # Errors
///
/// If they cannot be started.
pub(crate) fn in_pool<T: Send>(
    threads: usize,
    work: impl FnOnce() -> T + Send,
) -> anyhow::Result<T> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    Ok(pool.with_context(|| format!("starting {threads} threads"))?.install(work))
}
