//! What a command says on stdout. `println!` panics where nobody reads it any more.

use anyhow::Context as _;
use std::fmt::Display;
use std::io::{ErrorKind, Write as _};

/// The reader of stdout has gone: the end of the program, but no complaint.
#[derive(Debug)]
pub(crate) struct Closed;

impl Closed {
    /// What a shell reports of a program that a closed pipe ended: 128 and SIGPIPE.
    pub(crate) const EXIT_CODE: u8 = 141;
}

impl Display for Closed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("standard output is closed")
    }
}

impl std::error::Error for Closed {}

/// Prints `text` and the end of a line, at once.
///
/// # Errors
///
/// [`Closed`] where the reader has gone; otherwise why it cannot be written.
pub(super) fn say(text: impl Display) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Err(Closed.into()),
        result => result.context("writing to standard output"),
    }
}
