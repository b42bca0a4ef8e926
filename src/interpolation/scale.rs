//! What errors are relative to.

use crate::expansion::geometry::{Level, Strength};
use crate::expansion::weights::Weights;
use crate::interpolation::budget::{FEW, KEPT, ONE, ROUNDED_UP, SPARE};
use crate::interpolation::means::Means;
use crate::interpolation::tuning::LIGHTER;
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
    /// Whether what comes from farther is as accurate in its slopes as in its values.
    pub(crate) slopes: bool,
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
        // Under the level's weights, all may be off by as much as the one that may be off by most.
        let lighter = if derivatives || degree.is_some() { 1.0 } else { lighter(level) };
        let [size, through] = [lighter * size, lighter * through];
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

/// How many times as much the field or density may be off that may be off by most as the one that may be so by least.
pub(crate) fn lighter<T: Real>(level: &Level<T>) -> f64 {
    let known = || level.fields.iter().chain(&level.densities).filter(|size| size.is_finite());
    let (least, most) = known()
        .fold((f64::INFINITY, 0.0f64), |(least, most), size| (least.min(*size), most.max(*size)));
    if most > LIGHTER * least && least > 0.0 { most / least } else { 1.0 }
}

/// The weights of a level's fields and densities: what may be off by less is multiplied by more.
pub(crate) fn level_weights<T: Real>(level: &Level<T>) -> Weights {
    let lighter = lighter(level);
    if lighter == 1.0 {
        return Weights::default();
    }
    let known = level.fields.iter().chain(&level.densities).filter(|size| size.is_finite());
    let most = known.fold(0.0f64, |most, size| most.max(*size));
    let weight =
        |size: &f64| if size.is_finite() { (most / size).log2().ceil().exp2() } else { 1.0 };
    let weights = |sizes: &[f64]| -> Vec<f64> {
        if sizes.is_empty() { vec![1.0] } else { sizes.iter().map(weight).collect() }
    };
    Weights { fields: weights(&level.fields), densities: weights(&level.densities) }
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
                slopes: false,
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
            slopes: false,
        }
    }

    /// How many times as large errors are that were measured relative to this scale, relative to another one for which
    /// they were measured likewise; none if they were not, or are much smaller than that asks for. What comes from
    /// farther than the interaction list is another matter.
    pub(crate) fn against(&self, other: &Self) -> Option<f64> {
        let is_measured = (self.corners || !other.corners) && (self.nearest || !other.nearest);
        let factor = self.size / other.size;
        (is_measured && KEPT * factor >= 1.0).then_some(factor)
    }

    /// The scale of errors that were measured for this one and meet another, with what comes from farther counted as
    /// much as either does.
    pub(crate) fn meeting(self, other: Self) -> Self {
        let (size, shells) = (self.size.min(other.size), self.shells.max(other.shells));
        Self { size, shells, ..self }
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
fn is_below(cells: f64, most: f64) -> bool {
    cells > 0.0 && cells < most
}

/// A size that differs from `unit` by a power of two, so that operators serve other points as well: the next
/// smaller one, or a slightly larger one.
fn rounded(size: f64, unit: f64) -> f64 {
    let exponent = (size / unit).log2();
    if exponent.is_finite() { unit * (exponent + ROUNDED_UP).floor().exp2() } else { size }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Levels of a kernel of degree 0 whose errors are small, but large between corners.
    fn scale(cells: f64, size: f64, through: f64) -> Scale {
        let model = Means::of(std::iter::repeat_n(Some([1.0; 2]), 316));
        Scale::new(model, [Served { cells, size, through, factor: 1.0 }].into_iter())
    }

    #[test]
    fn between_few_cells_corners_count() {
        let errors = Means::of(std::iter::repeat_n(Some([1.0, 100.0]), 316));
        let relative = |cells| scale(cells, 1.0, 1.0).relative(errors);
        assert_eq!(relative(64.0), 1.0);
        assert!((SPARE..10.0).contains(&relative(3.0)), "some are in the midst of cells");
        assert_eq!(relative(1.0), 10.0, "all may be in corners");
    }

    #[test]
    fn what_passes_through_from_farther_counts_more() {
        assert_eq!(scale(64.0, 8.0, 8.0).shells, 1.0);
        assert_eq!(scale(64.0, 8.0, 2.0).shells, 4.0);
    }

    #[test]
    fn errors_are_held_against_other_scales() {
        let against = |own: (f64, f64), other: (f64, f64)| {
            let [own, other] = [own, other].map(|(cells, size)| scale(cells, size, size));
            own.against(&other)
        };
        assert_eq!(against((64.0, 8.0), (64.0, 8.0)), Some(1.0));
        assert_eq!(against((64.0, 8.0), (64.0, 4.0)), Some(2.0));
        assert_eq!(against((64.0, 8.0), (64.0, 32.0)), Some(0.25));
        assert_eq!(against((64.0, 8.0), (64.0, 64.0)), None, "finer than it need be");
        assert_eq!(against((64.0, 8.0), (1.0, 8.0)), None, "corners count");
    }

    #[test]
    fn operators_that_were_checked_otherwise_are_others() {
        let scales = [(64.0, 8.0, 8.0), (64.0, 8.0, 2.0), (1.0, 8.0, 8.0), (64.0, 4.0, 4.0)];
        let keys = scales.map(|(cells, size, through)| scale(cells, size, through).key());
        for (i, key) in keys.iter().enumerate() {
            assert!(!keys[..i].contains(key), "{:?}", scales[i]);
        }
        assert_eq!(scale(64.0, 8.0, 8.0).key(), scale(64.0, 9.0, 9.0).key(), "much the same");
    }
}
