//! Operators of kernels that were met before: they do not depend on the points.

use std::any::Any;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::{Arc, Mutex};

use crate::interpolation::accuracy::Accuracy;
use crate::interpolation::entries::Entries;
use crate::interpolation::operators::{Operators, Sizes};
use crate::interpolation::scale::Scale;
use crate::interpolation::tuning::CAPACITY;
use crate::numbers::traits::{Real, Scalar};

/// Which formula a kernel is, as far as its type tells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct KernelName {
    /// The name of its type, which several closures of one function share.
    pub(crate) name: &'static str,
    /// Where its code is, which they don't.
    pub(crate) code: usize,
    /// Whether kernels of this type differ.
    pub(crate) has_parameters: bool,
}

/// What operators are found by. Two kernels with the same key may still differ where no sample point is:
/// [`Operators::digest`] tells them apart.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Key {
    kernel: KernelName,
    /// Whether derivatives had to be accurate too.
    with_slopes: bool,
    accuracy: Accuracy,
    half_widths: Vec<u64>,
    fingerprint: u64,
}

/// Operators, with what they are found and recognised by.
struct Known {
    key: Key,
    operators: Arc<dyn Any + Send + Sync>,
    digest: u64,
}

static CACHE: Mutex<Vec<Known>> = Mutex::new(Vec::new());

impl Key {
    pub(crate) fn new<S: Scalar>(
        kernel_name: KernelName,
        kernel: &Entries<'_, S>,
        with_slopes: bool,
        accuracy: Accuracy,
        sizes: &Sizes<S::Real>,
    ) -> Self {
        let mut hasher = DefaultHasher::new();
        for (level, reach) in sizes.reaches.iter().enumerate() {
            reach.to_bits().hash(&mut hasher);
            let scales = [sizes.scales.get(level), sizes.slope_scales.get(level)];
            scales.map(|scale| scale.map(Scale::key)).hash(&mut hasher);
            sizes.carried[level].hash(&mut hasher);
            sizes.far_field(level, true).for_each_entry(kernel, |entry: S| {
                entry.parts().map(|part| part.as_f64().to_bits()).hash(&mut hasher);
            });
        }
        let half_widths = sizes.half_widths.iter().map(|h| h.as_f64().to_bits()).collect();
        let fingerprint = hasher.finish();
        Self { kernel: kernel_name, with_slopes, accuracy, half_widths, fingerprint }
    }
}

/// The operators that are remembered under `key`, with their digests. The kernel is asked by the caller,
/// when nothing is locked.
pub(crate) fn candidates<S: Scalar>(key: &Key) -> Vec<(Arc<Operators<S>>, u64)> {
    let mut cache = CACHE.lock().unwrap_or_else(|e| e.into_inner());
    // Those that are asked for become the last to be forgotten.
    cache.sort_by_key(|known| known.key == *key);
    let found = cache.iter().filter(|known| known.key == *key);
    let typed = |known: &Known| {
        let operators = Arc::clone(&known.operators).downcast().ok()?;
        Some((operators, known.digest))
    };
    found.filter_map(typed).collect()
}

/// Remembers operators, and forgets the ones that were used the longest ago.
pub(crate) fn remember<S: Scalar>(key: Key, operators: Arc<Operators<S>>, digest: u64) {
    let mut cache = CACHE.lock().unwrap_or_else(|e| e.into_inner());
    cache.push(Known { key, operators, digest });
    if cache.len() > CAPACITY {
        cache.remove(0);
    }
}
