//! What errors are relative to.

use crate::expansion::geometry::{Level, Strength};
use crate::interpolation::budget::{FEW, ONE, ROUNDED_UP, SPARE};
use crate::interpolation::means::Means;
use crate::numbers::traits::Real;

/// The size of a pair of points that the errors of operators are relative to.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scale {
    /// Means over the interaction list of a full tree.
    pub(crate) model: Means,
    /// What errors are relative to.
    pub(crate) size: f64,
    /// Whether errors between corners count.
    pub(crate) corners: bool,
    /// Whether errors of the nearest cells count by themselves.
    pub(crate) nearest: bool,
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

impl Served {
    /// A level as operators of a kernel of that degree serve it, or operators of its own, where its strength is
    /// known. Lengths are half-widths for derivatives.
    pub(crate) fn new<T: Real>(
        level: &Level<T>,
        degree: Option<f64>,
        unit: f64,
        derivatives: bool,
    ) -> Option<Self> {
        let h = level.half_width.as_f64();
        let (strength, length) = if derivatives { (level.slopes, h) } else { (level.values, 1.0) };
        let Strength { cells, size, through, .. } = strength?;
        // What no pair of the level was seen to need, others need that pass through. One level's operators for
        // all are checked with these.
        let [size, through] = match degree {
            Some(_) => [size; 2],
            None => [if size.is_finite() { size } else { through }, through],
        };
        let [size, through] = [size, through].map(|number| number * length / unit);
        Some(Self { cells, size, through, factor: factor(degree, h) })
    }
}

/// What operators of unit cells are multiplied by at cells of half-width h.
pub(crate) fn factor(degree: Option<f64>, h: f64) -> f64 {
    degree.map_or(1.0, |degree| h.powf(degree))
}

impl Scale {
    /// The scale of operators that serve some levels; that of the model if nothing is known of these.
    pub(crate) fn new(model: Means, served: impl Iterator<Item = Served> + Clone) -> Self {
        let square = |served: Served| (served.factor / served.size).powi(2);
        let sum: f64 = served.clone().map(square).sum();
        if sum == 0.0 {
            return Self {
                model,
                size: model.least(),
                corners: model.grows(),
                nearest: false,
                shells: 1.0,
            };
        }
        let from = |cells: f64| -> f64 {
            served.clone().filter(|served| is_below(served.cells, cells)).map(square).sum()
        };
        let [one, few] = [ONE, FEW].map(|cells| 2.0 * from(cells) > sum);
        let size = sum.sqrt().recip() / if few && !one { SPARE } else { 1.0 };
        let size = rounded(size, model.all());
        let farther = served.map(|served| served.size / served.through).fold(1.0, f64::max);
        Self {
            model,
            size,
            // What grows with distance is smallest between the corners that face each other.
            corners: model.grows() || one,
            nearest: few,
            shells: rounded(farther, 1.0),
        }
    }

    /// What operators of that scale are recognised by.
    pub(crate) fn key(&self) -> (u64, [bool; 2], u64) {
        (self.size.to_bits(), [self.corners, self.nearest], self.shells.to_bits())
    }

    /// Errors relative to this scale.
    pub(crate) fn relative(&self, errors: Means) -> f64 {
        let error = errors.worst(self.nearest, self.corners);
        if error == 0.0 { 0.0 } else { error / self.size }
    }
}

/// Whether fewer cells share a field, but not none.
pub(crate) fn is_below(cells: f64, most: f64) -> bool {
    cells > 0.0 && cells < most
}

/// A size that differs from `unit` by a power of two, so that operators serve other points as well: the next
/// smaller one, or a slightly larger one.
fn rounded(size: f64, unit: f64) -> f64 {
    let exponent = (size / unit).log2();
    if exponent.is_finite() { unit * (exponent + ROUNDED_UP).floor().exp2() } else { size }
}
