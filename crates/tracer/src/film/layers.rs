//! OpenEXR files: radiance, and beside it in layers what compositing needs.

use super::Film;
use crate::whitted::First;
use anyhow::Context as _;
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Image, IntegerBounds, Layer,
    LayerAttributes, Text, WritableImage as _,
};
use glam::{DMat4, Vec2, Vec3};
use std::io::Cursor;

/// What each pixel's centre shows, rows from the top; `None` where there is no
/// surface.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Layers {
    pub(crate) pixels: Vec<Option<First>>,
}

/// Of which picture a film is a part, in pixels: how large that is, and how far from its
/// left and its top the film starts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Window {
    pub(crate) whole: [usize; 2],
    pub(crate) at: [usize; 2],
}

/// What a file says of how it was made. The same picture has the same: no times.
#[derive(Clone, Debug, Default)]
pub(crate) struct Metadata {
    pub(crate) camera: String,
    /// World to camera.
    pub(crate) view: DMat4,
    /// Vertical, radians; `None` if the projection is parallel.
    pub(crate) yfov: Option<f64>,
    /// Camera rays per pixel.
    pub(crate) samples: u32,
    /// The part that it is, if it is not the whole.
    pub(crate) window: Option<Window>,
    /// The options, as one JSON object.
    pub(crate) settings: String,
}

/// What comes before the settings in a file's comment.
const SETTINGS: &str = "\nsettings: ";

impl Metadata {
    /// Lines of a file's comment.
    pub(super) fn comment(&self) -> String {
        // The settings are the one line that is read back.
        let camera = self.camera.replace(char::is_control, " ");
        format!("camera: {camera}{SETTINGS}{}", self.settings)
    }

    /// The same in characters that OpenEXR's text has, one byte each: others are escaped in
    /// the settings, as JSON has it, and `?` in the camera's name.
    fn latin_comment(&self) -> String {
        let camera = self.camera.replace(|c: char| c > '\u{ff}', "?");
        Self { camera, settings: ascii(&self.settings), ..self.clone() }.comment()
    }

    /// The settings in a comment, if it has any.
    pub(super) fn settings_in(comment: &str) -> Option<&str> {
        Some(comment.split_once(SETTINGS)?.1.lines().next().unwrap_or_default())
    }
}

impl Film {
    /// The picture as an OpenEXR file: channels `R`, `G`, `B` and, with `layers`,
    /// `albedo.R…`, `N.X…` (unit normals), `P.X…` (positions, metres), `Z` (depth
    /// along the camera's axis, metres, infinite without a surface), `id` (mesh
    /// numbers from 1), `wct-uv.U`, `wct-uv.V` (places on wavelet patches) and
    /// `wct-error` (relative RMS error of the patch's radiance, as its file says), these
    /// three −1 off patches.
    ///
    /// A crop is the data window, in the display window of the whole picture.
    ///
    /// # Errors
    ///
    /// If the picture has no pixels.
    pub(super) fn exr(
        &self,
        layers: Option<&Layers>,
        metadata: Option<&Metadata>,
    ) -> anyhow::Result<Vec<u8>> {
        let mut channels = vec3s("", ["R", "G", "B"], &self.pixels);
        if let Some(Layers { pixels }) = layers {
            let vectors = |of: fn(&First) -> Vec3| -> Vec<Vec3> {
                pixels.iter().map(|p| p.as_ref().map_or(Vec3::ZERO, of)).collect()
            };
            channels.extend(vec3s("albedo.", ["R", "G", "B"], &vectors(|p| p.albedo)));
            channels.extend(vec3s("N.", ["X", "Y", "Z"], &vectors(|p| p.normal)));
            channels.extend(vec3s("P.", ["X", "Y", "Z"], &vectors(|p| p.position)));
            let depth = pixels.iter().map(|p| p.map_or(f32::INFINITY, |p| p.depth)).collect();
            channels.push(AnyChannel::new("Z", FlatSamples::F32(depth)));
            let object = pixels.iter().map(|p| p.map_or(0, |p| p.object)).collect();
            channels.push(AnyChannel::new("id", FlatSamples::U32(object)));
            let uv = |p: &Option<First>| p.and_then(|p| p.wct_uv).unwrap_or(Vec2::NEG_ONE);
            let (u, v) = pixels.iter().map(|p| uv(p).into()).unzip::<f32, f32, Vec<_>, Vec<_>>();
            channels.push(AnyChannel::new("wct-uv.U", FlatSamples::F32(u)));
            channels.push(AnyChannel::new("wct-uv.V", FlatSamples::F32(v)));
            let error = |p: &Option<First>| p.and_then(|p| p.wct_error).unwrap_or(-1.0);
            let error = FlatSamples::F32(pixels.iter().map(error).collect());
            channels.push(AnyChannel::new("wct-error", error));
        }
        let mut attributes = attributes(metadata)?;
        let size = (self.width, self.height);
        let channels = AnyChannels::sort(channels.into());
        let window = metadata.and_then(|metadata| metadata.window);
        let vec2 =
            |[x, y]: [usize; 2]| anyhow::Ok(exr::math::Vec2(i32::try_from(x)?, i32::try_from(y)?));
        if let Some(window) = window {
            attributes.layer_position = vec2(window.at)?;
        }
        let layer = Layer::new(size, attributes, Encoding::SMALL_LOSSLESS, channels);
        let mut file = Cursor::new(Vec::new());
        // One thread: several write their blocks in the order they finish.
        let mut image = Image::from_layer(layer);
        if let Some(Window { whole: [width, height], .. }) = window {
            image.attributes.display_window = IntegerBounds::from_dimensions((width, height));
        }
        image.write().non_parallel().to_buffered(&mut file)?;
        Ok(file.into_inner())
    }
}

