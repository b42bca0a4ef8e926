//! The plan: everything that depends on geometry alone, built once, applied to any charges.

use std::fmt;
use std::sync::Mutex;

use rayon::prelude::*;

use crate::error::Error;
use crate::estimate::Estimate;
use crate::expansion::{ChargeOf, Expansion, Geometry, SourceOf, TargetOf, ValueOf};
use crate::forecast::Known;
use crate::grove::Grove;
use crate::interpolation::Interpolation;
use crate::kernel::PointKernel;
use crate::layout::{Layout, Parts};
use crate::lists::Costs;
use crate::mask::{Mask, Unmasked};
use crate::pace::pair_seconds;
use crate::plan::{Plan, Scheme, Workspace, levels};
use crate::real::Additive;
use crate::stats::{Stats, stats};
use crate::times::{ApplyTimes, BuildTimes, Clock, Phase, Progress};
use crate::traversal::{Far, Side, Traversal};

/// A plan for sums between fixed points: trees, interaction lists, operators and mask.
///
/// Building costs O(N log N); [`apply`](Self::apply) may then be called any number of times, from
/// any thread. Its result has the same bits for any number of threads.
///
/// ```
/// use farfield::{Fmm, from_fn};
/// use glam::DVec3;
///
/// let points: Vec<DVec3> = (0..500).map(|i| DVec3::splat(f64::from(i)).map(f64::sin)).collect();
/// let charges = vec![1.0; points.len()];
///
/// let kernel = from_fn(|x: DVec3, y: DVec3| (-x.distance(y)).exp());
/// let fmm = Fmm::builder(kernel).tolerance(1e-6).build(&points, &points)?;
/// let potentials = fmm.apply(&charges)?;
///
/// let exact = farfield::direct(&kernel, &points, &charges, &points);
/// assert!(farfield::relative_l2_error(&potentials, &exact) < 1e-6);
/// # Ok::<(), farfield::Error>(())
/// ```
pub struct Fmm<E: Expansion> {
    pub(crate) plan: Plan<E>,
    stats: Stats,
    build_times: BuildTimes,
    idle: Mutex<Vec<Workspace<E>>>,
}

impl<K: PointKernel> Fmm<Interpolation<K>> {
    /// Starts a plan for a kernel given by its formula, expanded by [`Interpolation`].
    pub fn builder(kernel: K) -> Builder<'static, Interpolation<K>, Unmasked> {
        Fmm::with_expansion(Interpolation::new(kernel))
    }
}

