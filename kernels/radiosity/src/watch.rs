//! When an iteration ends: by its residual, by a limit, or because it is told to.

use std::ops::ControlFlow;

use farfield::Real;

use crate::error::Error;
use crate::solve::{Stop, check_length};

/// What a solver's `progress` may return: nothing, or whether to go on.
///
/// On [`ControlFlow::Break`] a solver returns the radiosity that it has, with the residual of that: its
/// [`Solution`](crate::Solution) is `interrupted` unless it is good enough. The Krylov solvers gather once
/// more for it, since between restarts they know an estimate only.
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
    best: f64,
    interrupted: bool,
}

/// A residual that has grown so much over the best one seen won't come down again.
const DIVERGENCE: f64 = 100.0;

/// The share of the tolerance to which the estimate of the residual must fall before the residual
/// itself is looked at.
const ESTIMATE_SHARE: f64 = 0.9;

impl<P: FnMut(usize, f64) -> R, R: Report> Watch<P> {
    pub(crate) fn new(stop: Stop, progress: P) -> Self {
        Self { stop, progress, best: f64::INFINITY, interrupted: false }
    }

    /// Whether to return what has this residual: it reaches the tolerance, or `progress` has had enough.
    /// An error if it never will reach it or may no longer be tried.
    pub(crate) fn is_done(&mut self, iterations: usize, residual: f64) -> Result<bool, Error> {
        self.report(iterations, residual);
        if residual <= self.stop.tolerance {
            return Ok(true);
        }
        if !(residual.is_finite() && residual <= DIVERGENCE * self.best) {
            return Err(Error::Diverged { iterations, residual });
        }
        if self.interrupted {
            return Ok(true);
        }
        if iterations >= self.stop.max_iterations {
            let tolerance = self.stop.tolerance;
            return Err(Error::NotConverged { iterations, residual, tolerance });
        }
        self.best = self.best.min(residual);
        Ok(false)
    }

    /// Whether to go on by an estimate of the residual, without a look at the residual itself.
    pub(crate) fn goes_on(&mut self, iterations: usize, estimate: f64) -> bool {
        self.report(iterations, estimate);
        let needed = estimate > ESTIMATE_SHARE * self.stop.tolerance && estimate.is_finite();
        needed && iterations < self.stop.max_iterations && !self.interrupted
    }

    fn report(&mut self, iterations: usize, residual: f64) {
        self.interrupted |= (self.progress)(iterations, residual).flow().is_break();
    }
}

/// `gather` with a look at the length of what it returns.
pub(crate) fn checked<T: Real, const BANDS: usize, E: Into<Error>>(
    mut gather: impl FnMut(&[[T; BANDS]]) -> Result<Vec<[T; BANDS]>, E>,
) -> impl FnMut(&[[T; BANDS]]) -> Result<Vec<[T; BANDS]>, Error> {
    move |radiosity| {
        let irradiance = gather(radiosity).map_err(E::into)?;
        check_length("irradiance", irradiance.len(), radiosity.len())?;
        Ok(irradiance)
    }
}

/// r = E + ρ H − B.
pub(crate) fn residuals<T: Real, const BANDS: usize>(
    emission: &[[T; BANDS]],
    reflectance: &[[T; BANDS]],
    irradiance: &[[T; BANDS]],
    radiosity: &[[T; BANDS]],
) -> Vec<[T; BANDS]> {
    let r = |i: usize, k: usize| {
        emission[i][k] + reflectance[i][k] * irradiance[i][k] - radiosity[i][k]
    };
    (0..emission.len()).map(|i| std::array::from_fn(|k| r(i, k))).collect()
}

/// The largest ‖r‖₂ / ‖E‖₂ over the bands; a band without light has none.
pub(crate) fn relative_residual<T: Real, const BANDS: usize>(
    residuals: &[[T; BANDS]],
    emission: &[[T; BANDS]],
) -> f64 {
    let norm = |rows: &[[T; BANDS]], k: usize| -> f64 {
        rows.iter().map(|row| row[k].norm_squared()).sum::<f64>().sqrt()
    };
    let ratios = (0..BANDS).map(|k| match (norm(residuals, k), norm(emission, k)) {
        (0.0, _) => 0.0,
        (r, e) => r / e,
    });
    // Unlike f64::max, this doesn't lose a NaN.
    ratios.fold(0.0, |largest, ratio| if ratio <= largest { largest } else { ratio })
}

pub(crate) fn add<T: Real, const BANDS: usize>(sum: &mut [T; BANDS], term: &[T; BANDS]) {
    for (s, t) in sum.iter_mut().zip(term) {
        *s += *t;
    }
}
