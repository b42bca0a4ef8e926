//! What a plan does beside sums: second derivatives, many columns, transposes, and stopping.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use farfield::glam::{DVec3, Vec3};
use farfield::{Error, OperatorStore, Phase, Scheme, Watch, relative_l2_error};
use farfield_formula::{Derivatives, Options, Plan, READY, Ready, TextFormula, direct_sums};
use farfield_testing::clouds::Random;

fn points(n: usize, seed: u64) -> Vec<DVec3> {
    let mut random = Random::new(seed);
    (0..n).map(|_| random.in_cube()).collect()
}

fn numbers(n: usize, seed: u64) -> Vec<f64> {
    let mut random = Random::new(seed);
    (0..n).map(|_| random.between(-1.0, 1.0)).collect()
}

fn options(derivatives: Derivatives) -> Options {
    let mut options = Options::default();
    (options.derivatives, options.applications) = (derivatives, 100);
    options
}

/// Of axes 1 1, 1 2, 1 3, 2 2, 2 3, 3 3.
const SECOND: [[usize; 2]; 6] = [[0, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 2]];

#[test]
fn second_derivatives_are_those_of_the_gradients() {
    let texts = ["sin(3*r)/r", "d1*d2*exp(-r2)", "x1*y2*log(r) + x3^3", "erf(r)/r + tanh(d1)"];
    let names = READY.map(|ready| ready.name);
    let (y, x) = ([DVec3::ZERO], DVec3::new(0.7, -0.5, 0.4));
    for text in names.into_iter().chain(texts) {
        let kernel = Ready::or_text(text, &[]).unwrap();
        let charge = numbers(kernel.columns(), 3);
        let rows = kernel.rows();
        let sums =
            |at: DVec3, derivatives| direct_sums(&kernel, &y, &charge, &[at], derivatives).unwrap();
        let found = sums(x, Derivatives::Hessian);
        assert_eq!(found[..4 * rows], sums(x, Derivatives::Gradient));
        for (second, [a, b]) in SECOND.into_iter().enumerate() {
            // Central differences of sixth order.
            let h = 2f64.powi(-8);
            let gradient = |steps: f64| {
                let mut at = x;
                at[b] += steps * h;
                sums(at, Derivatives::Gradient)[(1 + a) * rows..][..rows].to_vec()
            };
            let sides: Vec<_> = [1.0, 2.0, 3.0].map(|k| [gradient(k), gradient(-k)]).into();
            for row in 0..rows {
                let [one, two, three] =
                    [0, 1, 2].map(|k: usize| sides[k][0][row] - sides[k][1][row]);
                let slope = (45.0 * one - 9.0 * two + three) / (60.0 * h);
                let own = found[(4 + second) * rows + row];
                let error = (own - slope).abs();
                assert!(error < 1e-9 * (1.0 + slope.abs()), "{text} {a}{b}: {own} {slope}");
            }
        }
    }
}

#[test]
fn plans_sum_second_derivatives() {
    let (x, q) = (points(2500, 1), numbers(2500, 2));
    for text in ["laplace", "exp(-2*r)/r"] {
        let kernel = Ready::or_text(text, &[]).unwrap();
        let plan = Plan::new(&kernel, &x, &x, &options(Derivatives::Hessian)).unwrap();
        assert_eq!(plan.numbers(), 10);
        let found = plan.apply(&q).unwrap();
        let exact = direct_sums(&kernel, &x, &q, &x, Derivatives::Hessian).unwrap();
        let error = relative_l2_error::<f64>(&found, &exact);
        assert!(error < 1e-6, "{text}: {error:e}");
        if text == "laplace" {
            // Δ 1/r = 0
            let trace = found.chunks(10).map(|u| (u[4] + u[7] + u[9]).abs()).fold(0.0, f64::max);
            let size = found.chunks(10).map(|u| u[4].abs()).fold(0.0, f64::max);
            assert!(trace < 1e-5 * size, "{trace:e} {size:e}");
        }
    }
}