impl<E: Expansion> Fmm<E> {
    /// Starts a plan for an expansion of its own.
    pub fn with_expansion(expansion: E) -> Builder<'static, E, Unmasked> {
        Builder {
            expansion,
            mask: Unmasked,
            scheme: Scheme::default(),
            leaf_size: None,
            memory_budget: None,
            progress: None,
        }
    }

    /// The sums u_i = Σ_j K(x_i, y_j) q_j at all targets, in the caller's order. O(N).
    ///
    /// # Errors
    /// If there is not one charge per source, a charge is not finite, or a sum is not.
    pub fn apply(&self, charges: &[ChargeOf<E>]) -> Result<Vec<ValueOf<E>>, Error> {
        self.check_charges(charges)?;
        let values = self.with_workspace(|workspace| self.plan.run(charges, workspace));
        check_values(&values)?;
        Ok(values)
    }

    /// The same sums as [`apply`](Self::apply), to the bit, with the time that each operator took.
    /// A little slower: what `apply` does in one sweep over the targets takes three.
    ///
    /// # Errors
    /// As [`apply`](Self::apply).
    pub fn apply_timed(
        &self,
        charges: &[ChargeOf<E>],
    ) -> Result<(Vec<ValueOf<E>>, ApplyTimes), Error> {
        let mut clock = Clock::start();
        let mut checks = 0.0;
        self.check_charges(charges)?;
        clock.lap(&mut checks);
        let (values, mut times) =
            self.with_workspace(|workspace| self.plan.run_timed(charges, workspace));
        clock = Clock::start();
        check_values(&values)?;
        clock.lap(&mut checks);
        times.permutation += checks;
        Ok((values, times))
    }

    /// What the plan consists of.
    pub fn stats(&self) -> &Stats {
        &self.stats
    }

    /// How long building the plan took.
    pub fn build_times(&self) -> &BuildTimes {
        &self.build_times
    }

    /// The expansion, as prepared for this plan.
    pub fn expansion(&self) -> &E {
        &self.plan.expansion
    }

    pub(crate) fn check_charges(&self, charges: &[ChargeOf<E>]) -> Result<(), Error> {
        if charges.len() != self.plan.sources.len() {
            let (expected, found) = (self.plan.sources.len(), charges.len());
            return Err(Error::LengthMismatch { what: "charges", expected, found });
        }
        match first_not_finite(charges) {
            Some(index) => {
                Err(Error::NonFiniteCharge { index, charge: format!("{:?}", charges[index]) })
            }
            None => Ok(()),
        }
    }

    /// Lends a workspace that no other call is using: allocated once, then kept.
    pub(crate) fn with_workspace<V>(&self, work: impl FnOnce(&mut Workspace<E>) -> V) -> V {
        let idle = self.idle.lock().unwrap_or_else(|e| e.into_inner()).pop();
        let mut workspace = idle.unwrap_or_else(|| Workspace::new(&self.plan));
        let result = work(&mut workspace);
        self.idle.lock().unwrap_or_else(|e| e.into_inner()).push(workspace);
        result
    }
}

pub(crate) fn check_values<V: Additive>(values: &[V]) -> Result<(), Error> {
    match first_not_finite(values) {
        Some(index) => Err(Error::NonFiniteValue { index, value: format!("{:?}", values[index]) }),
        None => Ok(()),
    }
}

/// Index of the first value that is not finite. O(N).
fn first_not_finite<V: Additive>(values: &[V]) -> Option<usize> {
    // To ask after each single value whether another thread has found one would cost more.
    let not_finite = |chunk: &[V]| !chunk.iter().all(V::is_finite);
    let start = CHUNK * values.par_chunks(CHUNK).position_first(not_finite)?;
    values[start..].iter().position(|v| !v.is_finite()).map(|i| start + i)
}

/// Values per task of a check.
const CHUNK: usize = 4096;

impl<E: Expansion> fmt::Debug for Fmm<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Fmm")
            .field("scheme", &self.plan.scheme)
            .field("stats", &self.stats)
            .finish()
    }
}

/// Collects the choices for a plan; every one has a default.
#[must_use = "call `build`"]
pub struct Builder<'a, E, M> {
    expansion: E,
    mask: M,
    scheme: Scheme,
    leaf_size: Option<usize>,
    memory_budget: Option<usize>,
    progress: Option<&'a (dyn Fn(Progress) + Sync)>,
}

impl<K: PointKernel, M> Builder<'_, Interpolation<K>, M> {
    /// The relative l2 error to stay below; default 1e-6. The order follows from it.
    pub fn tolerance(mut self, tolerance: f64) -> Self {
        self.expansion = self.expansion.tolerance(tolerance);
        self
    }

    /// A fixed number of Chebyshev nodes per axis, in place of a tolerance.
    pub fn order(mut self, order: usize) -> Self {
        self.expansion = self.expansion.order(order);
        self
    }
}

