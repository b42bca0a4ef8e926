//! Interaction lists: which pairs of cells meet through which operator.

use crate::interaction::grouped::Grouped;
use crate::octree::shape::{Node, Shape};

/// The four lists, each grouped by target cell.
#[derive(Clone, Debug)]
pub(crate) struct Lists {
    /// Source cells of the same level, well separated.
    pub(crate) m2l: Grouped<u32>,
    /// Source cells of the same level, well separated, of which a part counts: by the number of
    /// eighths. Empty if there are none.
    pub(crate) weighed: Vec<(u8, Grouped<u32>)>,
    /// For target leaves: smaller source cells, well separated.
    pub(crate) m2p: Grouped<u32>,
    /// For target cells: larger source leaves, well separated.
    pub(crate) p2l: Grouped<u32>,
    /// Source cells of the same level, well separated, of which too little comes to be summed.
    pub(crate) left_out: Grouped<u32>,
    /// For target leaves: sources that are summed directly, in tree order.
    pub(crate) near: Grouped<Run>,
    /// One bit per pair of every run that is partly masked.
    pub(crate) bits: Vec<u64>,
    /// For target leaves: pairs that count in part. No groups if there are none.
    pub(crate) shares: Grouped<PairShare>,
    /// The distinct offsets from source to target cell in `m2l`, ascending, for each level of the
    /// target tree.
    pub(crate) offsets: Vec<Vec<[i32; 3]>>,
    /// Source cells that would have to be opened, but whose children are elsewhere, ascending. The lists are complete
    /// once there are none.
    pub(crate) wanted: Vec<u32>,
}

/// A contiguous run of sources, in tree order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Run {
    /// Its first source.
    pub(crate) first: u32,
    /// One past its last source.
    pub(crate) last: u32,
    /// Where its bits start in [`Lists::bits`], or [`ALL`]. Bit i·n + j is the pair of the leaf's
    /// i-th target and the run's j-th of n sources.
    pub(crate) bits: u64,
}

/// A pair of points that counts in part, by their places in tree order.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct PairShare {
    pub(crate) target: u32,
    pub(crate) source: u32,
    /// Between 0 and 1.
    pub(crate) share: f64,
}

/// The value of [`Run::bits`] for runs in which every pair counts.
pub(crate) const ALL: u64 = u64::MAX;

/// The value of [`Run::bits`] for runs in which no pair counts; they are dropped.
pub(crate) const NONE: u64 = u64::MAX - 1;

impl Run {
    /// All sources of a cell, every pair counting.
    pub(crate) fn all(node: &Node) -> Self {
        let points = node.points();
        Self { first: points.start as u32, last: points.end as u32, bits: ALL }
    }
}

impl Lists {
    /// Sums directly what an expansion would not make cheaper: moves the pairs of cells that
    /// `costs` says are too small from their lists to the near runs of the target leaves.
    pub(crate) fn sum_small_directly(
        &mut self,
        targets: &Shape,
        sources: &Shape,
        costs: &ListCosts,
    ) {
        let pays = |node: &Node, costs: &[usize]| node.count() > costs[node.level()];
        let by_m2p = |_: usize, s: u32| pays(&sources.nodes[s as usize], &costs.m2p);
        let by_p2l = |t: usize, _: u32| !costs.treecode && pays(&targets.nodes[t], &costs.p2l);
        let by_m2l = |t: usize, s: u32| !costs.treecode || by_m2p(t, s);
        if self.m2p.all(by_m2p) && self.p2l.all(by_p2l) && self.m2l.all(by_m2l) {
            return;
        }

        let moved_from = |t: usize, runs: &mut Vec<Run>| {
            let mut move_down = |list: &Grouped<u32>, t, stays: &dyn Fn(usize, u32) -> bool| {
                let moved = list.of(t).iter().filter(|&&s| !stays(t, s));
                runs.extend(moved.map(|&s| Run::all(&sources.nodes[s as usize])));
            };
            move_down(&self.m2p, t, &by_m2p);
            for cell in targets.path_to_root(t) {
                move_down(&self.p2l, cell, &by_p2l);
                if costs.treecode {
                    move_down(&self.m2l, cell, &by_m2l);
                }
            }
        };
        self.near = rebuilt(&self.near, |t, runs| {
            if targets.nodes[t].is_leaf() {
                moved_from(t, runs);
            }
        });
        self.m2p = self.m2p.filtered(by_m2p);
        self.p2l = self.p2l.filtered(by_p2l);
        if costs.treecode {
            self.m2l = self.m2l.filtered(by_m2l);
        }
    }

