//! Morton order: keys that interleave three coordinates, and a parallel radix sort by them.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use crate::parallel;

/// The key of a point with the point's index.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Keyed {
    pub(crate) key: u64,
    pub(crate) index: u32,
}

/// Levels of the octree that one key tells apart: as many bits of each coordinate as fit.
pub(crate) const KEY_LEVELS: usize = 21;

/// As many points with the keys that `key` gives them. O(N).
pub(crate) fn keyed(count: usize, key: &(dyn Fn(u32) -> u64 + Sync)) -> Vec<Keyed> {
    parallel::map_many(count, &|i| Keyed { key: key(i as u32), index: i as u32 })
}

/// Interleaves the lowest [`KEY_LEVELS`] bits of three coordinates; x takes the lowest bit of each triple.
pub(crate) fn morton_key([x, y, z]: [u64; 3]) -> u64 {
    spread(x) | spread(y) << 1 | spread(z) << 2
}

/// Sorts `items` by key as far as an octree of leaves of at most `leaf_size` looks: items of an
/// octant that holds no more than that stay in the order they came in, and so do equal keys.
/// `scratch` is as long as `items`; what it holds afterwards has no meaning. O(N) per 12 bits of the
/// key that matter.
pub(crate) fn sort(items: &mut [Keyed], scratch: &mut [Keyed], leaf_size: usize) {
    if items.len() <= leaf_size.max(1) {
        return;
    }
    if items.len() <= SMALL {
        return items.sort_by_key(|item| item.key);
    }
    let Some(digit) = Digit::leading(items, leaf_size) else { return };
    if items.len() <= CHUNK {
        let sizes = digit.distribute(items, scratch);
        items.copy_from_slice(scratch);
        for (items, scratch) in split(items, &sizes).into_iter().zip(split(scratch, &sizes)) {
            sort(items, scratch, leaf_size);
        }
        return;
    }
    let sizes = digit.distribute_parallel(items, scratch);
    let mut octants: Vec<_> =
        split(items, &sizes).into_iter().zip(split(scratch, &sizes)).collect();
    parallel::for_each_piece(&mut octants, 1, &|_, octant| {
        let (items, scratch) = &mut octant[0];
        sort(items, scratch, leaf_size);
    });
}

/// So few items are sorted by comparison.
const SMALL: usize = 48;

/// Items per task: they and their copy fit the cache.
const CHUNK: usize = 1 << 15;

/// The most octree levels in one digit: its counters fit the nearest cache.
const DIGIT_LEVELS: u32 = 4;

/// Some bits of a key, whole octree levels of them.
#[derive(Clone, Copy)]
struct Digit {
    shift: u32,
    bits: u32,
}

impl Digit {
    /// The highest levels in which keys differ, so many that octants of about `leaf_size` items
    /// remain; none if all keys are equal.
    fn leading(items: &[Keyed], leaf_size: usize) -> Option<Self> {
        let first = items[0].key;
        let differing = AtomicU64::new(0);
        parallel::for_each(items.len().div_ceil(CHUNK), &|chunk| {
            let items = items[CHUNK * chunk..].iter().take(CHUNK);
            let own = items.fold(0, |differing, item| differing | (item.key ^ first));
            differing.fetch_or(own, Relaxed);
        });
        let differing = differing.into_inner();
        let levels = (u64::BITS - differing.leading_zeros()).div_ceil(3);
        let wanted = (items.len() / leaf_size.max(1)).ilog2() / 3;
        let taken = wanted.clamp(1, DIGIT_LEVELS).min(levels);
        (levels > 0).then(|| Self { shift: 3 * (levels - taken), bits: 3 * taken })
    }

    fn of(self, item: &Keyed) -> usize {
        (item.key >> self.shift) as usize & ((1 << self.bits) - 1)
    }

    /// Copies `from` to `to` in the order of the digit; how many items each of its values has.
    fn distribute(self, from: &[Keyed], to: &mut [Keyed]) -> Vec<usize> {
        let mut sizes = vec![0; 1 << self.bits];
        for item in from {
            sizes[self.of(item)] += 1;
        }
        let mut next = starts(&sizes);
        for item in from {
            let place = &mut next[self.of(item)];
            to[*place] = *item;
            *place += 1;
        }
        sizes
    }

