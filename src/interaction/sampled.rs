//! What the lists of a plan would hold, from a sample of its target cells.

use crate::interaction::lists::ALL;
use crate::interaction::traversal::{Candidate, Found, Traversal};
use crate::numbers::compiled::Compiled;
use crate::numbers::traits::Real;
use crate::parallel;

/// What the target cells of a level would find, extrapolated from some of them.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ListSample {
    /// Pairs of cells by M2L.
    pub(crate) m2l: f64,
    /// Pairs of cells by M2P and by P2L.
    pub(crate) m2p_p2l: f64,
    /// Runs of sources summed directly.
    pub(crate) runs: f64,
    /// Pairs of points that are summed directly, those of M2P and P2L that are not worth it included.
    pub(crate) direct_pairs: f64,
    /// Those of them that the mask would be asked for one by one.
    pub(crate) asked_pairs: f64,
    /// What M2P and P2L cost where they are worth it, in pairs summed directly.
    pub(crate) expanded_pairs: f64,
    /// What a treecode takes in place of M2L, likewise.
    pub(crate) treecode_pairs: f64,
}

/// Cells of a level that are looked at, and of all levels together, about.
const CELLS: usize = 32;
const ALL_CELLS: usize = 384;

/// [`Traversal::sample_lists`].
type Sample<T> = fn(&Traversal<'_, T>, usize) -> (Vec<ListSample>, f64);
static SAMPLE: Compiled<Sample<f32>, Sample<f64>> = Compiled(sample, sample);

impl<T: Real> Traversal<'_, T> {
    /// Surveys every level of the target tree, and tells which share of the work of finding all lists
    /// that is. M2P at a target and P2L of a source are taken to cost as much as `m2p_pairs` pairs summed
    /// directly. O(levels²) or O(cells), whichever is less.
    pub(crate) fn sample_lists(&self, m2p_pairs: usize) -> (Vec<ListSample>, f64) {
        SAMPLE.of::<Sample<T>>()(self, m2p_pairs)
    }

    /// A target cell's part in its level, from what was found for it.
    fn sample_of(&self, t: usize, found: &Found, m2p_pairs: usize) -> ListSample {
        let nodes = &self.targets.shape.nodes;
        let targets = nodes[t].count() as f64;
        let sources = &self.sources.shape.nodes;
        let count = |s: &u32| sources[*s as usize].count();
        let runs = found.near.items.iter();
        let of_runs = |asked: bool| {
            let runs = runs.clone().filter(|run| !asked || run.bits != ALL);
            runs.map(|run| f64::from(run.last - run.first)).sum::<f64>()
        };
        // What is no larger than M2P or P2L costs is summed directly.
        let (mut direct_pairs, mut expanded_pairs) = (targets * of_runs(false), 0.0);
        for s in &found.m2p.items {
            if count(s) > m2p_pairs {
                expanded_pairs += targets * m2p_pairs as f64
            } else {
                direct_pairs += targets * count(s) as f64
            }
        }
        for s in &found.p2l.items {
            if nodes[t].count() > m2p_pairs {
                expanded_pairs += m2p_pairs as f64 * count(s) as f64
            } else {
                direct_pairs += targets * count(s) as f64
            }
        }
        let by_m2p = |s: &u32| count(s).min(m2p_pairs) as f64;
        ListSample {
            m2l: (found.m2l.items.len() + found.weighed.items.len()) as f64,
            m2p_p2l: (found.m2p.items.len() + found.p2l.items.len()) as f64,
            runs: found.near.items.len() as f64,
            direct_pairs,
            asked_pairs: targets * of_runs(true),
            expanded_pairs,
            treecode_pairs: targets * found.m2l.items.iter().map(by_m2p).sum::<f64>(),
        }
    }
}

