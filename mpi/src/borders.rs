//! Where the curve is cut: at leaves of the one tree that all points make.

use std::ops::Range;

use crate::collective::{combine, sum};
use crate::error::Error;
use crate::key::{Key, first_of, last_of};
use crate::transport::Transport;

/// The most points on all ranks together: as many as the engine numbers.
const MOST_POINTS: u64 = u32::MAX as u64 / 2;

/// Which points each rank has, and the cells of which several ranks have some.
#[derive(Clone, Debug)]
pub(crate) struct Borders {
    /// The first place of each rank among all points; one more entry ends the last.
    places: Vec<u32>,
    /// The first key of each rank but the first: that of a leaf.
    pub(crate) firsts: Vec<Key>,
    /// For each of these, the places of the cells that hold it, level by level from the root to the leaf.
    above: Vec<Vec<Range<u32>>>,
}

impl Borders {
    /// Moves each cut down to the border of the leaf that holds it. `sorted` are the keys of this rank's points, ascending;
    /// no two that differ are the same on the first `levels` levels. Each rank sends O(P) words.
    pub(crate) fn new(
        ranks: &dyn Transport,
        sorted: &[Key],
        cuts: &[Key],
        leaf_size: usize,
        levels: usize,
    ) -> Result<Self, Error> {
        let total = sum(ranks, sorted.len() as u64)?;
        if total > MOST_POINTS {
            let (limit, found) = (MOST_POINTS as usize, total as usize);
            return Err(Error::TooManyPoints { limit, found });
        }
        let mut counts = Vec::new();
        for &cut in cuts {
            for level in 0..=levels {
                let (first, last) = (first_of(cut, level), last_of(cut, level));
                counts.push(sorted.partition_point(|key| *key < first) as u64);
                counts.push(sorted.partition_point(|key| *key <= last) as u64);
            }
        }
        let counts = combine(ranks, &counts, u64::wrapping_add)?;
        let (mut places, mut firsts, mut above) = (vec![0], Vec::new(), Vec::new());
        for (&cut, counts) in cuts.iter().zip(counts.chunks(2 * (levels + 1))) {
            let mut cells: Vec<Range<u32>> =
                counts.as_chunks::<2>().0.iter().map(|c| c[0] as u32..c[1] as u32).collect();
            // Points with one key are not divided.
            let same = cells[levels].len();
            let is_leaf = |cell: &Range<u32>| cell.len() <= leaf_size || cell.len() == same;
            let leaf = cells.iter().position(is_leaf).unwrap_or(levels);
            cells.truncate(leaf + 1);
            places.push(cells[leaf].start);
            firsts.push(first_of(cut, leaf));
            above.push(cells);
        }
        places.push(total as u32);
        Ok(Self { places, firsts, above })
    }

    /// How many points there are on all ranks together.
    pub(crate) fn total(&self) -> u32 {
        self.places[self.places.len() - 1]
    }

    /// The places of a rank's points.
    pub(crate) fn of(&self, rank: usize) -> Range<u32> {
        self.places[rank]..self.places[rank + 1]
    }

    /// The rank that has a place.
    pub(crate) fn owner(&self, place: u32) -> usize {
        let ranks = self.places.len() - 1;
        self.places[1..ranks].partition_point(|first| *first <= place)
    }

    /// The places of the cell of a level that begins at a key, if `rank` and others have points of it.
    pub(crate) fn shared(&self, rank: usize, level: usize, key: Key) -> Option<Range<u32>> {
        let own = self.of(rank);
        let cuts = [rank.checked_sub(1), Some(rank)].into_iter().flatten();
        cuts.filter(|&cut| cut < self.firsts.len()).find_map(|cut| {
            let cell = self.above[cut].get(level)?;
            let holds = first_of(self.firsts[cut], level) == key;
            let is_whole = own.start <= cell.start && cell.end <= own.end;
            (holds && !is_whole).then(|| cell.clone())
        })
    }
}
