//! The black-box expansion of any point kernel: interpolation, compressed to numerical rank.

pub(crate) mod basis;
pub(crate) mod by_kernel;
pub(crate) mod cache;
pub(crate) mod chebyshev;
pub(crate) mod check;
pub(crate) mod cost;
pub(crate) mod densities;
pub(crate) mod directions;
pub(crate) mod exchange;
pub(crate) mod far_field;
pub(crate) mod lanes;
pub(crate) mod level;
pub(crate) mod means;
pub(crate) mod operators;
pub(crate) mod points;
pub(crate) mod prepared;
pub(crate) mod probe;
pub(crate) mod ranges;
pub(crate) mod shifts;
pub(crate) mod transfer;

use std::any::type_name;
use std::fmt;

use crate::error::Error;
use crate::expansion::{Expansion, Geometry, LevelFamilies, LevelPairs};
use crate::interpolation::chebyshev::Chebyshev;
use crate::interpolation::probe::Formula;
use crate::kernel::{Outcome, PointKernel};
use crate::numbers::real::{Columns, Point, Real};
use crate::octree::geometry::Cell;
use crate::parallel::pool::Pool;

use basis::Basis;
use densities::Scratch;
use operators::Accuracy;
use prepared::{Everywhere, Prepared};
use shifts::Shifted;

/// The far field of any [`PointKernel`]: interpolation at Chebyshev nodes (Fong and Darve, "The
/// black-box fast multipole method", J. Comput. Phys. 228, 2009), reduced to the numerical rank of the
/// far field.
///
/// Nothing about the kernel is declared. Whether it is translation invariant, symmetric, homogeneous, or
/// changes only signs under reflections is measured when the plan is built, and saves work where it
/// holds. Order, rank and cut-offs follow from the tolerance: the fewest nodes that interpolate the far
/// field well enough; the singular vectors of the far field that matter; fewer still for what comes
/// from one of 26 directions. What is left out is measured between random points, and less is left out
/// if need be.
///
/// Operators depend on the kernel and the tolerance, not on the points: sets that were used lately are
/// remembered by the process and serve further plans.
///
/// With rank r per cell and k per direction, M2L costs O(k²) multiply-adds per pair of cells and O(r k)
/// per cell and direction, as matrix products; P2M and L2P cost O(n³) per point for n nodes per axis.
pub struct Interpolation<K: PointKernel> {
    kernel: K,
    accuracy: Accuracy,
    prepared: Prepared<K::Entry>,
    scratch: Pool<Scratch<K>>,
    shifted: Pool<Shifted<K::Entry>>,
}

/// The largest number of nodes per axis.
pub const MAX_ORDER: usize = 16;

/// The share of the tolerance that one pair of the near field may be off by.
const PAIR_SHARE: f64 = 0.1;

/// One evaluation of [`PointKernel::entries`] costs about as much as this many pairs of a near field.
const ENTRY_PAIRS: usize = 4;

impl<K: PointKernel> Interpolation<K> {
    /// Expands `kernel` to a relative l2 error of 1e-6.
    pub fn new(kernel: K) -> Self {
        Self {
            kernel,
            accuracy: Accuracy::Tolerance(1e-6),
            prepared: Prepared::Everywhere(Box::new(Everywhere::with_order(
                1,
                K::FIELDS,
                K::DENSITIES,
            ))),
            scratch: Pool::default(),
            shifted: Pool::default(),
        }
    }

    /// The relative l2 error to stay below, between 0 and 1.
    pub fn tolerance(self, tolerance: f64) -> Self {
        Self { accuracy: Accuracy::Tolerance(tolerance), ..self }
    }

    /// A fixed number of nodes per axis, 1 to [`MAX_ORDER`]; nothing is cut off that they resolve.
    pub fn order(self, order: usize) -> Self {
        Self { accuracy: Accuracy::Order(order), ..self }
    }

