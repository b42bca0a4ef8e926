//! What the targets of this rank need of all sources: cells, opened level by level where their owners have them.

use std::collections::BTreeMap;
use std::ops::Range;

use farfield::{Admissibility, Cube, PartCell, PartLists, Real};

use crate::borders::Borders;
use crate::cells::{OwnCell, find, octant_of};
use crate::collective::{agree, any};
use crate::error::Error;
use crate::key::{Key, child, coordinates};
use crate::transport::{Transport, TransportError};
use crate::words::next;

/// The children of cells that several ranks have points of, each known to the rank that has the cell's first point.
pub(crate) type SharedChildren = BTreeMap<(usize, u32), Vec<Child>>;

/// A cell as its parent knows it.
#[derive(Clone, Debug)]
pub(crate) struct Child {
    octant: u64,
    places: Range<u32>,
    is_leaf: bool,
}

impl Child {
    fn of(cell: &OwnCell) -> Self {
        Self { octant: octant_of(cell), places: cell.places.clone(), is_leaf: cell.is_leaf }
    }

    fn write(&self, words: &mut Vec<u64>) {
        let Range { start, end } = self.places;
        words.extend([self.octant | u64::from(self.is_leaf) << 3, start.into(), end.into()]);
    }

    fn read(words: &mut std::slice::Iter<'_, u64>) -> Self {
        let octant = next(words);
        let places = next(words) as u32..next(words) as u32;
        Self { octant: octant & 7, places, is_leaf: octant >> 3 == 1 }
    }
}

/// Tells the owners of shared cells of their children. O(P) words for each level on all ranks together.
pub(crate) fn shared_children(
    ranks: &dyn Transport,
    cells: &[OwnCell],
    borders: &Borders,
) -> Result<SharedChildren, TransportError> {
    let mut messages = vec![Vec::new(); ranks.size()];
    let own = borders.of(ranks.rank());
    for cell in cells.iter().filter(|cell| cell.level > 0 && own.start <= cell.places.start) {
        let parent = &cells[cell.parent];
        if parent.is_shared {
            let words = &mut messages[borders.owner(parent.places.start)];
            words.extend([parent.level as u64, parent.places.start.into()]);
            Child::of(cell).write(words);
        }
    }
    let mut children = SharedChildren::new();
    // Ranks have places in their order, and so have children.
    for words in ranks.exchange(messages)? {
        let mut words = words.iter();
        while words.len() > 0 {
            let parent = (next(&mut words) as usize, next(&mut words) as u32);
            children.entry(parent).or_default().push(Child::read(&mut words));
        }
    }
    Ok(children)
}

/// A cell of sources that this rank knows of.
#[derive(Clone, Debug)]
struct Known {
    key: Key,
    last: u32,
    is_closed: bool,
}

/// The cells of sources that this rank knows of, by their levels and their first places.
#[derive(Debug)]
pub(crate) struct KnownCells(BTreeMap<(usize, u32), Known>);

impl KnownCells {
    /// The root alone.
    pub(crate) fn new(
        ranks: &dyn Transport,
        cells: &[OwnCell],
        borders: &Borders,
    ) -> Result<Self, TransportError> {
        let is_leaf = any(ranks, cells.first().is_some_and(|root| root.is_leaf))?;
        let root = Known { key: Key::default(), last: borders.total(), is_closed: !is_leaf };
        Ok(Self((borders.total() > 0).then_some(((0, 0), root)).into_iter().collect()))
    }

    /// The lists of this rank's targets. As long as any rank wants children that it doesn't know, all of them ask: for one
    /// more level each time.
    pub(crate) fn lists<T: Real>(
        &mut self,
        ranks: &dyn Transport,
        root: Cube<T>,
        targets: &[PartCell],
        owned: (&[OwnCell], &Borders, &SharedChildren),
        admissibility: &Admissibility,
    ) -> Result<PartLists<T>, Error> {
        loop {
            let sources: Vec<PartCell> = self.0.iter().map(part).collect();
            let lists = agree(ranks, PartLists::new(root, targets, &sources, admissibility))?;
            if !any(ranks, !lists.wanted().is_empty())? {
                return Ok(lists);
            }
            let ids: Vec<(usize, u32)> = self.0.keys().copied().collect();
            let wanted: Vec<_> = lists.wanted().iter().map(|&s| ids[s as usize]).collect();
            self.open(ranks, &wanted, owned)?;
        }
    }

    /// The level and the first place of the cell with an index.
    pub(crate) fn ids(&self) -> Vec<(usize, u32)> {
        self.0.keys().copied().collect()
    }

    /// Adds the children of these cells.
    fn open(
        &mut self,
        ranks: &dyn Transport,
        wanted: &[(usize, u32)],
        (cells, borders, shared): (&[OwnCell], &Borders, &SharedChildren),
    ) -> Result<(), TransportError> {
        let mut requests = vec![Vec::new(); ranks.size()];
        for &(level, first) in wanted {
            requests[borders.owner(first)].extend([level as u64, u64::from(first)]);
        }
        let answer = |words: &Vec<u64>| {
            let mut answer = Vec::new();
            for request in words.as_chunks::<2>().0 {
                let (level, first) = (request[0] as usize, request[1] as u32);
                let own = children(cells, level, first);
                let children = shared.get(&(level, first)).unwrap_or(&own);
                answer.push(children.len() as u64);
                children.iter().for_each(|child| child.write(&mut answer));
            }
            answer
        };
        let answers = ranks.exchange(ranks.exchange(requests)?.iter().map(answer).collect())?;
        let mut answers: Vec<_> = answers.iter().map(|words| words.iter()).collect();
        for &(level, first) in wanted {
            let words = &mut answers[borders.owner(first)];
            let count = next(words);
            let children: Vec<Child> = (0..count).map(|_| Child::read(words)).collect();
            let Some(parent) = self.0.get_mut(&(level, first)) else { continue };
            parent.is_closed = false;
            let key = parent.key;
            for Child { octant, places, is_leaf } in children {
                let key = child(key, level + 1, octant);
                let known = Known { key, last: places.end, is_closed: !is_leaf };
                self.0.insert((level + 1, places.start), known);
            }
        }
        Ok(())
    }
}

/// The children of a cell all of whose points this rank has.
fn children(cells: &[OwnCell], level: usize, first: u32) -> Vec<Child> {
    let Some(parent) = find(cells, level, first) else { return Vec::new() };
    let last = cells[parent].places.end;
    let from = cells.partition_point(|c| (c.level, c.places.start) < (level + 1, first));
    let inside = |cell: &&OwnCell| cell.level == level + 1 && cell.places.start < last;
    cells[from..].iter().take_while(inside).map(Child::of).collect()
}

/// A known cell as the engine takes it.
fn part((&(level, first), cell): (&(usize, u32), &Known)) -> PartCell {
    PartCell {
        level,
        coordinates: coordinates(cell.key, level),
        points: first..cell.last,
        count: cell.last - first,
        closed: cell.is_closed,
    }
}
