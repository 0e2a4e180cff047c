//! A tree in few bytes: quantised, and entropy-coded.
//!
//! What is exactly dark is coded as a shape, cell by cell from the root down, and
//! costs no coefficients: nodes are transformed by a Haar transform of what is lit
//! in them. Beside a dark cell the coefficients of the usual transform are those
//! of an edge, and large; here they are those of the light. All coefficients are
//! quantised by one step, which for an orthonormal basis is the best, along axes
//! of colour in which the channels are uncorrelated, and each is coded with the
//! probability that its surroundings give it: magnitudes in its node, its parent
//! and the cells beside, and the slope between those.
//!
//! The bytes, little-endian:
//!
//! | bytes | type | what |
//! |---|---|---|
//! | 0..8 | `f64` | the step Δ, of a coefficient along an axis |
//! | 8..16 | `f64` | the largest departure of any channel from what was coded, W sr⁻¹ m⁻² |
//! | 16..40 | `[f64; 3]` | the root's smoothing coefficient along the axes, in steps |
//! | 40..76 | `[[f32; 3]; 3]` | the axes: rows of red, green and blue |
//! | 76 | `u8` | 1 if nothing outside the UDC is lit, else 0 |
//! | 77.. | | bits of the arithmetic coder: the shape, then the coefficients |
//!
//! The models behind the probabilities are part of the format: they are in
//! [`shape`] and [`values`], and whatever changes there needs another name for the
//! codec in the `.wct` file.

mod model;
mod quantise;
mod range;
mod region;
mod shape;
#[cfg(test)]
mod tests;
mod values;

use super::{Node, Tree};
use crate::{Levels, children, pull};
use quantise::Analysis;
use range::{Coder as _, Decoder, Encoder};
use shape::{Branch, Shape, volume};
use std::sync::Arc;
use values::NodeValues;

/// Bytes before the coder's bits.
const HEADER: usize = 77;

/// Where the largest departure is, which is known last.
const LARGEST: std::ops::Range<usize> = 8..16;

/// Nodes that a byte may stand for: what bounds the memory that reading needs.
/// Radiance of a chapel's floor has 2 a byte at an error of 1 %, 6 at 10 %.
const NODES_PER_BYTE: usize = 4;

/// The bytes that a [`Tree`] was read from, or is to be written as.
#[derive(Clone, PartialEq)]
pub(super) struct Code(Arc<[u8]>);

impl std::fmt::Debug for Code {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Code({} bytes)", self.0.len())
    }
}

/// What quantisation did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantisation {
    /// ‖a − b‖ / ‖a‖ of the tree a and the quantised one b.
    pub relative_error: f64,
    /// The largest |a − b| of any channel anywhere, W sr⁻¹ m⁻².
    pub largest_error: f64,
}

impl Tree {
    /// The tree with its coefficients quantised as coarsely as a relative L² error
    /// of at most `error` allows: it remembers the few bytes that it is coded as.
    ///
    /// Where `error` is near or below that of single precision, the tree itself.
    #[must_use]
    pub fn quantised(&self, error: f64) -> (Self, Quantisation) {
        let norm = self.norm_squared();
        // Rounding to single precision adds an error of its own, and so few bytes may
        // stand for so many nodes that a reader refuses them: then less is allowed.
        let mut share = 0.9999;
        while norm > 0.0 && error > 0.0 && share > 0.1 {
            let Some(coded) = self.encoded((share * error).powi(2) * norm) else { break };
            if let (mut bytes, Some(tree)) = coded {
                let difference = self.difference(&tree);
                let relative_error = (difference.squared / norm).sqrt();
                if relative_error <= error {
                    let largest_error = difference.largest;
                    bytes[LARGEST].copy_from_slice(&largest_error.to_le_bytes());
                    let code = Some(Code(bytes.into()));
                    return (Self { code, ..tree }, Quantisation { relative_error, largest_error });
                }
            }
            share *= 0.8;
        }
        (self.without_code(), Quantisation { relative_error: 0.0, largest_error: 0.0 })
    }

    /// The bytes that it is coded as, if it has been [`quantised`](Self::quantised).
    #[must_use]
    pub fn code(&self) -> Option<&[u8]> {
        self.code.as_ref().map(|Code(bytes)| &bytes[..])
    }

    /// The same radiance, to be stored as masks and coefficients.
    #[must_use]
    pub fn without_code(&self) -> Self {
        Self { code: None, ..self.clone() }
    }

    /// The largest departure of any channel anywhere from the tree that was
    /// [`quantised`](Self::quantised), W sr⁻¹ m⁻².
    #[must_use]
    pub fn largest_error(&self) -> Option<f64> {
        self.code().map(|bytes| double(bytes, LARGEST.start))
    }

    /// The code, and the tree that a reader makes of it unless it refuses it.
    fn encoded(&self, allowed: f64) -> Option<(Vec<u8>, Option<Self>)> {
        let analysis = Analysis::new(self, allowed);
        let step = analysis.step(allowed)?;
        let (masks, coefficients) = analysis.quantised(self, step);
        let root = analysis.root.map(|x| x / step);
        let mut bytes = Vec::new();
        bytes.extend([step, 0.0].into_iter().chain(root).flat_map(f64::to_le_bytes));
        bytes.extend(analysis.axes.iter().flatten().flat_map(|x| x.to_le_bytes()));
        bytes.push(analysis.within_udc.into());
        let mut coder = Encoder::new();
        let most = masks.len();
        let shape = Shape::code(&mut coder, self.levels, analysis.within_udc, &masks, most)?;
        let mut decoded = Decoded::new(&shape, root, step, analysis.axes.map(|a| a.map(f64::from)));
        values::code(&mut coder, &shape, root, &coefficients, |branch, values| {
            decoded.add(branch, values);
        });
        bytes.extend(coder.finish());
        let fits = masks.len() <= NODES_PER_BYTE * bytes.len();
        Some((bytes, decoded.finish().filter(|_| fits)))
    }

