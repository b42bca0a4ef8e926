//! Kernels that are smooth between some cells only, or that send next to nothing between others.

use farfield::conformance::Counting;
use farfield::{Cell, Coverage, Expansion, Fmm, Scheme};
use farfield_testing::clouds::{charges, cube, helix, plummer, two_clusters};
use glam::DVec3;

use crate::any_kernel::{Formula, error, error_at, plain};

#[test]
fn only_what_is_not_smooth_is_summed_directly() {
    // Along planes at every distance, so that a part of every level is smooth.
    let formulas: [(&str, Formula, f64); 3] = [
        ("kink", |x, y| (x.x - y.x).abs(), 0.4),
        ("step", |x, y| f64::from(x.x > y.x), 0.45),
        (
            "flat",
            |x, y| {
                let d = x - y;
                1.0 / (d.x * d.x + 100.0 * d.y * d.y + 1e4 * d.z * d.z).sqrt()
            },
            0.7,
        ),
    ];
    let (points, qs) = (cube(4000, 71), charges(4000, 72));
    let pairs = (points.len() * points.len()) as f64;
    for (name, formula, most) in formulas {
        for tolerance in [1e-2, 1e-4] {
            let builder = Fmm::builder(plain(formula)).tolerance(tolerance).leaf_size(16);
            let fmm = builder.build(&points, &points).unwrap();
            let stats = fmm.report().stats;
            assert_eq!((stats.scheme, stats.fallback), (Scheme::Fmm, None), "{name}");
            let share = stats.direct_pairs as f64 / pairs;
            assert!(share < most && stats.expansion_pairs > 0, "{name} {tolerance}: {share}");
            let error = error(formula, &points, &qs, &fmm.apply(&qs).unwrap());
            assert!(error <= tolerance, "{name} {tolerance}: {error:e}");
        }
    }
}

#[test]
fn what_is_negligible_is_left_out() {
    let formulas: [(&str, Formula); 3] = [
        ("narrow", |x, y| (-x.distance_squared(y) / 2e-4).exp()),
        ("compact", |x, y| {
            let t = (1.0 - 10.0 * x.distance(y)).max(0.0);
            t.powi(4) * (5.0 - 4.0 * t)
        }),
        ("screened", |x, y| (-50.0 * x.distance(y)).exp() / x.distance(y)),
    ];
    for (cloud, points) in [("cube", cube(5000, 73)), ("helix", helix(5000, 74))] {
        let any_sign = charges(points.len(), 75);
        let one_sign: Vec<f64> = any_sign.iter().map(|q| 1.0 + 0.5 * q).collect();
        for (name, formula) in formulas {
            let builder = Fmm::builder(plain(formula)).tolerance(1e-3).leaf_size(8);
            let fmm = builder.build(&points, &points).unwrap();
            let stats = fmm.report().stats;
            assert_eq!(stats.scheme, Scheme::Fmm, "{name}, {cloud}");
            let pairs = (points.len() * points.len()) as u64;
            assert!(stats.left_out_pairs > pairs / 5, "{name}, {cloud}: {stats:?}");
            let all = stats.left_out_pairs + stats.direct_pairs + stats.expansion_pairs;
            assert_eq!(all, pairs, "{name}, {cloud}: each pair is taken once");
            for qs in [&any_sign, &one_sign] {
                let error = error(formula, &points, qs, &fmm.apply(qs).unwrap());
                assert!(error <= 1e-3, "{name}, {cloud}: {error:e}");
            }
        }
    }
}

