//! What `render` and `fly` share: a scene with its radiance, ready for cameras.

use crate::accel::Accel;
use crate::cli;
use crate::film::{Display, Film, Tone};
use crate::render::{RenderOptions, RenderStats, render};
use crate::scene::{Camera, Scene, surfaces};
use crate::wct_texture::WctTexture;
use crate::whitted::PatchRadiance;
use anyhow::Context as _;
use glam::Vec3;
use std::path::Path;
use wrt_core::WctFile;

/// A scene to look at.
pub(super) struct Stage<'a> {
    pub(super) scene: Scene,
    accel: Accel,
    /// `None` where nothing emits or nothing receives.
    texture: Option<WctTexture>,
    view: &'a cli::View,
}

impl<'a> Stage<'a> {
    /// Loads the scene and its radiance, or bakes that.
    pub(super) fn open(path: &Path, view: &'a cli::View) -> anyhow::Result<Self> {
        let mut scene = super::load(path)?;
        super::light_windows(&mut scene, &view.weather)
            .with_context(|| format!("{}", path.display()))?;
        let texture = match &view.wct {
            Some(path) => WctFile::read(path)
                .map_err(anyhow::Error::from)
                .and_then(|file| WctTexture::bind(&file.patches, &scene))
                .map(Some)
                .with_context(|| format!("{}", path.display()))?,
            None if surfaces::emitters(&scene).is_empty()
                || surfaces::receivers(&scene).is_empty() =>
            {
                eprintln!("tracer: nothing to bake: no surface emits, or none receives");
                None
            }
            None => {
                eprintln!("tracer: no --wct given: baking in memory first");
                let options = super::bake::options(&cli::Accuracy::default());
                let baked = super::bake::baked(&scene, &options, view.threads)
                    .with_context(|| format!("baking {}", path.display()))?;
                Some(WctTexture::bind(&baked.patches, &scene)?)
            }
        };
        Ok(Self { accel: Accel::new(&scene), scene, texture, view })
    }

    /// What `camera` sees; `progress` is called after each row.
    pub(super) fn render(
        &self,
        camera: &Camera,
        progress: &(dyn Fn() + Sync),
    ) -> anyhow::Result<(Film, RenderStats)> {
        let (width, height) = self.size(camera);
        let options = RenderOptions {
            width,
            height,
            samples: self.view.samples,
            max_depth: self.view.depth,
            emitter_grid: self.view.emitter_grid as usize,
            threads: self.view.threads,
            seed: self.view.seed,
            background: Vec3::ZERO,
        };
        let patches = self.texture.as_ref().map(|texture| texture as &dyn PatchRadiance);
        render(&self.scene, &self.accel, patches, camera, &options, progress)
    }

    /// Pixels across and down.
    pub(super) fn size(&self, camera: &Camera) -> (usize, usize) {
        const WIDTH: usize = 960;
        let aspect = camera.aspect.unwrap_or(4.0 / 3.0);
        let height = (WIDTH as f64 / aspect).round().clamp(1.0, 16.0 * WIDTH as f64);
        self.view.size.unwrap_or((WIDTH, height as usize))
    }

    /// How a `.png` shows it.
    pub(super) fn display(&self) -> Display {
        let tone = match self.view.tone {
            cli::Tone::None => Tone::None,
            cli::Tone::Neutral => Tone::Neutral,
            cli::Tone::Agx => Tone::Agx,
        };
        Display { exposure: self.view.exposure, tone }
    }

    /// How many surfaces have wavelet radiance.
    pub(super) fn patches(&self) -> usize {
        self.texture.as_ref().map_or(0, WctTexture::len)
    }
}

/// The one of that name among `all`, or the first; an error names them all.
pub(super) fn named<'a, T>(
    all: &'a [T],
    name: Option<&str>,
    name_of: impl Fn(&T) -> &str,
    what: &str,
) -> anyhow::Result<&'a T> {
    let found = match name {
        Some(name) => all.iter().find(|item| name_of(item) == name),
        None => all.first(),
    };
    found.with_context(|| {
        let names: Vec<&str> = all.iter().map(name_of).collect();
        match (name, names.is_empty()) {
            (_, true) => format!("the scene has no {what}"),
            (name, false) => format!(
                "no {what} named \"{}\"; there are: {}",
                name.unwrap_or_default(),
                names.join(", ")
            ),
        }
    })
}
