//! The plan: everything that depends on geometry alone, built once, applied to any charges.

use std::fmt;
use std::sync::{Arc, Mutex};

use rayon::prelude::*;

use crate::error::{Error, PointSet};
use crate::expansion::{ChargeOf, Expansion, Geometry, Level, RealOf, SourceOf, TargetOf, ValueOf};
use crate::interpolation::Interpolation;
use crate::kernel::PointKernel;
use crate::lists::{ALL, Lists, Side};
use crate::mask::{Mask, Unmasked};
use crate::passes::{Plan, Scheme, Workspace};
use crate::real::{Additive, Located};
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

/// What a plan consists of.
#[derive(Clone, Debug, PartialEq)]
pub struct Stats {
    /// Number of sources.
    pub sources: usize,
    /// Number of targets.
    pub targets: usize,
    /// Number of cells of the source tree and the target tree, counted once if they are shared.
    pub cells: usize,
    /// Level of the deepest cell.
    pub depth: usize,
    /// The largest number of points that a leaf was allowed.
    pub leaf_size: usize,
    /// Multipole terms of a leaf at the deepest level.
    pub terms_per_cell: usize,
    /// Pairs of points that an expansion carries.
    pub expansion_pairs: u64,
    /// Pairs of points that are summed directly.
    pub direct_pairs: u64,
    /// Pairs of cells by M2L, M2P and P2L.
    pub cell_pairs: [u64; 3],
    /// Bytes of the remembered mask.
    pub mask_bytes: usize,
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
    plan: Plan<E>,
    stats: Stats,
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
        if charges.len() != self.plan.sources.len() {
            let (expected, found) = (self.plan.sources.len(), charges.len());
            return Err(Error::LengthMismatch { what: "charges", expected, found });
        }
        if let Some(index) = charges.par_iter().position_first(|q| !q.is_finite()) {
            return Err(Error::NonFiniteCharge { index, charge: format!("{:?}", charges[index]) });
        }
        let mut workspace = self.take_workspace();
        self.plan.run(charges, &mut workspace);
        let mut values = vec![ValueOf::<E>::zero(); self.plan.targets.len()];
        for (value, &i) in workspace.values.iter().zip(&self.plan.target_tree.order) {
            values[i as usize] = *value;
        }
        self.idle.lock().unwrap_or_else(|e| e.into_inner()).push(workspace);
        match values.par_iter().position_first(|u| !u.is_finite()) {
            Some(index) => {
                Err(Error::NonFiniteValue { index, value: format!("{:?}", values[index]) })
            }
            None => Ok(values),
        }
    }

    /// What the plan consists of.
    pub fn stats(&self) -> &Stats {
        &self.stats
    }

    /// The expansion, as prepared for this plan.
    pub fn expansion(&self) -> &E {
        &self.plan.expansion
    }

    /// A workspace that no other call is using: `apply` allocates only the first time.
    fn take_workspace(&self) -> Workspace<E> {
        let idle = self.idle.lock().unwrap_or_else(|e| e.into_inner()).pop();
        idle.unwrap_or_else(|| Workspace::new(&self.plan))
    }
}

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

    /// The largest number of points in a leaf; the default is the expansion's own
    /// [`leaf_size`](Expansion::leaf_size).
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
        let leaf_size = self.leaf_size.unwrap_or_else(|| self.expansion.leaf_size(1e-9));
        if leaf_size == 0 {
            return Err(Error::InvalidLeafSize);
        }
        report(Phase::Tree, 0.0);
        let bounds = Bounds::new(PointSet::Sources, sources)?;
        let root = bounds.join(Bounds::new(PointSet::Targets, targets)?).root_cube()?;
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

        report(Phase::Lists, 0.0);
        let far = self.scheme != Scheme::Direct;
        let lists = Lists::new(
            Side { tree: &target_tree, points: &targets },
            Side { tree: &source_tree, points: &sources },
            &self.mask,
            far,
            &|fraction| report(Phase::Lists, fraction),
        );
        report(Phase::Lists, 1.0);

        report(Phase::Operators, 0.0);
        let levels = levels(&lists, &source_tree, &target_tree, self.scheme);
        self.expansion.prepare(&Geometry { root, levels })?;
        report(Phase::Operators, 1.0);

        let stats = stats(&self.expansion, &lists, &source_tree, &target_tree, leaf_size);
        let plan = Plan {
            expansion: self.expansion,
            scheme: self.scheme,
            target_leaves: target_tree.leaves.clone(),
            source_tree,
            target_tree,
            sources,
            targets,
            lists,
        };
        Ok(Fmm { plan, stats, idle: Mutex::new(Vec::new()) })
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
    tree.order.par_iter().map(|&i| points[i as usize].clone()).collect()
}

