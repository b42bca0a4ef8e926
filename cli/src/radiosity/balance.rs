//! What becomes of the light: row sums, and what is emitted, absorbed and lost.

use farfield_radiosity::{Element, Error, Solution, Surfel, energy_balance};
use serde::Serialize;

use farfield_scenes::Optics;

/// The sums of each element's form factors to all others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(crate) struct RowSums {
    /// The least.
    pub(crate) min: f64,
    /// The largest.
    pub(crate) max: f64,
    /// The root mean square, over the area, of what is missing to 1 in a closed room, and of what is
    /// more than 1 elsewhere.
    pub(crate) rms_error: f64,
}

impl RowSums {
    /// Those of elements that belong to these closed parts, or to none.
    pub(crate) fn new(elements: &[Element], sums: &[f64], parts: &[Option<u32>]) -> Self {
        let error = |(sum, part): (&f64, &Option<u32>)| {
            if part.is_some() { sum - 1.0 } else { (sum - 1.0).max(0.0) }
        };
        let areas = || elements.iter().map(|element| element.surfel().area);
        let errors = sums.iter().zip(parts).map(error);
        let squares: f64 = areas().zip(errors).map(|(area, error)| area * error.powi(2)).sum();
        Self {
            min: sums.iter().copied().fold(f64::INFINITY, f64::min),
            max: sums.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            rms_error: (squares / areas().sum::<f64>()).sqrt(),
        }
    }
}

/// The share of the emitted power that is neither absorbed nor escapes, in the worst band.
///
/// The power that escapes is Σ A B (1 − s), where s, the irradiance of an element when all have
/// radiosity 1, is the share of its light that other elements receive.
///
/// # Errors
/// If lengths don't match.
pub(crate) fn energy_residual<const BANDS: usize>(
    surfels: &[Surfel],
    optics: &Optics<BANDS>,
    solution: &Solution<f64, BANDS>,
    row_sums: &[f64],
) -> Result<f64, Error> {
    let Optics { emission, reflectance, .. } = optics;
    let balance = energy_balance(surfels, emission, reflectance, solution, row_sums)?;
    Ok(balance.residual().into_iter().map(f64::abs).fold(0.0, f64::max))
}

/// How often light is reflected, on average, in parts that lose some of it, in the worst band: Σ A ρ H / Σ A E over
/// the elements that belong to no closed part.
pub(crate) fn reflections<const BANDS: usize>(
    surfels: &[Surfel],
    optics: &Optics<BANDS>,
    irradiance: &[[f64; BANDS]],
    parts: &[Option<u32>],
) -> f64 {
    let sum = |value: &dyn Fn(usize) -> f64| -> f64 {
        let open = (0..surfels.len()).filter(|&i| parts[i].is_none());
        open.map(|i| surfels[i].area * value(i)).sum()
    };
    let of = |band: usize| {
        let emitted = sum(&|i| optics.emission[i][band]);
        let reflected = sum(&|i| optics.reflectance[i][band] * irradiance[i][band]);
        if emitted > 0.0 { reflected / emitted } else { 0.0 }
    };
    (0..BANDS).map(of).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn only_closed_rooms_miss_what_escapes() {
        let disk = |area| {
            let (position, normal) = (DVec3::ZERO, DVec3::Z);
            Element::disk(Surfel { position, normal, area, face: 0 })
        };
        let elements = [disk(1.0), disk(3.0)];
        let sums = [0.6, 1.2];
        let open = RowSums::new(&elements, &sums, &[None; 2]);
        assert_eq!((open.min, open.max), (0.6, 1.2));
        assert!((open.rms_error - 0.03f64.sqrt()).abs() < 1e-12);
        let closed = RowSums::new(&elements, &sums, &[Some(0); 2]);
        assert!((closed.rms_error - 0.07f64.sqrt()).abs() < 1e-12);
    }
}
