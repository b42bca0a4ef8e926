//! The scheme that a plan takes if none is given.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::thread::sleep;
use std::time::Duration;

use farfield::conformance::Counting;
use farfield::{
    Cell, Error, Expansion, Fmm, FnKernel, Scheme, Unmasked, direct, from_fn, relative_l2_error,
};
use farfield_testing::clouds::{self, Random};
use glam::DVec3;

use crate::{Formula, plain};

fn inverse() -> FnKernel<Formula<DVec3, f64>, DVec3, f64> {
    plain(|x, y| 1.0 / x.distance(y)).skip_coincident()
}

#[test]
fn few_points_are_summed_directly_and_many_by_expansions() {
    for (n, expected) in [(10, Scheme::Direct), (300, Scheme::Direct), (50_000, Scheme::Fmm)] {
        let points = clouds::cube(n, 1);
        let charges = clouds::charges(n, 2);
        let builder = || Fmm::builder(inverse()).tolerance(1e-4);
        let fmm = builder().build(&points, &points).unwrap();
        assert_eq!(fmm.report().stats.scheme, expected, "{n} points");
        assert_eq!(fmm.report().stats.expansion_pairs > 0, expected == Scheme::Fmm);

        let values = fmm.apply(&charges).unwrap();
        let exact = direct(&inverse(), &points, &charges, &points[..300.min(n)]).unwrap();
        assert!(relative_l2_error(&values[..exact.len()], &exact) < 1e-4);

        let report = fmm.report();
        let estimate = report.estimate.expect("a choice rests on estimates");

        assert!(report.to_string().contains("expected: plan"));
        assert_eq!(estimate.far_seconds > 0.0, expected == Scheme::Fmm);
        let again = builder().build(&points, &points).unwrap();
        assert_eq!(values, again.apply(&charges).unwrap(), "plans built alike are alike");
    }
}

#[test]
fn few_targets_don_t_pay_for_expansions() {
    // 200,000 pairs, and moments of 20,000 sources.
    let (sources, targets) = (clouds::cube(20_000, 1), clouds::cube(10, 2));
    let fmm = Fmm::builder(inverse()).tolerance(1e-4).build(&sources, &targets).unwrap();
    assert_eq!(fmm.report().stats.scheme, Scheme::Direct);
}

/// Counts points, with moments that take far longer than is forecast.
struct Drowsy(Counting<f64>);

impl Expansion for Drowsy {
    type Kernel = Counting<f64>;
    type MultipoleTerm = f64;
    type LocalTerm = f64;

