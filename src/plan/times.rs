//! Where the time goes.

use std::time::Instant;

/// Seconds that building a plan took, part by part.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct BuildTimes {
    /// Checking the points and sorting them into trees.
    pub tree: f64,
    /// Finding the interaction lists and asking the mask.
    pub lists: f64,
    /// Preparing the expansion's operators.
    pub operators: f64,
}

/// Seconds that one application took, operator by operator.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct ApplyTimes {
    /// Bringing charges into tree order and values back into the caller's, with their checks.
    pub permutation: f64,
    /// Sources to multipole terms.
    pub p2m: f64,
    /// Children's multipole terms to their parents'.
    pub m2m: f64,
    /// Multipole terms to local terms.
    pub m2l: f64,
    /// Parents' local terms to their children's, and P2L: sources to local terms.
    pub l2l: f64,
    /// Local terms to values.
    pub l2p: f64,
    /// Multipole terms to values, and whatever an optional operator declined.
    pub m2p: f64,
    /// Pairs summed directly.
    pub near: f64,
}

impl ApplyTimes {
    /// All of it.
    pub fn total(&self) -> f64 {
        let Self { permutation, p2m, m2m, m2l, l2l, l2p, m2p, near } = self;
        permutation + p2m + m2m + m2l + l2l + l2p + m2p + near
    }
}

/// Tells how long each part of a job took.
#[derive(Debug)]
pub(crate) struct Clock {
    last: Instant,
}

impl Clock {
    pub(crate) fn start() -> Self {
        Self { last: Instant::now() }
    }

    /// Adds the seconds since the last call, or since the start, to `part`.
    pub(crate) fn lap(&mut self, part: &mut f64) {
        let now = Instant::now();
        *part += (now - self.last).as_secs_f64();
        self.last = now;
    }
}
