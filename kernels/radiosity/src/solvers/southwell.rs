//! The radiosity equation by shooting.

use farfield::Real;

use crate::elements::Surfel;
use crate::error::{Error, check_length};
use crate::numbers::unit_of_size;
use crate::solvers::floor::floor_of_numbers;
use crate::solvers::residual::{add, relative_residual, residuals, units};
use crate::solvers::solution::{Solution, Stop, check};
use crate::solvers::watch::{Report, Watch};

/// Southwell's relaxation, known as progressive shooting, from B = 0 with all light unshot, r = E.
///
/// Each iteration takes the surfel i whose unshot light Σ_bands |r_i| A_i is the largest and shoots it:
///
/// B_i += r_i,   r_j += ρ_j F_ji r_i for all j,   r_i reduced by what was shot,
///
/// F_ji = K_ji A_i V_ji = F_ij A_i / A_j. `column(i)` returns that: for every j, the irradiance of j per
/// unit radiosity of i. Each iteration costs O(N). `progress` receives its number and residual.
///
/// The unshot light is kept up to date from shot to shot, and rounded each time. Once it is small enough,
/// it is computed anew as E + ρ H − B. What rounding had hidden is then shot as well.
///
/// # Errors
/// Those of [`jacobi`](crate::jacobi).
pub fn southwell<T: Real, const BANDS: usize, E: Into<Error>, R: Report>(
    surfels: &[Surfel<T>],
    emission: &[[T; BANDS]],
    reflectance: &[[T; BANDS]],
    stop: Stop,
    mut column: impl FnMut(usize) -> Result<Vec<T>, E>,
    progress: impl FnMut(usize, f64) -> R,
) -> Result<Solution<T, BANDS>, Error> {
    check(emission, reflectance)?;
    check_length("emission", emission.len(), surfels.len())?;
    let mut watch = Watch::of_steps(stop, progress, surfels.len());
    let units = units(emission);
    let unit_area = unit_of_size(surfels.iter().map(|surfel| surfel.area.as_f64()));
    let mut unshot = emission.to_vec();
    let mut radiosity = vec![[T::from_f64(0.0); BANDS]; surfels.len()];
    let mut irradiance = radiosity.clone();
    let mut iterations = 0;
    loop {
        iterations += 1;
        let power = |i: &usize| {
            let light = unshot[*i].iter().zip(&units).map(|(r, unit)| (unit * r.as_f64()).abs());
            light.sum::<f64>() * (unit_area * surfels[*i].area.as_f64())
        };
        // Of equal surfels the first, so that a run can be repeated.
        let brightest = (0..surfels.len()).rev().max_by(|i, j| power(i).total_cmp(&power(j)));
        if let Some(i) = brightest {
            let factors = column(i).map_err(E::into)?;
            check_length("column", factors.len(), surfels.len())?;
            let shot = std::mem::replace(&mut unshot[i], [T::from_f64(0.0); BANDS]);
            add(&mut radiosity[i], &shot);
            for (j, &factor) in factors.iter().enumerate() {
                let received = shot.map(|r| factor * r);
                add(&mut irradiance[j], &received);
                add(&mut unshot[j], &std::array::from_fn(|k| reflectance[j][k] * received[k]));
            }
        }
        let mut residual = relative_residual(&unshot, emission);
        if residual <= stop.tolerance {
            // What is unshot was rounded at every shot. What all of them together leave may be more.
            unshot = residuals(emission, reflectance, &irradiance, &radiosity);
            residual = relative_residual(&unshot, emission);
            watch.correct(iterations, residual, floor_of_numbers(emission, &radiosity))?;
        }
        let floor = || Ok(floor_of_numbers(emission, &radiosity));
        if watch.is_done(iterations, residual, floor)? {
            let interrupted = residual > stop.tolerance;
            return Ok(Solution { radiosity, irradiance, iterations, residual, interrupted });
        }
    }
}
