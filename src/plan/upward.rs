//! Up the source tree: from charges to multipole terms.

use crate::expansion::level_cells::LevelFamilies;
use crate::expansion::{ChargeOf, Expansion, RealOf, SourceOf};
use crate::numbers::traits::Numbers;
use crate::octree::tree::Tree;
use crate::parallel;
use crate::parallel::watch::Watch;

/// Forms the multipole terms of a tree.
pub(crate) struct Upward<'a, E: Expansion> {
    pub(crate) expansion: &'a E,
    pub(crate) tree: &'a Tree<RealOf<E>>,
    /// Of which cells.
    pub(crate) formed: &'a [bool],
    /// Whether parents take their moments from their children.
    pub(crate) shifts_moments: bool,
    pub(crate) watch: &'a Watch,
}

impl<E: Expansion> Upward<'_, E> {
    /// P2M wherever moments are not shifted from children, for points in tree order.
    pub(crate) fn p2m(
        &self,
        sources: &[SourceOf<E>],
        charges: &[ChargeOf<E>],
        multipoles: &mut [Vec<E::MultipoleTerm>],
    ) {
        let tree = self.tree;
        for (level, multipoles) in multipoles.iter_mut().enumerate() {
            let first = tree.shape.level(level).start;
            let len = self.expansion.multipole_len(level);
            parallel::for_each_piece(multipoles, len, &|i, multipole| {
                let (cell, node) = (&tree.cells[first + i], &tree.shape.nodes[first + i]);
                if self.watch.advance(1)
                    || !self.formed[first + i]
                    || (!node.is_leaf() && self.shifts_moments)
                {
                    return;
                }
                multipole.fill(Numbers::zero());
                let points = node.points();
                let (ys, qs) = (&sources[points.clone()], &charges[points]);
                self.expansion.p2m(cell, ys, qs, multipole);
            });
        }
    }

    /// M2M into every cell that has children, from the deepest up.
    pub(crate) fn m2m(&self, multipoles: &mut [Vec<E::MultipoleTerm>]) {
        for level in (1..self.tree.shape.levels()).rev() {
            let (above, below) = multipoles.split_at_mut(level);
            let families = LevelFamilies::new(self.tree, level - 1, self.formed, self.watch);
            let to = &mut above[level - 1];
            let len = self.expansion.multipole_len(level - 1);
            parallel::for_each_piece(to, len, &|p, multipole| {
                if !families.children_of(p).is_empty() {
                    multipole.fill(Numbers::zero());
                }
            });
            self.expansion.m2m_level(&families, &below[0], to);
        }
    }
}
