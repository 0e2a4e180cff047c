//! What a radiance is where it is not zero: quantised coefficients, coded from the
//! root down, each in the light of what is known by then.

use super::model::Model;
use super::range::Coder;
use super::region::Region;
use super::shape::{Branch, NONE, Shape};
use crate::CHILDREN;

/// Bits of the largest magnitude of a quantised coefficient.
pub(super) const MAGNITUDE_BITS: usize = 24;

/// One node's coefficients in all three channels, in steps of the quantisation.
pub(super) struct NodeValues {
    /// By channel and ν, where it is not dark all over: wavelets only.
    pub(super) wavelets: [[f64; CHILDREN]; 3],
    /// By channel and m′: the children's smoothing coefficients, as in [`Region`].
    pub(super) smooth: [[f64; CHILDREN]; 3],
    /// The volume that is lit in each child.
    pub(super) volumes: [f64; CHILDREN],
}

/// What is remembered of the nodes coded before.
struct Memory<'a> {
    shape: &'a Shape,
    /// By lit cell: its mean over what is lit.
    means: Vec<[f64; 3]>,
    /// Magnitudes of wavelet coefficients, up to 255; by node, by increasing ν.
    magnitudes: Vec<[u8; 3]>,
    /// By node: where its magnitudes start, which ν it has, and their mean, in
    /// eighths.
    nodes: Vec<(u32, u16, [u32; 3])>,
}

/// Codes the coefficients of a tree of this shape whose root has the smoothing
/// coefficient `root`. A writer has `quantised`, by node and by increasing ν.
/// `emit` is called for each node in turn, until a reader has run out.
pub(super) fn code(
    coder: &mut impl Coder,
    shape: &Shape,
    root: [f64; 3],
    quantised: &[[i32; 3]],
    mut emit: impl FnMut(&Branch, &NodeValues),
) {
    let mut memory = Memory {
        shape,
        means: vec![[0.0; 3]; shape.node_of.len()],
        magnitudes: Vec::with_capacity(shape.node_of.len()),
        nodes: Vec::with_capacity(shape.nodes.len()),
    };
    let Some(&whole) = shape.volumes.first() else { return };
    memory.means[0] = root.map(|x| x / whole.sqrt());
    let mut models = Models::new();
    let mut before = [[0_u32; 3]; CHILDREN];
    let mut parent = 0;
    for (i, branch) in shape.nodes.iter().enumerate() {
        if coder.has_run_out() {
            return;
        }
        while i > 0 && !has_child(&shape.nodes[parent], i) {
            parent += 1;
        }
        let parent = (i > 0).then_some(parent);
        let given = quantised.get(memory.magnitudes.len()..).unwrap_or_default();
        let values = memory.code_node(coder, &mut models, branch, parent, &mut before, given);
        emit(branch, &values);
    }
}

fn has_child(parent: &Branch, node: usize) -> bool {
    let first = parent.first_node as usize;
    (first..first + parent.nodes.count_ones() as usize).contains(&node)
}

