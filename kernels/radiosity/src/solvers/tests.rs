//! Tests that all solvers share.

use crate::numbers::mixed;
use crate::solvers::residual::{relative_residual, residuals};
use crate::solvers::watch::{DOUBT, PLATEAU};
use crate::{
    Error, Solution, Stop, Surfel, bicgstab, conjugate_gradients, energy_balance, jacobi, southwell,
};
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
    let amplify = |b: &[[f64; 1]]| Ok::<_, Infallible>(b.iter().map(|b| [b[0] * 1.3]).collect());
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
    let shot = southwell(surfels, &emission, &reflectance, TIGHT, column, |_, _| ()).unwrap_err();
    for (error, most) in [(gathered, PLATEAU + 1), (shot, 2 * PLATEAU + 2)] {
        let Error::Stagnated { iterations, residual, floor, .. } = error else { panic!("{error}") };
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
        for (solver, (found, plain)) in solve(unit, TIGHT).iter().zip(solve(1.0, TIGHT)).enumerate()
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
    let white = [[1.1, 0.0]; 3];
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
