//! The shape of an octree: which cells there are, how they hang together and which points they hold.
//! Nothing here depends on the precision or the kind of the points.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use crate::octree::geometry::MAX_LEVEL;
use crate::octree::morton::{KEY_LEVELS, Keyed, morton_key, sort};
use crate::parallel;

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
    /// How many points it has, here or elsewhere.
    count: u32,
    /// Whether some of its children are elsewhere.
    closed: bool,
}

impl Node {
    fn leaf(points: Range<u32>, parent: u32, level: usize) -> Self {
        let (first, last, count) = (points.start, points.end, points.end - points.start);
        let (first_child, child_count, level) = (0, 0, level as u32);
        Self { first, last, parent, first_child, child_count, level, count, closed: false }
    }

    /// Its points, as far as they are here, as a range in tree order.
    pub(crate) fn points(&self) -> Range<usize> {
        self.first as usize..self.last as usize
    }

    /// Says where its points are now.
    pub(crate) fn move_points(&mut self, first: u32) {
        (self.first, self.last) = (first, first + (self.last - self.first));
    }

    /// How many points it has, here or elsewhere.
    pub(crate) fn count(&self) -> usize {
        self.count as usize
    }

    /// Indices of its children.
    pub(crate) fn children(&self) -> Range<usize> {
        self.first_child as usize..(self.first_child + self.child_count) as usize
    }

    /// Its level; the root's is 0.
    pub(crate) fn level(&self) -> usize {
        self.level as usize
    }

    /// Whether it has no children, here or elsewhere.
    pub(crate) fn is_leaf(&self) -> bool {
        self.child_count == 0 && !self.closed
    }

    /// Whether some of its children are elsewhere.
    pub(crate) fn is_closed(&self) -> bool {
        self.closed
    }
}

