//! Interaction lists: which pairs of cells meet through which operator.
//!
//! A traversal of both trees starts at the pair of roots and ends each branch in exactly one of
//! four lists, or in none where the mask says that no pair counts. Every pair of points is
//! therefore taken once or, if masked, never.
//!
//! It goes down the target tree level by level: what a cell does not settle with a source cell, it
//! hands down to its children. Each target cell is visited by one task and writes its own lists, so
//! they come out grouped by target, in an order that no number of threads changes.

use rayon::prelude::*;

use crate::geometry::Cell;
use crate::grouped::Grouped;
use crate::kernel::Kernel;
use crate::mask::{CellView, Coverage, Mask};
use crate::offsets::OffsetSet;
use crate::real::{Located, Real};
use crate::tree::{Node, Tree};

/// The four lists, each grouped by target cell.
#[derive(Debug)]
pub(crate) struct Lists {
    /// Source cells of the same level, well separated.
    pub(crate) m2l: Grouped<u32>,
    /// For target leaves: smaller source cells, well separated.
    pub(crate) m2p: Grouped<u32>,
    /// For target cells: larger source leaves, well separated.
    pub(crate) p2l: Grouped<u32>,
    /// For target leaves: sources that are summed directly, in tree order.
    pub(crate) near: Grouped<Run>,
    /// One bit per pair of every run that is partly masked.
    pub(crate) bits: Vec<u64>,
    /// The distinct offsets from source to target cell in `m2l`, ascending, for each level of the
    /// target tree.
    pub(crate) offsets: Vec<Vec<[i32; 3]>>,
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

/// The value of [`Run::bits`] for runs in which every pair counts.
pub(crate) const ALL: u64 = u64::MAX;

/// The value of [`Run::bits`] for runs in which no pair counts; they are dropped.
const NONE: u64 = u64::MAX - 1;

impl Run {
    /// All sources of a cell, every pair counting.
    fn all(node: &Node) -> Self {
        let points = node.points();
        Self { first: points.start as u32, last: points.end as u32, bits: ALL }
    }
}

/// One set of points with its tree, the points in tree order.
pub(crate) struct Side<'a, P: Located> {
    pub(crate) tree: &'a Tree<P::Real>,
    pub(crate) points: &'a [P],
}

impl<P: Located> Clone for Side<'_, P> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<P: Located> Copy for Side<'_, P> {}

impl<'a, P: Located> Side<'a, P> {
    fn node(&self, cell: u32) -> &'a Node {
        &self.tree.nodes[cell as usize]
    }

    fn cell(&self, cell: u32) -> &'a Cell<P::Real> {
        &self.tree.cells[cell as usize]
    }

    fn view(&self, cell: u32) -> CellView<'a, P> {
        CellView { cell: self.cell(cell), points: &self.points[self.node(cell).points()] }
    }
}

