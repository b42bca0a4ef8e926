//! Fast sums of texts against direct ones, and the laws of kernels.

use farfield::conformance::{Samples, check_kernel};
use farfield::glam::{DVec3, Vec3};
use farfield::{Fmm, Kernel, Numbers, direct, relative_l2_error};
use farfield_formula::{Coincident, TextFormula};
use farfield_testing::clouds::Random;

const TOLERANCE: f64 = 1e-6;

fn points(n: usize) -> Vec<DVec3> {
    let mut random = Random::new(1);
    (0..n).map(|_| random.in_cube()).collect()
}

/// Holds a fast sum against direct sums, part by part of a value; the far field has to be used.
fn check<K>(name: &str, kernel: &K, points: &[K::Source], charges: &[K::Charge], parts: &[usize])
where
    K: Kernel<Target = <K as Kernel>::Source>,
{
    let fmm =
        Fmm::builder(kernel).tolerance(TOLERANCE).applications(1000).build(points, points).unwrap();
    assert!(fmm.report().stats.expansion_pairs > 0, "{name}: {:?}", fmm.report().stats);
    let targets: Vec<_> = points.iter().step_by(17).cloned().collect();
    let exact = direct(kernel, points, charges, &targets).unwrap();
    let values = fmm.apply(charges).unwrap();
    let mut start = 0;
    for &len in parts {
        let part = |values: &[K::Value], step: usize| -> Vec<f64> {
            let numbers = values.iter().step_by(step).map(|u| u.to_f64s());
            numbers.flat_map(|u| u[start..start + len].to_vec()).collect()
        };
        let error = relative_l2_error(&part(&values, 17), &part(&exact, 1));
        assert!(error < TOLERANCE, "{name}, from {start}: {error:e}");
        start += len;
    }
}

fn formula(text: &str) -> TextFormula {
    TextFormula::new(text, &[]).unwrap()
}

#[test]
fn scalar_sums_and_gradients_keep_the_tolerance() {
    let points = points(10_000);
    let charges: Vec<f64> = (0..10_000).map(|j| 1.0 + f64::from(j).cos()).collect();
    for (text, rule) in [
        ("1/r", Coincident::Skip),
        ("exp(-4*r2)", Coincident::Formula),
        ("sqrt(1 + 4*r2)", Coincident::Value(1.0)),
    ] {
        let kernel = formula(text).coincident(rule).kernel::<DVec3, f64, f64>();
        check(text, &kernel, &points, &charges, &[1]);
    }
    let kernel = formula("1/r").kernel::<DVec3, f64, f64>().gradient::<[f64; 4]>();
    check("1/r, gradient", &kernel, &points, &charges, &[1, 3]);
}

#[test]
fn kernels_of_positions_keep_the_tolerance() {
    let points = points(10_000);
    let charges: Vec<f64> = (0..10_000).map(|j| f64::from(j).cos()).collect();
    let kernel = formula("(2 + x1*y2)/(1 + r2)").kernel::<DVec3, f64, f64>();
    let fmm = Fmm::builder(&kernel).tolerance(TOLERANCE).build(&points, &points).unwrap();
    let exact = direct(&kernel, &points, &charges, &points).unwrap();
    let error = relative_l2_error(&fmm.apply(&charges).unwrap(), &exact);
    assert!(error < TOLERANCE, "{error:e}");
}

#[test]
fn tensors_and_lists_keep_the_tolerance() {
    let points = points(10_000);
    let stokeslet = formula(
        "[[1/r + d1*d1/r^3, d1*d2/r^3, d1*d3/r^3], [d2*d1/r^3, 1/r + d2*d2/r^3, d2*d3/r^3], \
         [d3*d1/r^3, d3*d2/r^3, 1/r + d3*d3/r^3]]",
    );
    let charges: Vec<_> = (0..10_000).map(f64::from).map(|j| [j.cos(), j.sin(), 0.3]).collect();
    check("stokeslet", &stokeslet.kernel::<_, _, [f64; 3]>(), &points, &charges, &[3]);
    let lists: Vec<_> = charges.iter().map(|q| q.to_vec()).collect();
    let columns = formula("1/r").kernel::<DVec3, Vec<f64>, Vec<f64>>().with_columns(3);
    check("three columns", &columns, &points, &lists, &[1, 1, 1]);
    check("three columns, gradient", &columns.gradient::<Vec<f64>>(), &points, &lists, &[3, 9]);
}

#[test]
fn single_precision_keeps_what_it_can() {
    let points: Vec<Vec3> = points(10_000).iter().map(|p| p.as_vec3()).collect();
    let charges = vec![1.0f32; 10_000];
    let kernel = formula("exp(-r)/r").kernel::<Vec3, f32, f32>();
    let fmm =
        Fmm::builder(&kernel).tolerance(1e-4).applications(1000).build(&points, &points).unwrap();
    assert!(fmm.report().stats.expansion_pairs > 0);
    let exact = direct(&kernel, &points, &charges, &points).unwrap();
    let error = relative_l2_error(&fmm.apply(&charges).unwrap(), &exact);
    assert!(error < 1e-4, "{error:e}");
}

#[test]
fn parameters_make_another_kernel_of_one_text() {
    let points = points(10_000);
    let charges = vec![1.0; 10_000];
    for k in [1.0, 3.0] {
        let formula = TextFormula::new("exp(-k*r)", &[("k", k)]).unwrap();
        check("exp(-k r)", &formula.kernel::<_, f64, f64>(), &points, &charges, &[1]);
    }
}

#[test]
fn the_laws_of_kernels_hold() {
    let samples = Samples {
        source: |p: DVec3, _| p,
        target: |p: DVec3, _| p,
        charge: |i| f64::from(i as u32).cos(),
    };
    for text in ["1/r", "exp(-r)*d1", "x1*y2/r", "3", "sin(3*r)/r"] {
        let kernel = formula(text).kernel::<DVec3, f64, f64>();
        check_kernel(&kernel, &samples, 1e-12).unwrap_or_else(|e| panic!("{text}: {e}"));
        let kernel = kernel.gradient::<[f64; 4]>();
        check_kernel(&kernel, &samples, 1e-12).unwrap_or_else(|e| panic!("{text}: {e}"));
    }
    let samples = Samples {
        source: |p: DVec3, _| p,
        target: |p: DVec3, _| p,
        charge: |i| [1.0, f64::from(i as u32).cos()],
    };
    let kernel = formula("[[1/r, d1], [d2, 2], [r, r2]]").kernel::<DVec3, _, [f64; 3]>();
    check_kernel(&kernel, &samples, 1e-12).unwrap();
}
