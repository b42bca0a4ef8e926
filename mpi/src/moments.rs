//! Multipole terms of the cells that have points here: those of whole cells from what is here, those of shared cells from
//! their children, by the rank that has the first point.

use farfield::{Cell, Cube, Expansion, Numbers, Real};

use crate::borders::Borders;
use crate::cells::{OwnCell, find};
use crate::collective::combine;
use crate::key::{child, coordinates, octant};
use crate::transport::{Transport, TransportError};
use crate::words::{next, read, write};

/// Multipole terms, level by level and cell after cell.
pub(crate) type Terms<M> = Vec<Vec<M>>;

/// Which multipole terms go where for the sums over the children of shared cells.
#[derive(Debug)]
pub(crate) struct SharedMoments<T: Real> {
    /// By the level of the children.
    levels: Vec<SharedLevel<T>>,
}

/// The children of one level whose parents are shared.
#[derive(Debug)]
struct SharedLevel<T: Real> {
    /// For each rank, those that are here and whose parents are there: their indices among the cells of their level.
    sent: Vec<Vec<usize>>,
    /// From each rank, those whose parents are here.
    arriving: Vec<Vec<Arriving<T>>>,
}

/// A child whose terms arrive.
#[derive(Clone, Debug)]
struct Arriving<T: Real> {
    child: Cell<T>,
    parent: Cell<T>,
    /// The parent's index among the cells of its level.
    index: usize,
}

impl<T: Real> SharedMoments<T> {
    /// Finds out which rank sums what. Each sends O(1) words for each of its cells with a shared parent.
    pub(crate) fn new(
        ranks: &dyn Transport,
        root: &Cube<T>,
        cells: &[OwnCell],
        borders: &Borders,
    ) -> Result<Self, TransportError> {
        let own = borders.of(ranks.rank());
        let starts = level_starts(cells);
        let deepest = combine(ranks, &[starts.len() as u64], u64::max)?[0] as usize;
        let nothing = |_| SharedLevel {
            sent: vec![Vec::new(); ranks.size()],
            arriving: vec![Vec::new(); ranks.size()],
        };
        let mut levels: Vec<SharedLevel<T>> = (0..deepest).map(nothing).collect();
        let mut messages = vec![Vec::new(); ranks.size()];
        for (index, cell) in cells.iter().enumerate() {
            let parent = &cells[cell.parent];
            if cell.level > 0 && own.start <= cell.places.start && parent.is_shared {
                let to = borders.owner(parent.places.start);
                levels[cell.level].sent[to].push(index - starts[cell.level]);
                let octant = octant(cell.key, cell.level);
                messages[to].extend([parent.level as u64, parent.places.start.into(), octant]);
            }
        }
        for (from, words) in ranks.exchange(messages)?.iter().enumerate() {
            for &[level, first, octant] in words.as_chunks::<3>().0 {
                let (level, first) = (level as usize, first as u32);
                let Some(index) = find(cells, level, first) else { continue };
                let key = cells[index].key;
                let parent = Cell::new(root, level, coordinates(key, level));
                let key = child(key, level + 1, octant);
                let child = Cell::new(root, level + 1, coordinates(key, level + 1));
                let index = index - starts[level];
                levels[level + 1].arriving[from].push(Arriving { child, parent, index });
            }
        }
        Ok(Self { levels })
    }

    /// Adds the terms of children to those of the shared cells whose first points are here, from the deepest level up to
    /// `coarsest`. Children come in the order of the curve, wherever they are.
    pub(crate) fn add<E: Expansion>(
        &self,
        ranks: &dyn Transport,
        expansion: &E,
        coarsest: usize,
        terms: &mut Terms<E::MultipoleTerm>,
    ) -> Result<(), TransportError>
    where
        E::Kernel: farfield::Kernel<Real = T>,
    {
        for level in (coarsest.saturating_add(1)..self.levels.len()).rev() {
            let SharedLevel { sent, arriving } = &self.levels[level];
            let len = expansion.multipole_len(level);
            let message = |sent: &Vec<usize>| {
                let mut words = Vec::new();
                for &index in sent {
                    write(&terms[level][index * len..][..len], &mut words);
                }
                words
            };
            let messages = ranks.exchange(sent.iter().map(message).collect())?;
            let parent_len = expansion.multipole_len(level - 1);
            for (arriving, words) in arriving.iter().zip(&messages) {
                let mut words = words.iter();
                for Arriving { child, parent, index } in arriving {
                    let from: Vec<E::MultipoleTerm> = read(len, &mut words);
                    let to = &mut terms[level - 1][index * parent_len..][..parent_len];
                    expansion.m2m(child, parent, &from, to);
                }
            }
        }
        Ok(())
    }
}