impl Lists {
    /// Builds the lists. Without `far`, every pair that counts is near. `progress` is told the
    /// fraction of partly masked pairs that have been asked for.
    pub(crate) fn new<K: Kernel>(
        targets: Side<'_, K::Target>,
        sources: Side<'_, K::Source>,
        mask: &impl Mask<K>,
        far: bool,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Self {
        let (mut lists, partial) = Traversal { targets, sources, mask, far }.run();
        if !partial.is_empty() {
            let answers = ask_all(targets, sources, mask, &partial, progress);
            lists.fill_in(&partial, answers);
        }
        lists
    }

    /// Sums directly what an expansion would not make cheaper: moves the pairs of cells that
    /// `costs` says are too small from their lists to the near runs of the target leaves.
    pub(crate) fn sum_small_directly<T: Real>(
        &mut self,
        targets: &Tree<T>,
        sources: &Tree<T>,
        costs: &Costs,
    ) {
        let pays = |tree: &Tree<T>, cell: usize, costs: &[usize]| {
            tree.nodes[cell].count() > costs[tree.cells[cell].level()]
        };
        let by_m2p = |_: usize, s: u32| pays(sources, s as usize, &costs.m2p);
        let by_p2l = |t: usize, _: u32| !costs.treecode && pays(targets, t, &costs.p2l);
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

    /// Its size in memory, without the bits.
    pub(crate) fn bytes(&self) -> usize {
        self.m2l.bytes() + self.m2p.bytes() + self.p2l.bytes() + self.near.bytes()
    }

    /// Gives the runs that are partly masked their bits.
    fn fill_in(&mut self, partial: &[PartialPair], answers: Vec<Answer>) {
        for (pair, answer) in partial.iter().zip(answers) {
            let bits = &mut self.near.items[pair.run].bits;
            *bits = match answer {
                Answer::Empty => NONE,
                Answer::Full => ALL,
                Answer::Partial(words) => {
                    let start = self.bits.len() as u64;
                    self.bits.extend(words);
                    start
                }
            };
        }
        self.near = rebuilt(&self.near, |_, _| ());
    }
}

/// From how many points on an expansion is cheaper than direct summation, level by level.
#[derive(Debug)]
pub(crate) struct Costs {
    /// Pairs summed directly that cost as much as M2P at one target.
    pub(crate) m2p: Vec<usize>,
    /// Pairs summed directly that cost as much as P2L of one source.
    pub(crate) p2l: Vec<usize>,
    /// Whether there are no local expansions: the pairs of `m2l` are evaluated by M2P at each target
    /// below, and those of `p2l` have to be summed directly.
    pub(crate) treecode: bool,
}

/// Calls `visit(j)` for every set bit j of row `i` in a block of `columns` columns.
pub(crate) fn for_each_set_bit(
    bits: &[u64],
    i: usize,
    columns: usize,
    mut visit: impl FnMut(usize),
) {
    let mut j = 0;
    while j < columns {
        let bit = i * columns + j;
        let width = (64 - bit % 64).min(columns - j);
        let mut word = bits[bit / 64] >> (bit % 64);
        if width < 64 {
            word &= (1 << width) - 1;
        }
        while word != 0 {
            visit(j + word.trailing_zeros() as usize);
            word &= word - 1;
        }
        j += width;
    }
}

/// Finds the pairs of cells.
struct Traversal<'a, K: Kernel, M> {
    targets: Side<'a, K::Target>,
    sources: Side<'a, K::Source>,
    mask: &'a M,
    far: bool,
}

/// A source cell that a target cell has to settle with.
#[derive(Clone, Copy, Debug, Default)]
struct Candidate {
    source: u32,
    /// Whether every pair of points is known to count.
    full: bool,
}

/// What a stretch of target cells finds.
#[derive(Default)]
struct Found {
    m2l: Grouped<u32>,
    m2p: Grouped<u32>,
    p2l: Grouped<u32>,
    near: Grouped<Run>,
    /// Handed down to the children.
    open: Grouped<Candidate>,
    /// Pairs of leaves that are partly masked; their runs count from the start of the stretch.
    partial: Vec<PartialPair>,
    offsets: OffsetSet,
}

/// Two leaves of which the mask has to be asked for every pair.
#[derive(Clone, Copy)]
struct PartialPair {
    target: u32,
    source: u32,
    /// Index of its run.
    run: usize,
}

/// Stretches that a level is cut into, and the most target cells in one.
const STRETCHES: usize = 256;
const STRETCH: usize = 64;

impl<K: Kernel, M: Mask<K>> Traversal<'_, K, M> {
    /// The lists, with the runs that are partly masked.
    fn run(&self) -> (Lists, Vec<PartialPair>) {
        let tree = self.targets.tree;
        let mut found: Vec<Found> = Vec::new();
        let mut offsets = Vec::new();
        let mut open = Grouped::default();
        let roots_meet = !self.sources.points.is_empty();
        open.push_group(roots_meet.then_some(Candidate { source: 0, full: false }));
        for level in 0..tree.levels() {
            let cells = tree.level(level);
            // The root is its own parent, and takes the only group there is.
            let first_parent = tree.level(level.saturating_sub(1)).start;
            let stretch = (cells.len() / STRETCHES).clamp(1, STRETCH);
            let mut parts: Vec<Found> = cells
                .clone()
                .into_par_iter()
                .step_by(stretch)
                .map(|first| {
                    let (mut found, mut near) = (Found::default(), Vec::new());
                    for t in first..(first + stretch).min(cells.end) {
                        let parent = tree.nodes[t].parent as usize;
                        let candidates = open.of(parent - first_parent);
                        self.visit(t as u32, candidates, &mut near, &mut found);
                    }
                    found
                })
                .collect();
            open = Grouped::join(parts.iter_mut().map(|part| std::mem::take(&mut part.open)));
            offsets.push(OffsetSet::ascending(parts.iter().map(|part| &part.offsets)));
            found.append(&mut parts);
        }

        let mut partial = Vec::new();
        let mut runs = 0;
        for part in &found {
            let shifted = |pair: &PartialPair| PartialPair { run: pair.run + runs, ..*pair };
            partial.extend(part.partial.iter().map(shifted));
            runs += part.near.items.len();
        }
        let lists = Lists {
            m2l: Grouped::join(found.iter_mut().map(|part| std::mem::take(&mut part.m2l))),
            m2p: Grouped::join(found.iter_mut().map(|part| std::mem::take(&mut part.m2p))),
            p2l: Grouped::join(found.iter_mut().map(|part| std::mem::take(&mut part.p2l))),
            near: Grouped::join(found.iter_mut().map(|part| std::mem::take(&mut part.near))),
            bits: Vec::new(),
            offsets,
        };
        (lists, partial)
    }