fn sample<T: Real>(traversal: &Traversal<'_, T>, m2p_pairs: usize) -> (Vec<ListSample>, f64) {
    let shape = &traversal.targets.shape;
    let most = (ALL_CELLS / shape.levels().max(1)).clamp(4, CELLS);
    // From the middle of as many stretches of each level.
    let sampled = |level: usize| {
        let cells = shape.level(level);
        let count = cells.len().min(most);
        (0..count).map(move |k| cells.start + (2 * k + 1) * cells.len() / (2 * count))
    };
    // A cell is visited after all above it.
    let mut visited = vec![false; shape.nodes.len()];
    for level in (0..shape.levels()).rev() {
        sampled(level).for_each(|cell| visited[cell] = true);
        for cell in shape.level(level).filter(|&cell| visited[cell]).collect::<Vec<_>>() {
            visited[shape.nodes[cell].parent as usize] = true;
        }
    }
    let mut samples = Vec::with_capacity(shape.levels());
    let root: Vec<Candidate> = traversal.at_root().into_iter().collect();
    let mut above: Vec<(usize, Found)> = Vec::new();
    for level in 0..shape.levels() {
        let cells: Vec<usize> = shape.level(level).filter(|&cell| visited[cell]).collect();
        let found = parallel::map(cells.len(), &|k| {
            let parent = shape.nodes[cells[k]].parent as usize;
            let parent = above.binary_search_by_key(&parent, |(cell, _)| *cell);
            let candidates = parent.map_or(&root, |parent| &above[parent].1.open.items);
            let (mut near, mut found) = (Vec::new(), Found::default());
            traversal.visit(cells[k] as u32, candidates, &mut near, &mut found);
            found
        });
        above = cells.into_iter().zip(found).collect();
        let share = shape.level(level).len() as f64 / sampled(level).len() as f64;
        samples.push(sampled(level).fold(ListSample::default(), |sum, cell| {
            let place = above.partition_point(|(other, _)| *other < cell);
            sum.with(share, &traversal.sample_of(cell, &above[place].1, m2p_pairs))
        }));
    }
    let visits = visited.iter().filter(|&&visited| visited).count();
    (samples, visits as f64 / shape.nodes.len().max(1) as f64)
}

impl ListSample {
    /// The sum of `self` and `share` times `other`.
    pub(crate) fn with(self, share: f64, other: &Self) -> Self {
        Self {
            m2l: self.m2l + share * other.m2l,
            m2p_p2l: self.m2p_p2l + share * other.m2p_p2l,
            runs: self.runs + share * other.runs,
            direct_pairs: self.direct_pairs + share * other.direct_pairs,
            asked_pairs: self.asked_pairs + share * other.asked_pairs,
            expanded_pairs: self.expanded_pairs + share * other.expanded_pairs,
            treecode_pairs: self.treecode_pairs + share * other.treecode_pairs,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expansion::admissibility::Admissibility;
    use crate::interaction::cell_mask::Everything;
    use crate::interaction::traversal::Far;
    use crate::octree::geometry::Cube;
    use crate::octree::tree::Tree;
    use crate::parallel::watch::Watch;
    use glam::DVec3;

    #[test]
    fn a_sample_of_all_cells_is_what_the_lists_hold() {
        // On a curve, so that no level has more cells than are looked at.
        let point = |i: usize| DVec3::new(0.9, 0.3, 0.1) * (i as f64 / 30.0 - 1.0);
        let points: Vec<DVec3> = (0..60).map(point).collect();
        let (root, watch) = (Cube::new(DVec3::ZERO, 1.0), Watch::default());
        let tree = Tree::new(&root, &points, 3, &watch).unwrap();
        let admissibility = Admissibility::default();
        let traversal = Traversal {
            targets: &tree,
            sources: &tree,
            mask: &Everything,
            far: Far::Whole,
            admissibility: &admissibility,
            watch: &watch,
        };
        let (levels, share) = traversal.sample_lists(0);
        let shape = &tree.shape;
        assert!(shape.levels() > 4 && share == 1.0, "{} levels, {share}", shape.levels());
        let lists = traversal.unmasked();
        for (level, sample) in levels.iter().enumerate() {
            let count =
                |of: &dyn Fn(usize) -> usize| shape.level(level).map(of).sum::<usize>() as f64;
            assert_eq!(sample.m2l, count(&|t| lists.m2l.of(t).len()));
            assert_eq!(sample.m2p_p2l, count(&|t| lists.m2p.of(t).len() + lists.p2l.of(t).len()));
            assert_eq!(sample.runs, count(&|t| lists.near.of(t).len()));
        }
    }
}
