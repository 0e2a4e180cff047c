//! A `.wct` as a 4-D texture: hit point and view direction to radiance.

mod look_up;

use crate::scene::{Scene, surfaces};
use crate::whitted::{Beside, PatchRadiance, Sample};
use anyhow::bail;
use glam::{DVec2, DVec3, Vec3};
use look_up::{Change, LookUp};
use rayon::prelude::*;
use wrt_core::legendre::LegendreSampler;
use wrt_core::wct_file::Side;
use wrt_core::{Frame, MipSampler, Patch, SmoothPatch};

/// The outgoing patches of a file, bound to a scene's triangles.
#[derive(Debug)]
pub(crate) struct WctTexture {
    patches: Vec<Bound>,
    /// Per mesh and triangle: index into `patches`.
    triangles: Vec<Vec<Option<u32>>>,
    /// Whether boxes are looked up as they are, with nothing between them.
    nearest: bool,
}

#[derive(Debug)]
struct Bound {
    frame: Frame,
    size: DVec2,
    sampler: LookUp,
    /// As measured when it was baked or, if it was not, what is left out; relative.
    error: f64,
}

impl WctTexture {
    /// Binds each outgoing patch to the planar polygon of its name and geometry.
    ///
    /// # Errors
    ///
    /// If a patch has no polygon of its name in the scene, or lies elsewhere.
    pub(crate) fn bind(
        patches: &[Patch],
        smooth: &[SmoothPatch],
        scene: &Scene,
    ) -> anyhow::Result<Self> {
        let polygons = surfaces::planar_polygons(scene);
        let mut texture = Self {
            patches: Vec::new(),
            triangles: scene.meshes.iter().map(|mesh| vec![None; mesh.triangles.len()]).collect(),
            nearest: false,
        };
        let haar: Vec<&Patch> =
            patches.iter().filter(|patch| patch.side == Side::Outgoing).collect();
        let samplers: Vec<MipSampler> = haar.par_iter().map(|p| MipSampler::new(&p.tree)).collect();
        let haar = haar.into_iter().zip(samplers).map(|(p, sampler)| {
            let error = p.error_estimate.unwrap_or(p.relative_error);
            (&p.name, &p.polygon, LookUp::haar(sampler), error)
        });
        let smooth = smooth.iter().map(|p| {
            let error = p.error_estimate.unwrap_or(p.relative_error);
            (&p.name, &p.polygon, LookUp::smooth(LegendreSampler::new(&p.tree)), error)
        });
        for (name, geometry, sampler, error) in haar.chain(smooth) {
            let Some(planar) = polygons.iter().find(|planar| planar.name == *name) else {
                bail!(
                    "the scene has no planar surface named \"{name}\", which the .wct file has a patch for: was it baked from another scene?"
                );
            };
            let polygon = geometry.to_polygon()?;
            let extent = polygon.size().unwrap_or_default().length();
            let off = |(a, b): (&DVec3, &[f64; 3])| a.distance(DVec3::from(*b));
            let pairs = planar.vertices.iter().zip(&geometry.vertices);
            let distance = pairs.map(off).fold(0.0, f64::max);
            if planar.vertices.len() != geometry.vertices.len() || distance > 1e-5 * extent {
                bail!(
                    "the patch \"{name}\" lies elsewhere than the scene's surface of that name: bake the scene again"
                );
            }
            let Some(size) = polygon.size() else {
                bail!("the patch \"{name}\" is on a chart that this renderer cannot look up");
            };
            for &triangle in &planar.triangles {
                texture.triangles[planar.mesh][triangle as usize] =
                    Some(texture.patches.len() as u32);
            }
            texture.patches.push(Bound { frame: *polygon.frame(), size, sampler, error });
        }
        if texture.patches.is_empty() {
            bail!("the .wct file holds no outgoing radiance");
        }
        Ok(texture)
    }

    /// The same, boxes looked up as they are.
    pub(crate) fn nearest(self) -> Self {
        Self { nearest: true, ..self }
    }

    /// Takes the patches off a mesh, which is then lit as one without any; returns
    /// whether it had some.
    pub(crate) fn unbind(&mut self, mesh: usize) -> bool {
        let bound = self.triangles[mesh].iter().any(Option::is_some);
        self.triangles[mesh].fill(None);
        bound
    }

    /// How many patches are bound.
    pub(crate) fn len(&self) -> usize {
        self.patches.len()
    }
}

impl Bound {
    fn uv(&self, position: DVec3) -> DVec2 {
        let local = self.frame.to_local(position - self.frame.origin).truncate();
        // Just inside: a hit on the border may round to the outside.
        (local / self.size).clamp(DVec2::ZERO, DVec2::splat(1.0 - f64::EPSILON))
    }

    fn change(&self, beside: &Beside) -> Change {
        let position = self.frame.to_local(beside.position).truncate();
        Change { uv: position / self.size, mu: self.frame.to_local(beside.to_eye) }
    }
}

impl PatchRadiance for WctTexture {
    fn error(&self, mesh: usize, triangle: u32) -> Option<f64> {
        Some(self.patches[self.triangles[mesh][triangle as usize]? as usize].error)
    }

    fn place(&self, mesh: usize, triangle: u32, position: DVec3) -> Option<DVec2> {
        Some(self.patches[self.triangles[mesh][triangle as usize]? as usize].uv(position))
    }

    fn outgoing(
        &self,
        mesh: usize,
        triangle: u32,
        position: DVec3,
        to_eye: DVec3,
        sample: &Sample,
    ) -> Option<Vec3> {
        let beside = [Beside::default(); 2];
        self.outgoing_over(mesh, triangle, position, to_eye, &beside, sample)
    }

    fn outgoing_over(
        &self,
        mesh: usize,
        triangle: u32,
        position: DVec3,
        to_eye: DVec3,
        beside: &[Beside; 2],
        _: &Sample,
    ) -> Option<Vec3> {
        let patch = &self.patches[self.triangles[mesh][triangle as usize]? as usize];
        let mu = patch.frame.to_local(to_eye);
        if mu.z < 0.0 {
            return None;
        }
        let uv = patch.uv(position);
        let radiance = if self.nearest {
            patch.sampler.nearest(uv, mu)
        } else {
            patch.sampler.over(uv, mu, beside.each_ref().map(|beside| patch.change(beside)))
        };
        // Thresholding and polynomials can leave a little less than no light: what taking
        // none costs is told where trees are compressed.
        Some(Vec3::from(radiance).max(Vec3::ZERO))
    }
}
