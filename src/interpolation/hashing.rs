//! Hashes that are the same in every process.

use std::hash::Hasher;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use crate::numbers::traits::{Real, Scalar};

/// A hash of numbers that does not change from one release of the standard library to the next. It tells different inputs
/// apart, not those that someone made to be alike.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct StableHasher {
    mixed: u64,
    count: u64,
}

/// 2⁶⁴ divided by the golden ratio: an odd number without a pattern.
const FACTOR: u64 = 0x9e37_79b9_7f4a_7c15;

/// Another one, so that numbers and how many there are don't cancel.
const COUNT_FACTOR: u64 = 0xd1b5_4a32_d192_ed03;

impl StableHasher {
    /// The hash of everything so far.
    pub(crate) fn value(self) -> u64 {
        // The end of SplitMix64 (Steele, Lea and Flood, 2014): every bit depends on all others.
        let mixed = self.mixed ^ (self.count + 1).wrapping_mul(COUNT_FACTOR);
        let mixed = (mixed ^ mixed >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ mixed >> 31
    }
}

impl Hasher for StableHasher {
    fn write(&mut self, bytes: &[u8]) {
        for chunk in bytes.chunks(8) {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            self.write_u64(u64::from_le_bytes(word));
        }
    }

    fn write_u64(&mut self, word: u64) {
        self.mixed = (self.mixed.rotate_left(23) ^ word).wrapping_mul(FACTOR);
        self.count += 1;
    }

    fn write_u8(&mut self, number: u8) {
        self.write_u64(number.into());
    }

    fn write_i32(&mut self, number: i32) {
        self.write_u64(number as u64);
    }

    fn write_usize(&mut self, number: usize) {
        self.write_u64(number as u64);
    }

    fn finish(&self) -> u64 {
        self.value()
    }
}

/// A hash of the fields of some sources, whatever their order. They may come from several threads.
#[derive(Debug, Default)]
pub(crate) struct Digest(AtomicU64);

/// One of so many sources is taken.
pub(crate) const TAKEN: u64 = 4;

impl Digest {
    /// Whether the field of a source at these coordinates is taken: one of four is, whichever they are.
    pub(crate) fn takes<T: Real>(coordinates: &[T]) -> bool {
        let mut hasher = StableHasher::default();
        coordinates.iter().for_each(|x| hasher.write_u64(x.as_f64().to_bits()));
        hasher.value().is_multiple_of(TAKEN)
    }

    /// Takes the values of one more field.
    pub(crate) fn add<S: Scalar>(&self, numbers: &[S]) {
        let mut hasher = StableHasher::default();
        for number in numbers {
            for part in &number.parts()[..S::PARTS] {
                hasher.write_u64(part.as_f64().to_bits());
            }
        }
        self.0.fetch_add(hasher.value(), Relaxed);
    }

    /// Takes all fields that another one has.
    pub(crate) fn join(&self, other: &Self) {
        self.0.fetch_add(other.value(), Relaxed);
    }

    /// The hash of all fields so far.
    pub(crate) fn value(&self) -> u64 {
        self.0.load(Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::hash::Hash;

    fn hash(value: impl Hash) -> u64 {
        let mut hasher = StableHasher::default();
        value.hash(&mut hasher);
        hasher.value()
    }

    #[test]
    fn hashes_tell_apart_and_stay_what_they_are() {
        let inputs: Vec<Vec<u64>> =
            vec![vec![], vec![0], vec![0, 0], vec![1], vec![0, 1], vec![1, 0]];
        let mut hashes: Vec<u64> = inputs.iter().map(hash).collect();
        assert_eq!(hashes[3], hash(vec![1u64]));
        hashes.sort_unstable();
        hashes.dedup();
        assert_eq!(hashes.len(), inputs.len());
        let sum = |lists: &[&[f64]]| {
            let digest = Digest::default();
            lists.iter().for_each(|list| digest.add(list));
            digest.value()
        };
        assert_eq!(sum(&[&[1.0, 2.0], &[3.0]]), sum(&[&[3.0], &[1.0, 2.0]]));
        assert_ne!(sum(&[&[1.0, 2.0], &[3.0]]), sum(&[&[1.0], &[2.0, 3.0]]));
        let taken = (0..1000).filter(|&i| Digest::takes(&[f64::from(i), 0.5, 0.25])).count();
        assert!((200..300).contains(&taken), "{taken}");
        // Files that earlier versions wrote are found by these.
        assert_eq!(hash(1u64), 0x83c2_0ae7_ffc5_992f);
    }
}
