//! What an outsider brings: masks on the public interface alone.

use farfield::{CellView, Coverage, Fmm, Kernel, Located, Mask, direct_masked, relative_l2_error};
use farfield_testing::clouds;
use glam::DVec3;

use crate::plain;

/// Only pairs with x to the right of y count; never certifies anything.
struct ToTheRight;

impl<K: Kernel<Real = f64>> Mask<K> for ToTheRight {
    fn cells(&self, _: CellView<'_, K::Target>, _: CellView<'_, K::Source>) -> Coverage {
        Coverage::Partial
    }
    fn pair(&self, x: &K::Target, y: &K::Source) -> f64 {
        f64::from(x.position().x > y.position().x)
    }
}

#[test]
fn a_mask_that_never_certifies_is_slow_but_right() {
    let points = clouds::cube(700, 1);
    let charges = clouds::charges(700, 2);
    let kernel = plain(|x, y| (x - y).length());
    let exact = direct_masked(&kernel, &ToTheRight, &points, &charges, &points).unwrap();
    let fmm = Fmm::builder(kernel).mask(ToTheRight).leaf_size(9).build(&points, &points).unwrap();
    assert_eq!(fmm.report().stats.expansion_pairs, 0);
    assert_eq!(fmm.report().stats.direct_pairs, 700 * 699 / 2);
    assert!(relative_l2_error(&fmm.apply(&charges).unwrap(), &exact) < 1e-13);
}

/// Well-separated cells of one level count by eighths, all other pairs in full.
struct Weighed(u8);

impl<K: Kernel<Real = f64>> Mask<K> for Weighed {
    fn cells(&self, t: CellView<'_, K::Target>, s: CellView<'_, K::Source>) -> Coverage {
        if t.cell.level() != s.cell.level() || !t.cell.well_separated(s.cell) {
            return Coverage::Partial;
        }
        match self.0 {
            0 => Coverage::Empty,
            8 => Coverage::Full,
            eighths => Coverage::Eighths(eighths),
        }
    }
    fn pair(&self, _: &K::Target, _: &K::Source) -> f64 {
        1.0
    }
}

#[test]
fn eighths_weigh_what_expansions_carry() {
    let points = clouds::cube(3000, 1);
    let charges = clouds::charges(3000, 2);
    // One kernel with operators by offset, one whose M2L goes through the kernel itself.
    let inverse = plain(|x, y| 1.0 / x.distance(y)).skip_coincident();
    let drifting = plain(|x, y| (1.0 + x.x) / (1.0 + x.distance(y)));
    // The latter costs far more, and what is weighed is linear at any accuracy.
    for (kernel, order) in [(inverse, None), (drifting, Some(4))] {
        let sum = |eighths: u8| {
            let builder = Fmm::builder(kernel);
            let builder = match order {
                Some(order) => builder.order(order),
                None => builder.tolerance(1e-6),
            };
            let plan = builder.mask(Weighed(eighths)).leaf_size(10);
            let fmm = plan.build(&points, &points).unwrap();
            assert_eq!(fmm.report().stats.cell_pairs[0] > 0, eighths > 0);
            fmm.apply(&charges).unwrap()
        };
        let (near, all) = (sum(0), sum(8));
        assert!(relative_l2_error(&near, &all) > 0.01);
        for eighths in [1, 3, 7] {
            let weight = f64::from(eighths) / 8.0;
            let mix = |(n, a): (&f64, &f64)| n + weight * (a - n);
            let expected: Vec<f64> = near.iter().zip(&all).map(mix).collect();
            assert!(relative_l2_error(&sum(eighths), &expected) < 1e-9);
        }
    }
}

/// Whether the sum of two positions lies on one side of a plane: the same from either end.
struct Symmetric {
    mirrored: bool,
    asked: std::sync::atomic::AtomicUsize,
}

impl Mask<farfield::FnKernel<fn(DVec3, DVec3) -> f64, DVec3, f64>> for Symmetric {
    fn cells(&self, _: CellView<'_, DVec3>, _: CellView<'_, DVec3>) -> Coverage {
        Coverage::Partial
    }
    fn pair(&self, x: &DVec3, y: &DVec3) -> f64 {
        self.asked.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        f64::from((*x + *y).x > 0.3)
    }
    fn is_mirrored(&self, _: &[DVec3], _: &[DVec3]) -> bool {
        self.mirrored
    }
}

#[test]
fn mirrored_pairs_are_asked_for_once_and_count_twice() {
    let points = clouds::plummer(900, 1);
    let charges = clouds::charges(900, 2);
    let kernel = plain(|x, y| (x - y).length());
    let sum = |mirrored| {
        let mask = Symmetric { mirrored, asked: Default::default() };
        let fmm = Fmm::builder(kernel).mask(&mask).leaf_size(13).build(&points, &points).unwrap();
        (fmm.apply(&charges).unwrap(), mask.asked.into_inner())
    };
    let ((whole, all), (halved, asked)) = (sum(false), sum(true));
    assert_eq!(whole, halved);
    assert_eq!(all, 900 * 900);
    assert!(asked < all * 11 / 20, "{asked}");
}

