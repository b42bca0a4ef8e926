//! Expansions: how a kernel's far field is carried from cell to cell.

pub(crate) mod costs;

use std::ops::Range;

use crate::error::Error;
use crate::expansion::costs::Costs;
use crate::kernel::traits::{Kernel, Outcome};
use crate::numbers::traits::{Numbers, Point, Real};
use crate::octree::geometry::{Cell, Cube};
use crate::octree::shape::Node;
use crate::octree::tree::Tree;
use crate::parallel;

/// A kernel's far field in five operators.
///
/// | operator | from | to |
/// |---|---|---|
/// | [`p2m`](Self::p2m) | sources in a cell | multipole terms of the cell |
/// | [`m2m`](Self::m2m) | multipole terms of a child | those of its parent |
/// | [`m2l`](Self::m2l) | multipole terms of a source cell | local terms of a target cell of the same level |
/// | [`l2l`](Self::l2l) | local terms of a parent | those of its child |
/// | [`l2p`](Self::l2p) | local terms of a cell | values at the targets in it |
///
/// Every operator *adds* to its last argument and is linear in the one it reads. The engine calls
/// `m2l`, `m2p` and `p2l` only between cells that are well separated, which with a
/// [mask](crate::Mask) may be any number of cells apart, not just the 316 offsets of an
/// unmasked tree. Cells give [normalised](Cell::normalised) coordinates: expansions work in
/// those, so that no power of a length in scene units is ever formed.
///
/// [`conformance::check`](crate::conformance::check) tells whether an implementation obeys.
pub trait Expansion: Send + Sync {
    /// The kernel expanded.
    type Kernel: Kernel;
    /// One multipole term.
    type MultipoleTerm: Numbers;
    /// One local term.
    type LocalTerm: Numbers;

    /// The kernel expanded.
    fn kernel(&self) -> &Self::Kernel;

    /// How many multipole terms a cell of `level` has.
    fn multipole_len(&self, level: usize) -> usize;

    /// How many local terms a cell of `level` has.
    fn local_len(&self, level: usize) -> usize;

    /// Called before any operator, with what will be asked for: the place to choose orders and to
    /// precompute translation operators for the levels and offsets that occur, and for no others.
    /// Called again if another [scheme](crate::Builder::scheme) turns out to be cheaper: with no levels
    /// for direct sums.
    /// Operators must also work at levels and offsets that were not announced.
    ///
    /// # Errors
    /// If the accuracy asked for can't be reached on this geometry.
    fn prepare(&mut self, _plan: &Geometry<RealOf<Self>>) -> Result<(), Error> {
        Ok(())
    }

    /// What the operators cost at cells of `level`, and how exact pairs have to be. Also asked before
    /// [`prepare`](Self::prepare), of level 2.
    fn costs(&self, level: usize) -> Costs {
        Costs::new(self.multipole_len(level), self.local_len(level))
    }

    /// Adds the moments of `sources` with `charges` about the centre of `cell`.
    fn p2m(
        &self,
        cell: &Cell<RealOf<Self>>,
        sources: &[SourceOf<Self>],
        charges: &[ChargeOf<Self>],
        multipole: &mut [Self::MultipoleTerm],
    );

    /// Adds the child's moments, shifted to the parent's centre.
    fn m2m(
        &self,
        child: &Cell<RealOf<Self>>,
        parent: &Cell<RealOf<Self>>,
        from: &[Self::MultipoleTerm],
        to: &mut [Self::MultipoleTerm],
    );

    /// Adds the local expansion, about the centre of `target`, of the field of `source`.
    fn m2l(
        &self,
        source: &Cell<RealOf<Self>>,
        target: &Cell<RealOf<Self>>,
        from: &[Self::MultipoleTerm],
        to: &mut [Self::LocalTerm],
    );

    /// Adds the parent's local expansion, shifted to the child's centre.
    fn l2l(
        &self,
        parent: &Cell<RealOf<Self>>,
        child: &Cell<RealOf<Self>>,
        from: &[Self::LocalTerm],
        to: &mut [Self::LocalTerm],
    );

    /// Adds the values of a local expansion at `targets`.
    fn l2p(
        &self,
        cell: &Cell<RealOf<Self>>,
        local: &[Self::LocalTerm],
        targets: &[TargetOf<Self>],
        values: &mut [ValueOf<Self>],
    );

