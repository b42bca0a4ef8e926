//! A mask as the traversal sees it: asked about cells by their numbers, so that the traversal is compiled
//! once for all kernels and masks.

use rayon::prelude::*;

use crate::interaction::lists::{ALL, Lists, NONE, rebuilt};
use crate::kernel::mask::{CellView, Coverage, Mask};
use crate::kernel::traits::Kernel;
use crate::numbers::bits::for_each_set_bit;
use crate::numbers::traits::Located;
use crate::octree::tree::Tree;
use crate::parallel;

/// A mask that is asked about cells of the target tree and cells of the source tree.
pub(crate) trait CellMask: Sync {
    /// What holds for all pairs between two cells.
    fn cells(&self, target: u32, source: u32) -> Coverage;
    /// Which pairs between two cells count.
    fn pairs(&self, target: u32, source: u32) -> Answer;
    /// Whether a pair of cells has the answers of its mirror image.
    fn is_mirrored(&self) -> bool;
}

/// The mask's answers for one pair of leaves.
#[derive(Clone)]
pub(crate) enum Answer {
    Empty,
    Full,
    Partial(Vec<u64>),
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
        let mut words = vec![0u64; pairs.div_ceil(64)];
        self.mask.pairs(targets, sources, &mut |i, j| {
            let bit = i * columns + j;
            words[bit / 64] |= 1 << (bit % 64);
        });
        match words.iter().map(|word| word.count_ones() as usize).sum() {
            0 => Answer::Empty,
            set if set == pairs => Answer::Full,
            _ => Answer::Partial(words),
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
) -> Vec<Answer> {
    let is_mirrored = mask.is_mirrored();
    let asked = if is_mirrored { without_images(partial) } else { partial.to_vec() };
    let done = std::sync::atomic::AtomicUsize::new(0);
    let answer = |pair: &PartialPair| {
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
        match asked[index].target == pair.target {
            true => answers[index].clone(),
            false => answers[index].transposed(count(pair.source), count(pair.target)),
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

/// Gives the runs that are partly masked their bits.
pub(crate) fn fill_in(lists: &mut Lists, partial: &[PartialPair], answers: Vec<Answer>) {
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
