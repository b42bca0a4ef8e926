//! Kernels that are singular, steep, of many scales, oscillatory, discontinuous, or not numbers.

use farfield::{Error, Fmm, direct, from_fn, relative_l2_error};
use farfield_potentials::harmonic::{Harmonic, Scratch};
use farfield_testing::clouds::{self, Random, charges};
use glam::DVec3;
use num_complex::Complex;

use crate::table::row;
use crate::{Formula, build, error, inverse, plain};

#[test]
fn cells_that_touch_are_never_expanded() {
    // Cells one and two cells apart, by orders.
    let error = |order, cells: f64| {
        let harmonic = Harmonic::<f64>::new(0.5, order).unwrap();
        let mut scratch = Scratch::new(&harmonic);
        let [mut functions, mut m, mut l] = [(); 3].map(|()| vec![0.0; harmonic.len()]);
        let mut random = Random::new(1);
        let mut points = || (0..50).map(|_| random.in_cube() * 2.0 - DVec3::ONE).collect();
        let [ys, xs]: [Vec<DVec3>; 2] = [points(), points()];
        let shift = DVec3::X * (2.0 * cells);
        for y in &ys {
            harmonic.regular(*y, &mut functions);
            m.iter_mut().zip(&functions).for_each(|(m, f)| *m += f);
        }
        harmonic.m2l(shift, &m, &mut l, &mut scratch);
        let mut field = |x: &DVec3| {
            harmonic.regular(*x, &mut functions);
            l.iter().zip(&functions).map(|(l, f)| l * f).sum::<f64>()
        };
        let values: Vec<f64> = xs.iter().map(&mut field).collect();
        let xs: Vec<DVec3> = xs.iter().map(|x| *x + shift).collect();
        relative_l2_error(&values, &direct(&plain(inverse), &ys, &[1.0; 50], &xs).unwrap())
    };
    let [touching, apart] = [1.0, 2.0].map(|cells| [10, 40].map(|order| error(order, cells)));
    assert!(touching[1] > 10.0 * touching[0] && touching[1] > 1.0, "{touching:?}");
    assert!(apart[1] < 1e-3 * apart[0], "{apart:?}");
    // All cells of the first level touch.
    let points = clouds::cube(200, 2);
    let fmm = Fmm::builder(plain(inverse)).order(2).leaf_size(50).build(&points, &points).unwrap();
    assert_eq!((fmm.report().stats.depth, fmm.report().stats.expansion_pairs), (1, 0));
    row(
        "Cells that touch",
        "the series of corners diverges",
        format!("error {:.0e} at order 10, {:.0e} at order 40", touching[0], touching[1]),
        format!("{:.0e} and {:.0e}: at least one cell lies between", apart[0], apart[1]),
    );
}

#[test]
fn corners_that_face_each_other_are_certified() {
    // All sources in one corner of a cell, all targets in the corner that faces it two cells on: the
    // pairs for which an expansion is worst, and no others.
    let mut random = Random::new(2);
    let mut corner = |at: DVec3, sign: DVec3| -> Vec<DVec3> {
        (0..100).map(|_| at + random.in_cube() * sign * 1e-3).collect()
    };
    let mut sources = corner(DVec3::splat(0.25), -DVec3::ONE);
    let mut targets = corner(DVec3::new(0.5, 0.25, 0.25), DVec3::new(1.0, -1.0, -1.0));
    for set in [&mut sources, &mut targets] {
        set.extend([DVec3::ZERO, DVec3::ONE]);
    }
    let mut charges = vec![1.0; 102];
    charges[100..].fill(0.0);
    let exact = direct(&plain(inverse), &sources, &charges, &targets).unwrap();
    let mut lines = Vec::new();
    for tolerance in [1e-3, 1e-6, 1e-9] {
        let fmm = build(inverse, tolerance, &sources, &targets).unwrap();
        assert!(fmm.report().stats.cell_pairs[0] > 0);
        let (values, certificate) = fmm.apply_certified(&charges).unwrap();
        let error = relative_l2_error(&values, &exact);
        assert!(error <= (1.0 + 1e-6) * certificate.relative_l2, "{error:e} {certificate:?}");
        assert!(error < 2.5 * tolerance, "{tolerance:e}: {error:e}");
        lines.push(format!("{error:.0e} at {tolerance:.0e}"));
    }
    row(
        "Barely separated cells, all charges in corners that face each other",
        "the worst pairs of all, which a mean over cells does not show",
        "tolerance taken for the error",
        format!("error {}; the certificate bounds it", lines.join(", ")),
    );
}

