//! Integration tests.

mod transport;
mod wct_file;
