//! Points so far apart, or so near each other, that r² overflows or vanishes: the sums are those of the same points at
//! an ordinary size, scaled, or a typed error.

use farfield::glam::{DVec3, Vec3};
use farfield::{Error, Fmm, Point, Real, Vector, WithGradient, direct, formula, relative_l2_error};
use farfield_formula::{
    Coincident, Derivatives, Options, Plan, Precision, Ready, TextFormula, direct_sums,
};
use farfield_testing::clouds::{Random, charges};

/// Text, degree of homogeneity, whether log s is added for a scale s.
const KERNELS: [(&str, i32, bool); 7] = [
    ("1/r", -1, false),
    ("r", 1, false),
    ("log(r)", 0, true),
    ("d1*d2/r^2", 0, false),
    ("r2^0.5 + d1^2*d2^2/r^3", 1, false),
    ("d3/r^2", -1, false),
    ("stokeslet", -1, false),
];

fn points(n: usize) -> Vec<Vec3> {
    let mut random = Random::new(5);
    let mut points: Vec<Vec3> = (0..n).map(|_| random.in_cube().as_vec3()).collect();
    points[1] = points[0];
    points
}

/// Twice a power of two, exact in every precision.
fn scaled<T: Real>(points: &[Vec3], exponent: i32) -> Vec<Point<T>> {
    let scale = |c: f32| T::from_f64(f64::from(c) * 2f64.powi(exponent));
    points.iter().map(|p| Point::<T>::from_array(p.to_array().map(scale))).collect()
}

fn error<T: Real>(found: &[T], exact: &[f64]) -> f64 {
    let found: Vec<f64> = found.iter().map(|x| x.as_f64()).collect();
    relative_l2_error(&found, exact)
}

/// Sums at an extreme size against those at an ordinary one, which double precision gives.
fn check<T: Precision>(exponents: &[i32], rounding: f64, tolerance: f64) {
    let cloud = points(150);
    for (text, degree, logarithmic) in KERNELS {
        let kernel = Ready::or_text(text, &[]).unwrap();
        let (rows, columns) = (kernel.rows(), kernel.columns());
        let charges = charges(cloud.len() * columns, 3);
        let own: Vec<T> = charges.iter().map(|&q| T::from_f64(q as f32 as f64)).collect();
        let charges: Vec<f64> = own.iter().map(|q| q.as_f64()).collect();
        let ordinary = scaled::<f64>(&cloud, 0);
        let exact =
            direct_sums(&kernel, &ordinary, &charges, &ordinary, Derivatives::Gradient).unwrap();
        let total: f64 = charges.iter().sum();
        for &exponent in exponents {
            let size = 2f64.powi(exponent);
            // A gradient has one degree less; what has no number in the precision is not asked for.
            let gradient = f64::from(degree - 1) * f64::from(exponent);
            let gradient = gradient.abs() < 0.8 * T::max_value().as_f64().log2();
            let derivatives = if gradient { Derivatives::Gradient } else { Derivatives::None };
            let parts = derivatives.parts();
            let (mut values, mut slopes) = (Vec::new(), Vec::new());
            for (i, all) in exact.chunks(4 * rows).enumerate() {
                // Each point is skipped in its own sum, and the first two in each other's.
                let others = total - charges[i] - if i < 2 { charges[1 - i] } else { 0.0 };
                let shift = if logarithmic { others * size.ln() } else { 0.0 };
                values.extend(all[..rows].iter().map(|u| u * size.powi(degree) + shift));
                slopes.extend(all[rows..].iter().map(|u| u * size.powi(degree - 1)));
            }
            let places = scaled::<T>(&cloud, exponent);
            let held = |found: &[T], bound: f64, what: &str| {
                let pick = |range: std::ops::Range<usize>| -> Vec<T> {
                    found.chunks(parts * rows).flat_map(|u| u[range.clone()].to_vec()).collect()
                };
                let off = error(&pick(0..rows), &values);
                assert!(off < bound, "{text} {what} at 2^{exponent}: {off:e}");
                if gradient {
                    let off = error(&pick(rows..4 * rows), &slopes);
                    assert!(off < bound, "gradient of {text} {what} at 2^{exponent}: {off:e}");
                }
            };
            let sums = direct_sums(&kernel, &places, &own, &places, derivatives).unwrap();
            held(&sums, rounding, "directly");
            let mut options = Options::default();
            (options.tolerance, options.derivatives, options.applications) =
                (tolerance, derivatives, 100);
            let plan = Plan::new(&kernel, &places, &places, &options).unwrap();
            held(&plan.apply(&own).unwrap(), 3.0 * tolerance, "by a plan");
        }
    }
}

#[test]
fn sums_in_single_precision_are_right_at_both_ends() {
    check::<f32>(&[75, -75, 42, -42], 1e-5, 1e-3);
}

#[test]
fn sums_in_double_precision_are_right_at_both_ends() {
    check::<f64>(&[600, -600, 345, -345], 1e-12, 1e-6);
}