    /// Sums directly what comes through the coarsest levels, as far as that is next to nothing beside
    /// what is summed directly anyway: a few points far from all others would ask for expansions on every
    /// level between them. With a mask, everything stays as it is: runs do not tell how many of their pairs count.
    /// O(cells and their pairs).
    pub(crate) fn sum_few_directly(&mut self, targets: &Shape, sources: &Shape) {
        if self.weighed.is_empty() && self.bits.is_empty() {
            let (near, by_level) = self.pairs_of_points(targets, sources);
            self.sum_directly_above(first_level_of_many(near, &by_level), targets, sources);
        }
    }

    /// Sums directly what comes through the levels above `first`. O(cells and their pairs).
    pub(crate) fn sum_directly_above(&mut self, first: usize, targets: &Shape, sources: &Shape) {
        let is_coarse = |node: &Node| node.level() < first;
        let is_met = |t: usize| !(self.m2l.of(t).is_empty() && self.p2l.of(t).is_empty());
        let mut coarse = (0..first).flat_map(|level| targets.level(level));
        let is_coarse_source = |s: u32| is_coarse(&sources.nodes[s as usize]);
        let stays = !coarse.any(is_met) && self.m2p.all(|_, s| !is_coarse_source(s));
        if stays {
            return;
        }
        self.near = rebuilt(&self.near, |t, runs| {
            if targets.nodes[t].is_leaf() {
                let above = targets.path_to_root(t).filter(|&cell| is_coarse(&targets.nodes[cell]));
                let inherited =
                    above.flat_map(|cell| self.m2l.of(cell).iter().chain(self.p2l.of(cell)));
                let own = self.m2p.of(t).iter().filter(|&&s| is_coarse_source(s));
                let moved = inherited.chain(own);
                runs.extend(moved.map(|&s| Run::all(&sources.nodes[s as usize])));
            }
        });
        let to_fine = |t: usize, _: u32| !is_coarse(&targets.nodes[t]);
        self.m2l = self.m2l.filtered(to_fine);
        self.p2l = self.p2l.filtered(to_fine);
        self.m2p = self.m2p.filtered(|_, s| !is_coarse_source(s));
        self.offsets.iter_mut().take(first).for_each(Vec::clear);
    }

    /// The M2L lists with their weights.
    pub(crate) fn weighed_m2l(&self) -> impl Iterator<Item = (f64, &Grouped<u32>)> {
        let weighed = self.weighed.iter().map(|(eighths, list)| (f64::from(*eighths) / 8.0, list));
        std::iter::once((1.0, &self.m2l)).chain(weighed)
    }

    /// Whether all of so many sources are summed directly at every target, and every pair counts.
    pub(crate) fn is_direct(&self, targets: &Shape, sources: usize) -> bool {
        let all = [Run { first: 0, last: sources as u32, bits: ALL }];
        let meets_all = |&leaf: &u32| *self.near.of(leaf as usize) == all;
        self.shares.items.is_empty() && targets.leaves.iter().all(meets_all)
    }

    /// Whether target cell `t` receives anything by M2L.
    pub(crate) fn has_m2l(&self, t: usize) -> bool {
        self.weighed_m2l().any(|(_, list)| !list.of(t).is_empty())
    }

    /// The pairs of target leaf `t` that count in part.
    pub(crate) fn shares_of(&self, t: usize) -> &[PairShare] {
        if self.shares.items.is_empty() { &[] } else { self.shares.of(t) }
    }

    /// Bytes of what is remembered of a mask: bits and shares.
    pub(crate) fn mask_bytes(&self) -> usize {
        let shares = if self.shares.items.is_empty() { 0 } else { self.shares.bytes() };
        size_of_val(&self.bits[..]) + shares
    }

