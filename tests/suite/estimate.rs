//! What plans are said to cost against what they do.

use farfield::conformance::Counting;
use farfield::{CellView, Coverage, Error, Fmm, FnKernel, Kernel, Mask, Scheme};
use farfield_testing::clouds;
use glam::DVec3;

use crate::{Formula, plain};

fn inverse() -> FnKernel<Formula<DVec3, f64>, DVec3, f64> {
    plain(|x, y| 1.0 / x.distance(y)).skip_coincident()
}

/// Asserts that a number foretold is right within a factor.
fn close(what: &str, foretold: f64, found: f64, factor: f64) {
    let ratio = foretold / found;
    assert!(ratio < factor && ratio > 1.0 / factor, "{what}: {foretold:e} instead of {found:e}");
}

#[test]
fn bytes_and_pairs_are_foretold_within_a_half() {
    let n = 20_000;
    let clouds = [
        ("cube", clouds::cube(n, 1)),
        ("sphere", clouds::sphere(n, 2)),
        ("plummer", clouds::plummer(n, 3)),
        ("two clusters", clouds::two_clusters(n, 4)),
    ];
    for (name, points) in &clouds {
        for (tolerance, leaf_size, targets) in
            [(1e-3, 40, n), (1e-6, 60, n), (1e-6, 60, n / 2), (1e-4, 200, n)]
        {
            let builder = Fmm::builder(inverse()).tolerance(tolerance).leaf_size(leaf_size);
            let targets = &points[..targets];
            let estimate = builder.estimate(points, targets).unwrap();
            let fmm = builder.build(points, targets).unwrap();
            let stats = fmm.report().stats;
            let what = format!("{name}, {tolerance:e}, leaf size {leaf_size}");
            let bytes = stats.plan_bytes() + stats.workspace_bytes;
            close(&what, estimate.bytes() as f64, bytes as f64, 1.5);
            close(&what, estimate.plan_bytes as f64, stats.plan_bytes() as f64, 1.25);
            if targets.len() == points.len() {
                close(&what, estimate.direct_pairs, stats.direct_pairs as f64, 1.5);
            }
            assert_eq!((estimate.cells, estimate.leaf_size), (stats.cells, leaf_size));
        }
    }
}

#[test]
fn masks_and_schemes_are_foretold() {
    /// Sources below the plane z = 0.45 don't count.
    struct Above;
    impl<K: Kernel<Real = f64>> Mask<K> for Above {
        fn cells(&self, _: CellView<'_, K::Target>, sources: CellView<'_, K::Source>) -> Coverage {
            let (low, high) = (sources.cell.normalised(DVec3::Z * 0.45).z, 1.0);
            match low {
                _ if low < -high => Coverage::Full,
                _ if low > high => Coverage::Empty,
                _ => Coverage::Partial,
            }
        }
        fn pair(&self, _: &K::Target, y: &K::Source) -> f64 {
            f64::from(farfield::Located::position(y).z >= 0.45)
        }
    }
    let points = clouds::cube(10_000, 5);
    let builder = Fmm::builder(inverse()).tolerance(1e-4).leaf_size(30).mask(Above);
    let estimate = builder.estimate(&points, &points).unwrap();
    let stats = builder.build(&points, &points).unwrap().report().stats.clone();
    close(
        "masked",
        estimate.bytes() as f64,
        (stats.plan_bytes() + stats.workspace_bytes) as f64,
        1.5,
    );
    assert!(estimate.asked_pairs > 0.0 && stats.mask_bytes > 0);

    for scheme in [Scheme::Direct, Scheme::Treecode { m2m: true }] {
        let builder = Fmm::with_expansion(Counting::<f64>::new()).leaf_size(30).scheme(scheme);
        let estimate = builder.estimate(&points, &points).unwrap();
        let stats = builder.build(&points, &points).unwrap().report().stats.clone();
        let bytes = stats.plan_bytes() + stats.workspace_bytes;
        close(&format!("{scheme:?}"), estimate.bytes() as f64, bytes as f64, 1.5);
        assert_eq!(estimate.far_seconds > 0.0, scheme != Scheme::Direct);
        let near = estimate.near_seconds / estimate.direct_seconds;
        assert_eq!(near > 0.8, scheme == Scheme::Direct, "{scheme:?}: {near}");
    }
}

#[test]
fn a_memory_budget_admits_and_refuses() {
    let points = clouds::cube(5000, 6);
    let builder = || Fmm::builder(inverse()).tolerance(1e-3).leaf_size(30);
    let estimate = builder().estimate(&points, &points).unwrap();
    assert!(builder().memory_budget(estimate.bytes()).build(&points, &points).is_ok());
    match builder().memory_budget(estimate.bytes() - 1).build(&points, &points) {
        Err(Error::OverMemoryBudget { budget, needed }) => {
            assert_eq!(budget, estimate.bytes() - 1);
            assert_eq!(needed, estimate.bytes());
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn empty_sets_have_estimates() {
    let (points, none) = (clouds::cube(100, 7), [DVec3::ZERO; 0]);
    for (sources, targets) in [(&points[..], &none[..]), (&none, &points), (&none, &none)] {
        let estimate = Fmm::builder(inverse()).estimate(sources, targets).unwrap();
        assert_eq!((estimate.direct_pairs, estimate.apply_seconds()), (0.0, 0.0));
        assert!(estimate.plan_seconds.is_finite());
    }
    let not_finite = [DVec3::NAN];
    let refused = Fmm::builder(inverse()).estimate(&points, &not_finite);
    assert!(matches!(refused, Err(Error::NonFinitePosition { index: 0, .. })));
}
