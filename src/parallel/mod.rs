//! Loops over all threads.
//!
//! What they do is passed as an object, and the machinery of threads sees nothing but numbers, so that it is compiled
//! once, not for every loop of every kernel.

pub(crate) mod pool;
pub(crate) mod watch;

use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

/// Calls `work` for every number below `count`.
pub(crate) fn for_each(count: usize, work: &(dyn Fn(usize) + Sync)) {
    (0..count).into_par_iter().for_each(work);
}

/// `make` of every number below `count`, in order.
pub(crate) fn map<V: Send>(count: usize, make: &(dyn Fn(usize) -> V + Sync)) -> Vec<V> {
    let mut values: Vec<Option<V>> = (0..count).map(|_| None).collect();
    for_each_piece(&mut values, 1, &|number, value| value[0] = Some(make(number)));
    values.into_iter().map(|value| value.expect("every number was asked for")).collect()
}

/// As [`map`], without its two passes of one thread: for millions of values that take next to nothing to make. Compiled
/// for each type of value.
pub(crate) fn map_many<V: Send>(count: usize, make: &(dyn Fn(usize) -> V + Sync)) -> Vec<V> {
    (0..count).into_par_iter().map(make).collect()
}

/// Into how many parts the pieces of [`for_each_piece`] go at most: many for each thread, and no list on the heap.
const PARTS: usize = 512;

/// Calls `work` for every piece of `len` items, the last of which may be shorter, with its number.
pub(crate) fn for_each_piece<V: Send>(
    items: &mut [V],
    len: usize,
    work: &(dyn Fn(usize, &mut [V]) + Sync),
) {
    let len = len.max(1);
    let pieces = items.len().div_ceil(len);
    let together = pieces.div_ceil(PARTS).max(1);
    let mut parts = items.chunks_mut(together * len);
    let parts: [Mutex<&mut [V]>; PARTS] =
        std::array::from_fn(|_| Mutex::new(parts.next().unwrap_or_default()));
    for_each(pieces.div_ceil(together), &|part| {
        let mut items = parts[part].lock().unwrap_or_else(PoisonError::into_inner);
        for (i, piece) in items.chunks_mut(len).enumerate() {
            work(part * together + i, piece);
        }
    });
}

/// Whether `holds` is true of every number below `count`.
pub(crate) fn all(count: usize, holds: &(dyn Fn(usize) -> bool + Sync)) -> bool {
    (0..count).into_par_iter().all(holds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_visited_once_each_with_their_numbers() {
        for count in [0, 1, 2, PARTS - 1, PARTS, PARTS + 1, 5 * PARTS + 3] {
            assert_eq!(map(count, &|i| i.to_string()), map_many(count, &|i| i.to_string()));
            for len in [0, 1, 3, 1000] {
                let mut items = vec![0; count];
                for_each_piece(&mut items, len, &|piece, items| {
                    items
                        .iter_mut()
                        .enumerate()
                        .for_each(|(i, item)| *item += piece * len.max(1) + i + 1);
                });
                assert!(
                    items.iter().enumerate().all(|(i, &item)| item == i + 1),
                    "{count} by {len}"
                );
            }
        }
    }
}
