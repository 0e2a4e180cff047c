//! Ctrl-C and requests to terminate: the first asks for an end, the second makes it.
//!
//! A hang-up is left as it is, so that `nohup` keeps its word.

use std::sync::atomic::AtomicBool;

/// Listens for SIGINT and SIGTERM, and returns what becomes true when one comes.
///
/// Where listening fails, they end the program as ever.
pub(super) fn listen() -> &'static AtomicBool {
    static STOP: AtomicBool = AtomicBool::new(false);
    static LISTENING: std::sync::Once = std::sync::Once::new();
    LISTENING.call_once(|| start(&STOP));
    &STOP
}

#[cfg(unix)]
fn start(stop: &'static AtomicBool) {
    use signal_hook::consts::{SIGINT, SIGTERM};
    use signal_hook::iterator::Signals;
    use std::io::Write as _;
    use std::sync::atomic::Ordering;

    let Ok(mut signals) = Signals::new([SIGINT, SIGTERM]) else { return };
    std::thread::spawn(move || {
        for signal in signals.forever() {
            if stop.swap(true, Ordering::Relaxed) {
                // What a shell reports of a program that the signal ended.
                std::process::exit(128 + signal);
            }
            // The terminal may be gone, which is no reason to panic.
            let _ = writeln!(
                std::io::stderr(),
                "tracer: stopping after the rows begun; once more to stop at once"
            );
        }
    });
}

#[cfg(not(unix))]
fn start(_: &'static AtomicBool) {}
