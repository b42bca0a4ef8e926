//! The plan of one sum over many ranks.

use std::fmt;

use farfield::{
    ChargeOf, Expansion, Kernel, Numbers, Part, PartMoments, RealOf, SourceOf, ValueOf,
};

use crate::collective::agree;
use crate::error::Error;
use crate::moments::{Served, SharedMoments, largest};
use crate::places::ServedPlaces;
use crate::points::Layout;
use crate::transport::Transport;

/// A plan for sums between fixed points that are spread over the ranks of a [`Transport`].
///
/// Every rank brings some of the sources and some of the targets, and gets the values at its targets. All ranks build and
/// apply the plan together. No rank holds all points: each is brought those in a piece of the Morton curve, and what its targets
/// need of the others. Values have the same bits for any number of ranks, and for any way in which the same points, in the
/// same order from rank to rank, are spread over them.
///
/// ```
/// use farfield::from_fn;
/// use farfield::glam::DVec3;
/// use farfield_mpi::{DistributedFmm, Transport, on_threads};
///
/// let kernel = from_fn(|x: DVec3, y: DVec3| (-x.distance(y)).exp());
/// let sums = on_threads(3, |ranks| {
///     let number = |i: i32| f64::from(3 * i) + ranks.rank() as f64;
///     let my_points: Vec<DVec3> = (0..40).map(|i| DVec3::splat(number(i)).map(f64::sin)).collect();
///     let fmm = DistributedFmm::builder(kernel, ranks).tolerance(1e-4).build(&my_points, &my_points)?;
///     fmm.apply(&vec![1.0; my_points.len()])
/// });
/// assert!(sums.iter().all(|sums| sums.as_ref().is_ok_and(|sums| sums.len() == 40)));
/// ```
pub struct DistributedFmm<'a, E: Expansion> {
    pub(crate) ranks: &'a dyn Transport,
    pub(crate) sources: Layout,
    pub(crate) targets: Layout,
    /// The sources that are here, along the curve.
    pub(crate) own_sources: Vec<SourceOf<E>>,
    pub(crate) moments: PartMoments<RealOf<E>>,
    pub(crate) shared: SharedMoments<RealOf<E>>,
    pub(crate) coarsest: usize,
    pub(crate) levels: usize,
    pub(crate) part: Part<E>,
    pub(crate) cells: Served,
    pub(crate) places: ServedPlaces,
}

impl<E: Expansion> DistributedFmm<'_, E> {
    /// The sums u_i = Σ_j K(x_i, y_j) q_j over the sources of all ranks at this rank's targets, in the caller's order, for
    /// the charges of this rank's sources. All ranks call it. O(N/P), and O((N/P)^⅔) words to others.
    ///
    /// The tolerance holds as for [`Fmm::apply`](farfield::Fmm::apply), over the targets of all ranks.
    ///
    /// # Errors
    /// On all ranks alike, if a rank has not one charge per source, or a charge or a sum that is not finite.
    pub fn apply(&self, my_charges: &[ChargeOf<E>]) -> Result<Vec<ValueOf<E>>, Error> {
        let (ranks, expansion) = (self.ranks, self.part.expansion());
        let checked = check_charges(expansion.kernel(), self.sources.route.callers(), my_charges);
        agree(ranks, checked)?;
        let charges = self.sources.route.to_owners(ranks, my_charges)?;
        let formed = self.moments.form(expansion, self.coarsest, &self.own_sources, &charges);
        let mut terms = agree(ranks, formed)?;
        self.shared.add(ranks, expansion, self.coarsest, &mut terms)?;
        let largest = largest(ranks, &terms, self.levels)?;
        let mut messages = vec![Vec::new(); ranks.size()];
        self.cells.send(expansion, &terms, &mut messages);
        self.places.send(&charges, &mut messages);
        let messages = ranks.exchange(messages)?;
        let mut messages: Vec<_> = messages.iter().map(|words| words.iter()).collect();
        let multipoles = self.cells.receive(expansion, &mut messages);
        let charges: Vec<ChargeOf<E>> = self.places.receive(&mut messages);
        let values = agree(ranks, self.part.apply(&charges, &multipoles, &largest))?;
        let values = self.targets.route.to_callers(ranks, &values)?;
        let not_finite = values.iter().position(|value| !value.is_finite());
        let finite = match not_finite {
            Some(index) => {
                Err(farfield::Error::NonFiniteValue { index, value: values[index].to_f64s() })
            }
            None => Ok(values),
        };
        agree(ranks, finite)
    }

    /// The expansion, as prepared for this plan.
    pub fn expansion(&self) -> &E {
        self.part.expansion()
    }

    /// What this rank holds, and what it needs of others.
    pub fn stats(&self) -> PartStats {
        let rank = self.ranks.rank();
        PartStats {
            sources: self.own_sources.len(),
            targets: self.targets.borders.of(rank).len(),
            source_cells: self.sources.cells.len(),
            cells_of_others: self.cells.needed_of_others(rank),
            sources_of_others: self.places.needed_of_others(rank),
        }
    }
}

/// What a rank has of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct PartStats {
    /// Sources in its piece of the curve.
    pub sources: usize,
    /// Targets in its piece of the curve.
    pub targets: usize,
    /// Cells that have sources of its own.
    pub source_cells: usize,
    /// Cells of other ranks whose multipole terms it is sent at every application.
    pub cells_of_others: usize,
    /// Sources of other ranks whose charges it is sent at every application.
    pub sources_of_others: usize,
}

fn check_charges<K: Kernel>(
    kernel: &K,
    expected: usize,
    charges: &[K::Charge],
) -> Result<(), farfield::Error> {
    let found = charges.len();
    if found != expected {
        return Err(farfield::Error::LengthMismatch { what: "charges", expected, found });
    }
    // Charges that are lists.
    let most = if K::Charge::LEN == 0 { kernel.charge_len() } else { K::Charge::LEN };
    if let Some(index) = charges.iter().position(|charge| charge.count() > most) {
        let found = charges[index].count();
        return Err(farfield::Error::ChargeTooLong { index, expected: most, found });
    }
    match charges.iter().position(|charge| !charge.is_finite()) {
        Some(index) => {
            Err(farfield::Error::NonFiniteCharge { index, charge: charges[index].to_f64s() })
        }
        None => Ok(()),
    }
}

impl<E: Expansion> fmt::Debug for DistributedFmm<'_, E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DistributedFmm").field("stats", &self.stats()).finish_non_exhaustive()
    }
}
