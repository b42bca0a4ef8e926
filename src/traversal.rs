//! The traversal that finds the interaction lists.
//!
//! It starts at the pair of roots and ends each branch in exactly one of four lists, or in none
//! where the mask says that no pair counts. Every pair of points is therefore taken once or, if
//! masked, never.
//!
//! It goes down the target tree level by level: what a cell does not settle with a source cell, it
//! hands down to its children. Each target cell is visited by one task and writes its own lists, so
//! they come out grouped by target, in an order that no number of threads changes.

use rayon::prelude::*;

use crate::geometry::Cell;
use crate::grouped::Grouped;
use crate::kernel::Kernel;
use crate::lists::{ALL, Lists, NONE, Run, append, for_each_set_bit, rebuilt};
use crate::mask::{CellView, Coverage, Mask};
use crate::offsets::OffsetSet;
use crate::parallel;
use crate::real::Located;
use crate::shape::Node;
use crate::tree::Tree;

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
        &self.tree.shape.nodes[cell as usize]
    }

    fn cell(&self, cell: u32) -> &'a Cell<P::Real> {
        &self.tree.cells[cell as usize]
    }

    fn view(&self, cell: u32) -> CellView<'a, P> {
        CellView { cell: self.cell(cell), points: &self.points[self.node(cell).points()] }
    }
}

/// What expansions do for pairs of cells that are well separated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Far {
    /// Nothing: every pair that counts is near.
    Nothing,
    /// They carry pairs that count in full.
    Whole,
    /// They also carry pairs that count in part.
    Weighed,
}

/// Finds the pairs of cells.
pub(crate) struct Traversal<'a, K: Kernel, M> {
    pub(crate) targets: Side<'a, K::Target>,
    pub(crate) sources: Side<'a, K::Source>,
    pub(crate) mask: &'a M,
    pub(crate) far: Far,
}

/// A source cell that a target cell has to settle with.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Candidate {
    source: u32,
    /// Whether every pair of points is known to count.
    full: bool,
}

/// A source cell of which a part counts.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Weighed {
    source: u32,
    eighths: u8,
}

/// What a stretch of target cells finds.
#[derive(Default)]
pub(crate) struct Found {
    pub(crate) m2l: Grouped<u32>,
    pub(crate) weighed: Grouped<Weighed>,
    pub(crate) m2p: Grouped<u32>,
    pub(crate) p2l: Grouped<u32>,
    pub(crate) near: Grouped<Run>,
    /// Handed down to the children.
    pub(crate) open: Grouped<Candidate>,
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
    /// Finds the lists. `progress` is told the fraction of partly masked pairs that have been asked
    /// for.
    pub(crate) fn lists(&self, progress: &(dyn Fn(f64) + Sync)) -> Lists {
        let (mut lists, partial) = self.run();
        if !partial.is_empty() {
            let answers = ask_all(self.targets, self.sources, self.mask, &partial, progress);
            fill_in(&mut lists, &partial, answers);
        }
        lists
    }

    /// The lists, with the runs that are partly masked.
    fn run(&self) -> (Lists, Vec<PartialPair>) {
        let shape = &self.targets.tree.shape;
        let mut found: Vec<Found> = Vec::new();
        let mut offsets = Vec::new();
        let mut open = Grouped::default();
        open.push_group(self.at_root());
        for level in 0..shape.levels() {
            let cells = shape.level(level);
            // The root is its own parent, and takes the only group there is.
            let first_parent = shape.level(level.saturating_sub(1)).start;
            let stretch = (cells.len() / STRETCHES).clamp(1, STRETCH);
            let mut parts = parallel::map(cells.len().div_ceil(stretch), &|part| {
                let first = cells.start + part * stretch;
                let (mut found, mut near) = (Found::default(), Vec::new());
                for t in first..(first + stretch).min(cells.end) {
                    let parent = shape.nodes[t].parent as usize;
                    let candidates = open.of(parent - first_parent);
                    self.visit(t as u32, candidates, &mut near, &mut found);
                }
                found
            });
            open = join_open(&mut parts);
            offsets.push(OffsetSet::ascending(parts.iter().map(|part| &part.offsets)));
            found.append(&mut parts);
        }
        join(found, offsets)
    }

    /// What the root of the targets has to settle with.
    pub(crate) fn at_root(&self) -> Option<Candidate> {
        (!self.sources.points.is_empty()).then_some(Candidate { source: 0, full: false })
    }

