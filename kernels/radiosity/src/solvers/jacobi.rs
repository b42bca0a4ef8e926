//! The radiosity equation by gathering.

use farfield::Real;

use crate::error::Error;
use crate::solvers::floor::floor;
use crate::solvers::residual::{add, checked, relative_residual, residuals};
use crate::solvers::solution::{Solution, Stop, check};
use crate::solvers::watch::{Report, Watch};

/// Jacobi's iteration B ← E + ρ H(B), known as gathering, from B = E.
///
/// `gather` is H: it takes the radiosity of all surfels to the irradiance of all surfels, such as
/// `|b| fmm.apply(b)`. `progress` receives the number of each iteration and its residual, and may end the
/// iteration; see [`Report`].
///
/// Each iteration reduces the error by the largest of ρ times the row sums of H: to 0.9ᵏ after k iterations
/// where all surfels of a closed room have a reflectance of 0.9. It may diverge where row sums exceed 1,
/// as form factors by centroids do where surfels touch.
///
/// # Errors
/// [`Error::InvalidEmission`], [`Error::InvalidReflectance`] or [`Error::LengthMismatch`] for bad
/// input; whatever `gather` fails with; [`Error::Diverged`], [`Error::Stagnated`] or
/// [`Error::NotConverged`], with the residual reached, if the tolerance is not met.
pub fn jacobi<T: Real, const BANDS: usize, E: Into<Error>, R: Report>(
    emission: &[[T; BANDS]],
    reflectance: &[[T; BANDS]],
    stop: Stop,
    gather: impl FnMut(&[[T; BANDS]]) -> Result<Vec<[T; BANDS]>, E>,
    progress: impl FnMut(usize, f64) -> R,
) -> Result<Solution<T, BANDS>, Error> {
    check(emission, reflectance)?;
    let mut gather = checked(gather);
    let mut watch = Watch::new(stop, progress);
    let mut radiosity = emission.to_vec();
    let mut iterations = 0;
    loop {
        iterations += 1;
        let irradiance = gather(&radiosity)?;
        let residuals = residuals(emission, reflectance, &irradiance, &radiosity);
        let residual = relative_residual(&residuals, emission);
        let floor = || floor(emission, reflectance, &radiosity, &irradiance, &mut gather);
        if watch.is_done(iterations, residual, floor)? {
            let interrupted = residual > stop.tolerance;
            return Ok(Solution { radiosity, irradiance, iterations, residual, interrupted });
        }
        for (b, r) in radiosity.iter_mut().zip(&residuals) {
            add(b, r);
        }
    }
}
