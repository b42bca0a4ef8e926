//! What follows from trees and lists and is needed at every application: which cells take part, how
//! many terms each level has, and how the work at the leaves is cut into tasks.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use rayon::prelude::*;

use crate::interaction::lists::{ListCosts, Lists};
use crate::octree::shape::Shape;
use crate::plan::tuning::TASKS;

/// The layout of a plan.
#[derive(Debug)]
pub(crate) struct Layout {
    /// Whether a source cell's multipole terms are used.
    pub(crate) multipole: Vec<bool>,
    /// Whether a target cell has local terms.
    pub(crate) local: Vec<bool>,
    /// Multipole terms of all cells of each level of the source tree; none where no cell's are used.
    pub(crate) multipole_terms: Vec<usize>,
    /// Local terms, likewise.
    pub(crate) local_terms: Vec<usize>,
    /// The place in tree order of each of the caller's targets.
    pub(crate) target_ranks: Vec<u32>,
    /// Whether all pairs are summed directly, so that leaves don't matter.
    pub(crate) is_direct: bool,
    /// Consecutive target leaves, as ranges in [`Shape::leaves`], of about the same work.
    pub(crate) tasks: Vec<Range<usize>>,
}

/// What a layout follows from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Parts<'a> {
    pub(crate) sources: &'a Shape,
    pub(crate) targets: &'a Shape,
    pub(crate) lists: &'a Lists,
    pub(crate) costs: &'a ListCosts,
    /// Multipole terms of a cell, level by level.
    pub(crate) multipole_lens: &'a [usize],
    /// Local terms of a cell, level by level.
    pub(crate) local_lens: &'a [usize],
    /// Whether parents take their moments from their children.
    pub(crate) shift_moments: bool,
}

impl Layout {
    pub(crate) fn new(parts: &Parts<'_>) -> Self {
        let multipole = multipoles_used(parts);
        let local = locals_used(parts);
        Self {
            multipole_terms: terms(parts.sources, &multipole, parts.multipole_lens),
            local_terms: terms(parts.targets, &local, parts.local_lens),
            target_ranks: parts.targets.ranks(),
            is_direct: parts.lists.is_direct(parts.targets, parts.sources.order.len()),
            tasks: tasks(&leaf_work(parts, &local)),
            multipole,
            local,
        }
    }
}

/// Calls `visit` for each leaf of `tasks`, by its number, with its part of `values`, in parallel.
pub(crate) fn for_each_leaf<V: Send>(
    shape: &Shape,
    tasks: &[Range<usize>],
    mut values: &mut [V],
    visit: &(dyn Fn(usize, &mut [V]) + Sync),
) {
    let points = |leaf: usize| shape.nodes[shape.leaves[leaf] as usize].points();
    match tasks {
        [] => (),
        [task] => {
            for leaf in task.clone() {
                let (us, rest) = values.split_at_mut(points(leaf).len());
                visit(leaf, us);
                values = rest;
            }
        }
        _ => {
            let (left, right) = tasks.split_at(tasks.len() / 2);
            let middle = points(right[0].start).start - points(left[0].start).start;
            let (before, after) = values.split_at_mut(middle);
            rayon::join(
                || for_each_leaf(shape, left, before, visit),
                || for_each_leaf(shape, right, after, visit),
            );
        }
    }
}

fn multipoles_used(parts: &Parts<'_>) -> Vec<bool> {
    let Parts { sources, lists, .. } = parts;
    let used: Vec<AtomicBool> = sources.nodes.iter().map(|_| AtomicBool::new(false)).collect();
    for (_, list) in lists.weighed_m2l().chain([(1.0, &lists.m2p)]) {
        list.items.par_iter().for_each(|&s| {
            // Most are set already: reading leaves the cache line shared.
            let used = &used[s as usize];
            if !used.load(Relaxed) {
                used.store(true, Relaxed);
            }
        });
    }
    let mut used: Vec<bool> = used.into_iter().map(AtomicBool::into_inner).collect();
    if parts.shift_moments {
        for s in 1..used.len() {
            used[s] |= used[sources.nodes[s].parent as usize];
        }
    }
    used
}

fn locals_used(parts: &Parts<'_>) -> Vec<bool> {
    let Parts { targets, lists, .. } = parts;
    let mut used = vec![false; targets.nodes.len()];
    if !parts.costs.treecode {
        for t in 0..used.len() {
            used[t] = used[targets.nodes[t].parent as usize]
                || lists.has_m2l(t)
                || !lists.p2l.of(t).is_empty();
        }
    }
    used
}

/// The terms of each level in which a cell is used.
fn terms(shape: &Shape, used: &[bool], lens: &[usize]) -> Vec<usize> {
    let terms = |level| {
        let cells = shape.level(level);
        if used[cells.clone()].contains(&true) { cells.len() * lens[level] } else { 0 }
    };
    (0..shape.levels()).map(terms).collect()
}

/// What every target leaf costs, in units of a pair summed directly.
fn leaf_work(parts: &Parts<'_>, local: &[bool]) -> Vec<u64> {
    let Parts { sources, targets, lists, costs, local_lens, .. } = parts;
    let m2p = |s: u32| costs.m2p[sources.nodes[s as usize].level()] as u64;
    let work = |&t: &u32| {
        let t = t as usize;
        let runs = lists.near.of(t).iter().map(|run| u64::from(run.last - run.first));
        let mut per_target = runs.sum::<u64>();
        let mut add = |work: u64| per_target = per_target.saturating_add(work);
        if local[t] {
            add(local_lens[targets.nodes[t].level()] as u64);
        }
        lists.m2p.of(t).iter().for_each(|&s| add(m2p(s)));
        if costs.treecode {
            let inherited = targets.path_to_root(t).flat_map(|cell| lists.m2l.of(cell));
            inherited.for_each(|&s| add(m2p(s)));
        }
        per_target.saturating_mul(targets.nodes[t].count() as u64)
    };
    targets.leaves.par_iter().map(work).collect()
}

/// Cuts pieces of the given work into tasks.
fn tasks(work: &[u64]) -> Vec<Range<usize>> {
    let total = work.iter().fold(0u64, |sum, &w| sum.saturating_add(w));
    let share = total / TASKS + 1;
    let mut tasks = Vec::new();
    let (mut first, mut sum) = (0, 0u64);
    for (piece, &w) in work.iter().enumerate() {
        sum = sum.saturating_add(w);
        if sum >= share || piece + 1 == work.len() {
            tasks.push(first..piece + 1);
            (first, sum) = (piece + 1, 0);
        }
    }
    tasks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tasks_cover_all_pieces_and_share_the_work() {
        let work: Vec<u64> = (0..50_000).map(|i| i * i % 1009).collect();
        let tasks = tasks(&work);
        let mut next = 0;
        let share = work.iter().sum::<u64>() / TASKS + 1;
        for task in &tasks {
            assert_eq!(task.start, next);
            next = task.end;
            assert!(work[task.clone()].iter().sum::<u64>() < share + 1009, "{task:?}");
        }
        assert_eq!(next, work.len());
        assert!(tasks.len() <= TASKS as usize + 1);
        assert_eq!(super::tasks(&[u64::MAX, u64::MAX, 0]), [0..1, 1..2, 2..3]);
        assert!(super::tasks(&[]).is_empty());
    }
}
