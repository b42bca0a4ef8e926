//! What is chosen for a plan besides its expansion and mask, and what follows for its set-up.

use crate::error::Error;
use crate::numbers::traits::Real;
use crate::parallel::watch::{Progress, Watch};
use crate::plan::Scheme;
use crate::plan::estimate::Estimate;
use crate::plan::tuning::{ASKED_SECONDS, ASKED_SUMS, BARGAIN, DIRECT_DIGITS, SET_UP_SECONDS};

/// Where it is known from how long a pair takes that is summed directly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Pace {
    /// The kernel says it.
    Declared,
    /// The caller says it: seconds of one core.
    Stated(f64),
    /// It is measured, as is how long applications take.
    Measured,
}

/// What is chosen besides expansion and mask.
#[derive(Clone)]
pub(crate) struct Choices<'a> {
    pub(crate) scheme: Option<Scheme>,
    pub(crate) leaf_size: Option<usize>,
    pub(crate) masked: bool,
    pub(crate) applications: usize,
    pub(crate) pace: Pace,
    pub(crate) memory_budget: Option<usize>,
    pub(crate) progress: Option<&'a (dyn Fn(Progress) + Sync)>,
    pub(crate) watch: Watch,
    /// Half the edge of a cell whose sizes operators are at hand for: cells are to have that times powers of two.
    pub(crate) unit: Option<f64>,
}

impl Default for Choices<'_> {
    fn default() -> Self {
        Self {
            scheme: None,
            leaf_size: None,
            masked: false,
            applications: 1,
            pace: Pace::Declared,
            memory_budget: None,
            progress: None,
            watch: Watch::default(),
            unit: None,
        }
    }
}

impl Choices<'_> {
    /// The same for a plan that takes the place of one with that root, whose progress nobody is told.
    pub(crate) fn kept(self, half_width: f64) -> Choices<'static> {
        Choices { progress: None, unit: self.unit.or(Some(half_width)), ..self }
    }

    /// Refuses a time of a pair that is none.
    ///
    /// # Errors
    /// [`Error::InvalidPairSeconds`].
    pub(crate) fn check(&self) -> Result<(), Error> {
        match self.pace {
            Pace::Stated(found) if !(found > 0.0 && found.is_finite()) => {
                Err(Error::InvalidPairSeconds { found })
            }
            _ => Ok(()),
        }
    }

    /// Seconds of one core that the operators are worth, if direct sums take `direct_seconds`. Where an expansion
    /// carries only some pairs of cells, it shows late whether it is of use: no more is ventured than may be lost.
    pub(crate) fn worth(
        &self,
        estimate: Option<&Estimate>,
        direct_seconds: f64,
        carries_all: bool,
    ) -> f64 {
        if self.masked {
            return f64::INFINITY;
        }
        let Some(estimate) = self.chosen(estimate) else {
            return ASKED_SECONDS + ASKED_SUMS * direct_seconds;
        };
        // What direct sums would take, but for what the applications do.
        let apply_seconds = estimate.apply_seconds() * rayon::current_num_threads() as f64;
        let saved = (BARGAIN * direct_seconds - apply_seconds).max(0.0);
        let worth = self.applications as f64 * saved + SET_UP_SECONDS;
        if carries_all { worth } else { worth.min(self.ventured(direct_seconds)) }
    }

    /// Seconds of one core that operators may take where it shows late whether they are of use: direct sums may have to
    /// follow.
    pub(crate) fn ventured(&self, direct_seconds: f64) -> f64 {
        self.applications as f64 * (BARGAIN - 1.0) * direct_seconds + SET_UP_SECONDS
    }

    /// Seconds of one core that the far field of an application may take if direct sums take `direct_seconds`. Unless
    /// an expansion is asked for, that and the near field have to take half the time of direct sums: where it is not
    /// known beforehand what an expansion takes, it may take twice as long.
    pub(crate) fn most_far_seconds(&self, estimate: Option<&Estimate>, direct_seconds: f64) -> f64 {
        if self.masked {
            return f64::INFINITY;
        }
        let Some(estimate) = self.chosen(estimate) else {
            return BARGAIN * direct_seconds + SET_UP_SECONDS;
        };
        let near_seconds = estimate.near_seconds * rayon::current_num_threads() as f64;
        (0.5 * direct_seconds - near_seconds).max(0.0)
    }

    /// The estimate of a scheme that was not asked for.
    fn chosen<'e>(&self, estimate: Option<&'e Estimate>) -> Option<&'e Estimate> {
        estimate.filter(|_| self.scheme.is_none() && self.leaf_size.is_none())
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Fmm, from_fn};
    use glam::DVec3;

    #[test]
    fn no_more_is_ventured_than_may_be_lost() {
        let points = [DVec3::ZERO, DVec3::X];
        let kernel = from_fn(|x: DVec3, y: DVec3| x.distance(y));
        let estimate = Fmm::builder(kernel).estimate(&points, &points).unwrap();
        let estimate = Estimate { near_seconds: 0.1, far_seconds: 0.0, ..estimate };
        let worth = |choices: &Choices<'_>, carries_all| {
            choices.worth(Some(&estimate), 10.0, carries_all) - SET_UP_SECONDS
        };
        let once = Choices::default();
        let saved = BARGAIN * 10.0 - 0.1 * rayon::current_num_threads() as f64;
        assert!((worth(&once, true) - saved).abs() < 1e-9);
        let lost = (BARGAIN - 1.0) * 10.0;
        assert!((worth(&once, false) - lost).abs() < 1e-9);
        let often = Choices { applications: 7, ..Choices::default() };
        assert!((worth(&often, false) - 7.0 * lost).abs() < 1e-9);
        // What is asked for is tried.
        let asked = Choices { scheme: Some(Scheme::Fmm), ..Choices::default() };
        assert!(worth(&asked, false) > ASKED_SECONDS - 1.0);
    }
}
