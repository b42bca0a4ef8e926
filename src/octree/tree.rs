//! The adaptive octree over points, and the box around them.

use crate::error::Error;
use crate::numbers::traits::{Located, Real};
use crate::octree::geometry::{Cell, Cube, MAX_LEVEL};
use crate::octree::morton::{KEY_LEVELS, keyed, morton_key};
use crate::octree::shape::{Given, Places, Shape, key};
use crate::parallel;
use crate::parallel::watch::Watch;

/// An octree over one set of points.
#[derive(Clone, Debug)]
pub(crate) struct Tree<T: Real> {
    /// Which cells there are.
    pub(crate) shape: Shape,
    /// Geometry of every cell.
    pub(crate) cells: Vec<Cell<T>>,
}

impl<T: Real> Tree<T> {
    /// Sorts `points` into cells of at most `leaf_size` points, as [`Shape::new`] does.
    ///
    /// # Errors
    /// [`Error::Stopped`].
    pub(crate) fn new<P: Located<Real = T>>(
        root: &Cube<T>,
        points: &[P],
        leaf_size: usize,
        watch: &Watch,
    ) -> Result<Self, Error> {
        let position = |i: usize| points[i].position();
        let rounded: Places<'_> =
            &|i| root.locate(position(i as usize)).map(|c| c << (MAX_LEVEL - KEY_LEVELS));
        let exact: Places<'_> = &|i| root.locate_exactly(position(i as usize));
        let mut places = rounded;
        let first = |i| morton_key(root.locate(position(i as usize)));
        let points_keyed = keyed(points.len(), &first);
        watch.check()?;
        let mut shape = Shape::new(points_keyed, places, leaf_size, KEY_LEVELS);
        watch.check()?;
        // Few clouds need digits beyond the first key, and those that do need all of them right.
        if shape.can_be_divided(exact, leaf_size) {
            places = exact;
            let points_keyed = keyed(points.len(), &|i| key(0, exact(i)));
            shape = Shape::new(points_keyed, places, leaf_size, root.deepest_level());
        }
        watch.check()?;
        let cells = parallel::map(shape.nodes.len(), &|c| {
            let node = &shape.nodes[c];
            let place = places(shape.order[node.points().start]);
            Cell::new(root, node.level(), place.map(|c| c >> (MAX_LEVEL - node.level())))
        });
        Ok(Self { shape, cells })
    }

    /// The tree of cells that are given, as [`Shape::of_cells`] takes them, with their integer coordinates.
    ///
    /// # Errors
    /// The index of the first cell that is not where its parent is, or out of order.
    pub(crate) fn of_cells(
        root: &Cube<T>,
        given: &[Given],
        coordinates: &[[u64; 3]],
        order: Vec<u32>,
    ) -> Result<Self, usize> {
        let shape = Shape::of_cells(given, order)?;
        for (index, node) in shape.nodes.iter().enumerate() {
            let own = coordinates[index];
            let halved = own.map(|c| c >> 1);
            let is_inside = if node.level() == 0 {
                own == [0; 3]
            } else {
                node.level() <= MAX_LEVEL && halved == coordinates[node.parent as usize]
            };
            if !is_inside {
                return Err(index);
            }
        }
        let cells = parallel::map(shape.nodes.len(), &|c| {
            Cell::new(root, shape.nodes[c].level(), coordinates[c])
        });
        Ok(Self { shape, cells })
    }

    /// Its size in memory.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.cells[..]) + self.shape.bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::PointSet;
    use crate::numbers::traits::Vector;
    use crate::octree::bounds::Bounds;
    use crate::octree::shape::Node;
    use glam::{DVec3, Vec3};

    fn root<P: Located>(points: &[P]) -> Cube<P::Real> {
        Bounds::new(PointSet::Sources, points).unwrap().root_cube(None).unwrap()
    }

    fn build(points: &[DVec3], leaf_size: usize) -> Tree<f64> {
        Tree::new(&root(points), points, leaf_size, &Watch::default()).unwrap()
    }

    /// A tree of which everything holds that trees promise.
    fn checked<P: Located>(points: &[P], leaf_size: usize) -> Tree<P::Real> {
        let root = root(points);
        let tree = Tree::new(&root, points, leaf_size, &Watch::default()).unwrap();
        let Tree { shape, cells } = &tree;
        let mut order = shape.order.clone();
        order.sort_unstable();
        assert!(order.iter().enumerate().all(|(i, &o)| i == o as usize), "a permutation");
        let rounding = 8.0 * <P::Real as num_traits::Float>::epsilon().as_f64();
        for (c, node) in shape.nodes.iter().enumerate() {
            assert!(node.count() > 0);
            assert_eq!(node.level(), cells[c].level());
            for &i in &shape.order[node.points()] {
                let p = cells[c].normalised(points[i as usize].position()).to_array();
                let inside = p.iter().all(|x| x.as_f64().abs() <= 1.0 + rounding.max(1e-9));
                assert!(inside, "point {i} lies in cell {c}: {p:?}");
            }
            let mut next = node.points().start;
            for child in node.children() {
                assert_eq!(shape.nodes[child].parent as usize, c);
                assert_eq!(shape.nodes[child].points().start, next);
                assert_eq!(cells[child].level(), cells[c].level() + 1);
                let halved = cells[child].coordinates().map(|x| x >> 1);
                assert_eq!(halved, cells[c].coordinates());
                next = shape.nodes[child].points().end;
            }
            assert!(node.is_leaf() || next == node.points().end, "children cover their parent");
            if node.is_leaf() && node.count() > leaf_size {
                let own = &shape.order[node.points()];
                let place = |i: u32| root.locate_exactly(points[i as usize].position());
                assert!(own.iter().all(|&i| place(i) == place(own[0])), "nothing tells them apart");
            }
        }
        let mut next = 0;
        for &leaf in &shape.leaves {
            assert_eq!(shape.nodes[leaf as usize].points().start, next, "leaves in order");
            next = shape.nodes[leaf as usize].points().end;
        }
        assert_eq!(next, points.len());
        let ranks = shape.ranks();
        assert!(ranks.iter().enumerate().all(|(i, &r)| shape.order[r as usize] as usize == i));
        tree
    }

