//! The trees over sources and targets, and the points in their order.

use std::sync::Arc;

use crate::error::{Error, PointSet};
use crate::numbers::traits::Located;
use crate::octree::bounds::Bounds;
use crate::octree::bulk::root_cube;
use crate::octree::geometry::Cube;
use crate::octree::tree::Tree;
use crate::parallel;
use crate::parallel::watch::Watch;

/// Source and target tree on one root cube; one tree if the points are the same in the same order.
pub(crate) struct Trees<S: Located, X: Located<Real = S::Real>> {
    pub(crate) root: Cube<S::Real>,
    /// The largest number of points in a leaf that can be split.
    pub(crate) leaf_size: usize,
    pub(crate) source_tree: Arc<Tree<S::Real>>,
    pub(crate) target_tree: Arc<Tree<S::Real>>,
    /// Sources in tree order.
    pub(crate) sources: Vec<S>,
    /// Targets in tree order.
    pub(crate) targets: Vec<X>,
}

impl<S: Located, X: Located<Real = S::Real>> Trees<S, X> {
    /// Sorts the points into cells of at most as many points as `leaf_size` says, which is asked once
    /// the points are known to be finite. With a `unit`, cells have that half-width times powers of two.
    pub(crate) fn new(
        sources: &[S],
        targets: &[X],
        leaf_size: &dyn Fn() -> usize,
        unit: Option<S::Real>,
        watch: &Watch,
    ) -> Result<Self, Error> {
        let bounds = Bounds::new(PointSet::Sources, sources)?;
        let bounds = bounds.join(Bounds::new(PointSet::Targets, targets)?);
        let root = root_cube(&bounds, sources, targets, unit)?;
        let leaf_size = leaf_size();
        if leaf_size == 0 {
            return Err(Error::InvalidLeafSize);
        }
        let source_tree = Arc::new(Tree::new(&root, sources, leaf_size, watch)?);
        let same_points = sources.len() == targets.len()
            && parallel::all(sources.len(), &|i| sources[i].position() == targets[i].position());
        let target_tree = if same_points {
            Arc::clone(&source_tree)
        } else {
            Arc::new(Tree::new(&root, targets, leaf_size, watch)?)
        };
        watch.check()?;
        let sources = in_tree_order(sources, &source_tree);
        watch.check()?;
        let targets = in_tree_order(targets, &target_tree);
        Ok(Self { root, leaf_size, source_tree, target_tree, sources, targets })
    }

    /// Number of levels of the deeper tree.
    pub(crate) fn levels(&self) -> usize {
        self.source_tree.shape.levels().max(self.target_tree.shape.levels())
    }

    /// Bytes of trees and points, and of the targets' places.
    pub(crate) fn bytes(&self) -> usize {
        let shared = Arc::ptr_eq(&self.source_tree, &self.target_tree);
        self.source_tree.bytes()
            + if shared { 0 } else { self.target_tree.bytes() }
            + size_of_val(&self.sources[..])
            + size_of_val(&self.targets[..])
            + self.targets.len() * size_of::<u32>()
    }
}

fn in_tree_order<P: Located>(points: &[P], tree: &Tree<P::Real>) -> Vec<P> {
    let order = &tree.shape.order;
    parallel::map_many(order.len(), &|rank| points[order[rank] as usize].clone())
}
