//! Linear pixels, and the files they become: OpenEXR as they are, PNG through
//! exposure, tone curve and sRGB.

mod layers;
mod read;

pub(crate) use layers::{Layers, Metadata, Window};

use anyhow::{Context as _, bail};
use glam::{Mat3, Vec3};
use std::path::{Path, PathBuf};
use wrt_core::wct_file::write_aside;

/// A picture in linear Rec. 709 radiance, rows from the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Film {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) pixels: Vec<Vec3>,
}

/// How radiance becomes displayable; only 8-bit files use it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Display {
    /// Stops: radiance is multiplied by 2^exposure.
    pub(crate) exposure: f32,
    pub(crate) tone: Tone,
}

/// A tone curve.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Tone {
    /// Clamp to [0, 1].
    None,
    /// Khronos PBR Neutral: true colours below 0.8, the rest compressed.
    #[default]
    Neutral,
    /// AgX: filmic, bright colours lose their saturation.
    Agx,
}

/// What a file name's extension asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    /// 8-bit sRGB.
    Png,
    /// 32-bit float, linear, whatever the display settings.
    Exr,
}

impl Format {
    /// The format that `path` asks for, if a picture can be written there.
    ///
    /// Meant to be called before hours are spent on the picture.
    ///
    /// # Errors
    ///
    /// An unknown extension, a folder that is not there, or one of this name.
    pub(crate) fn of(path: &Path) -> anyhow::Result<Self> {
        if path.is_dir() {
            bail!("{} is a folder: name a .png or .exr in it", path.display());
        }
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        let format = match extension.to_str() {
            Some("png") => Self::Png,
            Some("exr") => Self::Exr,
            _ => bail!("{}: name it .png or .exr", path.display()),
        };
        let folder = folder_of(path);
        if !folder.is_dir() {
            bail!("{}: the folder {} does not exist", path.display(), folder.display());
        }
        Ok(format)
    }
}

impl Film {
    /// Writes the picture to `path`, in the format of its extension. Until it is
    /// complete, a file of that name stays as it was.
    ///
    /// # Errors
    ///
    /// An unknown extension, a missing folder, or a write that fails.
    pub(crate) fn save(&self, path: &Path, display: Display) -> anyhow::Result<()> {
        self.save_with(path, display, None, None)
    }

    /// [`save`](Self::save) with how it was made, and an OpenEXR file with layers.
    ///
    /// # Errors
    ///
    /// As [`save`](Self::save).
    pub(crate) fn save_with(
        &self,
        path: &Path,
        display: Display,
        layers: Option<&Layers>,
        metadata: Option<&Metadata>,
    ) -> anyhow::Result<()> {
        let bytes = match Format::of(path)? {
            Format::Png => self.png(display, metadata),
            Format::Exr => self.exr(layers, metadata),
        };
        bytes
            .and_then(|bytes| Ok(write_aside(path, &bytes)?))
            .with_context(|| format!("writing {}", path.display()))
    }

    /// Linear display colours in [0, 1].
    pub(crate) fn displayed(&self, display: Display) -> Vec<Vec3> {
        let shown = |&pixel: &Vec3| display.apply(pixel).clamp(Vec3::ZERO, Vec3::ONE);
        self.pixels.iter().map(shown).collect()
    }

    fn png(&self, display: Display, metadata: Option<&Metadata>) -> anyhow::Result<Vec<u8>> {
        let bytes: Vec<u8> =
            self.pixels.iter().flat_map(|&pixel| srgb8(display.apply(pixel))).collect();
        let (width, height) = (u32::try_from(self.width)?, u32::try_from(self.height)?);
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Fast);
        encoder.set_filter(png::Filter::Adaptive);
        if let Some(metadata) = metadata {
            encoder.add_itxt_chunk("Comment".to_owned(), metadata.comment())?;
        }
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&bytes)?;
        writer.finish()?;
        Ok(file)
    }
}

fn folder_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder.to_path_buf(),
        _ => PathBuf::from("."),
    }
}

