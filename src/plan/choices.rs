//! What is chosen for a plan besides its expansion and mask, and what follows for its set-up.

use crate::error::Error;
use crate::numbers::traits::Real;
use crate::plan::Scheme;
use crate::plan::estimate::Estimate;
use crate::plan::times::Progress;
use crate::plan::tuning::{
    ASKED_PAIR_SECONDS, ASKED_SECONDS, ASKED_SUMS, BARGAIN, DIRECT_DIGITS, SET_UP_SECONDS,
};

/// What is chosen besides expansion and mask.
#[derive(Clone, Copy)]
pub(crate) struct Choices<'a> {
    pub(crate) scheme: Option<Scheme>,
    pub(crate) leaf_size: Option<usize>,
    pub(crate) masked: bool,
    pub(crate) applications: usize,
    pub(crate) memory_budget: Option<usize>,
    pub(crate) progress: Option<&'a (dyn Fn(Progress) + Sync)>,
}

impl Default for Choices<'_> {
    fn default() -> Self {
        Self {
            scheme: None,
            leaf_size: None,
            masked: false,
            applications: 1,
            memory_budget: None,
            progress: None,
        }
    }
}

impl Choices<'_> {
    /// Seconds of one core that the operators are worth, and that a pair takes: nominal ones where a scheme is
    /// asked for, so that nothing that is measured decides whether that is done.
    pub(crate) fn worth(
        &self,
        estimate: Option<&Estimate>,
        pairs: f64,
        pair_seconds: impl FnOnce() -> f64,
    ) -> (f64, f64) {
        if self.masked {
            return (f64::INFINITY, ASKED_PAIR_SECONDS);
        }
        let chosen = self.scheme.is_none() && self.leaf_size.is_none();
        let Some(estimate) = estimate.filter(|_| chosen) else {
            let most = ASKED_SECONDS + ASKED_SUMS * pairs * ASKED_PAIR_SECONDS;
            return (most, ASKED_PAIR_SECONDS);
        };
        // What direct sums would take, but for what the applications do.
        let (threads, applications) = (rayon::current_num_threads(), self.applications);
        let saved = (BARGAIN * estimate.direct_seconds - estimate.apply_seconds()).max(0.0);
        let most = threads as f64 * (applications as f64 * saved + SET_UP_SECONDS);
        (most, pair_seconds())
    }

    /// Seconds of one core that an application may take if direct sums take `direct_seconds`.
    pub(crate) fn most_apply_seconds(&self, direct_seconds: f64) -> f64 {
        if self.masked { f64::INFINITY } else { BARGAIN * direct_seconds + SET_UP_SECONDS }
    }

    /// Whether direct sums in the precision `T` can do what an expansion refuses. Asking a mask for every pair
    /// is another matter.
    pub(crate) fn may_sum_directly<T: Real>(&self, refusal: &Error) -> bool {
        let within_reach = match refusal {
            Error::OverWork { .. } | Error::NonFiniteKernel => true,
            Error::UnreachableTolerance { requested, .. } => {
                *requested >= DIRECT_DIGITS * T::epsilon().as_f64()
            }
            _ => false,
        };
        within_reach && !self.masked
    }
}
