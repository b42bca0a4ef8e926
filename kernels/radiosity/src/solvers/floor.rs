//! The residual that rounding may leave.

use farfield::Real;

use crate::error::Error;
use crate::operator::rounding;
use crate::solvers::residual::relative_residual;

/// The relative residual that rounding may leave, however long an iteration goes on: by ρ times the
/// [`rounding`] of H at this radiosity, and by the roundings of the radiosities themselves.
///
/// One evaluation of H is off by δ, and so is each residual by ρ δ. An iteration gathers what it rounded
/// in the step before as well, and later bounces of that: some √(2/(1 − ρ²)) times ρ δ together. [`SLACK`]
/// stands for that factor. It is exceeded where ρ is above 0.94.
pub(crate) fn floor<T: Real, const BANDS: usize>(
    emission: &[[T; BANDS]],
    reflectance: &[[T; BANDS]],
    radiosity: &[[T; BANDS]],
    irradiance: &[[T; BANDS]],
    gather: impl FnMut(&[[T; BANDS]]) -> Result<Vec<[T; BANDS]>, Error>,
) -> Result<f64, Error> {
    let mut reflected = rounding(radiosity, irradiance, gather)?;
    for (reflected, rho) in reflected.iter_mut().zip(reflectance) {
        *reflected = std::array::from_fn(|k| rho[k] * reflected[k]);
    }
    let of_sums = relative_residual(&reflected, emission);
    Ok(SLACK * of_sums + floor_of_numbers(emission, radiosity))
}

/// What rounding of the numbers alone leaves of a residual, whatever the operator.
pub(crate) fn floor_of_numbers<T: Real, const BANDS: usize>(
    emission: &[[T; BANDS]],
    radiosity: &[[T; BANDS]],
) -> f64 {
    SLACK * T::epsilon().as_f64() * relative_residual(radiosity, emission)
}

/// How much more than one rounding a residual may be; see [`floor`].
const SLACK: f64 = 4.0;