impl Display {
    /// Linear display colour, for radiance from 0 up; not yet clamped.
    fn apply(self, radiance: Vec3) -> Vec3 {
        // max passes over NaN, which no tone curve survives.
        let colour = (radiance * self.exposure.exp2()).max(Vec3::ZERO).min(Vec3::splat(f32::MAX));
        match self.tone {
            Tone::None => colour,
            Tone::Neutral => neutral(colour),
            Tone::Agx => agx(colour),
        }
    }
}

/// Khronos PBR Neutral tone mapper, after the specification's reference code
/// (KhronosGroup/ToneMapping, `PBR_Neutral`).
fn neutral(colour: Vec3) -> Vec3 {
    const F90: f32 = 0.04;
    const START: f32 = 0.8 - F90;
    const DESATURATION: f32 = 0.15;
    let low = colour.min_element();
    let offset = if low < 2.0 * F90 { low - low * low / (4.0 * F90) } else { F90 };
    let colour = colour - offset;
    let peak = colour.max_element();
    if peak < START {
        return colour;
    }
    let d = 1.0 - START;
    let compressed = 1.0 - d * d / (peak + d - START);
    let colour = colour * (compressed / peak);
    let white = 1.0 - 1.0 / (DESATURATION * (peak - compressed) + 1.0);
    colour.lerp(Vec3::splat(compressed), white)
}

/// AgX by T. Sobotka, as approximated by B. Wrensch (*Minimal AgX
/// Implementation*, 2023): a matrix, a log curve fitted by a polynomial, and
/// the matrix back.
fn agx(colour: Vec3) -> Vec3 {
    const INSET: Mat3 = Mat3::from_cols_array(&[
        0.842_479_06,
        0.042_328_242,
        0.042_375_655,
        0.078_433_6,
        0.878_468_64,
        0.078_433_6,
        0.079_223_745,
        0.079_166_13,
        0.879_143,
    ]);
    const OUTSET: Mat3 = Mat3::from_cols_array(&[
        1.196_879,
        -0.052_896_85,
        -0.052_971_635,
        -0.098_020_88,
        1.151_903_1,
        -0.098_043_45,
        -0.099_029_74,
        -0.098_961_18,
        1.151_073_7,
    ]);
    /// Stops about middle grey that the curve covers.
    const EV: (f32, f32) = (-12.473_93, 4.026_069);
    let curve = |value: f32| {
        let x = ((value.max(1e-10).log2() - EV.0) / (EV.1 - EV.0)).clamp(0.0, 1.0);
        let coefficients = [15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.002_32];
        coefficients.into_iter().fold(0.0, |sum: f32, c| sum * x + c)
    };
    let [r, g, b] = (INSET * colour).to_array().map(curve);
    // The polynomial's result is encoded with a gamma of 2.2.
    (OUTSET * Vec3::new(r, g, b)).max(Vec3::ZERO).powf(2.2)
}

