//! A scene's planar polygons: what emits, what receives, what can be baked.

mod join;

use super::{Mesh, Scene};
use glam::{DVec3, Vec2};

/// A planar polygon without holes: coplanar triangles of one mesh, joined.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PlanarPolygon {
    /// Index into [`Scene::meshes`].
    pub(crate) mesh: usize,
    /// The mesh's name; `name.k`, from 0, where the mesh has several polygons.
    pub(crate) name: String,
    /// Corners, counter-clockwise seen from the front; the one with the lowest
    /// index in the mesh is first.
    pub(crate) vertices: Vec<DVec3>,
    /// Coordinates of the emission texture, one a corner; empty if the mesh has none.
    pub(crate) uvs: Vec<Vec2>,
    /// Indices into [`Mesh::triangles`], increasing.
    pub(crate) triangles: Vec<u32>,
}

impl PlanarPolygon {
    /// Whether it has four corners and four right angles, to one part in 10⁵.
    pub(crate) fn is_rectangle(&self) -> bool {
        let [a, b, c, d] = self.vertices[..] else { return false };
        let tolerance = 1e-5 * (c - a).length();
        let parallelogram = (a + c - b - d).length() <= tolerance;
        // The diagonals of a parallelogram are of one length in a rectangle only.
        parallelogram && ((c - a).length() - (d - b).length()).abs() <= tolerance
    }

    /// Twice its area along its front normal.
    fn area_vector(&self) -> DVec3 {
        let origin = self.vertices[0];
        let pairs = self.vertices.windows(2);
        pairs.map(|p| (p[0] - origin).cross(p[1] - origin)).sum()
    }

    /// Square metres.
    #[cfg(test)]
    pub(crate) fn area(&self) -> f64 {
        0.5 * self.area_vector().length()
    }

    /// Unit normal of the front.
    pub(crate) fn normal(&self) -> DVec3 {
        self.area_vector().normalize_or_zero()
    }

    /// Puts the corners into their mean plane. Those of a small part of a large mesh can be
    /// farther off it, in its own size, than a polygon's may be.
    fn flatten(&mut self) {
        /// Of the polygon's size: corners that are nearer stay as the file has them.
        const FLAT: f64 = 3e-7;
        let (origin, normal) = (self.vertices[0], self.normal());
        let above = |v: &DVec3| (*v - origin).dot(normal);
        let height = self.vertices.iter().map(above).sum::<f64>() / self.vertices.len() as f64;
        let size = self.vertices.iter().map(|v| v.distance(origin)).fold(0.0, f64::max);
        if self.vertices.iter().any(|v| (above(v) - height).abs() > FLAT * size) {
            self.vertices.iter_mut().for_each(|v| *v -= (above(v) - height) * normal);
        }
    }

    /// Whether some of `other` is in front of this polygon's plane.
    fn sees(&self, other: &Self) -> bool {
        let (origin, normal) = (self.vertices[0], self.normal());
        let reach = |p: &DVec3| (*p - origin).length();
        let size = other.vertices.iter().chain(&self.vertices).map(reach).fold(0.0, f64::max);
        other.vertices.iter().any(|&p| normal.dot(p - origin) > 1e-6 * size)
    }
}

/// Every polygon of the scene, by mesh and by lowest triangle.
pub(crate) fn planar_polygons(scene: &Scene) -> Vec<PlanarPolygon> {
    polygons_where(scene, |_| true)
}

/// The polygons whose material emits.
pub(crate) fn emitters(scene: &Scene) -> Vec<PlanarPolygon> {
    polygons_where(scene, |mesh| emits(scene, mesh))
}

/// The polygons that light is to be baked on.
///
/// Those of the meshes that the file marks, or, where it marks none, every
/// rectangle that does not emit and has an emitter before it that it is before.
pub(crate) fn receivers(scene: &Scene) -> Vec<PlanarPolygon> {
    if scene.meshes.iter().any(|mesh| mesh.receiver) {
        return polygons_where(scene, |mesh| mesh.receiver);
    }
    let emitters = emitters(scene);
    let mut receivers = polygons_where(scene, |mesh| !emits(scene, mesh));
    receivers.retain(|r| r.is_rectangle() && emitters.iter().any(|e| e.sees(r) && r.sees(e)));
    receivers
}

