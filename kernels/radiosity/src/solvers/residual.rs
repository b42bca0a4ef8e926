//! The residual of the radiosity equation, and norms that no emission is too faint or too bright for.

use farfield::Real;

use crate::error::{Error, check_length};
use crate::numbers::{norm, unit_of_size};

/// `gather` with a check of the length of what it returns.
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

/// The largest ‖r‖₂ / ‖E‖₂ over the bands; a band whose residual is zero counts as 0.
pub(crate) fn relative_residual<T: Real, const BANDS: usize>(
    residuals: &[[T; BANDS]],
    emission: &[[T; BANDS]],
) -> f64 {
    let ratios = (0..BANDS).map(|k| {
        let residual = norm(residuals.iter().map(|r| r[k].as_f64()));
        if residual == 0.0 { 0.0 } else { residual / norm(emission.iter().map(|e| e[k].as_f64())) }
    });
    // Unlike f64::max, this doesn't lose a NaN.
    ratios.fold(0.0, |largest, ratio| if ratio <= largest { largest } else { ratio })
}

/// A power of two for each band that brings emissions, multiplied by it, to about 1, or as near as
/// powers of two get. Products of numbers in these units neither overflow nor vanish.
pub(crate) fn units<T: Real, const BANDS: usize>(emission: &[[T; BANDS]]) -> [f64; BANDS] {
    std::array::from_fn(|k| unit_of_size(emission.iter().map(|e| e[k].as_f64())))
}

pub(crate) fn add<T: Real, const BANDS: usize>(sum: &mut [T; BANDS], term: &[T; BANDS]) {
    for (s, t) in sum.iter_mut().zip(term) {
        *s += *t;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn residuals_of_faint_and_bright_light_are_those_of_any_other() {
        for unit in [5e-320, 1e-200, 1e-162, 1.0, 1e150, 1e200, 1e307] {
            let residuals = [[3.0 * unit, 0.0], [4.0 * unit, 0.0]];
            let ratio = relative_residual(&residuals, &[[0.0, unit], [2.0 * unit, 0.0]]);
            assert!((ratio - 2.5).abs() < 1e-3, "{unit:e}: {ratio}");
        }
        assert_eq!(relative_residual(&[[0.0]], &[[0.0]]), 0.0);
        for residual in [f64::NAN, f64::INFINITY] {
            for unit in [0.0, 1e-200, 1.0] {
                let ratio = relative_residual(&[[residual], [unit]], &[[1.0], [unit]]);
                assert!(!ratio.is_finite(), "{residual} {unit}: {ratio}");
            }
        }
    }

    #[test]
    fn units_bring_emissions_to_about_one() {
        let emission = [[3e-200, 0.0, 1.0, 6e300], [0.0, 0.0, 0.5, 1.0]];
        let units = units(&emission);
        assert_eq!([units[1], units[2]], [1.0, 1.0]);
        for k in [0, 2, 3] {
            assert!((1.0..2.0).contains(&(emission[0][k] * units[k])), "{}", units[k]);
            assert_eq!(units[k].log2().fract(), 0.0);
        }
        assert!(super::units(&[[f64::from_bits(1)]])[0].is_finite());
    }
}
