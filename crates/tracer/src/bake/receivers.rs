//! A scene's receivers: polygons, and how they reflect.

use crate::scene::{
    Scene,
    surfaces::{self, PlanarPolygon},
};
use anyhow::{Context as _, bail};
use wrt_core::{Phong, Polygon};

/// The largest exponent that is baked: a lobe of 0.4°. What a window's image shows at less
/// takes more cells than anybody would wait for.
const NARROWEST: f64 = 2e4;

pub(crate) struct Receiver {
    pub(crate) planar: PlanarPolygon,
    pub(crate) polygon: Polygon,
    pub(crate) phong: Phong,
}

pub(crate) fn receivers(
    scene: &Scene,
    warnings: &mut Vec<String>,
) -> anyhow::Result<Vec<Receiver>> {
    let found = surfaces::receivers(scene);
    if found.is_empty() {
        bail!(
            "nothing receives light: mark a node's extras with \"wrt\": {{\"receiver\": true}}, or put a rectangle before the emitter"
        );
    }
    let receiver = |planar: PlanarPolygon| {
        let polygon = Polygon::rectilinear(&planar.vertices)
            .with_context(|| format!("the receiver \"{}\"", planar.name))?;
        let material = &scene.materials[scene.meshes[planar.mesh].material];
        if material.base_texture.is_some() {
            warnings.push(format!(
                "receiver \"{}\": the base-colour texture of material \"{}\" is not baked, only its factor",
                planar.name, material.name
            ));
        }
        // A mirror's k_s is the raytracer's recursive ray, not the patch's.
        let ks = if material.mirror { [0.0; 3] } else { material.ks.as_dvec3().to_array() };
        let kd = material.kd.as_dvec3().to_array();
        let exponent = f64::from(material.exponent);
        if exponent > NARROWEST && ks != [0.0; 3] {
            warnings.push(format!(
                "receiver \"{}\": its lobe of exponent {exponent} is baked as one of {NARROWEST}, 0.4° wide; a mirror would do (roughnessFactor up to 0.1, or illum 3)",
                planar.name
            ));
        }
        let phong = Phong::new(kd, ks, exponent.min(NARROWEST))
            .with_context(|| format!("material \"{}\"", material.name))?;
        Ok(Receiver { planar, polygon, phong })
    };
    found.into_iter().map(receiver).collect()
}
