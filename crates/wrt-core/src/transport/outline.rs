//! A source's picture as the borders at which its radiance changes, and their
//! shadows on the destination along one direction.
//!
//! What is constant between straight borders has ∬ L du dv = ∮ L u dv over them: the
//! integral of a picture needs its jumps alone. Texels that hold nothing and panes of
//! one colour cost nothing, and any chart of the source will do; of the destination
//! any that keeps the lines of its grid straight.

use super::TransportGeometry;
use super::cover::Cover;
use crate::Chart;
use crate::grid::Rgb;
use glam::{DMat3, DVec2, DVec3};

/// All borders of one picture, in the destination's frame and on its front.
#[derive(Clone, Debug, Default)]
pub(super) struct Outline {
    points: Vec<DVec3>,
    borders: Vec<Border>,
}

/// A straight border from point to point; what is brighter on its left than on its
/// right, seen from the source's front.
#[derive(Clone, Copy, Debug)]
struct Border {
    from: u32,
    to: u32,
    jump: Rgb,
}

/// The corners of a source's texels, `side` a side, in the destination's frame; u
/// fastest.
pub(super) fn corners(geometry: &TransportGeometry, side: usize) -> Vec<DVec3> {
    let chart = geometry.source().chart();
    let at = |i: usize| {
        let uv = DVec2::new((i % (side + 1)) as f64, (i / (side + 1)) as f64) / side as f64;
        geometry.source_to_dest(chart.to_plane(uv))
    };
    let mut points: Vec<DVec3> = (0..(side + 1) * (side + 1)).map(at).collect();
    // A shared edge lies on the destination's plane up to rounding.
    let extent = points.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
    for p in &mut points {
        if p.z.abs() <= 1e-12 * extent {
            p.z = 0.0;
        }
    }
    points
}

/// Where the line from `a` to `b` meets the destination's plane.
fn foot(a: DVec3, b: DVec3) -> DVec3 {
    (a + (b - a) * (a.z / (a.z - b.z))).with_z(0.0)
}

impl Outline {
    /// The borders of a picture between texels with these [`corners`].
    ///
    /// What of it lies behind the destination's plane is cut away. A destination
    /// point in front of the source sees only what is in front of the destination,
    /// so that this also cuts the destination by the source's plane.
    pub(super) fn new(corners: &[DVec3], picture: &[Rgb], side: usize) -> Self {
        let mut outline = Self::default();
        let mut numbers = vec![u32::MAX; corners.len()];
        let texel = |u: usize, v: usize| {
            // Past either end there is nothing; −1 wraps to the far end.
            if u < side && v < side { picture[v * side + u] } else { [0.0; 3] }
        };
        let corner = |u: usize, v: usize| v * (side + 1) + u;
        // Lines of constant u and of constant v; runs of equal jumps are one border.
        for (line, upright) in (0..=side).flat_map(|line| [(line, true), (line, false)]) {
            let jump = |along: usize| -> Rgb {
                let (left, right) = if upright {
                    (texel(line.wrapping_sub(1), along), texel(line, along))
                } else {
                    (texel(along, line), texel(along, line.wrapping_sub(1)))
                };
                std::array::from_fn(|c| left[c] - right[c])
            };
            let at = |along| if upright { corner(line, along) } else { corner(along, line) };
            let mut from = 0;
            while from < side {
                let own = jump(from);
                let to = (from + 1..side).find(|&along| jump(along) != own).unwrap_or(side);
                if own != [0.0; 3] {
                    outline.add(corners, &mut numbers, [at(from), at(to)], own);
                }
                from = to;
            }
        }
        outline.close(corners, picture, side);
        outline
    }

    /// Number of borders.
    pub(super) fn len(&self) -> usize {
        self.borders.len()
    }

    /// Adds the part of a border in front of the destination.
    fn add(&mut self, corners: &[DVec3], numbers: &mut [u32], ends: [usize; 2], jump: Rgb) {
        let [a, b] = ends.map(|end| corners[end]);
        if a.z <= 0.0 && b.z <= 0.0 {
            // On the plane itself it is `close` that adds it.
            return;
        }
        let [from, to] = [(a, b, ends[0]), (b, a, ends[1])].map(|(own, other, end)| {
            if own.z < 0.0 {
                self.points.push(foot(other, own));
                return self.points.len() as u32 - 1;
            }
            if numbers[end] == u32::MAX {
                numbers[end] = self.points.len() as u32;
                self.points.push(own);
            }
            numbers[end]
        });
        self.borders.push(Border { from, to, jump });
    }

