//! The derivatives of a kernel, where they have to be accurate too.

use crate::interpolation::budget::SLOPE_WEIGHT;
use crate::interpolation::entries::Entries;
use crate::interpolation::far_field::FarField;
use crate::interpolation::means::Means;
use crate::numbers::traits::Scalar;

/// The derivatives of a kernel in half-widths of a level's cells, and the size that their errors are
/// relative to.
pub(crate) struct Slopes<'a, S: Scalar> {
    pub(crate) entries: Entries<'a, S>,
    pub(crate) scale: Means,
    /// What their errors are multiplied by.
    pub(crate) weight: f64,
}

impl<'a, S: Scalar> Slopes<'a, S> {
    pub(crate) fn new(slopes: &Entries<'a, S>, far: &FarField<S::Real>, homogeneous: bool) -> Self {
        let entries = slopes.times(far.half_width());
        let scale = far.size(&entries);
        Self { entries, scale, weight: if homogeneous { 1.0 } else { SLOPE_WEIGHT } }
    }
}
