//! What must hold for all clouds, charges, kernels and trees. A case is a seed and a few sizes, so that
//! what is printed when one fails is all that it takes to see it again.
//!
//! `PROPTEST_CASES=10000 cargo test --test stability properties` looks longer.

use farfield::{Fmm, direct, relative_l2_error};
use farfield_potentials::{HarmonicExpansion, InverseDistance};
use farfield_testing::clouds::Random;
use glam::{DQuat, DVec3};
use proptest::prelude::*;
use proptest::test_runner::{FileFailurePersistence, TestError, TestRunner};

use crate::table::row;
use crate::{Formula, plain};

/// As many cases as the environment asks for, or `few`.
fn cases(few: u32) -> ProptestConfig {
    match std::env::var_os("PROPTEST_CASES") {
        Some(_) => ProptestConfig::default(),
        None => ProptestConfig::with_cases(few),
    }
}

/// Sources and targets in [−1, 1]³, which the first two sources span.
#[derive(Clone, Copy, Debug)]
struct Case {
    seed: u64,
    sources: usize,
    targets: usize,
    shape: usize,
    leaf_size: usize,
}

impl Case {
    /// Sources, charges, targets, and weights of the targets.
    fn points(&self) -> (Vec<DVec3>, Vec<f64>, Vec<DVec3>, Vec<f64>) {
        let mut random = Random::new(self.seed);
        let mut cloud =
            |n: usize| -> Vec<DVec3> { (0..n).map(|_| self.point(&mut random)).collect() };
        let (mut sources, targets) = (vec![-DVec3::ONE, DVec3::ONE], cloud(self.targets));
        sources.extend(cloud(self.sources));
        let mut charge = |_| random.between(-1.0, 1.0);
        let mut charges: Vec<f64> = (0..sources.len()).map(&mut charge).collect();
        charges[..2].fill(0.0);
        let weights = (0..targets.len()).map(&mut charge).collect();
        (sources, charges, targets, weights)
    }

    fn point(&self, random: &mut Random) -> DVec3 {
        let p = random.in_cube() * 2.0 - DVec3::ONE;
        match self.shape {
            0 => p,
            1 => random.direction(),
            2 => p * p.abs(),
            3 => DVec3::new(0.9, -0.5, 0.2) * p.x,
            4 => p.with_z(0.25),
            5 => (p * 4.0).round() / 4.0,
            _ => p.signum() * 0.7 + p * 0.02,
        }
    }
}

fn case() -> impl Strategy<Value = Case> {
    (any::<u64>(), 0..200usize, 1..200usize, 0..7usize, 1..30usize).prop_map(
        |(seed, sources, targets, shape, leaf_size)| Case {
            seed,
            sources,
            targets,
            shape,
            leaf_size,
        },
    )
}

/// A kernel by an expansion.
#[derive(Clone, Copy)]
struct Method {
    name: &'static str,
    formula: Formula,
    transposed: Formula,
    harmonic: bool,
    /// What truncation, and what rounding may cost, relative to Σ |K| |q|.
    tolerance: f64,
    rounding: f64,
}

impl std::fmt::Debug for Method {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name)
    }
}

fn inverse(x: DVec3, y: DVec3) -> f64 {
    1.0 / x.distance(y)
}

fn bell(x: DVec3, y: DVec3) -> f64 {
    (-0.25 * x.distance_squared(y)).exp()
}

fn dipole(x: DVec3, y: DVec3) -> f64 {
    let d = x - y;
    (d.x + 0.5 * d.z) / d.length_squared().powf(1.5)
}

fn drift(x: DVec3, y: DVec3) -> f64 {
    (-0.2 * x.distance_squared(y) + 0.5 * (x - y).x).exp()
}

fn varying(x: DVec3, y: DVec3) -> f64 {
    (1.0 + x.x * x.x + 0.3 * y.z) / (1.0 + x.distance(y))
}

