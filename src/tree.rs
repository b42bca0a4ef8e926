//! The adaptive octree: cells in flat arrays, level after level, in Morton order.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use rayon::prelude::*;

use crate::error::{Error, PointSet};
use crate::geometry::{Cell, Cube, MAX_LEVEL};
use crate::morton::{Keyed, coordinates, morton_key, sort};
use crate::real::{Additive, Located, Point, Real, Vector};

/// An octree over one set of points.
///
/// Cells are stored level by level, in Morton order within a level; each holds the points
/// `order[first..last]`. No cell is empty.
#[derive(Clone, Debug)]
pub(crate) struct Tree<T: Real> {
    /// Geometry of every cell.
    pub(crate) cells: Vec<Cell<T>>,
    /// Points, parent and children of every cell.
    pub(crate) nodes: Vec<Node>,
    /// Where each level starts in `cells`; one more entry ends the last.
    pub(crate) level_starts: Vec<usize>,
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
}

impl Node {
    fn leaf(points: Range<u32>, parent: u32) -> Self {
        Self { first: points.start, last: points.end, parent, first_child: 0, child_count: 0 }
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

    /// Whether it has no children.
    pub(crate) fn is_leaf(&self) -> bool {
        self.child_count == 0
    }
}

impl<T: Real> Tree<T> {
    /// Sorts `points` into cells of at most `leaf_size` points. A cell is left larger only where
    /// its points can't be told apart by their keys. Points of a leaf keep their order. O(N) per
    /// four levels.
    pub(crate) fn new<P: Located<Real = T>>(
        root: &Cube<T>,
        points: &[P],
        leaf_size: usize,
    ) -> Self {
        let keyed = |(i, p): (usize, &P)| {
            let key = morton_key(root.locate(p.position()));
            Keyed { key, index: i as u32 }
        };
        let mut sorted: Vec<Keyed> = points.par_iter().enumerate().map(keyed).collect();
        let mut scratch: Vec<Keyed> = sorted.par_iter().map(|_| Keyed::default()).collect();
        sort(&mut sorted, &mut scratch, leaf_size);

        let mut tree = Self {
            cells: Vec::new(),
            nodes: Vec::new(),
            level_starts: vec![0],
            leaves: Vec::new(),
            order: sorted.par_iter().map(|item| item.index).collect(),
        };
        if !points.is_empty() {
            tree.cells.push(Cell::new(root, 0, [0; 3]));
            tree.nodes.push(Node::leaf(0..points.len() as u32, 0));
            tree.level_starts.push(1);
            while tree.split_last_level(root, &sorted, leaf_size) {}
            tree.collect_leaves();
        }
        tree
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
            self.cells.len()..self.cells.len()
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
        size_of_val(&self.cells[..])
            + size_of_val(&self.nodes[..])
            + size_of_val(&self.leaves[..])
            + size_of_val(&self.order[..])
    }