    /// Points scattered over a cube of that half-width.
    fn scattered(n: u32, half_width: f64) -> Vec<DVec3> {
        let point = |i| {
            let steps = DVec3::new(0.754_877, 0.569_840, 0.362_719);
            ((steps * f64::from(i)).fract() * 2.0 - DVec3::ONE) * half_width
        };
        (1..=n).map(point).collect()
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
            checked(&points, leaf_size);
        }
    }

    #[test]
    fn coincident_points_stop_the_splitting() {
        let points = vec![DVec3::new(0.3, 0.2, 0.1); 100];
        assert_eq!(build(&points, 8).cells.len(), 1);
        let mut pair = points;
        pair.push(DVec3::ONE);
        let tree = build(&pair, 8);
        assert_eq!(tree.shape.levels(), 2);
        assert_eq!(tree.shape.leaves.len(), 2);
        // Not even where others are divided beyond the first key.
        let mut nested = scattered(100, 1e-12);
        nested.extend(pair);
        let tree = checked(&nested, 8);
        let largest = tree.shape.leaves.iter().map(|&leaf| tree.shape.nodes[leaf as usize].count());
        assert_eq!(largest.max(), Some(100));
        assert!(tree.cells.len() < 200, "{}", tree.cells.len());
    }

    #[test]
    fn depth_ends_where_cells_do() {
        let chain = |n: i32| (0..n).map(|i| DVec3::X * 0.5f64.powi(i)).collect::<Vec<_>>();
        let tree = checked(&chain(60), 1);
        assert_eq!(tree.shape.leaves.len(), 60);
        assert!((50..MAX_LEVEL).contains(&(tree.shape.levels() - 1)));
        let tree = checked(&chain(200), 1);
        assert_eq!(tree.shape.levels(), MAX_LEVEL + 1);
        assert!(tree.shape.leaves.len() > 60);
    }

    #[test]
    fn what_is_far_away_costs_a_chain_of_cells() {
        for leaf_size in [1, 20] {
            let alone = checked(&scattered(500, 1.0), leaf_size).cells.len();
            for extents in [1e6, 1e9, 1e12, 1e15] {
                // One on either side puts the centre of the root, a corner of cells, amid the others.
                for sides in [&[1.0][..], &[1.0, -1.0]] {
                    let mut points = scattered(500, 1.0);
                    points.extend(
                        sides.iter().map(|side| DVec3::new(0.9, -0.7, 1.0) * side * extents),
                    );
                    let cells = checked(&points, leaf_size).cells.len();
                    let levels = extents.log2() as usize + 2;
                    assert!(cells < 2 * alone + 8 * levels, "{cells} {alone} {levels}");
                }
            }
        }
    }

    #[test]
    fn clusters_in_clusters_are_divided_where_they_are_dense() {
        let at = DVec3::new(0.317, -0.273, 0.711);
        let mut points = scattered(300, 1.0);
        points.extend(scattered(300, 1e-5).iter().map(|p| *p + at));
        points.extend(scattered(300, 1e-10).iter().map(|p| *p + at));
        let tree = checked(&points, 10);
        let leaves = tree.shape.leaves.iter().map(|&leaf| &tree.shape.nodes[leaf as usize]);
        assert!(leaves.clone().all(|leaf| leaf.count() <= 10));
        assert!(leaves.map(Node::level).max() > Some(33));
        assert!(tree.cells.len() < 900);
    }

    #[test]
    fn single_precision_is_used_up_as_well() {
        let chain: Vec<Vec3> = (0..60).map(|i| Vec3::X * 0.5f32.powi(i)).collect();
        assert_eq!(checked(&chain, 1).shape.leaves.len(), 60);
        for (extents, scale) in [(1e6, 1.0), (1e9, 1e-3), (1e12, 1e6), (1e9, 1e-30)] {
            let mut points = scattered(500, scale);
            // One coordinate is the same for all, and coarse beside the others.
            points.iter_mut().for_each(|p| p.y = 0.7 * extents * scale);
            points.push(DVec3::new(0.9, -0.7, 1.0) * extents * scale);
            let points: Vec<Vec3> = points.iter().map(|p| p.as_vec3()).collect();
            let tree = checked(&points, 10);
            if scale > 1e-20 {
                assert!(tree.shape.leaves.len() > 50, "{extents}");
            }
        }
    }
}