    /// Nodes per axis of a prepared expansion.
    pub fn nodes_per_axis(&self) -> usize {
        self.rule().len()
    }

    /// The relative error that was measured between random points of well-separated cells when the
    /// expansion was prepared; none for a kernel that is not translation invariant.
    pub fn measured_error(&self) -> Option<f64> {
        match &self.prepared {
            Prepared::Everywhere(_) => None,
            Prepared::Invariant(invariant) => Some(invariant.operators.error),
        }
    }

    /// How many multiply-adds M2L takes at a level per right-hand side and cell with a full interaction
    /// list; none for a kernel that is not translation invariant.
    pub fn m2l_multiply_adds(&self, level: usize) -> Option<f64> {
        match &self.prepared {
            Prepared::Everywhere(_) => None,
            Prepared::Invariant(invariant) => {
                Some(invariant.level(level).transfers.multiply_adds())
            }
        }
    }

    /// The mean rank of M2L at a level, by direction; none for a kernel that is not translation
    /// invariant.
    pub fn mean_m2l_rank(&self, level: usize) -> Option<f64> {
        match &self.prepared {
            Prepared::Everywhere(_) => None,
            Prepared::Invariant(invariant) => Some(invariant.level(level).transfers.mean_rank()),
        }
    }

    fn rule(&self) -> &Chebyshev<K::Real> {
        match &self.prepared {
            Prepared::Everywhere(everywhere) => &everywhere.rule,
            Prepared::Invariant(invariant) => &invariant.operators.rule,
        }
    }

    fn source_basis(&self, level: usize) -> &Basis<K::Entry> {
        match &self.prepared {
            Prepared::Everywhere(everywhere) => &everywhere.source,
            Prepared::Invariant(invariant) => &invariant.level(level).bases.source,
        }
    }

    fn target_basis(&self, level: usize) -> &Basis<K::Entry> {
        match &self.prepared {
            Prepared::Everywhere(everywhere) => &everywhere.target,
            Prepared::Invariant(invariant) => &invariant.level(level).bases.target,
        }
    }
}

impl<K: PointKernel> Expansion for Interpolation<K> {
    type Kernel = K;
    type MultipoleTerm = K::Entry;
    type LocalTerm = K::Entry;

    fn kernel(&self) -> &K {
        &self.kernel
    }

    fn multipole_len(&self, level: usize) -> usize {
        self.source_basis(level).rank() * K::Column::WIDTH
    }

    fn local_len(&self, level: usize) -> usize {
        self.target_basis(level).rank() * K::Column::WIDTH
    }

    fn prepare(&mut self, geometry: &Geometry<K::Real>) -> Result<(), Error> {
        self.accuracy.check()?;
        let kernel = &self.kernel;
        let entries =
            |x: Point<K::Real>, y: Point<K::Real>, g: &mut [K::Entry]| kernel.entries(x, y, g);
        let formula = Formula::new(K::FIELDS, K::DENSITIES, &entries);
        self.prepared = Prepared::new(type_name::<K>(), &formula, self.accuracy, geometry)?;
        self.scratch = Pool::default();
        Ok(())
    }

    fn leaf_size(&self, pair_seconds: f64) -> usize {
        let components = K::FIELDS.max(K::DENSITIES);
        cost::leaf_size::<K::Entry>(self.accuracy, components, K::Column::WIDTH, pair_seconds)
    }

    fn expected_terms(&self) -> usize {
        let components = K::FIELDS.max(K::DENSITIES);
        cost::rank(self.accuracy, components) as usize * K::Column::WIDTH
    }

    fn pair_tolerance(&self) -> f64 {
        match self.accuracy {
            Accuracy::Tolerance(tolerance) => PAIR_SHARE * tolerance,
            Accuracy::Order(_) => 0.0,
        }
    }

    fn m2p_pairs(&self, level: usize) -> usize {
        ENTRY_PAIRS * self.source_basis(level).skeleton.points.len()
    }

