//! What a plan tells its expansion.

use crate::numbers::traits::{Point, Real};
use crate::octree::geometry::Cube;

/// What a plan will ask of its expansion.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Geometry<T: Real> {
    /// The root cube of both trees.
    pub root: Cube<T>,
    /// The levels at which expansions are formed, from the coarsest to the finest.
    pub levels: Vec<Level<T>>,
    /// Seconds of one core that [`prepare`](crate::Expansion::prepare) may take. An expansion that would take
    /// longer had better refuse with [`Error::OverWork`](crate::Error::OverWork) as soon as it sees that: where the engine may
    /// choose the scheme, it then sums directly.
    pub most_seconds: f64,
    /// Seconds of one core that a pair summed directly takes.
    pub pair_seconds: f64,
    /// Some of the sources, spread over all of them; none where they are not known.
    pub sources: Vec<Point<T>>,
    /// Likewise of the targets.
    pub targets: Vec<Point<T>>,
}

/// One level of a plan.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Level<T: Real> {
    /// Its depth; the root's is 0.
    pub level: usize,
    /// Half the edge of its cells.
    pub half_width: T,
    /// The distinct integer vectors from source to target cell of its M2L pairs, in ascending order.
    pub offsets: Vec<[i32; 3]>,
    /// The number of its M2L pairs.
    pub pairs: usize,
}

impl<T: Real> Level<T> {
    /// A level of cells of that half-width, with one M2L pair at each of these offsets.
    pub fn new(level: usize, half_width: T, offsets: Vec<[i32; 3]>) -> Self {
        let pairs = offsets.len();
        Self { level, half_width, offsets, pairs }
    }
}

impl<T: Real> Geometry<T> {
    /// Levels for which an expansion may be prepared as long as it takes.
    pub fn new(root: Cube<T>, levels: Vec<Level<T>>) -> Self {
        let (sources, targets) = (Vec::new(), Vec::new());
        Self { root, levels, most_seconds: f64::INFINITY, pair_seconds: 0.0, sources, targets }
    }

    /// The distinct offsets of all levels together, in ascending order.
    pub fn all_offsets(&self) -> Vec<[i32; 3]> {
        let mut offsets: Vec<_> = self.levels.iter().flat_map(|l| l.offsets.clone()).collect();
        offsets.sort_unstable();
        offsets.dedup();
        offsets
    }
}
