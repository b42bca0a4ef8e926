//! The bases of a level: of what leaves its cells, and of what enters them.

use std::sync::Arc;

use crate::interpolation::basis::Basis;
use crate::numbers::traits::Scalar;

/// The bases of cells of one size.
#[derive(Debug)]
pub(crate) struct Bases<S: Scalar> {
    pub(crate) half_width: S::Real,
    pub(crate) source: Arc<Basis<S>>,
    pub(crate) target: Arc<Basis<S>>,
    /// Whether a reflected offset has the same matrix, with signs on rows and columns.
    pub(crate) reflected: bool,
    /// What an M2L matrix may leave out (Frobenius norm).
    pub(crate) cut: f64,
}

impl<S: Scalar> Bases<S> {
    /// The axes across directions that lie along `axes`; none without reflections.
    pub(crate) fn across(&self, axes: u8) -> u8 {
        if self.reflected { !axes & 7 } else { 0 }
    }
}
