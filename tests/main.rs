//! Integration tests.

mod bake;
mod cli;
mod interaction;
mod layering;
mod paper;
mod render;
mod report;
mod smooth;
mod support;
mod transport;
mod wct_file;
