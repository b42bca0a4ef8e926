//! The shape of an octree: which cells there are, how they hang together and which points they hold.
//! Nothing here depends on the precision or the kind of the points.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use rayon::prelude::*;

use crate::octree::geometry::MAX_LEVEL;
use crate::octree::morton::{KEY_LEVELS, Keyed, morton_key, sort};

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

/// Points per task of a sweep over all of them.
const CHUNK: usize = 4096;

/// Integer coordinates among the cells of [`MAX_LEVEL`] of the point with some index.
pub(crate) type Places<'a> = &'a (dyn Fn(u32) -> [u64; 3] + Sync);

/// The n-th key of a place.
pub(crate) fn key(n: usize, place: [u64; 3]) -> u64 {
    morton_key(place.map(|c| c >> (MAX_LEVEL - (n + 1) * KEY_LEVELS)))
}

impl Shape {
    /// Sorts the points with these keys into cells of at most `leaf_size` points; what a key can't tell
    /// apart is keyed anew by its `places`. A cell is left larger only where its points have one place on
    /// the deepest level. Points of a leaf keep their order. O(N) per four levels; levels that only some
    /// points reach are no work for the others.
    pub(crate) fn new(
        mut sorted: Vec<Keyed>,
        places: Places<'_>,
        leaf_size: usize,
        deepest_level: usize,
    ) -> Self {
        let division = Division { places, leaf_size, deepest_level };
        division.sort(&mut sorted);
        let mut shape = Self {
            nodes: Vec::new(),
            level_starts: vec![0],
            leaves: Vec::new(),
            order: Vec::new(),
        };
        if !sorted.is_empty() {
            shape.nodes.push(Node::leaf(0..sorted.len() as u32, 0, 0));
            shape.level_starts.push(1);
            while shape.split_last_level(&mut sorted, &division) {}
            shape.collect_leaves();
        }
        shape.order = sorted.par_iter().map(|item| item.index).collect();
        shape
    }

    /// Whether a leaf has more than `leaf_size` points although not all have one of these places.
    pub(crate) fn can_be_divided(&self, places: Places<'_>, leaf_size: usize) -> bool {
        self.leaves.iter().any(|&leaf| {
            let points = &self.order[self.nodes[leaf as usize].points()];
            points.len() > leaf_size && differ(points, |&i| places(i))
        })
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

    /// Splits every cell of the last level that is too full; whether there was one.
    fn split_last_level(&mut self, sorted: &mut [Keyed], division: &Division<'_>) -> bool {
        let level = self.levels();
        if level > division.deepest_level {
            return false;
        }
        let parents = self.level(level - 1);
        let (key, digit) = ((level - 1) / KEY_LEVELS, (level - 1) % KEY_LEVELS);
        if key > 0 && digit == 0 {
            for node in &self.nodes[parents.clone()] {
                division.key_anew(&mut sorted[node.points()], key);
            }
        }
        let (sorted, shift) = (&*sorted, 3 * (KEY_LEVELS - 1 - digit) as u32);
        let octant_ends: Vec<Option<[u32; 8]>> = self.nodes[parents.clone()]
            .par_iter()
            .map(|node| {
                let points = &sorted[node.points()];
                let splits = points.len() > division.leaf_size
                    && (points[0].key != points[points.len() - 1].key
                        || self.is_only_child(node)
                        || division.differ_below(points, key));
                splits.then(|| octant_ends(points, node.first, shift))
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

    /// Whether a cell has all points of its parent, which was divided.
    fn is_only_child(&self, node: &Node) -> bool {
        node.level > 0 && self.nodes[node.parent as usize].child_count == 1
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

/// What cells are divided by.
struct Division<'a> {
    places: Places<'a>,
    leaf_size: usize,
    deepest_level: usize,
}

impl Division<'_> {
    /// Sorts points by the keys that they have.
    fn sort(&self, points: &mut [Keyed]) {
        let mut scratch: Vec<Keyed> = points.par_iter().map(|_| Keyed::default()).collect();
        sort(points, &mut scratch, self.leaf_size);
    }

    /// Sorts the points of a cell by their n-th keys, if there are too many of them.
    fn key_anew(&self, points: &mut [Keyed], n: usize) {
        if points.len() > self.leaf_size {
            let items = points.par_iter_mut().with_min_len(CHUNK);
            items.for_each(|item| item.key = key(n, (self.places)(item.index)));
            self.sort(points);
        }
    }

    /// Whether points whose n-th keys are equal have later ones that are not.
    fn differ_below(&self, points: &[Keyed], n: usize) -> bool {
        (n + 1) * KEY_LEVELS < self.deepest_level
            && differ(points, |item| (self.places)(item.index))
    }
}

/// Whether not all items are at the place of the first.
fn differ<V: Sync>(items: &[V], place: impl Fn(&V) -> [u64; 3] + Sync) -> bool {
    let first = place(&items[0]);
    items.par_iter().with_min_len(CHUNK).any(|item| place(item) != first)
}

/// Where each octant of a cell ends that holds `points`, the first of which has the tree position
/// `start`.
fn octant_ends(points: &[Keyed], start: u32, shift: u32) -> [u32; 8] {
    std::array::from_fn(|octant| {
        let count = points.partition_point(|item| (item.key >> shift) as usize % 8 <= octant);
        start + count as u32
    })
}