    /// Settles a target cell with every candidate, or hands it down. `near` is scratch.
    fn visit(
        &self,
        t: u32,
        candidates: &[Candidate],
        near: &mut Vec<Candidate>,
        found: &mut Found,
    ) {
        for &candidate in candidates {
            self.meet(t, candidate, near, found);
        }
        near.sort_unstable_by_key(|n| self.sources.node(n.source).points().start);
        let start = found.near.items.len();
        for Candidate { source, full } in near.drain(..) {
            if !full {
                let run = found.near.items.len();
                found.partial.push(PartialPair { target: t, source, run });
            }
            let bits = if full { ALL } else { NONE };
            let run = Run { bits, ..Run::all(self.sources.node(source)) };
            append(&mut found.near.items, start, run);
        }
        found.m2l.end_group();
        found.m2p.end_group();
        found.p2l.end_group();
        found.near.end_group();
        found.open.end_group();
    }

    /// Puts one pair of cells into a list or opens the pairs of their children.
    fn meet(&self, t: u32, candidate: Candidate, near: &mut Vec<Candidate>, found: &mut Found) {
        let Self { targets, sources, .. } = self;
        let s = candidate.source;
        let full = candidate.full
            || match self.mask.cells(targets.view(t), sources.view(s)) {
                Coverage::Empty => return,
                Coverage::Full => true,
                Coverage::Partial => false,
            };
        if full && self.far {
            let (target, source) = (targets.cell(t), sources.cell(s));
            if target.level() == source.level() {
                let offset = source.offset_to(target);
                // Well separated, for cells of one level.
                if offset.iter().any(|o| o.unsigned_abs() > 1) {
                    found.offsets.insert(offset);
                    return found.m2l.items.push(s);
                }
            } else if target.well_separated(source) {
                let list =
                    if target.level() < source.level() { &mut found.m2p } else { &mut found.p2l };
                return list.items.push(s);
            }
        }
        // With no far field, a full pair needs its target leaves only.
        let source_is_whole = sources.node(s).is_leaf() || (full && !self.far);
        let children = sources.node(s).children();
        let children = children.map(|s| Candidate { source: s as u32, full });
        match (targets.node(t).is_leaf(), source_is_whole) {
            (true, true) => near.push(Candidate { source: s, full }),
            (true, false) => children.for_each(|child| self.meet(t, child, near, found)),
            (false, true) => found.open.items.push(Candidate { source: s, full }),
            (false, false) => found.open.items.extend(children),
        }
    }
}

