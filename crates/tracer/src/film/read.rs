//! Pictures read back.

use super::{Film, Format, Metadata};
use crate::scene::srgb_to_linear;
use anyhow::{Context as _, bail};
use exr::meta::header::Header;
use exr::prelude::{MetaData, read_first_rgba_layer_from_file};
use glam::Vec3;
use image::ImageReader;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Pixels that a picture may have: a damaged header can promise any number.
const MOST: usize = 1 << 26;

impl Film {
    /// Reads a `.png`, as the linear display colours that it shows, or the radiance
    /// of a `.exr`.
    ///
    /// # Errors
    ///
    /// An unknown extension, or a file that is missing, damaged or of more than 2²⁶
    /// pixels; by name.
    pub(crate) fn open(path: &Path) -> anyhow::Result<Self> {
        let film = match Format::of(path)? {
            Format::Png => read_png(path),
            Format::Exr => read_exr(path),
        };
        film.with_context(|| format!("reading {}", path.display()))
    }
}

impl Format {
    /// Width and height of the picture at `path`, by its header.
    ///
    /// # Errors
    ///
    /// If it is no picture of this format.
    pub(crate) fn size_of(self, path: &Path) -> anyhow::Result<(usize, usize)> {
        match self {
            Self::Png => {
                let (width, height) =
                    ImageReader::open(path)?.with_guessed_format()?.into_dimensions()?;
                Ok((width as usize, height as usize))
            }
            Self::Exr => {
                let size = exr_header(path)?.layer_size;
                Ok((size.width(), size.height()))
            }
        }
    }

    /// With which settings the picture at `path` was made, if it says so.
    ///
    /// # Errors
    ///
    /// If it is no picture of this format.
    pub(crate) fn settings_of(self, path: &Path) -> anyhow::Result<Option<String>> {
        let comment = match self {
            Self::Png => {
                let file = BufReader::new(File::open(path)?);
                let reader = png::Decoder::new(file).read_info()?;
                let texts = &reader.info().utf8_text;
                texts.first().map(|text| text.get_text()).transpose()?
            }
            Self::Exr => exr_header(path)?.own_attributes.comments.map(|text| text.to_string()),
        };
        let settings = comment.as_deref().and_then(Metadata::settings_in);
        Ok(settings.map(str::to_owned))
    }
}

fn exr_header(path: &Path) -> anyhow::Result<Header> {
    let headers = MetaData::read_from_file(path, false)?.headers;
    headers.into_iter().next().context("no picture in it")
}

fn read_png(path: &Path) -> anyhow::Result<Film> {
    let image = ImageReader::open(path)?.with_guessed_format()?.decode()?.into_rgb16();
    let linear = |c: u16| srgb_to_linear(f32::from(c) / f32::from(u16::MAX));
    let (width, height) = (image.width() as usize, image.height() as usize);
    let pixels = image.pixels().map(|p| Vec3::from_array(p.0.map(linear))).collect();
    Ok(Film { width, height, pixels })
}

fn read_exr(path: &Path) -> anyhow::Result<Film> {
    let size = exr_header(path)?.layer_size;
    if size.area() > MOST {
        bail!("{} x {} pixels are more than this program reads", size.width(), size.height());
    }
    let read = read_first_rgba_layer_from_file(
        path,
        |size, _| Film {
            width: size.width(),
            height: size.height(),
            pixels: vec![Vec3::ZERO; size.area()],
        },
        |film: &mut Film, at, (r, g, b, _): (f32, f32, f32, f32)| {
            film.pixels[at.y() * film.width + at.x()] = Vec3::new(r, g, b);
        },
    )?;
    Ok(read.layer_data.channel_data.pixels)
}

#[cfg(test)]
mod tests {
    use super::super::{Display, Tone};
    use super::*;
    use serde_json::Value;
    use std::fs;

    #[test]
    fn what_was_written_is_read() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let pixels = (0..35).map(|i| Vec3::new(i as f32 * 0.02, 1.0 / 3.0, 1e-3)).collect();
        let film = Film { width: 7, height: 5, pixels };
        let plain = Display { exposure: 0.0, tone: Tone::None };
        let read = ["a.exr", "a.png"].map(|name| {
            let path = folder.path().join(name);
            film.save(&path, plain).expect("written");
            Film::open(&path).expect("readable")
        });
        assert_eq!(read[0], film);
        let off = film.pixels.iter().zip(&read[1].pixels).map(|(a, b)| (*a - *b).abs());
        // Half of 1/255 at the slope of the sRGB curve's bright end.
        assert!(off.fold(Vec3::ZERO, Vec3::max).max_element() < 0.0045);
    }

    #[test]
    fn names_of_any_script_do_not_lose_how_a_picture_was_made() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let film = Film { width: 1, height: 1, pixels: vec![Vec3::ONE] };
        let settings = r#"{"scene":"Grüße\n, 日 🙂.gltf","samples":4}"#;
        let metadata = Metadata {
            camera: "日\nsettings: none".to_owned(),
            settings: settings.to_owned(),
            ..Metadata::default()
        };
        for (name, format) in [("a.exr", Format::Exr), ("a.png", Format::Png)] {
            let path = folder.path().join(name);
            film.save_with(&path, Display::default(), None, Some(&metadata)).expect("written");
            let found = format.settings_of(&path).expect("a picture").expect(name);
            let found: Value = serde_json::from_str(&found).expect("JSON");
            assert_eq!(found, serde_json::from_str::<Value>(settings).expect("JSON"), "{name}");
            film.save(&path, Display::default()).expect("written");
            assert_eq!(format.settings_of(&path).expect("a picture"), None, "{name}");
        }
    }

    #[test]
    fn a_damaged_picture_is_named() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        for name in ["a.exr", "a.png"] {
            let path = folder.path().join(name);
            fs::write(&path, "not a picture").expect("a file");
            let error = format!("{:#}", Film::open(&path).expect_err(name));
            assert!(error.starts_with("reading ") && error.contains(name), "{error}");
        }
    }
}