impl Memory<'_> {
    fn code_node(
        &mut self,
        coder: &mut impl Coder,
        models: &mut Models,
        branch: &Branch,
        parent: Option<usize>,
        before: &mut [[u32; 3]; CHILDREN],
        mut given: &[[i32; 3]],
    ) -> NodeValues {
        let shape = self.shape;
        let split = shape.levels.split(branch.cell.depth);
        let volumes = shape.lit_volumes(branch);
        let region = Region::new(split, volumes);
        let scale = region.volume().sqrt();
        let smooth = self.means[branch.own as usize].map(|x| x * scale);
        let slopes = self.slopes(branch, split, scale);
        let mask = region.mask() & !1;
        let start = self.magnitudes.len() as u32;
        let (mut sums, mut count) = ([0_u32; 3], 0_u32);
        let place = usize::from(branch.cell.depth + 1 == shape.levels.depth())
            + usize::from(mask.count_ones() < 15);
        let mut wavelets = [[0.0; CHILDREN]; 3];
        for nu in (1..CHILDREN).filter(|nu| mask >> nu & 1 == 1) {
            let value = match given.split_first() {
                Some((&value, rest)) => {
                    given = rest;
                    value
                }
                None => [0; 3],
            };
            let mut q = [0_i32; 3];
            for c in 0..3 {
                // Details are mostly of the colour of what they are details of.
                let tint = match smooth[c] / smooth[0] {
                    ratio if c > 0 && ratio.is_finite() => f64::from(q[0]) * ratio.clamp(-2.0, 2.0),
                    _ => 0.0,
                };
                let is_straight = nu.is_power_of_two();
                let known = Known {
                    channel: c,
                    nu,
                    depth: branch.cell.depth.into(),
                    place,
                    own: (8 * sums[c]).checked_div(count).unwrap_or(0),
                    parent: parent.map_or(0, |parent| self.nodes[parent].2[c]),
                    parent_same: 8 * parent.map_or(0, |parent| self.magnitude(parent, nu, c)),
                    channels: 8 * q[..c].iter().map(|x| x.unsigned_abs()).sum::<u32>(),
                    before: 8 * before[nu][c],
                    smooth: eighths(smooth[c]) / 8,
                    slope: if is_straight { slopes[c][nu.ilog2() as usize] } else { 0.0 },
                    tint,
                };
                q[c] = models.code(coder, &known, value[c]);
                sums[c] += q[c].unsigned_abs();
                before[nu][c] = q[c].unsigned_abs();
                wavelets[c][nu] = q[c].into();
            }
            count += 1;
            self.magnitudes.push(q.map(|x| x.unsigned_abs().min(255) as u8));
        }
        let mean = sums.map(|sum| (8 * sum).checked_div(count).unwrap_or(0));
        self.nodes.push((start, mask, mean));
        let mut children = wavelets;
        for (b, smooth) in children.iter_mut().zip(smooth) {
            b[0] = smooth;
            region.push(b);
        }
        for m in (0..CHILDREN).filter(|m| branch.lit >> m & 1 == 1) {
            let scale = volumes[m].sqrt().recip();
            self.means[branch.lit_child(m) as usize] = children.map(|b| b[m] * scale);
        }
        NodeValues { wavelets, smooth: children, volumes }
    }

    /// The magnitude of coefficient ν of `node`, up to 255.
    fn magnitude(&self, node: usize, nu: usize, channel: usize) -> u32 {
        let (start, mask, _) = self.nodes[node];
        if mask >> nu & 1 == 0 {
            return 0;
        }
        let at = start + (mask & ((1 << nu) - 1)).count_ones();
        self.magnitudes[at as usize][channel].into()
    }

    /// By channel and dimension: the coefficient that a straight line through the
    /// means of the cells beside would give, of a node whose lit volume is
    /// `scale`².
    ///
    /// 0 where the node is an extremum; elsewhere at most what keeps the halves
    /// between the means beside (the limiter of B. van Leer, *Towards the ultimate
    /// conservative difference scheme IV*, J. Comput. Phys. 23, 1977).
    fn slopes(&self, branch: &Branch, split: usize, scale: f64) -> [[f64; 4]; 3] {
        let own = self.means[branch.own as usize];
        let mut slopes = [[0.0; 4]; 3];
        for d in (0..4).filter(|d| split >> d & 1 == 1) {
            let [low, high] = [branch.beside[2 * d], branch.beside[2 * d + 1]];
            if low == NONE || high == NONE {
                continue;
            }
            let (low, high) = (self.means[low as usize], self.means[high as usize]);
            for c in 0..3 {
                let (a, b) = (own[c] - low[c], high[c] - own[c]);
                if a * b > 0.0 {
                    let most = 2.0 * a.abs().min(b.abs());
                    slopes[c][d] = -0.25 * scale * (0.5 * (a + b)).clamp(-most, most);
                }
            }
        }
        slopes
    }
}

/// What is known before a coefficient is coded.
struct Known {
    channel: usize,
    nu: usize,
    depth: usize,
    /// Whether the node is of the finest, and whether it is partly dark; 0 to 2.
    place: usize,
    /// Mean magnitude of this node's coefficients so far, in eighths.
    own: u32,
    /// Mean magnitude of the parent's, in eighths.
    parent: u32,
    /// Magnitude of the parent's of the same ν, in eighths.
    parent_same: u32,
    /// Magnitude of this one in the channels before, in eighths.
    channels: u32,
    /// Magnitude of the same ν in the node before, in eighths.
    before: u32,
    /// Magnitude of the node's smoothing coefficient.
    smooth: u32,
    /// What the cells beside predict.
    slope: f64,
    /// What the first channel predicts.
    tint: f64,
}

