//! Any kernel is summed to its tolerance, values and derivatives, whatever was summed before.

use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use farfield::{Fmm, FnKernel, Kernel, Scheme, direct, from_fn};
use farfield_testing::clouds::{charges, cube, helix, sphere};
use glam::DVec3;

pub(crate) type Formula = fn(DVec3, DVec3) -> f64;

/// ‖ũ − u‖ relative to the larger of ‖u‖ and s, s² = Σ |K|² |q|² over all pairs of different points.
pub(crate) fn error(formula: Formula, points: &[DVec3], qs: &[f64], sums: &[f64]) -> f64 {
    error_at(points, formula, points, qs, sums)
}

/// The same at other targets.
pub(crate) fn error_at(
    targets: &[DVec3],
    formula: Formula,
    points: &[DVec3],
    qs: &[f64],
    sums: &[f64],
) -> f64 {
    let exact = direct(&plain(formula), points, qs, targets).unwrap();
    let pairs = targets.iter().flat_map(|x| points.iter().zip(qs).map(move |(y, q)| (x, y, q)));
    let s: f64 =
        pairs.filter(|(x, y, _)| x != y).map(|(x, y, q)| (formula(*x, *y) * q).powi(2)).sum();
    let u: f64 = exact.iter().map(|u| u * u).sum();
    let e: f64 = sums.iter().zip(&exact).map(|(a, b)| (a - b).powi(2)).sum();
    (e / s.max(u)).sqrt()
}

/// A kernel that leaves pairs at the same position out.
pub(crate) fn plain<F: Fn(DVec3, DVec3) -> f64 + Send + Sync>(f: F) -> FnKernel<F, DVec3, f64> {
    from_fn(f).skip_coincident()
}

#[test]
fn hard_kernels_are_summed() {
    let formulas: &[(&str, Formula)] = &[
        ("cut off", |x, y| if x.distance(y) < 0.4 { 1.0 / x.distance(y) } else { 0.0 }),
        ("jump", |x, y| (if x.distance(y) < 0.37 { 1.1 } else { 1.0 }) / x.distance(y)),
        ("kink", |x, y| (x.x - y.x).abs()),
        ("step", |x, y| f64::from(x.x > y.x)),
        ("narrow", |x, y| (-x.distance_squared(y) / (2.0 * 0.0055f64.powi(2))).exp()),
        ("growing", |x, y| (40.0 * x.distance(y)).cosh()),
        ("flat", |x, y| {
            let d = x - y;
            1.0 / (d.x * d.x + 100.0 * d.y * d.y + 1e4 * d.z * d.z).sqrt()
        }),
        ("steep", |x, y| x.distance_squared(y).powi(-6)),
        // Of positions, and no number for some that don't occur.
        ("root", |x, y| (x.z * y.z).sqrt() / x.distance(y)),
        ("half space", |x, y| {
            1.0 / x.distance(y) - 1.0 / x.distance(DVec3::new(y.x, y.y, -0.1 - y.z))
        }),
        ("medium", |x, y| (2.0 + (9.0 * x.x).sin() + (8.0 * y.z).cos()) / x.distance(y)),
    ];
    let (points, qs) = (cube(1500, 1), charges(1500, 2));
    for (k, &(name, formula)) in formulas.iter().enumerate() {
        let tolerance = [1e-3, 1e-5][k % 2];
        let start = || Fmm::builder(plain(formula)).tolerance(tolerance);
        // Where an expansion is asked for, much is tried: every third kernel is enough.
        let asked = (k % 3 == 0).then(|| start().scheme(Scheme::Fmm).leaf_size(30));
        for builder in [Some(start()), asked].into_iter().flatten() {
            let fmm = builder.build(&points, &points);
            let fmm = fmm.unwrap_or_else(|e| panic!("{name}: {e}"));
            let error = error(formula, &points, &qs, &fmm.apply(&qs).unwrap());
            assert!(error <= tolerance, "{name}, {:?}: {error:e}", fmm.report().stats);
        }
    }
}