    fn p2l_pairs(&self, level: usize) -> usize {
        ENTRY_PAIRS * self.target_basis(level).skeleton.points.len()
    }

    fn p2m(
        &self,
        cell: &Cell<K::Real>,
        sources: &[K::Source],
        charges: &[K::Charge],
        multipole: &mut [K::Entry],
    ) {
        self.add_moments(cell, sources, charges, multipole);
    }

    fn m2m(
        &self,
        child: &Cell<K::Real>,
        _parent: &Cell<K::Real>,
        from: &[K::Entry],
        to: &mut [K::Entry],
    ) {
        self.shift(child, false, from, to);
    }

    fn m2m_level(
        &self,
        families: &LevelFamilies<'_, K::Real>,
        from: &[K::Entry],
        to: &mut [K::Entry],
    ) {
        self.shift_up(families, from, to);
    }

    fn l2l_level(
        &self,
        families: &LevelFamilies<'_, K::Real>,
        from: &[K::Entry],
        to: &mut [K::Entry],
    ) {
        self.shift_down(families, from, to);
    }

    fn m2l(
        &self,
        source: &Cell<K::Real>,
        target: &Cell<K::Real>,
        from: &[K::Entry],
        to: &mut [K::Entry],
    ) {
        if let Prepared::Invariant(invariant) = &self.prepared {
            let (transfers, scale) = invariant.transfers(source.level(), source.half_width());
            if transfers.add(source.offset_to(target), scale, from, to) {
                return;
            }
        }
        self.m2l_by_kernel(1.0, source, target, from, to);
    }

    fn weighs(&self) -> bool {
        true
    }

    fn m2l_level(
        &self,
        level: &LevelPairs<'_, K::Real>,
        multipoles: &[K::Entry],
        locals: &mut [K::Entry],
    ) {
        let from = self.multipole_len(level.level);
        let by_kernel = |s: usize, t: usize, local: &mut [K::Entry]| {
            let multipole = &multipoles[s * from..][..from];
            let [source, target] = [&level.sources[s], &level.targets[t]];
            self.m2l_by_kernel(level.weight, source, target, multipole, local);
        };
        let Some(half_width) = level.targets.first().map(Cell::half_width) else { return };
        match &self.prepared {
            Prepared::Everywhere(_) => level.for_each_pair(locals, by_kernel),
            Prepared::Invariant(invariant) => {
                let (transfers, scale) = invariant.transfers(level.level, half_width);
                let columns = K::Column::WIDTH;
                let scale = scale * K::Real::from_f64(level.weight);
                transfers.add_level(level, scale, columns, multipoles, locals, &by_kernel);
            }
        }
    }

    fn l2l(
        &self,
        _parent: &Cell<K::Real>,
        child: &Cell<K::Real>,
        from: &[K::Entry],
        to: &mut [K::Entry],
    ) {
        self.shift(child, true, from, to);
    }

    fn l2p(
        &self,
        cell: &Cell<K::Real>,
        local: &[K::Entry],
        targets: &[K::Target],
        values: &mut [K::Value],
    ) {
        self.add_values(cell, local, targets, values);
    }

    fn m2p(
        &self,
        cell: &Cell<K::Real>,
        multipole: &[K::Entry],
        targets: &[K::Target],
        values: &mut [K::Value],
    ) -> Outcome {
        self.m2p_by_kernel(cell, multipole, targets, values)
    }

    fn p2l(
        &self,
        cell: &Cell<K::Real>,
        sources: &[K::Source],
        charges: &[K::Charge],
        local: &mut [K::Entry],
    ) -> Outcome {
        self.p2l_by_kernel(cell, sources, charges, local);
        Outcome::Done
    }
}

impl<K: PointKernel> fmt::Debug for Interpolation<K> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Interpolation")
            .field("accuracy", &self.accuracy)
            .field("nodes_per_axis", &self.nodes_per_axis())
            .field("measured_error", &self.measured_error())
            .finish_non_exhaustive()
    }
}
