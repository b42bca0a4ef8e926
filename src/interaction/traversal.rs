//! The traversal that finds the interaction lists.
//!
//! It starts at the pair of roots and ends each branch in exactly one of four lists, or in none
//! where the mask says that no pair counts. Every pair of points is therefore taken once or, if
//! masked, never.
//!
//! It goes down the target tree level by level: what a cell does not settle with a source cell, it
//! hands down to its children. Each target cell is visited by one task and writes its own lists, so
//! they come out grouped by target, in an order that no number of threads changes.

use crate::expansion::admissibility::Admissibility;
use crate::interaction::cell_mask::{CellMask, PartialPair, ask_all, fill_in};
use crate::interaction::grouped::Grouped;
use crate::interaction::lists::{ALL, Lists, NONE, PairShare, Run, append};
use crate::interaction::offsets::OffsetSet;
use crate::kernel::mask::Coverage;
use crate::numbers::compiled::Compiled;
use crate::numbers::traits::Real;
use crate::octree::geometry::{Cell, MAX_OFFSET};
use crate::octree::shape::Node;
use crate::octree::tree::Tree;
use crate::parallel;
use crate::parallel::watch::Watch;

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
pub(crate) struct Traversal<'a, T: Real> {
    pub(crate) targets: &'a Tree<T>,
    pub(crate) sources: &'a Tree<T>,
    pub(crate) mask: &'a dyn CellMask,
    pub(crate) far: Far,
    /// Which well-separated cells expansions carry.
    pub(crate) admissibility: &'a Admissibility,
    /// Once it is stopped, what is found is not used.
    pub(crate) watch: &'a Watch,
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
    pub(crate) left_out: Grouped<u32>,
    pub(crate) near: Grouped<Run>,
    /// Handed down to the children.
    pub(crate) open: Grouped<Candidate>,
    /// Source cells that would have to be opened, but whose children are elsewhere.
    wanted: Vec<u32>,
    /// Pairs of leaves that are partly masked; their runs count from the start of the stretch.
    partial: Vec<PartialPair>,
    offsets: OffsetSet,
}

/// Stretches that a level is cut into, and the most target cells in one.
const STRETCHES: usize = 256;
const STRETCH: usize = 64;

