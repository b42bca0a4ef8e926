//! Units of length: a kernel is asked for distances between points of the cloud, and what has another unit is
//! as accurate as all else.

use farfield::{
    Coordinates, Difference, Fmm, Formula, Number, direct, from_formula, relative_l2_error,
};
use farfield_testing::clouds::{charges, cube};
use glam::DVec3;

use crate::plain;

const N: usize = 3000;

#[test]
fn what_a_kernel_is_beyond_the_cloud_is_nothing_to_it() {
    // All are 1/r, r or r³ between points of small cubes, and something else not far beyond.
    let kernels: [(&str, crate::Formula<DVec3, f64>); 6] = [
        ("cut off", |x, y| if x.distance(y) < 2.0 { 1.0 / x.distance(y) } else { 0.0 }),
        ("bounded", |x, y| 1.0 / x.distance(y).min(1.8)),
        ("huge", |x, y| if x.distance(y) < 1.9 { 1.0 / x.distance(y) } else { 1e9 }),
        ("no number", |x, y| if x.distance(y) < 1.9 { x.distance(y) } else { f64::NAN }),
        ("growing", |x, y| if x.distance(y) < 1.9 { x.distance(y).powi(3) } else { 0.0 }),
        ("beyond 8", |x, y| 1.0 / x.distance(y).min(8.0)),
    ];
    let qs = charges(N, 2);
    for edge in [1e-3, 0.5, 3.0, 10.0] {
        let points: Vec<DVec3> = cube(N, 1).iter().map(|&p| p * (0.5 * edge)).collect();
        for (name, kernel) in kernels {
            if edge > 0.5 && name != "beyond 8" {
                continue;
            }
            let kernel = plain(kernel).skip_coincident();
            let exact = direct(&kernel, &points, &qs, &points).unwrap();
            for tolerance in [1e-3, 1e-6] {
                let builder = Fmm::builder(&kernel).tolerance(tolerance).leaf_size(30);
                let fmm = builder.build(&points, &points).unwrap();
                let error = relative_l2_error(&fmm.apply(&qs).unwrap(), &exact);
                assert!(error <= tolerance, "{name}, {edge}, {tolerance:e}: {error:e}");
                let is_smooth = edge < 8.0 / 3f64.sqrt();
                assert!(!is_smooth || fmm.report().stats.expansion_pairs > 0, "{name}, {edge}");
            }
        }
    }
}

/// The potential of charges and of dipoles along an axis.
#[derive(Clone, Copy)]
struct ChargesAndDipoles;

impl Formula for ChargesAndDipoles {
    type Of = Difference;
    type Entry<X: Number> = X;

    fn entries<X: Number>(&self, d: Coordinates<X>, g: &mut [X]) {
        let inverse = d.length().recip();
        (g[0], g[1]) = (inverse, d.x * inverse * inverse * inverse);
    }

    fn densities(&self) -> usize {
        2
    }
}

#[test]
fn densities_of_any_unit_are_as_accurate_as_others() {
    for edge in [1e-6, 1.0, 1e5] {
        let points: Vec<DVec3> = cube(N, 1).iter().map(|&p| p * (0.5 * edge)).collect();
        let kernel = from_formula::<_, DVec3, [f64; 2]>(ChargesAndDipoles).values::<f64>();
        let kernel = kernel.skip_coincident();
        for tolerance in [1e-3, 1e-6] {
            let builder = Fmm::builder(&kernel).tolerance(tolerance).leaf_size(30);
            let fmm = builder.build(&points, &points).unwrap();
            assert!(fmm.report().stats.expansion_pairs > 0, "{edge:e}, {tolerance:e}");
            for [charge, dipole] in [[1.0, 0.0], [0.0, 1.0], [1.0, edge]] {
                let qs: Vec<[f64; 2]> =
                    charges(N, 2).iter().map(|q| [charge * q, dipole * q]).collect();
                let exact = direct(&kernel, &points, &qs, &points).unwrap();
                let error = relative_l2_error(&fmm.apply(&qs).unwrap(), &exact);
                assert!(error <= tolerance, "{edge:e}, {tolerance:e}, {dipole}: {error:e}");
            }
        }
    }
}

