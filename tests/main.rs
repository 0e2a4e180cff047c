//! Integration tests.

mod layering;
mod wct_file;
