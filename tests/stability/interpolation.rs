//! Interpolation at high order, close to its cut-offs, and in single precision.

use farfield::{Error, Fmm, direct, from_fn, relative_l2_error};
use farfield_testing::clouds::{self, Random, charges};
use glam::{DVec3, Vec3};

use crate::table::row;
use crate::{Formula, build, error, plain};

fn inverse(x: DVec3, y: DVec3) -> f64 {
    1.0 / x.distance(y)
}

/// The largest error of interpolating 1/(1.6 − x) on [−1, 1] from values at `nodes` that are each off by
/// a rounding, by Lagrange's formula.
fn interpolation_error(nodes: &[f64]) -> f64 {
    let f = |x: f64| 1.0 / (1.6 - x);
    let rounded = |(k, &x): (usize, &f64)| f(x) * (1.0 + f64::EPSILON * [1.0, -1.0][k % 2]);
    let values: Vec<f64> = nodes.iter().enumerate().map(rounded).collect();
    let at = |x: f64| -> f64 {
        let weight = |k: usize| -> f64 {
            let others = nodes.iter().enumerate().filter(|(j, _)| *j != k);
            others.map(|(_, &node)| (x - node) / (nodes[k] - node)).product()
        };
        values.iter().enumerate().map(|(k, value)| value * weight(k)).sum()
    };
    (0..200).map(|i| f64::from(i) / 100.0 - 0.995).map(|x| (at(x) - f(x)).abs()).fold(0.0, f64::max)
}

/// d_x d_y is symmetric, but flips its sign under two reflections: its fields are odd where its densities
/// are even.
#[test]
fn kernels_odd_along_two_axes_meet_their_tolerance() {
    let points = clouds::cube(1500, 5);
    let charges: Vec<f64> = charges(1500, 6).iter().map(|q| q.abs()).collect();
    let product = |x: DVec3, y: DVec3| (x.x - y.x) * (x.y - y.y);
    let shear =
        |x: DVec3, y: DVec3| (x.z - y.z) * (x.y - y.y) * (x.distance_squared(y) + 0.01).powf(-1.5);
    let mut largest = 0.0f64;
    for formula in [product as Formula, shear] {
        let sizes = from_fn(|x: DVec3, y: DVec3| formula(x, y).abs());
        let sizes = direct(&sizes, &points, &charges, &points).unwrap();
        let exact = direct(&plain(formula), &points, &charges, &points).unwrap();
        let fmm = build(formula, 1e-5, &points, &points).unwrap();
        assert!(fmm.report().stats.expansion_pairs > 0, "a far field to test");
        let sums = fmm.apply(&charges).unwrap();
        let sums: Vec<f64> = sums.iter().zip(&exact).map(|(a, b)| a - b).collect();
        let norm = |values: &[f64]| values.iter().map(|v| v * v).sum::<f64>().sqrt();
        largest = largest.max(norm(&sums) / norm(&sizes));
    }
    assert!(largest < 1e-5, "{largest:e}");
    row(
        "Kernels odd along two axes",
        "symmetric, but what leaves a cell has other signs than what enters it",
        "one basis for both: refused at every tolerance, wrong in all digits by order",
        format!("error {largest:.0e} at tolerance 1e-5"),
    );
}

#[test]
fn high_orders_are_well_conditioned() {
    let n = 48;
    let equal: Vec<f64> = (0..n).map(|k| 2.0 * f64::from(k) / f64::from(n - 1) - 1.0).collect();
    let angle = |k: i32| (f64::from(k) + 0.5) * std::f64::consts::PI / f64::from(n);
    let chebyshev: Vec<f64> = (0..n).map(|k| angle(k).cos()).collect();
    let [naive, ours] = [equal, chebyshev].map(|nodes| interpolation_error(&nodes));
    assert!(naive > 1e-5 && ours < 1e-13, "{naive:e} {ours:e}");

    let points = clouds::cube(1200, 1);
    let charges = charges(1200, 2);
    let exact = direct(&plain(inverse), &points, &charges, &points).unwrap();
    let error = |order| {
        let fmm = Fmm::builder(plain(inverse)).order(order).leaf_size(20);
        let values = fmm.build(&points, &points).unwrap().apply(&charges).unwrap();
        relative_l2_error(&values, &exact)
    };
    let errors = [4, 8, 12].map(error);
    assert!(errors.windows(2).all(|pair| pair[1] < 1e-2 * pair[0]), "{errors:?}");
    row(
        "Interpolation at high order",
        "equal spacing amplifies rounding as 2^n",
        format!("error {naive:.0e} with {n} equally spaced nodes"),
        format!(
            "{ours:.0e} with as many of Chebyshev's; sums with 4, 8, 12 per axis: {:.0e}, {:.0e}, {:.0e}",
            errors[0], errors[1], errors[2]
        ),
    );
}

