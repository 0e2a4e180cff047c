//! Radiance of one patch in either basis, at a point or over what a camera ray stands
//! for.
//!
//! Where that is larger than the patch's finest cells, one look-up at its middle would
//! leave to chance which cell a pixel shows. Boxes have the means over larger cells
//! (a tree is its own mip chain); along the longer axis of what is seen, and of
//! polynomials along both, a few places stand for the whole.

use glam::{DVec2, DVec3, Vec3};
use wrt_core::MipSampler;
use wrt_core::legendre::LegendreSampler;

/// The most look-ups along the longer axis, as for textures of surfaces.
const MAX_ANISOTROPY: f64 = 16.0;

/// The most look-ups of polynomials along an axis.
const MAX_STEPS: f64 = 4.0;

/// A step to a neighbouring camera ray, in the patch's frame.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Change {
    /// As parts of the patch's sides.
    pub(super) uv: DVec2,
    /// Of the unit vector to the eye.
    pub(super) mu: DVec3,
}

impl Change {
    /// Extents in position, and in κ and λ.
    fn lengths(&self) -> [f64; 2] {
        [self.uv.length(), 0.5 * self.mu.truncate().length()]
    }

    /// In cells of 2^-level, the larger of the two.
    fn cells(&self, levels: [u8; 2]) -> f64 {
        let [position, direction] = self.lengths();
        let [p, d] = levels.map(|level| f64::from(level).exp2());
        (position * p).max(direction * d)
    }
}

/// A patch's radiance.
#[derive(Debug)]
pub(super) enum LookUp {
    Haar(Box<MipSampler>),
    /// With the levels of its finest cells, of position and direction.
    Smooth(LegendreSampler, [u8; 2]),
}

impl LookUp {
    pub(super) fn haar(sampler: MipSampler) -> Self {
        Self::Haar(Box::new(sampler))
    }

    pub(super) fn smooth(sampler: LegendreSampler) -> Self {
        let finest = sampler.finest_levels();
        Self::Smooth(sampler, finest)
    }

    /// Radiance at (u, v) towards `mu`, of the upper hemisphere; of boxes that of the
    /// nearest.
    pub(super) fn nearest(&self, uv: DVec2, mu: DVec3) -> [f32; 3] {
        match self {
            Self::Haar(sampler) => sampler.finest().box_value(point(uv, mu)),
            Self::Smooth(sampler, _) => sampler.radiance(uv, mu),
        }
    }

    /// The mean radiance around (u, v) and `mu` over half of `changes` to either side.
    pub(super) fn over(&self, uv: DVec2, mu: DVec3, changes: [Change; 2]) -> [f32; 3] {
        match self {
            Self::Haar(sampler) => {
                let levels = sampler.finest().levels();
                haar(sampler, [levels.position, levels.direction], uv, mu, changes)
            }
            Self::Smooth(sampler, levels) => {
                let steps = changes.map(|change| steps(change.cells(*levels), MAX_STEPS));
                if steps == [1, 1] {
                    return sampler.radiance(uv, mu);
                }
                let along = |i: usize| places(steps[i]).map(move |at| (at, changes[i]));
                let all = along(0).flat_map(|a| along(1).map(move |b| [a, b]));
                mean(all.map(|moves| {
                    let (uv, mu) = moves.iter().fold((uv, mu), |(uv, mu), (at, change)| {
                        (uv + *at * change.uv, mu + *at * change.mu)
                    });
                    sampler.radiance(uv, raised(mu))
                }))
            }
        }
    }
}

fn haar(
    sampler: &MipSampler,
    levels: [u8; 2],
    uv: DVec2,
    mu: DVec3,
    [across, down]: [Change; 2],
) -> [f32; 3] {
    let (mut long, mut short) = (across, down);
    if long.cells(levels) < short.cells(levels) {
        (long, short) = (short, long);
    }
    let (length, width) = (long.cells(levels), short.cells(levels));
    if length <= 1.0 {
        return sampler.finest().multilinear(point(uv, mu));
    }
    let steps = steps(length / width.max(1.0), MAX_ANISOTROPY);
    let [part, whole] = [long.lengths().map(|l| l / steps as f64), short.lengths()];
    let footprint = [part[0].max(whole[0]), part[1].max(whole[1])];
    mean(places(steps).map(|at| {
        let [u, v, kappa, lambda] = point(uv, mu);
        let [duv, dmu] = [at * long.uv, 0.5 * at * long.mu.truncate()];
        let q = [u + duv.x, v + duv.y, kappa + dmu.x, lambda + dmu.y];
        sampler.value(q, footprint)
    }))
}

/// How many look-ups something of so many cells takes.
fn steps(cells: f64, most: f64) -> usize {
    // Not a number: one.
    cells.ceil().min(most).max(1.0) as usize
}

/// The middles of `steps` parts of −½ to ½.
fn places(steps: usize) -> impl Iterator<Item = f64> + Clone {
    (0..steps).map(move |i| (i as f64 + 0.5) / steps as f64 - 0.5)
}

fn mean(values: impl Iterator<Item = [f32; 3]>) -> [f32; 3] {
    let (sum, count) =
        values.fold((Vec3::ZERO, 0), |(sum, count), value| (sum + Vec3::from(value), count + 1));
    (sum / count as f32).to_array()
}

/// (u, v, κ, λ).
fn point(uv: DVec2, mu: DVec3) -> [f64; 4] {
    let q = 0.5 * (raised(mu).truncate() + DVec2::ONE);
    [uv.x, uv.y, q.x, q.y]
}

