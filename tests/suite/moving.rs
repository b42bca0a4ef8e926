//! Plans that are given other points: as exact as plans that are built, without operators of their own.

use farfield::conformance::Counting;
use farfield::{
    CellView, Coverage, Error, Fmm, FnKernel, Interpolation, Mask, OperatorStore, direct_masked,
    relative_l2_error,
};
use farfield_testing::clouds::{charges, cube};
use glam::DVec3;

use crate::any_kernel::{Formula, error, plain};

type Plan = Fmm<Interpolation<FnKernel<Formula, DVec3, f64>>>;

const INVERSE: Formula = |x, y| 1.0 / x.distance(y);
const YUKAWA: Formula = |x, y| (-2.0 * x.distance(y)).exp() / x.distance(y);
const STEEP: Formula = |x, y| x.distance_squared(y).powi(-2);

/// A plan whose operators nobody else has, and that finds none in a store.
fn plan(formula: Formula, tolerance: f64, points: &[DVec3]) -> Plan {
    let builder = Fmm::builder(plain(formula)).operator_store(&OperatorStore::new(0));
    builder.tolerance(tolerance).leaf_size(40).build(points, points).unwrap()
}

/// Asserts that a plan keeps its tolerance, by expansions.
fn check(fmm: &Plan, formula: Formula, tolerance: f64, points: &[DVec3], what: &str) {
    let qs = charges(points.len(), 9);
    let stats = fmm.report().stats;
    assert!(stats.expansion_pairs > stats.direct_pairs / 4, "{what}: {stats:?}");
    let error = error(formula, points, &qs, &fmm.apply(&qs).unwrap());
    assert!(error <= tolerance, "{what}: {error:e}");
}

/// Levels of a plan with M2L of their own.
fn levels(fmm: &Plan) -> usize {
    fmm.report().levels.iter().filter(|level| level.m2l_pairs > 0).count()
}

/// The points after a while, within the unit cube.
fn moved(points: &[DVec3], by: f64) -> Vec<DVec3> {
    let step = |(i, p): (usize, &DVec3)| {
        let t = i as f64;
        let p = *p + by * DVec3::new(t.sin(), (1.3 * t).cos(), (2.1 * t).sin());
        p.clamp(DVec3::splat(1e-4), DVec3::splat(1.0 - 1e-4))
    };
    points.iter().enumerate().map(step).collect()
}

#[test]
fn small_moves_build_no_operators() {
    for (formula, tolerance) in [(INVERSE, 1e-5), (YUKAWA, 1e-4)] {
        let mut points = cube(4000, 1);
        let mut fmm = plan(formula, tolerance, &points);
        let built = fmm.expansion().built_levels();
        assert!(built > 0);
        for step in 0..3 {
            points = moved(&points, 0.01);
            fmm.update(&points, &points).unwrap();
            assert_eq!(fmm.expansion().built_levels(), 0, "step {step}");
            check(&fmm, formula, tolerance, &points, "moved");
        }
    }
}

#[test]
fn operators_of_all_sizes_are_kept_and_others_are_those_of_new_levels() {
    let mut points = cube(4000, 2);
    let mut fmm = plan(INVERSE, 1e-4, &points);
    for factor in [3.0, 5.5, 7.0, 1e-5] {
        points = points.iter().map(|p| *p * factor + 0.1 * DVec3::ONE).collect();
        fmm.update(&points, &points).unwrap();
        assert_eq!(fmm.expansion().built_levels(), 0, "{factor}");
        check(&fmm, INVERSE, 1e-4, &points, "scaled");
    }

    let mut points = cube(6000, 2);
    let mut fmm = plan(YUKAWA, 1e-4, &points);
    let before = levels(&fmm);
    assert!(before > 1 && fmm.expansion().built_levels() >= before);
    for factor in [1.5, 1.5, 0.5] {
        points = points.iter().map(|p| *p * factor).collect();
        fmm.update(&points, &points).unwrap();
        let built = fmm.expansion().built_levels();
        assert!(built <= 1, "{built} of {} levels at {factor}", levels(&fmm));
        check(&fmm, YUKAWA, 1e-4, &points, "scaled");
    }
}

#[test]
fn the_tolerance_holds_whatever_shape_points_take() {
    for (formula, tolerance) in [(INVERSE, 1e-6), (STEEP, 1e-4), (YUKAWA, 1e-4)] {
        let cloud = cube(2500, 3);
        let mut fmm = plan(formula, tolerance, &cloud);
        for thin in [0.3, 0.05, 1e-3, 0.0] {
            let rod: Vec<DVec3> = cloud.iter().map(|p| *p * DVec3::new(1.0, thin, thin)).collect();
            fmm.update(&rod, &rod).unwrap();
            check(&fmm, formula, tolerance, &rod, &format!("rod of {thin}"));
        }
        for apart in [0.5, 3.0, 100.0] {
            let side = |i: usize| {
                DVec3::new(1.0, 0.7, 0.1) * if i.is_multiple_of(2) { apart } else { 0.0 }
            };
            let two: Vec<DVec3> = cloud.iter().enumerate().map(|(i, p)| *p + side(i)).collect();
            fmm.update(&two, &two).unwrap();
            check(&fmm, formula, tolerance, &two, &format!("two, {apart} apart"));
        }
    }
}

