//! The radiosity equation by conjugate gradients.

use farfield::Real;

use crate::elements::{Surfel, check_surfels};
use crate::error::{Error, check_length};
use crate::numbers::unit_of_size;
use crate::solvers::floor::floor;
use crate::solvers::residual::{add, checked, relative_residual, residuals, units};
use crate::solvers::solution::{Solution, Stop, check};
use crate::solvers::watch::{Report, Watch};

/// The radiosity equation by conjugate gradients on its symmetric form, from B = E:
///
/// (D − A H) B = D E,   D = A/ρ,
///
/// preconditioned by D, where A are the areas. `gather` is H, as in [`jacobi`](crate::jacobi). Surfels
/// without reflectance keep B = E. All bands share the calls of `gather`; each has step lengths of its own.
///
/// The matrix is symmetric if the exchange is reciprocal, A_i F_ij = A_j F_ji, and positive definite if
/// no row of ρ F sums to more than 1. Jacobi's iteration needs about log(tolerance)/log(ρ) calls of
/// `gather`; this method needs about the square root of that number. Between restarts it goes by an
/// estimate of the residual. When the estimate meets the tolerance, the residual itself is computed, and
/// the method starts afresh if that is still too large, as it may be for a sum that is reciprocal only to
/// its own tolerance.
///
/// # Errors
/// Those of [`jacobi`](crate::jacobi), those of [`check_surfels`], and [`Error::NotPositiveDefinite`] if
/// rows sum to so much more than 1 that no solution exists.
pub fn conjugate_gradients<T: Real, const BANDS: usize, E: Into<Error>, R: Report>(
    surfels: &[Surfel<T>],
    emission: &[[T; BANDS]],
    reflectance: &[[T; BANDS]],
    stop: Stop,
    gather: impl FnMut(&[[T; BANDS]]) -> Result<Vec<[T; BANDS]>, E>,
    progress: impl FnMut(usize, f64) -> R,
) -> Result<Solution<T, BANDS>, Error> {
    check(emission, reflectance)?;
    check_surfels(surfels)?;
    check_length("emission", emission.len(), surfels.len())?;
    let mut gather = checked(gather);
    let units = units(emission);
    let unit_area = unit_of_size(surfels.iter().map(|surfel| surfel.area.as_f64()));
    // ⟨a, b⟩ = Σ A/ρ a b, band by band; without reflectance, both are 0. In units of the largest area and
    // emission: quotients of such products are the same in all units.
    let product = |a: &[[T; BANDS]], b: &[[T; BANDS]]| -> [f64; BANDS] {
        std::array::from_fn(|k| {
            let term = |i: usize| {
                let rho = reflectance[i][k].as_f64();
                let area = unit_area * surfels[i].area.as_f64();
                let [a, b] = [a, b].map(|rows| units[k] * rows[i][k].as_f64());
                if rho > 0.0 { area * (a / rho) * b } else { 0.0 }
            };
            (0..a.len()).map(term).sum()
        })
    };

    let mut watch = Watch::of_estimates(stop, progress);
    let mut radiosity = emission.to_vec();
    let mut iterations = 0;
    loop {
        iterations += 1;
        let irradiance = gather(&radiosity)?;
        let mut r = residuals(emission, reflectance, &irradiance, &radiosity);
        let residual = relative_residual(&r, emission);
        let floor = || floor(emission, reflectance, &radiosity, &irradiance, &mut gather);
        if watch.is_done(iterations, residual, floor)? {
            let interrupted = residual > stop.tolerance;
            return Ok(Solution { radiosity, irradiance, iterations, residual, interrupted });
        }
        let mut p = r.clone();
        let mut squared = product(&r, &r);
        loop {
            let received = gather(&p)?;
            iterations += 1;
            // q = D⁻¹ (D − A H) p
            let q: Vec<[T; BANDS]> = (0..p.len())
                .map(|i| std::array::from_fn(|k| p[i][k] - reflectance[i][k] * received[i][k]))
                .collect();
            let curvature = product(&p, &q);
            let mut step = [T::from_f64(0.0); BANDS];
            for k in 0..BANDS {
                if squared[k] > 0.0 {
                    if curvature[k] <= 0.0 {
                        return Err(Error::NotPositiveDefinite { iterations, band: k });
                    }
                    step[k] = T::from_f64(squared[k] / curvature[k]);
                }
            }
            for ((b, r), (p, q)) in radiosity.iter_mut().zip(&mut r).zip(p.iter().zip(&q)) {
                add(b, &std::array::from_fn(|k| step[k] * p[k]));
                add(r, &std::array::from_fn(|k| -step[k] * q[k]));
            }
            if !watch.goes_on(iterations, relative_residual(&r, emission)) {
                break;
            }
            let next = product(&r, &r);
            for (p, r) in p.iter_mut().zip(&r) {
                for k in 0..BANDS {
                    let grown = if squared[k] > 0.0 { next[k] / squared[k] } else { 0.0 };
                    p[k] = r[k] + T::from_f64(grown) * p[k];
                }
            }
            squared = next;
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::{Patch, jacobi};
    use approx::assert_relative_eq;
    use glam::DVec3;
    use std::convert::Infallible;

    /// The walls of a closed unit cube in n × n patches each, top first and bottom second, and their
    /// form factors.
    pub(crate) fn cube(n: usize) -> (Vec<Surfel>, Vec<Vec<f64>>) {
        let step = 1.0 / n as f64;
        let mut patches = Vec::new();
        for (axis, high) in [(2, true), (2, false), (0, false), (0, true), (1, false), (1, true)] {
            let (mut u, mut v) = (DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3]);
            let mut origin = DVec3::ZERO;
            if high {
                origin = DVec3::AXES[axis];
                (u, v) = (v, u);
            }
            for k in 0..n * n {
                let corner = origin + step * ((k / n) as f64 * u + (k % n) as f64 * v);
                let (u, v) = (step * u, step * v);
                patches
                    .push(Patch::new(&[corner, corner + u, corner + u + v, corner + v]).unwrap());
            }
        }
        let surfel = |patch: &Patch| Surfel {
            position: patch.centroid(),
            normal: patch.normal(),
            area: patch.area(),
            face: Surfel::<f64>::NO_FACE,
        };
        let row = |from: &Patch| patches.iter().map(|to| from.form_factor(to)).collect();
        (patches.iter().map(surfel).collect(), patches.iter().map(row).collect())
    }

    /// Irradiances by form factors, row by row.
    pub(crate) fn gather<const BANDS: usize>(
        factors: &[Vec<f64>],
        b: &[[f64; BANDS]],
    ) -> Result<Vec<[f64; BANDS]>, Infallible> {
        let sum = |row: &Vec<f64>, k: usize| row.iter().zip(b).map(|(f, b)| f * b[k]).sum();
        Ok(factors.iter().map(|row| std::array::from_fn(|k| sum(row, k))).collect())
    }

    #[test]
    fn a_cube_with_a_luminous_ceiling() {
        let (surfels, factors) = cube(1);
        let exact = [
            [1.024258763, 1.09090909811, 1.55172415364],
            [0.0808157816103, 0.181745826108, 0.689551070738],
            [0.0808742209893, 0.181836268946, 0.689681193904],
        ];
        let mut emission = vec![[0.0; 3]; 6];
        emission[0] = [1.0; 3];
        let reflectance = vec![[0.3, 0.5, 0.8]; 6];
        let stop = Stop { tolerance: 1e-12, ..Stop::default() };
        let apply = |b: &[[f64; 3]]| gather(&factors, b);
        let solution =
            conjugate_gradients(&surfels, &emission, &reflectance, stop, apply, |_, _| ()).unwrap();
        for (i, b) in solution.radiosity.iter().enumerate() {
            for k in 0..3 {
                assert_relative_eq!(b[k], exact[i.min(2)][k], max_relative = 1e-9);
            }
        }
        assert!(solution.iterations <= 6, "three kinds of walls need three steps");
    }

    #[test]
    fn a_white_cube_takes_few_steps_where_gathering_takes_a_thousand() {
        let (surfels, factors) = cube(4);
        let mut emission = vec![[0.0]; surfels.len()];
        emission[3] = [1.0];
        let reflectance = vec![[0.99]; surfels.len()];
        let stop = Stop { tolerance: 1e-6, max_iterations: 5000 };
        let apply = |b: &[[f64; 1]]| gather(&factors, b);
        let mut seen = Vec::new();
        let progress = |iteration, residual| seen.push((iteration, residual));
        let fast =
            conjugate_gradients(&surfels, &emission, &reflectance, stop, apply, progress).unwrap();
        assert!(fast.iterations <= 20, "{}", fast.iterations);
        assert!(fast.residual <= 1e-6 && seen.last() == Some(&(fast.iterations, fast.residual)));
        let slow = jacobi(&emission, &reflectance, stop, apply, |_, _| ()).unwrap();
        assert!(slow.iterations > 500, "{}", slow.iterations);
        for (a, b) in fast.radiosity.iter().zip(&slow.radiosity) {
            assert_relative_eq!(a[0], b[0], max_relative = 1e-3);
        }
    }

    #[test]
    fn black_surfels_and_dark_bands_are_left_alone_and_others_differ() {
        let (surfels, factors) = cube(2);
        let mut emission = vec![[0.0; 2]; surfels.len()];
        emission[0] = [2.0, 0.0];
        let reflectance: Vec<[f64; 2]> =
            (0..surfels.len()).map(|i| [[0.0, 0.05, 0.99][i % 3], 0.5]).collect();
        let stop = Stop { tolerance: 1e-10, ..Stop::default() };
        let apply = |b: &[[f64; 2]]| gather(&factors, b);
        let solution =
            conjugate_gradients(&surfels, &emission, &reflectance, stop, apply, |_, _| ()).unwrap();
        assert!(solution.iterations <= 11, "{}", solution.iterations);
        let slow = jacobi(&emission, &reflectance, stop, apply, |_, _| ()).unwrap();
        for (i, (a, b)) in solution.radiosity.iter().zip(&slow.radiosity).enumerate() {
            assert_relative_eq!(a[0], b[0], epsilon = 1e-8);
            assert_eq!(a[1], 0.0);
            assert!(i % 3 > 0 || a[0] == emission[i][0]);
        }
    }

    #[test]
    fn what_no_solution_exists_for_is_refused() {
        let (surfels, mut factors) = cube(1);
        factors.iter_mut().flatten().for_each(|factor| *factor *= 1.5);
        let (emission, reflectance) = (vec![[1.0]; 6], vec![[0.9]; 6]);
        let apply = |b: &[[f64; 1]]| gather(&factors, b);
        let error = conjugate_gradients(
            &surfels,
            &emission,
            &reflectance,
            Stop::default(),
            apply,
            |_, _| (),
        );
        assert_eq!(error, Err(Error::NotPositiveDefinite { iterations: 2, band: 0 }));

        let short = |b: &[[f64; 1]]| Ok::<_, Infallible>(b[..5].to_vec());
        let stop = Stop::default();
        let error = conjugate_gradients(&surfels, &emission, &reflectance, stop, short, |_, _| ());
        assert!(matches!(error, Err(Error::LengthMismatch { what: "irradiance", .. })));
        let few = &surfels[..5];
        let error = conjugate_gradients(few, &emission, &reflectance, stop, apply, |_, _| ());
        assert!(matches!(error, Err(Error::LengthMismatch { what: "emission", .. })));
    }
}
