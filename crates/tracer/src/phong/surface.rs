//! What a ray finds of a surface, its textures looked up, and how lights show there.

use super::{Phong, Source, Unshadowed, arriving};
use crate::accel::Hit;
use crate::scene::{Map, Material, Mesh, PunctualLight, Scene};
use glam::{DMat2, DVec2, DVec3, Vec2, Vec3, Vec4};

/// A point of a surface as seen along one ray, with its textures looked up.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface<'a> {
    pub(crate) material: &'a Material,
    pub(crate) position: DVec3,
    /// Unit, of the triangle, on the side that the ray came from.
    pub(crate) geometric: DVec3,
    /// Unit, interpolated and by the normal map, turned to the side that the ray
    /// came from.
    pub(crate) normal: DVec3,
    /// Whether the ray came from the front.
    pub(crate) front: bool,
    /// Unit, back along the ray.
    pub(crate) to_eye: DVec3,
    /// What reflects locally: the specular part of a mirror and the part of
    /// glass that lets light pass are left out.
    pub(crate) brdf: Phong,
    /// k_d with its texture, before glass takes its part.
    pub(crate) colour: Vec3,
    /// k_s with its texture, of a mirror, too.
    pub(crate) specular: Vec3,
    /// Radiance emitted at the lobe's peak, with its texture; an unlit surface's
    /// colour.
    pub(crate) emission: Vec3,
    /// What is left of the ambient term, 0 to 1.
    unoccluded: f32,
}

/// The corners of a triangle, and a point and an area of it to look up.
struct Lookup<'a> {
    scene: &'a Scene,
    mesh: &'a Mesh,
    corners: [usize; 3],
    weights: [f64; 3],
    /// Change of the second and third weight across and down the footprint.
    footprint: [DVec2; 2],
}

impl Lookup<'_> {
    fn interpolate(&self, of: impl Fn(usize) -> Vec4) -> Vec4 {
        (0..3).map(|k| self.weights[k] as f32 * of(self.corners[k])).sum()
    }

    /// Texture coordinates, and how they change along the triangle's edges from
    /// its first corner.
    fn uv(&self, map: &Map) -> (Vec2, [Vec2; 2]) {
        let [a, b, c] = self.corners.map(|corner| self.mesh.uv(map, corner));
        let edges = [b - a, c - a];
        (a + self.weights[1] as f32 * edges[0] + self.weights[2] as f32 * edges[1], edges)
    }

    fn texture(&self, map: &Map) -> Vec4 {
        let (uv, [along_b, along_c]) = self.uv(map);
        let spread = self.footprint.map(|d| d.x as f32 * along_b + d.y as f32 * along_c);
        self.scene.textures[map.texture].over(uv, spread)
    }

    /// The texture's colour, or white without one.
    fn textured(&self, map: Option<&Map>) -> Vec3 {
        map.map_or(Vec3::ONE, |map| self.texture(map).truncate())
    }

    /// `normal` as the normal map bends it.
    ///
    /// Where the mesh has no tangents they follow from the texture coordinates,
    /// the bitangent up in the picture (glTF 2.0, §3.9.3).
    fn bent(&self, normal: DVec3, map: &Map, scale: f32) -> DVec3 {
        let (tangent, sign) = if self.mesh.tangents.is_empty() {
            let [a, b, c] = self.corners.map(|corner| self.mesh.positions[corner]);
            let (_, edges) = self.uv(map);
            let to_uv = DMat2::from_cols(edges[0].as_dvec2(), edges[1].as_dvec2());
            let determinant = to_uv.determinant();
            if determinant == 0.0 {
                return normal;
            }
            // The first row of the inverse: how the weights change along u.
            let along_u = to_uv.inverse() * DVec2::X;
            (along_u.x * (b - a) + along_u.y * (c - a), -determinant.signum())
        } else {
            let tangent = self.interpolate(|corner| self.mesh.tangents[corner]);
            (tangent.truncate().as_dvec3(), f64::from(tangent.w))
        };
        let Some(tangent) = tangent.reject_from_normalized(normal).try_normalize() else {
            return normal;
        };
        let bitangent = sign.signum() * normal.cross(tangent);
        let local = (2.0 * self.texture(map).truncate() - 1.0) * Vec3::new(scale, scale, 1.0);
        let bent = DVec3::from(local);
        (bent.x * tangent + bent.y * bitangent + bent.z * normal).try_normalize().unwrap_or(normal)
    }
}

impl<'a> Surface<'a> {
    /// [`over`](Self::over) no area at all.
    #[cfg(test)]
    pub(crate) fn new(scene: &'a Scene, hit: &Hit, to_eye: DVec3) -> Self {
        Self::over(scene, hit, to_eye, [DVec3::ZERO; 2])
    }

