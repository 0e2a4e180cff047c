//! What `render` and `fly` share: a scene with its radiance, ready for cameras.

use crate::accel::Accel;
use crate::bake::{Flight, fingerprint, hash_of};
use crate::cli;
use crate::emitters::MANY;
use crate::film::{Display, Film, Format, Layers, Metadata, Tone, Window};
use crate::reference::{Estimate, Lighting, ReferenceOptions, Target, render_reference};
use crate::render::{Crop, RenderOptions, RenderStats, layers, render};
use crate::scene::{Animation, Camera, Loaded, Moved, Projection, Scene, flight, surfaces};
use crate::wct_texture::WctTexture;
use crate::whitted::PatchRadiance;
use anyhow::{Context as _, ensure};
use cpu_time::ProcessTime;
use glam::{DMat4, Vec3};
use indicatif::ProgressBar;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;
use wrt_core::WctFile;

/// A scene to look at.
pub(super) struct Stage<'a> {
    pub(super) scene: Scene,
    accel: Accel,
    /// `None` where nothing emits or nothing receives.
    texture: Option<WctTexture>,
    view: &'a cli::View,
    path: PathBuf,
    stop: &'static AtomicBool,
    /// Of the scene's files and of the `.wct`.
    contents: [Option<String>; 2],
    /// The animation, and the second of it that is shown.
    moment: Option<(String, f64)>,
    /// What the radiance was baked for, if not for all views; taken when a camera that
    /// sees more has been told of.
    flight: Mutex<Option<Flight>>,
}

/// One picture, rendered as far as it was wanted.
pub(super) struct Picture {
    film: Film,
    layers: Option<Layers>,
    metadata: Metadata,
    pub(super) stats: RenderStats,
}

impl Picture {
    /// Whether all of it is there.
    pub(super) fn is_whole(&self) -> bool {
        self.stats.rows_left == 0
    }

    /// Writes what there is beside `path`, as `name.partial.png`, and returns where:
    /// `path` itself may hold a whole picture from before.
    pub(super) fn save_partial(&self, path: &Path, display: Display) -> anyhow::Result<PathBuf> {
        let partial = partial(path);
        self.save(&partial, display)?;
        Ok(partial)
    }

    /// Writes it to `path`.
    pub(super) fn save(&self, path: &Path, display: Display) -> anyhow::Result<()> {
        self.film.save_with(path, display, self.layers.as_ref(), Some(&self.metadata))
    }
}

impl<'a> Stage<'a> {
    /// Loads the scene and its radiance, or bakes that, once `check` has found what is to
    /// be seen in it.
    pub(super) fn open(
        path: &Path,
        view: &'a cli::View,
        check: impl FnOnce(&Scene) -> anyhow::Result<()>,
    ) -> anyhow::Result<Self> {
        let (scene, files) = lit(path, view, check)?;
        let accel = Accel::new(&scene);
        let mut flight = None;
        let texture = match &view.wct {
            Some(path) => WctFile::read(path)
                .map_err(anyhow::Error::from)
                .and_then(|file| {
                    warn_of_another_bake(&file, &scene, path);
                    flight = baked_for(&file, &scene, path);
                    WctTexture::bind(&file.patches, &file.smooth, &scene)
                })
                .map(Some)
                .with_context(|| format!("{}", path.display()))?,
            None => baked_in_memory(&scene, &accel, view.threads)
                .with_context(|| format!("baking {}", path.display()))?,
        };
        Ok(Self::of(path, view, (scene, &files), accel, (texture, flight)))
    }

    /// Loads the scene to be rendered without wavelets, as [`open`](Self::open) does.
    pub(super) fn without_radiance(
        path: &Path,
        view: &'a cli::View,
        check: impl FnOnce(&Scene) -> anyhow::Result<()>,
    ) -> anyhow::Result<Self> {
        let (scene, files) = lit(path, view, check)?;
        let accel = Accel::new(&scene);
        Ok(Self::of(path, view, (scene, &files), accel, (None, None)))
    }

    fn of(
        path: &Path,
        view: &'a cli::View,
        (scene, files): (Scene, &[PathBuf]),
        accel: Accel,
        (texture, flight): (Option<WctTexture>, Option<Flight>),
    ) -> Self {
        Self {
            scene,
            accel,
            texture,
            view,
            path: path.to_owned(),
            stop: super::interrupt::listen(),
            contents: [content(files), content(view.wct.as_slice())],
            moment: None,
            flight: Mutex::new(flight),
        }
    }

