//! Operators with what they are found and recognised by.

use std::any::Any;
use std::hash::Hash;
use std::sync::Arc;

use crate::interpolation::accuracy::Accuracy;
use crate::interpolation::entries::Entries;
use crate::interpolation::hashing::StableHasher;
use crate::interpolation::operators::{Operators, Sizes};
use crate::interpolation::scale::Scale;
use crate::interpolation::stored::Stored;
use crate::numbers::traits::{Real, Scalar};
use crate::parallel;

/// What a kernel is recognised by.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Identity {
    /// What it says that it is.
    Stated(String),
    /// Where its code is, for kernels that have no parameters. Another process has it elsewhere.
    Code(usize),
    /// All its values that went into its operators.
    Values,
}

/// What operators are found by. Two kernels with the same key may still differ where no sample point is, unless they have
/// an identity: [`Operators::digest`] tells them apart.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Key {
    pub(crate) identity: Identity,
    /// Whether derivatives had to be accurate too.
    pub(crate) with_slopes: bool,
    pub(crate) accuracy: Accuracy,
    pub(crate) half_widths: Vec<f64>,
    pub(crate) fingerprint: u64,
}

impl Key {
    pub(crate) fn new<S: Scalar>(
        identity: Identity,
        kernel: &Entries<'_, S>,
        with_slopes: bool,
        accuracy: Accuracy,
        sizes: &Sizes<S::Real>,
    ) -> Self {
        let of_level = |level: usize| {
            let mut hasher = StableHasher::default();
            sizes.reaches[level].to_bits().hash(&mut hasher);
            let scales = [sizes.scales.get(level), sizes.slope_scales.get(level)];
            scales.map(|scale| scale.map(Scale::key)).hash(&mut hasher);
            sizes.carried[level].hash(&mut hasher);
            let weights = &sizes.weights[level];
            let all = weights.fields.iter().chain(&weights.densities);
            all.for_each(|weight| weight.to_bits().hash(&mut hasher));
            let kernel = &kernel.weighted_by(weights);
            sizes.far_field(level, true).for_each_entry(kernel, |entry: S| {
                entry.parts().map(|part| part.as_f64().to_bits()).hash(&mut hasher);
            });
            hasher.value()
        };
        let mut hasher = StableHasher::default();
        parallel::map(sizes.reaches.len(), &of_level).hash(&mut hasher);
        let half_widths = sizes.half_widths.iter().map(|h| h.as_f64()).collect();
        Self { identity, with_slopes, accuracy, half_widths, fingerprint: hasher.value() }
    }

    /// Whether all but the identities are equal.
    pub(crate) fn is_like(&self, other: &Self) -> bool {
        let Self { identity: _, with_slopes, accuracy, half_widths, fingerprint } = self;
        (with_slopes, accuracy, half_widths, fingerprint)
            == (&other.with_slopes, &other.accuracy, &other.half_widths, &other.fingerprint)
    }
}

/// Operators, with what they are found and recognised by.
#[derive(Clone)]
pub(crate) struct Known {
    pub(crate) key: Key,
    pub(crate) operators: Arc<dyn AnyOperators>,
    /// Of values that the operators were built from.
    pub(crate) digest: Option<u64>,
    pub(crate) bytes: usize,
}

impl Known {
    /// Whether another process can recognise it.
    pub(crate) fn lasts(&self) -> bool {
        matches!(self.key.identity, Identity::Stated(_)) || self.digest.is_some()
    }
}

/// [`Operators`] whose numbers' type is forgotten.
pub(crate) trait AnyOperators: Any + Send + Sync {
    /// The same with the type asked for, if it is that.
    fn into_any(self: Arc<Self>) -> Arc<dyn Any + Send + Sync>;
    /// Hands over all bytes.
    fn store(&self, to: &mut dyn FnMut(&[u8]));
    /// What the numbers are.
    fn scalar(&self) -> &'static str;
}

impl<S: Scalar> AnyOperators for Operators<S> {
    fn into_any(self: Arc<Self>) -> Arc<dyn Any + Send + Sync> {
        self
    }

    fn store(&self, to: &mut dyn FnMut(&[u8])) {
        Stored::store(self, to);
    }

    fn scalar(&self) -> &'static str {
        scalar_name::<S>()
    }
}

/// What scalars of this type are called in files.
pub(crate) fn scalar_name<S: Scalar>() -> &'static str {
    match (S::COMPLEX, size_of::<S::Real>()) {
        (false, 4) => "f32",
        (false, _) => "f64",
        (true, 4) => "complex f32",
        (true, _) => "complex f64",
    }
}
