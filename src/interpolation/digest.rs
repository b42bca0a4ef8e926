//! What operators were built from, as one number.

use std::sync::Arc;

use crate::error::Error;
use crate::interpolation::entries::{Entries, PointOf, zero};
use crate::interpolation::far_field::FarField;
use crate::interpolation::hashing::{Digest, TAKEN};
use crate::interpolation::level::{LevelOperators, operator_costs};
use crate::interpolation::operators::{Operators, Sizes};
use crate::interpolation::probe::sample;
use crate::interpolation::ranges::skeletons;
use crate::interpolation::tuning::CHECK_POINTS;
use crate::numbers::traits::{Point, Real, Scalar, Vector};
use crate::parallel;

impl<S: Scalar> Operators<S> {
    /// A number that stands for a quarter of the values of the kernel from which bases and M2L matrices were made: for
    /// the whole fields of one source of four. It also stands for values between random points of all pairs of cells.
    /// Kernels that differ in what operators are made of have the same number only if they differ next to nowhere.
    ///
    /// # Errors
    /// [`Error::OverWork`](crate::Error::OverWork), before any value is computed.
    pub(crate) fn digest(
        &self,
        kernel: &Entries<'_, S>,
        slopes: Option<&Entries<'_, S>>,
        sizes: &Sizes<S::Real>,
    ) -> Result<u64, Error> {
        let levels = || self.levels.iter().enumerate();
        let far = |(l, level): (usize, &Arc<LevelOperators<S>>)| {
            sizes.far_field(l, level.bases.reflected)
        };
        let fields: Vec<FarField<_>> = levels().map(far).collect();
        let (n, mut evaluations) = (self.rule.len(), 0.0);
        for ((_, level), far) in levels().zip(&fields) {
            let rank = level.bases.target.functions.columns;
            let [of_matrices, _] = operator_costs(kernel, n, rank, level.bases.reflected);
            evaluations += (n.pow(3) * far.len()) as f64 / TAKEN as f64 + of_matrices;
        }
        kernel.afford(evaluations, 0.0)?;

        let digest = Digest::default();
        let digested = &kernel.digested_by(Some(&digest));
        for ((l, level), far) in levels().zip(&fields) {
            let digested = &digested.weighted_by(&sizes.weights[l]);
            let (nodes, sources) = far.places(&self.rule);
            let field = |xs: &[PointOf<S>], y: PointOf<S>| {
                if Digest::takes(&y.to_array()) {
                    let len = xs.len() * kernel.fields * kernel.densities;
                    digested.write(xs, y, &mut vec![zero::<S>(); len]);
                }
            };
            parallel::for_each(sources.len(), &|j| field(&nodes, sources[j]));
            let offsets = far.carried().offsets();
            parallel::for_each(offsets.len(), &|o| {
                if !level.bases.reflected || offsets[o].iter().all(|&o| o >= 0) {
                    let [xs, ys] = skeletons(&level.bases, offsets[o]);
                    ys.into_iter().for_each(|y| field(&xs, y));
                }
            });
        }
        Ok(self.digest_from(digest, kernel, slopes, sizes))
    }

    /// The same, if `digest` has the values that bases and matrices were made from.
    pub(crate) fn digest_from(
        &self,
        digest: Digest,
        kernel: &Entries<'_, S>,
        slopes: Option<&Entries<'_, S>>,
        sizes: &Sizes<S::Real>,
    ) -> u64 {
        let kernel = &kernel.digested_by(Some(&digest));
        let slopes = slopes.map(|slopes| slopes.digested_by(Some(&digest)));
        for (l, level) in self.levels.iter().enumerate() {
            let half_width = sizes.half_widths[l];
            let far = sizes.far_field(l, level.bases.reflected);
            let offsets = far.carried().offsets();
            parallel::for_each(offsets.len(), &|o| {
                let step = offsets[o].map(|o| S::Real::from_f64(2.0 * f64::from(o)));
                let step = Point::<S::Real>::from_array(step);
                let at = |k: usize| sample::<S::Real>(1000 + k) * half_width;
                let xs: Vec<PointOf<S>> =
                    (0..CHECK_POINTS).map(|k| at(CHECK_POINTS + k) + step * half_width).collect();
                for entries in [Some(kernel), slopes.as_ref()].into_iter().flatten() {
                    let entries = entries.weighted_by(&sizes.weights[l]);
                    let len = xs.len() * entries.fields * entries.densities;
                    let mut values = vec![zero::<S>(); len];
                    (0..CHECK_POINTS).for_each(|k| entries.write(&xs, at(k), &mut values));
                }
            });
        }
        digest.value()
    }
}
