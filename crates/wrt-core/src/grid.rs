//! Radiance as plain means over the finest cells: what transport and reflection
//! compute with, one position image per direction cell.

use crate::{Levels, udc_fraction};

/// Radiance of the three channels.
pub type Rgb = [f32; 3];

/// Means of a radiance over the cells of [`Levels`], zeros outside the UDC
/// counted; direction cells without light hold nothing.
///
/// An image may serve many direction cells at different scales, as the picture
/// of a window does that is the same from everywhere but for its lobe.
#[derive(Clone, Debug)]
pub struct Grid {
    levels: Levels,
    /// Each `positions()` long, u fastest.
    images: Vec<Vec<Rgb>>,
    /// Per direction cell, κ fastest: which image, times what.
    slices: Vec<Option<(u32, f32)>>,
}

impl Grid {
    /// No light at all.
    #[must_use]
    pub fn dark(levels: Levels) -> Self {
        Self { levels, images: Vec::new(), slices: vec![None; levels.directions()] }
    }

    /// The grid with these position images, one per direction cell (κ fastest).
    ///
    /// # Panics
    ///
    /// If there are not `levels.directions()` of them, or one does not have
    /// `levels.positions()` texels.
    #[must_use]
    pub fn from_images(levels: Levels, images: Vec<Option<Vec<Rgb>>>) -> Self {
        assert_eq!(images.len(), levels.directions(), "one image or none per direction cell");
        let mut grid = Self::dark(levels);
        for (slice, image) in grid.slices.iter_mut().zip(images) {
            let Some(image) = image else { continue };
            assert_eq!(image.len(), levels.positions(), "an image covers all positions");
            *slice = Some((grid.images.len() as u32, 1.0));
            grid.images.push(image);
        }
        grid
    }

    /// One position image seen from all directions, times `lobe` (one factor per
    /// direction cell, κ fastest): a product of position and direction.
    ///
    /// # Panics
    ///
    /// If the lengths do not fit `levels`.
    #[must_use]
    pub fn separable(levels: Levels, image: Vec<Rgb>, lobe: &[f32]) -> Self {
        assert_eq!(image.len(), levels.positions(), "an image covers all positions");
        assert_eq!(lobe.len(), levels.directions(), "a factor per direction cell");
        let slices = lobe.iter().map(|&f| (f != 0.0).then_some((0, f))).collect();
        Self { levels, images: vec![image], slices }
    }

    /// The sum of several grids: light from several sources.
    ///
    /// # Panics
    ///
    /// If their levels differ from `levels`.
    #[must_use]
    pub fn sum(levels: Levels, grids: impl IntoIterator<Item = Self>) -> Self {
        let mut grids: Vec<Self> = grids.into_iter().collect();
        assert!(grids.iter().all(|grid| grid.levels == levels), "grids of equal levels");
        if grids.len() == 1 {
            return grids.remove(0);
        }
        let image = |d: usize| {
            let lit = grids.iter().filter_map(|grid| grid.slice(d).map(|slice| (grid, slice)));
            lit.fold(None, |sum: Option<Vec<Rgb>>, (grid, (image, scale))| {
                let mut sum = sum.unwrap_or_else(|| vec![[0.0; 3]; levels.positions()]);
                for (sum, rgb) in sum.iter_mut().zip(&grid.images[image]) {
                    *sum = std::array::from_fn(|c| sum[c] + scale * rgb[c]);
                }
                Some(sum)
            })
        };
        Self::from_images(levels, (0..levels.directions()).map(image).collect())
    }

    /// Its levels.
    #[must_use]
    pub fn levels(&self) -> Levels {
        self.levels
    }

    /// The distinct images.
    #[must_use]
    pub fn images(&self) -> &[Vec<Rgb>] {
        &self.images
    }

    /// The image of a direction cell (κ fastest) by its number, and its factor;
    /// `None` where it is dark.
    #[must_use]
    pub fn slice(&self, direction: usize) -> Option<(usize, f32)> {
        self.slices[direction].map(|(image, scale)| (image as usize, scale))
    }

    /// The mean radiance over the cell with offsets **m** = (u, v, κ, λ).
    #[must_use]
    pub fn mean(&self, m: [usize; 4]) -> Rgb {
        let (position, direction) = self.offsets(m);
        match self.slices[direction] {
            Some((image, scale)) => self.images[image as usize][position].map(|x| x * scale),
            None => [0.0; 3],
        }
    }

    /// Index of the position within an image and of the direction among slices.
    #[must_use]
    pub fn offsets(&self, m: [usize; 4]) -> (usize, usize) {
        (m[1] << self.levels.position | m[0], m[3] << self.levels.direction | m[2])
    }

    /// ‖L‖² over the unit hypercube, all channels together.
    #[must_use]
    pub fn norm_squared(&self) -> f64 {
        let energy = |image: &Vec<Rgb>| -> f64 {
            image.iter().flatten().map(|&x| f64::from(x) * f64::from(x)).sum()
        };
        let energies: Vec<f64> = self.images.iter().map(energy).collect();
        let sum: f64 = self
            .slices
            .iter()
            .flatten()
            .map(|&(image, scale)| energies[image as usize] * f64::from(scale).powi(2))
            .sum();
        sum / (self.levels.positions() * self.levels.directions()) as f64
    }

    /// Irradiance E = 4 Σ L Δκ Δλ at each position, u fastest (Eq. 12).
    #[must_use]
    pub fn irradiance(&self) -> Vec<[f64; 3]> {
        let weight = 4.0 / self.levels.directions() as f64;
        let mut sum = vec![[0.0; 3]; self.levels.positions()];
        for &(image, scale) in self.slices.iter().flatten() {
            for (e, l) in sum.iter_mut().zip(&self.images[image as usize]) {
                for (e, l) in e.iter_mut().zip(l) {
                    *e += weight * f64::from(scale) * f64::from(*l);
                }
            }
        }
        sum
    }
}

/// Each direction cell's fraction inside the UDC, κ fastest.
#[must_use]
pub fn udc_fractions(level: u8) -> Vec<f64> {
    let side = 1_u32 << u32::from(level);
    let at = |m: u32| f64::from(m) / f64::from(side);
    let cell = |l: u32, k: u32| udc_fraction([at(k), at(l)], [at(k + 1), at(l + 1)]);
    (0..side).flat_map(|l| (0..side).map(move |k| cell(l, k))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn separable_light_has_the_irradiance_of_its_lobe() {
        let levels = Levels { position: 1, direction: 4 };
        let lobe: Vec<f32> = udc_fractions(4).iter().map(|&f| f as f32).collect();
        let grid = Grid::separable(levels, vec![[1.0, 2.0, 3.0]; 4], &lobe);
        for e in grid.irradiance() {
            for (channel, e) in e.iter().enumerate() {
                let expected = std::f64::consts::PI * (channel + 1) as f64;
                assert!((e - expected).abs() < 1e-6 * expected, "E = π L: {e}");
            }
        }
    }
}
