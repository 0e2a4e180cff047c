//! Integration tests.

mod layering;
mod paper;
mod wct_file;