    /// Settles a target cell with every candidate, or hands it down. `near` is scratch.
    pub(crate) fn visit(
        &self,
        t: u32,
        candidates: &[Candidate],
        near: &mut Vec<Candidate>,
        found: &mut Found,
    ) {
        for &candidate in candidates {
            self.meet(t, candidate, near, found);
        }
        sort_by_place(near, &self.sources.tree.shape.nodes);
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
        found.weighed.end_group();
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
                Coverage::Eighths(eighths) => {
                    if self.weigh(t, s, eighths, found) {
                        return;
                    }
                    false
                }
            };
        if full && self.far != Far::Nothing {
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
        let source_is_whole = sources.node(s).is_leaf() || (full && self.far == Far::Nothing);
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

impl<K: Kernel, M> Traversal<'_, K, M> {
    /// Puts a pair that counts in part into its list, if an expansion can carry it.
    fn weigh(&self, t: u32, s: u32, eighths: u8, found: &mut Found) -> bool {
        let (target, source) = (self.targets.cell(t), self.sources.cell(s));
        if self.far != Far::Weighed
            || target.level() != source.level()
            || !(1..8).contains(&eighths)
        {
            return false;
        }
        let offset = source.offset_to(target);
        let separated = offset.iter().any(|o| o.unsigned_abs() > 1);
        if separated {
            found.offsets.insert(offset);
            found.weighed.items.push(Weighed { source: s, eighths });
        }
        separated
    }
}

/// What the cells of a level hand down.
fn join_open(parts: &mut [Found]) -> Grouped<Candidate> {
    Grouped::join(parts.iter_mut().map(|part| std::mem::take(&mut part.open)))
}

/// The lists of all stretches, with the pairs of leaves that are partly masked.
fn join(mut found: Vec<Found>, offsets: Vec<Vec<[i32; 3]>>) -> (Lists, Vec<PartialPair>) {
    let mut partial = Vec::new();
    let mut runs = 0;
    for part in &found {
        let shifted = |pair: &PartialPair| PartialPair { run: pair.run + runs, ..*pair };
        partial.extend(part.partial.iter().map(shifted));
        runs += part.near.items.len();
    }
    let weighed = Grouped::join(found.iter_mut().map(|part| std::mem::take(&mut part.weighed)));
    let of_weight = |eighths: u8| {
        weighed.mapped(|_, items, out| {
            let own = items.iter().filter(|pair: &&Weighed| pair.eighths == eighths);
            out.extend(own.map(|pair| pair.source));
        })
    };
    let lists = Lists {
        weighed: match weighed.items.is_empty() {
            true => Vec::new(),
            false => (1..8).map(|eighths| (eighths, of_weight(eighths))).collect(),
        },
        m2l: Grouped::join(found.iter_mut().map(|part| std::mem::take(&mut part.m2l))),
        m2p: Grouped::join(found.iter_mut().map(|part| std::mem::take(&mut part.m2p))),
        p2l: Grouped::join(found.iter_mut().map(|part| std::mem::take(&mut part.p2l))),
        near: Grouped::join(found.iter_mut().map(|part| std::mem::take(&mut part.near))),
        bits: Vec::new(),
        offsets,
    };
    (lists, partial)
}

/// Leaf pairs between two calls of a progress callback.
const PROGRESS_STEP: usize = 64;

/// The mask's answers for one pair of leaves.
#[derive(Clone)]
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
    let is_mirrored = std::ptr::eq(targets.tree, sources.tree)
        && mask.is_mirrored(targets.points, sources.points);
    let asked = if is_mirrored { without_images(partial) } else { partial.to_vec() };
    let done = std::sync::atomic::AtomicUsize::new(0);
    let answer = |pair: &PartialPair| {
        let answer = ask(mask, targets.view(pair.target), sources.view(pair.source));
        let done = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
        if done.is_multiple_of(PROGRESS_STEP) || done == asked.len() {
            progress(done as f64 / asked.len() as f64);
        }
        answer
    };
    let answers: Vec<Answer> = parallel::map(asked.len(), &|i| answer(&asked[i]));
    if !is_mirrored {
        return answers;
    }
    let find = |pair: &PartialPair| {
        let index = asked.partition_point(|other| image(other) < image(pair));
        match asked[index].target == pair.target {
            true => answers[index].clone(),
            false => {
                let size = |cell: u32| targets.node(cell).count();
                answers[index].transposed(size(pair.source), size(pair.target))
            }
        }
    };
    parallel::map(partial.len(), &|i| find(&partial[i]))
}

/// The pairs of which each of `partial` is one, or the mirror image of one, by their [`image`]s.
fn without_images(partial: &[PartialPair]) -> Vec<PartialPair> {
    let mut asked = partial.to_vec();
    asked.par_sort_unstable_by_key(|pair| (image(pair), pair.target));
    asked.dedup_by_key(|pair| image(pair));
    asked
}

/// What a pair has in common with its mirror image.
fn image(pair: &PartialPair) -> (u32, u32) {
    (pair.target.min(pair.source), pair.target.max(pair.source))
}

/// Sorts cells by where their points are.
fn sort_by_place(cells: &mut [Candidate], nodes: &[Node]) {
    cells.sort_unstable_by_key(|cell| nodes[cell.source as usize].points().start);
}

impl Answer {
    /// The answer for `columns` targets and `rows` sources, from that for `rows` targets and
    /// `columns` sources.
    fn transposed(&self, rows: usize, columns: usize) -> Self {
        let Self::Partial(words) = self else { return self.clone() };
        let mut transposed = vec![0u64; words.len()];
        for i in 0..rows {
            for_each_set_bit(words, i, columns, |j| {
                let bit = j * rows + i;
                transposed[bit / 64] |= 1 << (bit % 64);
            });
        }
        Self::Partial(transposed)
    }
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

/// Gives the runs that are partly masked their bits.
fn fill_in(lists: &mut Lists, partial: &[PartialPair], answers: Vec<Answer>) {
    for (pair, answer) in partial.iter().zip(answers) {
        let bits = &mut lists.near.items[pair.run].bits;
        *bits = match answer {
            Answer::Empty => NONE,
            Answer::Full => ALL,
            Answer::Partial(words) => {
                let start = lists.bits.len() as u64;
                lists.bits.extend(words);
                start
            }
        };
    }
    lists.near = rebuilt(&lists.near, |_, _| ());
}