#[test]
fn what_was_negligible_is_summed_where_there_is_nothing_else() {
    let formula: Formula = |x, y| (-x.distance_squared(y) / 2e-4).exp();
    let (points, usual) = (cube(3000, 76), charges(3000, 77));
    let targets: Vec<DVec3> = points.iter().copied().filter(|p| p.x < 0.6).collect();
    let fmm = Fmm::builder(plain(formula)).tolerance(1e-3).leaf_size(16);
    let fmm = fmm.build(&points, &targets).unwrap();
    assert!(fmm.report().stats.left_out_pairs > 0);
    let before = fmm.apply(&usual).unwrap();
    assert_eq!(fmm.report().unusual_applications, 0);
    let far: Vec<f64> =
        points.iter().zip(&usual).map(|(p, &q)| if p.x > 0.7 { q } else { 0.0 }).collect();
    let error = error_at(&targets, formula, &points, &far, &fmm.apply(&far).unwrap());
    assert!(error <= 1e-3, "{error:e}");
    assert_eq!(fmm.report().unusual_applications, 1);
    assert_eq!(fmm.apply(&usual).unwrap(), before);
}

/// Counts points, but carries only what it is told to.
struct Choosy(Counting<f64>, fn(usize, [i32; 3]) -> Coverage);

impl Expansion for Choosy {
    type Kernel = Counting<f64>;
    type MultipoleTerm = f64;
    type LocalTerm = f64;

    fn kernel(&self) -> &Counting<f64> {
        &self.0
    }
    fn admits(&self, level: usize, offset: [i32; 3]) -> Coverage {
        (self.1)(level, offset)
    }
    fn multipole_len(&self, level: usize) -> usize {
        self.0.multipole_len(level)
    }
    fn local_len(&self, level: usize) -> usize {
        self.0.local_len(level)
    }
    fn p2m(&self, cell: &Cell<f64>, sources: &[DVec3], charges: &[f64], multipole: &mut [f64]) {
        self.0.p2m(cell, sources, charges, multipole);
    }
    fn m2m(&self, child: &Cell<f64>, parent: &Cell<f64>, from: &[f64], to: &mut [f64]) {
        self.0.m2m(child, parent, from, to);
    }
    fn m2l(&self, source: &Cell<f64>, target: &Cell<f64>, from: &[f64], to: &mut [f64]) {
        assert_eq!((self.1)(target.level(), source.offset_to(target)), Coverage::Full);
        self.0.m2l(source, target, from, to);
    }
    fn l2l(&self, parent: &Cell<f64>, child: &Cell<f64>, from: &[f64], to: &mut [f64]) {
        self.0.l2l(parent, child, from, to);
    }
    fn l2p(&self, cell: &Cell<f64>, local: &[f64], targets: &[DVec3], values: &mut [f64]) {
        self.0.l2p(cell, local, targets, values);
    }
}

#[test]
fn an_expansion_says_what_it_carries() {
    let rules: [fn(usize, [i32; 3]) -> Coverage; 4] = [
        |_, _| Coverage::Partial,
        |level, _| if level == 3 { Coverage::Partial } else { Coverage::Full },
        |level, [x, y, z]| match (x + 2 * y + 3 * z + level as i32).rem_euclid(3) {
            0 => Coverage::Partial,
            _ => Coverage::Full,
        },
        |level, [x, y, z]| match (x + 2 * y + 3 * z + level as i32).rem_euclid(4) {
            0 => Coverage::Partial,
            1 => Coverage::Empty,
            _ => Coverage::Full,
        },
    ];
    for points in [cube(3000, 78), plummer(3000, 79), two_clusters(3000, 80)] {
        for (k, admits) in rules.into_iter().enumerate() {
            for scheme in [Scheme::Fmm, Scheme::Treecode { m2m: true }] {
                let builder = Fmm::with_expansion(Choosy(Counting::new(), admits));
                let fmm = builder.scheme(scheme).leaf_size(10).build(&points, &points).unwrap();
                let sums = fmm.apply(&vec![1.0; points.len()]).unwrap();
                let stats = fmm.report().stats;
                let pairs = (points.len() * points.len()) as u64;
                assert_eq!(sums.iter().sum::<f64>() as u64, pairs - stats.left_out_pairs);
                assert_eq!(stats.left_out_pairs > 0, k == 3, "rule {k}");
                assert_eq!(stats.expansion_pairs > 0, k > 0, "rule {k}");
                if k < 3 {
                    assert!(sums.iter().all(|&count| count == points.len() as f64), "rule {k}");
                }
            }
        }
    }
}