    /// Sorts `items` by the digit: chunk by chunk into `scratch`, then value by value back.
    fn distribute_parallel(self, items: &mut [Keyed], scratch: &mut [Keyed]) -> Vec<usize> {
        let mut chunk_sizes = vec![Vec::new(); items.len().div_ceil(CHUNK)];
        let mut chunks: Vec<_> =
            scratch.chunks_mut(CHUNK).zip(items.chunks(CHUNK)).zip(&mut chunk_sizes).collect();
        parallel::for_each_piece(&mut chunks, 1, &|_, chunk| {
            let ((to, from), sizes) = &mut chunk[0];
            **sizes = self.distribute(from, to);
        });
        let chunk_starts: Vec<Vec<usize>> = chunk_sizes.iter().map(|sizes| starts(sizes)).collect();
        let mut sizes = vec![0; 1 << self.bits];
        for chunk in &chunk_sizes {
            sizes.iter_mut().zip(chunk).for_each(|(sum, size)| *sum += size);
        }
        let mut places = split(items, &sizes);
        parallel::for_each_piece(&mut places, 1, &|value, place| {
            let mut to = &mut *place[0];
            for (chunk, from) in scratch.chunks(CHUNK).enumerate() {
                let size = chunk_sizes[chunk][value];
                let (head, tail) = to.split_at_mut(size);
                head.copy_from_slice(&from[chunk_starts[chunk][value]..][..size]);
                to = tail;
            }
        });
        sizes
    }
}

/// Where each of consecutive stretches starts.
fn starts(sizes: &[usize]) -> Vec<usize> {
    let mut end = 0;
    let start_of = |&size| {
        let start = end;
        end += size;
        start
    };
    sizes.iter().map(start_of).collect()
}

/// Consecutive stretches of the given sizes.
fn split<'a, V>(mut all: &'a mut [V], sizes: &[usize]) -> Vec<&'a mut [V]> {
    let take = |&size| {
        let (head, tail) = std::mem::take(&mut all).split_at_mut(size);
        all = tail;
        head
    };
    sizes.iter().map(take).collect()
}

/// Moves bit i to bit 3i.
fn spread(x: u64) -> u64 {
    let mut x = x & 0x001f_ffff;
    x = (x | x << 32) & 0x001f_0000_0000_ffff;
    x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_interleave_the_lowest_bits() {
        assert_eq!(morton_key([1, 0, 0]), 1);
        assert_eq!(morton_key([0, 1, 2]), 0b100_010);
        assert_eq!(morton_key([u64::MAX; 3]), u64::MAX >> 1);
        for c in [[0, 1, 2], [77_777, 1 << 20, 3], [1 << 21, 5 << 40 | 1, 1 << 19]] {
            let key = morton_key(c);
            for bit in 0..KEY_LEVELS {
                let triple = [0, 1, 2].map(|axis| key >> (3 * bit + axis) & 1);
                assert_eq!(triple, c.map(|c| c >> bit & 1));
            }
        }
    }

    /// Keys of `bits` significant bits, many of them equal, under a common prefix.
    fn scattered(n: usize, bits: u32) -> Vec<Keyed> {
        let mut state = 1u64;
        let mut next = |index| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            Keyed { key: 1 << 60 | state >> (64 - bits), index }
        };
        (0..n as u32).map(&mut next).collect()
    }

    #[test]
    fn sorting_to_the_last_octant_is_a_stable_sort() {
        for (n, bits) in [(0, 9), (1, 9), (40, 3), (3000, 40), (3 * CHUNK + 7, 11), (2 * CHUNK, 50)]
        {
            let mut items = scattered(n, bits);
            let mut expected = items.clone();
            expected.sort_by_key(|item| (item.key, item.index));
            sort(&mut items, &mut vec![Keyed::default(); n], 1);
            assert_eq!(items, expected, "{n} items of {bits} bits");
        }
    }

    #[test]
    fn octants_larger_than_a_leaf_are_sorted_by_their_children() {
        let leaf_size = 50;
        let mut items = scattered(2 * CHUNK, 30);
        let n = items.len();
        sort(&mut items, &mut vec![Keyed::default(); n], leaf_size);
        for level in 1..10 {
            let shift = 30 - 3 * level;
            for octant in items.chunk_by(|a, b| a.key >> (shift + 3) == b.key >> (shift + 3)) {
                let sorted = octant.is_sorted_by_key(|item| item.key >> shift);
                assert!(sorted || octant.len() <= leaf_size, "level {level}");
                let stable = octant.is_sorted_by_key(|item| item.index);
                assert!(sorted || stable || octant.len() > leaf_size, "level {level}");
            }
        }
    }
}
