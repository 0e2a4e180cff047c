//! Any smooth radiance to a [`LegendreTree`].

use super::checks::Checks;
use super::prune::prune;
use super::sampled::View;
use super::sampling::{Position, Sampling, count, norm_squared};
use super::tree::{Cells, MAX_DEPTH, MAX_TREE_ORDER};
use super::{LegendreTree, ViewSet};
use crate::DirectionMap;
use glam::{DVec2, DVec3};

/// A radiance that can be asked for anywhere.
pub trait Radiance: Sync {
    /// What is worked out once per position.
    type Place: Send + Sync;

    /// Prepares position (u, v) of the unit square.
    fn place(&self, uv: DVec2) -> Self::Place;

    /// The radiance there towards the unit direction `mu`, W m⁻² sr⁻¹. A `mu` below
    /// the horizon asks for the continuation of what is above, as smooth as can be.
    fn radiance(&self, place: &Self::Place, mu: DVec3) -> [f64; 3];

    /// The standard deviation, in radians, of the narrowest lobe that could be
    /// overlooked; infinite if it hardly depends on direction.
    fn scale(&self) -> f64;

    /// Whether, seen from within `radius` radians of `axis`, it does not depend on direction
    /// at all: then no lobe can be overlooked there.
    fn is_plain(&self, _place: &Self::Place, _axis: DVec3, _radius: f64) -> bool {
        false
    }

    /// From which directions on `map` anybody looks at position (u, v), or at any that
    /// is at most `reach` away along either axis; `None` if from all.
    ///
    /// Other directions are not refined, nor is the error there counted: see
    /// [`UNSEEN_ERROR`].
    fn views(&self, _map: DirectionMap, _uv: DVec2, _reach: f64) -> Option<ViewSet> {
        None
    }
}

/// The relative error that will do for directions from which nobody looks, or twice
/// what is asked for of the others if that is more: coefficients are kept for it, but no
/// cell is split, so that it can be up to three times as much.
pub const UNSEEN_ERROR: f64 = 0.1;

/// The highest orders of leaves: what a look-up may cost at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Orders {
    /// Total degree in (u, v) below this, 1 to 7.
    pub position: usize,
    /// Total degree in (s, t) below this, 1 to 7.
    pub direction: usize,
}

impl Default for Orders {
    /// 4 and 4: of those whose look-ups are fastest to 0.2 to 1 %, the one of the fewest
    /// bytes.
    fn default() -> Self {
        Self { position: 4, direction: 4 }
    }
}

/// How to project.
#[derive(Clone, Copy, Debug)]
pub struct ProjectOptions {
    /// The relative error asked for: ‖error‖ / ‖L‖ over position and all directions
    /// of the hemisphere that are seen, weighted with cosθ dω.
    pub error: f64,
    /// The highest orders.
    pub orders: Orders,
    /// How directions lie on the square.
    pub map: DirectionMap,
    /// The deepest levels of position and of direction, at most 12.
    pub levels: [u8; 2],
    /// The most direction cells that are sampled, over all positions: time and memory.
    pub cells: usize,
}

impl Default for ProjectOptions {
    fn default() -> Self {
        Self {
            error: 2e-3,
            orders: Orders::default(),
            map: DirectionMap::default(),
            levels: [5, 8],
            cells: 20_000,
        }
    }
}

/// What a projection made.
#[derive(Clone, Debug)]
pub struct Projected {
    /// The coefficients.
    pub tree: LegendreTree,
    /// The relative error, in the norm of [`ProjectOptions::error`]: what is looked up
    /// against the radiance itself at some thousands of points that no coefficient was
    /// made from. Above what was asked for if a limit on levels or cells was met.
    pub error: f64,
    /// ‖L‖² in that norm.
    pub norm_squared: f64,
    /// Whether anybody looks at it at all. If nobody does, the above are over all
    /// directions, and [`UNSEEN_ERROR`] is what was asked for.
    pub is_seen: bool,
}

/// How much of the error asked for is spent by what points tell: they miss some of it,
/// up to 15 % where most of it is in few places.
const SPENT: f64 = 0.85;

/// From where on no more coefficients are left out to spend it, and up to where it will
/// do.
const ENOUGH: [f64; 2] = [0.81, 0.87];

/// What of its square must be left for pruning: if less is, more cells are wanted.
const LEAST: f64 = 0.15;

/// How often cells are split anew, because points tell of more than coefficients do: how
/// much of all cells there may then be when positions are split, and then directions.
const ROUNDS: [[f64; 2]; 4] = [[0.25, 0.5], [0.65, 0.75], [0.85, 0.95], [0.95, 1.0]];

/// How often they are pruned with what points tell of.
const PRUNINGS: usize = 3;