/// Classes of magnitudes: 0, then two an octave.
const CLASSES: usize = 20;

fn class(x: u32) -> usize {
    if x == 0 {
        return 0;
    }
    let octave = x.ilog2();
    let half = if octave > 0 { x >> (octave - 1) & 1 } else { 0 };
    (1 + 2 * octave as usize + half as usize).min(CLASSES - 1)
}

fn eighths(x: f64) -> u32 {
    (x.abs() * 8.0).min(1e6) as u32
}

/// Bits of a magnitude that contexts tell apart.
const LENGTHS: usize = 14;

/// What each part of a coefficient is coded with.
struct Models {
    /// Whether a magnitude has another bit.
    length: Model<6>,
    /// The two bits after its leading one.
    mantissa: Model<2>,
    sign: Model<3>,
}

impl Models {
    fn new() -> Self {
        let kinds = LENGTHS * 3;
        Self {
            length: Model::new(
                [
                    kinds * CLASSES * 5,
                    kinds * CLASSES * CLASSES,
                    kinds * CLASSES * CLASSES,
                    kinds * CLASSES * 17 * 3,
                    kinds * CLASSES * CLASSES,
                    kinds * CHILDREN * CLASSES,
                ],
                kinds,
            ),
            mantissa: Model::new(
                [(MAGNITUDE_BITS + 1) * 4 * 3, (MAGNITUDE_BITS + 1) * 4 * CLASSES],
                3,
            ),
            sign: Model::new([3 * 9 * 4, 3 * 3 * CLASSES, 3 * CHILDREN * 3], 3),
        }
    }

    fn code(&mut self, coder: &mut impl Coder, known: &Known, value: i32) -> i32 {
        let &Known { channel, nu, own, parent, parent_same, channels, before, .. } = known;
        let blend = (2 * own + parent + parent_same + 2 * channels + 2 * before) / 8;
        let tint = class(eighths(known.tint));
        let length = u32::BITS - value.unsigned_abs().leading_zeros();
        let mut bits = 0;
        while bits < MAGNITUDE_BITS {
            let kind = bits.min(LENGTHS - 1) * 3 + channel;
            let contexts = [
                (kind * CLASSES + class(blend)) * 5 + nu.count_ones() as usize,
                (kind * CLASSES + class(parent)) * CLASSES + class(own),
                (kind * CLASSES + class(channels)) * CLASSES + tint,
                ((kind * CLASSES + class(known.smooth)) * 17 + known.depth) * 3 + known.place,
                (kind * CLASSES + class(eighths(known.slope))) * CLASSES + class(own + before),
                (kind * CHILDREN + nu) * CLASSES + class(parent_same + before),
            ];
            if !self.length.code(coder, contexts, kind, bits < length as usize) {
                break;
            }
            bits += 1;
        }
        if bits == 0 {
            return 0;
        }
        let mut magnitude = 1_u32;
        let below = bits - 1;
        for k in 0..below.min(2) {
            let at = bits * 4 + 2 * k + (magnitude as usize & k);
            let contexts = [at * 3 + channel, at * CLASSES + class(blend)];
            let bit = value.unsigned_abs() >> (below - 1 - k) & 1 == 1;
            let bit = self.mantissa.code(coder, contexts, channel, bit);
            magnitude = magnitude << 1 | u32::from(bit);
        }
        let even = below.saturating_sub(2) as u32;
        magnitude = magnitude << even | coder.even_bits(even, value.unsigned_abs());
        let way = |x: f64| usize::from(x > -0.25) + usize::from(x > 0.25);
        let (slope, tinted) = (way(known.slope), way(known.tint));
        let strength = usize::from(bits > 1) * 2 + usize::from(own > 16);
        let contexts = [
            ((channel * 3 + slope) * 3 + tinted) * 4 + strength,
            (channel * 3 + tinted) * CLASSES + tint,
            (channel * CHILDREN + nu) * 3 + slope,
        ];
        let is_negative = self.sign.code(coder, contexts, channel, value < 0);
        if is_negative { -(magnitude as i32) } else { magnitude as i32 }
    }
}
