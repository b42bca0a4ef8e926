//! The octree: its root cube and cells, Morton keys, the tree over one point set and over two.

pub(crate) mod bounds;
pub(crate) mod bulk;
pub(crate) mod geometry;
pub(crate) mod morton;
pub(crate) mod shape;
pub(crate) mod tree;
pub(crate) mod trees;
