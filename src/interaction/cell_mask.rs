//! A mask as the traversal sees it: asked about cells by their numbers, so that the traversal is compiled
//! once for all kernels and masks.

use rayon::prelude::*;

use crate::interaction::lists::{ALL, Lists, NONE, PairShare, rebuilt};
use crate::kernel::mask::{CellView, Coverage, Mask};
use crate::kernel::traits::Kernel;
use crate::numbers::bits::for_each_set_bit;
use crate::numbers::traits::Located;
use crate::octree::shape::Shape;
use crate::octree::tree::Tree;
use crate::parallel;
use crate::parallel::watch::Watch;

/// A mask that is asked about cells of the target tree and cells of the source tree.
pub(crate) trait CellMask: Sync {
    /// What holds for all pairs between two cells.
    fn cells(&self, target: u32, source: u32) -> Coverage;
    /// Which pairs between two cells count.
    fn pairs(&self, target: u32, source: u32) -> Answer;
    /// Whether a pair of cells has the answers of its mirror image.
    fn is_mirrored(&self) -> bool;
}

/// No mask.
pub(crate) struct Everything;

impl CellMask for Everything {
    fn cells(&self, _target: u32, _source: u32) -> Coverage {
        Coverage::Full
    }

    fn pairs(&self, _target: u32, _source: u32) -> Answer {
        Answer::Full
    }

    fn is_mirrored(&self) -> bool {
        false
    }
}

/// The mask's answers for one pair of leaves.
#[derive(Clone)]
pub(crate) enum Answer {
    Empty,
    Full,
    Partial(Partly),
}

/// The pairs of two leaves of which some count.
#[derive(Clone, Default)]
pub(crate) struct Partly {
    /// A bit for each pair that counts in full.
    words: Vec<u64>,
    /// The others that count, with their shares: the i-th target and the j-th source.
    shares: Vec<(u32, u32, f64)>,
}

/// A mask, and what it is shown.
pub(crate) struct PointMask<'a, K: Kernel, M> {
    pub(crate) mask: &'a M,
    pub(crate) targets: TreePoints<'a, K::Target>,
    pub(crate) sources: TreePoints<'a, K::Source>,
}

/// One set of points with its tree, the points in tree order.
pub(crate) struct TreePoints<'a, P: Located> {
    pub(crate) tree: &'a Tree<P::Real>,
    pub(crate) points: &'a [P],
}

impl<'a, P: Located> TreePoints<'a, P> {
    fn view(&self, cell: u32) -> CellView<'a, P> {
        let cell = cell as usize;
        let points = self.tree.shape.nodes[cell].points();
        CellView { cell: &self.tree.cells[cell], points: &self.points[points] }
    }
}

impl<K: Kernel, M: Mask<K>> CellMask for PointMask<'_, K, M> {
    fn cells(&self, target: u32, source: u32) -> Coverage {
        self.mask.cells(self.targets.view(target), self.sources.view(source))
    }

    fn pairs(&self, target: u32, source: u32) -> Answer {
        let (targets, sources) = (self.targets.view(target), self.sources.view(source));
        let columns = sources.points.len();
        let pairs = targets.points.len() * columns;
        let mut partly = Partly { words: vec![0; pairs.div_ceil(64)], shares: Vec::new() };
        self.mask.pairs(targets, sources, &mut |i, j, share| {
            if i >= targets.points.len() || j >= columns {
                // Refused like any other answer that is none.
                partly.shares.push((0, 0, f64::NAN));
            } else if share == 1.0 {
                let bit = i * columns + j;
                partly.words[bit / 64] |= 1 << (bit % 64);
            } else if share != 0.0 {
                partly.shares.push((i as u32, j as u32, share));
            }
        });
        if !partly.shares.is_empty() {
            return Answer::Partial(partly);
        }
        match partly.words.iter().map(|word| word.count_ones() as usize).sum() {
            0 => Answer::Empty,
            set if set == pairs => Answer::Full,
            _ => Answer::Partial(partly),
        }
    }

    fn is_mirrored(&self) -> bool {
        std::ptr::eq(self.targets.tree, self.sources.tree)
            && self.mask.is_mirrored(self.targets.points, self.sources.points)
    }
}

