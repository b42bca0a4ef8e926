//! Masks: which pairs count.

use crate::error::Error;
use crate::kernel::traits::Kernel;
use crate::numbers::traits::{Located, Numbers, Real};
use crate::octree::geometry::Cell;
use crate::parallel;

/// Whether the pairs between two cells count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coverage {
    /// Every pair counts: the expansion may be used.
    Full,
    /// No pair counts: nothing is computed.
    Empty,
    /// Some may, some may not, or it is not known: the cells are split, and leaf pairs are asked
    /// for one by one.
    Partial,
    /// So many eighths of them count, 1 to 7, and which of them doesn't matter: the expansion is used
    /// and weighed. Taken as [`Partial`](Self::Partial) where the expansion [can't
    /// weigh](crate::Expansion::weighs) or the cells are not well separated ones of one level.
    Eighths(u8),
}

/// A cell together with the points in it.
#[derive(Debug)]
pub struct CellView<'a, P: Located> {
    /// The cell.
    pub cell: &'a Cell<P::Real>,
    /// Its points, at least one.
    pub points: &'a [P],
}

impl<P: Located> Clone for CellView<'_, P> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<P: Located> Copy for CellView<'_, P> {}

/// The factor V(x, y) of a sum Σ_j K(x, y_j) V(x, y_j) q_j, from 0 to 1, such as visibility.
///
/// It is not smooth, so it never enters an expansion: the engine uses the expansion between cells
/// only where *every* pair counts in full, or where [`Coverage::Eighths`] says that all count alike.
/// Masks are geometry: they are asked while a plan is built and never again, and each pair of points is
/// asked for at most once.
pub trait Mask<K: Kernel>: Sync {
    /// What holds for all pairs between two cells. [`Coverage::Partial`] is never wrong, only slow.
    fn cells(&self, targets: CellView<'_, K::Target>, sources: CellView<'_, K::Source>)
    -> Coverage;

    /// The share of the pair (x, y) that counts: 1 if it does, 0 if it does not, anything between if it
    /// counts in part. Must agree with [`cells`](Self::cells). Where pairs count or do not,
    /// `f64::from(condition)` says it.
    fn pair(&self, x: &K::Target, y: &K::Source) -> f64;

    /// Calls `count(i, j, share)` once for every pair of the i-th target and the j-th source that counts
    /// at all. Override it to share work among the pairs of two cells; the answers must be those of
    /// [`pair`](Self::pair).
    fn pairs(
        &self,
        targets: CellView<'_, K::Target>,
        sources: CellView<'_, K::Source>,
        count: &mut dyn FnMut(usize, usize, f64),
    ) {
        for (i, x) in targets.points.iter().enumerate() {
            for (j, y) in sources.points.iter().enumerate() {
                let share = self.pair(x, y);
                if share != 0.0 {
                    count(i, j, share);
                }
            }
        }
    }

    /// Whether the pair of target i and source j counts by the same share as that of target j and source
    /// i, for every i and j. The engine then asks [`pairs`](Self::pairs) for one of two mirrored leaf
    /// pairs only. Never wrong to deny.
    fn is_mirrored(&self, _targets: &[K::Target], _sources: &[K::Source]) -> bool {
        false
    }
}

/// The mask that lets every pair count.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unmasked;

impl<K: Kernel> Mask<K> for Unmasked {
    fn cells(&self, _: CellView<'_, K::Target>, _: CellView<'_, K::Source>) -> Coverage {
        Coverage::Full
    }

    fn pair(&self, _: &K::Target, _: &K::Source) -> f64 {
        1.0
    }
}

/// Direct summation with a mask: u_i = Σ_j K(x_i, y_j) V(x_i, y_j) q_j, asking for every pair.
/// O(N·M): the reference for masked plans.
///
/// # Errors
/// [`Error::LengthMismatch`] if there is not one charge per source.
pub fn direct_masked<K: Kernel>(
    kernel: &K,
    mask: &impl Mask<K>,
    sources: &[K::Source],
    charges: &[K::Charge],
    targets: &[K::Target],
) -> Result<Vec<K::Value>, Error> {
    Error::check_charges(sources.len(), charges.len())?;
    let sum = |i: usize| {
        let mut u = [K::Value::zero()];
        for (j, y) in sources.iter().enumerate() {
            let share = mask.pair(&targets[i], y);
            if share != 0.0 {
                let q = share_of(&charges[j], share);
                kernel.add_block(&targets[i..=i], &sources[j..=j], &[q], 0.0, &mut u);
            }
        }
        let [u] = u;
        u
    };
    Ok(parallel::map(targets.len(), &sum))
}

/// The share of a charge; all of it as it is.
pub(crate) fn share_of<Q: Numbers>(charge: &Q, share: f64) -> Q {
    if share == 1.0 {
        return charge.clone();
    }
    let mut part = Q::zero();
    part.add_scaled(Q::Real::from_f64(share), charge);
    part
}

impl<K: Kernel, M: Mask<K>> Mask<K> for &M {
    fn cells(
        &self,
        targets: CellView<'_, K::Target>,
        sources: CellView<'_, K::Source>,
    ) -> Coverage {
        (**self).cells(targets, sources)
    }

    fn pair(&self, x: &K::Target, y: &K::Source) -> f64 {
        (**self).pair(x, y)
    }

    fn pairs(
        &self,
        targets: CellView<'_, K::Target>,
        sources: CellView<'_, K::Source>,
        count: &mut dyn FnMut(usize, usize, f64),
    ) {
        (**self).pairs(targets, sources, count);
    }

    fn is_mirrored(&self, targets: &[K::Target], sources: &[K::Source]) -> bool {
        (**self).is_mirrored(targets, sources)
    }
}
