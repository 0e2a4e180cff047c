//! `tracer`: bakes scenes to wavelet radiance and renders them from it.
fn main() {}
