//! When an iteration ends: by its residual, by a limit, because it gets no further, or because it is told to.

use std::ops::ControlFlow;

use crate::error::Error;
use crate::solvers::solution::Stop;

/// What the callback `progress` of a solver may return: nothing, or whether to go on.
///
/// On [`ControlFlow::Break`] a solver returns the radiosity that it has, with its residual. The
/// [`Solution`](crate::Solution) is marked as `interrupted` unless it meets the tolerance.
/// [`conjugate_gradients`](crate::conjugate_gradients) and [`bicgstab`](crate::bicgstab) then gather once
/// more, since between restarts they know only an estimate of the residual.
pub trait Report {
    /// Whether to go on.
    fn flow(self) -> ControlFlow<()>;
}

impl Report for () {
    fn flow(self) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

impl Report for ControlFlow<()> {
    fn flow(self) -> ControlFlow<()> {
        self
    }
}

/// Reports an iteration's residuals and decides when it ends.
pub(crate) struct Watch<P> {
    stop: Stop,
    progress: P,
    /// How many iterations are as good as one gathering.
    unit: usize,
    /// A residual is progress if it is less than this share of the one that was progress before.
    share: f64,
    /// The least residual of all.
    least: f64,
    last: Mark,
    /// The same for estimates, since the residual itself was looked at.
    estimated: Mark,
    /// The last residual that rounding had spoilt.
    corrected: f64,
    interrupted: bool,
}

/// The last residual that was progress, and when that was.
#[derive(Clone, Copy)]
struct Mark {
    residual: f64,
    iteration: usize,
    /// The gatherings without progress after which to doubt that there will be any.
    patience: usize,
}

/// A residual that has grown so much over the best one seen won't come down again.
const DIVERGENCE: f64 = 100.0;

/// The share of the tolerance to which the estimate of the residual must fall before the residual
/// itself is looked at.
const ESTIMATE_SHARE: f64 = 0.9;

/// The gatherings without progress after which the operator's rounding is measured. It is measured again
/// after twice as many, four times as many and so on: a residual may well rise before it falls, where
/// light goes from a few surfels to many.
pub(crate) const DOUBT: usize = 8;

/// The gatherings without progress after which no more is expected, whatever the reason.
pub(crate) const PLATEAU: usize = 100;

/// A residual that has grown by this factor in the course of a plateau grows without end, if slowly.
const GROWTH: f64 = 1.1;

impl<P: FnMut(usize, f64) -> R, R: Report> Watch<P> {
    /// For an iteration whose every residual is known: each should be less than all before.
    pub(crate) fn new(stop: Stop, progress: P) -> Self {
        Self {
            stop,
            progress,
            unit: 1,
            share: 1.0,
            least: f64::INFINITY,
            last: Mark::NONE,
            estimated: Mark::NONE,
            corrected: f64::INFINITY,
            interrupted: false,
        }
    }

    /// For an iteration of which so many steps are as good as one gathering.
    pub(crate) fn of_steps(stop: Stop, progress: P, unit: usize) -> Self {
        Self { unit: unit.max(1), ..Self::new(stop, progress) }
    }

    /// For an iteration that goes by estimates: when it looks at a residual, that should have been halved.
    pub(crate) fn of_estimates(stop: Stop, progress: P) -> Self {
        Self { share: 0.5, ..Self::new(stop, progress) }
    }

    /// Whether to return what has this residual: it reaches the tolerance, or `progress` has had enough.
    /// An error if it never will reach it or may no longer be tried. `floor` measures the residual that
    /// the operator's rounding may leave.
    pub(crate) fn is_done(
        &mut self,
        iterations: usize,
        residual: f64,
        floor: impl FnOnce() -> Result<f64, Error>,
    ) -> Result<bool, Error> {
        self.report(iterations, residual);
        let tolerance = self.stop.tolerance;
        if residual <= tolerance {
            return Ok(true);
        }
        if !(residual.is_finite() && residual <= DIVERGENCE * self.least) {
            return Err(Error::Diverged { iterations, residual });
        }
        if self.interrupted {
            return Ok(true);
        }
        self.least = self.least.min(residual);
        if iterations >= self.stop.max_iterations {
            return Err(Error::NotConverged { iterations, residual, tolerance });
        }
        self.estimated = Mark::NONE;
        if !self.last.falls(iterations, residual, self.share) {
            let idle = (iterations - self.last.iteration) / self.unit;
            if idle >= self.last.patience.min(PLATEAU) {
                self.last.patience *= 2;
                let floor = floor()?;
                if self.least > floor && idle >= PLATEAU && residual > GROWTH * self.least {
                    return Err(Error::Diverged { iterations, residual });
                }
                if self.least <= floor || idle >= PLATEAU {
                    return Err(self.stagnated(iterations, floor));
                }
            }
        }
        Ok(false)
    }

    /// Whether to go on by an estimate of the residual, without a look at the residual itself.
    pub(crate) fn goes_on(&mut self, iterations: usize, estimate: f64) -> bool {
        self.report(iterations, estimate);
        let needed = estimate > ESTIMATE_SHARE * self.stop.tolerance && estimate.is_finite();
        let falls = self.estimated.falls(iterations, estimate, 1.0)
            || iterations - self.estimated.iteration < PLATEAU * self.unit;
        needed && falls && iterations < self.stop.max_iterations && !self.interrupted
    }

    /// Takes note that a residual, kept up to date step by step, has become `residual` by rounding. An
    /// error if that is what rounding leaves, or no less than half of what it left the time before.
    pub(crate) fn correct(
        &mut self,
        iterations: usize,
        residual: f64,
        floor: f64,
    ) -> Result<(), Error> {
        if residual > self.stop.tolerance {
            self.least = residual;
            if residual <= floor || residual > 0.5 * self.corrected {
                return Err(self.stagnated(iterations, floor));
            }
            self.corrected = residual;
            self.last = Mark { residual, iteration: iterations, ..Mark::NONE };
        }
        Ok(())
    }

    fn stagnated(&self, iterations: usize, floor: f64) -> Error {
        let (residual, tolerance) = (self.least, self.stop.tolerance);
        Error::Stagnated { iterations, residual, tolerance, floor }
    }

    fn report(&mut self, iterations: usize, residual: f64) {
        self.interrupted |= (self.progress)(iterations, residual).flow().is_break();
    }
}

impl Mark {
    const NONE: Self = Self { residual: f64::INFINITY, iteration: 0, patience: DOUBT };

    /// Whether a residual is less than a share of the last that was: then it is the last.
    fn falls(&mut self, iteration: usize, residual: f64, share: f64) -> bool {
        let falls = residual < share * self.residual;
        if falls {
            *self = Self { residual, iteration, ..Self::NONE };
        }
        falls
    }
}