const HARMONIC: Method = Method {
    name: "1/r in harmonics",
    formula: inverse,
    transposed: inverse,
    harmonic: true,
    tolerance: 3e-4,
    rounding: 1e-12,
};
/// With 4 nodes per axis, M2L in single precision.
const INTERPOLATED: Method = Method {
    name: "1/r, interpolated",
    harmonic: false,
    tolerance: 3e-2,
    rounding: 1e-5,
    ..HARMONIC
};
const BELL: Method = Method { name: "bell", formula: bell, transposed: bell, ..INTERPOLATED };
const DIPOLE: Method =
    Method { name: "dipole", formula: dipole, transposed: |x, y| dipole(y, x), ..INTERPOLATED };
const DRIFT: Method =
    Method { name: "drift", formula: drift, transposed: |x, y| drift(y, x), ..INTERPOLATED };
const VARYING: Method =
    Method { name: "varying", formula: varying, transposed: |x, y| varying(y, x), ..INTERPOLATED };

fn any_method() -> impl Strategy<Value = Method> {
    prop_oneof![
        8 => Just(HARMONIC), 8 => Just(INTERPOLATED), 1 => Just(BELL),
        3 => Just(DIPOLE), 1 => Just(DRIFT), 3 => Just(VARYING),
    ]
}

/// Those whose kernel has no scale and no place.
fn inverse_distance() -> impl Strategy<Value = Method> {
    prop_oneof![Just(HARMONIC), Just(INTERPOLATED)]
}

impl Method {
    fn sum(&self, leaf_size: usize, ys: &[DVec3], qs: &[f64], xs: &[DVec3]) -> Vec<f64> {
        let values = if self.harmonic {
            let expansion = HarmonicExpansion::new(InverseDistance::<f64>::new(), 8).unwrap();
            Fmm::with_expansion(expansion).leaf_size(leaf_size).build(ys, xs).unwrap().apply(qs)
        } else {
            let builder = Fmm::builder(plain(self.formula)).order(4).leaf_size(leaf_size);
            builder.build(ys, xs).unwrap().apply(qs)
        };
        values.unwrap()
    }