    fn kernel(&self) -> &Counting<f64> {
        &self.0
    }
    fn multipole_len(&self, level: usize) -> usize {
        self.0.multipole_len(level)
    }
    fn local_len(&self, level: usize) -> usize {
        self.0.local_len(level)
    }
    fn p2m(&self, cell: &Cell<f64>, sources: &[DVec3], charges: &[f64], multipole: &mut [f64]) {
        sleep(Duration::from_millis(2));
        self.0.p2m(cell, sources, charges, multipole);
    }
    fn m2m(&self, child: &Cell<f64>, parent: &Cell<f64>, from: &[f64], to: &mut [f64]) {
        self.0.m2m(child, parent, from, to);
    }
    fn m2l(&self, source: &Cell<f64>, target: &Cell<f64>, from: &[f64], to: &mut [f64]) {
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
fn doubts_are_settled_by_applying_the_plan() {
    let points = clouds::cube(6000, 1);
    // So many that neither scheme is taken for being quick.
    let builder = || Fmm::with_expansion(Drowsy(Counting::new())).applications(1000).tuned();
    // Forecasts are in pairs, so that their ratio is none of measured times.
    let forecast = builder().estimate(&points, &points).unwrap();
    let ratio = forecast.direct_seconds / forecast.apply_seconds();
    assert!(ratio > 2.0 && ratio < 15.0, "expansions look better, but not beyond doubt: {ratio}");
    let fmm = builder().build(&points, &points).unwrap();
    assert_eq!(
        fmm.report().stats.scheme,
        Scheme::Direct,
        "direct sums take less than hundreds of naps"
    );
    assert_eq!(fmm.apply(&[1.0; 6000]).unwrap(), [6000.0; 6000]);
}

#[test]
fn what_is_given_is_taken() {
    let points = clouds::cube(300, 1);
    let builder = || Fmm::builder(inverse()).tolerance(1e-2);
    let scheme_of = |fmm: Fmm<_>| fmm.report().stats.scheme;
    let given = builder().scheme(Scheme::Treecode { m2m: false }).build(&points, &points);
    assert_eq!(scheme_of(given.unwrap()), Scheme::Treecode { m2m: false });
    let cells = builder().leaf_size(10).build(&points, &points).unwrap();
    assert!(cells.report().stats.expansion_pairs > 0 && cells.report().estimate.is_none());
    assert_eq!(scheme_of(cells), Scheme::Fmm);
    let masked = builder().mask(Unmasked).build(&points, &points);
    assert_eq!(scheme_of(masked.unwrap()), Scheme::Fmm);
}

#[test]
fn nothing_that_is_measured_decides() {
    // As slow as it likes, now and then.
    let calls = AtomicU64::new(0);
    let moody = || {
        from_fn(|x: DVec3, y: DVec3| {
            if calls.fetch_add(1, Relaxed).is_multiple_of(50_000) {
                sleep(Duration::from_millis(1));
            }
            (-x.distance_squared(y)).exp()
        })
    };
    let points = clouds::cube(5000, 1);
    let charges = clouds::charges(5000, 2);
    let build = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let fmm = Fmm::builder(moody()).tolerance(1e-3).build(&points, &points).unwrap();
            let stats = fmm.report().stats;
            (stats.scheme, stats.leaf_size, fmm.apply(&charges).unwrap())
        })
    };
    let first = build(1);
    assert_eq!(first.0, Scheme::Fmm, "there is something to choose");
    for threads in [2, 7] {
        assert_eq!(build(threads), first);
    }
}

#[test]
fn what_can_t_be_afforded_is_not_begun() {
    // So many sizes of cells, and so few points, that operators would take many times as long as the sums.
    let mut random = Random::new(1);
    let shrinking = |_| random.direction() * 10f64.powf(-16.0 * random.unit());
    let points: Vec<DVec3> = (0..3000).map(shrinking).collect();
    let calls = AtomicU64::new(0);
    let gaussian = from_fn(|x: DVec3, y: DVec3| {
        calls.fetch_add(1, Relaxed);
        (-9.0 * x.distance_squared(y)).exp()
    });
    let fmm = Fmm::builder(gaussian).tolerance(1e-6).build(&points, &points).unwrap();
    assert_eq!(fmm.report().stats.scheme, Scheme::Direct);
    let asked = calls.load(Relaxed);
    assert!(asked < 3000 * 3000 / 50, "{asked}");
}

#[test]
fn what_a_pair_is_said_to_take_counts() {
    let points = clouds::cube(3000, 1);
    let plan = |seconds: f64| {
        Fmm::builder(inverse()).tolerance(1e-3).pair_seconds(seconds).build(&points, &points)
    };
    let leaf_size = |seconds: f64| plan(seconds).unwrap().report().stats.leaf_size;
    assert!(leaf_size(1e-6) < leaf_size(1e-9));
    let scheme = |seconds: f64| plan(seconds).unwrap().report().stats.scheme;
    assert_eq!((scheme(1e-6), scheme(1e-10)), (Scheme::Fmm, Scheme::Direct));
    for seconds in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let error = plan(seconds).unwrap_err();
        assert!(matches!(error, Error::InvalidPairSeconds { .. }), "{error}");
    }
}
