//! The cells of a level, as operators for whole levels see them.

use std::ops::Range;

use crate::numbers::traits::Real;
use crate::octree::geometry::Cell;
use crate::octree::shape::Node;
use crate::octree::tree::Tree;
use crate::parallel;
use crate::parallel::watch::Watch;

/// The cells of one level and their children, between which expansions are shifted.
#[derive(Clone, Copy, Debug)]
pub struct LevelFamilies<'a, T: Real> {
    /// The level of the parents.
    pub level: usize,
    /// The cells of that level.
    pub parents: &'a [Cell<T>],
    /// The cells of the next.
    pub children: &'a [Cell<T>],
    /// The tree's nodes, and the index of `parents[0]` and of `children[0]` among them.
    pub(crate) nodes: &'a [Node],
    pub(crate) first_parent: usize,
    pub(crate) first_child: usize,
    /// For every node, whether it has the expansion.
    pub(crate) expanded: &'a [bool],
    pub(crate) watch: &'a Watch,
}

impl<'a, T: Real> LevelFamilies<'a, T> {
    /// The cells of `level` and of the next; `expanded` says for every cell of the tree whether it has an
    /// expansion.
    pub(crate) fn new(
        tree: &'a Tree<T>,
        level: usize,
        expanded: &'a [bool],
        watch: &'a Watch,
    ) -> Self {
        let [parents, children] = [tree.shape.level(level), tree.shape.level(level + 1)];
        Self {
            level,
            parents: &tree.cells[parents.clone()],
            children: &tree.cells[children.clone()],
            nodes: &tree.shape.nodes,
            first_parent: parents.start,
            first_child: children.start,
            expanded,
            watch,
        }
    }

    /// Indices into `children` of the cells that `parents[p]` exchanges terms with: none if it has no
    /// children or no expansion.
    pub fn children_of(&self, p: usize) -> Range<usize> {
        let p = self.first_parent + p;
        let children = self.nodes[p].children();
        if self.expanded[p] && !children.is_empty() {
            children.start - self.first_child..children.end - self.first_child
        } else {
            0..0
        }
    }

    /// The index into `parents` of the cell that `children[c]` exchanges terms with, if that has an
    /// expansion.
    pub fn parent_of(&self, c: usize) -> Option<usize> {
        let p = self.nodes[self.first_child + c].parent as usize;
        self.expanded[p].then(|| p - self.first_parent)
    }

    /// Whether the application shall end: whoever shifts many cells looks here now and then.
    pub fn is_stopped(&self) -> bool {
        self.watch.is_stopped()
    }

    /// Calls `visit(p, c, terms of p)` for all children of each parent in order: parents in parallel.
    pub fn for_each_parent<M: Send>(
        &self,
        multipoles: &mut [M],
        visit: impl Fn(usize, usize, &mut [M]) + Sync,
    ) {
        let len = multipoles.len() / self.parents.len().max(1);
        parallel::for_each_piece(multipoles, len, &|p, multipole| {
            if !self.is_stopped() {
                self.children_of(p).for_each(|c| visit(p, c, multipole));
            }
        });
    }

    /// Calls `visit(p, c, terms of c)` for each child in parallel.
    pub fn for_each_child<L: Send>(
        &self,
        locals: &mut [L],
        visit: impl Fn(usize, usize, &mut [L]) + Sync,
    ) {
        let len = locals.len() / self.children.len().max(1);
        parallel::for_each_piece(locals, len, &|c, local| {
            if let Some(p) = self.parent_of(c).filter(|_| !self.is_stopped()) {
                visit(p, c, local);
            }
        });
    }
}

/// The M2L pairs of one level: for each target cell, the source cells that act on it.
#[derive(Clone, Copy, Debug)]
pub struct LevelPairs<'a, T: Real> {
    /// The level.
    pub level: usize,
    /// The factor that all its translations are taken by: what a [mask](crate::Coverage::Eighths) says.
    /// 1 for expansions that don't [weigh](crate::Costs::weighs).
    pub weight: f64,
    /// Its source cells.
    pub sources: &'a [Cell<T>],
    /// Its target cells.
    pub targets: &'a [Cell<T>],
    /// For each target cell, where its list starts in `list`; one more entry ends the last.
    pub(crate) starts: &'a [usize],
    /// The lists of all levels, as indices into the tree.
    pub(crate) list: &'a [u32],
    /// The tree's index of `sources[0]`.
    pub(crate) first_source: usize,
    /// A number that no multipole term of the level is larger than, those of cells that are elsewhere; 0 if all are here.
    pub(crate) largest_elsewhere: f64,
    pub(crate) watch: &'a Watch,
}

impl<T: Real> LevelPairs<'_, T> {
    /// Indices into `sources` of the cells that act on `targets[t]`.
    pub fn sources_of(&self, t: usize) -> impl ExactSizeIterator<Item = usize> {
        let list = &self.list[self.starts[t]..self.starts[t + 1]];
        list.iter().map(|&s| s as usize - self.first_source)
    }

    /// Whether the application shall end: whoever translates many cells looks here now and then.
    pub fn is_stopped(&self) -> bool {
        self.watch.is_stopped()
    }

    /// Calls `visit(s, t, terms of t)` for every pair: target cells in parallel, the sources of each in
    /// order.
    pub fn for_each_pair<L: Send>(
        &self,
        locals: &mut [L],
        visit: impl Fn(usize, usize, &mut [L]) + Sync,
    ) {
        let len = locals.len() / self.targets.len().max(1);
        parallel::for_each_piece(locals, len, &|t, local| {
            let sources = self.sources_of(t).take_while(|_| !self.is_stopped());
            sources.for_each(|s| visit(s, t, local));
        });
    }
}