/// A cell that is given rather than found by dividing.
#[derive(Clone, Debug)]
pub(crate) struct Given {
    pub(crate) level: usize,
    /// Its points, as far as they are here.
    pub(crate) points: Range<u32>,
    /// How many points it has, here or elsewhere.
    pub(crate) count: u32,
    /// Whether some of its children are elsewhere.
    pub(crate) closed: bool,
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
        shape.order = vec![0; sorted.len()];
        parallel::for_each_piece(&mut shape.order, CHUNK, &|chunk, order| {
            let sorted = sorted[CHUNK * chunk..].iter();
            order.iter_mut().zip(sorted).for_each(|(index, item)| *index = item.index);
        });
        shape
    }

    /// The shape of cells that are given level by level, from the root on, those of a level in the order of their points.
    /// O(cells).
    ///
    /// # Errors
    /// The index of the first cell that is out of order or has no parent.
    pub(crate) fn of_cells(cells: &[Given], order: Vec<u32>) -> Result<Self, usize> {
        let (nodes, leaves) = (Vec::with_capacity(cells.len()), Vec::new());
        let mut shape = Self { nodes, level_starts: vec![0], leaves, order };
        let mut parent = 0;
        for (index, Given { level, points, count, closed }) in cells.iter().enumerate() {
            let level_of_last = shape.nodes.last().map_or(0, Node::level);
            if *level > level_of_last {
                parent = shape.level_starts[level_of_last];
                shape.level_starts.push(index);
            }
            let is_next = *level == level_of_last || *level == level_of_last + 1;
            let follows = *level > level_of_last
                || shape.nodes.last().is_none_or(|last| *level > 0 && last.last <= points.start);
            if !is_next || !follows || points.start >= points.end {
                return Err(index);
            }
            if *level > 0 {
                let first = shape.level_starts[*level];
                while parent < first && shape.nodes[parent].last <= points.start {
                    parent += 1;
                }
                let holds = |node: &Node| node.first <= points.start && points.end <= node.last;
                if parent == first || !holds(&shape.nodes[parent]) {
                    return Err(index);
                }
                let above = &mut shape.nodes[parent];
                if above.child_count == 0 {
                    above.first_child = index as u32;
                }
                above.child_count += 1;
            }
            let leaf = Node::leaf(points.clone(), parent as u32, *level);
            shape.nodes.push(Node { count: *count, closed: *closed, ..leaf });
        }
        if !shape.nodes.is_empty() {
            shape.level_starts.push(shape.nodes.len());
            shape.collect_leaves();
        }
        Ok(shape)
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
        let ranks: Vec<AtomicU32> = self.order.iter().map(|_| AtomicU32::new(0)).collect();
        parallel::for_each(self.order.len().div_ceil(CHUNK), &|chunk| {
            let first = CHUNK * chunk;
            for (rank, &i) in self.order[first..].iter().take(CHUNK).enumerate() {
                ranks[i as usize].store((first + rank) as u32, Relaxed);
            }
        });
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
        let octant_ends = parallel::map(parents.len(), &|parent| {
            let node = &self.nodes[parents.start + parent];
            let points = &sorted[node.points()];
            let splits = points.len() > division.leaf_size
                && (points[0].key != points[points.len() - 1].key
                    || self.is_only_child(node)
                    || division.differ_below(points, key));
            splits.then(|| octant_ends(points, node.first, shift))
        });
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
        let mut scratch = vec![Keyed::default(); points.len()];
        sort(points, &mut scratch, self.leaf_size);
    }

    /// Sorts the points of a cell by their n-th keys, if there are too many of them.
    fn key_anew(&self, points: &mut [Keyed], n: usize) {
        if points.len() > self.leaf_size {
            parallel::for_each_piece(points, CHUNK, &|_, points| {
                points.iter_mut().for_each(|item| item.key = key(n, (self.places)(item.index)));
            });
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
    !parallel::all(items.len().div_ceil(CHUNK), &|chunk| {
        items[CHUNK * chunk..].iter().take(CHUNK).all(|item| place(item) == first)
    })
}

/// Where each octant of a cell ends that holds `points`, the first of which has the tree position
/// `start`.
fn octant_ends(points: &[Keyed], start: u32, shift: u32) -> [u32; 8] {
    std::array::from_fn(|octant| {
        let count = points.partition_point(|item| (item.key >> shift) as usize % 8 <= octant);
        start + count as u32
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn given(level: usize, points: Range<u32>) -> Given {
        Given { level, count: points.end - points.start, points, closed: false }
    }

    #[test]
    fn given_cells_hang_together_by_their_points() {
        let mut cells = vec![given(0, 0..9), given(1, 0..3), given(1, 5..9), given(2, 5..7)];
        cells[0].count = 20;
        cells[2].closed = true;
        let shape = Shape::of_cells(&cells, Vec::new()).unwrap();
        assert_eq!(shape.levels(), 3);
        let children: Vec<_> = shape.nodes.iter().map(Node::children).collect();
        assert_eq!(children[..3], [1..3, 0..0, 3..4]);
        assert_eq!(shape.leaves, [1, 3]);
        assert!(shape.nodes[2].is_closed() && !shape.nodes[2].is_leaf());
        assert_eq!((shape.nodes[0].count(), shape.nodes[0].points()), (20, 0..9));
        assert_eq!(shape.path_to_root(3).collect::<Vec<_>>(), [3, 2, 0]);
        assert_eq!(Shape::of_cells(&[], Vec::new()).unwrap().levels(), 0);
    }

    #[test]
    fn cells_that_do_not_make_a_tree_are_refused() {
        let refused = |cells: &[Given]| Shape::of_cells(cells, Vec::new()).err();
        let root = || given(0, 2..9);
        assert_eq!(refused(&[given(1, 0..3)]), Some(0), "no root");
        assert_eq!(refused(&[root(), given(0, 9..12)]), Some(1), "two roots");
        assert_eq!(refused(&[root(), given(2, 2..3)]), Some(1), "a level is missing");
        assert_eq!(refused(&[root(), given(1, 4..6), given(1, 2..4)]), Some(2), "out of order");
        assert_eq!(refused(&[root(), given(1, 2..6), given(1, 5..7)]), Some(2), "overlapping");
        assert_eq!(refused(&[root(), given(1, 3..10)]), Some(1), "points its parent has not");
        assert_eq!(refused(&[root(), given(1, 3..3)]), Some(1), "empty");
    }
}