/// Where the cells of each level begin.
pub(crate) fn level_starts(cells: &[OwnCell]) -> Vec<usize> {
    let levels = cells.last().map_or(0, |cell| cell.level + 1);
    (0..levels).map(|level| cells.partition_point(|cell| cell.level < level)).collect()
}

/// A number for each level that none of its multipole terms is larger than, on any rank.
pub(crate) fn largest<M: Numbers>(
    ranks: &dyn Transport,
    terms: &[Vec<M>],
    levels: usize,
) -> Result<Vec<f64>, TransportError> {
    let largest = |terms: &Vec<M>| {
        let numbers = terms.iter().flat_map(|term| (0..term.count()).map(|i| term.number(i)));
        numbers.fold(0.0f64, |largest, number| largest.max(number.as_f64().abs())).to_bits()
    };
    let mut own: Vec<u64> = terms.iter().map(largest).collect();
    own.resize(levels, 0);
    // The order of numbers that are not negative is that of their bits.
    Ok(combine(ranks, &own, u64::max)?.into_iter().map(f64::from_bits).collect())
}

/// Who needs which multipole terms of whom.
#[derive(Debug)]
pub(crate) struct Served {
    /// For each rank, the cells that are here whose terms it needs: levels, and indices among the cells of those.
    cells: Vec<Vec<(usize, usize)>>,
    /// For each cell that is needed here, its level and the rank that has its terms.
    needed: Vec<(usize, usize)>,
}

impl Served {
    /// Asks for the terms of cells, which are told by their levels and first places.
    pub(crate) fn new(
        ranks: &dyn Transport,
        needed: &[(usize, u32)],
        cells: &[OwnCell],
        borders: &Borders,
    ) -> Result<Self, TransportError> {
        let mut requests = vec![Vec::new(); ranks.size()];
        let mut owners = Vec::new();
        for &(level, first) in needed {
            let owner = borders.owner(first);
            requests[owner].extend([level as u64, first.into()]);
            owners.push((level, owner));
        }
        let starts = level_starts(cells);
        let served = |words: Vec<u64>| {
            let mut words = words.iter();
            let mut served = Vec::new();
            while words.len() > 0 {
                let (level, first) = (next(&mut words) as usize, next(&mut words) as u32);
                let index = find(cells, level, first);
                served.extend(index.map(|index| (level, index - starts[level])));
            }
            served
        };
        let cells = ranks.exchange(requests)?.into_iter().map(served).collect();
        Ok(Self { cells, needed: owners })
    }

    /// How many cells are needed of other ranks.
    pub(crate) fn needed_of_others(&self, rank: usize) -> usize {
        self.needed.iter().filter(|(_, owner)| *owner != rank).count()
    }

    /// Appends the terms that others need to messages for them.
    pub(crate) fn send<E: Expansion>(
        &self,
        expansion: &E,
        terms: &Terms<E::MultipoleTerm>,
        messages: &mut [Vec<u64>],
    ) {
        for (cells, words) in self.cells.iter().zip(messages) {
            for &(level, index) in cells {
                let len = expansion.multipole_len(level);
                write(&terms[level][index * len..][..len], words);
            }
        }
    }

    /// Takes the terms that are needed here from the front of messages.
    pub(crate) fn receive<E: Expansion>(
        &self,
        expansion: &E,
        messages: &mut [std::slice::Iter<'_, u64>],
    ) -> Vec<E::MultipoleTerm> {
        let terms = |&(level, owner): &(usize, usize)| {
            read::<E::MultipoleTerm>(expansion.multipole_len(level), &mut messages[owner])
        };
        self.needed.iter().flat_map(terms).collect()
    }
}
