//! The engine on kernels that are exact: any error is the tree's, the lists' or the passes'.

use farfield::conformance::{Counting, RankOne};
use farfield::{
    Error, Fmm, Interpolation, PointSet, Scheme, Stats, direct, from_fn, relative_l2_error,
};
use farfield_testing::clouds::{self, Random};
use glam::{DVec3, Vec3};
use num_complex::Complex;

use crate::{Formula, plain, single};

pub(crate) const SCHEMES: [Scheme; 4] =
    [Scheme::Direct, Scheme::Treecode { m2m: false }, Scheme::Treecode { m2m: true }, Scheme::Fmm];

/// Whole charges, so that sums of them are exact.
fn whole_charges(n: usize) -> Vec<f64> {
    (0..n).map(|i| (i % 17) as f64 - 5.0).collect()
}

fn counted(points: &[DVec3], targets: &[DVec3], leaf_size: usize, scheme: Scheme) -> Stats {
    let charges = whole_charges(points.len());
    let fmm = Fmm::with_expansion(Counting::<f64>::new())
        .leaf_size(leaf_size)
        .scheme(scheme)
        .build(points, targets)
        .unwrap();
    let total: f64 = charges.iter().sum();
    let values = fmm.apply(&charges).unwrap();
    assert_eq!(values, vec![total; targets.len()], "{scheme:?}, leaf size {leaf_size}");
    fmm.report().stats.clone()
}

#[test]
fn counting_is_exact_to_the_integer() {
    for (name, points) in clouds::all(3000) {
        for scheme in SCHEMES {
            for leaf_size in [1, 8, 60, 3000] {
                let stats = counted(&points, &points, leaf_size, scheme);
                let pairs = stats.expansion_pairs + stats.direct_pairs;
                assert_eq!(pairs, 9_000_000, "{name}: every pair once");
                let far = scheme != Scheme::Direct && leaf_size < 100 && name != "coincident";
                assert_eq!(stats.expansion_pairs > 0, far, "{name}, {scheme:?}, {leaf_size}");
            }
        }
    }
}

#[test]
fn sources_and_targets_may_differ() {
    let sources = clouds::plummer(2000, 7);
    for (name, targets) in clouds::all(500) {
        for scheme in SCHEMES {
            let stats = counted(&sources, &targets, 10, scheme);
            assert_eq!((stats.sources, stats.targets), (2000, 500), "{name}");
        }
    }
    // Very different densities: cells of one tree meet larger leaves of the other.
    let dense = clouds::cube(4000, 8);
    let sparse = clouds::cube(100, 9);
    for (sources, targets) in [(&dense, &sparse), (&sparse, &dense)] {
        let stats = counted(sources, targets, 8, Scheme::Fmm);
        let [_, m2p, p2l] = stats.cell_pairs;
        assert!(m2p + p2l > 0, "unequal leaves meet: {stats:?}");
    }
}

#[test]
fn tiny_and_empty_sets() {
    for n in 0..4 {
        for m in 0..4 {
            for scheme in SCHEMES {
                for leaf_size in 1..4 {
                    counted(&clouds::cube(n, 1), &clouds::cube(m, 2), leaf_size, scheme);
                }
            }
        }
    }
}

#[test]
fn the_rank_one_kernel_is_exact_to_round_off() {
    for (name, points) in clouds::all(2000) {
        let points: Vec<DVec3> = points.iter().map(|p| p.clamp_length_max(10.0)).collect();
        let charges: Vec<f64> = clouds::charges(2000, 3).iter().map(|q| q.abs()).collect();
        let kernel = RankOne::<f64>::new();
        let exact = direct(&kernel, &points, &charges, &points).unwrap();
        for scheme in SCHEMES {
            let fmm =
                Fmm::with_expansion(kernel).scheme(scheme).leaf_size(20).build(&points, &points);
            let values = fmm.unwrap().apply(&charges).unwrap();
            for (value, exact) in values.iter().zip(&exact) {
                approx::assert_relative_eq!(value, exact, max_relative = 1e-12);
            }
            assert!(relative_l2_error(&values, &exact) < 1e-13, "{name}, {scheme:?}");
        }
    }
}

