//! `tracer`: bakes scenes to wavelet radiance and renders them from it.

#[cfg_attr(not(test), expect(dead_code, unused_imports, reason = "no command reads a scene yet"))]
mod scene;

fn main() {}
