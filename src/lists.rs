//! Interaction lists: which pairs of cells meet through which operator.
//!
//! A traversal of both trees starts at the pair of roots and ends each branch in exactly one of
//! four lists, or in none where the mask says that no pair counts. Every pair of points is
//! therefore taken once or, if masked, never.

use rayon::prelude::*;

use crate::kernel::Kernel;
use crate::mask::{CellView, Coverage, Mask};
use crate::real::{Located, Real};
use crate::tree::Tree;

/// The four lists, each grouped by target cell.
#[derive(Debug)]
pub(crate) struct Lists {
    /// Source cells of the same level, well separated.
    pub(crate) m2l: Grouped<u32>,
    /// For target leaves: smaller source cells, well separated.
    pub(crate) m2p: Grouped<u32>,
    /// For target cells: larger source leaves, well separated.
    pub(crate) p2l: Grouped<u32>,
    /// For target leaves: sources that are summed directly.
    pub(crate) near: Grouped<Run>,
    /// One bit per pair of every run that is partly masked.
    pub(crate) bits: Vec<u64>,
}

/// A contiguous run of sources, in tree order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

/// Items grouped by target cell.
#[derive(Debug)]
pub(crate) struct Grouped<V> {
    /// For each target cell, where its items start; one more entry ends the last.
    pub(crate) starts: Vec<u32>,
    /// The items.
    pub(crate) items: Vec<V>,
}

impl<V: Copy> Grouped<V> {
    /// The items of target cell `t`.
    pub(crate) fn of(&self, t: usize) -> &[V] {
        &self.items[self.starts[t] as usize..self.starts[t + 1] as usize]
    }

    /// Groups `pairs` by their first entry, keeping the order within a group.
    fn new(groups: usize, pairs: &[(u32, V)]) -> Self {
        let mut starts = vec![0u32; groups + 1];
        for &(t, _) in pairs {
            starts[t as usize + 1] += 1;
        }
        for t in 0..groups {
            starts[t + 1] += starts[t];
        }
        let mut next = starts.clone();
        let mut items: Vec<V> = pairs.iter().map(|&(_, item)| item).collect();
        for &(t, item) in pairs {
            items[next[t as usize] as usize] = item;
            next[t as usize] += 1;
        }
        Self { starts, items }
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
    fn view(&self, cell: u32) -> CellView<'a, P> {
        CellView {
            cell: &self.tree.cells[cell as usize],
            points: &self.points[self.tree.nodes[cell as usize].points()],
        }
    }

    fn is_leaf(&self, cell: u32) -> bool {
        self.tree.nodes[cell as usize].is_leaf()
    }

    fn children(&self, cell: u32) -> impl Iterator<Item = u32> + 'a {
        self.tree.nodes[cell as usize].children().map(|c| c as u32)
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
        let found = traverse(targets, sources, mask, far);
        let groups = targets.tree.cells.len();
        let (near, bits) = runs(targets, sources, mask, &found.near, progress);
        Self {
            m2l: Grouped::new(groups, &found.m2l),
            m2p: Grouped::new(groups, &found.m2p),
            p2l: Grouped::new(groups, &found.p2l),
            near: Grouped::new(groups, &near),
            bits,
        }
    }
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

/// What a traversal finds: pairs (target cell, source cell).
#[derive(Default)]
struct Found {
    m2l: Vec<(u32, u32)>,
    m2p: Vec<(u32, u32)>,
    p2l: Vec<(u32, u32)>,
    near: Vec<(u32, NearCell)>,
    /// Pairs to be looked at next, with whether every pair of points is known to count.
    open: Vec<(u32, u32, bool)>,
}

#[derive(Clone, Copy)]
struct NearCell {
    source: u32,
    full: bool,
}

impl Found {
    fn append(&mut self, mut other: Self) {
        self.m2l.append(&mut other.m2l);
        self.m2p.append(&mut other.m2p);
        self.p2l.append(&mut other.p2l);
        self.near.append(&mut other.near);
        self.open.append(&mut other.open);
    }
}

/// Pairs of cells per parallel task.
const TRAVERSAL_CHUNK: usize = 256;

fn traverse<K: Kernel>(
    targets: Side<'_, K::Target>,
    sources: Side<'_, K::Source>,
    mask: &impl Mask<K>,
    far: bool,
) -> Found {
    let mut all = Found::default();
    if targets.points.is_empty() || sources.points.is_empty() {
        return all;
    }
    let mut open = vec![(0, 0, false)];
    while !open.is_empty() {
        let parts: Vec<Found> = open
            .par_chunks(TRAVERSAL_CHUNK)
            .map(|chunk| {
                let mut found = Found::default();
                for &(t, s, full) in chunk {
                    visit(targets, sources, mask, far, (t, s, full), &mut found);
                }
                found
            })
            .collect();
        for part in parts {
            all.append(part);
        }
        open = std::mem::take(&mut all.open);
    }
    all
}

