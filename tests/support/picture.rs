//! Pictures read back, and how far apart two of them are.

/// A picture, rows from the top.
pub(crate) struct Picture {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) pixels: Vec<[f64; 3]>,
}

impl Picture {
    /// An OpenEXR file's radiance.
    pub(crate) fn exr(path: &str) -> Self {
        let read = exr::prelude::read_first_rgba_layer_from_file(
            path,
            |size, _| Self {
                width: size.width(),
                height: size.height(),
                pixels: vec![[0.0; 3]; size.area()],
            },
            |picture: &mut Self, at, (r, g, b, _): (f32, f32, f32, f32)| {
                picture.pixels[at.y() * picture.width + at.x()] = [r, g, b].map(f64::from);
            },
        );
        read.expect("an OpenEXR file").layer_data.channel_data.pixels
    }

    pub(crate) fn at(&self, x: usize, y: usize) -> [f64; 3] {
        self.pixels[y * self.width + x]
    }
}

/// ‖found − expected‖ / ‖expected‖ over all channels.
pub(crate) fn relative_rms(found: &[[f64; 3]], expected: &[[f64; 3]]) -> f64 {
    assert_eq!(found.len(), expected.len(), "colours in pairs");
    let pairs = found.as_flattened().iter().zip(expected.as_flattened());
    let (error, size) = pairs.fold((0.0, 0.0), |(e, s), (f, x)| (e + (f - x) * (f - x), s + x * x));
    (error / size).sqrt()
}
