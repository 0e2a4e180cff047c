//! A tree over the cells of very many emitters.
//!
//! After B. Walter et al., *Lightcuts: A Scalable Approach to Illumination*, SIGGRAPH
//! 2005: clusters of cells that are near each other and look the same way.

use super::flat::{Cell, Flat};
use glam::{DVec3, Vec3};

/// How far apart normals have to be to weigh as much as places on either side of a
/// cluster: half turns as half its diagonal.
const NORMAL_SCALE: f64 = 0.25;

/// Rounding of a node's numbers to single precision, relative.
const ROUNDING: f64 = 1e-6;

/// All cells, in an order in which each cluster's follow each other.
#[derive(Debug)]
pub(crate) struct Hierarchy {
    flats: Vec<Flat>,
    /// Which emitter's, and which of its cells.
    order: Vec<[u32; 2]>,
    nodes: Vec<Node>,
}

/// What holds of all cells of a cluster.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Node {
    /// Of a sphere around them.
    pub(super) centre: Vec3,
    pub(super) radius: f32,
    /// Unit, of a cone around their normals.
    pub(super) axis: Vec3,
    /// Of the angle from the cone's axis to its edge.
    pub(super) cos: f32,
    pub(super) sin: f32,
    /// Sum of radiance at the brightest channel times area, W sr⁻¹.
    pub(super) power: f32,
    /// Sum of radiance at the brightest channel, W m⁻² sr⁻¹.
    pub(super) radiance: f32,
}

/// Where in the tree a node stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Span {
    pub(super) node: usize,
    /// Its first cell in the order, and how many there are.
    pub(super) first: usize,
    pub(super) count: usize,
}

impl Span {
    /// The two halves, for more than one cell: a tree of k cells has 2k − 1 nodes, the
    /// first half's ahead of the second's.
    pub(super) fn halves(self) -> [Self; 2] {
        let half = self.count / 2;
        let left = Self { node: self.node + 1, first: self.first, count: half };
        let right =
            Self { node: self.node + 2 * half, first: self.first + half, count: self.count - half };
        [left, right]
    }
}

/// A cell as the tree is built of it.
struct Item {
    which: [u32; 2],
    corners: [DVec3; 4],
    centre: DVec3,
    normal: DVec3,
    area: f64,
    radiance: f64,
}

impl Hierarchy {
    /// `None` without a cell. The same emitters give the same tree.
    pub(super) fn new(flats: Vec<Flat>) -> Option<Self> {
        let item = |i: usize, j: usize| {
            let (flat, cell) = (&flats[i], &flats[i].cells[j]);
            let corners = flat.corners(cell);
            let [low, high] = bounds(corners.iter().copied());
            Item {
                which: [i as u32, j as u32],
                corners,
                centre: 0.5 * (low + high),
                normal: flat.normal,
                area: flat.cell_area,
                radiance: f64::from(cell.radiance.max_element()),
            }
        };
        let mut items: Vec<Item> = (0..flats.len())
            .flat_map(|i| (0..flats[i].cells.len()).map(move |j| (i, j)))
            .map(|(i, j)| item(i, j))
            .collect();
        if items.is_empty() {
            return None;
        }
        let mut nodes = Vec::with_capacity(2 * items.len() - 1);
        build(&mut items, &mut nodes);
        let order = items.iter().map(|item| item.which).collect();
        Some(Self { flats, order, nodes })
    }

    pub(super) fn root(&self) -> Span {
        Span { node: 0, first: 0, count: self.order.len() }
    }

    pub(super) fn node(&self, span: Span) -> &Node {
        &self.nodes[span.node]
    }

    /// The `number`-th cell in the order.
    pub(super) fn cell(&self, number: usize) -> (&Flat, &Cell) {
        let [flat, cell] = self.order[number].map(|i| i as usize);
        (&self.flats[flat], &self.flats[flat].cells[cell])
    }
}

/// Appends the nodes over `items`, of which there is one at least, and puts these in
/// the tree's order.
///
/// Each node is cut at the median of that of six coordinates, of place and normal, which
/// is spread farthest: so the tree is never deeper than the logarithm of their number.
fn build(items: &mut [Item], nodes: &mut Vec<Node>) {
    let [low, high] = bounds(items.iter().flat_map(|item| item.corners));
    nodes.push(node(items, 0.5 * (low + high)));
    if items.len() == 1 {
        return;
    }
    let spread = |[low, high]: [DVec3; 2]| high - low;
    let scale = NORMAL_SCALE * low.distance(high);
    let place = spread(bounds(items.iter().map(|item| item.centre)));
    let normal = scale * spread(bounds(items.iter().map(|item| item.normal)));
    let by_normal = normal.max_element() > place.max_element();
    let axis = if by_normal { normal.max_position() } else { place.max_position() };
    let key = |item: &Item| if by_normal { item.normal[axis] } else { item.centre[axis] };
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, |a, b| {
        key(a).total_cmp(&key(b)).then_with(|| a.which.cmp(&b.which))
    });
    let (left, right) = items.split_at_mut(middle);
    build(left, nodes);
    build(right, nodes);
}

fn node(items: &[Item], centre: DVec3) -> Node {
    let corners = items.iter().flat_map(|item| item.corners);
    let radius = corners.map(|corner| corner.distance(centre)).fold(0.0, f64::max);
    let sum: DVec3 = items.iter().map(|item| item.normal).sum();
    let axis = sum.try_normalize().unwrap_or(DVec3::Z);
    let cos = items.iter().map(|item| item.normal.dot(axis)).fold(1.0, f64::min);
    let cos = (cos - ROUNDING).max(-1.0);
    Node {
        centre: centre.as_vec3(),
        // Rounding the centre moves it.
        radius: ((1.0 + ROUNDING) * radius + ROUNDING * centre.length()) as f32,
        axis: axis.as_vec3(),
        cos: cos as f32,
        sin: (1.0 - cos * cos).sqrt() as f32,
        power: items.iter().map(|item| item.radiance * item.area).sum::<f64>() as f32,
        radiance: items.iter().map(|item| item.radiance).sum::<f64>() as f32,
    }
}

fn bounds(points: impl Iterator<Item = DVec3>) -> [DVec3; 2] {
    points.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], point| {
        [low.min(point), high.max(point)]
    })
}
