//! What all ranks decide alike: lists, levels, and what the expansion is prepared for.

use farfield::{
    Admissibility, Cell, Coverage, Cube, Expansion, Geometry, Kernel, Level, MAX_LEVEL, PartCell,
    PartLists, Point, Real,
};

use crate::collective::{agree, combine};
use crate::error::Error;
use crate::needed::{KnownCells, SharedChildren};
use crate::points::Layout;
use crate::transport::Transport;

/// The parts of one sum that lists are found from.
pub(crate) struct Whole<'a, T: Real> {
    pub(crate) ranks: &'a dyn Transport,
    pub(crate) root: Cube<T>,
    pub(crate) known: KnownCells,
    pub(crate) sources: &'a Layout,
    pub(crate) targets: &'a Layout,
    pub(crate) shared_children: SharedChildren,
    pub(crate) target_cells: Vec<PartCell>,
}

/// Bits for the offsets of an unmasked tree, up to three cells along each axis.
const OFFSET_WORDS: usize = 6;
const SIDE: i32 = 7;
/// Levels of a tree, at most.
const LEVELS: usize = MAX_LEVEL + 1;

impl<T: Real> Whole<'_, T> {
    /// The lists of this rank, and the levels of all ranks, for which the expansion is prepared then.
    pub(crate) fn prepare<E: Expansion>(
        &mut self,
        expansion: &mut E,
        (sources, targets): (Vec<Point<T>>, Vec<Point<T>>),
    ) -> Result<(PartLists<T>, Vec<Level<T>>), Error>
    where
        E::Kernel: Kernel<Real = T>,
    {
        let mut admissibility = Admissibility::default();
        loop {
            let lists = self.lists(&admissibility)?;
            let levels = self.levels(&lists)?;
            let mut geometry = Geometry::new(self.root, levels.clone());
            let costs = expansion.costs(2);
            geometry.pair_seconds = expansion.kernel().pair_seconds(costs.pair_tolerance);
            (geometry.sources, geometry.targets) = (sources.clone(), targets.clone());
            geometry.admissibility = admissibility.clone();
            agree(self.ranks, expansion.prepare(&geometry))?;
            let announced = || levels.iter().map(|level| level.level);
            let admits = |level, offset| expansion.admits(level, offset);
            if admissibility.with(announced(), admits) == admissibility {
                return Ok((lists, levels));
            }
            // What can't be tried is not trusted: whole levels are summed directly.
            admissibility = admissibility.with(announced(), |_, _| Coverage::Partial);
        }
    }

    /// The lists of this rank, without what next to nothing of all sums comes through.
    fn lists(&mut self, admissibility: &Admissibility) -> Result<PartLists<T>, Error> {
        let Layout { cells, borders, .. } = self.sources;
        let owned = (&cells[..], borders, &self.shared_children);
        let mut lists =
            self.known.lists(self.ranks, self.root, &self.target_cells, owned, admissibility)?;
        let (near, mut by_level) = lists.pairs_of_points();
        by_level.resize(LEVELS, 0);
        by_level.push(near);
        let mut all = combine(self.ranks, &by_level, u64::saturating_add)?;
        let near = all.pop().unwrap_or_default();
        lists.sum_few_directly(near, &all);
        Ok(lists)
    }

    /// The levels at which any rank needs expansions, with the offsets and pairs of all.
    fn levels(&self, lists: &PartLists<T>) -> Result<Vec<Level<T>>, Error> {
        let own = lists.levels();
        let deepest =
            [self.sources, self.targets].map(|set| set.cells.last().map_or(0, |c| c.level));
        let coarsest = own.first().map_or(LEVELS, |level| level.level);
        let extremes = [(LEVELS - coarsest) as u64, deepest[0].max(deepest[1]) as u64];
        let extremes = combine(self.ranks, &extremes, u64::max)?;
        let (coarsest, deepest) = (LEVELS - extremes[0] as usize, extremes[1] as usize);

        let mut offsets = vec![0u64; LEVELS * OFFSET_WORDS];
        for level in &own {
            for offset in &level.offsets {
                let bit = offset.iter().fold(0, |bit, o| bit * SIDE + o + SIDE / 2) as usize;
                offsets[level.level * OFFSET_WORDS + bit / 64] |= 1 << (bit % 64);
            }
        }
        let offsets = combine(self.ranks, &offsets, |a, b| a | b)?;
        let mut pairs = vec![0u64; LEVELS];
        let first = self.targets.borders.of(self.ranks.rank()).start;
        for (index, cell) in self.targets.cells.iter().enumerate() {
            // Shared cells count where they begin.
            if first <= cell.places.start {
                pairs[cell.level] += lists.m2l_pairs(index) as u64;
            }
        }
        let pairs = combine(self.ranks, &pairs, u64::wrapping_add)?;
        let level = |level: usize| {
            let bits = &offsets[level * OFFSET_WORDS..][..OFFSET_WORDS];
            let is_set = |bit: &i32| bits[*bit as usize / 64] >> (bit % 64) & 1 == 1;
            let offset = |bit: i32| [bit / (SIDE * SIDE), bit / SIDE % SIDE, bit % SIDE];
            let offset = |bit: i32| offset(bit).map(|o| o - SIDE / 2);
            let offsets = (0..SIDE.pow(3)).filter(is_set).map(offset).collect();
            let half_width = Cell::new(&self.root, level, [0; 3]).half_width();
            let mut whole = Level::new(level, half_width, offsets);
            whole.pairs = pairs[level] as usize;
            whole
        };
        Ok((coarsest..deepest + 1).map(level).collect())
    }
}
