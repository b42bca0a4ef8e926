//! Expansions: how a kernel's far field is carried from cell to cell.

pub(crate) mod admissibility;
pub(crate) mod costs;
pub(crate) mod geometry;
pub(crate) mod level_cells;
pub(crate) mod offset_map;
pub(crate) mod weights;

use crate::error::Error;
use crate::expansion::costs::Costs;
use crate::expansion::geometry::Geometry;
use crate::expansion::level_cells::{LevelFamilies, LevelPairs};
use crate::expansion::weights::Weights;
use crate::kernel::mask::Coverage;
use crate::kernel::traits::{Kernel, Outcome};
use crate::numbers::traits::Numbers;
use crate::octree::geometry::{Cell, Cube};

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

    /// What brings the rows and columns of G to one size for pairs of points within `root`, if the expansion weighs
    /// them so that its errors are small beside each of them. Called before [`prepare`](Self::prepare) if there are
    /// levels, whose [strengths](crate::Strength) are then those of the weighted kernel. By default, nothing is weighted.
    fn weigh(&mut self, _root: &Cube<RealOf<Self>>) -> Weights {
        Weights::default()
    }

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

    /// Which pairs of cells of `level` the expansion carries, by the integer vector from source to target cell.
    /// Asked after [`prepare`](Self::prepare), for every offset of the levels that were announced.
    ///
    /// * [`Coverage::Full`]: all of them, the default.
    /// * [`Coverage::Partial`]: none of them. The cells are split, and what is left at the leaves is summed
    ///   directly: for kernels that are not smooth there.
    /// * [`Coverage::Empty`]: all that these pairs add to sums is no more than the
    ///   [tolerance of a pair](crate::Costs::pair_tolerance) of them. They are left out.
    ///
    /// If not everything is carried, the interaction lists are made again, and `prepare` is called again with what
    /// was answered in [`Geometry::admissibility`].
    fn admits(&self, _level: usize, _offset: [i32; 3]) -> Coverage {
        Coverage::Full
    }

    /// The same expansion, not prepared, if it heeds [`Strength`](crate::Strength): the engine prepares it again
    /// for charges under which pairs may be off by less. By default none, and strengths are not measured.
    fn again(&self) -> Option<Self>
    where
        Self: Sized,
    {
        None
    }

    /// What the errors of a pair at `level` were taken relative to when the expansion was prepared: those of
    /// values, and those of derivatives. Where some charges allow half of that only, the engine prepares the
    /// expansion [again](Self::again) for them.
    fn pair_sizes(&self, _level: usize) -> [f64; 2] {
        [0.0; 2]
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
