//! What solvers solve: B = E + ρ H(B), when they stop, and what they return.
//!
//! All quantities have one column per band, and bands don't mix: `[T; BANDS]` per surfel.

use farfield::Real;

use crate::elements::{check_emission, check_reflectance};
use crate::error::{Error, check_length};

/// When a solver stops.
///
/// The residual is that of the equation itself, r = E + ρ H(B) − B, not the change of B: the
/// largest ‖r‖₂ / ‖E‖₂ over the bands. Where a small lamp is much brighter than all it lights, that is small from the start:
/// [`Balance::solve`](crate::Balance::solve) has the equation for reflected light alone.
///
/// A tolerance can ask for more digits than the sums H(B) have: those of a fast sum are often formed in
/// single precision. The residual then falls to what rounding leaves of it and goes on in a circle.
/// Every solver notices this and returns [`Error::Stagnated`] instead of going on to the last iteration.
/// The error tells the least residual reached, and how much of it rounding may leave. These are the rules:
///
/// * Progress is a residual that is less than all before. Where a solver goes by estimates and looks at
///   the residual only when the estimate is small enough, progress is half of the last one.
/// * After 8 iterations without progress the rounding of the sums is measured, by two more calls of
///   `gather`, which are not counted. A residual that is no larger has stagnated. A larger one is given
///   time, and the rounding is measured again after 16, 32 and 64 iterations.
/// * After 100 iterations without progress the residual has stagnated whatever the rounding, or
///   [diverges](Error::Diverged) if it has grown by a tenth.
///
/// For shooting, as many shots as there are surfels count as one iteration here.
/// [`RadiosityOperator::rounding`](crate::RadiosityOperator::rounding) measures the rounding of an
/// operator beforehand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// The residual to reach.
    pub tolerance: f64,
    /// The number of iterations after which to give up; at least one is made.
    pub max_iterations: usize,
}

impl Default for Stop {
    /// A residual of 10⁻⁶ within 1000 iterations.
    fn default() -> Self {
        Self { tolerance: 1e-6, max_iterations: 1000 }
    }
}

/// A solution of the radiosity equation, in the units of the emission.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution<T, const BANDS: usize> {
    /// Radiosity B of each surfel.
    pub radiosity: Vec<[T; BANDS]>,
    /// Irradiance H(B) of each surfel.
    pub irradiance: Vec<[T; BANDS]>,
    /// Iterations made: shots when shooting, applications of H otherwise.
    pub iterations: usize,
    /// The residual of this B; see [`Stop`].
    pub residual: f64,
    /// Whether `progress` ended the iteration before the tolerance was reached; see [`Report`](crate::Report).
    pub interrupted: bool,
}

/// Whether emissions and reflectances are such that there is something to solve.
pub(crate) fn check<T: Real, const BANDS: usize>(
    emission: &[[T; BANDS]],
    reflectance: &[[T; BANDS]],
) -> Result<(), Error> {
    check_length("reflectance", reflectance.len(), emission.len())?;
    check_emission(emission)?;
    check_reflectance(reflectance)
}
