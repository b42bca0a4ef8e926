//! The certificate of an application against the error that it speaks of.

use farfield::{
    CellView, Certificate, Coverage, Error, Fmm, Kernel, Located, Mask, Sampling, Scheme, Watch,
    direct, direct_masked, from_fn, relative_l2_error,
};
use farfield_testing::clouds::{self, Random};
use glam::{DVec3, Vec3};

use crate::{plain, single};

/// Charges of the kinds that sums are made of: of either sign, of one, or few and large.
fn charges(n: usize, seed: u64) -> Vec<f64> {
    let mut random = Random::new(seed);
    let charge = |i: usize| match seed % 3 {
        0 => random.between(-1.0, 1.0),
        1 => random.between(0.0, 1.0),
        _ if i.is_multiple_of(97) => random.between(-100.0, 100.0),
        _ => random.between(-1.0, 1.0),
    };
    (0..n).map(charge).collect()
}

/// 1/r, but nothing of a point on itself.
fn inverse(x: DVec3, y: DVec3) -> f64 {
    1.0 / x.distance(y)
}

#[test]
fn the_bound_holds_in_a_thousand_trials_and_is_tight() {
    const POINTS: usize = 1600;
    let kernel = from_fn(inverse).skip_coincident();
    let (mut missed, mut ratios, mut squares) = (0, Vec::new(), 0.0);
    for (seed, tolerance) in (0..).zip([1e-2, 1e-3, 1e-4, 1e-5, 1e-6]) {
        let clouds = [
            clouds::cube(POINTS, seed),
            clouds::sphere(POINTS, seed),
            clouds::plummer(POINTS, seed),
            clouds::line(POINTS, seed),
            clouds::two_clusters(POINTS, seed),
        ];
        for points in &clouds {
            let builder = Fmm::builder(kernel).tolerance(tolerance).leaf_size(16);
            let fmm = builder.build(points, points).unwrap();
            for trial in 0..40 {
                let charges = charges(POINTS, 1000 * seed + trial);
                let sampling = Sampling { seed: trial, max_samples: 512, ..Sampling::default() };
                let (values, certificate) = fmm.apply_certified_by(&charges, &sampling).unwrap();
                assert!((100..=512).contains(&certificate.samples));
                let exact = direct(&kernel, points, &charges, points).unwrap();
                let error = relative_l2_error(&values, &exact);
                missed += usize::from(error > certificate.relative_l2);
                ratios.push(certificate.relative_l2 / error);
                squares += (certificate.estimate / error).powi(2) / 1000.0;
            }
        }
    }
    ratios.sort_by(f64::total_cmp);
    let quantile = |q: usize| ratios[q * (ratios.len() - 1) / 100];
    println!(
        "{missed} of {} bounds missed; bound / error: least {:.2}, median {:.2}, 99 % {:.2}; mean square of estimate / error {squares:.4}",
        ratios.len(),
        quantile(0),
        quantile(50),
        quantile(99)
    );
    assert_eq!(ratios.len(), 1000);
    assert!(missed <= 10, "{missed} bounds are below the error");
    assert!((0.98..1.02).contains(&squares), "estimates are biased: {squares}");
    assert!(quantile(50) < 2.0 && quantile(99) < 8.0);
}

#[test]
fn more_targets_are_drawn_until_the_bound_is_tight() {
    let points = clouds::plummer(6000, 3);
    let charges = charges(points.len(), 0);
    let kernel = from_fn(inverse).skip_coincident();
    let fmm = Fmm::builder(kernel).tolerance(1e-3).leaf_size(30).build(&points, &points).unwrap();
    let plain = fmm.apply(&charges).unwrap();
    let error = relative_l2_error(&plain, &direct(&kernel, &points, &charges, &points).unwrap());
    let certificate = |tightness, max_samples| {
        let sampling = Sampling { tightness, max_samples, ..Sampling::default() };
        let (values, certificate) = fmm.apply_certified_by(&charges, &sampling).unwrap();
        assert_eq!(values, plain);
        assert!(certificate.relative_l2 >= error * (1.0 - 1e-9));
        certificate
    };
    let few = certificate(100.0, 4096);
    assert!(few.samples <= 512 && few.confidence == 0.99);
    let many = certificate(1.3, 2048);
    assert!(many.samples > 512 && many.samples <= 2048);
    assert!(many.relative_l2 < few.relative_l2);
    assert!((0.7..1.4).contains(&(many.estimate / error)));
    let all = certificate(1.0, 6000);
    assert_eq!((all.samples, all.targets, all.confidence), (6000, 6000, 1.0));
    assert!((all.relative_l2 / error - 1.0).abs() < 1e-9, "{all:?}: {error:e}");
    assert!(all.max_relative >= 0.999 * many.max_relative && many.max_relative > many.estimate);
}

