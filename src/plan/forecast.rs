//! From trees and a sample of the lists to what a plan would cost.

use std::sync::Arc;

use crate::expansion::{ChargeOf, Expansion, RealOf, SourceOf, TargetOf, ValueOf};
use crate::interaction::lists::Run;
use crate::interaction::sampled::ListSample;
use crate::interaction::traversal::Traversal;
use crate::octree::shape::Shape;
use crate::octree::trees::Trees;
use crate::plan::Scheme;
use crate::plan::estimate::Estimate;
use crate::plan::times::Clock;

/// Foretells the cost of a plan from what there is before its lists are made.
pub(crate) struct Forecast<'a, E: Expansion> {
    pub(crate) expansion: &'a E,
    pub(crate) scheme: Scheme,
    pub(crate) trees: &'a Trees<SourceOf<E>, TargetOf<E>>,
    /// Seconds of one thread for a pair summed directly.
    pub(crate) pair_seconds: f64,
    /// Seconds that the trees took.
    pub(crate) tree_seconds: f64,
}

/// Cells of an interaction list in the midst of a volume: what leaf sizes are chosen for.
const FULL_LIST: f64 = 189.0;

/// M2P at a target costs about as much as this many pairs for each term, as does P2L of a source.
const TERM_PAIRS: usize = 4;

/// The share of M2L in what an expansion takes with full lists.
const M2L_SHARE: f64 = 2.0 / 3.0;

impl<E: Expansion> Forecast<'_, E> {
    /// What the plan with the lists that `traversal` would find would cost.
    pub(crate) fn estimate(&self, traversal: &Traversal<'_, RealOf<E>>) -> Estimate {
        let terms = self.expansion.costs(2).terms;
        let (mut clock, mut seconds) = (Clock::start(), 0.0);
        let (levels, share) = traversal.sample_lists(TERM_PAIRS * terms);
        clock.lap(&mut seconds);
        let total = levels.iter().fold(ListSample::default(), |sum, level| sum.with(1.0, level));

        let Trees { source_tree, target_tree, sources, targets, .. } = self.trees;
        let shared = Arc::ptr_eq(source_tree, target_tree);
        let far_pairs = match self.scheme {
            Scheme::Fmm => self.translated_pairs(&levels) + total.expanded_pairs,
            Scheme::Treecode { .. } => total.treecode_pairs + total.expanded_pairs,
            Scheme::Direct => 0.0,
        };
        let per_thread = self.pair_seconds / rayon::current_num_threads() as f64;
        let pairs = sources.len() as f64 * targets.len() as f64;
        Estimate {
            leaf_size: self.trees.leaf_size,
            cells: source_tree.cells.len() + if shared { 0 } else { target_tree.cells.len() },
            direct_pairs: total.direct_pairs,
            asked_pairs: total.asked_pairs,
            plan_bytes: self.trees.bytes() + list_bytes(target_tree.cells.len(), &total),
            workspace_bytes: self.workspace_bytes(&levels, terms),
            plan_seconds: self.tree_seconds + seconds / share.max(f64::MIN_POSITIVE),
            near_seconds: total.direct_pairs * per_thread,
            far_seconds: far_pairs * per_thread,
            direct_seconds: pairs * per_thread,
        }
    }

    /// What P2M, M2M, M2L, L2L and L2P would take, in pairs summed directly.
    ///
    /// An expansion says it by the leaf size s that it chooses: at that, translations for a leaf and its
    /// share of the cells above, 8/7 cells, take as long as 27 s²/8 pairs.
    fn translated_pairs(&self, levels: &[ListSample]) -> f64 {
        let balanced = self.expansion.costs(2).leaf_size(self.pair_seconds) as f64;
        let per_cell = 7.0 / 8.0 * 27.0 / 8.0 * balanced * balanced;
        let first = first_far_level(levels);
        let shape = &self.trees.target_tree.shape;
        let cells: usize = (first..shape.levels()).map(|level| shape.level(level).len()).sum();
        let m2l: f64 = levels.iter().map(|level| level.m2l).sum();
        per_cell * ((1.0 - M2L_SHARE) * cells as f64 + M2L_SHARE * m2l / FULL_LIST)
    }

    /// Bytes of charges, values and terms.
    fn workspace_bytes(&self, levels: &[ListSample], terms: usize) -> usize {
        let Trees { source_tree, target_tree, sources, targets, .. } = self.trees;
        let first = first_far_level(levels);
        let cells = |shape: &Shape| -> usize {
            (first..shape.levels()).map(|level| shape.level(level).len()).sum()
        };
        let multipoles = cells(&source_tree.shape) * terms * size_of::<E::MultipoleTerm>();
        let locals = match self.scheme {
            Scheme::Fmm => cells(&target_tree.shape) * terms * size_of::<E::LocalTerm>(),
            _ => 0,
        };
        sources.len() * size_of::<ChargeOf<E>>()
            + targets.len() * size_of::<ValueOf<E>>()
            + multipoles
            + locals
    }
}

/// The coarsest level with expansions.
fn first_far_level(levels: &[ListSample]) -> usize {
    let far = |level: &ListSample| level.m2l > 0.0;
    levels.iter().position(far).unwrap_or(usize::MAX)
}

/// Bytes of the four lists and the remembered mask.
fn list_bytes(cells: usize, total: &ListSample) -> usize {
    let starts = 4 * (cells + 1) * size_of::<usize>();
    // Most of what meets through M2P and P2L is too small for it, and becomes runs.
    let runs = (total.runs + total.m2p_p2l) * size_of::<Run>() as f64;
    let m2l = total.m2l * size_of::<u32>() as f64;
    starts + (runs + m2l + total.asked_pairs / 8.0) as usize
}
