//! What a plan tells its expansion.

use crate::expansion::admissibility::Admissibility;
use crate::numbers::traits::{Point, Real};
use crate::octree::geometry::Cube;
use crate::parallel::watch::Watch;

/// What a plan will ask of its expansion.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Geometry<T: Real> {
    /// The root cube of both trees.
    pub root: Cube<T>,
    /// The levels at which expansions are formed, from the coarsest to the finest.
    pub levels: Vec<Level<T>>,
    /// Which pairs of cells are carried: everything at first, then what the expansion
    /// [admitted](crate::Expansion::admits).
    pub admissibility: Admissibility,
    /// Seconds of one core that [`prepare`](crate::Expansion::prepare) may take, with all that it took before
    /// for more pairs of cells. An expansion that would take
    /// longer had better refuse with [`Error::OverWork`](crate::Error::OverWork) as soon as it sees that: where the engine may
    /// choose the scheme, it then sums directly.
    pub most_seconds: f64,
    /// Likewise those that the far field of an application may take.
    pub most_apply_seconds: f64,
    /// Seconds of one core that a pair summed directly takes.
    pub pair_seconds: f64,
    /// Some of the sources, spread over all of them; none where they are not known.
    pub sources: Vec<Point<T>>,
    /// Likewise of the targets.
    pub targets: Vec<Point<T>>,
    /// Whoever prepares something long looks here now and then whether it shall end, and refuses with
    /// [`Error::Stopped`](crate::Error::Stopped) then.
    pub watch: Watch,
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
    /// How strongly its pairs of points act; none where that is not known. Errors are then best taken relative
    /// to the pairs themselves.
    pub values: Option<Strength>,
    /// Likewise the derivatives of the kernel with respect to the target, where the kernel
    /// [needs them](crate::Kernel::needs_gradients).
    pub slopes: Option<Strength>,
    /// What errors of each field may be taken relative to if all have their share of the errors of a pair's values, where
    /// there are several and that is known. The [size](Strength::size) of all values is the least of these and of those
    /// of densities.
    pub fields: Vec<f64>,
    /// Likewise of what each density sends.
    pub densities: Vec<f64>,
}

/// How strongly the pairs of points act that meet through a level, beside the sums that they are part of.
///
/// A relative tolerance ε speaks of whole sums, near field included. Where little of them comes through a level,
/// its pairs may be off by more than ε of what they carry; where the level holds weak pairs only, by less than ε
/// of what others of their size carry. The engine measures both at some targets: for charges of like size,
/// of either sign and of one sign, or for the very charges of a sum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Strength {
    /// The root mean square of |G| over these pairs; 0 if none was met.
    pub pair: f64,
    /// How many cells share what a target receives: with few, errors do not average out.
    pub cells: f64,
    /// What errors of these pairs may be taken relative to: if all pairs of L levels are off by ε·`size`/√L, then
    /// sums are off by ε. Infinite if none was met.
    pub size: f64,
    /// The same if pairs that meet at coarser levels are off as well: their terms pass through cells of this
    /// level.
    pub through: f64,
}

impl<T: Real> Level<T> {
    /// A level of cells of that half-width, with one M2L pair at each of these offsets.
    pub fn new(level: usize, half_width: T, offsets: Vec<[i32; 3]>) -> Self {
        let pairs = offsets.len();
        let (values, slopes, fields, densities) = (None, None, Vec::new(), Vec::new());
        Self { level, half_width, offsets, pairs, values, slopes, fields, densities }
    }
}

impl<T: Real> Geometry<T> {
    /// Levels for which an expansion may be prepared as long as it takes.
    pub fn new(root: Cube<T>, levels: Vec<Level<T>>) -> Self {
        let (sources, targets) = (Vec::new(), Vec::new());
        let (most_seconds, most_apply_seconds) = (f64::INFINITY, f64::INFINITY);
        let admissibility = Admissibility::default();
        Self {
            root,
            levels,
            admissibility,
            most_seconds,
            most_apply_seconds,
            pair_seconds: 0.0,
            sources,
            targets,
            watch: Watch::default(),
        }
    }

    /// The distinct offsets of all levels together, in ascending order.
    pub fn all_offsets(&self) -> Vec<[i32; 3]> {
        let mut offsets: Vec<_> = self.levels.iter().flat_map(|l| l.offsets.clone()).collect();
        offsets.sort_unstable();
        offsets.dedup();
        offsets
    }
}