#[test]
fn columns_are_sums_of_their_own_whatever_their_size() {
    let (y, x) = (points(12_000, 1), points(9_000, 2));
    const SIZES: [f64; 19] = [
        1.0, 1e-9, 1e30, 0.0, 1e-30, 1.0, 2.0, 3.0, 1.0, 1.0, 5.0, 1.0, 1e3, 1.0, 1.0, 1.0, 1.0,
        1.0, 7.0,
    ];
    let kernel = Ready::or_text("exp(-r)/r", &[]).unwrap();
    let all = numbers(y.len() * SIZES.len(), 3);
    let all: Vec<f64> = all
        .chunks(SIZES.len())
        .flat_map(|row| row.iter().zip(SIZES).map(|(q, size)| q * size).collect::<Vec<_>>())
        .collect();
    let plan = Plan::new(&kernel, &y, &x, &options(Derivatives::None)).unwrap();
    let watch = Watch::default();
    for columns in [SIZES.len(), 3] {
        let own: Vec<f64> =
            all.chunks(SIZES.len()).flat_map(|row| row[..columns].to_vec()).collect();
        let found = plan.apply_columns(&own, columns, &watch).unwrap();
        for column in 0..columns {
            let q: Vec<f64> = own.iter().skip(column).step_by(columns).copied().collect();
            let u: Vec<f64> = found.iter().skip(column).step_by(columns).copied().collect();
            let some = &x[..300];
            let exact = direct_sums(&kernel, &y, &q, some, Derivatives::None).unwrap();
            let error = relative_l2_error::<f64>(&u[..300], &exact);
            assert!(error < 1e-6, "{column} of {columns}: {error:e}");
        }
    }
    assert!(plan.report().stats.expansion_pairs > 0);
    let few = Plan::new(&kernel, &y[..50], &x[..50], &options(Derivatives::Gradient)).unwrap();
    let found = few.apply_columns(&all[..150], 3, &watch).unwrap();
    for column in 0..3 {
        let q: Vec<f64> = all[..150].iter().skip(column).step_by(3).copied().collect();
        let u: Vec<f64> = found.iter().skip(column).step_by(3).copied().collect();
        assert_eq!(u, few.apply(&q).unwrap());
    }
    let refused = few.apply_columns(&all[..149], 3, &watch);
    assert!(matches!(refused, Err(Error::LengthMismatch { expected: 150, found: 149, .. })));
}

#[test]
fn transposed_plans_sum_the_transposed_matrix() {
    let texts = ["laplace_dipole", "(x1 + 2)*exp(-r)*d1", "stokeslet", "where(d1 < 0, r, x2*y3)"];
    for text in texts {
        let kernel = Ready::or_text(text, &[]).unwrap();
        let (rows, columns) = (kernel.rows(), kernel.columns());
        for (n, m) in [(60, 40), (4000, 3000)] {
            let (y, x) = (points(n, 1), points(m, 2));
            let plan = Plan::new(&kernel, &y, &x, &options(Derivatives::None)).unwrap();
            let back = plan.transposed(&Watch::default()).unwrap();
            assert_eq!((back.densities(), back.numbers()), (rows, columns));
            let (q, w) = (numbers(n * columns, 3), numbers(m * rows, 4));
            let (u, v) = (plan.apply(&q).unwrap(), back.apply(&w).unwrap());
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let norm = |a: &[f64]| dot(a, a).sqrt();
            let difference = (dot(&w, &u) - dot(&q, &v)).abs();
            let stats = [plan.report().stats.scheme, back.report().stats.scheme];
            let bound = if stats == [Scheme::Direct; 2] { 1e-12 } else { 1e-6 };
            assert!(difference <= bound * norm(&w) * norm(&u), "{text} {n}: {difference:e}");
            assert!(n > 60 || bound == 1e-12);
            let exact = direct_sums(&kernel.transposed(), &x, &w, &y[..50], Derivatives::None);
            let error = relative_l2_error::<f64>(&v[..50 * columns], &exact.unwrap());
            assert!(error < 3e-6, "{text} {n}: {error:e}");
        }
    }
}