#[test]
fn a_far_away_origin_costs_no_digits() {
    let near = clouds::cube(2000, 1);
    let origin = DVec3::new(3e6, -1e6, 7e5);
    // Shifted points are rounded: the reference must see the rounded ones.
    let points: Vec<DVec3> = near.iter().map(|p| *p + origin).collect();
    let charges = clouds::charges(2000, 2);
    let kernel = plain(|x, y| 1.0 / x.distance(y)).skip_coincident();
    let exact = direct(&kernel, &points, &charges, &points).unwrap();
    let fmm = Fmm::builder(kernel).order(9).leaf_size(60).build(&points, &points).unwrap();
    let error = relative_l2_error(&fmm.apply(&charges).unwrap(), &exact);
    assert!(error < 1e-7, "{error:e}");
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let points = clouds::plummer(3000, 1);
    let targets = clouds::cube(2000, 2);
    let charges = clouds::charges(3000, 3);
    let kernel = plain(|x, y| 1.0 / (1.0 + x.distance_squared(y)));
    let run = |threads, scheme| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let builder = Fmm::builder(kernel).order(4).leaf_size(20).scheme(scheme);
            let fmm = builder.build(&points, &targets).unwrap();
            let values = fmm.apply(&charges).unwrap();
            assert_eq!(values, fmm.apply(&charges).unwrap(), "a second application");
            let (timed, times) = fmm.apply_timed(&charges).unwrap();
            assert_eq!(values, timed, "operator by operator");
            assert_eq!(times.m2l > 0.0, scheme == Scheme::Fmm, "{times:?}");
            values
        })
    };
    for scheme in SCHEMES {
        let one = run(1, scheme);
        assert_eq!(one, run(2, scheme), "{scheme:?}");
        assert_eq!(one, run(4, scheme), "{scheme:?}");
    }
}

#[test]
fn a_plan_serves_many_charges_and_many_threads() {
    let points = clouds::cube(1000, 1);
    let fmm = Fmm::with_expansion(Counting::<f64>::new()).leaf_size(10).build(&points, &points);
    let fmm = fmm.unwrap();
    std::thread::scope(|scope| {
        for k in 1..5 {
            let fmm = &fmm;
            scope.spawn(move || {
                for _ in 0..10 {
                    let values = fmm.apply(&vec![f64::from(k); 1000]).unwrap();
                    assert_eq!(values, vec![1000.0 * f64::from(k); 1000]);
                }
            });
        }
    });
}

#[test]
fn all_schemes_of_interpolation_converge_to_direct() {
    let points = clouds::sphere(3000, 1);
    let charges = clouds::charges(3000, 2);
    let kernel = plain(|x, y| 1.0 / (1.0 + x.distance_squared(y)));
    let exact = direct(&kernel, &points, &charges, &points).unwrap();
    for scheme in SCHEMES {
        let fmm = Fmm::builder(kernel).tolerance(1e-6).leaf_size(30).scheme(scheme);
        let fmm = fmm.build(&points, &points).unwrap();
        let error = relative_l2_error(&fmm.apply(&charges).unwrap(), &exact);
        assert!(error < 1e-6, "{scheme:?}: {error:e}");
    }
}

#[test]
fn complex_kernels_and_many_columns() {
    let points = clouds::cube(1500, 1);
    let mut random = Random::new(2);
    let charges: Vec<Complex<f64>> =
        (0..1500).map(|_| Complex::new(random.unit() - 0.5, random.unit())).collect();
    let wave: Formula<DVec3, Complex<f64>> = |x, y| {
        let r = x.distance(y);
        Complex::cis(5.0 * r) / r
    };
    let wave = from_fn(wave).skip_coincident();
    let fmm = Fmm::builder(wave).tolerance(1e-6).leaf_size(30).build(&points, &points).unwrap();
    let exact = direct(&wave, &points, &charges, &points).unwrap();
    let error = relative_l2_error(&fmm.apply(&charges).unwrap(), &exact);
    assert!(error < 1e-6, "{error:e}");
    assert!(fmm.report().stats.expansion_pairs > 0);

    let rgb = from_fn(|x: DVec3, y: DVec3| (-x.distance(y)).exp()).charges::<[f64; 3]>();
    let charges: Vec<[f64; 3]> =
        (0..1500).map(|_| [random.unit(), random.unit(), random.unit()]).collect();
    let fmm = Fmm::builder(rgb).tolerance(1e-5).leaf_size(30).build(&points, &points).unwrap();
    let values = fmm.apply(&charges).unwrap();
    let exact = direct(&rgb, &points, &charges, &points).unwrap();
    assert!(relative_l2_error(&values, &exact) < 1e-5);
}

#[test]
fn single_precision() {
    let points: Vec<Vec3> = clouds::plummer(2000, 4).iter().map(|p| p.as_vec3()).collect();
    let charges: Vec<f32> = clouds::charges(2000, 2).iter().map(|&q| q as f32).collect();
    let kernel = single(|x, y| 1.0 / x.distance(y)).skip_coincident();
    let fmm = Fmm::builder(kernel).tolerance(1e-4).leaf_size(30).build(&points, &points).unwrap();
    let exact = direct(&kernel, &points, &charges, &points).unwrap();
    let error = relative_l2_error(&fmm.apply(&charges).unwrap(), &exact);
    assert!(error < 1e-4, "{error:e}");
}