    /// Adds the line in which the source meets the destination's plane: there the
    /// texels in front end.
    fn close(&mut self, corners: &[DVec3], picture: &[Rgb], side: usize) {
        for (i, &jump) in picture.iter().enumerate() {
            let (u, v) = (i % side, i / side);
            let corner = |du: usize, dv: usize| corners[(v + dv) * (side + 1) + u + du];
            let around = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
            if jump == [0.0; 3] || around.iter().all(|p| p.z > 0.0) {
                continue;
            }
            let (mut last, mut first) = (None, None);
            for k in 0..4 {
                let (a, b) = (around[k], around[(k + 1) % 4]);
                if a.z > 0.0 && b.z <= 0.0 {
                    last = Some(foot(a, b));
                } else if a.z <= 0.0 && b.z > 0.0 {
                    first = Some(foot(b, a));
                }
            }
            if let (Some(last), Some(first)) = (last, first) {
                let from = self.points.len() as u32;
                self.points.extend([last, first]);
                self.borders.push(Border { from, to: from + 1, jump });
            }
        }
    }

    /// Adds to `cover` what the picture, `weight` times as bright, gives along `mu`.
    /// `shadows` is room for the points' shadows.
    pub(super) fn shine(
        &self,
        plane: &Plane,
        mu: DVec3,
        weight: f64,
        shadows: &mut Vec<DVec3>,
        cover: &mut Cover,
    ) {
        let slope = mu.truncate() / mu.z;
        shadows.clear();
        shadows.extend(self.points.iter().map(|p| plane.cells(p.truncate() - slope * p.z)));
        // A shadow is the mirror image of a source that faces the destination.
        let weight = if plane.mirrored() { -weight } else { weight };
        for border in &self.borders {
            let (a, b) = (shadows[border.from as usize], shadows[border.to as usize]);
            if let Some((a, b)) = plane.on_grid(a, b) {
                cover.add(a, b, border.jump.map(|x| weight * f64::from(x)));
            }
        }
    }
}

/// From the destination's plane to its grid of cells.
#[derive(Clone, Copy, Debug)]
pub(super) enum Plane {
    /// A rectilinear chart.
    Affine {
        /// Cells per unit of length along x and along y.
        scale: DVec2,
    },
    /// A perspective chart.
    Projective {
        /// Homogeneous plane coordinates to cells.
        to_cells: DMat3,
        /// Cells a side.
        cells: f64,
        /// Whether columns run backwards.
        mirrored: bool,
    },
}

impl Plane {
    /// `None` for a chart that bends lines.
    pub(super) fn of(chart: &Chart, cells: usize) -> Option<Self> {
        let cells = cells as f64;
        match chart {
            Chart::Rectilinear { width, height } => {
                Some(Self::Affine { scale: cells / DVec2::new(*width, *height) })
            }
            Chart::Perspective { to_plane, to_uv } => {
                // Borders left of a cell count in it, on and on: the lines of
                // constant v must not meet there, so that w grows with u.
                let mirrored = to_plane.x_axis.z < 0.0;
                let turn = if mirrored {
                    DMat3::from_cols(DVec3::NEG_X, DVec3::Y, DVec3::new(1.0, 0.0, 1.0))
                } else {
                    DMat3::IDENTITY
                };
                let grow = DMat3::from_diagonal(DVec3::new(cells, cells, 1.0));
                Some(Self::Projective { to_cells: grow * turn * *to_uv, cells, mirrored })
            }
            Chart::Bilinear { .. } => None,
        }
    }

    /// Whether columns come out in reverse.
    pub(super) fn mirrored(&self) -> bool {
        matches!(self, Self::Projective { mirrored: true, .. })
    }

    /// A point of the plane in cells, homogeneous.
    fn cells(&self, point: DVec2) -> DVec3 {
        match self {
            Self::Affine { scale } => (point * *scale).extend(1.0),
            Self::Projective { to_cells, .. } => *to_cells * point.extend(1.0),
        }
    }

    /// The ends of a segment on the grid; `None` if it is right of it or has no rise
    /// on it.
    fn on_grid(&self, a: DVec3, b: DVec3) -> Option<(DVec2, DVec2)> {
        let Self::Projective { cells, .. } = self else {
            return Some((a.truncate(), b.truncate()));
        };
        let (mut from, mut to) = (0.0_f64, 1.0_f64);
        // Between the grid's first line and its last, left of its right end. All of
        // that lies in front of the horizon, w > 0.
        let sides = |p: DVec3| [p.y, cells * p.z - p.y, cells * p.z - p.x];
        for (p, q) in sides(a).into_iter().zip(sides(b)) {
            match (p < 0.0, q < 0.0) {
                (true, true) => return None,
                (true, false) => from = from.max(p / (p - q)),
                (false, true) => to = to.min(p / (p - q)),
                (false, false) => {}
            }
        }
        let at = |t: f64| a + (b - a) * t;
        let (a, b) = (at(from), at(to));
        (from < to && a.z > 0.0 && b.z > 0.0).then(|| (a.truncate() / a.z, b.truncate() / b.z))
    }
}
