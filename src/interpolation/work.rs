//! What operators may cost to set up and to apply.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use crate::error::Error;
use crate::expansion::geometry::Geometry;
use crate::interpolation::tuning::{
    ENTRY_PAIRS, PROBING_SHARE, SET_UP_ENTRY, SET_UP_PAIRS, SET_UP_PRODUCT,
};
use crate::numbers::traits::Real;
use crate::parallel::watch::Watch;

/// Counts what set-up costs and ends it when that is more than it may.
///
/// Work is counted, not timed: evaluations of the kernel and products of numbers, each at a rate that is
/// fixed beforehand. What a step needs is foretold before it is taken, so that no factorisation is begun
/// that can't be afforded.
#[derive(Debug)]
pub(crate) struct Work {
    watch: Watch,
    /// Core seconds.
    limit: f64,
    /// Core seconds before the counts below.
    spent: f64,
    /// Core seconds of an application.
    apply_limit: f64,
    /// Core seconds of one evaluation of the kernel, and of one in an application.
    evaluation: f64,
    applied: f64,
    /// Evaluations so far.
    evaluations: AtomicU64,
    /// Multiply-adds so far.
    multiply_adds: AtomicU64,
}

impl Work {
    /// What a plan of that geometry may cost if so many core seconds have gone into it before.
    pub(crate) fn new<T: Real>(geometry: &Geometry<T>, spent: f64) -> Self {
        Self {
            watch: geometry.watch.clone(),
            limit: geometry.most_seconds,
            spent,
            apply_limit: geometry.most_apply_seconds,
            evaluation: SET_UP_PAIRS * geometry.pair_seconds + SET_UP_ENTRY,
            applied: ENTRY_PAIRS as f64 * geometry.pair_seconds,
            evaluations: AtomicU64::new(0),
            multiply_adds: AtomicU64::new(0),
        }
    }

    /// Counts evaluations that have been made.
    pub(crate) fn add_evaluations(&self, count: usize) {
        self.evaluations.fetch_add(count as u64, Relaxed);
    }

    /// Counts multiply-adds that have been made.
    pub(crate) fn add_products(&self, multiply_adds: f64) {
        self.multiply_adds.fetch_add(multiply_adds as u64, Relaxed);
    }

    /// Counts multiply-adds that are about to be made, unless they and what has been counted before
    /// are too many.
    ///
    /// # Errors
    /// [`Error::OverWork`], or [`Error::Stopped`].
    pub(crate) fn spend(&self, multiply_adds: f64) -> Result<(), Error> {
        self.afford(0.0, multiply_adds)?;
        self.add_products(multiply_adds);
        Ok(())
    }

    /// Whether so much can be afforded for finding out what set-up would take: a small part of
    /// what that may.
    ///
    /// # Errors
    /// [`Error::OverWork`], or [`Error::Stopped`].
    pub(crate) fn afford_probes(&self, evaluations: f64, multiply_adds: f64) -> Result<(), Error> {
        self.within(PROBING_SHARE, evaluations, multiply_adds)
    }

    /// Whether so many evaluations and multiply-adds can still be afforded.
    ///
    /// # Errors
    /// [`Error::OverWork`], or [`Error::Stopped`].
    pub(crate) fn afford(&self, evaluations: f64, multiply_adds: f64) -> Result<(), Error> {
        self.within(1.0, evaluations, multiply_adds)
    }

    /// Whether an application can afford so many evaluations.
    ///
    /// # Errors
    /// [`Error::OverWork`], or [`Error::Stopped`].
    pub(crate) fn afford_application(&self, evaluations: f64) -> Result<(), Error> {
        let (limit, needed) = (self.apply_limit, evaluations * self.applied);
        if needed <= limit { Ok(()) } else { Err(Error::OverWork { limit, needed }) }
    }

    /// Whether they fit, beside what has been counted, into a share of the limit.
    fn within(&self, share: f64, evaluations: f64, multiply_adds: f64) -> Result<(), Error> {
        self.watch.check()?;
        let more = evaluations * self.evaluation + multiply_adds * SET_UP_PRODUCT;
        let (limit, needed) = (self.limit, (self.seconds() + more) / share);
        if needed <= limit { Ok(()) } else { Err(Error::OverWork { limit, needed }) }
    }

    /// The core seconds that all that was counted comes to.
    pub(crate) fn seconds(&self) -> f64 {
        let evaluations = self.evaluations.load(Relaxed) as f64;
        let multiply_adds = self.multiply_adds.load(Relaxed) as f64;
        self.spent + evaluations * self.evaluation + multiply_adds * SET_UP_PRODUCT
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::octree::geometry::Cube;
    use glam::DVec3;

    #[test]
    fn what_is_too_much_is_refused_before_it_is_done() {
        let root = Cube::new(DVec3::ZERO, 1.0);
        let pair_seconds = (0.01 - SET_UP_ENTRY) / SET_UP_PAIRS;
        let geometry = Geometry {
            most_seconds: 1.0,
            most_apply_seconds: 10.0 * ENTRY_PAIRS as f64 * pair_seconds,
            pair_seconds,
            ..Geometry::new(root, Vec::new())
        };
        let work = Work::new(&geometry, 0.0);
        assert!(work.afford_application(9.0).is_ok() && work.afford_application(11.0).is_err());
        work.add_evaluations(50);
        assert!(work.afford(40.0, 0.05 / SET_UP_PRODUCT).is_ok());
        work.spend(0.4 / SET_UP_PRODUCT).unwrap();
        let Err(Error::OverWork { limit, needed }) = work.spend(0.2 / SET_UP_PRODUCT) else {
            panic!()
        };
        assert!(limit == 1.0 && (needed - 1.1).abs() < 1e-9, "{needed}");
        // What was refused does not count.
        assert!(work.afford(0.0, 0.05 / SET_UP_PRODUCT).is_ok());
        assert!(work.afford_probes(0.0, 0.0).is_err(), "probes had their share");
        // What was spent before does.
        let again = Work::new(&geometry, work.seconds());
        assert!(again.afford(5.0, 0.0).is_ok() && again.afford(15.0, 0.0).is_err());
    }
}