    /// The surface at `hit`, seen from `to_eye`, with textures averaged over the
    /// parallelogram that `footprint` spans about it. The back of a surface is
    /// shaded like its front.
    pub(crate) fn over(scene: &'a Scene, hit: &Hit, to_eye: DVec3, footprint: [DVec3; 2]) -> Self {
        let mesh = &scene.meshes[hit.mesh];
        let material = &scene.materials[mesh.material];
        let corners = mesh.triangles[hit.triangle as usize].map(|corner| corner as usize);
        let (v, w) = hit.barycentric;
        let weights = [1.0 - v - w, v, w];
        let footprint = if footprint == [DVec3::ZERO; 2] {
            [DVec2::ZERO; 2]
        } else {
            let [a, b, c] = corners.map(|corner| mesh.positions[corner]);
            footprint.map(|d| weight_change(b - a, c - a, d))
        };
        let lookup = Lookup { scene, mesh, corners, weights, footprint };

        let normal = if mesh.normals.is_empty() {
            hit.normal
        } else {
            let sum: DVec3 = (0..3).map(|k| weights[k] * mesh.normals[corners[k]].as_dvec3()).sum();
            sum.try_normalize().unwrap_or(hit.normal)
        };
        // A file's normals may disagree with its winding; the winding decides.
        let normal = if normal.dot(hit.normal) < 0.0 { -normal } else { normal };
        let normal = match &material.normal_map {
            Some((map, scale)) => lookup.bent(normal, map, *scale),
            None => normal,
        };

        let mut tint = lookup.textured(material.base_texture.as_ref());
        if !mesh.colours.is_empty() {
            tint *= lookup.interpolate(|corner| mesh.colours[corner]).truncate();
        }
        let (colour, ks, exponent) = match &material.metallic {
            Some(metallic) => {
                let numbers = metallic.map.as_ref().map_or(Vec4::ONE, |map| lookup.texture(map));
                metallic.phong(tint, [numbers.y, numbers.z])
            }
            None => (material.kd * tint, material.ks, material.exponent),
        };
        let unoccluded = material
            .occlusion
            .as_ref()
            .map_or(1.0, |(map, strength)| 1.0 + strength * (lookup.texture(map).x - 1.0));
        let emission = if material.unlit {
            // What metallic-roughness would have scaled by is not for unlit colours.
            material.metallic.map_or(material.kd, |metallic| metallic.base) * tint
        } else {
            material.emission * lookup.textured(material.emission_texture.as_ref())
        };
        let opacity = 1.0 - material.transmission.clamp(0.0, 1.0);
        let reflecting = if material.unlit { 0.0 } else { 1.0 };
        let side = if hit.front { 1.0 } else { -1.0 };
        Self {
            material,
            position: hit.position,
            geometric: side * hit.normal,
            normal: side * normal,
            front: hit.front,
            to_eye,
            brdf: Phong {
                kd: colour * opacity * reflecting,
                ks: if material.mirror { Vec3::ZERO } else { ks * reflecting },
                exponent: f64::from(exponent),
            },
            colour,
            specular: ks,
            emission,
            unoccluded,
        }
    }

    /// What is reflected to the eye of `light`, shadows left aside; `None` where none of
    /// it arrives.
    pub(crate) fn lit_by(&self, light: &PunctualLight) -> Option<Unshadowed> {
        if self.brdf.is_black() {
            return None;
        }
        let (to_light, distance, irradiance) = arriving(light, self.position)?;
        let cosine = self.normal.dot(to_light);
        if cosine <= 0.0 {
            return None;
        }
        let reflectance = self.brdf.reflectance(self.normal, to_light, self.to_eye);
        let source = if distance.is_finite() {
            Source::Point(light.position)
        } else {
            Source::Direction(to_light)
        };
        Some(Unshadowed { radiance: reflectance * irradiance * cosine as f32, source })
    }

    /// k_d times the ambient radiance, less what is occluded: the classical ambient
    /// term.
    pub(crate) fn ambient(&self, radiance: Vec3) -> Vec3 {
        self.brdf.kd * radiance * self.unoccluded
    }
}

