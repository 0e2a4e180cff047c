//! What a mesh with alpha hides of what is behind it.

use super::{Alpha, Mesh, Scene, Texture};
use glam::Vec2;

/// The opacity of a mesh's triangles, on its own: a hierarchy keeps it beside them.
#[derive(Debug)]
pub(crate) struct Cutout {
    alpha: Alpha,
    texture: Option<Texture>,
    corners: Vec<Corners>,
}

/// Of one triangle.
#[derive(Debug)]
struct Corners {
    uvs: [Vec2; 3],
    alphas: [f32; 3],
}

impl Cutout {
    /// `None` for a mesh that is opaque all over.
    pub(crate) fn of(scene: &Scene, mesh: &Mesh) -> Option<Self> {
        let material = &scene.materials[mesh.material];
        let map = material.base_texture.as_ref();
        let texture = map.map(|map| &scene.textures[map.texture]).filter(|t| !t.is_opaque());
        let coloured = mesh.colours.iter().any(|c| c.w != 1.0);
        match material.alpha {
            Alpha::Opaque => return None,
            Alpha::Mask { factor, cutoff }
                if factor >= cutoff && texture.is_none() && !coloured =>
            {
                return None;
            }
            Alpha::Blend { factor: 1.0 } if texture.is_none() && !coloured => return None,
            Alpha::Mask { .. } | Alpha::Blend { .. } => {}
        }
        let corner = |v: u32| {
            let uv = map.map_or(Vec2::ZERO, |map| mesh.uv(map, v as usize));
            (uv, mesh.colours.get(v as usize).map_or(1.0, |c| c.w))
        };
        let corners = |t: &[u32; 3]| {
            let [a, b, c] = t.map(corner);
            Corners { uvs: [a.0, b.0, c.0], alphas: [a.1, b.1, c.1] }
        };
        Some(Self {
            alpha: material.alpha,
            texture: texture.cloned(),
            corners: mesh.triangles.iter().map(corners).collect(),
        })
    }

    /// Which part of what is behind it a triangle hides, 0 to 1, at the barycentric
    /// weights of its second and third vertex.
    pub(crate) fn opacity(&self, triangle: u32, (v, w): (f64, f64)) -> f32 {
        let Corners { uvs, alphas } = &self.corners[triangle as usize];
        let (v, w) = (v as f32, w as f32);
        let u = 1.0 - v - w;
        let vertices = u * alphas[0] + v * alphas[1] + w * alphas[2];
        let uv = u * uvs[0] + v * uvs[1] + w * uvs[2];
        let alpha = self.texture.as_ref().map_or(1.0, |t| t.at(uv).w) * vertices;
        match self.alpha {
            Alpha::Opaque => 1.0,
            Alpha::Mask { factor, cutoff } => f32::from(factor * alpha >= cutoff),
            Alpha::Blend { factor } => (factor * alpha).clamp(0.0, 1.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Map, Material};
    use glam::{DVec3, Vec4};

    /// A triangle whose texture is clear on the left and opaque on the right.
    fn half_clear(alpha: Alpha) -> Scene {
        let texels = vec![Vec4::new(1.0, 1.0, 1.0, 0.0), Vec4::ONE];
        let material = Material { alpha, base_texture: Some(Map::of(0)), ..Material::default() };
        Scene {
            meshes: vec![Mesh {
                positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
                uvs: [vec![Vec2::ZERO, Vec2::X, Vec2::Y], Vec::new()],
                triangles: vec![[0, 1, 2]],
                ..Mesh::default()
            }],
            materials: vec![material],
            textures: vec![Texture::from_texels(2, 1, texels)],
            ..Scene::default()
        }
    }

    #[test]
    fn a_mask_is_all_or_nothing_and_a_blend_between() {
        let opacity = |alpha, u: f64| {
            let scene = half_clear(alpha);
            let cutout = Cutout::of(&scene, &scene.meshes[0]).expect("half of it is clear");
            cutout.opacity(0, (u, 0.0))
        };
        let mask = Alpha::Mask { factor: 1.0, cutoff: 0.5 };
        assert_eq!((opacity(mask, 0.3), opacity(mask, 0.7)), (0.0, 1.0));
        // Texel centres are at ¼ and ¾: at ½ the alpha is ½.
        let blend = Alpha::Blend { factor: 0.5 };
        assert_eq!((opacity(blend, 0.5), opacity(blend, 0.75)), (0.25, 0.5));
    }

    #[test]
    fn what_is_opaque_all_over_has_no_cutout() {
        let mut scene = half_clear(Alpha::Opaque);
        assert!(Cutout::of(&scene, &scene.meshes[0]).is_none(), "its mode says so");
        scene.materials[0].base_texture = None;
        for alpha in [Alpha::Mask { factor: 0.5, cutoff: 0.5 }, Alpha::Blend { factor: 1.0 }] {
            scene.materials[0].alpha = alpha;
            assert!(Cutout::of(&scene, &scene.meshes[0]).is_none(), "{alpha:?}");
        }
        scene.meshes[0].colours = vec![Vec4::splat(0.5); 3];
        let cutout = Cutout::of(&scene, &scene.meshes[0]).expect("its vertices are not");
        assert_eq!(cutout.opacity(0, (0.2, 0.2)), 0.5);
    }
}
