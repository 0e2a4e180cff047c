//! Geometries that several rules are tested on.

use crate::{
    Polygon,
    transport::{Support, TransportGeometry},
};
use glam::DVec3;

/// T_00 of two unit squares that face each other at distance 1: the mean of L
/// over the unit hypercube for L = 1, which is E/4 = π F / 4, with their form
/// factor F = 0.1998… in closed form (Howell, *Catalog of Radiation Heat Transfer
/// Configuration Factors*, C-11).
pub(super) const FACING: f64 = 0.199_824_895_698_387_46 * std::f64::consts::FRAC_PI_4;

type Case = (TransportGeometry, [Support; 2]);

fn case(origin: DVec3, edge_u: DVec3, edge_v: DVec3) -> Case {
    let source = Polygon::rectangle(origin, edge_u, edge_v).expect("a rectangle");
    let dest = Polygon::rectangle(DVec3::ZERO, DVec3::X, DVec3::Y).expect("a square");
    (TransportGeometry::new(source, dest), [Support::isotropic(0, [0; 4]); 2])
}

/// See [`FACING`].
pub(super) fn facing() -> Case {
    case(DVec3::Z, DVec3::Y, DVec3::X)
}

/// A square that no axis of the destination's is along.
pub(super) fn tilted() -> Case {
    let (u, v) = (DVec3::new(0.8, 0.36, 0.48), DVec3::new(0.0, 0.8, -0.6));
    case(DVec3::new(-0.3, 0.7, 1.2), v, u)
}

/// A source that fills a thousandth of the hemisphere, off the normal.
pub(super) fn far() -> Case {
    case(DVec3::new(4.3, 3.1, 20.0), DVec3::Y, DVec3::X)
}

/// A square that stands on an edge of the destination.
pub(super) fn shared_edge() -> Case {
    // n̂ = ẑ × x̂ = ŷ, over the destination.
    case(DVec3::ZERO, DVec3::Z, DVec3::X)
}