#[test]
fn tolerances_hold_wherever_ranks_are_cut() {
    let points = clouds::cube(1200, 3);
    let charges = charges(1200, 4);
    let exact = direct(&plain(inverse), &points, &charges, &points).unwrap();
    let mut ranks = Vec::new();
    let mut worst = 0.0f64;
    // Not in steps of ten, so that singular values lie on either side of each cut.
    let mut tolerance = 0.3;
    while tolerance > 1e-7 {
        let fmm = build(inverse, tolerance, &points, &points).unwrap();
        let error = relative_l2_error(&fmm.apply(&charges).unwrap(), &exact);
        assert!(error <= tolerance, "{tolerance:e}: {error:e}");
        worst = worst.max(error / tolerance);
        ranks.push(fmm.report().stats.terms_per_cell);
        tolerance *= 0.37;
    }
    assert!(ranks.is_sorted_by(|a, b| a <= b), "{ranks:?}");
    row(
        "Ranks near the cut-off",
        "a singular value on the wrong side of the cut",
        "a rank fixed for all kernels",
        format!(
            "{} tolerances from 0.3 to 1e-7: error ≤ {worst:.1} of each, ranks {} to {}",
            ranks.len(),
            ranks[0],
            ranks[ranks.len() - 1]
        ),
    );
}

#[test]
fn tolerances_at_the_end_of_the_digits_are_met_or_refused() {
    let points = clouds::cube(1200, 5);
    let charges = charges(1200, 6);
    let mut outcomes = Vec::new();
    let single: Vec<Vec3> = points.iter().map(|p| p.as_vec3()).collect();
    let rounded: Vec<DVec3> = single.iter().map(|p| p.as_dvec3()).collect();
    let weights: Vec<f32> = charges.iter().map(|&q| q as f32).collect();
    let exact: Vec<f64> = weights.iter().copied().map(f64::from).collect();
    let exact = direct(&plain(inverse), &rounded, &exact, &rounded).unwrap();
    let kernel = from_fn(|x: Vec3, y: Vec3| 1.0 / x.distance(y)).skip_coincident();
    for tolerance in [3e-6, 1e-6, 1e-8] {
        let builder = Fmm::builder(kernel).tolerance(tolerance).leaf_size(20);
        let found = builder.build(&single, &single).map(|fmm| {
            let values = fmm.apply(&weights).unwrap().into_iter().map(f64::from);
            relative_l2_error(&values.collect::<Vec<_>>(), &exact)
        });
        outcomes.push(outcome("f32", tolerance, found));
    }
    let exact = direct(&plain(inverse), &points, &charges, &points).unwrap();
    let found = build(inverse, 1e-10, &points, &points)
        .map(|fmm| relative_l2_error(&fmm.apply(&charges).unwrap(), &exact));
    outcomes.push(outcome("f64", 1e-10, found));
    assert!(outcomes.iter().any(|o| o.contains("refused")), "{outcomes:?}");
    assert!(outcomes.iter().any(|o| o.contains("error")), "{outcomes:?}");
    row(
        "Tolerances at the end of the digits",
        "more nodes add rounding, not digits",
        "the last order is returned as if it had met the tolerance",
        outcomes.join(", "),
    );
}

#[test]
fn a_scale_of_the_smallest_cells_is_not_overlooked() {
    // Points whose distances from the origin span seven decades, and a softening of the last.
    let mut random = Random::new(6);
    let place = |_| random.direction() * 10f64.powf(-6.0 * random.unit());
    let points: Vec<DVec3> = (0..1500).map(place).collect();
    let softened: Formula = |x, y| 1.0 / (x.distance_squared(y) + 1e-14).sqrt();
    let error = error(softened, 1e-6, &points, &vec![1.0; 1500]).unwrap();
    assert!(error < 1e-6, "{error:e}");
    row(
        "A softening of 1e-7 of the extent, cells of that size",
        "homogeneous to all digits in large cells",
        "error 4e-5 at tolerance 1e-6, with operators of large cells",
        format!("error {error:.0e}"),
    );
}

/// What came of a tolerance: met, or refused with something larger.
fn outcome(precision: &str, tolerance: f64, found: Result<f64, Error>) -> String {
    match found {
        Ok(error) => {
            assert!(error <= tolerance, "{precision}, {tolerance:e}: {error:e}");
            format!("{precision} {tolerance:.0e}: error {error:.0e}")
        }
        Err(Error::UnreachableTolerance { requested, reachable }) => {
            assert!(requested == tolerance && reachable > tolerance);
            format!("{precision} {tolerance:.0e}: refused, {reachable:.0e} offered")
        }
        Err(other) => panic!("{precision}, {tolerance:e}: {other}"),
    }
}
