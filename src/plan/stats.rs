//! What a plan consists of.

use std::sync::Arc;

use rayon::prelude::*;

use crate::expansion::Expansion;
use crate::interaction::lists::{ALL, Lists};
use crate::octree::shape::Node;
use crate::plan::{Plan, Scheme, Workspace};

/// What a plan consists of.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct Stats {
    /// How the plan sums.
    pub scheme: Scheme,
    /// Why sums are direct although an expansion was to carry them.
    pub fallback: Option<String>,
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
    /// Pairs of points that are left out, because all that they come to is within the tolerance.
    pub left_out_pairs: u64,
    /// Pairs of cells by M2L, M2P and P2L.
    pub cell_pairs: [u64; 3],
    /// Bytes of the trees and of the points in tree order.
    pub tree_bytes: usize,
    /// Bytes of the interaction lists.
    pub list_bytes: usize,
    /// Bytes of the remembered mask.
    pub mask_bytes: usize,
    /// Bytes of the charges, values and terms that one application works on; they are kept for the
    /// next. As many as there are applications at the same time.
    pub workspace_bytes: usize,
}

impl Stats {
    /// Bytes of trees, points, lists and mask. The expansion's operators are not among them.
    pub fn plan_bytes(&self) -> usize {
        self.tree_bytes + self.list_bytes + self.mask_bytes
    }

    /// Bytes of the plan and one workspace, per point of the larger set.
    pub fn bytes_per_point(&self) -> f64 {
        let bytes = self.plan_bytes() + self.workspace_bytes;
        bytes as f64 / self.sources.max(self.targets).max(1) as f64
    }
}

pub(crate) fn stats<E: Expansion>(plan: &Plan<E>) -> Stats {
    let Plan { expansion, source_tree, target_tree, lists, .. } = plan;
    let depth = source_tree.shape.levels().max(target_tree.shape.levels()).saturating_sub(1);
    let mut stats = Stats {
        scheme: plan.scheme,
        fallback: None,
        sources: plan.sources.len(),
        targets: plan.targets.len(),
        cells: source_tree.cells.len(),
        depth,
        leaf_size: plan.leaf_size,
        terms_per_cell: expansion.multipole_len(depth),
        expansion_pairs: 0,
        direct_pairs: 0,
        left_out_pairs: 0,
        cell_pairs: [
            lists.weighed_m2l().map(|(_, list)| list.items.len() as u64).sum(),
            lists.m2p.items.len() as u64,
            lists.p2l.items.len() as u64,
        ],
        tree_bytes: source_tree.bytes()
            + size_of_val(&plan.sources[..])
            + size_of_val(&plan.targets[..])
            + size_of_val(&plan.layout.target_ranks[..]),
        list_bytes: lists.bytes(),
        mask_bytes: lists.mask_bytes(),
        workspace_bytes: Workspace::bytes(plan),
    };
    if !Arc::ptr_eq(source_tree, target_tree) {
        stats.cells += target_tree.cells.len();
        stats.tree_bytes += target_tree.bytes();
    }
    [stats.expansion_pairs, stats.direct_pairs, stats.left_out_pairs] =
        pairs(lists, &target_tree.shape.nodes, &source_tree.shape.nodes);
    stats
}

/// Pairs of points that expansions carry, that are summed directly, and that are left out.
fn pairs(lists: &Lists, targets: &[Node], sources: &[Node]) -> [u64; 3] {
    let pairs = |(t, target): (usize, &Node)| {
        let targets = target.count() as u64;
        let sources_of = |&s: &u32| sources[s as usize].count() as u64;
        let m2l = lists.weighed_m2l().map(|(_, list)| list);
        let far = m2l.chain([&lists.m2p, &lists.p2l]).flat_map(|list| list.of(t));
        let left_out = lists.left_out.of(t).iter().map(sources_of).sum::<u64>();
        let far = far.map(sources_of).sum::<u64>();
        [targets * far, near_pairs(lists, t, targets), targets * left_out]
    };
    let sum = |a: [u64; 3], b: [u64; 3]| std::array::from_fn(|k| a[k] + b[k]);
    targets.par_iter().enumerate().map(pairs).reduce(|| [0; 3], sum)
}

/// Pairs of points in the near field of target cell `t`, which has this many targets.
fn near_pairs(lists: &Lists, t: usize, targets: u64) -> u64 {
    let pairs = lists.near.of(t).iter().map(|run| {
        let pairs = targets * u64::from(run.last - run.first);
        if run.bits == ALL {
            return pairs;
        }
        let words = &lists.bits[run.bits as usize..][..pairs.div_ceil(64) as usize];
        words.iter().map(|w| u64::from(w.count_ones())).sum()
    });
    pairs.sum::<u64>() + lists.shares_of(t).len() as u64
}
