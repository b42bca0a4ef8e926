//! Every ready kernel against a sum written by hand.

use std::f64::consts::PI;

use farfield::glam::DVec3;
use farfield::relative_l2_error;
use farfield_formula::{Derivatives, KernelError, Options, Plan, READY, Ready};
use farfield_testing::clouds::Random;

/// What a source with charges q at d = x − y contributes.
type Pair = fn(DVec3, &[f64]) -> Vec<f64>;

fn stokes(d: DVec3, q: &[f64]) -> DVec3 {
    let (f, r) = (DVec3::from_slice(q), d.length());
    f / r + d * (d.dot(f) / r.powi(3))
}

fn turned(d: DVec3, q: &[f64]) -> DVec3 {
    DVec3::from_slice(q).cross(d) / d.length().powi(3)
}

/// A name, its parameters, and the same kernel written by hand.
type Case = (&'static str, &'static [(&'static str, f64)], Pair);

/// All kernels with parameters other than their defaults, and what they are; singular ones are not asked for d = 0.
const KERNELS: [Case; 23] = [
    ("laplace", &[], |d, q| vec![q[0] / d.length()]),
    ("laplace_dipole", &[], |d, q| vec![d.dot(DVec3::from_slice(q)) / d.length().powi(3)]),
    ("yukawa", &[("k", 2.0)], |d, q| vec![q[0] * (-2.0 * d.length()).exp() / d.length()]),
    ("softened_coulomb", &[("eps", 0.2)], |d, q| vec![q[0] / (d.length_squared() + 0.04).sqrt()]),
    ("inverse_power", &[("p", 1.25)], |d, q| vec![q[0] * d.length().powf(-1.25)]),
    ("gaussian", &[("length", 0.5)], |d, q| vec![q[0] * (-4.0 * d.length_squared()).exp()]),
    ("matern12", &[("length", 0.5)], |d, q| vec![q[0] * (-2.0 * d.length()).exp()]),
    ("matern32", &[("length", 0.5)], |d, q| {
        let s = 3f64.sqrt() * d.length() / 0.5;
        vec![q[0] * (1.0 + s) * (-s).exp()]
    }),
    ("matern52", &[("length", 0.5)], |d, q| {
        let s = 5f64.sqrt() * d.length() / 0.5;
        vec![q[0] * (1.0 + s + s * s / 3.0) * (-s).exp()]
    }),
    ("multiquadric", &[("c", 0.5)], |d, q| vec![q[0] * (d.length_squared() + 0.25).sqrt()]),
    ("inverse_multiquadric", &[("c", 0.5)], |d, q| vec![q[0] / (d.length_squared() + 0.25).sqrt()]),
    ("inverse_quadratic", &[("c", 0.5)], |d, q| vec![q[0] / (d.length_squared() + 0.25)]),
    ("r", &[], |d, q| vec![q[0] * d.length()]),
    ("r3", &[], |d, q| vec![q[0] * d.length().powi(3)]),
    ("r2logr", &[], |d, q| vec![q[0] * d.length_squared() * d.length().ln()]),
    ("logr", &[], |d, q| vec![q[0] * d.length().ln()]),
    ("inverse_square", &[], |d, q| vec![q[0] / d.length_squared()]),
    ("inverse_fourth", &[], |d, q| vec![q[0] / d.length_squared().powi(2)]),
    ("stokeslet", &[("mu", 3.0)], |d, q| (stokes(d, q) / (24.0 * PI)).to_array().to_vec()),
    ("rotlet", &[("mu", 3.0)], |d, q| (turned(d, q) / (24.0 * PI)).to_array().to_vec()),
    ("biot_savart", &[], |d, q| (turned(d, q) / (4.0 * PI)).to_array().to_vec()),
    ("kelvin", &[("G", 2.0), ("nu", 0.25)], |d, q| {
        let (f, r) = (DVec3::from_slice(q), d.length());
        let u = f * (3.0 - 4.0 * 0.25) / r + d * (d.dot(f) / r.powi(3));
        (u / (16.0 * PI * 2.0 * 0.75)).to_array().to_vec()
    }),
    ("rpy", &[("a", 0.2), ("mu", 3.0)], |d, q| {
        let (f, r, a) = (DVec3::from_slice(q), d.length(), 0.2);
        let along = if r > 0.0 { d * (d.dot(f) / r) } else { DVec3::ZERO };
        let u = if r >= 2.0 * a {
            let (same, other) = (1.0 + 2.0 * a * a / (3.0 * r * r), 1.0 - 2.0 * a * a / (r * r));
            (f * same + along / r * other) / (8.0 * PI * 3.0 * r)
        } else {
            (f * (1.0 - 9.0 * r / (32.0 * a)) + along * (3.0 / (32.0 * a))) / (6.0 * PI * 3.0 * a)
        };
        u.to_array().to_vec()
    }),
];

/// Those that count pairs at the same position.
const EVERYWHERE: [&str; 10] = [
    "gaussian",
    "matern12",
    "matern32",
    "matern52",
    "multiquadric",
    "inverse_multiquadric",
    "inverse_quadratic",
    "r",
    "r3",
    "rpy",
];

#[test]
fn every_kernel_is_what_it_says() {
    assert_eq!(READY.map(|ready| ready.name), KERNELS.map(|(name, ..)| name));
    let mut random = Random::new(3);
    let points: Vec<DVec3> = (0..700).map(|_| random.in_cube()).collect();
    for (name, parameters, pair) in KERNELS {
        let kernel = Ready::or_text(name, parameters).unwrap();
        let plan = Plan::<f64>::new(&kernel, &points, &points, &Options::default()).unwrap();
        let densities = plan.densities();
        let charges: Vec<f64> = (0..700 * densities).map(|_| random.between(0.2, 1.0)).collect();
        let values = plan.apply(&charges).unwrap();
        let mut exact = vec![0.0; values.len()];
        let counts = |i: usize, j: usize| i != j || EVERYWHERE.contains(&name);
        for (i, (x, u)) in points.iter().zip(exact.chunks_mut(plan.numbers())).enumerate() {
            for (j, (y, q)) in points.iter().zip(charges.chunks(densities)).enumerate() {
                if counts(i, j) {
                    u.iter_mut().zip(pair(*x - *y, q)).for_each(|(u, k)| *u += k);
                }
            }
        }
        let error = relative_l2_error::<f64>(&values, &exact);
        assert!(error < 1e-6, "{name}: {error:e}");
        // Without parameters there are defaults.
        assert!(Ready::or_text(name, &[]).is_ok(), "{name}");
        let other = Ready::or_text(name, &[("unknown", 1.0)]).unwrap_err().to_string();
        assert!(other.contains("\"unknown\" does not occur"), "{other}");
    }
}

#[test]
fn gradients_follow_the_values() {
    let (x, y) = (DVec3::new(0.3, 0.4, 0.5), DVec3::ZERO);
    for (name, parameters, pair) in KERNELS {
        let kernel = Ready::or_text(name, parameters).unwrap();
        let mut options = Options::default();
        options.derivatives = Derivatives::Gradient;
        let plan = Plan::<f64>::new(&kernel, &[y], &[x], &options).unwrap();
        let charge = vec![0.7; plan.densities()];
        let found = plan.apply(&charge).unwrap();
        let fields = found.len() / 4;
        for axis in 0..3 {
            let h = 1e-5;
            let mut step = DVec3::ZERO;
            step[axis] = h;
            let (above, below) = (pair(x + step, &charge), pair(x - step, &charge));
            for k in 0..fields {
                let slope = (above[k] - below[k]) / (2.0 * h);
                let error = (found[(1 + axis) * fields + k] - slope).abs();
                assert!(error < 1e-7 * (1.0 + slope.abs()), "{name}, {axis}, {k}: {slope}");
            }
        }
    }
}

#[test]
fn points_may_meet_themselves() {
    let points = [DVec3::ZERO, DVec3::new(0.3, 0.4, 0.5)];
    let mut options = Options::default();
    options.derivatives = Derivatives::Gradient;
    // The mobility has no derivatives at r = 0.
    for (name, ..) in KERNELS.iter().filter(|(name, ..)| *name != "rpy") {
        let kernel = Ready::or_text(name, &[]).unwrap();
        let both = Plan::<f64>::new(&kernel, &points, &points, &options).unwrap();
        let other = Plan::<f64>::new(&kernel, &points[1..], &points[..1], &options).unwrap();
        let fields = both.numbers() / 4;
        let found = both.apply(&vec![1.0; 2 * both.densities()]).unwrap();
        let alone = other.apply(&vec![1.0; both.densities()]).unwrap();
        for (k, (found, alone)) in found.iter().zip(alone).enumerate() {
            let itself = if k < fields && EVERYWHERE.contains(name) && !name.starts_with("r") {
                found - alone > 0.5
            } else {
                (found - alone).abs() < 1e-15
            };
            assert!(itself, "{name}, {k}: {found} {alone}");
        }
    }
}

#[test]
fn names_that_no_kernel_has_are_refused_with_the_nearest() {
    for (name, nearest) in
        [("stokslet", Some("stokeslet")), ("gravity", None), ("Laplace", Some("laplace"))]
    {
        let error = Ready::or_text(name, &[]).unwrap_err();
        let expected = KernelError::UnknownKernel {
            name: name.to_owned(),
            nearest: nearest.map(str::to_owned),
        };
        assert_eq!(error, expected);
        assert!(error.to_string().contains("one of laplace, "), "{error}");
    }
    // Texts that are wrong are pointed at.
    for text in ["1/q", "2r", "k"] {
        assert!(matches!(Ready::or_text(text, &[]), Err(KernelError::Text(_))), "{text}");
    }
}

#[test]
fn far_fields_of_ready_kernels_and_of_texts_are_alike() {
    let mut random = Random::new(4);
    let points: Vec<DVec3> = (0..30_000).map(|_| random.in_cube()).collect();
    let charges: Vec<f64> = (0..30_000).map(|_| random.between(-1.0, 1.0)).collect();
    let [ready, text] = ["laplace", "1/r"].map(|name| {
        let kernel = Ready::or_text(name, &[]).unwrap();
        let mut options = Options::default();
        options.applications = 100;
        let plan = Plan::<f64>::new(&kernel, &points, &points, &options).unwrap();
        assert!(plan.report().stats.expansion_pairs > 0);
        plan.apply(&charges).unwrap()
    });
    let error = relative_l2_error::<f64>(&text, &ready);
    assert!(error < 2e-6, "{error:e}");
    let wrong =
        Plan::<f64>::new(&Ready::or_text("r", &[]).unwrap(), &points, &points, &Options::default());
    let error = wrong.unwrap().apply(&charges[1..]).unwrap_err().to_string();
    assert!(error.contains("expected 30000 entries, found 29999"), "{error}");
}
