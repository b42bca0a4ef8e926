//! What errors are relative to.

use crate::interpolation::means::Means;

/// The size of a pair of points that the errors of operators are relative to.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scale {
    /// Means over the interaction list of a full tree.
    pub(crate) model: Means,
    /// What errors are relative to.
    pub(crate) size: f64,
    /// How much errors between corners count, if there may be so many points.
    pub(crate) corners: f64,
    /// How many times as much what comes from farther counts: it passes through more levels.
    pub(crate) shells: f64,
}

/// A level that operators serve, in the unit of the operators' kernel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Served {
    /// How many cells share what a target receives.
    pub(crate) cells: f64,
    /// What their errors may be taken relative to, and those of all pairs that pass through the level.
    pub(crate) size: f64,
    pub(crate) through: f64,
    /// What the operators are multiplied by.
    pub(crate) factor: f64,
}

impl Scale {
    /// The scale of operators that serve some levels; that of the model if nothing is known of these.
    pub(crate) fn new(model: Means, served: impl Iterator<Item = Served> + Clone) -> Self {
        // What grows with distance is smallest between the corners that face each other.
        let growing = if model.grows() { 1.0 } else { 0.0 };
        let square = |served: Served| (served.factor / served.size).powi(2);
        let sum: f64 = served.clone().map(square).sum();
        if sum == 0.0 {
            return Self { model, size: model.least(), corners: growing, shells: 1.0 };
        }
        let from_few: f64 = served.clone().filter(|served| served.cells < FEW).map(square).sum();
        let size = rounded(sum.sqrt().recip(), model.all());
        let farther = served.map(|served| served.size / served.through).fold(1.0, f64::max);
        Self {
            model,
            size,
            corners: if 2.0 * from_few > sum { FEW_WEIGHT } else { growing },
            shells: rounded(farther, 1.0),
        }
    }

    /// What operators of that scale are recognised by.
    pub(crate) fn key(&self) -> [u64; 3] {
        [self.size, self.corners, self.shells].map(f64::to_bits)
    }

    /// Errors relative to this scale.
    pub(crate) fn relative(&self, errors: Means) -> f64 {
        let error = if self.corners > 0.0 { errors.worst(self.corners) } else { errors.all() };
        if error == 0.0 { 0.0 } else { error / self.size }
    }
}

/// Where fewer cells than these share a field, their points may all be in corners.
const FEW: f64 = 3.0;

/// How much the mean error between corners counts then: they may be those of the worst pair of cells.
const FEW_WEIGHT: f64 = 2.0;

/// A size that differs from `unit` by a power of two, so that operators serve other points as well: the next
/// smaller one, or a slightly larger one.
fn rounded(size: f64, unit: f64) -> f64 {
    let exponent = (size / unit).log2();
    if exponent.is_finite() { unit * (exponent + ROUNDING).floor().exp2() } else { size }
}

/// Sizes are rounded up by no more than this power of two.
const ROUNDING: f64 = 0.25;
