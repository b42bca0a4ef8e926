//! Direct sums at single targets, in twice the working precision: what an application is held against.

use std::ops::Range;

use crate::expansion::{ChargeOf, Expansion, RealOf, TargetOf, ValueOf};
use crate::interaction::lists::ALL;
use crate::kernel::traits::Kernel;
use crate::numbers::bits::for_each_set_bit;
use crate::numbers::double_word::DoubleWord;
use crate::numbers::traits::{Numbers, Real};
use crate::parallel;
use crate::parallel::watch::Watch;
use crate::plan::Plan;

/// Sums the pairs of a plan one by one: those that its lists hold, so that a mask need not be asked
/// again.
pub(crate) struct Reference<'a, E: Expansion> {
    pub(crate) plan: &'a Plan<E>,
    /// Charges in tree order.
    pub(crate) charges: &'a [ChargeOf<E>],
    /// Sums that it stops are not finished.
    pub(crate) watch: &'a Watch,
}

/// The sum at a target.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ReferenceSum<V> {
    /// Over the pairs that the plan sums directly.
    pub(crate) near: DoubleWord<V>,
    /// Over all pairs.
    pub(crate) all: DoubleWord<V>,
    /// Σ_j ‖K(x, y_j) q_j‖ over all pairs.
    pub(crate) absolute: f64,
}

/// Targets that are summed side by side.
const BLOCK: usize = 64;

/// Sources between two looks at the watch.
const UNWATCHED: usize = 64;

/// Sources per task.
const SECTION: usize = 1 << 14;

