//! Where the light of a solution goes.

use farfield::Real;

use crate::elements::Surfel;
use crate::error::{Error, check_length};
use crate::solvers::solution::Solution;

/// Where the light of a solution stays, one entry per band, in units of emission times area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EnergyBalance<const BANDS: usize> {
    /// Σ A E.
    pub emitted: [f64; BANDS],
    /// Σ A (1 − ρ) H.
    pub absorbed: [f64; BANDS],
    /// Σ A B (1 − s), s the row sums: what no surfel receives. Negative where rows sum to more
    /// than 1.
    pub escaped: [f64; BANDS],
}

impl<const BANDS: usize> EnergyBalance<BANDS> {
    /// (emitted − absorbed − escaped) / emitted; 0 where nothing is emitted.
    ///
    /// It vanishes if the equation is solved exactly and the sums are reciprocal: an error of a fast
    /// sum shows here as well as an unfinished iteration.
    pub fn residual(&self) -> [f64; BANDS] {
        std::array::from_fn(|k| {
            let lost = self.emitted[k] - self.absorbed[k] - self.escaped[k];
            if self.emitted[k] == 0.0 { lost } else { lost / self.emitted[k] }
        })
    }
}

/// The energy balance of a solution. `row_sums` holds s_i = Σ_j F_ij, the irradiance of each surfel
/// when all have radiosity 1; the surfels' exchange is taken to be reciprocal, A_i F_ij = A_j F_ji.
///
/// # Errors
/// [`Error::LengthMismatch`] if the inputs don't all have one entry per surfel.
pub fn energy_balance<T: Real, const BANDS: usize>(
    surfels: &[Surfel<T>],
    emission: &[[T; BANDS]],
    reflectance: &[[T; BANDS]],
    solution: &Solution<T, BANDS>,
    row_sums: &[T],
) -> Result<EnergyBalance<BANDS>, Error> {
    check_length("emission", emission.len(), surfels.len())?;
    check_length("reflectance", reflectance.len(), surfels.len())?;
    check_length("radiosity", solution.radiosity.len(), surfels.len())?;
    check_length("irradiance", solution.irradiance.len(), surfels.len())?;
    check_length("row sums", row_sums.len(), surfels.len())?;
    let sum = |term: &dyn Fn(usize, usize) -> f64| {
        std::array::from_fn(|k| {
            surfels.iter().enumerate().map(|(i, s)| s.area.as_f64() * term(i, k)).sum()
        })
    };
    Ok(EnergyBalance {
        emitted: sum(&|i, k| emission[i][k].as_f64()),
        absorbed: sum(&|i, k| {
            (1.0 - reflectance[i][k].as_f64()) * solution.irradiance[i][k].as_f64()
        }),
        escaped: sum(&|i, k| solution.radiosity[i][k].as_f64() * (1.0 - row_sums[i].as_f64())),
    })
}
