//! A plan and what an application of it writes to.

pub(crate) mod builder;
pub(crate) mod candidates;
pub(crate) mod charge_sums;
pub(crate) mod choice;
pub(crate) mod choices;
pub(crate) mod estimate;
pub(crate) mod fmm;
pub(crate) mod forecast;
pub(crate) mod guard;
pub(crate) mod layout;
pub(crate) mod near;
pub(crate) mod near_pairs;
pub(crate) mod norms;
pub(crate) mod pair_time;
pub(crate) mod passes;
pub(crate) mod part;
pub(crate) mod ready;
pub(crate) mod report;
pub(crate) mod sampled_target;
pub(crate) mod stats;
pub(crate) mod times;
pub(crate) mod trial;
pub(crate) mod tuning;
pub(crate) mod update;
pub(crate) mod upward;

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::expansion::geometry::Level;
use crate::expansion::{ChargeOf, Expansion, RealOf, SourceOf, TargetOf, ValueOf};
use crate::interaction::lists::{ListCosts, Lists};
use crate::numbers::traits::{Numbers, Real};
use crate::octree::geometry::Cube;
use crate::octree::tree::Tree;
use crate::octree::trees::Trees;
use crate::parallel::pool::Pool;
use crate::plan::layout::{Layout, Parts};
use crate::plan::near::Gathered;

/// How a plan sums. All schemes give the same sums; they differ in cost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub enum Scheme {
    /// Every pair: O(N²).
    Direct,
    /// Multipoles evaluated at every target: O(N log N).
    Treecode {
        /// Whether parents take their moments from their children (M2M) instead of from their
        /// sources.
        m2m: bool,
    },
    /// Multipoles turned into local expansions, evaluated once per target: O(N).
    Fmm,
}

impl Scheme {
    /// Whether parents take their moments from their children.
    pub(crate) fn shifts_moments(self) -> bool {
        self != (Self::Treecode { m2m: false })
    }
}

impl fmt::Display for Scheme {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Direct => "direct",
            Self::Treecode { m2m: false } => "treecode without m2m",
            Self::Treecode { m2m: true } => "treecode",
            Self::Fmm => "fmm",
        })
    }
}

/// What a sum needs besides charges.
pub(crate) struct Plan<E: Expansion> {
    pub(crate) expansion: E,
    pub(crate) scheme: Scheme,
    /// The relative error that a pair of the near field may be off by.
    pub(crate) pair_tolerance: f64,
    pub(crate) root: Cube<RealOf<E>>,
    /// The largest number of points in a leaf that can be split.
    pub(crate) leaf_size: usize,
    pub(crate) source_tree: Arc<Tree<RealOf<E>>>,
    pub(crate) target_tree: Arc<Tree<RealOf<E>>>,
    /// Sources in tree order.
    pub(crate) sources: Vec<SourceOf<E>>,
    /// Targets in tree order.
    pub(crate) targets: Vec<TargetOf<E>>,
    pub(crate) lists: Lists,
    pub(crate) layout: Layout,
}

impl<E: Expansion> Plan<E> {
    /// The plan with these lists and an expansion that is prepared for them.
    pub(crate) fn new(
        expansion: E,
        scheme: Scheme,
        trees: Trees<SourceOf<E>, TargetOf<E>>,
        mut lists: Lists,
    ) -> Self {
        let levels = trees.levels();
        let Trees { root, leaf_size, source_tree, target_tree, sources, targets } = trees;
        let by_level =
            |of: &dyn Fn(usize) -> usize| -> Vec<usize> { (0..levels).map(of).collect() };
        let costs = ListCosts {
            m2p: by_level(&|level| expansion.costs(level).m2p_pairs),
            p2l: by_level(&|level| expansion.costs(level).p2l_pairs),
            treecode: scheme != Scheme::Fmm,
        };
        lists.sum_small_directly(&target_tree.shape, &source_tree.shape, &costs);
        let layout = Layout::new(&Parts {
            sources: &source_tree.shape,
            targets: &target_tree.shape,
            lists: &lists,
            costs: &costs,
            multipole_lens: &by_level(&|level| expansion.multipole_len(level)),
            local_lens: &by_level(&|level| expansion.local_len(level)),
            shift_moments: scheme.shifts_moments(),
        });
        let pair_tolerance = expansion.costs(levels.saturating_sub(1)).pair_tolerance;
        Self {
            expansion,
            scheme,
            pair_tolerance,
            root,
            leaf_size,
            source_tree,
            target_tree,
            sources,
            targets,
            lists,
            layout,
        }
    }