#[test]
fn a_kernel_is_not_asked_beyond_the_points() {
    // A table that ends where distances do.
    let points = cube(1500, 3);
    let extent = points.iter().fold(DVec3::ZERO, |a, p| a.max(p.abs())).max_element();
    let table: Vec<f64> = (0..2000).map(|i| (-f64::from(i) / 500.0).exp()).collect();
    // Roots are up to an eighth larger than the points.
    let step = 1.125 * extent * 3f64.sqrt() / 1998.0;
    let kernel = plain(move |x: DVec3, y: DVec3| {
        let at = x.distance(y) / step;
        let (low, part) = (at as usize, at.fract());
        table[low] * (1.0 - part) + table[low + 1] * part
    });
    let qs = charges(1500, 4);
    let fmm = Fmm::builder(&kernel).tolerance(1e-3).leaf_size(30).build(&points, &points).unwrap();
    let exact = direct(&kernel, &points, &qs, &points).unwrap();
    assert!(farfield::relative_l2_error(&fmm.apply(&qs).unwrap(), &exact) <= 1e-3);
}

#[test]
fn operators_serve_only_the_kernel_that_they_were_built_from() {
    let bump = |amplitude: f64| {
        plain(move |x: DVec3, y: DVec3| {
            let r = x.distance(y);
            let t = (x - y).distance(DVec3::new(0.31, 0.3, -0.2)) / 0.03;
            1.0 / (1.0 + r) + amplitude * (1.0 - t * t).max(0.0).powi(4)
        })
    };
    let (points, qs) = (cube(2000, 5), charges(2000, 6));
    for amplitude in [0.0, 1e4, 0.0] {
        let kernel = bump(amplitude);
        let fmm = Fmm::builder(kernel).tolerance(1e-3).leaf_size(40).build(&points, &points);
        let sums = fmm.unwrap().apply(&qs).unwrap();
        let exact = direct(&bump(amplitude), &points, &qs, &points).unwrap();
        let error = farfield::relative_l2_error(&sums, &exact);
        assert!(error <= 1e-3, "amplitude {amplitude}: {error:e}");
    }
}

