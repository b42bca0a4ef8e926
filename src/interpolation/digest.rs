//! What operators were built from, as one number.

use std::hash::Hasher;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use crate::interpolation::entries::{Entries, PointOf, zero};
use crate::interpolation::hashing::StableHasher;
use crate::interpolation::operators::{Operators, Sizes};
use crate::interpolation::probe::sample;
use crate::interpolation::ranges::between;
use crate::interpolation::tuning::CHECK_POINTS;
use crate::numbers::traits::{Point, Real, Scalar, Vector};
use crate::parallel;

impl<S: Scalar> Operators<S> {
    /// A number that stands for all values of the kernel from which bases and M2L matrices were made, and for
    /// values between random points of all pairs of cells. Another kernel with the same number has the same
    /// operators.
    pub(crate) fn digest(
        &self,
        kernel: &Entries<'_, S>,
        slopes: Option<&Entries<'_, S>>,
        sizes: &Sizes<S::Real>,
    ) -> u64 {
        let sum = AtomicU64::new(0);
        for (l, level) in self.levels.iter().enumerate() {
            let half_width = sizes.half_widths[l];
            let far = sizes.far_field(l, level.bases.reflected);
            let (nodes, sources) = far.places(&self.rule);
            parallel::for_each(sources.len(), &|j| add(&sum, kernel, &nodes, sources[j]));

            let offsets = far.carried().offsets();
            parallel::for_each(offsets.len(), &|o| {
                let folded = !level.bases.reflected || offsets[o].iter().all(|&o| o >= 0);
                if folded {
                    let values = between(kernel, &level.bases, offsets[o]);
                    sum.fetch_add(hash(&values.data), Relaxed);
                }
                let step = offsets[o].map(|o| S::Real::from_f64(2.0 * f64::from(o)));
                let step = Point::<S::Real>::from_array(step);
                let at = |k: usize| sample::<S::Real>(1000 + k) * half_width;
                let xs: Vec<PointOf<S>> =
                    (0..CHECK_POINTS).map(|k| at(CHECK_POINTS + k) + step * half_width).collect();
                for y in (0..CHECK_POINTS).map(at) {
                    add(&sum, kernel, &xs, y);
                    if let Some(slopes) = slopes {
                        add(&sum, slopes, &xs, y);
                    }
                }
            });
        }
        sum.into_inner()
    }
}

/// Adds the values of the kernel between some points.
fn add<S: Scalar>(sum: &AtomicU64, kernel: &Entries<'_, S>, xs: &[PointOf<S>], y: PointOf<S>) {
    let mut values = vec![zero::<S>(); xs.len() * kernel.fields * kernel.densities];
    kernel.write(xs, y, &mut values);
    sum.fetch_add(hash(&values), Relaxed);
}

/// A number for some numbers in their order.
fn hash<S: Scalar>(numbers: &[S]) -> u64 {
    let mut hasher = StableHasher::default();
    for number in numbers {
        for part in &number.parts()[..S::PARTS] {
            hasher.write_u64(part.as_f64().to_bits());
        }
    }
    hasher.value()
}
