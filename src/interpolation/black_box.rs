//! Interpolation of any kernel: what is asked for, and what is prepared.

use std::fmt;
use std::sync::Arc;

use crate::expansion::admissibility::Admissibility;
use crate::expansion::weights::Weights;
use crate::interpolation::chebyshev::Chebyshev;
use crate::kernel::traits::Kernel;
use crate::parallel::pool::Pool;

use crate::interpolation::accuracy::Accuracy;
use crate::interpolation::basis::Basis;
use crate::interpolation::everywhere::Everywhere;
use crate::interpolation::prepared::Prepared;
use crate::interpolation::scratch::{Scratch, Shifted};
use crate::interpolation::store::OperatorStore;

/// The far field of any [`Kernel`]: interpolation at Chebyshev nodes (Fong and Darve, "The
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
/// Pairs of cells between which no order is enough are [not carried](crate::Expansion::admits), nor are those of
/// which all that they send is within a tenth of the tolerance.
///
/// Operators depend on the kernel and the tolerance, not on the points: an [`OperatorStore`] keeps them for further plans.
///
/// With rank r per cell and k per direction, M2L costs O(k²) multiply-adds per pair of cells and O(r k)
/// per cell and direction, as matrix products; P2M and L2P cost O(n³) per point for n nodes per axis.
pub struct Interpolation<K: Kernel> {
    pub(super) kernel: Arc<K>,
    pub(super) accuracy: Accuracy,
    /// What brings the kernel's entries to one size; levels may have weights of their own beside these.
    pub(super) weights: Weights,
    /// Where operators are kept.
    pub(super) store: OperatorStore,
    pub(super) prepared: Arc<Prepared<K::Entry>>,
    /// What the expansion that this one was cloned from had prepared last.
    pub(super) former: Option<Arc<Prepared<K::Entry>>>,
    /// Which pairs of cells are carried.
    pub(super) admissibility: Admissibility,
    /// Core seconds that went into preparing it, for all geometries.
    pub(super) spent: f64,
    pub(super) scratch: Pool<Scratch<K>>,
    pub(super) shifted: Pool<Shifted<K::Entry>>,
}

impl<K: Kernel> Interpolation<K> {
    /// Expands `kernel` to a relative l2 error of 1e-6.
    pub fn new(kernel: K) -> Self {
        Self::of(Arc::new(kernel), Accuracy::Tolerance(1e-6), OperatorStore::of_process().clone())
    }

    /// Not prepared.
    pub(super) fn of(kernel: Arc<K>, accuracy: Accuracy, store: OperatorStore) -> Self {
        let everywhere = Everywhere::with_order(1, kernel.fields(), kernel.densities());
        Self {
            kernel,
            accuracy,
            weights: Weights::default(),
            store,
            prepared: Arc::new(Prepared::Everywhere(Box::new(everywhere))),
            former: None,
            admissibility: Admissibility::default(),
            spent: 0.0,
            scratch: Pool::default(),
            shifted: Pool::default(),
        }
    }

    /// The relative l2 error to stay below, between 0 and 1.
    pub fn tolerance(self, tolerance: f64) -> Self {
        Self { accuracy: Accuracy::Tolerance(tolerance), ..self }
    }

    /// A fixed number of nodes per axis, 1 to [`MAX_ORDER`](crate::MAX_ORDER); nothing is cut off that they resolve.
    pub fn order(self, order: usize) -> Self {
        Self { accuracy: Accuracy::Order(order), ..self }
    }

    /// Where operators are looked for and kept; default [`OperatorStore::of_process`].
    pub fn operator_store(self, store: &OperatorStore) -> Self {
        Self { store: store.clone(), ..self }
    }

    /// Nodes per axis of a prepared expansion.
    pub fn nodes_per_axis(&self) -> usize {
        self.rule().len()
    }

    /// The error that was measured between random points of well-separated cells when the expansion was
    /// prepared, relative to what whole sums [allow](crate::Strength::size) where that is known, and to the
    /// kernel's size otherwise; none for a kernel that is not translation invariant.
    pub fn measured_error(&self) -> Option<f64> {
        match &*self.prepared {
            Prepared::Everywhere(_) => None,
            Prepared::Invariant(invariant) => Some(invariant.operators.error),
        }
    }

    /// For how many levels operators were built when the expansion was prepared last, rather than
    /// [kept](crate::Fmm::update) or found in an [`OperatorStore`]; 1 if one level's operators serve all.
    pub fn built_levels(&self) -> usize {
        match &*self.prepared {
            Prepared::Everywhere(_) => 0,
            Prepared::Invariant(invariant) => invariant.built,
        }
    }

    /// How many multiply-adds M2L takes at a level per right-hand side and cell with a full interaction
    /// list; none for a kernel that is not translation invariant.
    pub fn m2l_multiply_adds(&self, level: usize) -> Option<f64> {
        match &*self.prepared {
            Prepared::Everywhere(_) => None,
            Prepared::Invariant(invariant) => {
                Some(invariant.level(level).transfers.numbering.multiply_adds())
            }
        }
    }

    /// The mean rank of M2L at a level, by direction; none for a kernel that is not translation
    /// invariant.
    pub fn mean_m2l_rank(&self, level: usize) -> Option<f64> {
        match &*self.prepared {
            Prepared::Everywhere(_) => None,
            Prepared::Invariant(invariant) => {
                Some(invariant.level(level).transfers.numbering.mean_rank())
            }
        }
    }

    pub(super) fn rule(&self) -> &Chebyshev<K::Real> {
        match &*self.prepared {
            Prepared::Everywhere(everywhere) => &everywhere.rule,
            Prepared::Invariant(invariant) => &invariant.operators.rule,
        }
    }

    /// What expansions of a level are of: a_i G_ij b_j.
    pub(super) fn weights(&self, level: usize) -> &Weights {
        match &*self.prepared {
            Prepared::Everywhere(_) => &self.weights,
            Prepared::Invariant(invariant) => invariant.weights(level),
        }
    }

    pub(super) fn source_basis(&self, level: usize) -> &Basis<K::Entry> {
        match &*self.prepared {
            Prepared::Everywhere(everywhere) => &everywhere.source,
            Prepared::Invariant(invariant) => &invariant.level(level).bases.source,
        }
    }

    pub(super) fn target_basis(&self, level: usize) -> &Basis<K::Entry> {
        match &*self.prepared {
            Prepared::Everywhere(everywhere) => &everywhere.target,
            Prepared::Invariant(invariant) => &invariant.level(level).bases.target,
        }
    }
}

/// Shares the kernel and the operators. Prepared for other points, the clone keeps those operators that serve them.
impl<K: Kernel> Clone for Interpolation<K> {
    fn clone(&self) -> Self {
        let former = match &*self.prepared {
            Prepared::Invariant(_) => Some(Arc::clone(&self.prepared)),
            // Direct sums prepare nothing.
            Prepared::Everywhere(_) => self.former.clone(),
        };
        Self {
            kernel: Arc::clone(&self.kernel),
            accuracy: self.accuracy,
            weights: self.weights.clone(),
            store: self.store.clone(),
            prepared: Arc::clone(&self.prepared),
            former,
            admissibility: self.admissibility.clone(),
            spent: 0.0,
            scratch: Pool::default(),
            shifted: Pool::default(),
        }
    }
}

impl<K: Kernel> fmt::Debug for Interpolation<K> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Interpolation")
            .field("accuracy", &self.accuracy)
            .field("nodes_per_axis", &self.nodes_per_axis())
            .field("measured_error", &self.measured_error())
            .finish_non_exhaustive()
    }
}