fn emits(scene: &Scene, mesh: &Mesh) -> bool {
    scene.materials[mesh.material].emission.max_element() > 0.0
}

fn polygons_where(scene: &Scene, wanted: impl Fn(&Mesh) -> bool) -> Vec<PlanarPolygon> {
    let mut polygons = Vec::new();
    for (i, mesh) in scene.meshes.iter().enumerate().filter(|(_, mesh)| wanted(mesh)) {
        let outlines = join::outlines(mesh);
        let several = outlines.len() > 1;
        polygons.extend(outlines.into_iter().enumerate().map(|(k, outline)| {
            let at = |&corner: &u32| mesh.positions[corner as usize];
            let map = scene.materials[mesh.material].emission_texture;
            let map = map.filter(|map| !mesh.uvs[map.set].is_empty());
            let uv = |&corner: &u32| Some(mesh.uv(map.as_ref()?, corner as usize));
            let mut polygon = PlanarPolygon {
                mesh: i,
                name: if several { format!("{}.{k}", mesh.name) } else { mesh.name.clone() },
                vertices: outline.corners.iter().map(at).collect(),
                uvs: outline.corners.iter().filter_map(uv).collect(),
                triangles: outline.triangles,
            };
            polygon.flatten();
            polygon
        }));
    }
    polygons
}

