//! Outgoing radiance in Legendre polynomials: a quadtree over position, and under
//! each of its leaves one over direction, each leaf of which has orders of its own.
//!
//! Departs from §4 and §5 in three ways, for radiance that leaves a surface is
//! smooth. Boxes are polynomials (see [`Multiwavelet`](crate::multiwavelet)); order
//! 1 is Haar. Levels for position and for direction are independent, so that a
//! diffuse surface has one direction cell of order 1 and a glossy one few positions.
//! And directions lie on a square without a rim: see
//! [`DirectionMap`](crate::DirectionMap).
//!
//! [`project`] samples any [`Radiance`] at Gauss nodes, best first, until the last
//! degrees of all cells together are small, and then merges cells and lowers orders
//! where bytes buy the least. [`LegendreSampler`] looks the result up.

mod checks;
mod project;
mod prune;
mod reflected;
mod sampled;
mod sampler;
mod sampling;
mod tree;
mod views;

#[cfg(test)]
mod tests;

pub use project::{Orders, ProjectOptions, Projected, Radiance, UNSEEN_ERROR, project};
pub use reflected::Reflected;
pub use sampler::LegendreSampler;
pub use tree::{Census, LegendreTree, MAX_DEPTH, MAX_TREE_ORDER};
pub use views::ViewSet;

/// Polynomials of two variables of total degree below `order`: p (p + 1)/2.
pub(crate) const fn terms(order: usize) -> usize {
    order * (order + 1) / 2
}

/// The degrees in x and in y of those polynomials, by total degree: the terms of a
/// lower order come first.
pub(crate) fn degrees(order: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..order).flat_map(|degree| (0..=degree).map(move |y| (degree - y, y)))
}
