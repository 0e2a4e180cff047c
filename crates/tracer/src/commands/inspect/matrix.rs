//! The radiance of patches as the paper's Fig. 14 and 15: a matrix of position
//! images, one per direction cell.

use crate::film::Film;
use glam::{DVec3, Vec3};
use wrt_core::grid::{Grid, udc_fractions};
use wrt_core::{Cell, Levels, Patch, PatchGeometry, Polygon, Tree, TreeBuilder, children};

/// Pixels that a picture may have along a side: 2 × 2 tiles of 64⁴ have 8256.
const MAX_SIDE: usize = 8_400;

/// Finest cells of all patches in a picture: what is held in memory.
const MAX_CELLS: usize = 1 << 26;

/// Pixels along a side that a close-up is enlarged to.
const DETAIL_SIDE: usize = 1024;

/// Between images and outside the UDC, of a picture's white.
const GREY: f32 = 0.03;

/// Direction cells of which less lies inside the UDC are not shown: their
/// radiance is what thresholding left, divided by little.
const LEAST_FRACTION: f64 = 0.25;

/// Direction cells along κ and λ: the first, and how many.
pub(super) type Directions = [[usize; 2]; 2];

/// Patches that together are one rectangle.
pub(super) struct Mosaic<'a> {
    /// Row by row, from the lowest v, each from the lowest u.
    tiles: Vec<(&'a Patch, Grid)>,
    /// Tiles along u.
    columns: usize,
    levels: Levels,
    /// Of direction cells inside the UDC, κ fastest.
    fractions: Vec<f64>,
}

impl<'a> Mosaic<'a> {
    /// The patch with the most energy and, if together they tile a rectangle, all
    /// those that continue it; `None` if there are no patches.
    pub(super) fn of(patches: &'a [Patch]) -> Option<Self> {
        let energy = |patch: &&Patch| patch.tree.norm_squared();
        let most = patches.iter().max_by(|a, b| energy(a).total_cmp(&energy(b)))?;
        let (tiles, columns) = tiling(most, patches).unwrap_or_else(|| (vec![most], 1));
        let levels = shown(most.tree.levels(), [columns, tiles.len() / columns]);
        let grid = |patch: &'a Patch| (patch, means(&patch.tree, levels));
        Some(Self {
            tiles: tiles.into_iter().map(grid).collect(),
            columns,
            levels,
            fractions: udc_fractions(levels.direction),
        })
    }