/// Projects `radiance`, using all threads of the current pool; the result does not
/// depend on how many.
///
/// Cells are sampled at Gauss nodes for one order more than leaves may have, and
/// split where the energy of that last degree is greatest, until over all cells it is
/// below the error asked for. Then as many coefficients are left out, cells merged
/// and bits dropped as that error allows. What no coefficient tells of, at a jump most
/// of the error, is found by looking the result up at other points; if it is too much,
/// more cells are split.
///
/// # Panics
///
/// If an order is not 1 to 7 or a level above 12.
#[must_use]
pub fn project<R: Radiance>(radiance: &R, options: &ProjectOptions) -> Projected {
    let Orders { position, direction } = options.orders;
    for order in [position, direction] {
        assert!((1..MAX_TREE_ORDER).contains(&order), "order {order} is not in 1..=7");
    }
    assert!(options.levels.iter().all(|l| *l <= MAX_DEPTH), "levels {:?}", options.levels);
    refine(&Sampling::new(radiance, options)).unwrap_or_else(|| {
        let error = UNSEEN_ERROR.max(2.0 * options.error);
        let options = ProjectOptions { error, ..*options };
        let made = refine(&Sampling::new(radiance, &options).everywhere())
            .unwrap_or_else(|| unreachable!("all is seen"));
        Projected { is_seen: false, ..made }
    })
}

/// What [`project`] makes of what is seen; `None` if that is nothing, or dark.
fn refine<R: Radiance>(sampling: &Sampling<'_, R>) -> Option<Projected> {
    let options = sampling.options;
    let mut positions = vec![sampling.position(Cells::default())];
    let views = positions[0].views.as_ref();
    let is_part = views.is_some();
    if views.is_some_and(|views| views.all.is_empty()) {
        return None;
    }
    // A third of the error's square each for what positions, directions and pruning
    // leave out.
    let mut share = 1.0 / 3.0;
    let mut made = Projected {
        tree: LegendreTree::dark(options.map),
        error: 0.0,
        norm_squared: norm_squared(&positions, View::Seen),
        is_seen: true,
    };
    if !is_part && made.norm_squared == 0.0 {
        return Some(made);
    }
    for most in ROUNDS {
        let cells = count(&positions);
        let [for_positions, for_all] = most.map(|part| (part * options.cells as f64) as usize);
        positions = sampling.split_positions(positions, share, for_positions);
        sampling.split_directions(&mut positions, share, for_all);
        if made.error > 0.0 && count(&positions) == cells {
            break;
        }
        let checks = Checks::new(sampling, &positions);
        let norm =
            if is_part { checks.norm_squared() } else { norm_squared(&positions, View::Seen) };
        if norm == 0.0 {
            return None;
        }
        let unseen = unseen_weight(&positions, options.error);
        let wanted = (SPENT * options.error).powi(2) * norm;
        let (mut allowed, mut unknown, mut last) = (0.8 * wanted, 0.0, None);
        for _ in 0..PRUNINGS {
            let pruning = prune(&positions, norm, allowed, last.as_ref(), unseen, options);
            let found = checks.error_squared(&pruning.tree);
            unknown = found - pruning.error;
            let relative = (found / norm).sqrt();
            // One that is too much after one that is not was of no use.
            if relative <= options.error || made.error == 0.0 || made.error > options.error {
                made.tree = pruning.tree.clone();
                (made.error, made.norm_squared) = (relative, norm);
            }
            last = Some(pruning);
            let enough = (ENOUGH[0]..=ENOUGH[1]).contains(&(relative / options.error));
            if enough || wanted - unknown < LEAST * wanted {
                break;
            }
            allowed = wanted - unknown;
        }
        if made.error <= ENOUGH[1] * options.error {
            break;
        }
        // As much less as what is not known is more than its part.
        share *= (0.4 * wanted / unknown.max(0.4 * wanted)).clamp(0.1, 0.6);
    }
    Some(made)
}

/// What the square of an error counts where nobody looks, so that [`UNSEEN_ERROR`] of the
/// radiance there weighs as much as `error` of that which is seen.
fn unseen_weight(positions: &[Position], error: f64) -> f64 {
    let mean_square = |view: View| {
        let leaves = positions.iter().flat_map(|p| p.root.leaves());
        let (mut norm, mut measure) = (0.0, 0.0);
        for leaf in leaves.filter(|leaf| leaf.view == view) {
            norm += leaf.norm;
            measure += leaf.projected_measure();
        }
        norm / measure
    };
    let brightness = mean_square(View::Seen) / mean_square(View::Unseen);
    let weight = (error / UNSEEN_ERROR.max(2.0 * error)).powi(2) * brightness;
    // Where there is nothing of either kind, and where one is all but dark.
    if weight.is_finite() { weight.clamp(1e-9, 1.0) } else { 1.0 }
}
