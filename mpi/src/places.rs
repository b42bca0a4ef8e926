//! What stands at places of other ranks: points once, charges at every application.

use std::ops::Range;

use farfield::Numbers;

use crate::borders::Borders;
use crate::transport::{Transport, TransportError};
use crate::words::{read, write};

/// Who needs what stands at which places of whom.
#[derive(Debug)]
pub(crate) struct ServedPlaces {
    /// For each rank, the places here that it needs, counted from the first of this rank.
    served: Vec<Vec<Range<u32>>>,
    /// From each rank, how many places are needed here.
    counts: Vec<usize>,
}

impl ServedPlaces {
    /// Asks for places, ascending, whosever they are.
    pub(crate) fn new(
        ranks: &dyn Transport,
        needed: &[Range<u32>],
        borders: &Borders,
    ) -> Result<Self, TransportError> {
        let mut requests = vec![Vec::new(); ranks.size()];
        let mut counts = vec![0; ranks.size()];
        for range in needed {
            let mut start = range.start;
            while start < range.end {
                let owner = borders.owner(start);
                let theirs = borders.of(owner);
                let end = range.end.min(theirs.end);
                let from_first = [start - theirs.start, end - theirs.start];
                requests[owner].extend(from_first.map(u64::from));
                counts[owner] += (end - start) as usize;
                start = end;
            }
        }
        let ranges = |words: Vec<u64>| {
            words.as_chunks::<2>().0.iter().map(|&[start, end]| start as u32..end as u32).collect()
        };
        let served = ranks.exchange(requests)?.into_iter().map(ranges).collect();
        Ok(Self { served, counts })
    }

    /// How many places are needed of other ranks.
    pub(crate) fn needed_of_others(&self, rank: usize) -> usize {
        self.counts.iter().sum::<usize>() - self.counts[rank]
    }

    /// Appends what others need to messages for them; `items` are those of this rank.
    pub(crate) fn send<V: Numbers>(&self, items: &[V], messages: &mut [Vec<u64>]) {
        for (ranges, words) in self.served.iter().zip(messages) {
            for range in ranges {
                write(&items[range.start as usize..range.end as usize], words);
            }
        }
    }

    /// Takes what is needed here from the front of messages, in the order of places.
    pub(crate) fn receive<V: Numbers>(&self, messages: &mut [std::slice::Iter<'_, u64>]) -> Vec<V> {
        let counts = self.counts.iter().zip(messages);
        counts.flat_map(|(&count, words)| read::<V>(count, words)).collect()
    }
}