/// How much of the edges `b` and `c` make up `d`, by least squares: `d` may leave
/// their plane.
fn weight_change(b: DVec3, c: DVec3, d: DVec3) -> DVec2 {
    let (bb, bc, cc) = (b.dot(b), b.dot(c), c.dot(c));
    let (db, dc) = (d.dot(b), d.dot(c));
    DVec2::new(cc * db - bc * dc, bb * dc - bc * db) / (bb * cc - bc * bc)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::Accel;
    use crate::scene::Texture;

    /// A unit square in the plane z = 0 that faces +z, u along x and v along −y,
    /// with a texture of one texel.
    fn square(texel: Vec4) -> Scene {
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let uvs = corners.map(|[x, y]: [f64; 2]| Vec2::new(x as f32, 1.0 - y as f32)).to_vec();
        Scene {
            meshes: vec![Mesh {
                positions: corners.map(|[x, y]| DVec3::new(x, y, 0.0)).to_vec(),
                uvs: [uvs, Vec::new()],
                triangles: vec![[0, 1, 2], [0, 2, 3]],
                ..Mesh::default()
            }],
            materials: vec![Material { kd: Vec3::ONE, ..Material::default() }],
            textures: vec![Texture::from_texels(1, 1, vec![texel])],
            ..Scene::default()
        }
    }

    fn seen(scene: &Scene) -> Surface<'_> {
        let accel = Accel::new(scene);
        let eye = DVec3::new(0.25, 0.5, 1.0);
        let hit = accel.closest(eye, DVec3::NEG_Z, 0.0, 2.0).expect("the square");
        Surface::new(scene, &hit, DVec3::Z)
    }

    #[test]
    fn a_normal_map_turns_the_normal_with_the_texture() {
        // Red leans along u, which is +x here; green up in the picture, +y.
        let lean = |texel: Vec3| {
            let mut scene = square((0.5 + 0.5 * texel).extend(1.0));
            scene.materials[0].normal_map = Some((Map::of(0), 1.0));
            seen(&scene).normal
        };
        let leaning = Vec3::new(0.6, 0.0, 0.8);
        assert!(lean(leaning).abs_diff_eq(leaning.as_dvec3(), 1e-6), "{}", lean(leaning));
        let rising = Vec3::new(0.0, 0.6, 0.8);
        assert!(lean(rising).abs_diff_eq(rising.as_dvec3(), 1e-6), "{}", lean(rising));
        // Tangents of the mesh's own win: along y, bitangent −x.
        let mut scene = square((0.5 + 0.5 * leaning).extend(1.0));
        scene.materials[0].normal_map = Some((Map::of(0), 1.0));
        scene.meshes[0].tangents = vec![Vec4::new(0.0, 1.0, 0.0, 1.0); 4];
        let turned = seen(&scene).normal;
        assert!(turned.abs_diff_eq(DVec3::new(0.0, 0.6, 0.8), 1e-6), "{turned}");
        // A texture that is mirrored on the surface leans the other way.
        let mut scene = square((0.5 + 0.5 * leaning).extend(1.0));
        scene.materials[0].normal_map = Some((Map::of(0), 1.0));
        scene.meshes[0].uvs[0].iter_mut().for_each(|uv| uv.x = -uv.x);
        let turned = seen(&scene).normal;
        assert!(turned.abs_diff_eq(DVec3::new(-0.6, 0.0, 0.8), 1e-6), "{turned}");
    }

    #[test]
    fn vertex_colours_and_textures_multiply() {
        let mut scene = square(Vec4::new(0.5, 1.0, 1.0, 1.0));
        scene.materials[0].base_texture = Some(Map::of(0));
        scene.meshes[0].colours = [0.0, 1.0, 1.0, 0.0].map(|x| Vec4::new(1.0, x, 1.0, 1.0)).into();
        let colour = seen(&scene).colour;
        assert!(colour.abs_diff_eq(Vec3::new(0.5, 0.25, 1.0), 1e-6), "{colour}");
    }

    #[test]
    fn occlusion_takes_its_strength_of_the_ambient_term_alone() {
        let mut scene = square(Vec4::new(0.25, 0.0, 0.0, 1.0));
        scene.materials[0].occlusion = Some((Map::of(0), 0.5));
        let surface = seen(&scene);
        assert_eq!(surface.ambient(Vec3::ONE), Vec3::splat(0.625));
        assert_eq!(surface.brdf.kd, Vec3::ONE);
    }

    #[test]
    fn an_unlit_surface_shows_its_colour_and_reflects_nothing() {
        let mut scene = square(Vec4::new(0.5, 0.25, 1.0, 1.0));
        scene.materials[0] = Material {
            kd: Vec3::splat(0.5),
            ks: Vec3::ONE,
            base_texture: Some(Map::of(0)),
            unlit: true,
            ..Material::default()
        };
        let surface = seen(&scene);
        assert_eq!(surface.emission, Vec3::new(0.25, 0.125, 0.5));
        assert!(surface.brdf.is_black(), "{surface:?}");
    }

    #[test]
    fn a_footprint_is_taken_to_texture_coordinates() {
        let (b, c) = (DVec3::new(2.0, 0.0, 0.0), DVec3::new(1.0, 1.0, 0.0));
        let d = weight_change(b, c, 0.25 * b - 0.5 * c + DVec3::Z);
        assert!(d.abs_diff_eq(DVec2::new(0.25, -0.5), 1e-15), "{d}");
    }
}
