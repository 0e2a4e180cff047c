//! Image files as linear texels, and look-ups in them.
//!
//! Texel centres are at half-integers; row 0 is at v = 0, glTF's top. An image is
//! kept with its mip levels, each texel the mean of four of the level before, so
//! that a look-up over a footprint costs little more than one at a point.

use anyhow::Context as _;
use glam::{DVec4, Vec2, Vec4};
use image::{DynamicImage, ImageReader};
use std::io::Cursor;
use std::sync::{Arc, LazyLock};

/// The most look-ups along the longer axis of a footprint.
const MAX_ANISOTROPY: f32 = 16.0;

/// What the numbers of an 8-bit image are. Alpha is linear in either.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Encoding {
    /// Colours, by the transfer function of IEC 61966-2-1.
    Srgb,
    /// Numbers as they stand: normals, roughness, occlusion.
    Linear,
}

/// What a texture shows beyond [0, 1].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) enum Wrap {
    #[default]
    Repeat,
    /// Repeats, every other time backwards.
    Mirror,
    /// Its border.
    Clamp,
}

impl Wrap {
    /// The texel of 0 to n − 1 that stands at `i`.
    fn index(self, i: i64, n: usize) -> usize {
        let n = n as i64;
        let wrapped = match self {
            Self::Repeat => i.rem_euclid(n),
            Self::Mirror => {
                let i = i.rem_euclid(2 * n);
                if i < n { i } else { 2 * n - 1 - i }
            }
            Self::Clamp => i.clamp(0, n - 1),
        };
        wrapped as usize
    }
}

/// An image with a sampler. Copies share their texels.
#[derive(Clone, Debug)]
pub(crate) struct Texture {
    image: Arc<Image>,
    /// Along u and v.
    pub(crate) wrap: [Wrap; 2],
    /// Shows texels as squares when seen from near.
    pub(crate) nearest: bool,
}

/// Mip levels, the finest first; each has a texel at least.
#[derive(Debug)]
struct Image {
    levels: Vec<Level>,
    opaque: bool,
}

#[derive(Debug)]
struct Level {
    width: usize,
    height: usize,
    texels: Texels,
}

#[derive(Debug)]
enum Texels {
    Bytes(Vec<[u8; 4]>, Encoding),
    Floats(Vec<Vec4>),
}

impl Level {
    fn texel(&self, x: usize, y: usize) -> Vec4 {
        let i = y * self.width + x;
        match &self.texels {
            Texels::Floats(texels) => texels[i],
            Texels::Bytes(texels, encoding) => {
                let [r, g, b, a] = texels[i];
                let linear = f32::from(a) / 255.0;
                match encoding {
                    Encoding::Linear => Vec4::new(r.into(), g.into(), b.into(), 0.0) / 255.0,
                    Encoding::Srgb => {
                        let [r, g, b] = [r, g, b].map(|c| SRGB[usize::from(c)]);
                        Vec4::new(r, g, b, 0.0)
                    }
                }
                .with_w(linear)
            }
        }
    }

    fn bilinear(&self, uv: Vec2, wrap: [Wrap; 2]) -> Vec4 {
        let size = Vec2::new(self.width as f32, self.height as f32);
        let at = uv * size - 0.5;
        let below = at.floor();
        let [s, t] = (at - below).to_array();
        // A cast from a float saturates: no coordinate is out of reach.
        let (x, y) = (i64::from(below.x as i32), i64::from(below.y as i32));
        let texel = |x: i64, y: i64| {
            self.texel(wrap[0].index(x, self.width), wrap[1].index(y, self.height))
        };
        let top = texel(x, y).lerp(texel(x + 1, y), s);
        let bottom = texel(x, y + 1).lerp(texel(x + 1, y + 1), s);
        top.lerp(bottom, t)
    }

    fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let texel = |x: usize, y: usize| self.texel(x.min(self.width - 1), y.min(self.height - 1));
        let mean = |i: usize| {
            let (x, y) = (2 * (i % width), 2 * (i / width));
            0.25 * (texel(x, y) + texel(x + 1, y) + texel(x, y + 1) + texel(x + 1, y + 1))
        };
        Self { width, height, texels: Texels::Floats((0..width * height).map(mean).collect()) }
    }
}