/// Pairs whose positions lie on different sides of the plane z = 1/2 don't count.
struct SameSide;

impl SameSide {
    fn above(point: &impl Located<Real = f64>) -> bool {
        point.position().z > 0.5
    }

    /// Whether all points are above the plane; none if they lie on both sides of it.
    fn side(points: &[impl Located<Real = f64>]) -> Option<bool> {
        let above = Self::above(&points[0]);
        points.iter().all(|p| Self::above(p) == above).then_some(above)
    }
}

impl<K: Kernel<Real = f64>> Mask<K> for SameSide {
    fn cells(
        &self,
        targets: CellView<'_, K::Target>,
        sources: CellView<'_, K::Source>,
    ) -> Coverage {
        match (Self::side(targets.points), Self::side(sources.points)) {
            (Some(x), Some(y)) if x == y => Coverage::Full,
            (Some(_), Some(_)) => Coverage::Empty,
            _ => Coverage::Partial,
        }
    }

    fn pair(&self, x: &K::Target, y: &K::Source) -> f64 {
        f64::from(Self::above(x) == Self::above(y))
    }
}

#[test]
fn masked_pairs_are_left_out_of_the_direct_sums() {
    let (points, targets) = (clouds::cube(1500, 4), clouds::cube(900, 5));
    let charges = charges(points.len(), 1);
    let kernel = from_fn(inverse);
    for scheme in [Scheme::Fmm, Scheme::Treecode { m2m: true }] {
        let builder = Fmm::builder(kernel).tolerance(1e-4).leaf_size(10).scheme(scheme);
        let fmm = builder.mask(SameSide).build(&points, &targets).unwrap();
        let (values, certificate) = fmm.apply_certified(&charges).unwrap();
        let exact = direct_masked(&kernel, &SameSide, &points, &charges, &targets).unwrap();
        let error = relative_l2_error(&values, &exact);
        assert!(error < 1e-4);
        let difference = certificate.relative_l2 - error;
        assert!(difference.abs() < 1e-6 * error + 1e-14, "{certificate:?}: {error:e}");
        assert_eq!(certificate.far > 0.0, scheme == Scheme::Fmm);
    }
}

#[test]
fn shares_that_a_mask_gives_are_what_is_judged() {
    struct Half;
    impl<K: Kernel> Mask<K> for Half {
        fn cells(&self, _: CellView<'_, K::Target>, _: CellView<'_, K::Source>) -> Coverage {
            Coverage::Eighths(4)
        }
        fn pair(&self, _: &K::Target, _: &K::Source) -> f64 {
            1.0
        }
    }
    let points = clouds::cube(1000, 6);
    let builder = Fmm::builder(from_fn(inverse).skip_coincident()).tolerance(1e-5);
    let fmm = builder.leaf_size(8).mask(Half).build(&points, &points).unwrap();
    let (_, certificate) = fmm.apply_certified(&charges(points.len(), 1)).unwrap();
    assert!((1e-12..1e-5).contains(&certificate.relative_l2), "{certificate:?}");
}

#[test]
fn near_and_far_field_have_their_parts() {
    let points = clouds::cube(1000, 7);
    let charges = charges(points.len(), 0);
    let kernel = from_fn(inverse).skip_coincident();
    let certificate = |scheme| {
        let builder = Fmm::builder(kernel).order(3).leaf_size(20).scheme(scheme);
        builder.build(&points, &points).unwrap().apply_certified(&charges).unwrap().1
    };
    let Certificate { near, far, estimate, .. } = certificate(Scheme::Fmm);
    assert!(near < 1e-12 && far > 1e-4 && (far / estimate - 1.0).abs() < 1e-6);
    let direct = certificate(Scheme::Direct);
    assert!(direct.far == 0.0 && direct.near == direct.estimate);
    assert!(direct.relative_l2 < 1e-12 && direct.relative_l2 >= direct.near);
    assert!(direct.round_off < 1e-25);
}