/// Two triangles, counter-clockwise from corner `o`.
#[cfg(test)]
pub(crate) fn rectangle(name: &str, o: DVec3, u: DVec3, v: DVec3, material: usize) -> Mesh {
    Mesh {
        name: name.to_owned(),
        positions: vec![o, o + u, o + u + v, o + v],
        uvs: [vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y], Vec::new()],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        material,
        ..Mesh::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Map, Material};
    use glam::Vec3;

    /// Materials 0 (dark) and 1 (shining), and the meshes given.
    fn scene(meshes: Vec<Mesh>) -> Scene {
        let emission_texture = Some(Map::of(0));
        let shining = Material { emission: Vec3::ONE, emission_texture, ..Material::default() };
        Scene { meshes, materials: vec![Material::default(), shining], ..Scene::default() }
    }

    /// A facet of a millimetre in a mesh of a hundred metres, which is flat within that
    /// mesh's rounding.
    #[test]
    fn small_facets_of_large_meshes_are_flat() {
        let mut mesh = rectangle("facet", DVec3::ZERO, DVec3::X * 0.001, DVec3::Z * 0.001, 0);
        mesh.positions[2].y = 5e-6;
        mesh.positions.extend([DVec3::splat(100.0), DVec3::new(100.0, 101.0, 100.0), DVec3::ONE]);
        mesh.triangles.push([4, 5, 6]);
        let polygons = planar_polygons(&scene(vec![mesh]));
        let facet = polygons.iter().find(|p| p.vertices.len() == 4).expect("still one facet");
        wrt_core::Polygon::rectilinear(&facet.vertices).expect("and flat");
    }

    /// A 4 × 3 m floor at y = 0 that looks up, and a lamp over it that looks down.
    fn floor_and_lamp() -> Vec<Mesh> {
        vec![
            rectangle("floor", DVec3::ZERO, DVec3::Z * 3.0, DVec3::X * 4.0, 0),
            rectangle("lamp", DVec3::new(1.0, 2.0, 1.0), DVec3::X, DVec3::Z, 1),
        ]
    }

    fn names(polygons: &[PlanarPolygon]) -> Vec<&str> {
        polygons.iter().map(|p| p.name.as_str()).collect()
    }

    #[test]
    fn a_rectangle_has_its_area_normal_and_corners() {
        let polygons = planar_polygons(&scene(floor_and_lamp()));
        let [floor, lamp] = &polygons[..] else { panic!("{polygons:?}") };
        assert!(floor.is_rectangle() && lamp.is_rectangle(), "{polygons:?}");
        assert_eq!((floor.area(), floor.normal()), (12.0, DVec3::Y));
        assert_eq!((lamp.area(), lamp.normal()), (1.0, DVec3::NEG_Y));
        assert_eq!(floor.vertices[..2], [DVec3::ZERO, DVec3::Z * 3.0]);
        assert!(floor.uvs.is_empty(), "it has no emission texture");
        assert_eq!(lamp.uvs, [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y]);
        assert_eq!((floor.mesh, lamp.mesh), (0, 1));
        assert_eq!(floor.triangles, [0, 1]);
    }

    #[test]
    fn a_skewed_or_stretched_quadrilateral_is_no_rectangle() {
        let skewed = rectangle("s", DVec3::ZERO, DVec3::X, DVec3::new(0.1, 1.0, 0.0), 0);
        let mut kite = rectangle("k", DVec3::ZERO, DVec3::X, DVec3::Y, 0);
        kite.positions[2] = DVec3::new(1.5, 1.5, 0.0);
        let mut triangle = rectangle("t", DVec3::ZERO, DVec3::X, DVec3::Y, 0);
        triangle.triangles.pop();
        for mesh in [skewed, kite, triangle] {
            let polygons = planar_polygons(&scene(vec![mesh]));
            assert!(polygons.len() == 1 && !polygons[0].is_rectangle(), "{polygons:?}");
        }
        let tilted =
            rectangle("t", DVec3::ONE, DVec3::new(3.0, 4.0, 0.0), DVec3::new(-4.0, 3.0, 0.0), 0);
        assert!(planar_polygons(&scene(vec![tilted]))[0].is_rectangle(), "a turned square");
    }

    #[test]
    fn a_rectangle_before_an_emitter_receives() {
        let scene = scene(floor_and_lamp());
        assert_eq!(names(&emitters(&scene)), ["lamp"]);
        assert_eq!(names(&receivers(&scene)), ["floor"]);
    }

    #[test]
    fn what_the_emitter_cannot_reach_does_not_receive() {
        let mut meshes = floor_and_lamp();
        let o = DVec3::new(0.0, 3.0, 0.0);
        // Over the lamp, which shines down, and under it but looking down.
        meshes.push(rectangle("ceiling", o, DVec3::X, DVec3::Z, 0));
        meshes.push(rectangle("below", DVec3::NEG_Y, DVec3::X, DVec3::Z, 0));
        // In the lamp's own plane.
        let beside = DVec3::new(5.0, 2.0, 0.0);
        meshes.push(rectangle("beside", beside, DVec3::X, DVec3::Z, 0));
        // A wall that rises past the lamp's plane: its lower part is lit.
        meshes.push(rectangle("wall", DVec3::ZERO, DVec3::Y * 3.0, DVec3::Z * 3.0, 0));
        let scene = scene(meshes);
        assert_eq!(names(&receivers(&scene)), ["floor", "wall"]);
    }

    #[test]
    fn marks_replace_the_rule() {
        let mut meshes = floor_and_lamp();
        let mut triangle = rectangle("marked", DVec3::ZERO, DVec3::X, DVec3::Z, 0);
        triangle.triangles.pop();
        triangle.receiver = true;
        meshes.push(triangle);
        assert_eq!(names(&receivers(&scene(meshes))), ["marked"]);
    }

    #[test]
    fn several_polygons_of_a_mesh_are_numbered() {
        let mut fold = rectangle("fold", DVec3::ZERO, DVec3::X, DVec3::Y, 0);
        fold.positions[3] = DVec3::new(0.0, 1.0, 1.0);
        assert_eq!(names(&planar_polygons(&scene(vec![fold]))), ["fold.0", "fold.1"]);
    }
}