    /// ‖a − b‖ relative to ‖Σ |K| |q|‖.
    fn difference(&self, ys: &[DVec3], qs: &[f64], xs: &[DVec3], a: &[f64], b: &[f64]) -> f64 {
        let magnitudes: Vec<f64> = qs.iter().map(|q| q.abs()).collect();
        let absolute = direct(&plain(self.formula), ys, &magnitudes, xs).unwrap();
        let norm = relative_l2_error(&absolute, &vec![0.0; xs.len()]);
        let difference: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
        let difference = relative_l2_error(&difference, &vec![0.0; xs.len()]);
        if difference == 0.0 { 0.0 } else { difference / norm }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// `order` is a permutation: the things in it, in that order.
fn permuted<V: Copy>(things: &[V], order: &[usize]) -> Vec<V> {
    order.iter().map(|&i| things[i]).collect()
}

fn shuffled(n: usize, seed: u64) -> Vec<usize> {
    let mut random = Random::new(seed);
    let mut order: Vec<usize> = (0..n).collect();
    for i in (1..n).rev() {
        order.swap(i, random.below(i + 1));
    }
    order
}

proptest! {
    #![proptest_config(cases(40))]

    #[test]
    fn sums_are_direct_sums(case in case(), method in any_method()) {
        let (ys, qs, xs, _) = case.points();
        // Of one sign: errors that charges of both would cancel show.
        let qs: Vec<f64> = qs.iter().map(|q| q.abs()).collect();
        let exact = direct(&plain(method.formula), &ys, &qs, &xs).unwrap();
        let values = method.sum(case.leaf_size, &ys, &qs, &xs);
        let error = method.difference(&ys, &qs, &xs, &values, &exact);
        prop_assert!(error <= method.tolerance, "{error:e}");
    }

    #[test]
    fn sums_are_linear(case in case(), method in any_method(), [a, b] in [-3.0..3.0f64, -3.0..3.0]) {
        let (ys, qs, xs, _) = case.points();
        let ps: Vec<f64> = qs.iter().rev().map(|q| q * q).collect();
        let mixed: Vec<f64> = qs.iter().zip(&ps).map(|(q, p)| a * q + b * p).collect();
        let [of_q, of_p, of_mixed] =
            [&qs, &ps, &mixed].map(|qs| method.sum(case.leaf_size, &ys, qs, &xs));
        let expected: Vec<f64> = of_q.iter().zip(&of_p).map(|(q, p)| a * q + b * p).collect();
        let sizes: Vec<f64> = qs.iter().zip(&ps).map(|(q, p)| (a * q).abs() + (b * p).abs()).collect();
        let error = method.difference(&ys, &sizes, &xs, &of_mixed, &expected);
        prop_assert!(error <= method.rounding, "{error:e}");
    }

    #[test]
    fn sums_over_parts_add_up(case in case(), method in any_method(), share in 0.0..1.0f64) {
        let (ys, qs, xs, _) = case.points();
        let cut = (share * ys.len() as f64) as usize;
        let whole = method.sum(case.leaf_size, &ys, &qs, &xs);
        let mut parts = method.sum(case.leaf_size, &ys[..cut], &qs[..cut], &xs);
        let rest = method.sum(case.leaf_size, &ys[cut..], &qs[cut..], &xs);
        parts.iter_mut().zip(rest).for_each(|(part, rest)| *part += rest);
        let error = method.difference(&ys, &qs, &xs, &whole, &parts);
        prop_assert!(error <= 2.0 * method.tolerance, "{error:e}");
    }

    #[test]
    fn the_order_of_points_does_not_matter(case in case(), method in any_method()) {
        let (ys, qs, xs, _) = case.points();
        let [at_y, at_x] = [shuffled(ys.len(), case.seed), shuffled(xs.len(), !case.seed)];
        let values = method.sum(case.leaf_size, &ys, &qs, &xs);
        let [ys, xs] = [permuted(&ys, &at_y), permuted(&xs, &at_x)];
        let qs = permuted(&qs, &at_y);
        let found = method.sum(case.leaf_size, &ys, &qs, &xs);
        let error = method.difference(&ys, &qs, &xs, &found, &permuted(&values, &at_x));
        prop_assert!(error <= method.rounding, "{error:e}");
    }

    #[test]
    fn moving_turning_and_scaling_all_points_does_not_matter(
        case in case(),
        method in inverse_distance(),
        [shift, axis] in [any::<u64>(), any::<u64>()],
        angle in 0.0..6.3f64,
        scale in -40..40i32,
        stretch in 1.0..2.0f64,
    ) {
        let (ys, qs, xs, _) = case.points();
        let shift = Random::new(shift).direction() * 10.0;
        let turn = DQuat::from_axis_angle(Random::new(axis).direction(), angle);
        let scale = stretch * f64::from(scale).exp2();
        let values = method.sum(case.leaf_size, &ys, &qs, &xs);
        let motions: [(&dyn Fn(DVec3) -> DVec3, f64); 3] =
            [(&|p| p + shift, 1.0), (&|p| turn * p, 1.0), (&|p| p * scale, scale)];
        for (motion, unit) in motions {
            let [ys, xs] = [&ys, &xs].map(|points| points.iter().map(|p| motion(*p)).collect::<Vec<_>>());
            let mut found = method.sum(case.leaf_size, &ys, &qs, &xs);
            found.iter_mut().for_each(|u| *u *= unit);
            let units: Vec<f64> = qs.iter().map(|q| q * unit).collect();
            let error = method.difference(&ys, &units, &xs, &found, &values);
            // Twins that were skipped stay twins; near ones may round to twins.
            prop_assert!(error <= 2.0 * method.tolerance, "{error:e}");
        }
    }

    #[test]
    fn scaling_by_powers_of_two_changes_no_digit(
        case in case(), method in inverse_distance(), scale in -300..300i32,
    ) {
        let (ys, qs, xs, _) = case.points();
        let scale = f64::from(scale).exp2();
        let values = method.sum(case.leaf_size, &ys, &qs, &xs);
        let [ys, xs] = [&ys, &xs].map(|points| points.iter().map(|p| *p * scale).collect::<Vec<_>>());
        let charges: Vec<f64> = qs.iter().map(|q| q * scale).collect();
        let found = method.sum(case.leaf_size, &ys, &charges, &xs);
        let error = method.difference(&ys, &charges, &xs, &found, &values);
        prop_assert!(error <= 1e-14, "{error:e}");
    }

    #[test]
    fn transposed_sums_are_adjoint(case in case(), method in any_method()) {
        let (ys, qs, xs, ws) = case.points();
        let transposed = Method { formula: method.transposed, transposed: method.formula, ..method };
        let forth = dot(&ws, &method.sum(case.leaf_size, &ys, &qs, &xs));
        let back = dot(&transposed.sum(case.leaf_size, &xs, &ws, &ys), &qs);
        let norm = |a: &[f64]| dot(a, a).sqrt();
        let magnitudes: Vec<f64> = qs.iter().map(|q| q.abs()).collect();
        let there = norm(&ws) * norm(&direct(&plain(method.formula), &ys, &magnitudes, &xs).unwrap());
        let magnitudes: Vec<f64> = ws.iter().map(|w| w.abs()).collect();
        let here = norm(&qs) * norm(&direct(&plain(transposed.formula), &xs, &magnitudes, &ys).unwrap());
        let error = (forth - back).abs();
        // Signed kernels are larger in absolute terms than their sums of magnitudes.
        let signed = if method.name == "dipole" { 3.0 } else { 1.0 };
        prop_assert!(error <= signed * method.tolerance * (there + here.abs()), "{error:e}");
    }

    #[test]
    fn charges_may_be_split_and_zeros_added(
        case in case(), method in any_method(), share in -2.0..2.0f64, zeros in 0..50usize,
    ) {
        let (mut ys, mut qs, xs, _) = case.points();
        let values = method.sum(case.leaf_size, &ys, &qs, &xs);
        let (at, charges) = (ys.clone(), qs.clone());
        for (y, q) in at.iter().zip(&charges).step_by(3) {
            ys.push(*y);
            qs.push(share * q);
        }
        qs.iter_mut().take(at.len()).step_by(3).for_each(|q| *q *= 1.0 - share);
        let mut random = Random::new(!case.seed);
        ys.extend((0..zeros).map(|_| random.in_cube()));
        qs.resize(ys.len(), 0.0);
        let found = method.sum(case.leaf_size, &ys, &qs, &xs);
        let error = method.difference(&ys, &qs, &xs, &found, &values);
        prop_assert!(error <= 2.0 * method.tolerance, "{error:e}");
    }
}

#[test]
fn what_fails_is_shrunk_and_replayed() {
    let directory = tempfile::tempdir().unwrap();
    let seeds = directory.path().join("seeds").to_string_lossy().into_owned();
    let seeds: &'static str = Box::leak(seeds.into_boxed_str());
    let run = || {
        let config = ProptestConfig {
            cases: 2000,
            source_file: Some(file!()),
            failure_persistence: Some(Box::new(FileFailurePersistence::Direct(seeds))),
            ..ProptestConfig::default()
        };
        let tried = std::cell::RefCell::new(Vec::new());
        let failure = TestRunner::new(config).run(&case(), |case| {
            tried.borrow_mut().push(case.sources);
            prop_assert!(case.sources < 150);
            Ok(())
        });
        let Err(TestError::Fail(_, smallest)) = failure else { panic!("{failure:?}") };
        (tried.into_inner(), smallest)
    };
    let ((_, smallest), (again, same)) = (run(), run());
    assert_eq!((smallest.sources, smallest.targets), (150, 1), "as small as it gets");
    assert!(again[0] >= 150, "what failed comes first");
    assert_eq!(format!("{smallest:?}"), format!("{same:?}"));
    row(
        "Linearity, superposition, permutation, motion, scaling, adjointness, splitting, zeros",
        "what one example does not show",
        "examples only",
        "8 properties of 6 kernels by 2 expansions; a failure prints a seed that replays",
    );
}
