//! What rounding leaves of a residual: how far a sum is from linear.

use farfield::Real;

use crate::error::Error;
use crate::operator::mixed;
use crate::residual::{norm, relative_residual};

/// H(B) − H(B′) − H(B − B′) for a B′ between a quarter and three quarters of B: zero but for rounding.
/// Two calls of `gather`, which is H; `irradiance` is H(B).
///
/// An error that is the same for every B, such as that of an expansion, is linear and does not show. It
/// makes a sum another sum, whose equation has a solution too.
pub(crate) fn rounding<T: Real, const BANDS: usize, E>(
    radiosity: &[[T; BANDS]],
    irradiance: &[[T; BANDS]],
    mut gather: impl FnMut(&[[T; BANDS]]) -> Result<Vec<[T; BANDS]>, E>,
) -> Result<Vec<[T; BANDS]>, E> {
    let share = |i: usize, k: usize| {
        let bits = mixed((i * BANDS + k) as u64) >> 11;
        T::from_f64(0.25 + 0.5 * bits as f64 / (1u64 << 53) as f64)
    };
    let split = |(i, b): (usize, &[T; BANDS])| std::array::from_fn(|k| share(i, k) * b[k]);
    let part: Vec<[T; BANDS]> = radiosity.iter().enumerate().map(split).collect();
    let rest: Vec<_> = differences(radiosity, &part);
    Ok(differences(&differences(irradiance, &gather(&part)?), &gather(&rest)?))
}

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

/// ‖a‖ / ‖b‖ over all numbers, 0 if a is zero.
pub(crate) fn relative<T: Real, const BANDS: usize>(a: &[[T; BANDS]], b: &[[T; BANDS]]) -> f64 {
    let all = |rows: &[[T; BANDS]]| norm(rows.as_flattened().iter().map(|x| x.as_f64()));
    let above = all(a);
    if above == 0.0 { 0.0 } else { above / all(b) }
}

/// How much more than one rounding a residual may be; see [`floor`].
const SLACK: f64 = 4.0;

fn differences<T: Real, const BANDS: usize>(a: &[[T; BANDS]], b: &[[T; BANDS]]) -> Vec<[T; BANDS]> {
    a.iter().zip(b).map(|(a, b)| std::array::from_fn(|k| a[k] - b[k])).collect()
}