#[test]
fn far_fields_are_used_at_extreme_extents() {
    let cloud = points(10_000);
    let kernel = Ready::or_text("exp(-r*k)/r", &[("k", 2f64.powi(-75))]).unwrap();
    let places = scaled::<f32>(&cloud, 75);
    let mut options = Options::default();
    options.tolerance = 1e-3;
    let plan = Plan::new(&kernel, &places, &places, &options).unwrap();
    assert!(plan.report().stats.expansion_pairs > 0, "{}", plan.report());
    let charges = vec![1.0f32; cloud.len()];
    let found = plan.apply(&charges).unwrap();
    let ordinary = Ready::or_text("exp(-r)/r", &[]).unwrap();
    let (all, some) = (scaled::<f64>(&cloud, 0), scaled::<f64>(&cloud[..200], 0));
    let exact =
        direct_sums(&ordinary, &all, &vec![1.0; all.len()], &some, Derivatives::None).unwrap();
    let exact: Vec<f64> = exact.iter().map(|u| u * 2f64.powi(-75)).collect();
    let off = error(&found[..200], &exact);
    assert!(off < 1e-3, "{off:e}");
}

#[test]
fn formulas_written_in_rust_are_right_at_both_ends() {
    let newton = formula!(|d| d.length().recip()).skip_coincident().gradient();
    let pair = |x: DVec3| direct(&newton, &[DVec3::ZERO], &[1.0], &[x]).unwrap()[0];
    for r in [1e-150, 1e-100, 1e100, 1e150] {
        let WithGradient { value, gradient } = pair(DVec3::new(0.6, 0.0, -0.8) * r);
        assert!((value * r - 1.0).abs() < 1e-14, "{r:e}: {value:e}");
        assert!((gradient[2] * r * r - 0.8).abs() < 1e-14, "{r:e}: {gradient:?}");
    }
    let cloud = points(500);
    let charges: Vec<f32> = charges(cloud.len(), 3).iter().map(|&q| q as f32).collect();
    let spline = formula!(|d| d.length()).skip_coincident();
    let exact = direct(&spline, &cloud, &charges, &cloud).unwrap();
    for exponent in [75, -75] {
        let size = 2f32.powi(exponent);
        let places = scaled::<f32>(&cloud, exponent);
        let exact: Vec<f32> = exact.iter().map(|u| u * size).collect();
        let sums = direct(&spline, &places, &charges, &places).unwrap();
        assert!(relative_l2_error(&sums, &exact) < 1e-6);
        let plan = Fmm::builder(&spline).tolerance(1e-3).applications(100);
        let plan = plan.build(&places, &places).unwrap();
        assert!(relative_l2_error(&plan.apply(&charges).unwrap(), &exact) < 1e-3);
    }
}

#[test]
fn parameters_of_any_size_are_right() {
    for (text, c, r) in [
        ("1/sqrt(r2 + c^2)", 1e200, 1e200),
        ("exp(-r2/c^2)", 1e-200, 1e-200),
        ("1/sqrt(r2 + c^2)", 1e-30, 1e-30),
    ] {
        let kernel = TextFormula::new(text, &[("c", c)]).unwrap();
        let exact = if text.starts_with('e') { (-1.0f64).exp() } else { 0.5f64.sqrt() / c };
        if r > 1e-35 && r < 1e35 {
            let x = [Vec3::new(0.0, r as f32, 0.0)];
            let u =
                direct_sums(&kernel, &[Vec3::ZERO], &[1.0f32], &x, Derivatives::None).unwrap()[0];
            assert!((f64::from(u) / exact - 1.0).abs() < 1e-6, "{text}: {u:e}");
        }
        let x = [DVec3::new(0.0, r, 0.0)];
        let u = direct_sums(&kernel, &[DVec3::ZERO], &[1.0], &x, Derivatives::None).unwrap()[0];
        assert!((u / exact - 1.0).abs() < 1e-14, "{text}: {u:e}");
    }
}

#[test]
fn what_has_no_digits_in_its_precision_is_refused() {
    let cloud = points(300);
    let refused = |found: Result<(), Error>, name: &str| match found {
        Err(Error::KernelOutOfRange { extent, precision }) => {
            assert!(extent > 1e15 && precision == name, "{extent:e} {precision}");
        }
        other => panic!("{other:?}"),
    };
    let kernel = TextFormula::new("1/r2^2", &[]).unwrap().coincident(Coincident::Skip);
    let options = Options::default();
    let places = scaled::<f32>(&cloud, 60);
    refused(Plan::<f32>::new(&kernel, &places, &places, &options).map(drop), "f32");
    refused(
        direct_sums::<f32>(&kernel, &places, &[1.0; 300], &places, Derivatives::None).map(drop),
        "f32",
    );
    let places = scaled::<f64>(&cloud, 400);
    refused(Plan::<f64>::new(&kernel, &places, &places, &options).map(drop), "f64");
    refused(
        direct_sums::<f64>(&kernel, &places, &[1.0; 300], &places, Derivatives::None).map(drop),
        "f64",
    );
    let written = formula!(|d| (d.length_squared() * d.length_squared()).recip()).skip_coincident();
    refused(direct(&written, &places, &[1.0; 300], &places).map(drop), "f64");
    // Kernels that are zero between most points are not lost there.
    let compact = TextFormula::new("where(r < 1, 1, 0)", &[]).unwrap();
    assert_eq!(
        direct_sums(&compact, &places, &[1.0; 300], &places, Derivatives::None).unwrap(),
        [0.0; 300]
    );
}