#[test]
fn a_kernel_that_works_in_parallel_can_be_planned_from_all_threads() {
    struct Parallel(AtomicUsize);
    impl Kernel for Parallel {
        type Real = f64;
        type Source = DVec3;
        type Target = DVec3;
        type Charge = f64;
        type Value = f64;
        type Entry = f64;

        fn entries(&self, x: DVec3, y: DVec3, g: &mut [f64]) {
            g[0] = (-x.distance(y)).exp();
        }

        fn add_block(&self, xs: &[DVec3], ys: &[DVec3], qs: &[f64], _: f64, us: &mut [f64]) {
            self.0.fetch_add(1, Relaxed);
            let half = xs.len() / 2;
            let (left, right) = us.split_at_mut(half);
            let sum = |xs: &[DVec3], us: &mut [f64]| {
                for (x, u) in xs.iter().zip(us) {
                    *u += ys.iter().zip(qs).map(|(y, q)| (-x.distance(*y)).exp() * q).sum::<f64>();
                }
            };
            rayon::join(|| sum(&xs[..half], left), || sum(&xs[half..], right));
        }
    }
    let (points, qs) = (cube(1000, 7), charges(1000, 8));
    let sums = |_: usize| {
        let kernel = Parallel(AtomicUsize::new(0));
        let fmm = Fmm::builder(kernel).tolerance(1e-2).build(&points, &points).unwrap();
        fmm.apply(&qs).unwrap()
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(8).build().unwrap();
    let all: Vec<Vec<f64>> = pool.install(|| {
        use rayon::prelude::*;
        (0..16).into_par_iter().map(sums).collect()
    });
    assert!(all.iter().all(|sums| *sums == all[0]));
}

#[test]
fn kernels_of_positions_are_not_applied_where_direct_sums_are_faster() {
    let points = cube(1500, 28);
    let qs = charges(1500, 29);
    let formula: Formula = |x, y| (1.0 + x.x.sin()) / (0.01 + x.distance(y));
    let fmm = Fmm::builder(plain(formula)).tolerance(1e-3).scheme(Scheme::Fmm).leaf_size(30);
    let fmm = fmm.build(&points, &points).unwrap();
    let stats = fmm.report().stats;
    assert_eq!(stats.scheme, Scheme::Direct);
    assert!(stats.fallback.is_some_and(|reason| reason.contains("seconds")));
    let error = error(formula, &points, &qs, &fmm.apply(&qs).unwrap());
    assert!(error <= 1e-12, "{error:e}");
}

/// K(r) and K′(r).
type Radial = fn(f64) -> [f64; 2];

#[test]
fn values_and_gradients_keep_the_tolerance_each_by_itself() {
    let radials: &[(&str, Radial)] = &[
        ("1/r", |r| [1.0 / r, -1.0 / (r * r)]),
        ("yukawa", |r| [(-2.0 * r).exp() / r, -(-2.0 * r).exp() / r * (2.0 + 1.0 / r)]),
        ("gauss", |r| [(-r * r / 0.18).exp(), -(-r * r / 0.18).exp() * r / 0.09]),
        ("log", |r| [r.ln(), 1.0 / r]),
        ("1/r^4", |r| [r.powi(-4), -4.0 * r.powi(-5)]),
        ("root", |r| [(r * r + 0.01).sqrt(), r / (r * r + 0.01).sqrt()]),
    ];
    const N: usize = 2000;
    let apart: Vec<DVec3> = cube(N, 9).into_iter().map(|p| p + DVec3::X * 1.5).collect();
    let clouds = [
        ("apart", cube(N, 10), apart),
        ("sphere", sphere(N, 11), sphere(N, 11)),
        ("helix", helix(N, 12), helix(N, 12)),
    ];
    let qs = charges(N, 13);
    for &(name, radial) in radials {
        for (cloud, ys, xs) in &clouds {
            // Two kernels with many digits, the others with a few.
            let many = ["1/r", "gauss"].contains(&name);
            let tolerances: &[f64] = if many { &[1e-3, 1e-6] } else { &[1e-3] };
            let kernel = plain(move |x: DVec3, y: DVec3| radial(x.distance(y))[0]).gradient(
                move |x: DVec3, y: DVec3| (x - y) * (radial(x.distance(y))[1] / x.distance(y)),
            );
            let exact = direct(&kernel, ys, &qs, xs).unwrap();
            for &tolerance in tolerances {
                let fmm = Fmm::builder(kernel).tolerance(tolerance).leaf_size(30).build(ys, xs);
                let sums = fmm.unwrap().apply(&qs).unwrap();
                let mut s = [0.0f64; 2];
                for (x, y, q) in
                    xs.iter().flat_map(|x| ys.iter().zip(&qs).map(move |p| (x, p.0, p.1)))
                {
                    if x != y {
                        let k = radial(x.distance(*y));
                        s = [0, 1].map(|i| s[i] + (k[i] * q).powi(2));
                    }
                }
                let squares = |u: &farfield::WithGradient<f64>| {
                    [u.value.powi(2), u.gradient.iter().map(|g| g * g).sum()]
                };
                let (mut e, mut u) = ([0.0f64; 2], [0.0f64; 2]);
                for (sum, exact) in sums.iter().zip(&exact) {
                    let mut difference = *sum;
                    farfield::Numbers::subtract(&mut difference, exact);
                    let [de, du] = [squares(&difference), squares(exact)];
                    e = [0, 1].map(|i| e[i] + de[i]);
                    u = [0, 1].map(|i| u[i] + du[i]);
                }
                let errors = [0, 1].map(|i| (e[i] / s[i].max(u[i])).sqrt());
                assert!(
                    errors.iter().all(|&e| e <= tolerance),
                    "{name}, {cloud}, {tolerance:e}: values and gradients {errors:?}"
                );
            }
        }
    }
}