impl Texture {
    /// Decodes a PNG or JPEG.
    ///
    /// # Errors
    ///
    /// If `bytes` are neither, or are damaged.
    pub(super) fn decode(bytes: &[u8], encoding: Encoding) -> anyhow::Result<Self> {
        let picture = open(bytes)?;
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        let texels = match picture {
            DynamicImage::ImageLuma16(_)
            | DynamicImage::ImageLumaA16(_)
            | DynamicImage::ImageRgb16(_)
            | DynamicImage::ImageRgba16(_) => {
                let linear = |c: f32| match encoding {
                    Encoding::Srgb => srgb_to_linear(c),
                    Encoding::Linear => c,
                };
                let texel = |p: &image::Rgba<f32>| {
                    let [r, g, b, a] = p.0;
                    Vec4::new(linear(r), linear(g), linear(b), a)
                };
                Texels::Floats(picture.into_rgba32f().pixels().map(texel).collect())
            }
            _ => Texels::Bytes(picture.into_rgba8().pixels().map(|p| p.0).collect(), encoding),
        };
        Ok(Self::new(Level { width, height, texels }))
    }

    /// A texture of linear `texels`, rows from the top, that repeats.
    ///
    /// # Panics
    ///
    /// If there are not `width` · `height` of them, or none.
    #[cfg(test)]
    pub(crate) fn from_texels(width: usize, height: usize, texels: Vec<Vec4>) -> Self {
        assert!(texels.len() == width * height && !texels.is_empty(), "{} texels", texels.len());
        Self::new(Level { width, height, texels: Texels::Floats(texels) })
    }

    fn new(finest: Level) -> Self {
        let opaque = match &finest.texels {
            Texels::Bytes(texels, _) => texels.iter().all(|t| t[3] == 255),
            Texels::Floats(texels) => texels.iter().all(|t| t.w == 1.0),
        };
        let coarser = |level: &Level| (level.width.max(level.height) > 1).then(|| level.halved());
        let mut levels = vec![finest];
        while let Some(next) = levels.last().and_then(coarser) {
            levels.push(next);
        }
        Self { image: Arc::new(Image { levels, opaque }), wrap: [Wrap::Repeat; 2], nearest: false }
    }

    /// Texels across and down, at least one.
    pub(crate) fn size(&self) -> (usize, usize) {
        let finest = &self.image.levels[0];
        (finest.width, finest.height)
    }

    /// Whether alpha is 1 everywhere.
    pub(crate) fn is_opaque(&self) -> bool {
        self.image.opaque
    }

    /// The mean of all texels.
    pub(crate) fn mean(&self) -> Vec4 {
        let finest = &self.image.levels[0];
        // In f64: a large texture has more texels than f32 has whole numbers.
        let row = |y| (0..finest.width).map(|x| finest.texel(x, y).as_dvec4()).sum::<DVec4>();
        let sum: DVec4 = (0..finest.height).map(row).sum();
        (sum / (finest.width * finest.height) as f64).as_vec4()
    }

    /// The texel that holds `uv`.
    pub(crate) fn nearest(&self, uv: Vec2) -> Vec4 {
        let finest = &self.image.levels[0];
        let at = |x: f32, n: usize, wrap: Wrap| wrap.index((x * n as f32).floor() as i64, n);
        finest.texel(at(uv.x, finest.width, self.wrap[0]), at(uv.y, finest.height, self.wrap[1]))
    }

    /// The texture at a point: between the four texels about it, or the one that
    /// holds it.
    pub(crate) fn at(&self, uv: Vec2) -> Vec4 {
        if self.nearest { self.nearest(uv) } else { self.image.levels[0].bilinear(uv, self.wrap) }
    }