    /// Says what of `animation` the baked radiance does not follow, and takes the patches
    /// off what moves.
    pub(super) fn let_move(&mut self, animation: &Animation) {
        let Some(texture) = &mut self.texture else { return };
        let emitters = surfaces::emitters(&self.scene);
        for mover in &animation.movers {
            let Moved::Mesh { index, .. } = mover.moved else { continue };
            let name = &self.scene.meshes[index].name;
            if texture.unbind(index) {
                eprintln!(
                    "tracer: warning: \"{name}\" moves, and the bake holds still: its baked radiance is left out, and it is lit like a surface without"
                );
            }
            if emitters.iter().any(|emitter| emitter.mesh == index) {
                eprintln!(
                    "tracer: warning: the emitter \"{name}\" moves, and the bake holds still: baked surfaces stay lit from where it is at rest"
                );
            }
        }
    }

    /// Brings what `animation` moves to where it is at a time.
    pub(super) fn pose(&mut self, animation: &Animation, seconds: f64) -> anyhow::Result<()> {
        self.moment = Some((animation.name.clone(), seconds));
        if flight::pose(animation, &mut self.scene, seconds)? {
            self.accel = Accel::new(&self.scene);
        }
        Ok(())
    }

    /// What `camera` sees, for a file of `format`; `progress` is called after each
    /// row with the rays it took.
    pub(super) fn render(
        &self,
        camera: &Camera,
        format: Format,
        progress: &(dyn Fn(u64) + Sync),
    ) -> anyhow::Result<Picture> {
        let options = self.options(camera)?;
        self.warn_of_other_view(camera, options.width as f64 / options.height as f64);
        let patches = self.texture.as_ref().map(|texture| texture as &dyn PatchRadiance);
        let (scene, accel) = (&self.scene, &self.accel);
        let (film, stats) = render(scene, accel, patches, camera, &options, progress)?;
        let layers = match format {
            Format::Png => None,
            Format::Exr => Some(layers(scene, accel, patches, camera, &options)?),
        };
        let settings = self.settings(camera, format, self.moment.as_ref());
        let metadata = metadata(camera, &options, settings);
        Ok(Picture { film, layers, metadata, stats })
    }

    /// What `camera` sees where emitters are sampled in place of patches.
    pub(super) fn render_reference(
        &self,
        camera: &Camera,
        target: Target,
        format: Format,
        progress: &(dyn Fn(u64) + Sync),
    ) -> anyhow::Result<(Picture, Estimate)> {
        let lighting = Lighting::new(&self.scene)?;
        let options = ReferenceOptions { render: self.options(camera)?, target };
        let (scene, accel) = (&self.scene, &self.accel);
        let (film, stats, estimate) =
            render_reference(scene, accel, &lighting, camera, &options, progress)?;
        let layers = match format {
            Format::Png => None,
            Format::Exr => Some(layers(scene, accel, None, camera, &options.render)?),
        };
        let mut settings = self.settings(camera, format, None);
        settings["samples"] = json!(estimate.samples);
        settings["reference"] = match target {
            Target::Samples(points) => json!({ "points": points }),
            Target::Error(error) => json!({ "error": error, "points": estimate.points }),
        };
        let sampled = RenderOptions { samples: estimate.samples, ..options.render };
        let metadata = metadata(camera, &sampled, settings);
        Ok((Picture { film, layers, metadata, stats }, estimate))
    }

    fn options(&self, camera: &Camera) -> anyhow::Result<RenderOptions> {
        let (width, height) = self.size(camera);
        Ok(RenderOptions {
            width,
            height,
            crop: crop(self.view, camera)?,
            samples: self.view.samples,
            noise: self.view.noise,
            max_depth: self.view.depth,
            emitter_grid: self.view.emitter_grid as usize,
            threads: self.view.threads,
            seed: self.view.seed,
            background: Vec3::ZERO,
            stop: Some(self.stop),
        })
    }

    /// Says so, once, where a camera sees what the radiance was not baked for.
    fn warn_of_other_view(&self, camera: &Camera, aspect: f64) {
        let mut flight = self.flight.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(own) = flight.take_if(|flight| !flight.covers(camera, aspect)) {
            eprintln!(
                "tracer: warning: baked for animation \"{}\", of which the view of camera \"{}\" is not: its light may be coarse",
                own.name(),
                camera.name
            );
        }
    }

