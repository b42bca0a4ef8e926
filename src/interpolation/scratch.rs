//! What the operators write to in passing, kept from call to call.

use crate::interpolation::points::Powers;
use crate::kernel::PointKernel;
use crate::numbers::real::{Additive, Located, Vector};
use crate::octree::geometry::Cell;

/// What P2M and L2P write to in passing.
pub(super) struct Scratch<K: PointKernel> {
    pub(super) powers: Powers<K::Real>,
    /// Positions in half-widths.
    pub(super) points: Vec<[K::Real; 3]>,
    /// Densities or fields of all points, one array per column, part and component.
    pub(super) numbers: Vec<K::Real>,
    /// Coefficients in padded arrays, likewise.
    pub(super) arrays: Vec<K::Real>,
    /// Densities or fields of one point.
    pub(super) columns: Vec<K::Column>,
    pub(super) gradients: Vec<[K::Column; 3]>,
    pub(super) sums: Vec<K::Entry>,
}

impl<K: PointKernel> Scratch<K> {
    pub(super) fn new(n: usize) -> Self {
        Self {
            powers: Powers::new(n),
            points: Vec::new(),
            numbers: Vec::new(),
            arrays: Vec::new(),
            columns: vec![K::Column::zero(); K::FIELDS.max(K::DENSITIES)],
            gradients: vec![[K::Column::zero(); 3]; if K::GRADIENT { K::FIELDS } else { 0 }],
            sums: Vec::new(),
        }
    }

    /// Takes the positions of a cell's points.
    pub(super) fn set_points<P: Located<Real = K::Real>>(
        &mut self,
        cell: &Cell<K::Real>,
        points: &[P],
    ) {
        self.points.clear();
        self.points.extend(points.iter().map(|p| cell.normalised(p.position()).to_array()));
    }
}

/// One cell's shift, from terms to terms of two arrays.
#[derive(Clone, Copy, Debug)]
pub(super) struct Move {
    pub(super) from: usize,
    pub(super) to: usize,
    pub(super) octant: usize,
}

/// What shifts write to in passing.
#[derive(Debug, Default)]
pub(crate) struct Shifted<S> {
    pub(super) moves: Vec<Move>,
    pub(super) x: Vec<S>,
    pub(super) z: Vec<S>,
}
