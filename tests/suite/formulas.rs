//! Kernels given by their formula alone, to the tolerance asked for: nothing about them is declared.

use farfield::{Fmm, Scalar, direct, from_fn, relative_l2_error};
use farfield_radiosity::{Irradiance, Surfel};
use farfield_testing::clouds::{Random, cube, plummer, sphere};
use glam::{DVec3, Vec3};
use num_complex::Complex;

use crate::{plain, single};

const POINTS: usize = 2000;

/// The clouds, and how far apart their points are at most.
fn clouds() -> [(&'static str, Vec<DVec3>); 3] {
    [("cube", cube(POINTS, 1)), ("sphere", sphere(POINTS, 2)), ("Plummer", plummer(POINTS, 3))]
}

/// Sums over every cloud with charges of either sign; panics where the error exceeds the tolerance.
/// Function pointers, so that all real formulas are one type: the remembered operators must tell
/// them apart by their values.
fn meets<V>(name: &str, formula: fn(DVec3, DVec3) -> V, tolerance: f64)
where
    V: Scalar<Real = f64>,
{
    let kernel = from_fn(formula).skip_coincident();
    for (cloud, points) in &clouds() {
        let mut random = Random::new(9);
        let charges: Vec<V> =
            points.iter().map(|_| V::from_real(random.between(-0.5, 0.5))).collect();
        let plan = Fmm::builder(kernel).tolerance(tolerance).leaf_size(30);
        let fmm = plan.build(points, points).unwrap_or_else(|e| panic!("{name}, {cloud}: {e}"));
        assert!(fmm.report().stats.expansion_pairs > 0, "{name}, {cloud}: a far field to test");
        let values = fmm.apply(&charges).unwrap();
        let error = relative_l2_error(&values, &direct(&kernel, points, &charges, points).unwrap());
        let rank = fmm.report().stats.terms_per_cell;
        println!("{name}, {cloud}, {tolerance:e}: error {error:.1e}, rank {rank}");
        assert!(error <= tolerance, "{name}, {cloud}: error {error:e} > {tolerance:e}");
    }
}

fn distance(x: DVec3, y: DVec3) -> f64 {
    x.distance(y)
}

#[test]
fn homogeneous_formulas_meet_their_tolerances() {
    for tolerance in [1e-3, 1e-6, 1e-9] {
        meets("1/r", |x, y| distance(x, y).recip(), tolerance);
    }
    for tolerance in [1e-3, 1e-6] {
        meets("1/r⁴", |x, y| distance(x, y).powi(-4), tolerance);
        meets("r³", |x, y| distance(x, y).powi(3), tolerance);
    }
}

#[test]
fn formulas_with_a_scale_meet_their_tolerances() {
    for tolerance in [1e-3, 1e-6] {
        meets("Yukawa", |x, y| (-3.0 * distance(x, y)).exp() / distance(x, y), tolerance);
        meets("Gaussian", |x, y| (-2.0 * x.distance_squared(y)).exp(), tolerance);
        meets("log r", |x, y| distance(x, y).ln(), tolerance);
    }
}

#[test]
fn a_formula_without_reflection_symmetry_meets_its_tolerances() {
    let skew = |x: DVec3, y: DVec3| {
        let d = x - y;
        (d.length_squared() + 0.7 * d.x * d.y + 0.2 * d.y * d.z).sqrt().recip()
    };
    meets("anisotropic", skew, 1e-3);
    meets("anisotropic", skew, 1e-6);
}

#[test]
fn a_one_sided_formula_meets_its_tolerances() {
    // The field of a dipole along a fixed direction: odd, so that sources and targets differ.
    let dipole = |x: DVec3, y: DVec3| {
        let d = x - y;
        (d.x + 0.5 * d.z) / d.length_squared().powf(1.5)
    };
    meets("dipole", dipole, 1e-4);
    // One axis matters more on one side: neither symmetric nor odd.
    let drift = |x: DVec3, y: DVec3| (-(x - y).length_squared() + 0.5 * (x - y).x).exp();
    meets("drift", drift, 1e-4);
}

#[test]
fn waves_meet_their_tolerances() {
    // ka ≤ 3 for the half-width 10 of Plummer's root.
    let wave = |x: DVec3, y: DVec3| Complex::cis(0.3 * x.distance(y)) / x.distance(y);
    meets("exp(ikr)/r", wave, 1e-3);
    meets("exp(ikr)/r", wave, 1e-6);
}

#[test]
fn single_precision_meets_what_it_can() {
    let narrow = |p: &DVec3| Vec3::new(p.x as f32, p.y as f32, p.z as f32);
    let points: Vec<Vec3> = cube(POINTS, 4).iter().map(narrow).collect();
    let kernel = single(|x, y| x.distance(y).recip()).skip_coincident();
    let mut random = Random::new(5);
    let charges: Vec<f32> = points.iter().map(|_| random.between(-0.5, 0.5) as f32).collect();
    for tolerance in [1e-2, 1e-3, 1e-5] {
        let fmm = Fmm::builder(kernel).tolerance(tolerance).leaf_size(30);
        let values = fmm.build(&points, &points).unwrap().apply(&charges).unwrap();
        let error =
            relative_l2_error(&values, &direct(&kernel, &points, &charges, &points).unwrap());
        assert!(error <= tolerance, "error {error:e} > {tolerance:e}");
    }
    let unreachable = Fmm::builder(kernel).tolerance(1e-12).leaf_size(30).build(&points, &points);
    assert!(matches!(unreachable, Err(farfield::Error::UnreachableTolerance { .. })));
}

#[test]
fn the_radiosity_tensor_meets_its_tolerance_in_three_bands() {
    let surfels: Vec<Surfel> = sphere(POINTS, 6)
        .into_iter()
        .map(|p| Surfel {
            position: p,
            normal: -p,
            area: 4.0 * std::f64::consts::PI / POINTS as f64,
            face: Surfel::<f64>::NO_FACE,
        })
        .collect();
    let mut random = Random::new(7);
    let charges: Vec<[f64; 3]> =
        surfels.iter().map(|_| [(); 3].map(|()| random.between(0.0, 1.0))).collect();
    let kernel = Irradiance::<f64, [f64; 3]>::signed();
    for tolerance in [1e-3, 1e-5] {
        let fmm = Fmm::builder(kernel).tolerance(tolerance).leaf_size(30);
        let values = fmm.build(&surfels, &surfels).unwrap().apply(&charges).unwrap();
        let error =
            relative_l2_error(&values, &direct(&kernel, &surfels, &charges, &surfels).unwrap());
        assert!(error <= tolerance, "error {error:e} > {tolerance:e}");
    }
}

#[test]
fn parameters_of_one_type_are_told_apart() {
    let points = cube(2000, 8);
    let charges = vec![1.0; points.len()];
    for rate in [0.5, 4.0, 0.5] {
        let kernel = from_fn(move |x: DVec3, y: DVec3| (-rate * x.distance(y)).exp());
        let fmm = Fmm::builder(kernel).tolerance(1e-5).leaf_size(20);
        let values = fmm.build(&points, &points).unwrap().apply(&charges).unwrap();
        let exact = direct(&kernel, &points, &charges, &points).unwrap();
        assert!(relative_l2_error(&values, &exact) <= 1e-5);
    }
}

#[test]
fn reflections_and_offsets_are_each_right() {
    // One source cell and targets all around it, so that every offset and every sign takes part.
    let mut random = Random::new(10);
    let mut sources: Vec<DVec3> = (0..40).map(|_| DVec3::splat(4.0) + random.in_cube()).collect();
    sources.extend([DVec3::ZERO, DVec3::splat(8.0)]);
    let targets: Vec<DVec3> = (0..20_000).map(|_| random.in_cube() * 8.0).collect();
    let mut charges = vec![1.0; sources.len()];
    charges[40..].fill(0.0);
    let kernel = plain(|x, y| (x - y).x / x.distance_squared(y)).skip_coincident();
    let fmm = Fmm::builder(kernel).tolerance(1e-4).leaf_size(20).build(&sources, &targets).unwrap();
    let values = fmm.apply(&charges).unwrap();
    let exact = direct(&kernel, &sources, &charges, &targets).unwrap();
    for (i, (value, exact)) in values.iter().zip(&exact).enumerate() {
        let scale = 40.0 / targets[i].distance(DVec3::splat(4.5)).max(1.0);
        assert!((value - exact).abs() < 1e-3 * scale, "target {}: {value} {exact}", targets[i]);
    }
}
