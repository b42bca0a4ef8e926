//! The radiosity equation for what is reflected.

use std::array;

use crate::error::{Error, check_length};
use crate::operator::Balance;
use crate::solvers::solution::Solution;

impl<const BANDS: usize> Balance<'_, '_, BANDS> {
    /// Solves the equation by a solver of the equation R = R₁ + ρ H″(R) for what is reflected, R = B − E: its emission is
    /// R₁ = E″ − E + ρ H″(E), the even glow and the first bounce.
    ///
    /// The residual that the solver brings down is relative to R₁. Relative to E, that of a lamp which is small and
    /// bright would look small before anything is reflected. Two sums beside those of the solver, or one if
    /// [nothing has changed](Self::is_changed).
    ///
    /// # Errors
    /// Those of the solver, and of the sums.
    pub fn solve(
        &self,
        reflectance: &[[f64; BANDS]],
        solver: impl FnOnce(&[[f64; BANDS]]) -> Result<Solution<f64, BANDS>, Error>,
    ) -> Result<Solution<f64, BANDS>, Error> {
        check_length("reflectance", reflectance.len(), self.own().len())?;
        let received = self.apply(self.own())?;
        let first: Vec<[f64; BANDS]> = (0..received.len())
            .map(|i| {
                let glow = |k: usize| self.emission()[i][k] - self.own()[i][k];
                // Sums are off by their tolerance, and may be so below zero. H″ alone may well be negative: it is what
                // arrives beyond the even glow.
                array::from_fn(|k| (glow(k) + reflectance[i][k] * received[i][k]).max(0.0))
            })
            .collect();
        let mut solution = solver(&first)?;
        for (b, e) in solution.radiosity.iter_mut().zip(self.own()) {
            b.iter_mut().zip(e).for_each(|(b, e)| *b += e);
        }
        if self.is_changed() {
            solution.irradiance = self.operator().apply(&solution.radiosity)?;
        } else {
            for (h, own) in solution.irradiance.iter_mut().zip(&received) {
                h.iter_mut().zip(own).for_each(|(h, own)| *h += own);
            }
        }
        Ok(solution)
    }
}

#[cfg(test)]
mod tests {
    use crate::{
        Corrections, Element, RadiosityOperator, Stop, Surfel, conjugate_gradients, jacobi,
    };
    use glam::DVec3;

    /// A lamp of that area with a power of 1, and two walls that see it, each other, and nothing of themselves.
    fn lamp_and_walls(area: f64) -> ([Element; 3], [[f64; 3]; 3]) {
        let disk = |area: f64| {
            Element::disk(Surfel { position: DVec3::ZERO, normal: DVec3::Z, area, face: 0 })
        };
        // Of the light of the lamp half reaches either wall.
        let back = 0.5 * area;
        let factors = [[0.0, 0.5, 0.5], [back, 0.0, 1.0 - back], [back, 1.0 - back, 0.0]];
        ([disk(area), disk(1.0), disk(1.0)], factors)
    }

    #[test]
    fn small_bright_lamps_do_not_hide_what_is_reflected() {
        for area in [1e-2, 1e-6, 1e-12] {
            let (elements, factors) = lamp_and_walls(area);
            let gather = move |b: &[[f64; 1]]| {
                let sum = |row: &[f64; 3]| [(0..3).map(|j| row[j] * b[j][0]).sum::<f64>()];
                Ok(factors.iter().map(sum).collect())
            };
            let none = Corrections::none(&elements);
            let operator = RadiosityOperator::new(&elements, gather, none).unwrap();
            let emission = [[1.0 / area], [0.0], [0.0]];
            let reflectance = [[0.0], [0.8], [0.8]];
            let surfels = elements.map(|element| *element.surfel());
            let stop = Stop { tolerance: 1e-4, ..Stop::default() };
            let balance = operator.balance(&emission, &reflectance).unwrap();
            let apply = |b: &[[f64; 1]]| balance.apply(b);
            let by_jacobi = |e: &[[f64; 1]]| jacobi(e, &reflectance, stop, apply, |_, _| ());
            let by_gradients = |e: &[[f64; 1]]| {
                conjugate_gradients(&surfels, e, &reflectance, stop, apply, |_, _| ())
            };
            for solution in [
                balance.solve(&reflectance, by_jacobi).unwrap(),
                balance.solve(&reflectance, by_gradients).unwrap(),
            ] {
                // All that is emitted is absorbed: by the lamp, or by the walls.
                let absorbed = [area, 0.2, 0.2];
                let absorbed: f64 =
                    absorbed.iter().zip(&solution.irradiance).map(|(a, h)| a * h[0]).sum();
                assert!((absorbed - 1.0).abs() < 1e-3, "{area}: {absorbed}");
                for ((b, h), k) in solution.radiosity.iter().zip(&solution.irradiance).zip(0..) {
                    let expected = emission[k][0] + reflectance[k][0] * h[0];
                    assert!((b[0] / expected - 1.0).abs() < 1e-3, "{area}");
                }
            }
        }
    }
}
