//! Ctrl-C: the first asks for an end, the second makes it.

use std::sync::atomic::{AtomicBool, Ordering};

static STOP: AtomicBool = AtomicBool::new(false);

/// Listens for Ctrl-C and for a request to terminate, and returns what becomes true
/// when one comes.
///
/// Where listening fails, they end the program as ever.
pub(super) fn listen() -> &'static AtomicBool {
    let _ = ctrlc::set_handler(|| {
        if STOP.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
        eprintln!("tracer: stopping after the rows begun; once more to stop at once");
    });
    &STOP
}