#[test]
fn steep_kernels_meet_their_tolerances() {
    let points = clouds::cube(1500, 4);
    let charges = charges(1500, 5);
    let steep = |x: DVec3, y: DVec3| x.distance_squared(y).powi(-3);
    // The nearest pairs outweigh all others, so the far field is looked at by itself.
    let targets: Vec<DVec3> = points.iter().map(|p| *p + DVec3::X * 1.5).collect();
    let exact = direct(&plain(steep), &points, &charges, &targets).unwrap();
    let absolute: Vec<f64> = charges.iter().map(|q| q.abs()).collect();
    let absolute = direct(&plain(steep), &points, &absolute, &targets).unwrap();
    let condition = relative_l2_error(&absolute, &vec![0.0; 1500])
        / relative_l2_error(&exact, &vec![0.0; 1500]);
    let mut lines = Vec::new();
    for tolerance in [1e-2, 1e-4] {
        let fmm = build(steep, tolerance, &points, &targets).unwrap();
        assert!(fmm.report().stats.direct_pairs < 1500 * 1500 / 2);
        let error = relative_l2_error(&fmm.apply(&charges).unwrap(), &exact) / condition;
        assert!(error < tolerance, "{tolerance:e}: {error:e}");
        lines.push(format!("{error:.0e} at {tolerance:.0e}"));
    }
    let naive = fixed_order(steep, 4, &points, &charges, &targets);
    row(
        "Steep kernels: 1/r⁶",
        "a fixed order is good for one exponent",
        format!("error {naive:.0e} with 4 nodes"),
        format!("error {}", lines.join(", ")),
    );
}

/// The error of an order that nothing was asked about.
fn fixed_order(
    formula: Formula,
    order: usize,
    sources: &[DVec3],
    charges: &[f64],
    targets: &[DVec3],
) -> f64 {
    let fmm = Fmm::builder(plain(formula)).order(order).leaf_size(20);
    let values = fmm.build(sources, targets).unwrap().apply(charges).unwrap();
    relative_l2_error(&values, &direct(&plain(formula), sources, charges, targets).unwrap())
}

/// Points whose distances from one of them span six decades.
fn graded(n: usize, seed: u64) -> Vec<DVec3> {
    let mut random = Random::new(seed);
    (0..n).map(|_| random.direction() * 10f64.powf(-6.0 * random.unit())).collect()
}

#[test]
fn kernels_with_a_scale_meet_their_tolerances_over_twenty_levels() {
    let points = graded(1500, 6);
    let charges = vec![1.0; 1500];
    let mut lines = Vec::new();
    let formulas: [(&str, Formula); 2] = [
        ("Yukawa", |x, y| (-20.0 * x.distance(y)).exp() / x.distance(y)),
        ("Gaussian", |x, y| (-3000.0 * x.distance_squared(y)).exp()),
    ];
    for (name, formula) in formulas {
        let fmm = build(formula, 1e-2, &points, &points).unwrap();
        assert!(fmm.report().stats.depth >= 18, "{}", fmm.report().stats.depth);
        let exact = direct(&plain(formula), &points, &charges, &points).unwrap();
        let error = relative_l2_error(&fmm.apply(&charges).unwrap(), &exact);
        assert!(error < 1e-2, "{name}: {error:e}");
        lines.push(format!("{name} {error:.0e}"));
    }
    // Operators of one level, scaled as those of 1/r may be, are those of another Yukawa kernel.
    let yukawa = |scale: f64| (-20.0 * 4.0 * scale).exp() / (4.0 * scale);
    let naive = (yukawa(0.25) * 0.25 / (yukawa(0.25f64.powi(5)) * 0.25f64.powi(5)) - 1.0).abs();
    assert!(naive > 0.9);
    row(
        "Yukawa and Gaussian kernels over 20 levels",
        "operators of one level do not serve the next; exponentials underflow",
        format!("error {naive:.1} four levels on"),
        format!("at tolerance 1e-2: {}", lines.join(", ")),
    );
}

#[test]
fn a_scale_far_from_the_extent_is_not_overlooked() {
    // Over 2e7 units a softening of one unit is not to be seen; between cells of one unit it is.
    let softened = |x: DVec3, y: DVec3| 1.0 / (x.distance_squared(y) + 1.0).sqrt();
    let points: Vec<DVec3> = clouds::cube(1500, 7).iter().map(|p| *p * 2e7).collect();
    let charges = charges(1500, 8);
    let error = error(softened, 1e-6, &points, &charges).unwrap();
    assert!(error < 1e-6, "{error:e}");
    let at_unit = |r: f64| r / (r * r + 1.0).sqrt();
    row(
        "A softening of 1e-7 of the extent",
        "homogeneous where it was probed, not where operators were built",
        format!("error {:.0e} between unit cells", 1.0 - at_unit(4.0)),
        format!("error {error:.0e} at tolerance 1e-6"),
    );
}

