//! The radiosity equation by stabilised bi-conjugate gradients.

use farfield::Real;

use crate::error::Error;
use crate::solvers::floor::floor;
use crate::solvers::residual::{add, checked, relative_residual, residuals, units};
use crate::solvers::solution::{Solution, Stop, check};
use crate::solvers::watch::{Report, Watch};

/// The radiosity equation (1 − ρ H) B = E by BiCGSTAB, from B = E (van der Vorst, SIAM J. Sci. Stat.
/// Comput. 13, 1992).
///
/// It is meant for an exchange that isn't reciprocal, such as a fast sum with different errors in the two
/// directions: [`conjugate_gradients`](crate::conjugate_gradients) need not converge there. Each step
/// takes two calls of `gather`, which is H, as in [`jacobi`](crate::jacobi). Both count as iterations. All
/// bands share the calls; each has scalars of its own. Surfels without reflectance keep B = E.
///
/// Between restarts it goes by an estimate of the residual. When the estimate meets the tolerance, the
/// residual itself is computed, and the method starts afresh from the current B if that is still too
/// large. It also starts afresh, after one step of Jacobi's iteration, where a division by zero would end
/// the recurrence.
///
/// # Errors
/// Those of [`jacobi`](crate::jacobi), and [`Error::NegativeRadiosity`] if rows sum to so much more than 1
/// that the solution is not the limit of bounces of light.
pub fn bicgstab<T: Real, const BANDS: usize, E: Into<Error>, R: Report>(
    emission: &[[T; BANDS]],
    reflectance: &[[T; BANDS]],
    stop: Stop,
    gather: impl FnMut(&[[T; BANDS]]) -> Result<Vec<[T; BANDS]>, E>,
    progress: impl FnMut(usize, f64) -> R,
) -> Result<Solution<T, BANDS>, Error> {
    check(emission, reflectance)?;
    let mut gather = checked(gather);
    let mut watch = Watch::of_estimates(stop, progress);
    let units = units(emission);
    let product = |a: &[[T; BANDS]], b: &[[T; BANDS]]| product(a, b, units);
    let norms = |a: &[[T; BANDS]], b: &[[T; BANDS]]| {
        let (a, b) = (product(a, a), product(b, b));
        std::array::from_fn(|k| a[k].sqrt() * b[k].sqrt())
    };
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
            if !interrupted {
                check_sign(&radiosity, units)?;
            }
            return Ok(Solution { radiosity, irradiance, iterations, residual, interrupted });
        }
        let shadow = r.clone();
        let mut p = r.clone();
        let mut rho = product(&shadow, &r);
        loop {
            let v = outgoing(&p, reflectance, &gather(&p)?);
            let alpha = quotients::<T, BANDS>(rho, product(&shadow, &v), norms(&shadow, &v));
            advance(&mut radiosity, alpha.map(|a| a.unwrap_or(0.0)), &p);
            advance(&mut r, alpha.map(|a| -a.unwrap_or(0.0)), &v);

            let t = outgoing(&r, reflectance, &gather(&r)?);
            let (aligned, squared, size) = (product(&t, &r), product(&t, &t), norms(&t, &r));
            // Where either scalar is lost the residual may stay as it is for ever: there light bounces.
            let bounce = |k: usize| {
                alpha[k].is_none() || aligned[k].abs() <= T::epsilon().as_f64() * size[k]
            };
            let omega: [f64; BANDS] =
                std::array::from_fn(|k| if bounce(k) { 1.0 } else { aligned[k] / squared[k] });
            advance(&mut radiosity, omega, &r);
            advance(&mut r, omega.map(|w| -w), &t);
            iterations += 2;
            if !watch.goes_on(iterations, relative_residual(&r, emission)) {
                break;
            }

            let next = product(&shadow, &r);
            let size = norms(&shadow, &r);
            // A residual that the shadow doesn't see gives no direction; one that is zero needs none.
            let lost = |k: usize| {
                size[k] > 0.0 && (bounce(k) || next[k].abs() <= T::epsilon().as_f64() * size[k])
            };
            if (0..BANDS).any(lost) {
                break;
            }
            let beta: [f64; BANDS] = std::array::from_fn(|k| match alpha[k] {
                Some(alpha) if size[k] > 0.0 => (next[k] / rho[k]) * (alpha / omega[k]),
                _ => 0.0,
            });
            for ((p, v), r) in p.iter_mut().zip(&v).zip(&r) {
                for k in 0..BANDS {
                    let (beta, omega) = (T::from_f64(beta[k]), T::from_f64(omega[k]));
                    p[k] = r[k] + beta * (p[k] - omega * v[k]);
                }
            }
            rho = next;
        }
    }
}

