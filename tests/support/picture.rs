//! Pictures read back, and how far apart two of them are.

use std::path::Path;

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

    /// A PNG file's bytes, 0 to 255.
    pub(crate) fn png(path: &str) -> Self {
        let image = image::open(path).expect("a PNG file").into_rgb8();
        let (width, height) = (image.width() as usize, image.height() as usize);
        Self { width, height, pixels: image.pixels().map(|p| p.0.map(f64::from)).collect() }
    }

    pub(crate) fn at(&self, x: usize, y: usize) -> [f64; 3] {
        self.pixels[y * self.width + x]
    }

    /// Mean |a − b| over pixels and channels.
    pub(crate) fn mean_absolute_difference(&self, other: &Self) -> f64 {
        let pairs = self.pixels.as_flattened().iter().zip(other.pixels.as_flattened());
        pairs.map(|(a, b)| (a - b).abs()).sum::<f64>() / (3 * self.pixels.len()) as f64
    }

    /// Writes a PNG of grey where the two agree; differences are eightfold.
    pub(crate) fn write_difference(&self, other: &Self, path: &Path) {
        let pairs = self.pixels.as_flattened().iter().zip(other.pixels.as_flattened());
        let bytes = pairs.map(|(a, b)| (128.0 + 8.0 * (a - b)).clamp(0.0, 255.0) as u8).collect();
        let (width, height) = (self.width as u32, self.height as u32);
        let image = image::RgbImage::from_raw(width, height, bytes).expect("three bytes a pixel");
        image.save(path).expect("a writable folder");
    }
}

/// ‖found − expected‖ / ‖expected‖ over all channels.
pub(crate) fn relative_rms(found: &[[f64; 3]], expected: &[[f64; 3]]) -> f64 {
    assert_eq!(found.len(), expected.len(), "colours in pairs");
    let pairs = found.as_flattened().iter().zip(expected.as_flattened());
    let (error, size) = pairs.fold((0.0, 0.0), |(e, s), (f, x)| (e + (f - x) * (f - x), s + x * x));
    (error / size).sqrt()
}
