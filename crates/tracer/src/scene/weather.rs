//! Windows lit from outside: sky and sun through glass become what they emit.

use super::{Lobe, Scene, Sunlight, Window, surfaces};
use anyhow::{Context as _, ensure};
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;
use wrt_core::grid::udc_fractions;
use wrt_core::{Frame, Glazing, Grid, Polygon, Sun, cone_solid_angle};

/// Irradiance of the ground by the sky, W m⁻²: an overcast day.
pub(crate) const SKY_IRRADIANCE: f64 = 100.0;

/// Irradiance by the sun of a surface that faces it, W m⁻²: a clear day, low sun.
pub(crate) const SUN_IRRADIANCE: f64 = 500.0;

/// What the ground reflects: grass and soil.
pub(crate) const GROUND_ALBEDO: f64 = 0.2;

/// Level of the direction cells in which a window's light is kept: fine enough for the
/// horizon, and for sunlight through a measured BTDF.
const LEVEL: u8 = 7;

/// The same for glass that scatters into a lobe of this exponent, whose matrix of cells
/// by cells is worked out.
fn level_of_lobe(exponent: f64) -> u8 {
    if exponent > 100.0 { 6 } else { 5 }
}

/// Replaces the emission of all windows by the light of the scene's sky; does nothing
/// without one.
///
/// Windows are the surfaces whose material has a glazing, or if there are none, all
/// emitters, with clear glass. The colour of the glass is the emission's, of which the
/// greatest channel becomes 1, times its texture; the glazing says how much passes.
///
/// # Errors
///
/// If there is no window, or one has no plane.
pub(crate) fn light_windows(scene: &mut Scene) -> anyhow::Result<()> {
    let Some(sky) = scene.sky.clone() else { return Ok(()) };
    let any = scene.materials.iter().any(|material| material.glazing.is_some());
    let mut frames: BTreeMap<usize, Frame> = BTreeMap::new();
    for planar in surfaces::emitters(scene) {
        let material = &scene.materials[scene.meshes[planar.mesh].material];
        if any && material.glazing.is_none() {
            continue;
        }
        let polygon = Polygon::rectilinear(&planar.vertices)
            .with_context(|| format!("the window \"{}\"", planar.name))?;
        let frame = upright(polygon.frame());
        let first = frames.entry(planar.mesh).or_insert(frame);
        ensure!(
            first.n.dot(frame.n) > 1.0 - 1e-6,
            "the window \"{}\" bends: make a mesh of each of its planes",
            planar.name
        );
    }
    ensure!(
        !frames.is_empty(),
        "there is a sky and no window: give a planar surface an emissive material"
    );
    for (mesh, frame) in frames {
        let mut material = scene.materials[scene.meshes[mesh].material].clone();
        let glazing = material.glazing.clone().unwrap_or(Glazing::Clear { ior: 1.5 });
        let level = match &glazing {
            Glazing::Diffusing(phong) if phong.is_glossy() => level_of_lobe(phong.exponent),
            _ => LEVEL,
        };
        let sunlight = sky.sun().and_then(|sun| sunlight(&sun, &frame, &glazing));
        let seen = if glazing.is_clear() { sky.without_sun() } else { sky.clone() };
        let light = table(&glazing.transmit(&seen.behind(&frame, level)));
        material.emission /= material.emission.max_element();
        let window = Some(Window { frame, light, sunlight });
        material.lobe = Some(Lobe { exponent: 0.0, peak: DVec3::Z, window });
        scene.meshes[mesh].material = scene.materials.len();
        scene.materials.push(material);
    }
    Ok(())
}

/// What of the sun's light goes straight through.
fn sunlight(sun: &Sun, frame: &Frame, glazing: &Glazing) -> Option<Sunlight> {
    let cosine = -frame.n.dot(sun.direction);
    let passes = glazing.straight(cosine)?;
    let radiance = passes * sun.irradiance / cone_solid_angle(Sun::RADIUS);
    (cosine > 0.0 && radiance > 0.0).then_some(Sunlight { travel: -sun.direction, radiance })
}

/// The frame with the same normal whose ŷ points up, or north where that is nothing.
fn upright(frame: &Frame) -> Frame {
    let along = |up: DVec3| (up - up.dot(frame.n) * frame.n).try_normalize();
    let y = if frame.n.y.abs() < 1.0 - 1e-9 { along(DVec3::Y) } else { None };
    let y = y.or_else(|| along(-DVec3::Z)).unwrap_or(frame.y);
    Frame { x: y.cross(frame.n), y, ..*frame }
}

