//! Counts of the pairs that a mask was asked about.

use crate::masks::tally::Tally;

/// How the pairs of surfels that a [`Visibility`](crate::Visibility) was asked about fell out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PairCounts {
    /// Pairs that don't face each other.
    pub facing_away: u64,
    /// Pairs that face each other but are hidden by an occluder.
    pub hidden: u64,
    /// Pairs that see each other, found pair by pair.
    pub unhidden: u64,
    /// Pairs that see each other, found cell by cell.
    pub certified: u64,
    /// Pairs of which a share sees each other, found by samples, cell by cell.
    pub sampled: u64,
    /// Segments tested against the occluders.
    pub rays: u64,
}

impl PairCounts {
    /// All pairs.
    pub fn total(&self) -> u64 {
        self.facing_away + self.hidden + self.unhidden + self.certified + self.sampled
    }
}

/// The counts of a mask, which many threads add to.
#[derive(Debug)]
pub(crate) struct Counters {
    pub(crate) facing_away: Tally,
    pub(crate) hidden: Tally,
    pub(crate) unhidden: Tally,
    pub(crate) certified: Tally,
    pub(crate) sampled: Tally,
    pub(crate) rays: Tally,
    /// In whole units, so that sums don't depend on their order.
    variance: Tally,
    variance_unit: f64,
}

impl Counters {
    /// Those of a scene whose occluders have this [margin](crate::Occluders::margin). Its square is the
    /// unit in which variances times areas are counted: as fine for a scene of any size.
    pub(crate) fn new(margin: f64) -> Self {
        let unit = margin.powi(2);
        Self {
            facing_away: Tally::default(),
            hidden: Tally::default(),
            unhidden: Tally::default(),
            certified: Tally::default(),
            sampled: Tally::default(),
            rays: Tally::default(),
            variance: Tally::default(),
            variance_unit: if unit > 0.0 { unit } else { f64::MIN_POSITIVE },
        }
    }

    /// The counts so far.
    pub(crate) fn pairs(&self) -> PairCounts {
        PairCounts {
            facing_away: self.facing_away.total(),
            hidden: self.hidden.total(),
            unhidden: self.unhidden.total(),
            certified: self.certified.total(),
            sampled: self.sampled.total(),
            rays: self.rays.total(),
        }
    }

    pub(crate) fn add_variance(&self, variance: f64) {
        self.variance.add((variance / self.variance_unit) as u64);
    }

    /// The sum of all variances times areas.
    pub(crate) fn variance(&self) -> f64 {
        self.variance.total() as f64 * self.variance_unit
    }
}