impl<E: Expansion> Reference<'_, E> {
    /// The sums at targets that are given by their places in tree order. Each K(x, y) q is rounded as
    /// the kernel rounds it; their sum is off by at most 2 N u² Σ_j ‖K(x, y_j) q_j‖ for N sources and
    /// unit round-off u. O(N) per target.
    pub(crate) fn sums(&self, targets: &[usize]) -> Vec<ReferenceSum<ValueOf<E>>> {
        let mut sums = parallel::map(targets.len(), &|i| self.listed(targets[i]));
        let whole = |&i: &usize| sums[i].1;
        let whole: Vec<usize> = (0..targets.len()).filter(whole).collect();
        let xs: Vec<TargetOf<E>> =
            whole.iter().map(|&i| self.plan.targets[targets[i]].clone()).collect();
        for (&i, (all, absolute)) in whole.iter().zip(self.over_all_sources(&xs)) {
            let sum = &mut sums[i].0;
            (sum.all, sum.absolute) = (all, absolute);
        }
        sums.into_iter().map(|(sum, _)| sum).collect()
    }

    /// The sum over the pairs in the lists of a target; or only its near part, and true, if every source
    /// counts in full.
    fn listed(&self, target: usize) -> (ReferenceSum<ValueOf<E>>, bool) {
        let Plan { lists, source_tree, target_tree, .. } = self.plan;
        let nodes = &target_tree.shape.nodes;
        let leaves = &target_tree.shape.leaves;
        let leaf = leaves.partition_point(|&leaf| nodes[leaf as usize].points().end <= target);
        let leaf = leaves[leaf] as usize;
        let x = &self.plan.targets[target..=target];
        let mut sums = Sums::zero(1);
        let mut counted = 0;
        for run in lists.near.of(leaf) {
            let run_sources = run.first as usize..run.last as usize;
            if run.bits == ALL {
                counted += run_sources.len();
                self.add(x, run_sources, 1.0, &mut sums);
            } else {
                let row = target - nodes[leaf].points().start;
                let bits = &lists.bits[run.bits as usize..];
                for_each_set_bit(bits, row, run_sources.len(), |j| {
                    let j = run_sources.start + j;
                    self.add(x, j..j + 1, 1.0, &mut sums);
                });
            }
        }
        for pair in lists.shares_of(leaf).iter().filter(|pair| pair.target as usize == target) {
            let j = pair.source as usize;
            self.add(x, j..j + 1, pair.share, &mut sums);
        }
        let near = sums.values[0].clone();

        let mut far: Vec<(f64, Range<usize>)> = Vec::new();
        let cells = |list: &[u32], weight: f64, far: &mut Vec<_>| {
            let points = |&s: &u32| (weight, source_tree.shape.nodes[s as usize].points());
            far.extend(list.iter().map(points));
        };
        cells(lists.m2p.of(leaf), 1.0, &mut far);
        for cell in target_tree.shape.path_to_root(leaf) {
            cells(lists.p2l.of(cell), 1.0, &mut far);
            lists.weighed_m2l().for_each(|(weight, list)| cells(list.of(cell), weight, &mut far));
        }
        let in_full = |(weight, points): &(f64, Range<usize>)| {
            if *weight == 1.0 { points.len() } else { 0 }
        };
        let whole = counted + far.iter().map(in_full).sum::<usize>() == self.charges.len();
        if !whole {
            for (weight, points) in far {
                self.add(x, points, weight, &mut sums);
            }
        }
        let (all, absolute) = (sums.values[0].clone(), sums.absolute[0]);
        (ReferenceSum { near, all, absolute }, whole)
    }

    /// The sums over all sources at `xs`, and those of the pairs' magnitudes.
    fn over_all_sources(&self, xs: &[TargetOf<E>]) -> Vec<(DoubleWord<ValueOf<E>>, f64)> {
        let sources = self.charges.len();
        let sections: Vec<Range<usize>> = (0..sources)
            .step_by(SECTION)
            .map(|first| first..(first + SECTION).min(sources))
            .collect();
        let block = |xs: &[TargetOf<E>]| {
            let parts = parallel::map(sections.len(), &|i| {
                let mut sums = Sums::zero(xs.len());
                self.add(xs, sections[i].clone(), 1.0, &mut sums);
                sums
            });
            let mut total = Sums::zero(xs.len());
            parts.iter().for_each(|part| total.add(part));
            total.values.into_iter().zip(total.absolute).collect::<Vec<_>>()
        };
        let blocks: Vec<_> = xs.chunks(BLOCK).collect();
        parallel::map(blocks.len(), &|i| block(blocks[i])).into_iter().flatten().collect()
    }

    /// Adds the fields of `sources` at `xs`, one pair at a time.
    fn add(
        &self,
        xs: &[TargetOf<E>],
        sources: Range<usize>,
        weight: f64,
        sums: &mut Sums<ValueOf<E>>,
    ) {
        let kernel = self.plan.expansion.kernel();
        let ys = self.plan.sources[sources.clone()].chunks(1);
        for (k, (y, q)) in ys.zip(self.charges[sources].chunks(1)).enumerate() {
            if k % UNWATCHED == 0 && self.watch.is_stopped() {
                return;
            }
            sums.pairs.fill(Numbers::zero());
            kernel.add_block(xs, y, q, 0.0, &mut sums.pairs);
            if weight != 1.0 {
                let weight = <RealOf<E> as Real>::from_f64(weight);
                for pair in &mut sums.pairs {
                    let whole = std::mem::replace(pair, Numbers::zero());
                    pair.add_scaled(weight, &whole);
                }
            }
            sums.take_pairs();
        }
    }
}

/// Sums over pairs at several targets, side by side.
#[derive(Clone, Debug)]
struct Sums<V> {
    values: Vec<DoubleWord<V>>,
    /// The sums of the pairs' magnitudes.
    absolute: Vec<f64>,
    /// One pair for each target.
    pairs: Vec<V>,
}

impl<V: Numbers> Sums<V> {
    fn zero(targets: usize) -> Self {
        Self {
            values: vec![DoubleWord::zero(); targets],
            absolute: vec![0.0; targets],
            pairs: vec![V::zero(); targets],
        }
    }

    fn take_pairs(&mut self) {
        for (value, pair) in self.values.iter_mut().zip(&self.pairs) {
            value.accumulate(pair);
        }
        for (absolute, pair) in self.absolute.iter_mut().zip(&self.pairs) {
            *absolute += pair.norm();
        }
    }

    fn add(&mut self, other: &Self) {
        for (value, other) in self.values.iter_mut().zip(&other.values) {
            value.add(other);
        }
        for (absolute, other) in self.absolute.iter_mut().zip(&other.absolute) {
            *absolute += other;
        }
    }
}