    /// All M2M shifts from the cells of one level to their parents. Override it to shift many cells at
    /// once; each parent's sum must keep one fixed order.
    fn m2m_level(
        &self,
        families: &LevelFamilies<'_, RealOf<Self>>,
        from: &[Self::MultipoleTerm],
        to: &mut [Self::MultipoleTerm],
    ) {
        let len = self.multipole_len(families.level + 1);
        families.for_each_parent(to, |p, c, to| {
            self.m2m(&families.children[c], &families.parents[p], &from[c * len..][..len], to);
        });
    }

    /// All L2L shifts from the cells of one level to their children. Override it to shift many cells at
    /// once.
    fn l2l_level(
        &self,
        families: &LevelFamilies<'_, RealOf<Self>>,
        from: &[Self::LocalTerm],
        to: &mut [Self::LocalTerm],
    ) {
        let len = self.local_len(families.level);
        families.for_each_child(to, |p, c, to| {
            self.l2l(&families.parents[p], &families.children[c], &from[p * len..][..len], to);
        });
    }

    /// All M2L translations of one level. Override it to turn a whole level into matrix products;
    /// each target cell's sum must keep one fixed order.
    fn m2l_level(
        &self,
        level: &LevelPairs<'_, RealOf<Self>>,
        multipoles: &[Self::MultipoleTerm],
        locals: &mut [Self::LocalTerm],
    ) {
        let multipole_len = self.multipole_len(level.level);
        level.for_each_pair(locals, |s, t, local| {
            let multipole = &multipoles[s * multipole_len..][..multipole_len];
            self.m2l(&level.sources[s], &level.targets[t], multipole, local);
        });
    }

    /// Adds the values of a multipole expansion at `targets` that are well separated from `cell`.
    /// Never wrong to decline: the engine then sums directly.
    fn m2p(
        &self,
        _cell: &Cell<RealOf<Self>>,
        _multipole: &[Self::MultipoleTerm],
        _targets: &[TargetOf<Self>],
        _values: &mut [ValueOf<Self>],
    ) -> Outcome {
        Outcome::Declined
    }

    /// Adds the local expansion about the centre of `cell` of `sources` that are well separated from
    /// it. Never wrong to decline: the engine then sums directly.
    fn p2l(
        &self,
        _cell: &Cell<RealOf<Self>>,
        _sources: &[SourceOf<Self>],
        _charges: &[ChargeOf<Self>],
        _local: &mut [Self::LocalTerm],
    ) -> Outcome {
        Outcome::Declined
    }
}

/// The precision of an expansion's kernel.
pub type RealOf<E> = <<E as Expansion>::Kernel as Kernel>::Real;
/// The sources of an expansion's kernel.
pub type SourceOf<E> = <<E as Expansion>::Kernel as Kernel>::Source;
/// The targets of an expansion's kernel.
pub type TargetOf<E> = <<E as Expansion>::Kernel as Kernel>::Target;
/// The charges of an expansion's kernel.
pub type ChargeOf<E> = <<E as Expansion>::Kernel as Kernel>::Charge;
/// The values of an expansion's kernel.
pub type ValueOf<E> = <<E as Expansion>::Kernel as Kernel>::Value;

/// What a plan will ask of its expansion.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Geometry<T: Real> {
    /// The root cube of both trees.
    pub root: Cube<T>,
    /// The levels at which expansions are formed, from the coarsest to the finest.
    pub levels: Vec<Level<T>>,
    /// Seconds of one core that [`prepare`](Expansion::prepare) may take. An expansion that would take
    /// longer had better refuse with [`Error::OverWork`] as soon as it sees that: where the engine may
    /// choose the scheme, it then sums directly.
    pub most_seconds: f64,
    /// Seconds of one core that a pair summed directly takes.
    pub pair_seconds: f64,
    /// Some of the sources, spread over all of them; none where they are not known.
    pub sources: Vec<Point<T>>,
    /// Likewise of the targets.
    pub targets: Vec<Point<T>>,
}

/// One level of a plan.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Level<T: Real> {
    /// Its depth; the root's is 0.
    pub level: usize,
    /// Half the edge of its cells.
    pub half_width: T,
    /// The distinct integer vectors from source to target cell of its M2L pairs, in ascending order.
    pub offsets: Vec<[i32; 3]>,
    /// The number of its M2L pairs.
    pub pairs: usize,
}