/// Appends a run of sources to those from `start` on, joining it to the last if everything counts in
/// both.
fn append(runs: &mut Vec<Run>, start: usize, run: Run) {
    match runs[start..].last_mut() {
        Some(last) if last.last == run.first && last.bits == ALL && run.bits == ALL => {
            last.last = run.last;
        }
        _ => runs.push(run),
    }
}

/// The runs of every target cell with those that `add` adds, in the order of their sources, without
/// those of which nothing is left.
fn rebuilt(near: &Grouped<Run>, add: impl Fn(usize, &mut Vec<Run>) + Sync) -> Grouped<Run> {
    near.mapped(|t, runs, out| {
        let mut runs: Vec<Run> = runs.iter().copied().filter(|run| run.bits != NONE).collect();
        add(t, &mut runs);
        runs.sort_unstable_by_key(|run| run.first);
        let start = out.len();
        runs.into_iter().for_each(|run| append(out, start, run));
    })
}

/// Leaf pairs between two calls of a progress callback.
const PROGRESS_STEP: usize = 64;

/// The mask's answers for one pair of leaves.
enum Answer {
    Empty,
    Full,
    Partial(Vec<u64>),
}

/// Asks the mask for every pair of points of the partly masked pairs of leaves.
fn ask_all<K: Kernel>(
    targets: Side<'_, K::Target>,
    sources: Side<'_, K::Source>,
    mask: &impl Mask<K>,
    partial: &[PartialPair],
    progress: &(dyn Fn(f64) + Sync),
) -> Vec<Answer> {
    let done = std::sync::atomic::AtomicUsize::new(0);
    let answer = |pair: &PartialPair| {
        let answer = ask(mask, targets.view(pair.target), sources.view(pair.source));
        let done = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
        if done.is_multiple_of(PROGRESS_STEP) || done == partial.len() {
            progress(done as f64 / partial.len() as f64);
        }
        answer
    };
    partial.par_iter().map(answer).collect()
}

fn ask<K: Kernel>(
    mask: &impl Mask<K>,
    targets: CellView<'_, K::Target>,
    sources: CellView<'_, K::Source>,
) -> Answer {
    let columns = sources.points.len();
    let pairs = targets.points.len() * columns;
    let mut words = vec![0u64; pairs.div_ceil(64)];
    mask.pairs(targets, sources, &mut |i, j| {
        let bit = i * columns + j;
        words[bit / 64] |= 1 << (bit % 64);
    });
    match words.iter().map(|word| word.count_ones() as usize).sum() {
        0 => Answer::Empty,
        set if set == pairs => Answer::Full,
        _ => Answer::Partial(words),
    }
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

    #[test]
    fn set_bits_are_visited_across_word_borders() {
        let columns = 50;
        let set = |i: usize, j: usize| (i * 7 + j * 3).is_multiple_of(5) || j == 49;
        let mut bits = vec![0u64; 3 * columns / 64 + 1];
        for i in 0..3 {
            for j in (0..columns).filter(|&j| set(i, j)) {
                bits[(i * columns + j) / 64] |= 1 << ((i * columns + j) % 64);
            }
        }
        for i in 0..3 {
            let mut seen = Vec::new();
            for_each_set_bit(&bits, i, columns, |j| seen.push(j));
            assert_eq!(seen, (0..columns).filter(|&j| set(i, j)).collect::<Vec<_>>());
        }
    }
}
