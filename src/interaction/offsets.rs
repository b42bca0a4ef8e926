//! Sets of integer offsets between cells.

/// Offsets of at most this many cells along each axis have a bit each: all that occur unmasked.
const REACH: i32 = 3;
/// Offsets of one axis that have a bit.
const SIDE: i32 = 2 * REACH + 1;
/// Words of bits.
const WORDS: usize = (SIDE * SIDE * SIDE) as usize / 64 + 1;

/// A set of offsets: a bit for each near one, a list of the others.
#[derive(Clone, Debug, Default)]
pub(crate) struct OffsetSet {
    near: [u64; WORDS],
    far: Vec<[i32; 3]>,
    /// How long `far` was without repetitions, when they were last removed.
    distinct: usize,
}

impl OffsetSet {
    /// Adds an offset.
    pub(crate) fn insert(&mut self, offset: [i32; 3]) {
        let [x, y, z] = offset.map(|o| o.wrapping_add(REACH) as u32);
        let side = SIDE as u32;
        if x < side && y < side && z < side {
            let bit = (x * side + y) * side + z;
            self.near[bit as usize / 64] |= 1 << (bit % 64);
        } else {
            self.far.push(offset);
            if self.far.len() > 2 * self.distinct + 64 {
                self.far.sort_unstable();
                self.far.dedup();
                self.distinct = self.far.len();
            }
        }
    }

    /// The offsets that are in any of `sets`, once each, in ascending order.
    pub(crate) fn ascending<'a>(sets: impl Iterator<Item = &'a Self>) -> Vec<[i32; 3]> {
        let mut near = [0; WORDS];
        let mut offsets = Vec::new();
        for set in sets {
            near.iter_mut().zip(set.near).for_each(|(word, other)| *word |= other);
            offsets.extend(&set.far);
        }
        for bit in (0..SIDE * SIDE * SIDE).filter(|&b| near[b as usize / 64] >> (b % 64) & 1 == 1) {
            offsets.push([bit / (SIDE * SIDE), bit / SIDE % SIDE, bit % SIDE].map(|o| o - REACH));
        }
        offsets.sort_unstable();
        offsets.dedup();
        offsets
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_and_far_offsets_come_out_once_and_in_order() {
        let mut sets = [OffsetSet::default(), OffsetSet::default()];
        let mut expected = std::collections::BTreeSet::new();
        for i in 0..4000 {
            let offset = [i % 9 - 4, i / 9 % 11 - 5, i32::MAX * (i / 99 % 3 - 1)];
            sets[i as usize % 2].insert(offset);
            expected.insert(offset);
        }
        let near = [[3, -3, 3], [-3, -3, -3], [0, 0, 2]];
        near.iter().for_each(|&offset| sets[1].insert(offset));
        expected.extend(near);
        assert!(sets.iter().all(|set| set.far.len() < 2 * expected.len() + 64), "repetitions go");
        assert!(OffsetSet::ascending(sets.iter()).into_iter().eq(expected));
    }
}