/// A density that decays fast beside one that does not and is small.
#[derive(Clone, Copy)]
struct SteepAndFlat;

impl Formula for SteepAndFlat {
    type Of = Difference;
    type Entry<X: Number> = X;

    fn entries<X: Number>(&self, d: Coordinates<X>, g: &mut [X]) {
        let inverse = d.length_squared().recip();
        (g[0], g[1]) = (inverse * inverse * inverse, (d.length() + 1.0).recip() * 1e-6);
    }

    fn densities(&self) -> usize {
        2
    }
}

#[test]
fn densities_are_accurate_where_others_outweigh_them() {
    let points = cube(N, 1);
    let kernel = from_formula::<_, DVec3, [f64; 2]>(SteepAndFlat).values::<f64>();
    let kernel = kernel.skip_coincident();
    for tolerance in [1e-2, 1e-4] {
        let builder = Fmm::builder(&kernel).tolerance(tolerance).leaf_size(30).applications(1000);
        let fmm = builder.build(&points, &points).unwrap();
        assert!(fmm.report().stats.expansion_pairs > 0, "{tolerance:e}");
        for [steep, flat] in [[1.0, 0.0], [0.0, 1.0], [1e-6, 1.0]] {
            let sizes = charges(N, 2).into_iter().map(f64::abs);
            let qs: Vec<[f64; 2]> = sizes.map(|q| [steep * q, flat * q]).collect();
            let exact = direct(&kernel, &points, &qs, &points).unwrap();
            let error = relative_l2_error(&fmm.apply(&qs).unwrap(), &exact);
            assert!(error <= tolerance, "{tolerance:e}, {steep}, {flat}: {error:e}");
        }
    }
}

/// r or 1/r, whose values, gradients and second derivatives have sizes far apart where lengths are, or cells small.
#[derive(Clone, Copy)]
struct Radial {
    inverse: bool,
}

impl Formula for Radial {
    type Of = Difference;
    type Entry<X: Number> = X;

    fn entries<X: Number>(&self, d: Coordinates<X>, g: &mut [X]) {
        g[0] = if self.inverse { d.length().recip() } else { d.length() };
    }
}

#[test]
fn derivatives_are_as_accurate_in_any_unit_of_length() {
    let qs = charges(N, 2);
    for (edge, inverse) in [(1e-6, false), (1e5, false), (1e-6, true), (1.0, true)] {
        let points: Vec<DVec3> = cube(N, 1).iter().map(|&p| p * (0.5 * edge)).collect();
        let kernel = from_formula::<_, DVec3, f64>(Radial { inverse }).skip_coincident().hessian();
        let exact = direct(&kernel, &points, &qs, &points).unwrap();
        let tolerance = 1e-2;
        let builder = Fmm::builder(&kernel).tolerance(tolerance).leaf_size(30);
        let fmm = builder.applications(1000).build(&points, &points).unwrap();
        assert!(fmm.report().stats.expansion_pairs > 0, "{edge:e}, {inverse}");
        let sums = fmm.apply(&qs).unwrap();
        for (part, error) in [
            ("values", relative_l2_error(&by(&sums, |u| u.value), &by(&exact, |u| u.value))),
            (
                "gradients",
                relative_l2_error(&by(&sums, |u| u.gradient), &by(&exact, |u| u.gradient)),
            ),
            ("hessians", relative_l2_error(&by(&sums, |u| u.hessian), &by(&exact, |u| u.hessian))),
        ] {
            assert!(error <= tolerance, "{part}, {edge:e}, {inverse}: {error:e}");
        }
    }
}

fn by<U, V>(sums: &[U], part: impl Fn(&U) -> V) -> Vec<V> {
    sums.iter().map(part).collect()
}
