//! Windows lit from outside: sky and sun through glass become what they emit.

use super::{Lobe, Scene, Window, surfaces};
use anyhow::{Context as _, ensure};
use glam::{DVec2, DVec3, Vec3};
use std::collections::BTreeMap;
use wrt_core::grid::udc_fractions;
use wrt_core::{Frame, Glazing, Grid, Polygon, Sky};

/// Irradiance of the ground by the sky, W m⁻²: an overcast day.
pub(crate) const SKY_IRRADIANCE: f64 = 100.0;

/// Irradiance by the sun of a surface that faces it, W m⁻²: a clear day, low sun.
pub(crate) const SUN_IRRADIANCE: f64 = 500.0;

/// What the ground reflects: grass and soil.
pub(crate) const GROUND_ALBEDO: f64 = 0.2;

/// Level of the direction cells in which a window's light is kept: the sun's beam is as
/// wide as one, a hundredth.
const LEVEL: u8 = 7;

/// Replaces the emission of all windows by the light of the scene's sky; does nothing
/// without one.
///
/// Windows are the surfaces whose material has a glazing, or if there are none, all
/// emitters, with clear glass. The colour of the glass is the emission's, of which the
/// greatest channel becomes 1, times its texture; the glazing says how much passes.
///
/// # Errors
///
/// If a window has no plane.
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
    for (mesh, frame) in frames {
        let mut material = scene.materials[scene.meshes[mesh].material].clone();
        let glazing = material.glazing.clone().unwrap_or(Glazing::Clear { ior: 1.5 });
        let light = |sky: &Sky| table(&glazing.transmit(&sky.behind(&frame, LEVEL)));
        let all = light(&sky);
        let diffuse = if glazing.is_clear() { light(&sky.without_sun()) } else { all.clone() };
        material.emission /= material.emission.max_element();
        let window = Some(Window { frame, light: all, diffuse });
        material.lobe = Some(Lobe { exponent: 0.0, peak: DVec3::Z, window });
        scene.meshes[mesh].material = scene.materials.len();
        scene.materials.push(material);
    }
    Ok(())
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
    /// All of its light, in the axes of another frame of the same plane.
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
    use wrt_core::{Emission, SkyModel, Sun};

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
            let planar = &surfaces::emitters(&scene)[0];
            let polygon = Polygon::rectilinear(&planar.vertices).expect("a square");
            let light = window.light_in(polygon.frame());
            let travel = -sun.direction;
            assert!(light.eval(polygon.frame().to_local(travel)) > 0.0, "turn {turn}");
            let beside = DVec3::new(-travel.x, travel.y, travel.z);
            assert_eq!(light.eval(polygon.frame().to_local(beside)), 0.0, "turn {turn}");
            // Single cells of level 7, projected onto level 5: E = 500 cos of incidence.
            let exitance = Emission::new(0, vec![[1.0; 3]], light).project(5).irradiance()[0][0];
            let expected = 500.0 * sun.direction.dot(-DVec3::Z);
            assert!((exitance / expected - 1.0).abs() < 0.02, "turn {turn}: {exitance} {expected}");
            assert_eq!(window.diffuse.eval(window.frame.to_local(travel)), 0.0, "no beam in sight");
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