#[test]
fn sums_are_those_of_a_plan_that_is_built() {
    let first = cube(3000, 4);
    let mut second = moved(&first, 1e-3);
    // The box stays what it was.
    second[..500].copy_from_slice(&first[..500]);
    let low = first.iter().fold(DVec3::MAX, |low, p| low.min(*p));
    let high = first.iter().fold(DVec3::MIN, |high, p| high.max(*p));
    second.iter_mut().for_each(|p| *p = p.clamp(low, high));
    second.extend([low, high]);
    let mut fmm = plan(INVERSE, 1e-6, &first);
    fmm.update(&second, &second).unwrap();
    let qs = charges(second.len(), 5);
    let built = plan(INVERSE, 1e-6, &second).apply(&qs).unwrap();
    assert_eq!(fmm.apply(&qs).unwrap(), built);
}

#[test]
fn what_can_not_be_summed_leaves_the_plan_as_it_was() {
    let points = cube(2000, 6);
    let qs = charges(2000, 7);
    let mut fmm = plan(INVERSE, 1e-4, &points);
    let before = fmm.apply(&qs).unwrap();
    let mut broken = points.clone();
    broken[17].y = f64::NAN;
    let refused = fmm.update(&points, &broken);
    assert!(matches!(refused, Err(Error::NonFinitePosition { index: 17, .. })), "{refused:?}");
    broken[17].y = f64::MAX;
    broken[18].y = f64::MIN;
    let refused = fmm.update(&broken, &points);
    assert!(matches!(refused, Err(Error::ExtentTooLarge { .. })), "{refused:?}");
    assert_eq!(fmm.apply(&qs).unwrap(), before);
    // More of them, and none.
    let more = cube(3000, 8);
    fmm.update(&more, &points).unwrap();
    assert_eq!(fmm.apply(&charges(3000, 1)).unwrap().len(), 2000);
    fmm.update(&[], &points).unwrap();
    assert_eq!(fmm.apply(&[]).unwrap(), vec![0.0; 2000]);
    fmm.update(&points, &points).unwrap();
    assert_eq!(fmm.apply(&qs).unwrap(), before);
}

/// Points on one side of a plane see each other.
struct Wall(f64);

impl<K: farfield::Kernel<Source = DVec3, Target = DVec3, Real = f64>> Mask<K> for Wall {
    fn cells(&self, targets: CellView<'_, DVec3>, sources: CellView<'_, DVec3>) -> Coverage {
        let sides = targets.points.iter().chain(sources.points).map(|p| p.x > self.0);
        let right = sides.clone().filter(|&right| right).count();
        if right == 0 || right == sides.count() { Coverage::Full } else { Coverage::Partial }
    }

    fn pair(&self, x: &DVec3, y: &DVec3) -> f64 {
        f64::from((x.x > self.0) == (y.x > self.0))
    }
}

#[test]
fn masks_are_asked_anew() {
    let points = cube(2000, 8);
    let qs = charges(2000, 9);
    let kernel = plain(INVERSE);
    let builder = Fmm::builder(kernel).tolerance(1e-4).leaf_size(30);
    let mut fmm = builder.mask(Wall(0.5)).build(&points, &points).unwrap();
    assert_eq!(fmm.update(&points, &points), Err(Error::MaskNeeded));
    let moved = moved(&points, 0.05);
    fmm.update_masked(&moved, &moved, Wall(0.3)).unwrap();
    let exact = direct_masked(&kernel, &Wall(0.3), &moved, &qs, &moved).unwrap();
    assert!(relative_l2_error(&fmm.apply(&qs).unwrap(), &exact) < 1e-4);
    assert_eq!(fmm.expansion().built_levels(), 0);
}

#[test]
fn expansions_of_ones_own_are_updated_too() {
    let points = cube(3000, 1);
    let builder = Fmm::with_expansion(Counting::<f64>::new()).leaf_size(9);
    let mut fmm = builder.build(&points, &points).unwrap();
    let qs: Vec<f64> = (0..4000).map(|i| f64::from(i % 11)).collect();
    for n in [1000, 4000] {
        let (sources, targets) = (cube(n, 2), cube(700, 3));
        fmm.update(&sources, &targets).unwrap();
        let sum: f64 = qs[..n].iter().sum();
        assert_eq!(fmm.apply(&qs[..n]).unwrap(), vec![sum; 700]);
    }
}