#[test]
fn waves_of_any_length_are_summed() {
    let points = clouds::cube(800, 9);
    let wave = |k: f64| {
        from_fn(move |x: DVec3, y: DVec3| Complex::cis(k * x.distance(y)) / x.distance(y))
            .skip_coincident()
    };
    let charges: Vec<Complex<f64>> = charges(800, 10).into_iter().map(Complex::from).collect();
    let (mut expanded, mut direct_sums) = (Vec::new(), Vec::new());
    for k in [20.0, 300.0, 1e4] {
        let exact = direct(&wave(k), &points, &charges, &points).unwrap();
        let fmm = Fmm::builder(wave(k)).tolerance(0.05).leaf_size(20).build(&points, &points);
        let fmm = fmm.unwrap();
        let error = relative_l2_error(&fmm.apply(&charges).unwrap(), &exact);
        assert!(error < 0.05, "k = {k}: {error:e}");
        if fmm.report().stats.fallback.is_some() {
            direct_sums.push(format!("k = {k}"));
        } else {
            expanded.push(format!("k = {k}: {error:.0e}"));
        }
    }
    assert!(!expanded.is_empty() && direct_sums.len() >= 2, "{expanded:?} {direct_sums:?}");
    let cosine = |x: DVec3, y: DVec3| (300.0 * x.distance(y)).cos();
    let naive = fixed_order(cosine, 6, &points, &vec![1.0; 800], &points);
    assert!(naive > 0.1);
    row(
        "Oscillatory kernels, up to 500 and 1,000s of periods",
        "interpolation below two nodes per period is noise",
        format!("error {naive:.1} with 6 nodes, k = 300"),
        format!(
            "tolerance 0.05: {}; summed directly for {}",
            expanded.join(", "),
            direct_sums.join(", ")
        ),
    );
}

#[test]
fn discontinuous_kernels_are_summed_directly() {
    let points = clouds::cube(1500, 11);
    let charges = vec![1.0; 1500];
    let jump = |x: DVec3, y: DVec3| if x.distance(y) < 0.55 { 1.0 } else { 0.0 };
    // Different from place to place, and continuous about the centre.
    let step = |x: DVec3, y: DVec3| if x.x < 0.2 { 2.0 } else { 1.0 } / (0.3 + x.distance(y));
    let naive = fixed_order(jump, 6, &points, &charges, &points);
    assert!(naive > 1e-3);
    let mut worst = 0.0f64;
    for formula in [jump as Formula, step] {
        let fmm = build(formula, 1e-3, &points, &points).unwrap();
        let exact = direct(&plain(formula), &points, &charges, &points).unwrap();
        worst = worst.max(relative_l2_error(&fmm.apply(&charges).unwrap(), &exact));
    }
    assert!(worst < 1e-3, "{worst:e}");
    row(
        "Discontinuous kernels",
        "polynomials do not converge to a jump",
        format!("error {naive:.0e} with 6 nodes"),
        format!("summed directly; error {worst:.0e} at tolerance 1e-3"),
    );
}

#[test]
fn kernels_that_are_not_numbers_are_named() {
    let points = clouds::cube(1500, 12);
    let charges = vec![1.0; 1500];
    let formulas: [(&str, Formula); 4] = [
        ("NaN far away", |x, y| (1.0 - x.distance_squared(y)).sqrt()),
        ("NaN in one direction", |x, y| ((x - y).x + 0.3).sqrt()),
        ("infinite far away", |x, y| 1.0 / (0.7 - x.distance(y)).max(0.0)),
        ("NaN everywhere", |_, _| f64::NAN),
    ];
    let mut lines = Vec::new();
    for (name, formula) in formulas {
        let outcome = build(formula, 1e-3, &points, &points).and_then(|fmm| fmm.apply(&charges));
        match outcome {
            Err(Error::NonFiniteKernel) => lines.push(format!("{name}: `NonFiniteKernel`")),
            Err(Error::NonFiniteValue { .. }) => lines.push(format!("{name}: `NonFiniteValue`")),
            other => panic!("{name}: {:?}", other.map(|values| values[0])),
        }
    }
    let naive: f64 = points.iter().map(|y| formulas[0].1(points[0], *y)).sum();
    row(
        "Kernels that return NaN or infinity",
        "NaN passes comparisons, loops that wait for convergence never end",
        format!("sum {naive}"),
        lines.join("; "),
    );
}

#[test]
fn homogeneous_kernels_have_no_size() {
    let fourth = |x: DVec3, y: DVec3| x.distance_squared(y).powi(-2);
    let charges = vec![1.0; 1500];
    let mut worst = 0.0f64;
    for scale in [1e-50, 1.0, 1e60] {
        let points: Vec<DVec3> = clouds::cube(1500, 13).iter().map(|p| *p * scale).collect();
        // The far field by itself: the nearest pairs outweigh all others.
        let targets: Vec<DVec3> = points.iter().map(|p| *p + DVec3::X * (1.5 * scale)).collect();
        let fmm =
            build(fourth, 1e-3, &points, &targets).unwrap_or_else(|e| panic!("{scale:e}: {e}"));
        let units = |u: Vec<f64>| u.iter().map(|u| u * scale.powi(4)).collect::<Vec<_>>();
        let exact = units(direct(&plain(fourth), &points, &charges, &targets).unwrap());
        let error = relative_l2_error(&units(fmm.apply(&charges).unwrap()), &exact);
        assert!(error < 1e-3, "{scale:e}: {error:e}");
        worst = worst.max(error);
    }
    let naive = [1e-50f64, 1e60].map(|r| r.powi(-4).powi(2));
    assert_eq!(naive, [f64::INFINITY, 0.0]);
    row(
        "1/r⁴ over extents of 1e-50 and 1e60",
        "squares of 1e200 and 1e-240, by which kernels are compared",
        format!("norms of {naive:?}: refused, or taken for zero"),
        format!("error {worst:.0e} at tolerance 1e-3"),
    );
}