    /// Trees and points, once more.
    pub(crate) fn trees(&self) -> Trees<SourceOf<E>, TargetOf<E>> {
        Trees {
            root: self.root,
            leaf_size: self.leaf_size,
            source_tree: Arc::clone(&self.source_tree),
            target_tree: Arc::clone(&self.target_tree),
            sources: self.sources.clone(),
            targets: self.targets.clone(),
        }
    }

    /// What another plan can be made of.
    pub(crate) fn into_parts(self) -> (E, Trees<SourceOf<E>, TargetOf<E>>) {
        let Self { expansion, root, leaf_size, source_tree, target_tree, sources, targets, .. } =
            self;
        (expansion, Trees { root, leaf_size, source_tree, target_tree, sources, targets })
    }
}

/// Everything that one application writes to, kept from one to the next.
pub(crate) struct Workspace<E: Expansion> {
    /// Charges in tree order.
    pub(crate) charges: Vec<ChargeOf<E>>,
    /// Values in tree order.
    pub(crate) values: Vec<ValueOf<E>>,
    /// Multipole terms, level by level, cell after cell.
    pub(crate) multipoles: Vec<Vec<E::MultipoleTerm>>,
    /// For each level, a number that no multipole term of cells elsewhere is larger than; none if all are here.
    pub(crate) largest_elsewhere: Vec<f64>,
    /// Local terms, likewise.
    pub(crate) locals: Vec<Vec<E::LocalTerm>>,
    /// For every entry of the P2L list, whether the expansion declined it.
    pub(crate) p2l_declined: Vec<AtomicBool>,
    pub(crate) gathered: Pool<Gathered<E::Kernel>>,
}

impl<E: Expansion> Workspace<E> {
    pub(crate) fn new(plan: &Plan<E>) -> Self {
        let Layout { multipole_terms, local_terms, .. } = &plan.layout;
        Self {
            charges: vec![Numbers::zero(); plan.sources.len()],
            values: vec![Numbers::zero(); plan.targets.len()],
            multipoles: multipole_terms.iter().map(|&n| vec![Numbers::zero(); n]).collect(),
            largest_elsewhere: Vec::new(),
            locals: local_terms.iter().map(|&n| vec![Numbers::zero(); n]).collect(),
            p2l_declined: plan.lists.p2l.items.iter().map(|_| AtomicBool::new(false)).collect(),
            gathered: Pool::default(),
        }
    }

    /// The size in memory of a workspace for `plan`.
    pub(crate) fn bytes(plan: &Plan<E>) -> usize {
        let Layout { multipole_terms, local_terms, .. } = &plan.layout;
        plan.sources.len() * size_of::<ChargeOf<E>>()
            + plan.targets.len() * size_of::<ValueOf<E>>()
            + multipole_terms.iter().sum::<usize>() * size_of::<E::MultipoleTerm>()
            + local_terms.iter().sum::<usize>() * size_of::<E::LocalTerm>()
            + plan.lists.p2l.items.len() * size_of::<AtomicBool>()
    }
}

/// The levels at which expansions are formed. M2P and P2L need the level of their expansion, and
/// shifts need every level between the coarsest and the finest.
pub(crate) fn levels<T: Real>(
    lists: &Lists,
    source_tree: &Tree<T>,
    target_tree: &Tree<T>,
    scheme: Scheme,
) -> Vec<Level<T>> {
    // Cells are stored from the coarsest level to the finest, so the first is on the coarsest.
    let groups = 0..target_tree.cells.len();
    let receives = |&t: &usize| lists.has_m2l(t) || !lists.p2l.of(t).is_empty();
    let local = groups.into_iter().find(receives).map(|t| target_tree.shape.nodes[t].level());
    let m2p = lists.m2p.items.iter().min();
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
            let cells = target_tree.shape.level(level);
            let pairs =
                lists.weighed_m2l().map(|(_, l)| l.starts[cells.end] - l.starts[cells.start]);
            let offsets = offsets.cloned().unwrap_or_default();
            Level { pairs: pairs.sum(), ..Level::new(level, half_width, offsets) }
        })
        .collect()
}
