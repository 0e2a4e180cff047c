//! The multiresolution index of the basis (Eq. 6–9, §7.2.1), with levels for
//! position apart from levels for direction.

/// How finely a tree resolves position (u, v) and direction (κ, λ).
///
/// The paper's nonstandard basis (Eq. 9) has one level for all four dimensions.
/// Here position and direction stop refining at levels of their own: a node at
/// depth d splits u and v while d < `position`, κ and λ while d < `direction`.
/// With both equal every node has 16 children and the basis is the paper's;
/// past the coarser level nodes have 4 children and 3 wavelets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Levels {
    /// Cells a side along u and along v: 2^`position`.
    pub position: u8,
    /// Cells a side along κ and along λ: 2^`direction`.
    pub direction: u8,
}

impl Levels {
    /// The finest level whose offsets fit 16 bits (§7.2.1).
    pub const MAX: u8 = 16;

    /// The paper's levels: the same for position and direction.
    ///
    /// # Panics
    ///
    /// If `level` is above [`MAX`](Self::MAX).
    #[must_use]
    pub fn isotropic(level: u8) -> Self {
        assert!(level <= Self::MAX, "level {level} is above {}", Self::MAX);
        Self { position: level, direction: level }
    }

    /// How many times the root is split to reach the finest cells.
    #[must_use]
    pub fn depth(self) -> u8 {
        self.position.max(self.direction)
    }

    /// Which dimensions a node at `depth` splits: bit 0 = u … bit 3 = λ.
    #[must_use]
    pub fn split(self, depth: u8) -> usize {
        (if depth < self.position { 0b0011 } else { 0 })
            | (if depth < self.direction { 0b1100 } else { 0 })
    }

    /// The L² normalisation at `depth`: the value of a scaling function on its
    /// cell, 2^(l_p + l_d); 4^l where the two levels agree.
    #[must_use]
    pub fn scale(self, depth: u8) -> f64 {
        let (p, d) = (depth.min(self.position), depth.min(self.direction));
        f64::from(1_u32 << u32::from(p)) * f64::from(1_u32 << u32::from(d))
    }

    /// Finest cells over (u, v): 4^`position`.
    #[must_use]
    pub fn positions(self) -> usize {
        1 << (2 * usize::from(self.position))
    }

    /// Finest cells over (κ, λ): 4^`direction`.
    #[must_use]
    pub fn directions(self) -> usize {
        1 << (2 * usize::from(self.direction))
    }
}

/// A cell of the hierarchy: the support of a node's functions.
///
/// Along u and v it is `[m, m + 1] / 2^min(depth, position level)`, along κ and
/// λ likewise with the direction level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Cell {
    /// Splits from the root.
    pub depth: u8,
    /// **m**, the offsets along u, v, κ, λ.
    pub m: [u16; 4],
}

impl Cell {
    /// The whole unit hypercube.
    pub const ROOT: Self = Self { depth: 0, m: [0; 4] };

    /// Child m′ of a node that splits the dimensions in `split`; m′'s bit d says
    /// which half along dimension d and is 0 where that is not split.
    #[must_use]
    pub fn child(self, split: usize, m_prime: usize) -> Self {
        debug_assert!(m_prime & !split == 0, "child {m_prime:04b} of a split {split:04b}");
        let m = std::array::from_fn(|d| {
            if split >> d & 1 == 1 { 2 * self.m[d] + (m_prime >> d & 1) as u16 } else { self.m[d] }
        });
        Self { depth: self.depth + 1, m }
    }
}

/// The children m′ of a node that splits the dimensions in `split`, increasing.
/// The same numbers are its basis selectors ν; ν = 0 is the pure smoothing one.
pub fn children(split: usize) -> impl Iterator<Item = usize> {
    (0..16).filter(move |m| m & !split == 0)
}

/// Names one basis function B_νl**m** of (u, v, κ, λ) in the paper's nonstandard
/// basis (Eq. 9, Fig. 6).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct WaveletIndex {
    /// ν, the basis selector: bit d is set where dimension d has ψ, not φ.
    pub nu: u8,
    /// l, the level; 0 is the whole unit hypercube.
    pub l: u8,
    /// **m**, the offsets along u, v, κ, λ; each is below 2^l.
    pub m: [u16; 4],
}

impl WaveletIndex {
    /// The whole hypercube's smoothing function.
    pub const ROOT: Self = Self { nu: 0, l: 0, m: [0; 4] };

    /// The smoothing function of child m′, whose bits 0 to 3 say which half
    /// along u, v, κ, λ.
    ///
    /// # Panics
    ///
    /// If `self` is at [`Levels::MAX`] or `m_prime` is above 15.
    #[must_use]
    pub fn child(self, m_prime: usize) -> Self {
        assert!(self.l < Levels::MAX, "no level below {self:?}");
        assert!(m_prime < 16, "a node has 16 children, not a number {m_prime}");
        let cell = Cell { depth: self.l, m: self.m }.child(0b1111, m_prime);
        Self { nu: 0, l: cell.depth, m: cell.m }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unequal_levels_split_jointly_then_alone() {
        let levels = Levels { position: 1, direction: 3 };
        let splits: Vec<usize> = (0..=3).map(|d| levels.split(d)).collect();
        assert_eq!(splits, [0b1111, 0b1100, 0b1100, 0]);
        assert_eq!(levels.scale(3), 2.0 * 8.0, "2^(1 + 3)");
    }

    #[test]
    fn children_tile_their_parent_once() {
        let parent = Cell { depth: 2, m: [1, 2, 3, 0] };
        let cells: std::collections::BTreeSet<_> =
            children(0b1100).map(|m| parent.child(0b1100, m)).collect();
        assert_eq!(cells.len(), 4, "{cells:?}");
        assert!(cells.iter().all(|c| c.m[..2] == [1, 2] && c.m[2] / 2 == 3 && c.m[3] / 2 == 0));
    }
}
