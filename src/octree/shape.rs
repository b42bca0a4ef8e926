//! The shape of an octree: which cells there are, how they hang together and which points they hold.
//! Nothing here depends on the precision or the kind of the points.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use rayon::prelude::*;

use crate::octree::geometry::MAX_LEVEL;
use crate::octree::morton::{Keyed, sort};

/// The cells of an octree, level by level, in Morton order within a level; each holds the points
/// `order[first..last]`. No cell is empty.
#[derive(Clone, Debug)]
pub(crate) struct Shape {
    /// Points, parent and children of every cell.
    pub(crate) nodes: Vec<Node>,
    /// Where each level starts in `nodes`; one more entry ends the last.
    level_starts: Vec<usize>,
    /// All leaves in the order of their points.
    pub(crate) leaves: Vec<u32>,
    /// The caller's index of each point in tree order.
    pub(crate) order: Vec<u32>,
}

/// How a cell is tied into its tree.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    first: u32,
    last: u32,
    /// Index of the parent; the root is its own.
    pub(crate) parent: u32,
    first_child: u32,
    child_count: u32,
    level: u32,
}

impl Node {
    fn leaf(points: Range<u32>, parent: u32, level: usize) -> Self {
        let (first, last) = (points.start, points.end);
        Self { first, last, parent, first_child: 0, child_count: 0, level: level as u32 }
    }

    /// Its points, as a range in tree order.
    pub(crate) fn points(&self) -> Range<usize> {
        self.first as usize..self.last as usize
    }

    /// How many points it has.
    pub(crate) fn count(&self) -> usize {
        (self.last - self.first) as usize
    }

    /// Indices of its children.
    pub(crate) fn children(&self) -> Range<usize> {
        self.first_child as usize..(self.first_child + self.child_count) as usize
    }

    /// Its level; the root's is 0.
    pub(crate) fn level(&self) -> usize {
        self.level as usize
    }

    /// Whether it has no children.
    pub(crate) fn is_leaf(&self) -> bool {
        self.child_count == 0
    }
}

impl Shape {
    /// Sorts the points with these keys into cells of at most `leaf_size` points. A cell is left
    /// larger only where its points can't be told apart by their keys. Points of a leaf keep their
    /// order. Also the first point's key for every cell. O(N) per four levels.
    pub(crate) fn new(mut keyed: Vec<Keyed>, leaf_size: usize) -> (Self, Vec<u64>) {
        let mut scratch: Vec<Keyed> = keyed.par_iter().map(|_| Keyed::default()).collect();
        sort(&mut keyed, &mut scratch, leaf_size);

        let mut shape = Self {
            nodes: Vec::new(),
            level_starts: vec![0],
            leaves: Vec::new(),
            order: keyed.par_iter().map(|item| item.index).collect(),
        };
        if !keyed.is_empty() {
            shape.nodes.push(Node::leaf(0..keyed.len() as u32, 0, 0));
            shape.level_starts.push(1);
            while shape.split_last_level(&keyed, leaf_size) {}
            shape.collect_leaves();
        }
        let keys = shape.nodes.iter().map(|node| keyed[node.first as usize].key).collect();
        (shape, keys)
    }

    /// Number of levels; none for an empty tree.
    pub(crate) fn levels(&self) -> usize {
        self.level_starts.len() - 1
    }

    /// The cells of one level; none below the deepest.
    pub(crate) fn level(&self, level: usize) -> Range<usize> {
        if level < self.levels() {
            self.level_starts[level]..self.level_starts[level + 1]
        } else {
            self.nodes.len()..self.nodes.len()
        }
    }

    /// A cell, its parent, and so on up to the root.
    pub(crate) fn path_to_root(&self, cell: usize) -> impl Iterator<Item = usize> {
        let above = |&c: &usize| (c > 0).then(|| self.nodes[c].parent as usize);
        std::iter::successors(Some(cell), above)
    }

    /// The place in tree order of each of the caller's points: the inverse of `order`.
    pub(crate) fn ranks(&self) -> Vec<u32> {
        // Atomic stores let all threads write to scattered places.
        let ranks: Vec<AtomicU32> = self.order.par_iter().map(|_| AtomicU32::new(0)).collect();
        let set = |(rank, &i): (usize, &u32)| ranks[i as usize].store(rank as u32, Relaxed);
        self.order.par_iter().enumerate().for_each(set);
        ranks.into_iter().map(AtomicU32::into_inner).collect()
    }

    /// Its size in memory.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.nodes[..]) + size_of_val(&self.leaves[..]) + size_of_val(&self.order[..])
    }

    /// Splits every cell of the deepest level that is too full; whether there was one.
    fn split_last_level(&mut self, sorted: &[Keyed], leaf_size: usize) -> bool {
        let level = self.levels();
        if level > MAX_LEVEL {
            return false;
        }
        let parents = self.level(level - 1);
        let shift = 3 * (MAX_LEVEL - level) as u32;
        let octant_ends: Vec<Option<[u32; 8]>> = self.nodes[parents.clone()]
            .par_iter()
            .map(|node| {
                let points = node.points();
                let splits = points.len() > leaf_size
                    && sorted[points.start].key != sorted[points.end - 1].key;
                splits.then(|| octant_ends(&sorted[points], node.first, shift))
            })
            .collect();
        let before = self.nodes.len();
        for (p, ends) in parents.zip(octant_ends) {
            let Some(ends) = ends else { continue };
            let (first_child, mut first) = (self.nodes.len() as u32, self.nodes[p].first);
            for last in ends {
                if first < last {
                    self.nodes.push(Node::leaf(first..last, p as u32, level));
                }
                first = last;
            }
            self.nodes[p].first_child = first_child;
            self.nodes[p].child_count = self.nodes.len() as u32 - first_child;
        }
        let grows = self.nodes.len() > before;
        if grows {
            self.level_starts.push(self.nodes.len());
        }
        grows
    }

    /// Lists the leaves depth first, which is the order of their points.
    fn collect_leaves(&mut self) {
        let mut open = vec![0];
        while let Some(c) = open.pop() {
            let node = &self.nodes[c as usize];
            if node.is_leaf() {
                self.leaves.push(c);
            }
            open.extend(node.children().rev().map(|child| child as u32));
        }
    }
}

/// Where each octant of a cell ends that holds `points`, the first of which has the tree position
/// `start`.
fn octant_ends(points: &[Keyed], start: u32, shift: u32) -> [u32; 8] {
    std::array::from_fn(|octant| {
        let count = points.partition_point(|item| (item.key >> shift) as usize % 8 <= octant);
        start + count as u32
    })
}
