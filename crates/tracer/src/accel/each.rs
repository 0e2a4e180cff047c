//! Several rays at a time that have nothing in common, such as those that mirrors and glass
//! send on. They find what each would find alone.

use super::wide::each::RAYS;
use super::wide::fan::bits;
use super::{Accel, Entered, Found, Ray, SlabRay};
use fearless_simd::{Simd, dispatch};

impl Accel {
    /// [`find`](Self::find) along each of `rays`, however far, put into `found`.
    pub(crate) fn find_each(&self, rays: &[Ray], found: &mut Vec<Option<Found>>) {
        found.clear();
        found.resize(rays.len(), None);
        for (rays, found) in rays.chunks(RAYS).zip(found.chunks_mut(RAYS)) {
            dispatch!(self.level, simd => self.find_each_with(simd, rays, found));
        }
    }

    #[inline(always)]
    fn find_each_with<S: Simd>(&self, simd: S, rays: &[Ray], found: &mut [Option<Found>]) {
        let mut slabs = [SlabRay::NONE; RAYS];
        let mut entered: [Option<Entered>; RAYS] = [const { None }; RAYS];
        let mut tmax = [0.0; RAYS];
        let mut of = 0;
        for (i, ray) in rays.iter().enumerate() {
            let Some(ray) = self.enter(ray.origin, ray.direction, ray.from, f64::INFINITY) else {
                continue;
            };
            (slabs[i], tmax[i]) = (ray.slabs, ray.tmax);
            entered[i] = Some(ray);
            of |= 1 << i;
        }
        let left = self.hierarchy.traverse_each(
            simd,
            &slabs,
            of,
            #[inline(always)]
            |i, block| {
                let Some(ray) = &entered[i] else { return 0.0 };
                self.closer(simd, block, &ray.sheared, ray.tmin, &mut tmax[i], &mut found[i]);
                ray.single(tmax[i])
            },
        );
        for i in bits(left) {
            let Ray { origin, direction, from } = rays[i];
            found[i] = self.find_with(simd, origin, direction, from, f64::INFINITY);
        }
    }
}