/// Found lists, with the runs that are partly masked.
type RunOf<T> = fn(&Traversal<'_, T>) -> (Lists, Vec<PartialPair>);
static RUN: Compiled<RunOf<f32>, RunOf<f64>> = Compiled(compiled, compiled);

fn compiled<T: Real>(traversal: &Traversal<'_, T>) -> (Lists, Vec<PartialPair>) {
    traversal.run()
}

impl<T: Real> Traversal<'_, T> {
    /// Finds the lists. `progress` is told the fraction of partly masked pairs that have been asked
    /// for.
    ///
    /// # Errors
    /// The first pair that counts by a share that is not a number from 0 to 1.
    pub(crate) fn lists(&self, progress: &(dyn Fn(f64) + Sync)) -> Result<Lists, PairShare> {
        let (mut lists, partial) = RUN.of::<RunOf<T>>()(self);
        if !partial.is_empty() {
            let count = |cell: u32| self.targets.shape.nodes[cell as usize].count();
            let answers = ask_all(self.mask, &count, &partial, progress, self.watch);
            fill_in(&mut lists, &self.targets.shape, &partial, answers)?;
        }
        Ok(lists)
    }

    /// The lists of a mask that lets every pair count.
    pub(crate) fn unmasked(&self) -> Lists {
        RUN.of::<RunOf<T>>()(self).0
    }

    /// The lists, with the runs that are partly masked.
    fn run(&self) -> (Lists, Vec<PartialPair>) {
        let shape = &self.targets.shape;
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
                    if self.watch.is_stopped() {
                        break;
                    }
                    let parent = shape.nodes[t].parent as usize;
                    let candidates = open.of(parent - first_parent);
                    self.visit(t as u32, candidates, &mut near, &mut found);
                }
                found
            });
            open = join_open(&mut parts);
            offsets.push(OffsetSet::ascending(parts.iter().map(|part| &part.offsets)));
            found.append(&mut parts);
            if self.watch.is_stopped() {
                return (join(found, offsets).0, Vec::new());
            }
        }
        join(found, offsets)
    }

    /// What the root of the targets has to settle with.
    pub(crate) fn at_root(&self) -> Option<Candidate> {
        (!self.sources.shape.nodes.is_empty()).then_some(Candidate { source: 0, full: false })
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
        let nodes = &self.sources.shape.nodes;
        sort_by_place(near, nodes);
        let start = found.near.items.len();
        for Candidate { source, full } in near.drain(..) {
            if !full {
                let run = found.near.items.len();
                found.partial.push(PartialPair { target: t, source, run });
            }
            let bits = if full { ALL } else { NONE };
            let run = Run { bits, ..Run::all(&nodes[source as usize]) };
            append(&mut found.near.items, start, run);
        }
        found.m2l.end_group();
        found.weighed.end_group();
        found.m2p.end_group();
        found.p2l.end_group();
        found.left_out.end_group();
        found.near.end_group();
        found.open.end_group();
    }

    /// Puts one pair of cells into a list or opens the pairs of their children.
    fn meet(&self, t: u32, candidate: Candidate, near: &mut Vec<Candidate>, found: &mut Found) {
        let s = candidate.source;
        let full = candidate.full
            || match self.mask.cells(t, s) {
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
            let (target, source) = self.cells(t, s);
            if target.level() == source.level() {
                let offset = source.offset_to(target);
                if is_far(offset) {
                    match self.admissibility.of(target.level(), offset) {
                        Coverage::Empty => return found.left_out.items.push(s),
                        Coverage::Full => {
                            found.offsets.insert(offset);
                            return found.m2l.items.push(s);
                        }
                        Coverage::Partial | Coverage::Eighths(_) => {}
                    }
                }
            } else if target.well_separated(source) && self.is_carried(target, source) {
                let list =
                    if target.level() < source.level() { &mut found.m2p } else { &mut found.p2l };
                return list.items.push(s);
            }
        }
        // With no far field, a full pair needs its target leaves only.
        let source = &self.sources.shape.nodes[s as usize];
        let source_is_whole = source.is_leaf() || (full && self.far == Far::Nothing);
        if source.is_closed() && !source_is_whole {
            return found.wanted.push(s);
        }
        let children = source.children();
        let children = children.map(|s| Candidate { source: s as u32, full });
        match (self.targets.shape.nodes[t as usize].is_leaf(), source_is_whole) {
            (true, true) => near.push(Candidate { source: s, full }),
            (true, false) => children.for_each(|child| self.meet(t, child, near, found)),
            (false, true) => found.open.items.push(Candidate { source: s, full }),
            (false, false) => found.open.items.extend(children),
        }
    }

    /// Puts a pair that counts in part into its list, if an expansion can carry it.
    fn weigh(&self, t: u32, s: u32, eighths: u8, found: &mut Found) -> bool {
        let (target, source) = self.cells(t, s);
        if self.far != Far::Weighed
            || target.level() != source.level()
            || !(1..8).contains(&eighths)
        {
            return false;
        }
        let offset = source.offset_to(target);
        let is_carried =
            is_far(offset) && self.admissibility.of(target.level(), offset) == Coverage::Full;
        if is_carried {
            found.offsets.insert(offset);
            found.weighed.items.push(Weighed { source: s, eighths });
        }
        is_carried
    }

    /// Whether expansions carry pairs between cells of different levels that are well separated.
    fn is_carried(&self, target: &Cell<T>, source: &Cell<T>) -> bool {
        let [a, b] = [target.level(), source.level()];
        self.admissibility.between(a.min(b), a.max(b))
    }

    /// A target cell and a source cell.
    fn cells(&self, t: u32, s: u32) -> (&Cell<T>, &Cell<T>) {
        (&self.targets.cells[t as usize], &self.sources.cells[s as usize])
    }
}

/// Whether cells of one level are well separated, and not too far apart for their offset to be told.
#[inline]
fn is_far(offset: [i32; 3]) -> bool {
    offset.iter().any(|o| o.unsigned_abs() > 1) && offset.iter().all(|o| o.abs() < MAX_OFFSET)
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
    let mut wanted: Vec<u32> = found.iter_mut().flat_map(|part| part.wanted.drain(..)).collect();
    wanted.sort_unstable();
    wanted.dedup();
    let of_weight = |eighths: u8| {
        weighed.mapped(|_, items, out| {
            let own = items.iter().filter(|pair: &&Weighed| pair.eighths == eighths);
            out.extend(own.map(|pair| pair.source));
        })
    };
    let lists = Lists {
        weighed: if weighed.items.is_empty() {
            Vec::new()
        } else {
            (1..8).map(|eighths| (eighths, of_weight(eighths))).collect()
        },
        m2l: Grouped::join(found.iter_mut().map(|part| std::mem::take(&mut part.m2l))),
        m2p: Grouped::join(found.iter_mut().map(|part| std::mem::take(&mut part.m2p))),
        p2l: Grouped::join(found.iter_mut().map(|part| std::mem::take(&mut part.p2l))),
        left_out: Grouped::join(found.iter_mut().map(|part| std::mem::take(&mut part.left_out))),
        near: Grouped::join(found.iter_mut().map(|part| std::mem::take(&mut part.near))),
        bits: Vec::new(),
        shares: Grouped::default(),
        offsets,
        wanted,
    };
    (lists, partial)
}

/// Sorts cells by where their points are.
fn sort_by_place(cells: &mut [Candidate], nodes: &[Node]) {
    cells.sort_unstable_by_key(|cell| nodes[cell.source as usize].points().start);
}