impl<'a, E: Expansion, M: Mask<E::Kernel>> Builder<'a, E, M> {
    /// Sums only the pairs that `mask` lets count; pass a reference to keep the mask.
    pub fn mask<N: Mask<E::Kernel>>(self, mask: N) -> Builder<'a, E, N> {
        let Self { expansion, scheme, leaf_size, memory_budget, progress, .. } = self;
        Builder { expansion, mask, scheme, leaf_size, memory_budget, progress }
    }

    /// How to sum; default [`Scheme::Fmm`].
    pub fn scheme(self, scheme: Scheme) -> Self {
        Self { scheme, ..self }
    }

    /// The largest number of points in a leaf.
    ///
    /// By default the expansion [chooses](Expansion::leaf_size) by the time that a pair of these
    /// points takes, measured once in a process for each type of kernel and tolerance. Another
    /// process or another machine may so come to another tree, and to sums that differ in rounding
    /// and within the tolerance. A fixed leaf size makes them the same to the bit.
    pub fn leaf_size(self, leaf_size: usize) -> Self {
        Self { leaf_size: Some(leaf_size), ..self }
    }

    /// Whom to tell how far building has come, possibly from several threads at once.
    pub fn progress<'b>(self, report: &'b (dyn Fn(Progress) + Sync)) -> Builder<'b, E, M> {
        let Self { expansion, mask, scheme, leaf_size, memory_budget, .. } = self;
        Builder { expansion, mask, scheme, leaf_size, memory_budget, progress: Some(report) }
    }

    /// The most bytes that the plan and one workspace may need; by default as many as it takes. With a
    /// budget, building makes an [`estimate`](Self::estimate) as soon as the trees stand, and stops there
    /// if that is more. Operators of expansions are not counted.
    pub fn memory_budget(self, bytes: usize) -> Self {
        Self { memory_budget: Some(bytes), ..self }
    }

    /// What the plan would cost, without making its lists and operators: sorts the points into trees,
    /// and asks the mask for some cells. O(N).
    ///
    /// ```
    /// use farfield::{Error, Fmm, from_fn};
    /// use glam::DVec3;
    ///
    /// let points: Vec<DVec3> = (0..5000).map(|i| DVec3::splat(f64::from(i)).map(f64::sin)).collect();
    /// let builder = Fmm::builder(from_fn(|x: DVec3, y: DVec3| (-x.distance(y)).exp()));
    /// let estimate = builder.estimate(&points, &points)?;
    /// assert!(estimate.bytes() > 5000 * size_of::<DVec3>());
    /// let refused = builder.memory_budget(estimate.bytes() / 2).build(&points, &points);
    /// assert!(matches!(refused, Err(Error::OverMemoryBudget { .. })));
    /// # Ok::<(), Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`build`](Self::build), but for those of the expansion.
    pub fn estimate(
        &self,
        sources: &[SourceOf<E>],
        targets: &[TargetOf<E>],
    ) -> Result<Estimate, Error> {
        let (mut clock, mut tree_seconds) = (Clock::start(), 0.0);
        let grove = self.grove(sources, targets)?;
        clock.lap(&mut tree_seconds);
        Ok(self.estimate_in(&grove, tree_seconds))
    }

    /// Builds the plan. Empty sets are valid: sums over no sources are zero. If sources and targets
    /// are at the same points in the same order, they share one tree.
    ///
    /// # Errors
    /// If a coordinate is not finite, the points extend too far for their precision, the leaf size is
    /// zero, the plan would need more memory than it may, or the expansion can't meet its tolerance or
    /// order.
    pub fn build(
        mut self,
        sources: &[SourceOf<E>],
        targets: &[TargetOf<E>],
    ) -> Result<Fmm<E>, Error> {
        let report = |phase, fraction| {
            if let Some(report) = self.progress {
                report(Progress { phase, fraction });
            }
        };
        let (mut clock, mut build_times) = (Clock::start(), BuildTimes::default());
        report(Phase::Tree, 0.0);
        let grove = self.grove(sources, targets)?;
        report(Phase::Tree, 1.0);
        clock.lap(&mut build_times.tree);

        report(Phase::Lists, 0.0);
        if let Some(budget) = self.memory_budget {
            let estimate = Box::new(self.estimate_in(&grove, build_times.tree));
            if estimate.bytes() > budget {
                return Err(Error::OverMemoryBudget { budget, estimate });
            }
        }
        let report_lists = |fraction| report(Phase::Lists, fraction);
        let mut lists = self.traversal(&grove).lists(&report_lists);
        report(Phase::Lists, 1.0);
        clock.lap(&mut build_times.lists);

        report(Phase::Operators, 0.0);
        let levels_of_trees = grove.levels();
        let Grove { root, leaf_size, source_tree, target_tree, sources, targets } = grove;
        let levels = levels(&lists, &source_tree, &target_tree, self.scheme);
        self.expansion.prepare(&Geometry { root, levels })?;
        report(Phase::Operators, 1.0);
        clock.lap(&mut build_times.operators);

        // What an expansion costs is known only now.
        let expansion = self.expansion;
        let by_level =
            |of: &dyn Fn(usize) -> usize| -> Vec<usize> { (0..levels_of_trees).map(of).collect() };
        let costs = Costs {
            m2p: by_level(&|level| expansion.m2p_pairs(level)),
            p2l: by_level(&|level| expansion.p2l_pairs(level)),
            treecode: self.scheme != Scheme::Fmm,
        };
        lists.sum_small_directly(&target_tree.shape, &source_tree.shape, &costs);
        let layout = Layout::new(&Parts {
            sources: &source_tree.shape,
            targets: &target_tree.shape,
            lists: &lists,
            costs: &costs,
            multipole_lens: &by_level(&|level| expansion.multipole_len(level)),
            local_lens: &by_level(&|level| expansion.local_len(level)),
            shift_moments: self.scheme.shifts_moments(),
        });
        let plan = Plan {
            expansion,
            scheme: self.scheme,
            source_tree,
            target_tree,
            sources,
            targets,
            lists,
            layout,
        };
        let stats = stats(&plan, leaf_size);
        clock.lap(&mut build_times.lists);
        Ok(Fmm { plan, stats, build_times, idle: Mutex::new(Vec::new()) })
    }

    fn grove(
        &self,
        sources: &[SourceOf<E>],
        targets: &[TargetOf<E>],
    ) -> Result<Grove<SourceOf<E>, TargetOf<E>>, Error> {
        let best = || self.expansion.leaf_size(self.pair_seconds(sources, targets));
        Grove::new(sources, targets, || self.leaf_size.unwrap_or_else(best))
    }

    fn pair_seconds(&self, sources: &[SourceOf<E>], targets: &[TargetOf<E>]) -> f64 {
        let (kernel, tolerance) = (self.expansion.kernel(), self.expansion.pair_tolerance());
        pair_seconds(kernel, tolerance, sources, targets)
    }

    fn traversal<'b>(
        &'b self,
        grove: &'b Grove<SourceOf<E>, TargetOf<E>>,
    ) -> Traversal<'b, E::Kernel, M> {
        Traversal {
            targets: Side { tree: &grove.target_tree, points: &grove.targets },
            sources: Side { tree: &grove.source_tree, points: &grove.sources },
            mask: &self.mask,
            far: match self.scheme {
                Scheme::Direct => Far::Nothing,
                Scheme::Fmm if self.expansion.weighs() => Far::Weighed,
                Scheme::Fmm | Scheme::Treecode { .. } => Far::Whole,
            },
        }
    }

    fn estimate_in(&self, grove: &Grove<SourceOf<E>, TargetOf<E>>, tree_seconds: f64) -> Estimate {
        let pair_seconds = self.pair_seconds(&grove.sources, &grove.targets);
        let Self { expansion, scheme, .. } = self;
        let known = Known { expansion, scheme: *scheme, grove, pair_seconds, tree_seconds };
        known.estimate(&self.traversal(grove))
    }
}

impl<E: fmt::Debug, M: fmt::Debug> fmt::Debug for Builder<'_, E, M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Builder")
            .field("expansion", &self.expansion)
            .field("mask", &self.mask)
            .field("scheme", &self.scheme)
            .field("leaf_size", &self.leaf_size)
            .finish_non_exhaustive()
    }
}
