//! The radiosities that satisfy B = E + ρH(B).

use std::convert::Infallible;
use std::ops::ControlFlow;

use farfield::Mask;
use farfield_radiosity::{
    Balance, Error, Irradiance, RadiosityOperator, Solution, Stop, Surfel, Visibility, bicgstab,
    conjugate_gradients, jacobi, southwell,
};
use rayon::prelude::*;

use super::args::SolverName;
use super::daylight::Received;
use crate::interrupt::Interrupt;
use crate::progress::Progress;
use farfield_scenes::{ByPixel, Fields, Optics, Scene, direct_light_by_pixel};

/// The equation's residual in units of the tolerance: small enough not to add to the error.
pub(crate) const RESIDUAL: f64 = 1e-2;
/// Bounces that a solution may take.
const MAX_BOUNCES: usize = 2000;

/// Everything that decides how elements exchange light.
pub(crate) struct Exchange<'a, const BANDS: usize> {
    /// The surfels of all elements.
    pub(crate) surfels: &'a [Surfel],
    /// From all radiosities to all irradiances.
    pub(crate) operator: &'a RadiosityOperator<'a, BANDS>,
    /// Which elements see each other, pair by pair.
    pub(crate) visibility: &'a Visibility<'a>,
}

impl<const BANDS: usize> Exchange<'_, BANDS> {
    /// Solves for the radiosities as far as it may, with a bar for the digits gained.
    ///
    /// # Errors
    /// If the iteration doesn't converge or a sum fails.
    pub(crate) fn solve(
        &self,
        optics: &Optics<BANDS>,
        solver: SolverName,
        tolerance: f64,
        progress: &Progress,
        interrupt: &Interrupt,
    ) -> Result<Solution<f64, BANDS>, Error> {
        let tolerance = RESIDUAL * tolerance;
        let bar = progress.bar("solving");
        progress.begin_residuals();
        let report = |step, residual: f64| {
            progress.add_residual(step, residual);
            bar.show(residual.ln() / tolerance.ln());
            interrupt.flow()
        };
        let balance = self.operator.balance(&optics.emission, &optics.reflectance)?;
        let reflectance = &optics.reflectance[..];
        let stop = Stop { tolerance, max_iterations: MAX_BOUNCES };
        let apply = |b: &[[f64; BANDS]]| balance.apply(b);
        balance.solve(reflectance, |emission| match solver {
            SolverName::Cg => {
                conjugate_gradients(self.surfels, emission, reflectance, stop, apply, report)
            }
            SolverName::Jacobi => jacobi(emission, reflectance, stop, apply, report),
            SolverName::Bicgstab => bicgstab(emission, reflectance, stop, apply, report),
            SolverName::Southwell => self.shoot(&balance, emission, reflectance, stop, report),
        })
    }

    /// What a picture gathers pixel by pixel: light straight from few lamps, and from the sun.
    ///
    /// # Errors
    /// Those of the sum.
    pub(crate) fn by_pixel(
        &self,
        scene: &Scene,
        fields: &Fields,
        received: Option<Received>,
    ) -> Result<Option<ByPixel>, Error> {
        let lamps = direct_light_by_pixel(scene);
        let (diffuse, beam) = received.map_or((None, None), |r| (Some(r.diffuse), r.beam));
        if !lamps && beam.is_none() {
            return Ok(None);
        }
        let mut rest = if lamps { self.indirect(fields)? } else { fields.irradiance.clone() };
        let mut add = |irradiance: &[f64], sign: f64| {
            for (rest, h) in rest.chunks_mut(fields.bands).zip(irradiance) {
                rest.iter_mut().for_each(|rest| *rest += sign * h);
            }
        };
        if lamps {
            diffuse.iter().for_each(|diffuse| add(diffuse, 1.0));
        } else {
            beam.iter().for_each(|beam| add(&beam.irradiance, -1.0));
        }
        Ok(Some(ByPixel { rest, lamps, sun: beam.map(|beam| beam.sun) }))
    }

    /// The irradiance by what elements reflect, band by band: the sums of B − E.
    ///
    /// # Errors
    /// Those of the sum.
    fn indirect(&self, fields: &Fields) -> Result<Vec<f64>, Error> {
        let (bands, count) = (fields.bands, self.surfels.len());
        let mut field = vec![0.0; count * bands];
        for first in (0..bands).step_by(BANDS) {
            let reflected = |i: usize, k: usize| {
                let at = i * bands + first + k;
                if first + k < bands { fields.radiosity[at] - fields.emission[at] } else { 0.0 }
            };
            let reflected: Vec<[f64; BANDS]> =
                (0..count).map(|i| std::array::from_fn(|k| reflected(i, k))).collect();
            for (i, h) in self.operator.apply(&reflected)?.iter().enumerate() {
                for k in first..(first + BANDS).min(bands) {
                    field[i * bands + k] = h[k - first];
                }
            }
        }
        Ok(field)
    }

    /// Southwell's relaxation: all bands at once where they share their factors, else one after the other.
    fn shoot(
        &self,
        balance: &Balance<'_, '_, BANDS>,
        emission: &[[f64; BANDS]],
        reflectance: &[[f64; BANDS]],
        stop: Stop,
        report: impl Fn(usize, f64) -> ControlFlow<()>,
    ) -> Result<Solution<f64, BANDS>, Error> {
        let count = self.surfels.len();
        let stop = Stop { max_iterations: MAX_BOUNCES * count, ..stop };
        if !balance.is_changed() {
            let column = |i: usize| Ok::<_, Infallible>(self.column(i));
            return southwell(self.surfels, emission, reflectance, stop, column, report);
        }
        let zeros = || vec![[0.0; BANDS]; count];
        let mut all = Solution {
            radiosity: zeros(),
            irradiance: zeros(),
            iterations: 0,
            residual: 0.0,
            interrupted: false,
        };
        for band in 0..BANDS {
            let of = |rows: &[[f64; BANDS]]| rows.iter().map(|row| [row[band]]).collect::<Vec<_>>();
            let column = |i: usize| {
                let mut column = self.column(i);
                for (j, value) in column.iter_mut().enumerate() {
                    *value += balance.change(j, i, band);
                }
                Ok::<_, Infallible>(column)
            };
            let (emission, reflectance) = (of(emission), of(reflectance));
            let one = southwell(self.surfels, &emission, &reflectance, stop, column, &report)?;
            for (row, [b]) in all.radiosity.iter_mut().zip(one.radiosity) {
                row[band] = b;
            }
            all.iterations += one.iterations;
            all.residual = all.residual.max(one.residual);
            all.interrupted |= one.interrupted;
        }
        Ok(all)
    }

    /// The irradiance of every element per unit radiosity of element i.
    fn column(&self, i: usize) -> Vec<f64> {
        let kernel = Irradiance::<f64>::clamped();
        let source = &self.surfels[i];
        let factor = |receiver| {
            let seen = Mask::<Irradiance<f64>>::pair(self.visibility, receiver, source);
            seen * kernel.factor(receiver, source) * source.area
        };
        let mut column: Vec<f64> = self.surfels.par_iter().with_min_len(256).map(factor).collect();
        for (j, value) in self.operator.corrections().column(i) {
            column[j] += value;
        }
        let scale = self.operator.scaling(i);
        for (j, value) in column.iter_mut().enumerate() {
            *value *= scale * self.operator.scaling(j);
        }
        column[i] += self.operator.own_factor(i);
        column
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::outdoors::SkyModel;
    use crate::radiosity::daylight::{Beam, Origin};
    use crate::radiosity::fixture::exchanging;
    use farfield::glam::DVec3;
    use farfield::relative_l2_error;
    use farfield_radiosity::Enclosure;
    use farfield_scenes::Quantity;

    #[test]
    fn all_solvers_agree_and_leave_the_second_room_dark() {
        let closed = Some(Enclosure::Closed);
        exchanging("two-rooms", 600, closed, |scene, mesh, exchange| {
            let optics = Optics::<3>::new(scene, mesh, Quantity::Light, 3, 0);
            let solved = |solver| {
                let (progress, interrupt) = (Progress::new(true), Interrupt::default());
                let solved = exchange.solve(&optics, solver, 1e-4, &progress, &interrupt);
                solved.expect("converges")
            };
            let solved =
                [SolverName::Cg, SolverName::Jacobi, SolverName::Bicgstab, SolverName::Southwell]
                    .map(solved);
            let [cg, jacobi, _, southwell] = &solved;
            assert!(cg.iterations < jacobi.iterations);
            assert!(southwell.iterations > 10 * jacobi.iterations);
            for other in &solved {
                assert!(relative_l2_error(&other.radiosity, &jacobi.radiosity) < 1e-4);
                for (b, surfel) in other.radiosity.iter().zip(exchange.surfels) {
                    // The wall between the rooms is at x = 1, its back belongs to the second one.
                    let (x, back) = (surfel.position.x, surfel.normal.x > 0.0);
                    let second = x > 1.0 || (x == 1.0 && back);
                    assert_eq!(*b == [0.0; 3], second, "at {}", surfel.position);
                }
            }
        });
    }

    #[test]
    fn what_pixels_gather_is_not_in_the_rest() {
        for (name, lamps, expected) in [("two-rooms", true, 1.0), ("canyon", false, 3.0)] {
            exchanging::<3>(name, 600, None, |scene, mesh, exchange| {
                let count = mesh.elements.len();
                let all = |number: f64| vec![number; count];
                let (radiosity, emission, irradiance) = (all(7.0), all(7.0), all(5.0));
                let row_sums = all(1.0);
                let fields = Fields { bands: 1, radiosity, emission, irradiance, row_sums };
                let sun = (DVec3::Y, 4.0);
                let origin = Origin {
                    sky: 1.0,
                    sky_model: SkyModel::Uniform,
                    sun: None,
                    ground: 0.0,
                    ambient: None,
                    zenith: [0.0, 1.0, 0.0],
                    north: [0.0, 0.0, -1.0],
                };
                let beam = Some(Beam { sun, irradiance: all(2.0) });
                let received = Received { diffuse: all(1.0), beam, origin };
                let found = exchange.by_pixel(scene, &fields, Some(received)).expect("summed");
                // Nothing is reflected: light by lamps aside, only the sky is left; or all but the sun.
                let (rest, sun) = (all(expected), Some(sun));
                assert_eq!(found, Some(ByPixel { rest, lamps, sun }));
                let night = exchange.by_pixel(scene, &fields, None).expect("summed");
                assert_eq!(night.map(|light| light.rest), lamps.then(|| all(0.0)));
            });
        }
    }
}