#[test]
fn bad_input_gets_an_error_that_names_it() {
    let points = clouds::cube(10, 1);
    let kernel = plain(|x, y| 1.0 / x.distance(y));
    let build = |sources: &[DVec3], targets: &[DVec3]| {
        Fmm::builder(kernel).order(3).build(sources, targets).map(|_| ()).unwrap_err()
    };
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut spoilt = points.clone();
        spoilt[7].y = bad;
        for (set, error) in [
            (PointSet::Sources, build(&spoilt, &points)),
            (PointSet::Targets, build(&points, &spoilt)),
        ] {
            let named =
                matches!(error, Error::NonFinitePosition { set: s, index: 7, .. } if s == set);
            assert!(named, "{error}");
        }
    }
    let huge = [DVec3::ZERO, DVec3::X * 1e308, DVec3::X * -1e308];
    assert!(matches!(build(&huge, &points), Error::ExtentTooLarge { .. }));

    let refused = |builder: farfield::Builder<'static, Interpolation<_>, _>| {
        builder.build(&points, &points).map(|_| ()).unwrap_err()
    };
    let start = || Fmm::builder(kernel);
    assert_eq!(refused(start().leaf_size(0)), Error::InvalidLeafSize);
    for order in [0, 17] {
        let expected = Error::InvalidOrder { min: 1, max: 16, found: order };
        assert_eq!(refused(start().order(order)), expected);
    }
    for tolerance in [0.0, -1.0, 1.0, f64::INFINITY] {
        assert_eq!(
            refused(start().tolerance(tolerance)),
            Error::InvalidTolerance { found: tolerance }
        );
        let direct = refused(start().tolerance(tolerance).scheme(Scheme::Direct));
        assert_eq!(direct, Error::InvalidTolerance { found: tolerance });
    }
    assert!(matches!(refused(start().tolerance(f64::NAN)), Error::InvalidTolerance { .. }));

    let fmm = start().order(3).build(&points, &points).unwrap();
    let mismatch = Error::LengthMismatch { what: "charges", expected: 10, found: 9 };
    assert_eq!(fmm.apply(&[1.0; 9]), Err(mismatch));
    let mut charges = [1.0; 10];
    charges[3] = f64::NAN;
    assert!(matches!(fmm.apply(&charges), Err(Error::NonFiniteCharge { index: 3, .. })));
    // 1/r at coincident points: the kernel's fault, and said so.
    assert!(matches!(fmm.apply(&[1.0; 10]), Err(Error::NonFiniteValue { index: 0, .. })));
}

#[test]
fn what_expansions_cannot_reach_is_summed_directly_and_what_no_sum_can_is_refused() {
    let points = clouds::cube(4000, 1);
    let kernel = plain(|x, y| (20.0 * x.distance(y)).cos());
    let build = |tolerance| {
        Fmm::builder(kernel).tolerance(tolerance).leaf_size(400).build(&points, &points)
    };
    let fmm = build(1e-13).unwrap();
    let stats = fmm.report().stats;
    assert_eq!(stats.scheme, Scheme::Direct);
    assert!(stats.fallback.is_some_and(|why| why.contains("1e-13")), "a wave of many periods");
    assert_eq!(build(1e-2).unwrap().report().stats.scheme, Scheme::Fmm);
    let Err(Error::UnreachableTolerance { requested, reachable }) = build(1e-16) else {
        panic!("direct sums round as well");
    };
    assert!(requested == 1e-16 && reachable > requested && reachable < 1e-4, "{reachable:e}");
}

#[test]
fn the_memory_of_a_plan_is_accounted_for() {
    let (points, others) = (clouds::cube(4000, 1), clouds::cube(1000, 2));
    let stats = |sources: &[DVec3], targets: &[DVec3]| {
        let plan = Fmm::with_expansion(Counting::<f64>::new()).leaf_size(20);
        plan.build(sources, targets).unwrap().report().stats.clone()
    };
    let [alone, shared, apart] =
        [stats(&points, &[]), stats(&points, &points), stats(&points, &others)];
    let point = size_of::<DVec3>();
    let index = size_of::<u32>();
    assert_eq!(
        shared.tree_bytes - alone.tree_bytes,
        4000 * (point + index),
        "one tree serves both"
    );
    assert!(apart.tree_bytes > alone.tree_bytes + 1000 * (point + 2 * index));
    let pairs = |stats: &Stats| stats.cell_pairs.iter().sum::<u64>() as usize;
    assert!(shared.list_bytes > pairs(&shared) * index);
    // Charges, values, and one term of either kind for every cell below the second level.
    assert!(shared.workspace_bytes > 8 * (2 * 4000 + 2 * (shared.cells - 73)));
    assert!(shared.workspace_bytes <= 8 * (2 * 4000 + 2 * shared.cells));
    let bytes = shared.plan_bytes() + shared.workspace_bytes;
    assert_eq!(shared.bytes_per_point(), bytes as f64 / 4000.0);
}