    pub(super) fn patches(&self) -> impl Iterator<Item = &'a Patch> {
        self.tiles.iter().map(|tile| tile.0)
    }

    /// The levels shown: the patches' own unless those are too many pixels.
    pub(super) fn levels(&self) -> Levels {
        self.levels
    }

    /// The 4 × 4 direction cells with the most flux together; all, if there are
    /// fewer.
    fn brightest_directions(&self) -> Directions {
        let side = 1_usize << self.levels.direction;
        let window = side.min(4);
        let mut flux = vec![0.0; side * side];
        for (_, grid) in &self.tiles {
            let of_image = |image: &Vec<[f32; 3]>| -> f64 {
                image.iter().flatten().map(|&x| f64::from(x)).sum()
            };
            let sums: Vec<f64> = grid.images().iter().map(of_image).collect();
            for (d, flux) in flux.iter_mut().enumerate() {
                if let Some((image, scale)) = grid.slice(d) {
                    *flux += sums[image] * f64::from(scale);
                }
            }
        }
        let sum = |[k, l]: [usize; 2]| -> f64 {
            (l..l + window).map(|l| flux[l * side + k..][..window].iter().sum::<f64>()).sum()
        };
        let last = side - window;
        let starts = (0..=last).flat_map(|l| (0..=last).map(move |k| [k, l]));
        let best = starts.max_by(|&a, &b| sum(a).total_cmp(&sum(b))).unwrap_or_default();
        [best, [window; 2]]
    }

    /// Fig. 14: all directions, one pixel per position cell.
    pub(super) fn matrix(&self) -> Picture {
        self.picture([[0; 2], [1 << self.levels.direction; 2]], 1, 1)
    }

    /// Fig. 15: the brightest directions, enlarged.
    pub(super) fn detail(&self) -> Picture {
        let directions = self.brightest_directions();
        let [width, height] = self.image_size();
        let pixels = directions[1][0] * width.max(height);
        self.picture(directions, (DETAIL_SIDE / pixels).max(1), 4)
    }

    /// Position cells along u and v, of all tiles together.
    fn image_size(&self) -> [usize; 2] {
        [self.columns, self.tiles.len() / self.columns].map(|n| n << self.levels.position)
    }

    /// κ and u to the right, λ and v up; each position cell `scale` pixels wide,
    /// images `gap` pixels apart.
    fn picture(&self, directions: Directions, scale: usize, gap: usize) -> Picture {
        let [first, count] = directions;
        let size = self.image_size().map(|n| n * scale);
        let [width, height] = [0, 1].map(|i| count[i] * (size[i] + gap) + gap);
        // Which image, and where in it, from the left or from the bottom.
        let split = |at: usize, size: usize| {
            let at = at.checked_sub(gap)?;
            let inside = at % (size + gap);
            (inside < size).then_some((at / (size + gap), inside / scale))
        };
        let pixel = |i: usize| {
            let (k, x) = split(i % width, size[0])?;
            let (l, y) = split(height - 1 - i / width, size[1])?;
            self.radiance([first[0] + k, first[1] + l], [x, y])
        };
        Picture { directions, width, pixels: (0..width * height).map(pixel).collect() }
    }

    /// Radiance of a position cell in a direction cell, if that is inside the UDC.
    fn radiance(&self, [k, l]: [usize; 2], [x, y]: [usize; 2]) -> Option<Vec3> {
        let direction = l << self.levels.direction | k;
        let fraction = self.fractions[direction];
        if fraction < LEAST_FRACTION {
            return None;
        }
        let level = self.levels.position;
        let (_, grid) = &self.tiles[(y >> level) * self.columns + (x >> level)];
        let inside = (1 << level) - 1;
        Some(Vec3::from(grid.mean([x & inside, y & inside, k, l])) / fraction as f32)
    }
}

/// Rows of pixels from the top; `None` where there is no radiance to show.
pub(super) struct Picture {
    directions: Directions,
    width: usize,
    pixels: Vec<Option<Vec3>>,
}

impl Picture {
    /// Which directions it shows.
    pub(super) fn directions(&self) -> Directions {
        self.directions
    }

    /// The exposure in stops at which 99 % of the pixels that are not black stay
    /// below white.
    pub(super) fn exposure(&self) -> f32 {
        let peaks = self.pixels.iter().flatten().map(|rgb| rgb.max_element());
        let mut peaks: Vec<f32> = peaks.filter(|&x| x > 0.0).collect();
        if peaks.is_empty() {
            return 0.0;
        }
        let at = (peaks.len() - 1) * 99 / 100;
        -peaks.select_nth_unstable_by(at, f32::total_cmp).1.log2()
    }

    /// The pixels, with grey where there is nothing to show.
    pub(super) fn into_film(self, exposure: f32) -> Film {
        let grey = Vec3::splat(GREY * (-exposure).exp2());
        let pixels: Vec<Vec3> = self.pixels.into_iter().map(|p| p.unwrap_or(grey)).collect();
        Film { width: self.width, height: pixels.len() / self.width, pixels }
    }
}

