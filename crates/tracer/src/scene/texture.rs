//! Image files as linear texels.

use super::Texture;
use anyhow::Context as _;
use glam::{DVec3, Vec3};
use image::{DynamicImage, ImageReader};
use std::io::Cursor;

/// Decodes a PNG or JPEG whose texels are sRGB; alpha is dropped.
///
/// # Errors
///
/// If `bytes` are neither, or are damaged.
pub(super) fn decode(bytes: &[u8]) -> anyhow::Result<Texture> {
    let picture = open(bytes)?;
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let texels = match picture {
        DynamicImage::ImageLuma16(_)
        | DynamicImage::ImageLumaA16(_)
        | DynamicImage::ImageRgb16(_)
        | DynamicImage::ImageRgba16(_) => {
            let texel = |p: &image::Rgb<f32>| Vec3::from(p.0.map(srgb_to_linear));
            picture.into_rgb32f().pixels().map(texel).collect()
        }
        _ => {
            let table: [f32; 256] = std::array::from_fn(|i| srgb_to_linear(i as f32 / 255.0));
            let texel = |p: &image::Rgb<u8>| Vec3::from(p.0.map(|c| table[usize::from(c)]));
            picture.into_rgb8().pixels().map(texel).collect()
        }
    };
    Ok(Texture { width, height, texels })
}

/// The mean of each channel of a PNG or JPEG that holds numbers, not colours.
///
/// # Errors
///
/// As [`decode`].
pub(super) fn mean(bytes: &[u8]) -> anyhow::Result<Vec3> {
    let picture = open(bytes)?.into_rgb8();
    let count = f64::from(picture.width()) * f64::from(picture.height());
    let sum = |s: DVec3, p: &image::Rgb<u8>| s + DVec3::from(p.0.map(f64::from));
    Ok((picture.pixels().fold(DVec3::ZERO, sum) / (255.0 * count)).as_vec3())
}

fn open(bytes: &[u8]) -> anyhow::Result<DynamicImage> {
    let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format()?;
    anyhow::ensure!(reader.format().is_some(), "neither PNG nor JPEG: convert it to one of them");
    let picture = reader.decode().context("damaged PNG or JPEG")?;
    anyhow::ensure!(picture.width() > 0 && picture.height() > 0, "the image has no pixels");
    Ok(picture)
}

/// The sRGB transfer function, IEC 61966-2-1.
fn srgb_to_linear(c: f32) -> f32 {
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A PNG of one row, for tests of the loaders.
    pub(in crate::scene) fn png(texels: &[[u8; 3]]) -> Vec<u8> {
        let width = u32::try_from(texels.len()).expect("a short row");
        let row = image::RgbImage::from_raw(width, 1, texels.concat()).expect("3 bytes a texel");
        let mut bytes = Cursor::new(Vec::new());
        row.write_to(&mut bytes, image::ImageFormat::Png).expect("PNG to memory");
        bytes.into_inner()
    }

    #[test]
    fn texels_are_linear() {
        let texture = decode(&png(&[[0, 255, 188], [10, 0, 0]])).expect("a valid PNG");
        assert_eq!((texture.width, texture.height), (2, 1));
        let [a, b] = texture.texels[..] else { panic!("{texture:?}") };
        assert_eq!((a.x, a.y), (0.0, 1.0));
        // sRGB 188 is the grey that looks half as bright: 0.5 within one step.
        assert!((a.z - 0.5).abs() < 0.005, "{a}");
        // The linear toe: 10 / 255 / 12.92.
        assert!((b.x - 10.0 / 255.0 / 12.92).abs() < 1e-7, "{b}");
    }

    #[test]
    fn the_mean_is_of_the_stored_numbers() {
        let mean = mean(&png(&[[0, 255, 51], [255, 255, 153]])).expect("a valid PNG");
        assert!(mean.abs_diff_eq(Vec3::new(0.5, 1.0, 0.4), 1e-6), "{mean}");
    }

    #[test]
    fn sixteen_bits_agree_with_eight() {
        let deep = image::ImageBuffer::<image::Rgb<u16>, _>::from_raw(1, 1, vec![0x8080_u16; 3]);
        let mut bytes = Cursor::new(Vec::new());
        let deep = deep.expect("one texel");
        deep.write_to(&mut bytes, image::ImageFormat::Png).expect("PNG to memory");
        let deep = decode(bytes.get_ref()).expect("a valid PNG").texels[0];
        let shallow = decode(&png(&[[0x80; 3]])).expect("a valid PNG").texels[0];
        assert!((deep - shallow).length() < 1e-6, "{deep} {shallow}");
    }

    #[test]
    fn damaged_and_foreign_images_are_errors() {
        let whole = png(&[[1, 2, 3]; 9]);
        for len in 0..whole.len() - 12 {
            assert!(decode(&whole[..len]).is_err(), "{len} bytes of {}", whole.len());
        }
        let error = decode(b"RIFF....WEBPVP8 ").expect_err("WebP is not read");
        assert!(format!("{error:#}").contains("PNG"), "{error:#}");
    }
}
