//! The radiosity equation B = E + ρ H(B), solved by gathering or by shooting.
//!
//! All quantities have one column per band, and bands don't mix: `[T; BANDS]` per surfel.

use farfield::Real;

use crate::error::Error;
use crate::residual::{add, checked, power_of_two_under, relative_residual, residuals, units};
use crate::rounding::{floor, floor_of_numbers};
use crate::surfel::{Surfel, check_emission, check_reflectance};
use crate::watch::{Report, Watch};

/// When a solver stops.
///
/// The residual is that of the equation itself, r = E + ρ H(B) − B, not the change of B: the
/// largest ‖r‖₂ / ‖E‖₂ over the bands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// The residual to reach.
    pub tolerance: f64,
    /// The number of iterations after which to give up; at least one is made.
    pub max_iterations: usize,
}

impl Default for Stop {
    /// A residual of 10⁻⁶ within 1000 iterations.
    fn default() -> Self {
        Self { tolerance: 1e-6, max_iterations: 1000 }
    }
}

/// A solution of the radiosity equation, in the units of the emission.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution<T, const BANDS: usize> {
    /// Radiosity B of each surfel.
    pub radiosity: Vec<[T; BANDS]>,
    /// Irradiance H(B) of each surfel.
    pub irradiance: Vec<[T; BANDS]>,
    /// Iterations made: shots when shooting, applications of H otherwise.
    pub iterations: usize,
    /// The residual of this B; see [`Stop`].
    pub residual: f64,
    /// Whether `progress` ended the iteration before the tolerance was reached; see [`Report`].
    pub interrupted: bool,
}

/// Jacobi's iteration B ← E + ρ H(B), known as gathering, from B = E.
///
/// `gather` is H: from the radiosity of all surfels to the irradiance of all surfels, such as
/// `|b| fmm.apply(b)`. `progress` is told the iteration and its residual, and may end it; see [`Report`].
///
/// It converges like the powers of the largest of ρ times the row sums of H: 0.9ᵏ in a closed white
/// room. Row sums above 1, which factors of touching surfels can have, may make it diverge.
///
/// # Errors
/// [`Error::InvalidEmission`], [`Error::InvalidReflectance`] or [`Error::LengthMismatch`] for bad
/// input, whatever `gather` fails with, [`Error::Diverged`] or [`Error::NotConverged`] with the
/// residual reached.
pub fn jacobi<T: Real, const BANDS: usize, E: Into<Error>, R: Report>(
    emission: &[[T; BANDS]],
    reflectance: &[[T; BANDS]],
    stop: Stop,
    gather: impl FnMut(&[[T; BANDS]]) -> Result<Vec<[T; BANDS]>, E>,
    progress: impl FnMut(usize, f64) -> R,
) -> Result<Solution<T, BANDS>, Error> {
    check(emission, reflectance)?;
    let mut gather = checked(gather);
    let mut watch = Watch::new(stop, progress);
    let mut radiosity = emission.to_vec();
    let mut iterations = 0;
    loop {
        iterations += 1;
        let irradiance = gather(&radiosity)?;
        let residuals = residuals(emission, reflectance, &irradiance, &radiosity);
        let residual = relative_residual(&residuals, emission);
        let floor = || floor(emission, reflectance, &radiosity, &irradiance, &mut gather);
        if watch.is_done(iterations, residual, floor)? {
            let interrupted = residual > stop.tolerance;
            return Ok(Solution { radiosity, irradiance, iterations, residual, interrupted });
        }
        for (b, r) in radiosity.iter_mut().zip(&residuals) {
            add(b, r);
        }
    }
}

/// Southwell's relaxation, known as progressive shooting, from B = 0 with all light unshot, r = E.
///
/// Each iteration takes the surfel i whose unshot light Σ_bands |r_i| A_i is the largest and lets
///
/// B_i += r_i,   r_j += ρ_j F_ji r_i for all j,   r_i reduced by what was shot,
///
/// F_ji = K_ji A_i V_ji = F_ij A_i / A_j. `column(i)` gives that: for every j, the irradiance of j per
/// unit radiosity of i. Each iteration costs O(N); `progress` is told its number and residual.
///
/// # Errors
/// Those of [`jacobi`].
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
    let unit_area = power_of_two_under(surfels.iter().map(|surfel| surfel.area.as_f64()));
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