/// Puts one pair of cells into a list or opens the pairs of their children.
fn visit<K: Kernel>(
    targets: Side<'_, K::Target>,
    sources: Side<'_, K::Source>,
    mask: &impl Mask<K>,
    far: bool,
    (t, s, known_full): (u32, u32, bool),
    found: &mut Found,
) {
    let (target, source) = (targets.view(t), sources.view(s));
    let coverage = if known_full { Coverage::Full } else { mask.cells(target, source) };
    let full = match coverage {
        Coverage::Empty => return,
        Coverage::Full => true,
        Coverage::Partial => false,
    };
    if full && far && target.cell.well_separated(source.cell) {
        let list = match target.cell.level().cmp(&source.cell.level()) {
            std::cmp::Ordering::Equal => &mut found.m2l,
            std::cmp::Ordering::Less => &mut found.m2p,
            std::cmp::Ordering::Greater => &mut found.p2l,
        };
        list.push((t, s));
        return;
    }
    // With no far field, a full pair needs its target leaves only.
    let source_is_whole = sources.is_leaf(s) || (full && !far);
    match (targets.is_leaf(t), source_is_whole) {
        (true, true) => found.near.push((t, NearCell { source: s, full })),
        (true, false) => found.open.extend(sources.children(s).map(|s| (t, s, full))),
        (false, true) => found.open.extend(targets.children(t).map(|t| (t, s, full))),
        (false, false) => {
            for t in targets.children(t) {
                found.open.extend(sources.children(s).map(|s| (t, s, full)));
            }
        }
    }
}

/// Turns near pairs of cells into runs of sources: asks the mask for the pairs of partly masked
/// ones, drops those of which nothing is left and joins neighbours of which everything counts.
fn runs<K: Kernel>(
    targets: Side<'_, K::Target>,
    sources: Side<'_, K::Source>,
    mask: &impl Mask<K>,
    near: &[(u32, NearCell)],
    progress: &(dyn Fn(f64) + Sync),
) -> (Vec<(u32, Run)>, Vec<u64>) {
    let sorted = in_order_of_sources(near, sources.tree);

    let partial = sorted.iter().filter(|(_, near)| !near.full).count();
    let done = std::sync::atomic::AtomicUsize::new(0);
    let blocks: Vec<Block> = sorted
        .par_iter()
        .map(|&(t, near)| {
            if near.full {
                return Block::Full;
            }
            let block = ask(mask, targets.view(t), sources.view(near.source));
            let done = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
            if done.is_multiple_of(PROGRESS_STEP) || done == partial {
                progress(done as f64 / partial as f64);
            }
            block
        })
        .collect();

    let mut runs: Vec<(u32, Run)> = Vec::new();
    let mut bits = Vec::new();
    for (&(t, near), block) in sorted.iter().zip(blocks) {
        let points = sources.tree.nodes[near.source as usize].points();
        let mut run = Run { first: points.start as u32, last: points.end as u32, bits: ALL };
        match block {
            Block::Empty => continue,
            Block::Full => {
                if let Some((previous_t, previous)) = runs.last_mut()
                    && *previous_t == t
                    && previous.bits == ALL
                    && previous.last == run.first
                {
                    previous.last = run.last;
                    continue;
                }
            }
            Block::Partial(words) => {
                run.bits = bits.len() as u64;
                bits.extend(words);
            }
        }
        runs.push((t, run));
    }
    (runs, bits)
}

/// Near pairs by target cell, then by source.
fn in_order_of_sources<T: Real>(near: &[(u32, NearCell)], tree: &Tree<T>) -> Vec<(u32, NearCell)> {
    let mut sorted = near.to_vec();
    sorted.par_sort_by_key(|&(t, near)| (t, tree.nodes[near.source as usize].points().start));
    sorted
}

/// Leaf pairs between two calls of a progress callback.
const PROGRESS_STEP: usize = 64;

/// The mask's answers for one pair of leaves.
enum Block {
    Empty,
    Full,
    Partial(Vec<u64>),
}

fn ask<K: Kernel>(
    mask: &impl Mask<K>,
    targets: CellView<'_, K::Target>,
    sources: CellView<'_, K::Source>,
) -> Block {
    let columns = sources.points.len();
    let pairs = targets.points.len() * columns;
    let mut words = vec![0u64; pairs.div_ceil(64)];
    mask.pairs(targets, sources, &mut |i, j| {
        let bit = i * columns + j;
        words[bit / 64] |= 1 << (bit % 64);
    });
    match words.iter().map(|word| word.count_ones() as usize).sum() {
        0 => Block::Empty,
        set if set == pairs => Block::Full,
        _ => Block::Partial(words),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_keep_their_order() {
        let grouped = Grouped::new(3, &[(2, 'a'), (0, 'b'), (2, 'c')]);
        assert_eq!(grouped.of(0), ['b']);
        assert_eq!(grouped.of(1), []);
        assert_eq!(grouped.of(2), ['a', 'c']);
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