impl<T: Real> Level<T> {
    /// A level of cells of that half-width, with one M2L pair at each of these offsets.
    pub fn new(level: usize, half_width: T, offsets: Vec<[i32; 3]>) -> Self {
        let pairs = offsets.len();
        Self { level, half_width, offsets, pairs }
    }
}

impl<T: Real> Geometry<T> {
    /// Levels for which an expansion may be prepared as long as it takes.
    pub fn new(root: Cube<T>, levels: Vec<Level<T>>) -> Self {
        let (sources, targets) = (Vec::new(), Vec::new());
        Self { root, levels, most_seconds: f64::INFINITY, pair_seconds: 0.0, sources, targets }
    }

    /// The distinct offsets of all levels together, in ascending order.
    pub fn all_offsets(&self) -> Vec<[i32; 3]> {
        let mut offsets: Vec<_> = self.levels.iter().flat_map(|l| l.offsets.clone()).collect();
        offsets.sort_unstable();
        offsets.dedup();
        offsets
    }
}

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
}

impl<'a, T: Real> LevelFamilies<'a, T> {
    /// The cells of `level` and of the next; `expanded` says for every cell of the tree whether it has an
    /// expansion.
    pub(crate) fn new(tree: &'a Tree<T>, level: usize, expanded: &'a [bool]) -> Self {
        let [parents, children] = [tree.shape.level(level), tree.shape.level(level + 1)];
        Self {
            level,
            parents: &tree.cells[parents.clone()],
            children: &tree.cells[children.clone()],
            nodes: &tree.shape.nodes,
            first_parent: parents.start,
            first_child: children.start,
            expanded,
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

    /// Calls `visit(p, c, terms of p)` for all children of each parent in order: parents in parallel.
    pub fn for_each_parent<M: Send>(
        &self,
        multipoles: &mut [M],
        visit: impl Fn(usize, usize, &mut [M]) + Sync,
    ) {
        let len = multipoles.len() / self.parents.len().max(1);
        parallel::for_each_piece(multipoles, len, &|p, multipole| {
            self.children_of(p).for_each(|c| visit(p, c, multipole));
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
            if let Some(p) = self.parent_of(c) {
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
    /// 1 for expansions that don't [weigh](Costs::weighs).
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
}

impl<T: Real> LevelPairs<'_, T> {
    /// Indices into `sources` of the cells that act on `targets[t]`.
    pub fn sources_of(&self, t: usize) -> impl ExactSizeIterator<Item = usize> {
        let list = &self.list[self.starts[t]..self.starts[t + 1]];
        list.iter().map(|&s| s as usize - self.first_source)
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
            self.sources_of(t).for_each(|s| visit(s, t, local));
        });
    }
}

/// One value per integer offset, found by binary search: where expansions keep their operators.
#[derive(Clone, Debug)]
pub struct OffsetMap<V> {
    offsets: Vec<[i32; 3]>,
    values: Vec<V>,
}

impl<V> Default for OffsetMap<V> {
    fn default() -> Self {
        Self { offsets: Vec::new(), values: Vec::new() }
    }
}

impl<V: Send> OffsetMap<V> {
    /// Makes one value for each of `offsets`, in parallel.
    pub fn build(offsets: &[[i32; 3]], make: impl Fn([i32; 3]) -> V + Sync) -> Self {
        let mut offsets = offsets.to_vec();
        offsets.sort_unstable();
        offsets.dedup();
        let values = parallel::map(offsets.len(), &|i| make(offsets[i]));
        Self { offsets, values }
    }

    /// The value at `offset`, if it was built.
    pub fn get(&self, offset: [i32; 3]) -> Option<&V> {
        self.index(offset).map(|i| &self.values[i])
    }

    /// Where the value at `offset` stands in [`values`](Self::values), if it was built.
    pub fn index(&self, offset: [i32; 3]) -> Option<usize> {
        self.offsets.binary_search(&offset).ok()
    }

    /// The offsets of all values, in ascending order.
    pub fn offsets(&self) -> &[[i32; 3]] {
        &self.offsets
    }

    /// All values, in ascending order of their offsets.
    pub fn values(&self) -> &[V] {
        &self.values
    }
}