/// The levels at which expansions are formed. M2P and P2L need the level of their expansion, and
/// shifts need every level between the coarsest and the finest.
fn levels<T: crate::Real>(
    lists: &Lists,
    source_tree: &Tree<T>,
    target_tree: &Tree<T>,
    scheme: Scheme,
) -> Vec<Level<T>> {
    let used = (0..target_tree.cells.len()).flat_map(|t| {
        let m2l = !lists.m2l.of(t).is_empty();
        let p2l = !lists.p2l.of(t).is_empty();
        let own = (m2l || p2l).then(|| target_tree.cells[t].level());
        let m2p = lists.m2p.of(t).iter().map(|&s| source_tree.cells[s as usize].level());
        own.into_iter().chain(m2p)
    });
    let Some(coarsest) = used.min() else { return Vec::new() };
    let finest = source_tree.levels().max(target_tree.levels());
    (coarsest..finest)
        .map(|level| {
            let targets = target_tree.level(level);
            let mut offsets: Vec<[i32; 3]> = targets
                .filter(|_| scheme == Scheme::Fmm)
                .flat_map(|t| {
                    let target = &target_tree.cells[t];
                    let list = lists.m2l.of(t).iter();
                    list.map(move |&s| source_tree.cells[s as usize].offset_to(target))
                })
                .collect();
            offsets.par_sort_unstable();
            offsets.dedup();
            let cell = target_tree.level(level).next().map(|t| &target_tree.cells[t]);
            let cell =
                cell.or_else(|| source_tree.level(level).next().map(|s| &source_tree.cells[s]));
            let half_width = cell.map_or(T::from_f64(0.0), |cell| cell.half_width());
            Level { level, half_width, offsets }
        })
        .collect()
}

fn stats<E: Expansion>(
    expansion: &E,
    lists: &Lists,
    source_tree: &Arc<Tree<RealOf<E>>>,
    target_tree: &Arc<Tree<RealOf<E>>>,
    leaf_size: usize,
) -> Stats {
    let mut stats = Stats {
        sources: source_tree.order.len(),
        targets: target_tree.order.len(),
        cells: source_tree.cells.len(),
        depth: source_tree.levels().max(target_tree.levels()).saturating_sub(1),
        leaf_size,
        terms_per_cell: 0,
        expansion_pairs: 0,
        direct_pairs: 0,
        cell_pairs: [&lists.m2l, &lists.m2p, &lists.p2l].map(|list| list.items.len() as u64),
        mask_bytes: std::mem::size_of_val(&lists.bits[..]),
    };
    if !Arc::ptr_eq(source_tree, target_tree) {
        stats.cells += target_tree.cells.len();
    }
    stats.terms_per_cell = expansion.multipole_len(stats.depth);
    for (t, target) in target_tree.nodes.iter().enumerate() {
        let targets = target.count() as u64;
        for list in [&lists.m2l, &lists.m2p, &lists.p2l] {
            let sources = list.of(t).iter().map(|&s| source_tree.nodes[s as usize].count() as u64);
            stats.expansion_pairs += targets * sources.sum::<u64>();
        }
        for run in lists.near.of(t) {
            let pairs = targets * u64::from(run.last - run.first);
            stats.direct_pairs += if run.bits == ALL {
                pairs
            } else {
                let words = &lists.bits[run.bits as usize..][..pairs.div_ceil(64) as usize];
                words.iter().map(|w| u64::from(w.count_ones())).sum()
            };
        }
    }
    stats
}
