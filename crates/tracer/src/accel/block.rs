//! Triangles by the block, and the test that lets no ray through between two.

use super::LANES;
use super::wide::fan::{RAYS, lanes};
use fearless_simd::{f32x16, f64x4, prelude::*};
use glam::DVec3;

/// Which of the scene's triangles it is, in the scene's order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Owner {
    pub(super) mesh: u32,
    pub(super) triangle: u32,
}

/// Up to [`LANES`] triangles: five cache lines, all of which a test reads.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(super) struct Block {
    /// In the scaled frame, by corner, axis and triangle. What is missing is not a
    /// number, which no ray meets.
    corners: [[[f64; LANES]; 3]; 3],
    owners: [Owner; LANES],
}

impl Block {
    pub(super) fn new(triangles: [Option<([DVec3; 3], Owner)>; LANES]) -> Self {
        let at = |corner: usize, axis: usize, lane: usize| {
            triangles[lane].map_or(f64::NAN, |(p, _)| p[corner][axis])
        };
        let from_fn = |corner| [0, 1, 2].map(|axis| std::array::from_fn(|l| at(corner, axis, l)));
        Self {
            corners: [0, 1, 2].map(from_fn),
            owners: triangles.map(|triangle| triangle.map_or_else(Owner::default, |(_, o)| o)),
        }
    }

    pub(super) fn owner(&self, lane: u32) -> Owner {
        self.owners[lane as usize % LANES]
    }

    pub(super) fn triangle(&self, lane: u32) -> [DVec3; 3] {
        let lane = lane as usize % LANES;
        self.corners.each_ref().map(|p| DVec3::new(p[0][lane], p[1][lane], p[2][lane]))
    }

    /// Its edges as seen from `origin` in the scaled frame.
    #[inline(always)]
    pub(super) fn seen_from<S: Simd>(&self, simd: S, origin: DVec3) -> Edges {
        let [a, b, c] = &self.corners;
        let a = from_point(simd, a, origin);
        let b = from_point(simd, b, origin);
        let c = from_point(simd, c, origin);
        Edges { normals: [cross(c, b), cross(a, c), cross(b, a)] }
    }
}

/// The planes through a point and a block's edges.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edges {
    /// By edge, axis and triangle: towards or away from the triangle's inside, for all
    /// three edges alike.
    normals: [[[f32; LANES]; 3]; 3],
}

impl Edges {
    /// Bit by ray from that point along `directions`, by axis, at most unit vectors:
    /// whether it could meet one of the triangles. Never less than [`ShearedRay::meets`]
    /// finds.
    #[inline(always)]
    pub(super) fn may_meet<S: Simd>(&self, simd: S, directions: &[[f32; RAYS]; 3]) -> u32 {
        // Rounding to f32 of a normal, a direction and their product costs less than
        // 4 · 2⁻²⁴ of the normal's absolute values; that of f64, here and there, less than
        // 2⁻²³ in all: coordinates from the point are below 2¹³, so that edge functions
        // are sums of a few products below 2²⁶, each within 2⁻⁵³.
        const RELATIVE: f32 = 1.0 / (1 << 21) as f32;
        const ABSOLUTE: f32 = 1.0 / (1 << 20) as f32;
        let zero = wide(simd, 0.0);
        let mut met = 0;
        for lane in 0..LANES {
            // Missing triangles come last.
            if self.normals[0][0][lane].is_nan() {
                break;
            }
            let margins = self.normals.map(
                #[inline(always)]
                |n| RELATIVE * (n[0][lane].abs() + n[1][lane].abs() + n[2][lane].abs()) + ABSOLUTE,
            );
            for at in (0..RAYS).step_by(16) {
                let x = f32x16::load_array_ref(simd, lanes(&directions[0], at));
                let y = f32x16::load_array_ref(simd, lanes(&directions[1], at));
                let z = f32x16::load_array_ref(simd, lanes(&directions[2], at));
                let (mut least, mut most) =
                    (wide(simd, f32::INFINITY), wide(simd, f32::NEG_INFINITY));
                for (normal, margin) in self.normals.iter().zip(margins) {
                    let margin = wide(simd, margin);
                    let side = z * wide(simd, normal[2][lane]);
                    let side = y.mul_add(wide(simd, normal[1][lane]), side);
                    let side = x.mul_add(wide(simd, normal[0][lane]), side);
                    least = least.min(side + margin);
                    most = most.max(side - margin);
                }
                met |= ((least.simd_ge(zero) | most.simd_le(zero)).to_bitmask() as u32) << at;
            }
        }
        met
    }
}

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Meeting {
    pub(super) t: f64,
    /// Edge functions opposite the second and the third corner, and the sum of all three.
    v: f64,
    w: f64,
    determinant: f64,
}

impl Meeting {
    /// Weights of the second and the third corner.
    #[inline]
    pub(super) fn barycentric(&self) -> (f64, f64) {
        (self.v / self.determinant, self.w / self.determinant)
    }
}

/// Where a ray meets the triangles of a block.
#[derive(Clone, Copy, Debug)]
pub(super) struct Meetings {
    /// Bit by triangle: whether it does.
    pub(super) met: u32,
    t: [f64; LANES],
    v: [f64; LANES],
    w: [f64; LANES],
    determinant: [f64; LANES],
}