/// Means over the cells' parts inside the UDC, of the first channel.
fn table(grid: &Grid) -> wrt_core::Lobe {
    let level = grid.levels().direction;
    let factors = udc_fractions(level).into_iter().enumerate().map(|(d, fraction)| {
        let mean = grid.slice(d).map_or(0.0, |(image, f)| grid.images()[image][0][0] * f);
        if fraction > 1e-9 { mean / fraction as f32 } else { 0.0 }
    });
    wrt_core::Lobe::Table { level, factors: factors.collect(), x: DVec2::X }
}

impl Window {
    /// Radiance of light that travels along the unit vector `travel`, the sun's disc
    /// included.
    pub(crate) fn radiance(&self, travel: DVec3) -> f64 {
        let disc = self.sunlight.filter(|sun| sun.travel.dot(travel) >= Sun::RADIUS.cos());
        self.light.eval(self.frame.to_local(travel)) + disc.map_or(0.0, |sun| sun.radiance)
    }

    /// Its light without sunlight's beam, in the axes of another frame of the same plane.
    pub(crate) fn light_in(&self, frame: &Frame) -> wrt_core::Lobe {
        let own = DVec2::new(self.frame.x.dot(frame.x), self.frame.x.dot(frame.y)).normalize();
        match &self.light {
            wrt_core::Lobe::Table { level, factors, .. } => {
                wrt_core::Lobe::Table { level: *level, factors: factors.clone(), x: own }
            }
            other => other.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, Mesh};
    use glam::Vec3;
    use std::path::Path;
    use wrt_core::{Emission, Sky, SkyModel};

    /// A window in a wall that looks north, the first edge `turn` corners on.
    fn scene(turn: usize, glazing: Option<Glazing>) -> Scene {
        let corners = [[0., 0.], [1., 0.], [1., 1.], [0., 1.]];
        let positions =
            (0..4).map(|i| corners[(i + turn) % 4]).map(|[x, y]| DVec3::new(x, y, 0.0)).collect();
        let mesh = Mesh {
            name: "window".to_owned(),
            positions,
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        };
        let emission = Vec3::new(4.0, 2.0, 0.0);
        let material = Material { emission, glazing, ..Material::default() };
        Scene { meshes: vec![mesh], materials: vec![material], ..Scene::default() }
    }

    /// Whichever corner comes first, the sun shines in to the same side, with the power
    /// that falls on the glass.
    #[test]
    fn sunlight_enters_away_from_the_sun() {
        for turn in 0..4 {
            let mut scene = scene(turn, Some(Glazing::Clear { ior: 1.0 }));
            let sun = Sun::new(30.0, 40.0, 500.0).expect("in range");
            scene.sky = Some(Sky::new(SkyModel::Uniform, 0.0, Some(sun), 0.0).expect("in range"));
            light_windows(&mut scene).expect("a plane");
            let material = &scene.materials[scene.meshes[0].material];
            assert_eq!(material.emission, Vec3::new(1.0, 0.5, 0.0), "the glass's colour");
            let lobe = material.lobe.as_ref().expect("weather");
            let window = lobe.window.as_ref().expect("weather");
            let sunlight = window.sunlight.expect("through clear glass");
            assert_eq!(
                (sunlight.travel, window.radiance(-sun.direction)),
                (-sun.direction, sunlight.radiance)
            );
            let facing = sunlight.radiance * cone_solid_angle(Sun::RADIUS);
            assert!((facing / 500.0 - 1.0).abs() < 1e-9, "turn {turn}: {facing}");
            // The same through milk glass, or a table, is in no beam.
            let milk = wrt_core::Phong::new([1.0; 3], [0.0; 3], 0.0).expect("in range");
            scene.materials.truncate(1);
            scene.meshes[0].material = 0;
            scene.materials[0].glazing = Some(Glazing::Diffusing(milk));
            light_windows(&mut scene).expect("a plane");
            let lobe = scene.materials[1].lobe.as_ref().expect("weather");
            let window = lobe.window.as_ref().expect("weather");
            assert_eq!(window.sunlight, None, "scattered");
            let planar = &surfaces::emitters(&scene)[0];
            let polygon = Polygon::rectilinear(&planar.vertices).expect("a square");
            let light = window.light_in(polygon.frame());
            let exitance = Emission::new(0, vec![[1.0; 3]], light).project(5).irradiance()[0][0];
            let expected = 500.0 * sun.direction.dot(-DVec3::Z);
            assert!((exitance / expected - 1.0).abs() < 1e-3, "turn {turn}: {exitance} {expected}");
        }
    }

    /// A table keeps its axes, whichever corner comes first: light from the upper left.
    #[test]
    fn a_window_s_table_is_in_the_world_s_axes() {
        let blind = Some(Glazing::Diffusing(
            wrt_core::Phong::new([0.0; 3], [1.0; 3], 100.0).expect("in range"),
        ));
        for turn in 0..4 {
            let mut scene = scene(turn, blind.clone());
            let sun = Sun::new(30.0, 40.0, 500.0).expect("in range");
            scene.sky = Some(Sky::new(SkyModel::Uniform, 0.0, Some(sun), 0.0).expect("in range"));
            light_windows(&mut scene).expect("a plane");
            let lobe = scene.materials[1].lobe.as_ref().expect("weather");
            let planar = &surfaces::emitters(&scene)[0];
            let polygon = Polygon::rectilinear(&planar.vertices).expect("a square");
            let light = lobe.window.as_ref().expect("weather").light_in(polygon.frame());
            let along = |travel: DVec3| light.eval(polygon.frame().to_local(travel));
            let travel = -sun.direction;
            let beside = DVec3::new(-travel.x, travel.y, travel.z);
            assert!(along(travel) > 100.0 * along(beside), "turn {turn}");
        }
    }

    /// Sunlight through a blind's BSDF, made by Radiance's programs: what leaves the inner
    /// side, over what falls on the outer one, is `pyradiance.bsdf.direct_hemi` of that
    /// direction, transmitted.
    #[test]
    fn a_blind_passes_what_radiance_says() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/bsdf");
        for (file, suns) in [
            (
                "blind_kq.xml",
                [
                    ([20., 35.], 0.817_909),
                    ([-30., 50.], 0.810_764),
                    ([5., 15.], 0.836_705),
                    ([60., 40.], 0.881_764),
                ],
            ),
            (
                "blind_t4.xml",
                [
                    ([20., 35.], 0.833_902),
                    ([-30., 50.], 0.826_416),
                    ([12., 60.], 0.867_151),
                    ([60., 40.], 0.859_213),
                ],
            ),
        ] {
            let bsdf = super::super::bsdf_xml::read(&folder.join(file)).expect("a BSDF");
            let glazing = Glazing::Tabulated(bsdf.into());
            for ([azimuth, elevation], expected) in suns {
                let mut scene = scene(0, Some(glazing.clone()));
                let sun = Sun::new(azimuth, elevation, 600.0).expect("in range");
                let sky = Sky::new(SkyModel::Uniform, 0.0, Some(sun), 0.0).expect("in range");
                scene.sky = Some(sky);
                light_windows(&mut scene).expect("a plane");
                let lobe = scene.materials[1].lobe.as_ref().expect("weather");
                let planar = &surfaces::emitters(&scene)[0];
                let polygon = Polygon::rectilinear(&planar.vertices).expect("a square");
                let light = lobe.window.as_ref().expect("weather").light_in(polygon.frame());
                let leaves = Emission::new(0, vec![[1.0; 3]], light).project(6).irradiance()[0][0];
                let found = leaves / (600.0 * -sun.direction.z);
                println!(
                    "{file}, sun at {azimuth}, {elevation}: {found:.4}, Radiance {expected:.4}"
                );
                assert!((found / expected - 1.0).abs() < 5e-3, "{file}: {found} {expected}");
            }
        }
    }

    #[test]
    fn only_glass_is_lit_where_there_is_some() {
        let mut scene = scene(0, None);
        let mut lamp = Mesh { material: 1, ..Mesh::default() };
        lamp.positions = scene.meshes[0].positions.iter().map(|p| *p + DVec3::Z).collect();
        lamp.triangles = vec![[0, 1, 2], [0, 2, 3]];
        scene.meshes.push(lamp);
        scene.materials.push(Material { emission: Vec3::ONE, ..Material::default() });
        light_windows(&mut scene).expect("no sky");
        assert!(scene.materials.iter().all(|m| m.lobe.is_none()), "nothing without a sky");
        scene.sky = Some(Sky::new(SkyModel::Overcast, 100.0, None, 0.2).expect("in range"));
        scene.materials[0].glazing = Some(Glazing::Clear { ior: 1.5 });
        light_windows(&mut scene).expect("planes");
        let lit = |mesh: usize| scene.materials[scene.meshes[mesh].material].lobe.is_some();
        assert!(lit(0) && !lit(1), "the lamp is no window");
    }
}
