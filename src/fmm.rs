//! The plan: everything that depends on geometry alone, built once, applied to any charges.

use std::fmt;
use std::sync::{Arc, Mutex};

use rayon::prelude::*;

use crate::error::{Error, PointSet};
use crate::expansion::{ChargeOf, Expansion, Geometry, Level, SourceOf, TargetOf, ValueOf};
use crate::interpolation::Interpolation;
use crate::kernel::PointKernel;
use crate::layout::{Layout, Parts};
use crate::lists::{Costs, Lists};
use crate::mask::{Mask, Unmasked};
use crate::pace::pair_seconds;
use crate::plan::{Plan, Scheme, Workspace};
use crate::real::{Additive, Located, Real};
use crate::stats::{Stats, stats};
use crate::times::{ApplyTimes, BuildTimes, Clock};
use crate::traversal::{Far, Side, find_lists};
use crate::tree::{Bounds, Tree};

/// Which part of building a plan is under way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Sorting the points into trees.
    Tree,
    /// Finding the interaction lists and asking the mask for single pairs.
    Lists,
    /// Preparing the expansion's operators.
    Operators,
}

/// A report on how far building a plan has come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// The part under way.
    pub phase: Phase,
    /// How much of that part is done, from 0 to 1; reports may arrive out of order.
    pub fraction: f64,
}

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
        let Self { expansion, scheme, leaf_size, progress, .. } = self;
        Builder { expansion, mask, scheme, leaf_size, progress }
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
        let Self { expansion, mask, scheme, leaf_size, .. } = self;
        Builder { expansion, mask, scheme, leaf_size, progress: Some(report) }
    }

    /// Builds the plan. Empty sets are valid: sums over no sources are zero. If sources and targets
    /// are at the same points in the same order, they share one tree.
    ///
    /// # Errors
    /// If a coordinate is not finite, the points extend too far for their precision, the leaf size is
    /// zero, or the expansion can't meet its tolerance or order.
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
        let bounds = Bounds::new(PointSet::Sources, sources)?;
        let root = bounds.join(Bounds::new(PointSet::Targets, targets)?).root_cube()?;
        let leaf_size = self.leaf_size.unwrap_or_else(|| {
            let (kernel, tolerance) = (self.expansion.kernel(), self.expansion.pair_tolerance());
            self.expansion.leaf_size(pair_seconds(kernel, tolerance, sources, targets))
        });
        if leaf_size == 0 {
            return Err(Error::InvalidLeafSize);
        }
        let source_tree = Arc::new(Tree::new(&root, sources, leaf_size));
        let same_points = sources.len() == targets.len()
            && sources.par_iter().zip(targets).all(|(y, x)| y.position() == x.position());
        let target_tree = if same_points {
            Arc::clone(&source_tree)
        } else {
            Arc::new(Tree::new(&root, targets, leaf_size))
        };
        let sources = in_tree_order(sources, &source_tree);
        let targets = in_tree_order(targets, &target_tree);
        report(Phase::Tree, 1.0);
        clock.lap(&mut build_times.tree);

        report(Phase::Lists, 0.0);
        let far = match self.scheme {
            Scheme::Direct => Far::Nothing,
            Scheme::Fmm if self.expansion.weighs() => Far::Weighed,
            Scheme::Fmm | Scheme::Treecode { .. } => Far::Whole,
        };
        let mut lists = find_lists(
            Side { tree: &target_tree, points: &targets },
            Side { tree: &source_tree, points: &sources },
            &self.mask,
            far,
            &|fraction| report(Phase::Lists, fraction),
        );
        report(Phase::Lists, 1.0);
        clock.lap(&mut build_times.lists);

        report(Phase::Operators, 0.0);
        let levels = levels(&lists, &source_tree, &target_tree, self.scheme);
        self.expansion.prepare(&Geometry { root, levels })?;
        report(Phase::Operators, 1.0);
        clock.lap(&mut build_times.operators);

        // What an expansion costs is known only now.
        let expansion = self.expansion;
        let by_level = |of: &dyn Fn(usize) -> usize| -> Vec<usize> {
            (0..source_tree.shape.levels().max(target_tree.shape.levels())).map(of).collect()
        };
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

fn in_tree_order<P: Located>(points: &[P], tree: &Tree<P::Real>) -> Vec<P> {
    tree.shape.order.par_iter().map(|&i| points[i as usize].clone()).collect()
}

/// The levels at which expansions are formed. M2P and P2L need the level of their expansion, and
/// shifts need every level between the coarsest and the finest.
fn levels<T: Real>(
    lists: &Lists,
    source_tree: &Tree<T>,
    target_tree: &Tree<T>,
    scheme: Scheme,
) -> Vec<Level<T>> {
    // Cells are stored from the coarsest level to the finest, so the first is on the coarsest.
    let groups = 0..target_tree.cells.len();
    let receives = |&t: &usize| lists.has_m2l(t) || !lists.p2l.of(t).is_empty();
    let local = groups.into_iter().find(receives).map(|t| target_tree.shape.nodes[t].level());
    let m2p = lists.m2p.items.par_iter().min();
    let multipole = m2p.map(|&s| source_tree.shape.nodes[s as usize].level());
    let Some(coarsest) = local.into_iter().chain(multipole).min() else { return Vec::new() };
    let finest = source_tree.shape.levels().max(target_tree.shape.levels());
    (coarsest..finest)
        .map(|level| {
            let target = target_tree.shape.level(level).next().map(|t| &target_tree.cells[t]);
            let source = || source_tree.shape.level(level).next().map(|s| &source_tree.cells[s]);
            let cell = target.or_else(source);
            let half_width = cell.map_or(T::from_f64(0.0), |cell| cell.half_width());
            let offsets = lists.offsets.get(level).filter(|_| scheme == Scheme::Fmm);
            Level { level, half_width, offsets: offsets.cloned().unwrap_or_default() }
        })
        .collect()
}
