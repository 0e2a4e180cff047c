//! Pictures as an animated PNG.

use anyhow::{Context as _, ensure};
use std::io::Cursor;
use std::path::{Path, PathBuf};
use wrt_core::wct_file::write_aside;

/// Writes the `.png` files `frames` as one that shows `fps` of them a second, over
/// and over.
///
/// # Errors
///
/// If a picture cannot be read or has another size, or the file not be written.
pub(super) fn write(path: &Path, frames: &[PathBuf], fps: f64) -> anyhow::Result<()> {
    let count = u32::try_from(frames.len())?;
    let open = |path: &PathBuf| {
        let picture = image::open(path).with_context(|| format!("reading {}", path.display()))?;
        anyhow::Ok(picture.into_rgb8())
    };
    let first = open(frames.first().context("no pictures")?)?;
    let size = first.dimensions();
    let mut file = Cursor::new(Vec::new());
    let mut encoder = png::Encoder::new(&mut file, size.0, size.1);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_animated(count, 0)?;
    let (numerator, denominator) = delay(fps);
    encoder.set_frame_delay(numerator, denominator)?;
    let mut writer = encoder.write_header()?;
    for (i, frame) in frames.iter().enumerate() {
        let picture = if i == 0 { first.clone() } else { open(frame)? };
        let same = picture.dimensions() == size;
        ensure!(same, "{}: not of the size of the first picture", frame.display());
        writer.write_image_data(picture.as_raw())?;
    }
    writer.finish()?;
    write_aside(path, &file.into_inner()).with_context(|| format!("writing {}", path.display()))
}

/// Seconds between pictures as the fraction of two 16-bit numbers that APNG has.
fn delay(fps: f64) -> (u16, u16) {
    // 1000 for 29.97 and the like; fewer for rates too high for it.
    let numerator = (f64::from(u16::MAX) / fps).floor().clamp(1.0, 1000.0);
    (numerator as u16, (numerator * fps).round().clamp(1.0, f64::from(u16::MAX)) as u16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_kept_to_a_thousandth() {
        for fps in [0.5, 1.0, 24.0, 29.97, 60.0, 1000.0, 50_000.0] {
            let (numerator, denominator) = delay(fps);
            let kept = f64::from(denominator) / f64::from(numerator);
            assert!((kept / fps - 1.0).abs() < 1e-3, "{fps}: {numerator}/{denominator}");
        }
    }

    #[test]
    fn an_animation_has_its_pictures_in_order() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let frame = |i: u8| {
            let path = folder.path().join(format!("{i}.png"));
            image::RgbImage::from_pixel(3, 2, image::Rgb([i, 10, 20])).save(&path).expect("a PNG");
            path
        };
        let frames = [frame(0), frame(7), frame(9)];
        let path = folder.path().join("all.png");
        write(&path, &frames, 24.0).expect("written");
        let file = std::io::BufReader::new(std::fs::File::open(&path).expect("just written"));
        let mut reader = png::Decoder::new(file).read_info().expect("a PNG");
        let animation = *reader.info().animation_control().expect("an animation");
        assert_eq!((animation.num_frames, animation.num_plays), (3, 0));
        for expected in [0, 7, 9] {
            let mut pixels = vec![0; reader.output_buffer_size().expect("18 bytes")];
            reader.next_frame(&mut pixels).expect("a picture");
            assert_eq!(pixels[..3], [expected, 10, 20]);
        }
        let odd = folder.path().join("odd.png");
        image::RgbImage::new(2, 2).save(&odd).expect("a PNG");
        let error = write(&path, &[frames[0].clone(), odd], 24.0).expect_err("two sizes");
        assert!(error.to_string().contains("odd.png: not of the size"), "{error}");
    }
}