/// The patches that continue `first` on all sides, row by row, and how many are
/// in a row; `None` unless they fill a rectangle.
fn tiling<'a>(first: &'a Patch, patches: &'a [Patch]) -> Option<(Vec<&'a Patch>, usize)> {
    let rectangle = |geometry: &PatchGeometry| -> Option<Polygon> {
        geometry.to_polygon().ok().filter(|p| p.fills_chart() && p.size().is_some())
    };
    let polygon = rectangle(&first.polygon)?;
    let (frame, size) = (polygon.frame(), polygon.size()?);
    let near = |a: DVec3, b: DVec3, tolerance: f64| a.distance(b) <= tolerance;
    // Which column and row from `first`.
    let place = |patch: &Patch| -> Option<[i64; 2]> {
        let other = rectangle(&patch.polygon)?;
        let tolerance = 1e-4 * size.min_element();
        let away = frame.to_local(other.frame().origin - frame.origin);
        let step = (away.truncate() / size).round();
        let same = patch.side == first.side
            && patch.tree.levels() == first.tree.levels()
            && near(other.frame().x, frame.x, 1e-4)
            && near(other.frame().n, frame.n, 1e-4)
            && other.size()?.distance(size) <= tolerance
            && near(away, (step * size).extend(0.0), tolerance);
        same.then_some([step.x as i64, step.y as i64])
    };
    let mut places: Vec<([i64; 2], &Patch)> =
        patches.iter().filter_map(|patch| Some((place(patch)?, patch))).collect();
    places.sort_by_key(|([column, row], _)| (*row, *column));
    let low = [0, 1].map(|i| places.iter().map(|p| p.0[i]).min().unwrap_or(0));
    let high = [0, 1].map(|i| places.iter().map(|p| p.0[i]).max().unwrap_or(0));
    let columns = usize::try_from(high[0].checked_sub(low[0])?).ok()? + 1;
    let expected = |i: usize| [low[0] + (i % columns) as i64, low[1] + (i / columns) as i64];
    let full = places.iter().enumerate().all(|(i, place)| place.0 == expected(i));
    (full && places.len().is_multiple_of(columns))
        .then(|| (places.into_iter().map(|place| place.1).collect(), columns))
}

/// The finest levels at which so many tiles fit into a picture and in memory.
fn shown(levels: Levels, tiles: [usize; 2]) -> Levels {
    let at = |depth: u8| Levels {
        position: levels.position.min(depth),
        direction: levels.direction.min(depth),
    };
    let fits = |levels: &Levels| {
        let side = |tiles: usize| ((tiles << levels.position) + 1) << levels.direction;
        let cells = levels.positions().saturating_mul(levels.directions());
        side(tiles[0].max(tiles[1])) <= MAX_SIDE
            && cells.saturating_mul(tiles[0] * tiles[1]) <= MAX_CELLS
    };
    (0..=levels.depth()).rev().map(at).find(fits).unwrap_or_else(|| at(0))
}