#[test]
fn cancellation_shows_in_the_condition_number() {
    let points = clouds::cube(1200, 8);
    let mut charges = charges(points.len(), 1);
    let total: f64 = charges.iter().sum();
    charges[0] -= total;
    // Nearly constant: what is left when the charges cancel is a small part of Σ|K||q|.
    let kernel = plain(|x, y| 1.0 / (30.0 + x.distance(y)));
    let fmm = Fmm::builder(kernel).tolerance(1e-6).leaf_size(20).build(&points, &points).unwrap();
    let (values, certificate) = fmm.apply_certified(&charges).unwrap();
    let exact = direct(&kernel, &points, &charges, &points).unwrap();
    let magnitudes: Vec<f64> = charges.iter().map(|q| q.abs()).collect();
    let absolute = direct(&kernel, &points, &magnitudes, &points).unwrap();
    let norm = |u: &[f64]| u.iter().map(|u| u * u).sum::<f64>().sqrt();
    let condition = norm(&absolute) / norm(&exact);
    assert!(condition > 30.0 && (certificate.condition / condition - 1.0).abs() < 1e-6);
    let backward = relative_l2_error(&values, &exact) / condition;
    assert!((certificate.backward_error() / backward - 1.0).abs() < 1e-6);
    assert!(certificate.backward_error() < 1e-6);
}

#[test]
fn single_precision_is_judged_in_double_words() {
    let points = clouds::cube(1024, 9);
    let narrow: Vec<Vec3> = points.iter().map(|p| p.as_vec3()).collect();
    let kernel = single(|x, y| 1.0 / (0.1 + x.distance(y)));
    let builder = Fmm::builder(kernel).leaf_size(20).tolerance(1e-5);
    let fmm = builder.build(&narrow, &narrow).unwrap();
    let (values, certificate) = fmm.apply_certified(&vec![1.0; 1024]).unwrap();
    let exact = |x: &Vec3| narrow.iter().map(|y| f64::from(1.0 / (0.1 + x.distance(*y)))).sum();
    let exact: Vec<f64> = narrow.iter().map(exact).collect();
    let values: Vec<f64> = values.into_iter().map(f64::from).collect();
    let error = relative_l2_error(&values, &exact);
    assert!((certificate.estimate / error - 1.0).abs() < 1e-3, "{certificate:?}: {error:e}");
    assert!(certificate.round_off < 1e-10 && certificate.round_off > 0.0);
}

#[test]
fn empty_and_vanishing_sums_have_no_error() {
    let kernel = from_fn(inverse).skip_coincident();
    let points = clouds::cube(3000, 10);
    let none: [DVec3; 0] = [];
    let certificate = |sources: &[DVec3], targets: &[DVec3]| {
        let fmm = Fmm::builder(kernel).tolerance(1e-3).build(sources, targets).unwrap();
        fmm.apply_certified(&vec![0.0; sources.len()]).unwrap().1
    };
    for certificate in [
        certificate(&points, &points),
        certificate(&none, &points),
        certificate(&points, &none),
        certificate(&none, &none),
    ] {
        assert_eq!((certificate.relative_l2, certificate.estimate), (0.0, 0.0));
        assert_eq!((certificate.condition, certificate.backward_error()), (1.0, 0.0));
    }
}

#[test]
fn rules_that_cannot_be_followed_are_refused() {
    let points = clouds::cube(10, 11);
    let fmm = Fmm::builder(from_fn(inverse).skip_coincident()).build(&points, &points).unwrap();
    let refused = |sampling: Sampling| match fmm.apply_certified_by(&[1.0; 10], &sampling) {
        Err(Error::InvalidSampling { what, .. }) => what,
        other => panic!("{other:?}"),
    };
    let default = Sampling::default();
    assert_eq!(refused(Sampling { confidence: 1.0, ..default }), "confidence");
    assert_eq!(refused(Sampling { confidence: f64::NAN, ..default }), "confidence");
    assert_eq!(refused(Sampling { tightness: 0.9, ..default }), "tightness");
    assert_eq!(refused(Sampling { max_samples: 1, ..default }), "max_samples");
    let lengths = fmm.apply_certified(&[1.0; 9]);
    assert!(matches!(lengths, Err(Error::LengthMismatch { expected: 10, found: 9, .. })));
}

#[test]
fn a_certificate_can_be_stopped() {
    let points = clouds::cube(5000, 1);
    let fmm = Fmm::builder(plain(inverse).skip_coincident()).tolerance(1e-3);
    let fmm = fmm.build(&points, &points).unwrap();
    let (charges, watch) = (charges(points.len(), 1), Watch::new());
    let certified = || fmm.apply_certified_watched(&charges, &Sampling::default(), &watch);
    let before = certified().unwrap();
    watch.stop();
    assert_eq!(certified().unwrap_err(), Error::Stopped);
    assert_eq!(fmm.apply_certified(&charges).unwrap(), before);
}