    /// The texture's mean over about the parallelogram that `across` and `down`,
    /// in texture coordinates, span about `uv`.
    ///
    /// Look-ups along its longer side, each at the mip level where a texel has
    /// the shorter side's size (J. McCormack et al., *Feline: Fast Elliptical
    /// Lines for Anisotropic Texture Mapping*, SIGGRAPH 1999, simplified).
    pub(crate) fn over(&self, uv: Vec2, [across, down]: [Vec2; 2]) -> Vec4 {
        let (width, height) = self.size();
        let size = Vec2::new(width as f32, height as f32);
        let lengths = [(across * size).length(), (down * size).length()];
        let (long, along) =
            if lengths[0] > lengths[1] { (lengths[0], across) } else { (lengths[1], down) };
        if long.is_nan() || long <= 1.0 {
            return self.at(uv);
        }
        if !long.is_finite() {
            return self.trilinear(uv, f32::INFINITY);
        }
        let area = (across * size).perp_dot(down * size).abs();
        let short = (area / long).max(long / MAX_ANISOTROPY).max(1.0);
        let steps = (long / short).clamp(1.0, MAX_ANISOTROPY).ceil();
        let level = short.log2();
        let sum: Vec4 = (0..steps as u32)
            .map(|i| self.trilinear(uv + ((i as f32 + 0.5) / steps - 0.5) * along, level))
            .sum();
        sum / steps
    }

    fn trilinear(&self, uv: Vec2, level: f32) -> Vec4 {
        let levels = &self.image.levels;
        let last = levels.len() - 1;
        let level = level.clamp(0.0, last as f32);
        let finer = (level as usize).min(last);
        let near = levels[finer].bilinear(uv, self.wrap);
        let t = level - finer as f32;
        if t == 0.0 { near } else { near.lerp(levels[finer + 1].bilinear(uv, self.wrap), t) }
    }
}

fn open(bytes: &[u8]) -> anyhow::Result<DynamicImage> {
    let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format()?;
    anyhow::ensure!(reader.format().is_some(), "neither PNG nor JPEG: convert it to one of them");
    let picture = reader.decode().context("damaged PNG or JPEG")?;
    anyhow::ensure!(picture.width() > 0 && picture.height() > 0, "the image has no pixels");
    Ok(picture)
}

static SRGB: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|i| srgb_to_linear(i as f32 / 255.0)));