    /// How many pairs of points are summed directly, and how many meet through each level, those of targets that are
    /// here.
    pub(crate) fn pairs_of_points(&self, targets: &Shape, sources: &Shape) -> (u64, Vec<u64>) {
        let product = |t: usize, sources: u64| {
            (targets.nodes[t].points().len() as u64).saturating_mul(sources)
        };
        let count = |s: &u32| sources.nodes[*s as usize].count() as u64;
        let of_runs = |&leaf: &u32| {
            let runs = self.near.of(leaf as usize).iter();
            product(leaf as usize, runs.map(|run| u64::from(run.last - run.first)).sum())
        };
        let near = targets.leaves.iter().map(of_runs).fold(0, u64::saturating_add);
        let mut m2p = vec![0u64; sources.levels()];
        for &leaf in &targets.leaves {
            for s in self.m2p.of(leaf as usize) {
                let sum = &mut m2p[sources.nodes[*s as usize].level()];
                *sum = sum.saturating_add(product(leaf as usize, count(s)));
            }
        }
        let by_level = |level: usize| {
            let met = |t: usize| self.m2l.of(t).iter().chain(self.p2l.of(t)).map(count).sum();
            let of_cells = targets.level(level).map(|t| product(t, met(t)));
            let of_level = of_cells.fold(0, u64::saturating_add);
            of_level.saturating_add(m2p.get(level).copied().unwrap_or_default())
        };
        let levels = targets.levels().max(sources.levels());
        (near, (0..levels).map(by_level).collect())
    }

    /// Its size in memory, without what is remembered of a mask.
    pub(crate) fn bytes(&self) -> usize {
        let weighed: usize = self.weighed.iter().map(|(_, list)| list.bytes()).sum();
        let far = self.m2l.bytes() + weighed + self.m2p.bytes() + self.p2l.bytes();
        far + self.left_out.bytes() + self.near.bytes()
    }
}

/// The coarsest level through which pairs of points meet that are not [few](FEW), those of all levels above it counted
/// with it.
pub(crate) fn first_level_of_many(near: u64, by_level: &[u64]) -> usize {
    let mut far = 0u64;
    let many = by_level.iter().position(|of_level| {
        far = far.saturating_add(*of_level);
        far > near / FEW
    });
    many.unwrap_or(by_level.len())
}

/// Pairs of points are few if they are no more than this fraction of those that are summed directly.
const FEW: u64 = 16;

/// From how many points on an expansion is cheaper than direct summation, level by level.
#[derive(Debug)]
pub(crate) struct ListCosts {
    /// Pairs summed directly that cost as much as M2P at one target.
    pub(crate) m2p: Vec<usize>,
    /// Pairs summed directly that cost as much as P2L of one source.
    pub(crate) p2l: Vec<usize>,
    /// Whether there are no local expansions: the pairs of `m2l` are evaluated by M2P at each target
    /// below, and those of `p2l` have to be summed directly.
    pub(crate) treecode: bool,
}

/// Appends a run of sources to those from `start` on, joining it to the last if everything counts in
/// both.
pub(crate) fn append(runs: &mut Vec<Run>, start: usize, run: Run) {
    match runs[start..].last_mut() {
        Some(last) if last.last == run.first && last.bits == ALL && run.bits == ALL => {
            last.last = run.last;
        }
        _ => runs.push(run),
    }
}

/// The runs of every target cell with those that `add` adds, in the order of their sources, without
/// those of which nothing is left.
pub(crate) fn rebuilt(
    near: &Grouped<Run>,
    add: impl Fn(usize, &mut Vec<Run>) + Sync,
) -> Grouped<Run> {
    near.mapped(|t, runs, out| {
        let mut runs: Vec<Run> = runs.iter().copied().filter(|run| run.bits != NONE).collect();
        add(t, &mut runs);
        runs.sort_unstable_by_key(|run| run.first);
        let start = out.len();
        runs.into_iter().for_each(|run| append(out, start, run));
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_runs_join_where_they_touch_and_empty_ones_go() {
        let run = |first, last, bits| Run { first, last, bits };
        let mut near = Grouped::default();
        near.push_group([run(4, 6, ALL), run(6, 9, NONE), run(9, 12, 64)]);
        near.push_group([run(12, 20, ALL)]);
        let added = rebuilt(&near, |t, runs| {
            if t == 0 {
                runs.extend([run(0, 4, ALL), run(12, 13, ALL), run(7, 8, ALL)]);
            }
        });
        let expected = [run(0, 6, ALL), run(7, 8, ALL), run(9, 12, 64), run(12, 13, ALL)];
        assert_eq!(added.of(0), expected);
        assert_eq!(added.of(1), [run(12, 20, ALL)]);
    }
}
