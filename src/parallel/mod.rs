//! Loops over all threads.
//!
//! What they do is passed as an object, so that the machinery of threads is compiled once, not for every
//! loop of every kernel.

pub(crate) mod pool;
pub(crate) mod watch;

use rayon::prelude::*;

/// Calls `work` for every number below `count`.
pub(crate) fn for_each(count: usize, work: &(dyn Fn(usize) + Sync)) {
    (0..count).into_par_iter().for_each(work);
}

/// `make` of every number below `count`, in order.
pub(crate) fn map<V: Send>(count: usize, make: &(dyn Fn(usize) -> V + Sync)) -> Vec<V> {
    (0..count).into_par_iter().map(make).collect()
}

/// Calls `work` for every piece of `len` items, the last of which may be shorter, with its number.
pub(crate) fn for_each_piece<V: Send>(
    items: &mut [V],
    len: usize,
    work: &(dyn Fn(usize, &mut [V]) + Sync),
) {
    items.par_chunks_mut(len.max(1)).enumerate().for_each(|(piece, items)| work(piece, items));
}

/// Whether `holds` is true of every number below `count`.
pub(crate) fn all(count: usize, holds: &(dyn Fn(usize) -> bool + Sync)) -> bool {
    (0..count).into_par_iter().all(holds)
}
