//! Integration tests.

mod cli;
mod layering;
mod paper;
mod support;
mod wct_file;