/// The negative part of a radiosity, relative to all of it, that errors of a sum don't explain.
const NEGATIVE_SHARE: f64 = 0.01;

/// (1 − ρ H) b, with H b as received.
fn outgoing<T: Real, const BANDS: usize>(
    b: &[[T; BANDS]],
    reflectance: &[[T; BANDS]],
    received: &[[T; BANDS]],
) -> Vec<[T; BANDS]> {
    let rows = b.iter().zip(reflectance).zip(received);
    rows.map(|((b, rho), h)| std::array::from_fn(|k| b[k] - rho[k] * h[k])).collect()
}

/// ⟨a, b⟩, band by band, of numbers multiplied by the bands' units.
fn product<T: Real, const BANDS: usize>(
    a: &[[T; BANDS]],
    b: &[[T; BANDS]],
    units: [f64; BANDS],
) -> [f64; BANDS] {
    let term = |k: usize, a: T, b: T| (units[k] * a.as_f64()) * (units[k] * b.as_f64());
    std::array::from_fn(|k| a.iter().zip(b).map(|(a, b)| term(k, a[k], b[k])).sum())
}

/// Products divided by others, of vectors whose norms multiply to `size`; none where these are
/// orthogonal but for rounding.
fn quotients<T: Real, const BANDS: usize>(
    above: [f64; BANDS],
    below: [f64; BANDS],
    size: [f64; BANDS],
) -> [Option<f64>; BANDS] {
    let exists = |k: usize| below[k].abs() > T::epsilon().as_f64() * size[k];
    std::array::from_fn(|k| exists(k).then(|| above[k] / below[k]))
}

/// sum += step · direction, band by band.
fn advance<T: Real, const BANDS: usize>(
    sum: &mut [[T; BANDS]],
    step: [f64; BANDS],
    direction: &[[T; BANDS]],
) {
    for (sum, d) in sum.iter_mut().zip(direction) {
        add(sum, &std::array::from_fn(|k| T::from_f64(step[k]) * d[k]));
    }
}