/// The sRGB transfer function, IEC 61966-2-1.
pub(crate) fn srgb_to_linear(c: f32) -> f32 {
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

    fn greys(width: usize, height: usize, texels: &[f32]) -> Texture {
        let texels = texels.iter().map(|&x| Vec4::splat(x).with_w(1.0)).collect();
        Texture::from_texels(width, height, texels)
    }

    #[test]
    fn colours_are_made_linear_and_numbers_are_not() {
        let bytes = png(&[[0, 255, 188], [10, 0, 0]]);
        let texture = Texture::decode(&bytes, Encoding::Srgb).expect("a valid PNG");
        assert_eq!(texture.size(), (2, 1));
        assert!(texture.is_opaque(), "no alpha in the file");
        let (a, b) = (texture.nearest(Vec2::ZERO), texture.nearest(Vec2::new(0.9, 0.0)));
        assert_eq!((a.x, a.y, a.w), (0.0, 1.0, 1.0));
        // sRGB 188 is the grey that looks half as bright: 0.5 within one step.
        assert!((a.z - 0.5).abs() < 0.005, "{a}");
        // The linear toe: 10 / 255 / 12.92.
        assert!((b.x - 10.0 / 255.0 / 12.92).abs() < 1e-7, "{b}");
        let numbers = Texture::decode(&bytes, Encoding::Linear).expect("a valid PNG");
        assert_eq!(numbers.nearest(Vec2::ZERO).z, 188.0 / 255.0);
        assert_eq!(numbers.mean().y, 0.5);
    }

    #[test]
    fn sixteen_bits_agree_with_eight() {
        let deep = image::ImageBuffer::<image::Rgb<u16>, _>::from_raw(1, 1, vec![0x8080_u16; 3]);
        let mut bytes = Cursor::new(Vec::new());
        let deep = deep.expect("one texel");
        deep.write_to(&mut bytes, image::ImageFormat::Png).expect("PNG to memory");
        for encoding in [Encoding::Srgb, Encoding::Linear] {
            let at = |bytes: &[u8]| {
                Texture::decode(bytes, encoding).expect("a valid PNG").nearest(Vec2::ZERO)
            };
            let (deep, shallow) = (at(bytes.get_ref()), at(&png(&[[0x80; 3]])));
            assert!((deep - shallow).length() < 1e-6, "{deep} {shallow}");
        }
    }

    #[test]
    fn damaged_and_foreign_images_are_errors() {
        let whole = png(&[[1, 2, 3]; 9]);
        for len in 0..whole.len() - 12 {
            let decoded = Texture::decode(&whole[..len], Encoding::Srgb);
            assert!(decoded.is_err(), "{len} bytes of {}", whole.len());
        }
        let error = Texture::decode(b"RIFF....WEBPVP8 ", Encoding::Srgb).expect_err("no WebP");
        assert!(format!("{error:#}").contains("PNG"), "{error:#}");
    }

    #[test]
    fn look_ups_interpolate_between_texel_centres_and_wrap_as_asked() {
        let mut texture = greys(2, 2, &[0.0, 1.0, 2.0, 3.0]);
        let at = |texture: &Texture, u, v| texture.at(Vec2::new(u, v)).x;
        assert_eq!(at(&texture, 0.25, 0.25), 0.0);
        assert_eq!(at(&texture, 0.75, 0.25), 1.0);
        assert_eq!(at(&texture, 0.25, 0.75), 2.0);
        assert_eq!(at(&texture, 0.5, 0.5), 1.5);
        assert_eq!(at(&texture, -1.75, 4.25), 0.0, "repeats");
        assert_eq!(at(&texture, 0.0, 0.25), 0.5, "half way round the seam");
        texture.wrap = [Wrap::Mirror, Wrap::Clamp];
        assert_eq!(at(&texture, 0.0, 0.25), 0.0, "the border meets itself");
        assert_eq!(at(&texture, 1.25, 0.25), 1.0, "runs back");
        assert_eq!(at(&texture, 2.25, 0.25), 0.0, "and forth");
        assert_eq!(at(&texture, 0.25, -7.0), 0.0, "the upper border");
        assert_eq!(at(&texture, 0.25, 1e30), 2.0, "the lower border");
        texture.nearest = true;
        assert_eq!(at(&texture, 0.4, 0.4), 0.0, "no interpolation");
    }

    #[test]
    fn a_footprint_of_the_whole_texture_sees_its_mean() {
        let texels: Vec<f32> = (0..64 * 64).map(|i| ((i * 7919) % 251) as f32).collect();
        let texture = greys(64, 64, &texels);
        let mean = texture.mean().x;
        for side in [1.0, 4.0, 1e9, 1e30] {
            let seen = texture.over(Vec2::splat(0.3), [Vec2::X * side, Vec2::Y * side]).x;
            assert!((seen / mean - 1.0).abs() < 1e-3, "side {side}: {seen} of {mean}");
        }
        // None at all, and less than a texel: the point itself.
        let point = texture.at(Vec2::splat(0.3)).x;
        for side in [0.0, 0.01, f32::NAN] {
            let seen = texture.over(Vec2::splat(0.3), [Vec2::X * side, Vec2::Y * side]).x;
            assert_eq!(seen, point, "side {side}");
        }
    }

    /// Stripes across v: a footprint along u keeps them, one along v blurs them.
    #[test]
    fn a_long_footprint_blurs_along_itself_only() {
        let texels: Vec<f32> = (0..64 * 64).map(|i| f32::from((i / 64 % 8 < 4) as u8)).collect();
        let texture = greys(64, 64, &texels);
        let uv = Vec2::new(0.5, 2.0 / 64.0);
        let along = texture.over(uv, [Vec2::X * 0.25, Vec2::Y / 64.0]).x;
        assert!(along > 0.99, "{along}");
        let across = texture.over(uv, [Vec2::X / 64.0, Vec2::Y * 0.25]).x;
        assert!((across - 0.5).abs() < 0.05, "{across}");
    }
}