/// Linear to 8-bit sRGB (IEC 61966-2-1).
fn srgb8(colour: Vec3) -> [u8; 3] {
    colour.to_array().map(|x| {
        let x = x.clamp(0.0, 1.0);
        let encoded = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
        (encoded * 255.0).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn gradient() -> Film {
        let pixels = (0..35).map(|i| Vec3::new(i as f32 * 0.1, 1.0 / 3.0, 1e-6)).collect();
        Film { width: 7, height: 5, pixels }
    }

    #[test]
    fn exr_holds_the_pixels_as_they_are() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a.exr");
        let film = gradient();
        film.save(&path, Display { exposure: 3.0, tone: Tone::Agx }).expect("written");
        let read = exr::prelude::read_first_rgba_layer_from_file(
            &path,
            |size, _| vec![Vec3::ZERO; size.area()],
            |pixels: &mut Vec<Vec3>, at, (r, g, b, _): (f32, f32, f32, f32)| {
                pixels[at.y() * 7 + at.x()] = Vec3::new(r, g, b);
            },
        )
        .expect("an EXR file");
        assert_eq!(read.layer_data.channel_data.pixels, film.pixels);
        let software = read.layer_data.attributes.software_name.expect("who wrote it");
        assert!(software.to_string().starts_with("tracer "), "{software}");
    }

    #[test]
    fn png_holds_srgb() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a.PNG");
        let film = Film {
            width: 2,
            height: 1,
            pixels: vec![Vec3::new(0.25, 0.0, 9.0), Vec3::new(f32::NAN, -1.0, 0.000_5)],
        };
        film.save(&path, Display { exposure: 1.0, tone: Tone::None }).expect("written");
        let bytes = fs::read(&path).expect("just written");
        let read = image::load_from_memory_with_format(&bytes, image::ImageFormat::Png);
        let read = read.expect("a PNG file").to_rgb8();
        // 1.055 · 0.5^(1/2.4) − 0.055 = 0.7354; 12.92 · 0.001 = 0.0129.
        assert_eq!(read.into_raw(), [188, 0, 255, 0, 0, 3]);
    }

    #[test]
    fn tone_curves_keep_black_and_grey_order_and_end_at_white() {
        for tone in [Tone::None, Tone::Neutral, Tone::Agx] {
            let map = |x: f32| Display { exposure: 0.0, tone }.apply(Vec3::splat(x));
            assert!(map(0.0).max_element() < 1e-3, "{tone:?}: {}", map(0.0));
            let bright = map(1e6).clamp(Vec3::ZERO, Vec3::ONE);
            assert!(bright.min_element() > 0.97, "{tone:?}: {bright}");
            let greys: Vec<f32> = (0..400).map(|i| map(i as f32 * 0.01).y).collect();
            assert!(greys.is_sorted(), "{tone:?}");
        }
        // The specification's intent: a base colour is displayed as it is.
        let colour = neutral(Vec3::new(0.5, 0.2, 0.1) + 0.04);
        assert!((colour - Vec3::new(0.5, 0.2, 0.1)).length() < 1e-6, "{colour}");
    }

    #[test]
    fn failed_write_leaves_the_old_file_and_no_other() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("taken.png");
        fs::create_dir(&path).expect("a folder");
        fs::write(path.join("old"), "old").expect("a file in it");
        let error = gradient().save(&path, Display::default()).expect_err("a folder is there");
        assert!(format!("{error:#}").contains("taken.png is a folder"), "{error:#}");
        assert_eq!(fs::read(path.join("old")).expect("still there"), b"old");
        // More than a file's name may have, which only writing it finds.
        let long = folder.path().join(format!("{}.png", "a".repeat(300)));
        let error = gradient().save(&long, Display::default()).expect_err("too long a name");
        assert!(format!("{error:#}").starts_with("writing "), "{error:#}");
        assert_eq!(fs::read_dir(folder.path()).expect("readable").count(), 1, "leftovers");
        // An image that cannot be encoded does not touch the old one.
        let path = folder.path().join("a.png");
        gradient().save(&path, Display::default()).expect("written");
        let before = fs::read(&path).expect("readable");
        let empty = Film { width: 0, height: 0, pixels: Vec::new() };
        empty.save(&path, Display::default()).expect_err("no pixels");
        assert_eq!(fs::read(&path).expect("readable"), before);
    }

    #[test]
    fn wrong_names_are_refused_with_a_remedy() {
        let message = |path: &str| Format::of(Path::new(path)).expect_err(path).to_string();
        assert_eq!(message("a.jpg"), "a.jpg: name it .png or .exr");
        assert_eq!(message("a"), "a: name it .png or .exr");
        assert_eq!(
            message("no/such/folder/a.png"),
            "no/such/folder/a.png: the folder no/such/folder does not exist"
        );
        assert_eq!(message("."), ". is a folder: name a .png or .exr in it");
        assert_eq!(Format::of(Path::new("a.exr")).expect("here"), Format::Exr);
    }
}