/// Pairs count in part: by a share that depends on both points, the same from either end.
struct Veiled {
    mirrored: bool,
}

impl Veiled {
    fn share(x: DVec3, y: DVec3) -> f64 {
        let clear = 1.5 * (x.x + y.x) - 0.2;
        clear.clamp(0.0, 1.0)
    }
}

impl<K: Kernel<Real = f64>> Mask<K> for Veiled {
    fn cells(&self, t: CellView<'_, K::Target>, s: CellView<'_, K::Source>) -> Coverage {
        let most = |view: &[f64]| view.iter().copied().fold(f64::MIN, f64::max);
        let least = |view: &[f64]| view.iter().copied().fold(f64::MAX, f64::min);
        let xs: Vec<f64> = t.points.iter().map(|x| x.position().x).collect();
        let ys: Vec<f64> = s.points.iter().map(|y| y.position().x).collect();
        if 1.5 * (least(&xs) + least(&ys)) - 0.2 >= 1.0 {
            Coverage::Full
        } else if 1.5 * (most(&xs) + most(&ys)) - 0.2 <= 0.0 {
            Coverage::Empty
        } else {
            Coverage::Partial
        }
    }
    fn pair(&self, x: &K::Target, y: &K::Source) -> f64 {
        Self::share(x.position(), y.position())
    }
    fn is_mirrored(&self, _: &[K::Target], _: &[K::Source]) -> bool {
        self.mirrored
    }
}

#[test]
fn pairs_that_count_in_part_are_weighed() {
    let points = clouds::cube(1500, 1);
    let charges = clouds::charges(1500, 2);
    let kernel = plain(|x, y| 1.0 / x.distance(y)).skip_coincident();
    let mut exact = vec![0.0; points.len()];
    for (x, u) in points.iter().zip(&mut exact) {
        for (y, q) in points.iter().zip(&charges).filter(|(y, _)| x != *y) {
            *u += Veiled::share(*x, *y) / x.distance(*y) * q;
        }
    }
    let veil = Veiled { mirrored: false };
    let masked = direct_masked(&kernel, &veil, &points, &charges, &points).unwrap();
    assert!(relative_l2_error(&masked, &exact) < 1e-13);
    let sum = |mirrored| {
        let builder = Fmm::builder(kernel).mask(Veiled { mirrored }).tolerance(1e-6).leaf_size(15);
        builder.build(&points, &points).unwrap()
    };
    let fmm = sum(false);
    assert!(fmm.report().stats.expansion_pairs > 0 && fmm.report().stats.mask_bytes > 0);
    let values = fmm.apply(&charges).unwrap();
    assert!(relative_l2_error(&values, &exact) < 1e-6);
    assert_eq!(sum(true).apply(&charges).unwrap(), values, "mirrored answers are the same");
    let (_, certificate) = fmm.apply_certified(&charges).unwrap();
    assert!(certificate.estimate < 1e-6, "shares are seen: {certificate:?}");

    // Sets of their own trees, and leaves in which no pair counts in full.
    let targets = clouds::plummer(400, 3);
    let masked = direct_masked(&kernel, &veil, &points, &charges, &targets).unwrap();
    let fmm = Fmm::builder(kernel).mask(&veil).tolerance(1e-6).leaf_size(15);
    let values = fmm.build(&points, &targets).unwrap().apply(&charges).unwrap();
    assert!(relative_l2_error(&values, &masked) < 1e-6);
}

/// Says of one pair that it counts by something that is not a share.
struct Wrong(f64);

impl<K: Kernel<Real = f64>> Mask<K> for Wrong {
    fn cells(&self, _: CellView<'_, K::Target>, _: CellView<'_, K::Source>) -> Coverage {
        Coverage::Partial
    }
    fn pair(&self, x: &K::Target, y: &K::Source) -> f64 {
        let marked = x.position().x == 7.0 && y.position().x == 3.0;
        if marked { self.0 } else { 1.0 }
    }
}

#[test]
fn what_is_no_share_is_refused_with_its_pair() {
    let points: Vec<DVec3> = (0..100).map(|i| DVec3::new(f64::from(i), 0.0, 0.0)).collect();
    let kernel = plain(|x, y| x.distance(y));
    for wrong in [-0.1, 1.5, f64::NAN, f64::INFINITY] {
        let built = Fmm::builder(kernel).mask(Wrong(wrong)).leaf_size(9).build(&points, &points);
        let refused = built.map(|_| ()).unwrap_err();
        assert!(
            matches!(refused, farfield::Error::InvalidShare { target: 7, from: 3, .. }),
            "{refused}"
        );
    }
}