/// Bounces of light end at a radiosity that is nowhere negative, or don't end (Perron and Frobenius).
fn check_sign<T: Real, const BANDS: usize>(
    radiosity: &[[T; BANDS]],
    units: [f64; BANDS],
) -> Result<(), Error> {
    for band in 0..BANDS {
        let values = || radiosity.iter().map(|b| b[band].as_f64()).enumerate();
        let square = |(_, b): (usize, f64)| (units[band] * b).powi(2);
        let all: f64 = values().map(square).sum();
        let negative: f64 = values().filter(|(_, b)| *b < 0.0).map(square).sum();
        if negative > NEGATIVE_SHARE.powi(2) * all
            && let Some((index, found)) = values().min_by(|(_, a), (_, b)| a.total_cmp(b))
        {
            return Err(Error::NegativeRadiosity { index, band, found });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solvers::conjugate_gradients::tests::{cube, gather};
    use crate::{conjugate_gradients, jacobi};
    use approx::assert_relative_eq;
    use std::convert::Infallible;
    use std::ops::ControlFlow;

    const TIGHT: Stop = Stop { tolerance: 1e-10, max_iterations: 10_000 };

    /// Rows of light that mostly goes round in one direction, all of it received.
    fn roundabout(n: usize) -> Vec<Vec<f64>> {
        let entry = |i: usize, j: usize| match (j + n - i) % n {
            1 => 0.85 + 0.05 / n as f64,
            k => 0.1 * f64::from(u8::from(k == 2)) + 0.05 / n as f64,
        };
        (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect()
    }

    #[test]
    fn an_exchange_that_is_not_reciprocal_is_solved() {
        let n = 24;
        let factors = roundabout(n);
        let mut emission = vec![[0.0, 0.5]; n];
        emission[3] = [1.0, 0.0];
        let reflectance: Vec<_> = (0..n).map(|i| [0.95, [0.0, 0.3, 0.9][i % 3]]).collect();
        let apply = |b: &[[f64; 2]]| gather(&factors, b);
        let solution = bicgstab(&emission, &reflectance, TIGHT, apply, |_, _| ()).unwrap();
        let slow = jacobi(&emission, &reflectance, TIGHT, apply, |_, _| ()).unwrap();
        for (i, (a, b)) in solution.radiosity.iter().zip(&slow.radiosity).enumerate() {
            assert_relative_eq!(a[0], b[0], max_relative = 1e-7);
            assert_relative_eq!(a[1], b[1], max_relative = 1e-7);
            assert!(i % 3 > 0 || a[1] == emission[i][1], "black surfels are left alone");
        }
        assert!(solution.residual <= TIGHT.tolerance);
        assert!(solution.iterations < slow.iterations / 3, "{}", solution.iterations);
        assert_eq!(solution.irradiance, apply(&solution.radiosity).unwrap());
        // Where the method for symmetric equations doesn't get by then.
        let surfels = cube(2).0;
        let stop = Stop { max_iterations: 4 * solution.iterations, ..TIGHT };
        let wrong = conjugate_gradients(&surfels, &emission, &reflectance, stop, apply, |_, _| ());
        assert!(wrong.is_err(), "{wrong:?}");
    }

    #[test]
    fn a_white_cube_takes_few_steps() {
        let (surfels, factors) = cube(4);
        let mut emission = vec![[0.0]; surfels.len()];
        emission[3] = [1.0];
        let reflectance = vec![[0.99]; surfels.len()];
        let stop = Stop { tolerance: 1e-8, max_iterations: 100 };
        let apply = |b: &[[f64; 1]]| gather(&factors, b);
        let mut seen = Vec::new();
        let progress = |iteration, residual| seen.push((iteration, residual));
        let fast = bicgstab(&emission, &reflectance, stop, apply, progress).unwrap();
        assert!(fast.iterations <= 30, "{}", fast.iterations);
        assert_eq!(seen.last(), Some(&(fast.iterations, fast.residual)));
        let known =
            conjugate_gradients(&surfels, &emission, &reflectance, stop, apply, |_, _| ()).unwrap();
        for (a, b) in fast.radiosity.iter().zip(&known.radiosity) {
            assert_relative_eq!(a[0], b[0], max_relative = 1e-5);
        }
    }

    #[test]
    fn where_a_scalar_is_lost_light_bounces_and_all_starts_afresh() {
        // The first residual (15/8, 15/8) is at a right angle with 1 − ρ H times itself, exactly.
        let apply = |b: &[[f64; 1]]| Ok::<_, Infallible>(vec![[3.75 * b[1][0]], [0.25 * b[0][0]]]);
        let (emission, reflectance) = ([[15.0], [1.0]], [[0.5], [0.5]]);
        let solution = bicgstab(&emission, &reflectance, TIGHT, apply, |_, _| ()).unwrap();
        let determinant = 1.0 - 0.25 * 3.75 * 0.25;
        let exact = [(15.0 + 0.5 * 3.75) / determinant, (1.0 + 0.5 * 0.25 * 15.0) / determinant];
        for (b, exact) in solution.radiosity.iter().zip(exact) {
            assert_relative_eq!(b[0], exact, max_relative = 1e-12);
        }
        assert!(solution.iterations <= 9, "{}", solution.iterations);
    }

    #[test]
    fn what_bounces_of_light_do_not_reach_is_refused() {
        let (_, mut factors) = cube(1);
        factors.iter_mut().flatten().for_each(|factor| *factor *= 1.5);
        let mut emission = vec![[0.0]; 6];
        emission[2] = [1.0];
        let reflectance = vec![[0.9]; 6];
        let stop = Stop::default();
        let apply = |b: &[[f64; 1]]| gather(&factors, b);
        let error = bicgstab(&emission, &reflectance, stop, apply, |_, _| ()).unwrap_err();
        assert!(matches!(error, Error::NegativeRadiosity { band: 0, found, .. } if found < 0.0));
        // What an interrupted iteration has may be anything.
        let ends = |i, _| if i < 3 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) };
        let part = bicgstab(&emission, &reflectance, stop, apply, ends).unwrap();
        assert!(part.interrupted && part.radiosity.iter().any(|b| b[0] < -0.1), "{part:?}");
    }

    #[test]
    fn darkness_and_emptiness_are_solved_at_once() {
        let factors = roundabout(3);
        let apply = |b: &[[f64; 2]]| gather(&factors, b);
        let stop = Stop::default();
        let dark = bicgstab(&[[0.0; 2]; 3], &[[0.5; 2]; 3], stop, apply, |_, _| ()).unwrap();
        assert_eq!((dark.iterations, dark.residual), (1, 0.0));
        // One band is dark, the other is not.
        let half = bicgstab(&[[1.0, 0.0]; 3], &[[0.5; 2]; 3], TIGHT, apply, |_, _| ()).unwrap();
        for b in &half.radiosity {
            assert_relative_eq!(b[0], 2.0, max_relative = 1e-9);
            assert_eq!(b[1], 0.0);
        }
        let nothing = |_: &[[f64; 1]]| Ok::<_, Infallible>(Vec::new());
        let nothing = bicgstab(&[], &[], stop, nothing, |_, _| ()).unwrap();
        assert!(nothing.radiosity.is_empty());
    }

    #[test]
    fn single_precision_gets_as_far_as_it_can() {
        let factors = roundabout(6);
        let apply = |b: &[[f32; 1]]| {
            let wide: Vec<_> = b.iter().map(|b| [f64::from(b[0])]).collect();
            let h = gather(&factors, &wide).unwrap();
            Ok::<_, Infallible>(h.iter().map(|h| [h[0] as f32]).collect())
        };
        let emission: Vec<[f32; 1]> = (0..6).map(|i| [i as f32]).collect();
        let stop = Stop { tolerance: 1e-5, max_iterations: 100 };
        let solution = bicgstab(&emission, &[[0.8f32]; 6], stop, apply, |_, _| ()).unwrap();
        let mean = solution.radiosity.iter().map(|b| b[0]).sum::<f32>() / 6.0;
        assert_relative_eq!(mean, 2.5 / 0.2, max_relative = 1e-4);
    }

    #[test]
    fn bad_input_is_named() {
        let factors = roundabout(3);
        let apply = |b: &[[f64; 1]]| gather(&factors, b);
        let (e, rho, stop) = ([[1.0]; 3], [[0.5]; 3], Stop::default());
        let error = Error::LengthMismatch { what: "reflectance", expected: 3, found: 2 };
        assert_eq!(bicgstab(&e, &rho[..2], stop, apply, |_, _| ()), Err(error));
        let error = bicgstab(&e, &[[1.1]; 3], stop, apply, |_, _| ()).unwrap_err();
        assert!(matches!(error, Error::InvalidReflectance { index: 0, band: 0, .. }));
        let error = bicgstab(&[[-1.0]; 3], &rho, stop, apply, |_, _| ()).unwrap_err();
        assert!(matches!(error, Error::InvalidEmission { index: 0, band: 0, .. }));
        let short = |b: &[[f64; 1]]| Ok::<_, Infallible>(b[..2].to_vec());
        let error = Error::LengthMismatch { what: "irradiance", expected: 3, found: 2 };
        assert_eq!(bicgstab(&e, &rho, stop, short, |_, _| ()), Err(error));
        let failing = |_: &[[f64; 1]]| Err(farfield::Error::InvalidLeafSize);
        let error = Error::Sum(farfield::Error::InvalidLeafSize);
        assert_eq!(bicgstab(&e, &rho, stop, failing, |_, _| ()), Err(error));
        let nan = |b: &[[f64; 1]]| Ok::<_, Infallible>(vec![[f64::NAN]; b.len()]);
        let error = bicgstab(&e, &rho, stop, nan, |_, _| ()).unwrap_err();
        assert!(matches!(error, Error::Diverged { iterations: 1, .. }));
        let stop = Stop { tolerance: 1e-12, max_iterations: 2 };
        let spot = [[1.0], [0.0], [0.0]];
        let error = bicgstab(&spot, &rho, stop, apply, |_, _| ()).unwrap_err();
        assert!(matches!(error, Error::NotConverged { .. }), "{error}");
    }
}