pub(crate) fn check<T: Real, const BANDS: usize>(
    emission: &[[T; BANDS]],
    reflectance: &[[T; BANDS]],
) -> Result<(), Error> {
    check_length("reflectance", reflectance.len(), emission.len())?;
    check_emission(emission)?;
    check_reflectance(reflectance)
}

pub(crate) fn check_length(what: &'static str, found: usize, expected: usize) -> Result<(), Error> {
    if found == expected { Ok(()) } else { Err(Error::LengthMismatch { what, expected, found }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::operator::mixed;
    use crate::watch::{DOUBT, PLATEAU};
    use crate::{bicgstab, conjugate_gradients};
    use approx::assert_relative_eq;
    use farfield::relative_l2_error;
    use glam::DVec3;
    use std::convert::Infallible;
    use std::ops::ControlFlow;

    /// Three surfels of areas 1, 2, 4 with a reciprocal exchange that isn't closed.
    const AREAS: [f64; 3] = [1.0, 2.0, 4.0];
    const AREA_TIMES_FACTOR: [[f64; 3]; 3] = [[0.0, 0.3, 0.6], [0.3, 0.0, 1.2], [0.6, 1.2, 0.1]];
    const RHO: [[f64; 2]; 3] = [[0.5, 0.9], [0.2, 0.0], [0.7, 0.99]];
    const E: [[f64; 2]; 3] = [[1.0, 0.0], [0.0, 0.0], [2.0, 0.5]];

    fn factor(i: usize, j: usize) -> f64 {
        AREA_TIMES_FACTOR[i][j] / AREAS[i]
    }

    fn surfels() -> Vec<Surfel> {
        let surfel = |area| Surfel { position: DVec3::ZERO, normal: DVec3::Z, area, face: 0 };
        AREAS.map(surfel).to_vec()
    }

    fn gather(b: &[[f64; 2]]) -> Result<Vec<[f64; 2]>, Infallible> {
        let h = |i: usize| std::array::from_fn(|k| (0..3).map(|j| factor(i, j) * b[j][k]).sum());
        Ok((0..3).map(h).collect())
    }

    fn column(i: usize) -> Result<Vec<f64>, Infallible> {
        Ok((0..3).map(|j| factor(j, i)).collect())
    }

    const TIGHT: Stop = Stop { tolerance: 1e-13, max_iterations: 10_000 };

    /// (1 − ρ F)⁻¹ E.
    fn exact() -> Vec<[f64; 2]> {
        let band = |k: usize| {
            let entry = |i: usize, j: usize| f64::from(i == j) - RHO[i][k] * factor(i, j);
            let columns = std::array::from_fn(|j| std::array::from_fn(|i| entry(i, j)));
            glam::DMat3::from_cols_array_2d(&columns).inverse() * DVec3::from(E.map(|e| e[k]))
        };
        let (first, second) = (band(0), band(1));
        (0..3).map(|i| [first[i], second[i]]).collect()
    }

    #[test]
    fn gathering_and_shooting_solve_the_equation() {
        let jacobi = jacobi(&E, &RHO, TIGHT, gather, |_, _| ()).unwrap();
        let southwell = southwell(&surfels(), &E, &RHO, TIGHT, column, |_, _| ()).unwrap();
        for solution in [jacobi, southwell] {
            assert!(relative_l2_error(&solution.radiosity, &exact()) < 1e-12);
            let irradiance = gather(&solution.radiosity).unwrap();
            assert!(relative_l2_error(&solution.irradiance, &irradiance) < 1e-12);
            assert!(solution.residual <= 1e-13);
        }
    }

    #[test]
    fn energy_is_emitted_absorbed_or_escapes() {
        let solution = jacobi(&E, &RHO, TIGHT, gather, |_, _| ()).unwrap();
        let row_sums: Vec<f64> = (0..3).map(|i| (0..3).map(|j| factor(i, j)).sum()).collect();
        let balance = energy_balance(&surfels(), &E, &RHO, &solution, &row_sums).unwrap();
        assert_eq!(balance.emitted, [9.0, 2.0]);
        assert!(balance.absorbed.iter().chain(&balance.escaped).all(|&share| share > 0.1));
        assert!(balance.residual().iter().all(|r| r.abs() < 1e-12));

        let wrong = Solution { radiosity: E.to_vec(), ..solution };
        let balance = energy_balance(&surfels(), &E, &RHO, &wrong, &row_sums).unwrap();
        assert!(balance.residual().iter().all(|r| r.abs() > 0.01));
    }

    #[test]
    fn progress_reports_falling_residuals_of_the_equation() {
        let mut seen = Vec::new();
        let stop = Stop { tolerance: 1e-3, max_iterations: 100 };
        let solution = jacobi(&E, &RHO, stop, gather, |i, r| seen.push((i, r))).unwrap();
        assert_eq!(seen.len(), solution.iterations);
        assert_eq!(seen.last(), Some(&(solution.iterations, solution.residual)));
        assert!(seen.windows(2).all(|w| w[1].1 < w[0].1));
        // The residual of B = E is ρ H(E): in band 0, 2·0.6·0.5, 0.2·(0.15 + 1.2), 0.7·0.2.
        let by_hand = (0.6f64.powi(2) + 0.27f64.powi(2) + 0.14f64.powi(2)).sqrt() / 5f64.sqrt();
        let by_hand = by_hand.max((0.27f64.powi(2) + 0.012375f64.powi(2)).sqrt() / 0.5);
        assert_relative_eq!(seen[0].1, by_hand, max_relative = 1e-12);
    }

    #[test]
    fn interrupted_solvers_return_what_they_have_and_its_residual() {
        for last in 1..4 {
            let ends = |iteration, _| {
                if iteration < last { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
            };
            let surfels = surfels();
            let solved = [
                jacobi(&E, &RHO, TIGHT, gather, ends),
                southwell(&surfels, &E, &RHO, TIGHT, column, ends),
                conjugate_gradients(&surfels, &E, &RHO, TIGHT, gather, ends),
                bicgstab(&E, &RHO, TIGHT, gather, ends),
            ];
            for (solver, solution) in solved.into_iter().enumerate() {
                let solution = solution.unwrap();
                // Krylov solvers notice after whole steps only, and gather once more.
                let most = last + [0, 0, 1, 2][solver];
                assert!((last..=most).contains(&solution.iterations), "{solver}: {solution:?}");
                assert!(solution.interrupted && solution.residual > 1e-4, "{solver}: {solution:?}");
                let irradiance = gather(&solution.radiosity).unwrap();
                assert!(relative_l2_error(&solution.irradiance, &irradiance) < 1e-14);
                let r = residuals(&E, &RHO, &irradiance, &solution.radiosity);
                let residual = relative_residual(&r, &E);
                assert_relative_eq!(solution.residual, residual, max_relative = 1e-9);
            }
        }
    }

    #[test]
    fn what_is_good_enough_is_not_called_interrupted() {
        let ends = |_, _| ControlFlow::Break(());
        let stop = Stop { tolerance: 0.9, ..TIGHT };
        assert!(!jacobi(&E, &RHO, stop, gather, ends).unwrap().interrupted);
        let nan = |_: &[[f64; 1]]| Ok::<_, Infallible>(vec![[f64::NAN]]);
        let error = jacobi(&[[1.0]], &[[0.9]], TIGHT, nan, ends).unwrap_err();
        assert!(matches!(error, Error::Diverged { iterations: 1, .. }), "{error}");
    }

    #[test]
    fn amplifying_exchange_is_reported_not_returned() {
        let amplify =
            |b: &[[f64; 1]]| Ok::<_, Infallible>(b.iter().map(|b| [b[0] * 1.3]).collect());
        let error = jacobi(&[[1.0]], &[[0.9]], Stop::default(), amplify, |_, _| ()).unwrap_err();
        assert!(matches!(error, Error::Diverged { residual, .. } if residual > 1.0), "{error}");

        let column = |_| Ok::<_, Infallible>(vec![1.3]);
        let surfels = &surfels()[..1];
        let error =
            southwell(surfels, &[[1.0]], &[[0.9]], Stop::default(), column, |_, _| ()).unwrap_err();
        assert!(matches!(error, Error::Diverged { residual, .. } if residual > 1.0), "{error}");
    }

    /// What all solvers make of an equation whose sums have a relative error that changes at random.
    fn noisy(noise: f64, stop: Stop) -> [Result<Solution<f64, 2>, Error>; 4] {
        let mut calls = 0;
        let mut error = || {
            calls += 1;
            1.0 + noise * (mixed(calls) as f64 / u64::MAX as f64 - 0.5)
        };
        let mut h = |b: &[[f64; 2]]| {
            let h = gather(b)?;
            Ok::<_, Infallible>(h.iter().map(|h| h.map(|h| h * error())).collect())
        };
        let surfels = surfels();
        [
            jacobi(&E, &RHO, stop, &mut h, |_, _| ()),
            conjugate_gradients(&surfels, &E, &RHO, stop, &mut h, |_, _| ()),
            bicgstab(&E, &RHO, stop, &mut h, |_, _| ()),
            // The rounding of single precision, of which everything here is made.
            southwell(
                &surfels.iter().map(Surfel::cast::<f32>).collect::<Vec<_>>(),
                &E.map(|row| row.map(|e| e as f32)),
                &RHO.map(|row| row.map(|rho| rho as f32)),
                stop,
                |i| column(i).map(|f| f.iter().map(|&f| f as f32).collect()),
                |_, _| (),
            )
            .map(|solution| Solution {
                radiosity: solution.radiosity.iter().map(|b| b.map(f64::from)).collect(),
                irradiance: solution.irradiance.iter().map(|h| h.map(f64::from)).collect(),
                iterations: solution.iterations,
                residual: solution.residual,
                interrupted: solution.interrupted,
            }),
        ]
    }

    #[test]
    fn tolerances_beyond_rounding_are_refused_at_once_with_what_can_be_asked_for() {
        for (solver, result) in noisy(1e-7, TIGHT).into_iter().enumerate() {
            let error = result.unwrap_err();
            let Error::Stagnated { iterations, residual, tolerance, floor } = error else {
                panic!("{solver}: {error}")
            };
            assert!(iterations < 100, "{solver}: {iterations}");
            assert_eq!(tolerance, TIGHT.tolerance);
            assert!(tolerance < residual && residual <= floor, "{solver}: {residual:e} {floor:e}");
            assert!((1e-8..1e-5).contains(&floor), "{solver}: {floor:e}");
            // What it offers can be had.
            let stop = Stop { tolerance: floor, ..TIGHT };
            let solution = noisy(1e-7, stop).into_iter().nth(solver).unwrap().unwrap();
            assert!(relative_l2_error(&solution.radiosity, &exact()) < 100.0 * floor, "{solver}");
        }
    }

    #[test]
    fn an_equation_that_neither_gains_nor_loses_light_ends_on_its_plateau() {
        let swap = |b: &[[f64; 1]]| Ok::<_, Infallible>(vec![[2.0 * b[1][0]], [2.0 * b[0][0]]]);
        let (emission, reflectance) = ([[1.0], [1.0]], [[0.5], [0.5]]);
        let gathered = jacobi(&emission, &reflectance, TIGHT, swap, |_, _| ()).unwrap_err();
        let column = |i: usize| Ok::<_, Infallible>([vec![0.0, 2.0], vec![2.0, 0.0]][i].clone());
        let surfels = &surfels()[..1].repeat(2);
        let shot =
            southwell(surfels, &emission, &reflectance, TIGHT, column, |_, _| ()).unwrap_err();
        for (error, most) in [(gathered, PLATEAU + 1), (shot, 2 * PLATEAU + 2)] {
            let Error::Stagnated { iterations, residual, floor, .. } = error else {
                panic!("{error}")
            };
            assert!(iterations <= most && residual >= 1.0 && floor < 1e-10, "{error}");
        }
    }

    #[test]
    fn a_residual_that_rises_before_it_falls_is_waited_for() {
        // Light goes along a row of surfels, brighter from each to the next, and is absorbed by the last.
        let n = 4 * DOUBT;
        let pass = |b: &[[f64; 1]]| {
            let from = |i: usize| if i > 0 { 1.1 * b[i - 1][0] / 0.9 } else { 0.0 };
            Ok::<_, Infallible>((0..n).map(|i| [from(i)]).collect())
        };
        let mut emission = vec![[0.0]; n];
        emission[0] = [1.0];
        let solution = jacobi(&emission, &vec![[0.9]; n], TIGHT, pass, |_, _| ()).unwrap();
        assert_eq!((solution.iterations, solution.residual), (n, 0.0));
    }

    #[test]
    fn light_of_any_brightness_is_solved_alike() {
        let surfels = surfels();
        let solve = |unit: f64, stop: Stop| {
            let emission = E.map(|row| row.map(|e| unit * e));
            [
                jacobi(&emission, &RHO, stop, gather, |_, _| ()),
                southwell(&surfels, &emission, &RHO, stop, column, |_, _| ()),
                conjugate_gradients(&surfels, &emission, &RHO, stop, gather, |_, _| ()),
                bicgstab(&emission, &RHO, stop, gather, |_, _| ()),
            ]
            .map(Result::unwrap)
        };
        let exact = exact();
        let units = [-980, -600, -540, 500, 600, 1000].map(|power| 2f64.powi(power));
        for unit in units {
            for (solver, (found, plain)) in
                solve(unit, TIGHT).iter().zip(solve(1.0, TIGHT)).enumerate()
            {
                assert_eq!(found.iterations, plain.iterations, "{solver}: {unit:e}");
                assert_relative_eq!(found.residual, plain.residual, max_relative = 1e-6);
                let scaled: Vec<_> = found.radiosity.iter().map(|b| b.map(|b| b / unit)).collect();
                assert!(relative_l2_error(&scaled, &exact) < 1e-12, "{solver}: {unit:e}");
            }
        }
    }

    #[test]
    fn running_out_of_iterations_is_an_error() {
        let stop = Stop { tolerance: 1e-9, max_iterations: 3 };
        let error = jacobi(&E, &RHO, stop, gather, |_, _| ()).unwrap_err();
        assert!(matches!(error, Error::NotConverged { iterations: 3, .. }), "{error}");
    }

    #[test]
    fn bad_input_is_named() {
        let stop = Stop::default();
        let short = jacobi(&E, &RHO[..2], stop, gather, |_, _| ());
        let error = Error::LengthMismatch { what: "reflectance", expected: 3, found: 2 };
        assert_eq!(short, Err(error));
        let empty = |_: &[[f64; 2]]| Ok::<_, Infallible>(Vec::new());
        let error = Error::LengthMismatch { what: "irradiance", expected: 3, found: 0 };
        assert_eq!(jacobi(&E, &RHO, stop, empty, |_, _| ()), Err(error));
        let failing = |_: &[[f64; 2]]| Err(farfield::Error::InvalidLeafSize);
        let error = Error::Sum(farfield::Error::InvalidLeafSize);
        assert_eq!(jacobi(&E, &RHO, stop, failing, |_, _| ()), Err(error));
        let white = [[1.0, 0.0]; 3];
        assert!(matches!(
            jacobi(&E, &white, stop, gather, |_, _| ()),
            Err(Error::InvalidReflectance { index: 0, band: 0, .. })
        ));
    }

    #[test]
    fn darkness_and_emptiness_are_solved_at_once() {
        let dark = jacobi(&[[0.0; 2]; 3], &RHO, Stop::default(), gather, |_, _| ()).unwrap();
        assert_eq!((dark.iterations, dark.residual), (1, 0.0));
        let nothing =
            southwell::<f64, 1, _, _>(&[], &[], &[], Stop::default(), column, |_, _| ()).unwrap();
        assert!(nothing.radiosity.is_empty());
    }
}