/// The unit vector along `mu`, at the horizon if it is below.
fn raised(mu: DVec3) -> DVec3 {
    mu.with_z(mu.z.max(0.0)).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::array::{uniform2, uniform4};
    use proptest::prelude::*;
    use std::sync::LazyLock;
    use wrt_core::grid::udc_fractions;
    use wrt_core::legendre::{ProjectOptions, Radiance, project};
    use wrt_core::{Grid, Levels, TreeBuilder};

    const LEVELS: Levels = Levels { position: 4, direction: 2 };

    /// Every other column of boxes bright, all directions alike.
    static COLUMNS: LazyLock<LookUp> = LazyLock::new(|| {
        let texel = |i: usize| [(i % 2) as f32; 3];
        let lobe: Vec<f32> = udc_fractions(2).into_iter().map(|f| f as f32).collect();
        let grid = Grid::separable(LEVELS, (0..256).map(texel).collect(), &lobe);
        LookUp::haar(MipSampler::new(&TreeBuilder::from_grid(&grid).finish()))
    });

    fn change(u: f64, v: f64) -> Change {
        Change { uv: DVec2::new(u, v), ..Change::default() }
    }

    #[test]
    fn pixels_of_many_boxes_show_their_mean() {
        let (columns, mu) = (&COLUMNS, DVec3::new(0.1, 0.2, 1.0).normalize());
        for u in [0.4, 0.43, 0.46, 0.5, 0.53] {
            let at = DVec2::new(u, 0.37);
            let [seen, ..] = columns.over(at, mu, [change(0.0, 0.3), change(0.25, 0.0)]);
            assert!((seen - 0.5).abs() < 0.02, "u = {u}: {seen}");
        }
        let [dark, ..] = columns.over(DVec2::new(0.40625, 0.37), mu, [Change::default(); 2]);
        assert!(dark < 0.01, "a point in a dark column: {dark}");
    }

    #[test]
    fn long_narrow_pixels_are_not_blurred_across() {
        let (columns, mu) = (&COLUMNS, DVec3::Z);
        let pixel = [change(0.0, 0.5), change(0.04, 0.0)];
        for (u, expected) in [(0.40625, 0.0), (0.46875, 1.0)] {
            let [seen, ..] = columns.over(DVec2::new(u, 0.5), mu, pixel);
            assert!((seen - expected).abs() < 0.01, "u = {u}: {seen}");
        }
    }

    proptest! {
        #[test]
        fn pixels_within_a_box_are_points(
            at in uniform4(0.0..1.0), a in uniform2(-0.04..0.04), b in uniform2(-0.04..0.04),
            turn in -0.3..0.3,
        ) {
            let LookUp::Haar(sampler) = &*COLUMNS else { unreachable!() };
            let mu = DVec3::new(at[2] - 0.5, at[3] - 0.5, 0.6).normalize();
            let uv = DVec2::new(at[0], at[1]);
            let turned = Change { mu: DVec3::X * turn, ..change(a[0], a[1]) };
            let seen = COLUMNS.over(uv, mu, [turned, change(b[0], b[1])]);
            prop_assert_eq!(seen, sampler.finest().multilinear(point(uv, mu)));
        }

        /// Neither the size of what is seen nor a ray along the horizon may do harm.
        #[test]
        fn any_pixel_gives_what_the_patch_has(
            at in uniform2(0.0..1.0), mu in uniform2(-1.0..1.0), sizes in uniform4(-6.0..9.0),
        ) {
            let z = (1.0 - DVec2::from(mu).length_squared()).max(0.0);
            let mu = DVec3::new(mu[0], mu[1], z.sqrt() + 1e-12).normalize();
            let [a, b, c, d] = sizes.map(|x: f64| x.exp2());
            let pixel = [change(a, b), Change { mu: DVec3::new(c, -d, 0.1), ..change(-b, c) }];
            // Boxes go straight on from the last centre to the border: half of a column's
            // step past dark and bright.
            for (patch, low, high) in [(&COLUMNS, -0.5, 1.5), (&RIPPLES, 0.0, 2.0)] {
                for value in patch.over(DVec2::from(at), mu, pixel) {
                    prop_assert!((low - 0.02..=high + 0.02).contains(&value), "{value}");
                }
            }
        }
    }

    /// Eight periods of a cosine along u about 1.
    struct Ripples;

    impl Radiance for Ripples {
        type Place = f64;

        fn place(&self, uv: DVec2) -> f64 {
            1.0 + (std::f64::consts::TAU * 8.0 * uv.x).cos()
        }

        fn radiance(&self, place: &f64, _: DVec3) -> [f64; 3] {
            [*place; 3]
        }

        fn scale(&self) -> f64 {
            f64::INFINITY
        }
    }

    static RIPPLES: LazyLock<LookUp> = LazyLock::new(|| {
        let options = ProjectOptions { error: 5e-3, ..ProjectOptions::default() };
        LookUp::smooth(LegendreSampler::new(&project(&Ripples, &options).tree))
    });

    #[test]
    fn pixels_of_many_ripples_show_their_mean() {
        let at = |u: f64, wide: f64| {
            RIPPLES.over(DVec2::new(u, 0.5), DVec3::Z, [change(wide, 0.0), Change::default()])[0]
        };
        for u in [0.25, 0.3, 0.34, 0.375] {
            assert!((at(u, 0.25) - 1.0).abs() < 0.02, "u = {u}: {}", at(u, 0.25));
        }
        assert!((at(0.25, 0.0) - 2.0).abs() < 0.03, "a crest: {}", at(0.25, 0.0));
    }
}