fn vec3s(layer: &str, names: [&str; 3], pixels: &[Vec3]) -> Vec<AnyChannel<FlatSamples>> {
    let channel = |i: usize| {
        let samples = FlatSamples::F32(pixels.iter().map(|p| p[i]).collect());
        AnyChannel::new(format!("{layer}{}", names[i]).as_str(), samples)
    };
    (0..3).map(channel).collect()
}

fn attributes(metadata: Option<&Metadata>) -> anyhow::Result<LayerAttributes> {
    let software = concat!("tracer ", env!("CARGO_PKG_VERSION"));
    let mut comments = "radiance in W m^-2 sr^-1, linear Rec. 709".to_owned();
    let mut attributes =
        LayerAttributes { software_name: Some(Text::from(software)), ..LayerAttributes::default() };
    if let Some(metadata) = metadata {
        comments.push('\n');
        comments.push_str(&metadata.latin_comment());
        // Of several in this map the order in the file would differ from run to run.
        let samples = i32::try_from(metadata.samples).context("too many samples")?;
        attributes.other = [("samplesPerPixel".into(), AttributeValue::I32(samples))].into();
        // OpenEXR multiplies row vectors from the left: the transpose, by rows.
        attributes.world_to_camera = Some(metadata.view.as_mat4().to_cols_array());
        attributes.vertical_field_of_view = metadata.yfov.map(|f| f.to_degrees() as f32);
    }
    let comments = Text::new_or_none(&comments);
    attributes.comments = comments.or_else(|| Some(Text::from("linear Rec. 709")));
    Ok(attributes)
}

/// JSON with all beyond ASCII, which is in strings, as escapes.
fn ascii(json: &str) -> String {
    let mut text = String::with_capacity(json.len());
    for c in json.chars() {
        if c.is_ascii() {
            text.push(c);
        } else {
            for unit in c.encode_utf16(&mut [0; 2]) {
                text.push_str(&format!("\\u{unit:04x}"));
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::super::Display;
    use super::*;
    use exr::prelude::{ReadChannels as _, ReadLayers as _};

    #[test]
    fn layers_have_the_usual_names_and_their_values() {
        let first = First {
            albedo: Vec3::new(0.1, 0.2, 0.3),
            normal: Vec3::Y,
            position: Vec3::new(1.0, 2.0, 3.0),
            depth: 4.0,
            object: 7,
            wct_uv: Some(Vec2::new(0.25, 0.75)),
            wct_error: Some(0.125),
        };
        let film = Film { width: 2, height: 1, pixels: vec![Vec3::ONE, Vec3::ZERO] };
        let layers = Layers { pixels: vec![Some(first), None] };
        let metadata = Metadata {
            camera: "nave".to_owned(),
            view: DMat4::from_translation(glam::DVec3::new(5.0, 0.0, 0.0)),
            yfov: Some(std::f64::consts::FRAC_PI_2),
            samples: 16,
            window: Some(Window { whole: [9, 6], at: [4, 5] }),
            settings: "{}".to_owned(),
        };
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a.exr");
        let save = || film.save_with(&path, Display::default(), Some(&layers), Some(&metadata));
        save().expect("written");
        let bytes = std::fs::read(&path).expect("just written");
        save().expect("written again");
        assert!(std::fs::read(&path).expect("readable") == bytes, "other bytes");
        let image = exr::prelude::read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_file(&path)
            .expect("an EXR file");
        let attributes = &image.layer_data.attributes;
        assert!(attributes.comments.as_ref().expect("some").to_string().contains("camera: nave"));
        assert_eq!(attributes.vertical_field_of_view, Some(90.0));
        assert_eq!(attributes.world_to_camera.expect("there")[12], 5.0);
        let channels = &image.layer_data.channel_data.list;
        let values = |name: &str| -> Vec<f32> {
            let channel = channels.iter().find(|c| c.name.to_string() == name);
            channel.expect(name).sample_data.values_as_f32().collect()
        };
        assert_eq!(attributes.layer_position, exr::math::Vec2(4, 5));
        let display = image.attributes.display_window;
        assert_eq!(display, IntegerBounds::from_dimensions((9, 6)));
        assert_eq!(Film::open(&path).expect("a crop is read as it is"), film);
        let settings = super::super::Format::Exr.settings_of(&path).expect("readable");
        assert_eq!(settings.as_deref(), Some("{}"));
        assert_eq!(channels.len(), 17);
        assert_eq!(values("wct-error"), [0.125, -1.0]);
        assert_eq!(values("G"), [1.0, 0.0]);
        assert_eq!(values("albedo.B"), [0.3, 0.0]);
        assert_eq!(values("N.Y"), [1.0, 0.0]);
        assert_eq!(values("P.Z"), [3.0, 0.0]);
        assert_eq!(values("Z"), [4.0, f32::INFINITY]);
        assert_eq!(values("id"), [7.0, 0.0]);
        assert_eq!(values("wct-uv.V"), [0.75, -1.0]);
    }
}
