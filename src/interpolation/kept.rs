//! Operators that a plan had before, and what they are good for among those that another one needs.

use std::sync::Arc;

use crate::interpolation::basis::{Basis, adjoint, product};
use crate::interpolation::entries::{Entries, norm_squared};
use crate::interpolation::far_field::FarField;
use crate::interpolation::level::LevelOperators;
use crate::interpolation::means::INTERACTION_OFFSETS;
use crate::interpolation::operators::{Kept, Operators, Sizes};
use crate::interpolation::scale::Scale;
use crate::numbers::traits::{Real, Scalar};

/// Operators with the sizes that they were made for.
pub(crate) struct Former<'a, S: Scalar> {
    pub(crate) operators: &'a Arc<Operators<S>>,
    pub(crate) sizes: &'a Sizes<S::Real>,
}

impl<S: Scalar> Former<'_, S> {
    /// Which levels of some sizes the operators serve, with errors of `most` at each, and what errors there may be taken
    /// relative to, which is written to `sizes`.
    pub(crate) fn keep(
        &self,
        kernel: &Entries<'_, S>,
        with_slopes: bool,
        most: f64,
        sizes: &mut Sizes<S::Real>,
    ) -> Kept<S> {
        let own = self.sizes;
        let mut levels = Vec::with_capacity(sizes.half_widths.len());
        for index in 0..sizes.half_widths.len() {
            let found = own.half_widths.iter().position(|h| *h == sizes.half_widths[index]);
            let found = found.and_then(|former| {
                let level = &self.operators.levels[former];
                let values = against(&own.scales, former, &sizes.scales, index)?;
                let slopes = against(&own.slope_scales, former, &sizes.slope_scales, index)?;
                let factor = values.max(slopes);
                let serves = own.homogeneous == sizes.homogeneous
                    && own.carried[former] == sizes.carried[index]
                    && own.weights[former] == sizes.weights[index]
                    && factor * level.error <= most
                    && self.reaches(kernel, with_slopes, former, sizes, index);
                serves.then(|| (former, Arc::clone(level), factor))
            });
            if let Some((former, ..)) = found {
                sizes.scales[index] = own.scales[former].meeting(sizes.scales[index]);
                if let Some(scale) = sizes.slope_scales.get_mut(index) {
                    *scale = own.slope_scales[former].meeting(*scale);
                }
                sizes.reaches[index] = sizes.reaches[index].max(own.reaches[former]);
            }
            levels.push(found.map(|(_, level, factor)| (level, factor)));
        }
        Kept { order: self.operators.rule.len(), levels }
    }

    /// The operators themselves, if they are those of all levels and no others.
    pub(crate) fn whole(&self, kept: &Kept<S>) -> Option<Arc<Operators<S>>> {
        let levels = &self.operators.levels;
        let is_same = |(own, kept): (&Arc<_>, &Option<(Arc<_>, f64)>)| {
            kept.as_ref().is_some_and(|(kept, _)| Arc::ptr_eq(own, kept))
        };
        let is_whole =
            levels.len() == kept.levels.len() && levels.iter().zip(&kept.levels).all(is_same);
        is_whole.then(|| Arc::clone(self.operators))
    }

    /// Whether what comes from farther away than the interaction list is what the bases of a level were made for, or
    /// they leave out no more of it than of all else.
    fn reaches(
        &self,
        kernel: &Entries<'_, S>,
        with_slopes: bool,
        former: usize,
        sizes: &Sizes<S::Real>,
        index: usize,
    ) -> bool {
        let (own, other) = (self.sizes.scales[former], sizes.scales[index]);
        let seen = if own.shells >= other.shells { self.sizes.reaches[former] } else { 0.0 };
        if sizes.reaches[index] <= seen {
            return true;
        }
        let LevelOperators { bases, .. } = &*self.operators.levels[former];
        let beyond = sizes.far_field(index, bases.reflected).beyond(seen);
        let scale = Scale { slopes: with_slopes, ..own.meeting(other) };
        let kernel = &kernel.weighted_by(&sizes.weights[index]);
        let fits = |kernel: &Entries<'_, S>, basis: &Basis<S>| {
            self.left_out(kernel, basis, &beyond, scale) <= bases.cut
        };
        fits(kernel, &bases.target)
            && (Arc::ptr_eq(&bases.source, &bases.target)
                || fits(&kernel.transpose(), &bases.source))
    }

    /// What a basis leaves out of a far field, root mean square per sample.
    fn left_out(
        &self,
        kernel: &Entries<'_, S>,
        basis: &Basis<S>,
        far: &FarField<S::Real>,
        scale: Scale,
    ) -> f64 {
        let mut columns = far.columns(kernel, &self.operators.rule, scale);
        if basis.functions.columns > 0 && columns.columns > 0 {
            let coordinates = product(&adjoint(&basis.functions), &columns);
            let seen = product(&basis.functions, &coordinates);
            columns.data.iter_mut().zip(&seen.data).for_each(|(own, &seen)| *own -= seen);
        }
        (norm_squared(&columns.data) / INTERACTION_OFFSETS as f64).sqrt()
    }
}

/// How many times as large errors relative to a former scale are relative to another one; 0 if there are none.
fn against(former: &[Scale], own: usize, scales: &[Scale], index: usize) -> Option<f64> {
    match (former.get(own), scales.get(index)) {
        (Some(former), Some(scale)) => former.against(scale),
        (None, None) => Some(0.0),
        _ => None,
    }
}

/// A power of two by which a unit may be off before squares are in danger.
const UNIT_RANGE: f64 = 16.0;

/// The unit of former operators, if numbers of that `unit` can be told in it.
pub(crate) fn kept_unit<T: Real>(former: T, unit: T) -> T {
    let exponent = (former.as_f64() / unit.as_f64()).log2();
    if exponent.abs() <= UNIT_RANGE { former } else { unit }
}