/// The tree's means over the cells of `levels`, no finer than its own.
fn means(tree: &Tree, levels: Levels) -> Grid {
    let mut builder = TreeBuilder::new(levels);
    builder.add_root(tree.root().map(f64::from));
    let mut cells = vec![Cell::ROOT; tree.nodes().len()];
    for (i, node) in tree.nodes().iter().enumerate() {
        let cell = cells[i];
        if cell.depth == levels.depth() {
            break;
        }
        let split = tree.levels().split(cell.depth);
        for m_prime in children(split) {
            if let Some(child) = node.child(m_prime) {
                cells[child] = cell.child(split, m_prime);
            }
        }
        let b = std::array::from_fn(|nu| match node.coefficient(nu) {
            Some(at) => tree.coefficients()[at].map(f64::from),
            None => [0.0; 3],
        });
        builder.add_node(cell, &b);
    }
    builder.finish().to_grid()
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrt_core::wct_file::{ChartKind, Side};

    const LEVELS: Levels = Levels { position: 1, direction: 3 };

    /// Radiance of a tile: red is the direction cell's number, green the position
    /// cell's, blue the tile's.
    fn patch(tile: usize, origin: [f64; 3]) -> Patch {
        let radiance = |d: usize, f: f64| {
            let texel = |p: usize| [d, p, tile].map(|x| (x as f64 * f) as f32);
            Some((0..4).map(texel).collect())
        };
        let fractions = udc_fractions(LEVELS.direction).into_iter().enumerate();
        let grid = Grid::from_images(LEVELS, fractions.map(|(d, f)| radiance(d, f)).collect());
        let [x, y, z] = origin;
        let vertices = vec![[x, y, z], [x + 2.0, y, z], [x + 2.0, y, z - 1.0], [x, y, z - 1.0]];
        Patch {
            name: tile.to_string(),
            polygon: PatchGeometry { vertices, chart: ChartKind::Rectilinear },
            side: Side::Outgoing,
            tree: TreeBuilder::from_grid(&grid).finish(),
            relative_error: 0.0,
            error_estimate: None,
        }
    }

    /// Two by two tiles of 2 m × 1 m, in no order.
    fn floor() -> Vec<Patch> {
        vec![
            patch(3, [2.0, 0.0, -1.0]),
            patch(0, [0.0, 0.0, 0.0]),
            patch(2, [0.0, 0.0, -1.0]),
            patch(1, [2.0, 0.0, 0.0]),
        ]
    }

    fn names(patches: &[Patch]) -> Vec<&str> {
        let mosaic = Mosaic::of(patches).expect("patches");
        mosaic.patches().map(|patch| patch.name.as_str()).collect()
    }

    #[test]
    fn tiles_of_a_rectangle_are_put_in_their_places() {
        assert_eq!(names(&floor()), ["0", "1", "2", "3"]);
        assert_eq!(names(&floor()[1..]), ["2"], "three do not: the one with the most energy");
        let apart = [patch(0, [0.0, 0.0, 0.0]), patch(1, [2.0, 0.5, 0.0])];
        assert_eq!(names(&apart), ["1"], "a step higher");
        let twice = [patch(0, [0.0, 0.0, 0.0]), patch(1, [0.0, 0.0, 0.0])];
        assert_eq!(names(&twice), ["1"], "in the same place");
    }

    #[test]
    fn kappa_goes_right_and_lambda_up() {
        let floor = floor();
        let mosaic = Mosaic::of(&floor).expect("patches");
        let picture = mosaic.matrix();
        // Eight images of 2 × 2 cells of 2 × 2 tiles, and nine lines between.
        assert_eq!((picture.width, picture.pixels.len()), (8 * 4 + 9, 41 * 41));
        let at = |x: usize, y_from_bottom: usize| picture.pixels[(40 - y_from_bottom) * 41 + x];
        assert_eq!(at(0, 20), None, "the line on the left");
        assert_eq!(at(1, 1), None, "a corner outside the UDC");
        // Direction cell κ = 5, λ = 2, hence 21; tile (1, 0); its cell (0, 1), hence 2.
        let found = at(1 + 5 * 5 + 2, 1 + 2 * 5 + 1).expect("inside the UDC");
        assert!((found - Vec3::new(21.0, 2.0, 1.0)).length() < 1e-4, "{found}");
    }

    #[test]
    fn a_close_up_shows_the_brightest_directions() {
        let floor = floor();
        let mosaic = Mosaic::of(&floor).expect("patches");
        // Red grows with λ most, but the top rows have cells outside the UDC.
        let [first, count] = mosaic.detail().directions();
        assert_eq!(count, [4, 4]);
        assert_eq!(first[1], 4, "{first:?}");
    }

    #[test]
    fn exposure_leaves_one_pixel_in_a_hundred_above_white() {
        let pixels = (0..=1000).map(|i| Some(Vec3::splat(i as f32 / 250.0))).collect();
        let picture = Picture { directions: [[0; 2]; 2], width: 1, pixels };
        let white = (-picture.exposure()).exp2();
        assert!((white - 3.96).abs() < 0.01, "{white}");
    }

    #[test]
    fn too_many_cells_are_shown_as_means() {
        assert_eq!(shown(Levels::isotropic(5), [4, 4]), Levels::isotropic(5));
        assert_eq!(shown(Levels::isotropic(7), [1, 1]), Levels::isotropic(6));
        assert_eq!(shown(Levels::isotropic(16), [1, 1]), Levels::isotropic(6));
        let patch = patch(1, [0.0; 3]);
        let coarse = means(&patch.tree, Levels { position: 1, direction: 2 });
        let fine = patch.tree.to_grid();
        for d in 0..16 {
            let (k, l) = (2 * (d & 3), 2 * (d >> 2));
            let parts = [[k, l], [k + 1, l], [k, l + 1], [k + 1, l + 1]];
            let mean = parts.iter().map(|&[k, l]| fine.mean([1, 0, k, l])[0]).sum::<f32>() / 4.0;
            assert!((coarse.mean([1, 0, d & 3, d >> 2])[0] - mean).abs() < 1e-4, "{d}");
        }
    }
}