    /// Whether Ctrl-C was pressed.
    pub(super) fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// All that the pixels of a picture of `camera` depend on, at a moment of an animation.
    pub(super) fn settings(
        &self,
        camera: &Camera,
        format: Format,
        moment: Option<&(String, f64)>,
    ) -> Value {
        let name = |path: &Path| path.file_name().map(|n| n.to_string_lossy().into_owned());
        let mut settings = json!({
            "scene": name(&self.path),
            "scene_content": self.contents[0],
            "wct": self.view.wct.as_deref().and_then(name),
            "wct_content": self.contents[1],
            "weather": self.scene.sky.as_ref().map(ToString::to_string),
            "camera": camera.name,
            "animation": moment.map(|(name, _)| name),
            "seconds": moment.map(|(_, seconds)| seconds),
            "size": self.size(camera),
            "crop": self.view.crop,
            "samples": self.view.samples,
            "noise": self.view.noise,
            "depth": self.view.depth,
            "emitter_grid": self.view.emitter_grid,
            "seed": self.view.seed,
        });
        if format == Format::Png {
            settings["exposure"] = json!(self.view.exposure);
            settings["tone"] = json!(format!("{:?}", self.view.tone).to_lowercase());
        }
        settings
    }

    /// Pixels across and down.
    pub(super) fn size(&self, camera: &Camera) -> (usize, usize) {
        size(self.view, camera)
    }

    /// How a `.png` shows it.
    pub(super) fn display(&self) -> Display {
        display(self.view.exposure, self.view.tone)
    }

    /// How many surfaces have wavelet radiance.
    pub(super) fn patches(&self) -> usize {
        self.texture.as_ref().map_or(0, WctTexture::len)
    }
}

/// The radiance of a scene without a `.wct` file; `None` where there is none to bake, or too
/// much.
fn baked_in_memory(
    scene: &Scene,
    accel: &Accel,
    threads: usize,
) -> anyhow::Result<Option<WctTexture>> {
    let emitters = surfaces::emitters(scene).len();
    if emitters == 0 || surfaces::receivers(scene).is_empty() {
        eprintln!("tracer: nothing to bake: no surface emits, or none receives");
        return Ok(None);
    }
    if emitters > MANY {
        eprintln!(
            "tracer: no --wct given, and {emitters} surfaces emit: too many to bake in memory, so their light is sampled"
        );
        return Ok(None);
    }
    eprintln!("tracer: no --wct given: baking in memory first");
    let options = super::bake::options(&cli::Accuracy::default(), false)?;
    let (baked, _) = super::bake::baked(scene, accel, &options, threads)?;
    WctTexture::bind(&baked.patches, &baked.smooth, scene).map(Some)
}

/// The scene under the weather that is asked for, once `check` has found what is to be
/// seen in it.
fn lit(
    path: &Path,
    view: &cli::View,
    check: impl FnOnce(&Scene) -> anyhow::Result<()>,
) -> anyhow::Result<(Scene, Vec<PathBuf>)> {
    let Loaded { mut scene, files, .. } = super::load_all(path)?;
    super::light_windows(&mut scene, &view.weather)
        .with_context(|| format!("{}", path.display()))?;
    if scene.meshes.iter().all(|mesh| mesh.triangles.is_empty()) {
        eprintln!("tracer: warning: {}: nothing to see: no triangles", path.display());
    } else if scene.light_default() {
        eprintln!(
            "tracer: the scene has no light: a default one shines from behind the first camera"
        );
    }
    check(&scene).with_context(|| format!("{}", path.display()))?;
    Ok((scene, files))
}

/// A hash of the files' contents, if there are any and all can be read.
fn content(paths: &[PathBuf]) -> Option<String> {
    let contents: Result<Vec<Vec<u8>>, _> = paths.iter().map(std::fs::read).collect();
    contents.ok().filter(|all| !all.is_empty()).map(|all| hash_of(all.into_iter().flatten()))
}

fn metadata(camera: &Camera, options: &RenderOptions, settings: Value) -> Metadata {
    let yfov = match camera.projection {
        Projection::Perspective { yfov } => Some(yfov),
        Projection::Orthographic { .. } => None,
    };
    let window = options
        .crop
        .map(|crop| Window { whole: [options.width, options.height], at: [crop.left, crop.top] });
    Metadata {
        camera: camera.name.clone(),
        view: DMat4::from(camera.transform.inverse()),
        yfov,
        samples: options.samples,
        window,
        settings: settings.to_string(),
    }
}

