//! Integration tests.

mod bake;
mod cli;
mod fly;
mod for_animation;
mod images;
mod interaction;
mod layering;
mod paper;
mod read_wct;
mod render;
mod report;
mod seam;
mod smooth;
mod support;
mod transport;
mod wct_file;
