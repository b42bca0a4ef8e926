//! The adaptive octree: cells in flat arrays, level after level, in Morton order.

use std::ops::Range;

use rayon::prelude::*;

use crate::error::{Error, PointSet};
use crate::geometry::{Cell, Cube, MAX_LEVEL};
use crate::real::{Located, Point, Real, Vector};

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
    /// its points can't be told apart by their keys. O(N log N).
    pub(crate) fn new(root: &Cube<T>, points: &[Point<T>], leaf_size: usize) -> Self {
        let mut sorted: Vec<(u64, u32)> = points
            .par_iter()
            .enumerate()
            .map(|(i, &p)| (morton_key(root.locate(p)), i as u32))
            .collect();
        sorted.par_sort_unstable();

        let mut tree =
            Self { cells: Vec::new(), nodes: Vec::new(), level_starts: vec![0], order: Vec::new() };
        if !points.is_empty() {
            tree.cells.push(Cell::new(root, 0, [0; 3]));
            let last = points.len() as u32;
            tree.nodes.push(Node { first: 0, last, parent: 0, first_child: 0, child_count: 0 });
            tree.level_starts.push(1);
            while tree.split_last_level(root, &sorted, leaf_size) {}
        }
        tree.order = sorted.into_iter().map(|(_, i)| i).collect();
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

    /// All leaves in the order of their points.
    pub(crate) fn leaves(&self) -> Vec<u32> {
        let mut leaves: Vec<u32> =
            (0..self.nodes.len() as u32).filter(|&c| self.nodes[c as usize].is_leaf()).collect();
        leaves.par_sort_unstable_by_key(|&c| self.nodes[c as usize].first);
        leaves
    }

    /// Splits every cell of the deepest level that is too full; whether there was one.
    fn split_last_level(
        &mut self,
        root: &Cube<T>,
        sorted: &[(u64, u32)],
        leaf_size: usize,
    ) -> bool {
        let level = self.levels();
        let parents = self.level(level - 1);
        if level > MAX_LEVEL {
            return false;
        }
        let shift = 3 * (MAX_LEVEL - level) as u32;
        let children: Vec<Vec<Node>> = parents
            .clone()
            .into_par_iter()
            .map(|p| {
                let points = self.nodes[p].points();
                let splits =
                    points.len() > leaf_size && sorted[points.start].0 != sorted[points.end - 1].0;
                if splits { split(&sorted[points.clone()], points.start, shift, p) } else { vec![] }
            })
            .collect();
        for (p, children) in parents.zip(children) {
            self.nodes[p].first_child = self.nodes.len() as u32;
            self.nodes[p].child_count = children.len() as u32;
            for child in children {
                let key = sorted[child.first as usize].0 >> shift;
                self.cells.push(Cell::new(root, level, coordinates(key)));
                self.nodes.push(child);
            }
        }
        let grown = self.cells.len() > self.level_starts[level];
        if grown {
            self.level_starts.push(self.cells.len());
        }
        grown
    }
}

/// The root cube of both sets together.
pub(crate) fn root_cube<T: Real>(
    sources: &[Point<T>],
    targets: &[Point<T>],
) -> Result<Cube<T>, Error> {
    let mut low = [T::infinity(); 3];
    let mut high = [T::neg_infinity(); 3];
    for p in sources.iter().chain(targets) {
        for (k, x) in p.to_array().into_iter().enumerate() {
            low[k] = low[k].min(x);
            high[k] = high[k].max(x);
        }
    }
    if sources.is_empty() && targets.is_empty() {
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

/// The positions of a set, checked.
pub(crate) fn positions<P: Located>(
    set: PointSet,
    points: &[P],
) -> Result<Vec<Point<P::Real>>, Error> {
    let limit = u32::MAX as usize / 2;
    if points.len() > limit {
        return Err(Error::TooManyPoints { set, limit, found: points.len() });
    }
    let positions: Vec<_> = points.par_iter().map(Located::position).collect();
    let finite = |p: &Point<P::Real>| p.to_array().iter().all(|x| x.as_f64().is_finite());
    match positions.par_iter().position_first(|p| !finite(p)) {
        Some(index) => {
            let position = positions[index].to_array().map(Real::as_f64);
            Err(Error::NonFinitePosition { set, index, position })
        }
        None => Ok(positions),
    }
}

/// The children of a cell that holds `points`, the first of which has the tree position `start`.
fn split(points: &[(u64, u32)], start: usize, shift: u32, parent: usize) -> Vec<Node> {
    let mut children = Vec::with_capacity(8);
    let mut first = 0;
    while first < points.len() {
        let key = points[first].0 >> shift;
        let count = points[first..].partition_point(|&(k, _)| k >> shift == key);
        children.push(Node {
            first: (start + first) as u32,
            last: (start + first + count) as u32,
            parent: parent as u32,
            first_child: 0,
            child_count: 0,
        });
        first += count;
    }
    children
}

/// Interleaves three 21-bit coordinates; x takes the lowest bit of each triple.
fn morton_key([x, y, z]: [u32; 3]) -> u64 {
    spread(x) | spread(y) << 1 | spread(z) << 2
}

/// Undoes [`morton_key`].
fn coordinates(key: u64) -> [u32; 3] {
    [gather(key), gather(key >> 1), gather(key >> 2)]
}

/// Moves bit i to bit 3i.
fn spread(x: u32) -> u64 {
    let mut x = u64::from(x);
    x = (x | x << 32) & 0x001f_0000_0000_ffff;
    x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

/// Moves bit 3i to bit i.
fn gather(key: u64) -> u32 {
    let mut x = key & 0x1249_2492_4924_9249;
    x = (x | x >> 2) & 0x10c3_0c30_c30c_30c3;
    x = (x | x >> 4) & 0x100f_00f0_0f00_f00f;
    x = (x | x >> 8) & 0x001f_0000_ff00_00ff;
    x = (x | x >> 16) & 0x001f_0000_0000_ffff;
    (x | x >> 32) as u32 & 0x001f_ffff
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn build(points: &[DVec3], leaf_size: usize) -> Tree<f64> {
        Tree::new(&root_cube(points, &[]).unwrap(), points, leaf_size)
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
        let leaves = tree.leaves();
        assert_eq!(
            leaves.iter().map(|&l| tree.nodes[l as usize].count()).sum::<usize>(),
            points.len()
        );
    }

    #[test]
    fn keys_interleave_and_come_apart() {
        assert_eq!(morton_key([1, 0, 0]), 1);
        assert_eq!(morton_key([0, 1, 2]), 0b100_010);
        for c in [[0, 1, 2], [77_777, 1 << 20, 3], [(1 << 21) - 1; 3]] {
            assert_eq!(coordinates(morton_key(c)), c);
        }
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
        assert_eq!(tree.leaves().len(), 2);
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
        assert!(matches!(root_cube::<f64>(&points, &[]), Err(Error::ExtentTooLarge { .. })));
    }
}