    /// The tree that is coded as `bytes`, or what is wrong with them: an outside
    /// file promises nothing. Needs memory of at most 6000 times their number and a
    /// megabyte, whatever they are.
    ///
    /// # Errors
    ///
    /// A sentence, if the header has a number that no writer produces, the bits end
    /// early or late, or they stand for too many nodes.
    pub fn from_code(levels: Levels, bytes: &[u8]) -> Result<Self, String> {
        if levels.position > Levels::MAX || levels.direction > Levels::MAX {
            return Err(format!("levels above {}", Levels::MAX));
        }
        let Some((header, bits)) = bytes.split_at_checked(HEADER) else {
            return Err(format!("{} bytes, of which the first {HEADER} are a header", bytes.len()));
        };
        let float = |at: usize| f32::from_le_bytes(std::array::from_fn(|i| header[at + i]));
        let [step, largest] = [0, LARGEST.start].map(|at| double(header, at));
        let root = [16, 24, 32].map(|at| double(header, at));
        let axes = [40, 52, 64].map(|at| [0, 4, 8].map(|i| f64::from(float(at + i))));
        if !step.is_normal() || step < 0.0 {
            return Err(format!("a step of {step}"));
        }
        if !largest.is_finite() || largest < 0.0 {
            return Err(format!("a largest error of {largest}"));
        }
        // Sums of squares stay finite then.
        if !root.iter().all(|x| x.abs() < 1e100) {
            return Err(format!("a root of {root:?} steps"));
        }
        if !axes.iter().flatten().all(|x| x.abs() <= 1.001) {
            return Err(format!("axes of colour of {axes:?}"));
        }
        if header[76] > 1 {
            return Err(format!(
                "{} where 0 or 1 says whether light is within the UDC",
                header[76]
            ));
        }
        let mut coder = Decoder::new(bits);
        let most = NODES_PER_BYTE * bytes.len();
        let shape = Shape::code(&mut coder, levels, header[76] == 1, &[], most);
        let Some(shape) = shape.filter(|_| !coder.has_run_out()) else {
            return Err(match coder.has_run_out() {
                true => "its bits end early".to_owned(),
                false => format!("{} bytes for more than {most} nodes", bytes.len()),
            });
        };
        let mut decoded = Decoded::new(&shape, root, step, axes);
        values::code(&mut coder, &shape, root, &[], |branch, values| decoded.add(branch, values));
        if !coder.is_at_end() {
            return Err("more bits or fewer than its coefficients take".to_owned());
        }
        let Some(tree) = decoded.finish() else {
            return Err("a coefficient is not finite".to_owned());
        };
        Ok(Self { code: Some(Code(bytes.into())), ..tree })
    }
}

fn double(bytes: &[u8], at: usize) -> f64 {
    f64::from_le_bytes(std::array::from_fn(|i| bytes[at + i]))
}

/// A tree of the usual coefficients, as it is decoded node by node.
struct Decoded {
    tree: Tree,
    step: f64,
    axes: [[f64; 3]; 3],
}

impl Decoded {
    fn new(shape: &Shape, root: [f64; 3], step: f64, axes: [[f64; 3]; 3]) -> Self {
        let mut decoded = Self { tree: Tree::dark(shape.levels), step, axes };
        let lit = shape.volumes.first().copied().unwrap_or(1.0);
        decoded.tree.root = decoded.colour(root.map(|x| x * lit.sqrt()));
        decoded.tree.nodes.reserve_exact(shape.nodes.len());
        decoded
    }

    /// Red, green and blue of a coefficient along the axes.
    fn colour(&self, b: [f64; 3]) -> [f32; 3] {
        let sum = |c: usize| -> f64 { self.axes.iter().zip(b).map(|(axis, b)| axis[c] * b).sum() };
        [0, 1, 2].map(|c| (self.step * sum(c)) as f32)
    }

    /// The tree, if it is finite.
    fn finish(self) -> Option<Tree> {
        let tree = self.tree;
        let finite = |b: &[f32; 3]| b.iter().all(|x| x.is_finite());
        let every = vec![true; tree.coefficients.len()];
        let is_finite = tree.coefficients.iter().chain([&tree.root]).all(finite);
        is_finite.then(|| tree.filtered(&every))
    }

    fn add(&mut self, branch: &Branch, values: &NodeValues) {
        let levels = self.tree.levels;
        let split = levels.split(branch.cell.depth);
        let size = volume(levels, branch.cell.depth + 1);
        let mut b = values.wavelets;
        // Lit all over, it has the usual coefficients already.
        if children(split).any(|m| values.volumes[m] != size) {
            b = values.smooth;
            for b in &mut b {
                for m in children(split) {
                    b[m] *= (values.volumes[m] / size).sqrt();
                }
                pull(b, split);
            }
        }
        let mut node = Node {
            child_mask: branch.nodes,
            nu_mask: 0,
            first_child: branch.first_node,
            first_coefficient: self.tree.coefficients.len() as u32,
        };
        for nu in children(split).skip(1) {
            let rgb = self.colour([b[0][nu], b[1][nu], b[2][nu]]);
            if rgb != [0.0; 3] {
                node.nu_mask |= 1 << nu;
                self.tree.coefficients.push(rgb);
            }
        }
        self.tree.nodes.push(node);
    }
}
