//! The derivatives of a kernel, where they have to be accurate too.

use crate::interpolation::entries::Entries;
use crate::interpolation::scale::Scale;
use crate::numbers::traits::Scalar;

/// The derivatives of a kernel in half-widths of a level's cells, and what their errors are relative to.
pub(crate) struct Slopes<'a, S: Scalar> {
    pub(crate) entries: Entries<'a, S>,
    pub(crate) scale: Scale,
    /// What their errors are multiplied by.
    pub(crate) weight: f64,
}
