//! Operators of kernels that were met before: they do not depend on the points.

use std::any::Any;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::{Arc, Mutex};

use crate::interpolation::entries::Entries;
use crate::interpolation::far_field::FarField;
use crate::interpolation::operators::{Accuracy, Operators, Sizes};
use crate::interpolation::tuning::CAPACITY;
use crate::numbers::traits::{Real, Scalar};

/// What a kernel is known by: its type, and its values at sample points of every level, so that two
/// kernels of one type with different parameters are told apart.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Key {
    kernel: &'static str,
    /// Whether derivatives had to be accurate too.
    with_slopes: bool,
    accuracy: Accuracy,
    half_widths: Vec<u64>,
    fingerprint: u64,
}

static CACHE: Mutex<Vec<(Key, Arc<dyn Any + Send + Sync>)>> = Mutex::new(Vec::new());

impl Key {
    pub(crate) fn new<S: Scalar>(
        kernel_type: &'static str,
        kernel: &Entries<'_, S>,
        with_slopes: bool,
        accuracy: Accuracy,
        sizes: &Sizes<S::Real>,
    ) -> Self {
        let mut hasher = DefaultHasher::new();
        for &half_width in &sizes.half_widths {
            FarField::new(half_width, sizes.extent, 1).for_each_entry(kernel, |entry: S| {
                entry.parts().map(|part| part.as_f64().to_bits()).hash(&mut hasher);
            });
        }
        let half_widths = sizes.half_widths.iter().map(|h| h.as_f64().to_bits()).collect();
        let fingerprint = hasher.finish();
        Self { kernel: kernel_type, with_slopes, accuracy, half_widths, fingerprint }
    }
}

/// The operators that are remembered under `key`, the most recently used last.
pub(crate) fn find<S: Scalar>(key: &Key) -> Option<Arc<Operators<S>>> {
    let mut cache = CACHE.lock().unwrap_or_else(|e| e.into_inner());
    let entry = cache.iter().position(|(known, _)| known == key).map(|i| cache.remove(i))?;
    let operators = Arc::clone(&entry.1).downcast().ok();
    cache.push(entry);
    operators
}

/// Remembers operators, and forgets the ones that were used the longest ago.
pub(crate) fn remember<S: Scalar>(key: Key, operators: Arc<Operators<S>>) {
    let mut cache = CACHE.lock().unwrap_or_else(|e| e.into_inner());
    cache.push((key, operators));
    if cache.len() > CAPACITY {
        cache.remove(0);
    }
}