impl Meetings {
    /// The next triangle that is met; there must be one.
    #[inline(always)]
    pub(super) fn take(&mut self) -> u32 {
        let lane = self.met.trailing_zeros();
        self.met &= self.met - 1;
        lane
    }

    #[inline(always)]
    pub(super) fn at(&self, lane: u32) -> Meeting {
        let lane = lane as usize % LANES;
        Meeting {
            t: self.t[lane],
            v: self.v[lane],
            w: self.w[lane],
            determinant: self.determinant[lane],
        }
    }
}

/// A ray in the scaled frame with the shear that turns it into +z (Woop et al.,
/// §3.1).
#[derive(Clone, Copy, Debug)]
pub(super) struct ShearedRay {
    origin: [f64; 3],
    /// The axes that become x, y and z.
    axes: [usize; 3],
    shear: [f64; 3],
}

impl ShearedRay {
    #[inline(always)]
    pub(super) fn new(origin: DVec3, direction: DVec3) -> Self {
        let z = direction.abs().max_position();
        let [x, y] = [(z + 1) % 3, (z + 2) % 3];
        let scale = direction[z].recip();
        let shear = [direction[x] * scale, direction[y] * scale, scale];
        Self { origin: origin.to_array(), axes: [x, y, z], shear }
    }

    /// Corners as the ray sees them: from its origin, sheared.
    #[inline(always)]
    fn turned<S: Simd>(&self, simd: S, corners: &[[f64; LANES]; 3]) -> [f64x4<S>; 3] {
        let [kx, ky, kz] = self.axes;
        let [sx, sy, _] = self.shear;
        let x = f64x4::load_array_ref(simd, &corners[kx]) - splat(simd, self.origin[kx]);
        let y = f64x4::load_array_ref(simd, &corners[ky]) - splat(simd, self.origin[ky]);
        let z = f64x4::load_array_ref(simd, &corners[kz]) - splat(simd, self.origin[kz]);
        [x - splat(simd, sx) * z, y - splat(simd, sy) * z, z]
    }

    /// Woop et al., §3.2, in f64 throughout, for `tmin < t <= tmax`. A vanishing
    /// edge function counts as inside: both neighbours of an edge get bitwise
    /// opposite values (no fused multiply and add here), so a ray through the edge
    /// is claimed by at least one of them.
    ///
    /// Departs from Woop et al. in having no fallback to a higher precision;
    /// theirs only settles which of the two neighbours is hit.
    #[inline(always)]
    pub(super) fn meets<S: Simd>(&self, simd: S, block: &Block, tmin: f64, tmax: f64) -> Meetings {
        let [a, b, c] = &block.corners;
        let (a, b, c) = (self.turned(simd, a), self.turned(simd, b), self.turned(simd, c));
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        let zero = splat(simd, 0.0);
        let inside = (u.simd_ge(zero) & v.simd_ge(zero) & w.simd_ge(zero))
            | (u.simd_le(zero) & v.simd_le(zero) & w.simd_le(zero));
        let met = inside.to_bitmask() as u32;
        if met == 0 {
            let none = [0.0; LANES];
            return Meetings { met, t: none, v: none, w: none, determinant: none };
        }
        // 0 over 0 where the triangle is seen edge on, and no meeting.
        let determinant = u + v + w;
        let t = splat(simd, self.shear[2]) * (u * a[2] + v * b[2] + w * c[2]) / determinant;
        let met = inside & t.simd_gt(splat(simd, tmin)) & t.simd_le(splat(simd, tmax));
        Meetings {
            met: met.to_bitmask() as u32,
            t: t.into(),
            v: v.into(),
            w: w.into(),
            determinant: determinant.into(),
        }
    }
}

#[inline(always)]
fn splat<S: Simd>(simd: S, x: f64) -> f64x4<S> {
    f64x4::splat(simd, x)
}

#[inline(always)]
fn wide<S: Simd>(simd: S, x: f32) -> f32x16<S> {
    f32x16::splat(simd, x)
}

#[inline(always)]
fn from_point<S: Simd>(simd: S, corner: &[[f64; LANES]; 3], point: DVec3) -> [f64x4<S>; 3] {
    [
        f64x4::load_array_ref(simd, &corner[0]) - splat(simd, point.x),
        f64x4::load_array_ref(simd, &corner[1]) - splat(simd, point.y),
        f64x4::load_array_ref(simd, &corner[2]) - splat(simd, point.z),
    ]
}

#[inline(always)]
fn cross<S: Simd>(p: [f64x4<S>; 3], q: [f64x4<S>; 3]) -> [[f32; LANES]; 3] {
    [
        single(p[1] * q[2] - p[2] * q[1]),
        single(p[2] * q[0] - p[0] * q[2]),
        single(p[0] * q[1] - p[1] * q[0]),
    ]
}

#[inline(always)]
fn single<S: Simd>(x: f64x4<S>) -> [f32; LANES] {
    [x[0] as f32, x[1] as f32, x[2] as f32, x[3] as f32]
}