    /// Splits every cell of the deepest level that is too full; whether there was one.
    fn split_last_level(&mut self, root: &Cube<T>, sorted: &[Keyed], leaf_size: usize) -> bool {
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
        for (p, ends) in parents.zip(octant_ends) {
            let Some(ends) = ends else { continue };
            let (first_child, mut first) = (self.nodes.len() as u32, self.nodes[p].first);
            for last in ends {
                if first < last {
                    self.nodes.push(Node::leaf(first..last, p as u32));
                }
                first = last;
            }
            self.nodes[p].first_child = first_child;
            self.nodes[p].child_count = self.nodes.len() as u32 - first_child;
        }
        let grown = &self.nodes[self.cells.len()..];
        self.cells.par_extend(grown.par_iter().map(|node| {
            let key = sorted[node.first as usize].key >> shift;
            Cell::new(root, level, coordinates(key))
        }));
        let grows = !grown.is_empty();
        if grows {
            self.level_starts.push(self.cells.len());
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

/// The smallest box around a set of points.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds<T> {
    low: [T; 3],
    high: [T; 3],
}

impl<T: Real> Bounds<T> {
    /// The box around `points`, which belong to `set`; an error if a coordinate is not finite or if
    /// there are too many points.
    pub(crate) fn new<P: Located<Real = T>>(set: PointSet, points: &[P]) -> Result<Self, Error> {
        let limit = u32::MAX as usize / 2;
        if points.len() > limit {
            return Err(Error::TooManyPoints { set, limit, found: points.len() });
        }
        let finite = |p: &P| p.position().is_finite();
        let (bounds, all_finite) = points
            .par_chunks(CHUNK)
            .map(|points| (Self::around(points), points.iter().all(finite)))
            .reduce(|| (Self::around::<P>(&[]), true), |(a, x), (b, y)| (a.join(b), x && y));
        match points.iter().position(|p| !all_finite && !finite(p)) {
            Some(index) => {
                let position = points[index].position().to_array().map(Real::as_f64);
                Err(Error::NonFinitePosition { set, index, position })
            }
            None => Ok(bounds),
        }
    }

    /// The box around both.
    pub(crate) fn join(self, other: Self) -> Self {
        Self {
            low: std::array::from_fn(|k| self.low[k].min(other.low[k])),
            high: std::array::from_fn(|k| self.high[k].max(other.high[k])),
        }
    }

    /// The root cube of everything in the box.
    pub(crate) fn root_cube(&self) -> Result<Cube<T>, Error> {
        let Self { low, high } = self;
        if low[0] > high[0] {
            return Ok(Cube::new(Point::<T>::default(), T::from_f64(1.0)));
        }
        let half = T::from_f64(0.5);
        let centre: [T; 3] = std::array::from_fn(|k| half * low[k] + half * high[k]);
        let half_width = (0..3)
            .map(|k| (high[k] - centre[k]).max(centre[k] - low[k]))
            .fold(T::from_f64(0.0), |a, b| a.max(b));
        let limit = T::max_value() * T::from_f64(0.125);
        if half_width > limit {
            let extent = (0..3).map(|k| high[k].as_f64() - low[k].as_f64()).fold(0.0, f64::max);
            return Err(Error::ExtentTooLarge { extent, limit: 2.0 * limit.as_f64() });
        }
        Ok(Cube::new(Point::<T>::from_array(centre), half_width))
    }

    /// The box around finite points.
    fn around<P: Located<Real = T>>(points: &[P]) -> Self {
        let mut bounds = Self { low: [T::infinity(); 3], high: [T::neg_infinity(); 3] };
        for p in points {
            for (k, x) in p.position().to_array().into_iter().enumerate() {
                bounds.low[k] = if x < bounds.low[k] { x } else { bounds.low[k] };
                bounds.high[k] = if x > bounds.high[k] { x } else { bounds.high[k] };
            }
        }
        bounds
    }
}

/// Points per task of a sweep over all of them.
const CHUNK: usize = 4096;

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
    use glam::DVec3;

    fn build(points: &[DVec3], leaf_size: usize) -> Tree<f64> {
        Tree::new(
            &Bounds::new(PointSet::Sources, points).unwrap().root_cube().unwrap(),
            points,
            leaf_size,
        )
    }

    fn check(tree: &Tree<f64>, points: &[DVec3], leaf_size: usize) {
        let mut order = tree.order.clone();
        order.sort_unstable();
        assert!(order.iter().enumerate().all(|(i, &o)| i == o as usize), "a permutation");
        for (c, node) in tree.nodes.iter().enumerate() {
            assert!(node.count() > 0);
            for &i in &tree.order[node.points()] {
                let p = tree.cells[c].normalised(points[i as usize]);
                assert!(p.abs().max_element() <= 1.0 + 1e-9, "point {i} lies in cell {c}: {p}");
            }
            let mut next = node.first;
            for child in node.children() {
                assert_eq!(tree.nodes[child].parent as usize, c);
                assert_eq!(tree.nodes[child].first, next);
                assert_eq!(tree.cells[child].level(), tree.cells[c].level() + 1);
                next = tree.nodes[child].last;
            }
            assert!(node.is_leaf() || next == node.last, "children cover their parent");
            if node.is_leaf() && node.count() > leaf_size {
                assert_eq!(tree.cells[c].level(), tree.levels() - 1);
            }
        }
        let mut next = 0;
        for &leaf in &tree.leaves {
            assert_eq!(tree.nodes[leaf as usize].points().start, next, "leaves in order");
            next = tree.nodes[leaf as usize].points().end;
        }
        assert_eq!(next, points.len());
        let ranks = tree.ranks();
        assert!(ranks.iter().enumerate().all(|(i, &r)| tree.order[r as usize] as usize == i));
    }

    #[test]
    fn every_point_lies_in_its_cells() {
        let points: Vec<DVec3> = (0..2000)
            .map(|i| {
                let t = f64::from(i);
                DVec3::new((t * 0.7548).fract(), (t * 0.5698).fract().powi(4), (t * 0.1).sin())
            })
            .collect();
        for leaf_size in [1, 7, 64, 5000] {
            check(&build(&points, leaf_size), &points, leaf_size);
        }
    }

    #[test]
    fn coincident_points_stop_the_splitting() {
        let points = vec![DVec3::new(0.3, 0.2, 0.1); 100];
        assert_eq!(build(&points, 8).cells.len(), 1);
        let mut pair = points;
        pair.push(DVec3::ONE);
        let tree = build(&pair, 8);
        assert_eq!(tree.levels(), 2);
        assert_eq!(tree.leaves.len(), 2);
    }

    #[test]
    fn depth_is_bounded_by_the_key() {
        let points: Vec<DVec3> = (0..60).map(|i| DVec3::X * 0.5f64.powi(i)).collect();
        let tree = build(&points, 1);
        assert_eq!(tree.levels(), MAX_LEVEL + 1);
        check(&tree, &points, 1);
    }

    #[test]
    fn an_extent_that_overflows_is_refused() {
        let points = [DVec3::X * 1e308, DVec3::X * -1e308];
        let bounds = Bounds::new(PointSet::Sources, &points).unwrap();
        assert!(matches!(bounds.root_cube(), Err(Error::ExtentTooLarge { .. })));
    }
}