/// Two leaves of which the mask has to be asked for every pair.
#[derive(Clone, Copy)]
pub(crate) struct PartialPair {
    pub(crate) target: u32,
    pub(crate) source: u32,
    /// Index of its run.
    pub(crate) run: usize,
}

/// Leaf pairs between two calls of a progress callback.
const PROGRESS_STEP: usize = 64;

/// Asks the mask for every pair of points of the partly masked pairs of leaves; `count` is how many
/// points a leaf of the targets has.
pub(crate) fn ask_all(
    mask: &dyn CellMask,
    count: &(dyn Fn(u32) -> usize + Sync),
    partial: &[PartialPair],
    progress: &(dyn Fn(f64) + Sync),
    watch: &Watch,
) -> Vec<Answer> {
    let is_mirrored = mask.is_mirrored();
    let asked = if is_mirrored { without_images(partial) } else { partial.to_vec() };
    let done = std::sync::atomic::AtomicUsize::new(0);
    let answer = |pair: &PartialPair| {
        if watch.is_stopped() {
            return Answer::Empty;
        }
        let answer = mask.pairs(pair.target, pair.source);
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
        if asked[index].target == pair.target {
            answers[index].clone()
        } else {
            answers[index].transposed(count(pair.source), count(pair.target))
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

impl Answer {
    /// The answer for `columns` targets and `rows` sources, from that for `rows` targets and
    /// `columns` sources.
    fn transposed(&self, rows: usize, columns: usize) -> Self {
        let Self::Partial(Partly { words, shares }) = self else { return self.clone() };
        let mut transposed = vec![0u64; words.len()];
        for i in 0..rows {
            for_each_set_bit(words, i, columns, |j| {
                let bit = j * rows + i;
                transposed[bit / 64] |= 1 << (bit % 64);
            });
        }
        let mut shares: Vec<_> = shares.iter().map(|&(i, j, share)| (j, i, share)).collect();
        // In the order in which the pairs themselves would be asked for: the same sums to the bit.
        shares.sort_unstable_by_key(|&(i, j, _)| (i, j));
        Self::Partial(Partly { words: transposed, shares })
    }
}

/// Gives the runs that are partly masked their bits, and the leaves of `targets` the pairs that count in part.
///
/// # Errors
/// The first pair whose share is not a number from 0 to 1.
pub(crate) fn fill_in(
    lists: &mut Lists,
    targets: &Shape,
    partial: &[PartialPair],
    answers: Vec<Answer>,
) -> Result<(), PairShare> {
    let mut shares: Vec<(u32, PairShare)> = Vec::new();
    for (pair, answer) in partial.iter().zip(answers) {
        let run = &mut lists.near.items[pair.run];
        run.bits = match answer {
            Answer::Empty => NONE,
            Answer::Full => ALL,
            Answer::Partial(partly) => {
                let first = targets.nodes[pair.target as usize].points().start as u32;
                shares.extend(partly.shares.iter().map(|&(i, j, share)| {
                    let (target, source) = (first + i, run.first + j);
                    (pair.target, PairShare { target, source, share })
                }));
                if partly.words.iter().all(|&word| word == 0) {
                    NONE
                } else {
                    let start = lists.bits.len() as u64;
                    lists.bits.extend(partly.words);
                    start
                }
            }
        };
    }
    lists.near = rebuilt(&lists.near, |_, _| ());
    if let Some((_, wrong)) = shares.iter().find(|(_, pair)| !(0.0..=1.0).contains(&pair.share)) {
        return Err(*wrong);
    }
    if !shares.is_empty() {
        shares.sort_by_key(|&(leaf, _)| leaf);
        let mut rest = &shares[..];
        for cell in 0..targets.nodes.len() as u32 {
            let (own, others) = rest.split_at(rest.partition_point(|&(leaf, _)| leaf == cell));
            lists.shares.push_group(own.iter().map(|&(_, pair)| pair));
            rest = others;
        }
    }
    Ok(())
}