/// Width and height of the picture of `camera`: as asked for or else the camera's
/// own shape.
fn size(view: &cli::View, camera: &Camera) -> (usize, usize) {
    const WIDTH: usize = 960;
    let aspect = camera.aspect.unwrap_or(4.0 / 3.0);
    let height = (WIDTH as f64 / aspect).round().clamp(1.0, 16.0 * WIDTH as f64);
    view.size.unwrap_or((WIDTH, height as usize))
}

/// The part of the picture of `camera` that is asked for, if it is not all.
pub(super) fn crop(view: &cli::View, camera: &Camera) -> anyhow::Result<Option<Crop>> {
    let Some([x0, y0, x1, y1]) = view.crop else { return Ok(None) };
    let (width, height) = size(view, camera);
    ensure!(
        x1 <= width && y1 <= height,
        "--crop {x0},{y0},{x1},{y1} reaches past the picture of {width}x{height}"
    );
    Ok(Some(Crop { left: x0, top: y0, width: x1 - x0, height: y1 - y0 }))
}

/// Where a picture goes that was stopped before its end.
pub(super) fn partial(path: &Path) -> PathBuf {
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    path.with_extension(format!("partial.{extension}"))
}

/// What was typed, as a film takes it.
pub(super) fn display(exposure: f32, tone: cli::Tone) -> Display {
    let tone = match tone {
        cli::Tone::None => Tone::None,
        cli::Tone::Neutral => Tone::Neutral,
        cli::Tone::Agx => Tone::Agx,
    };
    Display { exposure, tone }
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

/// What pictures took, so far.
pub(super) struct Meter {
    start: Instant,
    cpu: ProcessTime,
    rays: AtomicU64,
}

impl Meter {
    pub(super) fn start() -> Self {
        Self { start: Instant::now(), cpu: ProcessTime::now(), rays: AtomicU64::new(0) }
    }

    /// Counts `rays`, and shows their rate in `bar`.
    pub(super) fn count(&self, rays: u64, bar: &ProgressBar) {
        let rays = self.rays.fetch_add(rays, Ordering::Relaxed) + rays;
        bar.set_message(format!("{:.2} Mrays/s", rays as f64 / 1e6 / self.seconds()));
    }

    /// Wall-clock seconds.
    pub(super) fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// All rays counted, in millions.
    pub(super) fn million_rays(&self) -> f64 {
        self.rays.load(Ordering::Relaxed) as f64 / 1e6
    }

    /// As JSON fields.
    pub(super) fn fields(&self) -> Value {
        json!({
            "rays": self.rays.load(Ordering::Relaxed),
            "seconds": self.seconds(),
            "cpu_seconds": self.cpu.elapsed().as_secs_f64(),
            "mrays_per_second": self.million_rays() / self.seconds(),
        })
    }
}

/// The flight that a file was baked for. Says so where the scene has it not.
fn baked_for(file: &WctFile, scene: &Scene, path: &Path) -> Option<Flight> {
    let name = file.options.get(super::ANIMATION)?;
    let margin = file.options.get(super::MARGIN).and_then(|margin| margin.parse().ok());
    Flight::new(scene, name, margin)
        .inspect_err(|error| {
            let path = path.display();
            eprintln!("tracer: warning: {path}: baked for an animation alone: {error}");
        })
        .ok()
}

/// Says so where a file was baked under another sky than the scene is shown under, or from
/// other windows and floors than it has.
fn warn_of_another_bake(file: &WctFile, scene: &Scene, path: &Path) {
    let shown = scene.sky.as_ref().map(ToString::to_string);
    let baked = file.options.get(super::SKY);
    if baked != shown.as_ref() {
        let name = |sky: Option<&String>| sky.map_or("no sky".to_owned(), Clone::clone);
        eprintln!(
            "tracer: warning: {}: baked under {}, shown under {}: give the weather flags of the bake",
            path.display(),
            name(baked),
            name(shown.as_ref())
        );
    } else if file.options.get(super::SCENE).is_some_and(|of| *of != fingerprint(scene)) {
        eprintln!(
            "tracer: warning: {}: the scene's windows or floors have changed since it was baked: bake again",
            path.display()
        );
    }
}
