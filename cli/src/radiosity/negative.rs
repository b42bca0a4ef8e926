//! Light that errors have taken below zero.

use farfield_radiosity::Surfel;
use serde::Serialize;

use super::failure::Failure;

/// Irradiances below zero, as sums off by the tolerance may leave them where next to no light arrives.
/// They are set to zero in what is written: the exchange itself stays linear.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Negative {
    /// How many there were, all bands together.
    pub(crate) count: usize,
    /// The largest, in units of the root mean square of the band.
    pub(crate) largest: f64,
}

impl Negative {
    /// Takes what is below zero out of some irradiances.
    ///
    /// # Errors
    /// [`Failure::BelowZero`] if one is further below zero than `tolerance` times the root mean square.
    pub(crate) fn take<const BANDS: usize>(
        &mut self,
        irradiance: &mut [[f64; BANDS]],
        surfels: &[Surfel],
        tolerance: f64,
    ) -> Result<(), Failure> {
        let area: f64 = surfels.iter().map(|surfel| surfel.area).sum();
        for band in 0..BANDS {
            let square = |(h, surfel): (&[f64; BANDS], &Surfel)| surfel.area * h[band].powi(2);
            let squares: f64 = irradiance.iter().zip(surfels).map(square).sum();
            let rms = (squares / area).sqrt();
            for (h, surfel) in irradiance.iter_mut().zip(surfels) {
                let found = h[band];
                if found < -tolerance * rms {
                    let place = surfel.position.to_array();
                    return Err(Failure::BelowZero { found, place, rms });
                }
                if found < 0.0 {
                    self.count += 1;
                    self.largest = self.largest.max(-found / rms);
                    h[band] = 0.0;
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn little_below_zero_is_counted_and_more_is_refused() {
        let surfel = Surfel { position: DVec3::X, normal: DVec3::Z, area: 2.0, face: 0 };
        let surfels = [surfel; 4];
        let mut irradiance = [[1.0, 0.0], [1.0, 0.0], [-1e-3, 0.0], [1.0, 0.0]];
        let mut negative = Negative::default();
        assert!(negative.take(&mut irradiance, &surfels, 1e-2).is_ok());
        assert!(
            (negative.count == 1)
                && (negative.largest / 1e-3 - 4f64.sqrt() / 3f64.sqrt()).abs() < 1e-3
        );
        assert_eq!(irradiance[2], [0.0, 0.0]);
        irradiance[1][0] = -0.1;
        let failure = negative.take(&mut irradiance, &surfels, 1e-2).expect_err("too much");
        let message = failure.to_string();
        assert!(message.contains("-1.0e-1") && message.contains("[1.0, 0.0, 0.0]"), "{message}");
    }
}
