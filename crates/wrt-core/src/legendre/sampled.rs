//! A direction cell's coefficients before anything is left out.

use super::tree::Cells;
use super::{degrees, terms};
use crate::multiwavelet::Multiwavelet;

/// A cell of the quadtree over direction, under one position cell.
#[derive(Debug)]
pub(super) struct Sampled {
    pub(super) cell: Cells,
    /// One more than leaves may have, for position and for direction.
    orders: [usize; 2],
    /// Per position term, per direction term, per channel.
    pub(super) b: Vec<f64>,
    /// The energy that its children have beyond `b`.
    detail: f64,
    /// Energies of `b` by position degree, then by direction degree.
    shells: Vec<f64>,
    /// What of them leaves leave out, by position order − 1, then direction order − 1.
    beyond: Vec<f64>,
    /// ∫ |L|² cosθ dω du dv over what is seen of it, or all if nothing is; of leaves
    /// alone.
    pub(super) norm: f64,
    /// The mean of cosθ dω / (ds dt).
    pub(super) measure: f64,
    pub(super) view: View,
    /// How much of its positions and directions is seen, if any is.
    share: f64,
    pub(super) children: Option<Box<[Self; 4]>>,
}

/// From where a cell can be looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum View {
    /// It has no directions of the hemisphere.
    Nowhere,
    /// None of [`Radiance::views`](super::Radiance::views).
    Unseen,
    Seen,
}

/// The least share that an error's square counts for where something is seen: errors are
/// greatest in corners, which may be all of it.
const LEAST_SHARE: f64 = 1.0 / 32.0;

impl Sampled {
    pub(super) fn new(
        cell: Cells,
        orders: [usize; 2],
        b: Vec<f64>,
        norm: f64,
        measure: f64,
        (view, share): (View, f64),
    ) -> Self {
        let shells = shells(orders, &b);
        let beyond = beyond(orders, &shells);
        Self {
            cell,
            orders,
            b,
            detail: 0.0,
            shells,
            beyond,
            norm,
            measure,
            view,
            share,
            children: None,
        }
    }

    /// What the square of an error in it counts: `unseen` if nobody looks.
    pub(super) fn weight(&self, unseen: f64) -> f64 {
        if self.is_seen() { self.share.max(LEAST_SHARE) } else { unseen }
    }

    /// ∫ cosθ dω du dv over what is seen of it, or all if nothing is.
    pub(super) fn projected_measure(&self) -> f64 {
        let area = self.cell.square(0).1 * self.cell.square(1).1;
        area * area * self.measure * self.share
    }

    /// How much of it is seen: 0 to 1.
    pub(super) fn share(&self) -> f64 {
        if self.view == View::Unseen { 0.0 } else { self.share }
    }

    pub(super) fn is_inside(&self) -> bool {
        self.view != View::Nowhere
    }

    pub(super) fn is_seen(&self) -> bool {
        self.view == View::Seen
    }

    /// Takes its children's coefficients for its own: they have seen more.
    pub(super) fn adopt(&mut self, children: [Self; 4], basis: &Multiwavelet) {
        let m = self.orders[1];
        let square = m * m;
        let q = terms(m);
        let mut four = vec![0.0; 4 * square];
        self.detail = children.iter().map(|child| child.detail).sum();
        for i in 0..terms(self.orders[0]) {
            for c in 0..3 {
                four.fill(0.0);
                for (part, child) in four.chunks_exact_mut(square).zip(&children) {
                    for (n, (k, l)) in degrees(m).enumerate() {
                        part[l * m + k] = child.b[3 * (i * q + n) + c];
                    }
                }
                basis.pull_square(&mut four);
                for (n, (k, l)) in degrees(m).enumerate() {
                    self.b[3 * (i * q + n) + c] = std::mem::take(&mut four[l * m + k]);
                }
                // Beside the wavelets, the children's terms of total degree below m
                // make polynomials of higher degree that the parent does not keep.
                self.detail += four.iter().map(|x| x * x).sum::<f64>();
            }
        }
        self.shells = shells(self.orders, &self.b);
        self.beyond = beyond(self.orders, &self.shells);
        self.norm = 0.0;
        self.children = Some(Box::new(children));
    }

    /// The weighted energy of the last degree that was sampled, for position (0) or
    /// direction (1), over all leaves that are seen: what leaves of the highest order leave out.
    pub(super) fn tail(&self, axis: usize) -> f64 {
        if let Some(children) = &self.children {
            return children.iter().map(|child| child.tail(axis)).sum();
        }
        if !self.is_seen() {
            return 0.0;
        }
        let [n, m] = self.orders;
        let shell = |i: usize, k: usize| self.shells[i * m + k];
        let tail: f64 = match axis {
            0 => (0..m).map(|k| shell(n - 1, k)).sum(),
            _ => (0..n).map(|i| shell(i, m - 1)).sum(),
        };
        // A pixel at the horizon is as bright as any other, though such are few.
        const LEAST: f64 = 1.0;
        tail * self.measure.max(LEAST) * self.share.max(LEAST_SHARE)
    }

    /// The energy that a leaf of these orders leaves out of what was sampled here.
    pub(super) fn left_out(&self, [p, q]: [usize; 2]) -> f64 {
        self.detail + self.beyond[(p - 1) * self.orders[1] + q - 1]
    }

    /// How many position terms `b` has.
    pub(super) fn position_terms(&self) -> usize {
        terms(self.orders[0])
    }

    pub(super) fn leaves(&self) -> Vec<&Self> {
        match &self.children {
            None => vec![self],
            Some(children) => children.iter().flat_map(Self::leaves).collect(),
        }
    }

    pub(super) fn leaves_mut(&mut self) -> Vec<&mut Self> {
        if self.children.is_none() {
            return vec![self];
        }
        self.children.iter_mut().flat_map(|c| c.iter_mut()).flat_map(Self::leaves_mut).collect()
    }
}

fn shells([n, m]: [usize; 2], b: &[f64]) -> Vec<f64> {
    let mut shells = vec![0.0; n * m];
    let mut terms = b.chunks_exact(3);
    for (i, j) in degrees(n) {
        for (k, l) in degrees(m) {
            let rgb = terms.next().unwrap_or_default();
            shells[(i + j) * m + k + l] += rgb.iter().map(|x| x * x).sum::<f64>();
        }
    }
    shells
}

fn beyond([n, m]: [usize; 2], shells: &[f64]) -> Vec<f64> {
    let sum = |p: usize, q: usize| {
        let out = shells.iter().enumerate().filter(|(i, _)| i / m >= p || i % m >= q);
        out.map(|(_, energy)| energy).sum()
    };
    (1..=n).flat_map(|p| (1..=m).map(move |q| (p, q))).map(|(p, q)| sum(p, q)).collect()
}
