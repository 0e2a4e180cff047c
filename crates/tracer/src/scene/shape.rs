//! The part of a mesh that its place in the world changes.

use super::Mesh;
use anyhow::ensure;
use glam::{DAffine3, DMat3, DVec3, Vec3, Vec4};

/// Triangles in a node's own coordinates.
#[derive(Clone, Debug, Default)]
pub(crate) struct Shape {
    pub(super) positions: Vec<[f32; 3]>,
    /// One a vertex, of any length; empty for flat shading.
    pub(super) normals: Vec<[f32; 3]>,
    /// One a vertex, w the bitangent's sign; empty where there are none.
    pub(super) tangents: Vec<[f32; 4]>,
    /// Counter-clockwise seen from the front; the vertices must be there.
    pub(super) triangles: Vec<[u32; 3]>,
}

impl Shape {
    /// Brings the shape to the world, into `mesh`.
    ///
    /// # Errors
    ///
    /// If a vertex is not finite there.
    pub(crate) fn place(&self, transform: DAffine3, mesh: &mut Mesh) -> anyhow::Result<()> {
        let place = |p: &[f32; 3]| transform.transform_point3(DVec3::from(p.map(f64::from)));
        mesh.positions = self.positions.iter().map(place).collect();
        let odd = mesh.positions.iter().position(|p| !p.is_finite());
        ensure!(odd.is_none(), "POSITION: vertex {} is not finite", odd.unwrap_or_default());
        mesh.triangles.clone_from(&self.triangles);
        if transform.matrix3.determinant() < 0.0 {
            // A reflection turns the winding: turn it back to keep the front.
            mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        mesh.normals = if self.normals.is_empty() {
            Vec::new()
        } else {
            world_normals(&self.normals, &transform, &mesh.positions, &mesh.triangles)
        };
        let tangents = self.tangents.iter();
        mesh.tangents = tangents.map(|&t| world_tangent(t.into(), &transform)).collect();
        mesh.transform = transform;
        Ok(())
    }
}

/// A tangent in world space, with the sign of a bitangent that a reflection turns;
/// zero where it has no direction.
fn world_tangent(tangent: Vec4, transform: &DAffine3) -> Vec4 {
    let along = transform.matrix3 * tangent.truncate().as_dvec3();
    let sign = tangent.w * transform.matrix3.determinant().signum() as f32;
    along.normalize_or_zero().as_vec3().extend(sign)
}

/// Unit normals in world space: n′ ∝ M⁻ᵀ n.
///
/// A normal that is zero or not finite becomes that of a triangle it belongs to.
fn world_normals(
    normals: &[[f32; 3]],
    transform: &DAffine3,
    positions: &[DVec3],
    triangles: &[[u32; 3]],
) -> Vec<Vec3> {
    // The cofactors are M⁻ᵀ times the determinant, and exist when it is zero.
    let m = transform.matrix3;
    let sign = if m.determinant() < 0.0 { -1.0 } else { 1.0 };
    let cofactors = sign
        * DMat3::from_cols(
            m.y_axis.cross(m.z_axis),
            m.z_axis.cross(m.x_axis),
            m.x_axis.cross(m.y_axis),
        );
    let unit = |n: &[f32; 3]| (cofactors * DVec3::from(n.map(f64::from))).try_normalize();
    let mut units: Vec<Option<DVec3>> = normals.iter().map(unit).collect();
    if units.iter().any(Option::is_none) {
        for triangle in triangles {
            let [a, b, c] = triangle.map(|i| positions[i as usize]);
            let flat = (b - a).cross(c - a).try_normalize();
            for &i in triangle {
                let slot = &mut units[i as usize];
                *slot = slot.or(flat);
            }
        }
    }
    units.into_iter().map(|n| n.unwrap_or(DVec3::Y).as_vec3()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_stay_perpendicular_under_uneven_scale() {
        let scale = DAffine3::from_scale(DVec3::new(4.0, 1.0, 1.0));
        // The plane x + y = 0 becomes x / 4 + y = 0.
        let [n] = world_normals(&[[1.0, 1.0, 0.0]], &scale, &[], &[])[..] else { panic!("one") };
        assert!(n.abs_diff_eq(Vec3::new(0.25, 1.0, 0.0).normalize(), 1e-6), "{n}");
    }

    #[test]
    fn a_mirrored_normal_is_mirrored_once() {
        let mirror = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
        let normals = world_normals(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &mirror, &[], &[]);
        assert_eq!(normals, [Vec3::NEG_X, Vec3::Y]);
    }

    #[test]
    fn a_missing_normal_is_the_triangles() {
        let positions = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let normals = [[0.0; 3], [f32::NAN, 0.0, 0.0], [1.0, 0.0, 0.0]];
        let normals = world_normals(&normals, &DAffine3::IDENTITY, &positions, &[[0, 1, 2]]);
        assert_eq!(normals, [Vec3::Z, Vec3::Z, Vec3::X]);
    }
}