#[test]
fn whatever_is_watched_can_be_stopped_at_any_time() {
    let (x, q) = (points(40_000, 1), numbers(40_000, 2));
    let kernel = TextFormula::new("erfc(r)/r + cos(5*r)", &[]).unwrap();
    let options = options(Derivatives::None);
    let plan = Plan::new(&kernel, &x, &x, &options).unwrap();
    let exact = plan.apply(&q).unwrap();
    let looked_on = |stop_at: Option<usize>| {
        let asked = Arc::new(AtomicUsize::new(0));
        let count = Arc::clone(&asked);
        let watch = Watch::asking(move |progress| {
            assert!((0.0..=1.0).contains(&progress.fraction));
            if Some(count.fetch_add(1, Relaxed)) == stop_at {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        });
        (watch, asked)
    };
    let (watch, asked) = looked_on(None);
    // Operators that are known take too little time to be stopped.
    OperatorStore::of_process().clear();
    let same = Plan::<f64>::watched(&kernel, &x, &x, &options, &watch).unwrap();
    let building = asked.load(Relaxed);
    assert_eq!(same.apply_columns(&q, 1, &watch).unwrap(), exact);
    assert!(asked.load(Relaxed) > 0 && watch.progress().phase == Phase::Values);
    let mut stops = 0;
    for moment in 0..10 {
        let (watch, _) = looked_on(Some(moment * building / 20));
        OperatorStore::of_process().clear();
        match Plan::<f64>::watched(&kernel, &x, &x, &options, &watch) {
            Err(error) => {
                assert_eq!(error, Error::Stopped);
                stops += 1;
            }
            // A machine with less to do may be through by then.
            Ok(plan) => assert_eq!(plan.apply(&q).unwrap(), exact),
        }
    }
    assert!(stops > 2, "{stops}");
    let stopped = Watch::new();
    stopped.stop();
    assert_eq!(plan.apply_columns(&q, 1, &stopped), Err(Error::Stopped));
    let (watch, _) = looked_on(Some(0));
    let found = plan.apply_columns(&q, 1, &watch);
    assert!(found == Err(Error::Stopped) || found == Ok(exact.clone()));
    assert_eq!(plan.apply(&q).unwrap(), exact);
}

#[test]
fn derivatives_that_there_are_not_are_refused_by_name() {
    let x = [DVec3::X, DVec3::Y, DVec3::X];
    let rpy = Ready::or_text("rpy", &[]).unwrap();
    let refused = Plan::<f64>::new(&rpy, &x, &x[1..], &options(Derivatives::Gradient)).map(drop);
    assert_eq!(refused, Err(Error::NotDifferentiable { target: 0, from: 1 }));
    let words = refused.unwrap_err().to_string();
    assert!(words.starts_with("target 0 and source 1 are at one place, where the kernel has no"));
    assert!(Plan::<f64>::new(&rpy, &x, &x, &options(Derivatives::None)).is_ok());
    assert!(Plan::<f64>::new(&rpy, &x[..1], &x[1..2], &options(Derivatives::Gradient)).is_ok());
    let smooth = Ready::or_text("gaussian", &[]).unwrap();
    assert!(Plan::<f64>::new(&smooth, &x, &x, &options(Derivatives::Hessian)).is_ok());
    let single = [Vec3::X, Vec3::X];
    let refused =
        Plan::<f32>::new(&rpy, &single, &single, &options(Derivatives::Hessian)).map(drop);
    assert_eq!(refused, Err(Error::NotDifferentiable { target: 0, from: 0 }));
}

#[test]
fn parameters_of_ready_kernels_are_held_against_what_they_mean() {
    for (name, parameter, value, words) in [
        ("gaussian", "length", -1.0, "\"length\" of gaussian is -1: expected a number above 0"),
        ("matern32", "length", 0.0, "is 0: expected a number above 0"),
        ("yukawa", "k", -0.5, "expected 0 or a number above it"),
        ("kelvin", "nu", 0.7, "\"nu\" of kelvin is 0.7: expected a number from -1 to 0.5"),
        ("rpy", "a", -1e-3, "expected a number above 0"),
        ("yukawa", "k", f64::NAN, "expected a finite number"),
    ] {
        let error = Ready::or_text(name, &[(parameter, value)]).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
    assert!(Ready::or_text("inverse_power", &[("p", -3.0)]).is_ok());
    assert!(Ready::or_text("yukawa", &[("k", 0.0)]).is_ok());
}
