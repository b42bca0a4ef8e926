//! What the operators write to in passing, kept from call to call.

use crate::interpolation::points::Powers;
use crate::kernel::traits::Kernel;
use crate::numbers::traits::{Located, Numbers, Vector};
use crate::octree::geometry::Cell;

/// What P2M and L2P write to in passing.
pub(super) struct Scratch<K: Kernel> {
    pub(super) powers: Powers<K::Real>,
    /// Positions in half-widths.
    pub(super) points: Vec<[K::Real; 3]>,
    /// Densities or fields of all points, one array per column, part and component.
    pub(super) numbers: Vec<K::Real>,
    /// Coefficients in padded arrays, likewise.
    pub(super) arrays: Vec<K::Real>,
    /// Densities or fields of one point, in every column.
    pub(super) entries: Vec<K::Entry>,
    /// The fields' gradients there, if the kernel needs them.
    pub(super) gradients: Vec<[K::Entry; 3]>,
    pub(super) sums: Vec<K::Entry>,
}

impl<K: Kernel> Scratch<K> {
    pub(super) fn new(n: usize, kernel: &K) -> Self {
        let (fields, columns) = (kernel.fields(), kernel.columns());
        let zero = <K::Entry as Numbers>::zero();
        Self {
            powers: Powers::new(n),
            points: Vec::new(),
            numbers: Vec::new(),
            arrays: Vec::new(),
            entries: vec![zero; fields.max(kernel.densities()) * columns],
            gradients: vec![[zero; 3]; if kernel.needs_gradients() { fields * columns } else { 0 }],
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
