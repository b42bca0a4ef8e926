//! Sums over points that are repeated: held against Ewald's sums, and against images one by one.

use std::f64::consts::{PI, TAU};

use farfield::math::{erf, erfc};
use farfield::{Error, Fmm, FnKernel, Periodic, direct, from_formula, relative_l2_error};
use farfield_testing::clouds::{charges, cube};
use glam::DVec3;

use crate::any_kernel::{Formula, plain};
use crate::written_once::Softened;

type Plan = Periodic<FnKernel<Formula, DVec3, f64>>;

const INVERSE: Formula = |x, y| 1.0 / x.distance(y);
const YUKAWA: Formula = |x, y| (-5.0 * x.distance(y)).exp() / x.distance(y);

fn plan(
    formula: Formula,
    tolerance: f64,
    periods: [Option<f64>; 3],
    sources: &[DVec3],
    targets: &[DVec3],
) -> Result<Plan, Error> {
    Fmm::builder(plain(formula)).tolerance(tolerance).periodic(periods).build(sources, targets)
}

/// Charges of either sign that add up to zero.
fn neutral(n: usize, seed: u64) -> Vec<f64> {
    let mut qs = charges(n, seed);
    let mean = qs.iter().sum::<f64>() / n as f64;
    qs.iter_mut().for_each(|q| *q -= mean);
    qs
}

/// Σ_j q_j ψ(x_i − y_j) in a cube of edge 1, targets apart from sources (Ewald 1921): the reciprocal part from structure
/// factors, one of each pair of opposite wave vectors.
fn ewald(sources: &[DVec3], qs: &[f64], targets: &[DVec3]) -> Vec<f64> {
    const A: f64 = 5.5;
    let mut sums = vec![0.0; targets.len()];
    for (x, u) in targets.iter().zip(&mut sums) {
        for (y, q) in sources.iter().zip(qs) {
            for n in lattice([1, 1, 1]) {
                let r = (*x - *y + n).length();
                *u += q * erfc(A * r) / r;
            }
        }
    }
    for m in lattice([12, 12, 12]) {
        let is_first = [m.x, m.y, m.z].into_iter().find(|c| *c != 0.0).is_some_and(|c| c > 0.0);
        let k = TAU * m;
        let weight = 8.0 * PI * (-k.length_squared() / (4.0 * A * A)).exp() / k.length_squared();
        if is_first && weight > 1e-18 {
            let waves = |p: &DVec3| k.dot(*p).sin_cos();
            let (sin, cos) = sources.iter().zip(qs).fold((0.0, 0.0), |sum, (y, q)| {
                let (sin, cos) = waves(y);
                (sum.0 + q * sin, sum.1 + q * cos)
            });
            for (x, u) in targets.iter().zip(&mut sums) {
                let own = waves(x);
                *u += weight * (own.1 * cos + own.0 * sin);
            }
        }
    }
    sums
}

/// The same for a slab that is repeated along x and y (Parry 1975).
fn ewald_slab(sources: &[DVec3], qs: &[f64], targets: &[DVec3]) -> Vec<f64> {
    const A: f64 = 4.0;
    let pair = |d: DVec3| {
        let mut sum: f64 =
            lattice([2, 2, 0]).map(|n| (d + n).length()).map(|r| erfc(A * r) / r).sum();
        for m in lattice([9, 9, 0]).filter(|m| *m != DVec3::ZERO) {
            let (k, z) = (TAU * m, d.z);
            let size = k.length();
            let side = |z: f64| (size * z).exp() * erfc(size / (2.0 * A) + A * z);
            sum += PI * k.dot(d).cos() / size * (side(z) + side(-z));
        }
        let z = d.z;
        sum - 2.0 * PI.sqrt() * ((-A * A * z * z).exp() / A + PI.sqrt() * z * erf(A * z))
    };
    let sum = |x: &DVec3| sources.iter().zip(qs).map(|(y, q)| q * pair(*x - *y)).sum();
    targets.iter().map(sum).collect()
}

/// All integer vectors up to a reach along each axis.
fn lattice(reach: [i32; 3]) -> impl Iterator<Item = DVec3> {
    let range = move |k: usize| -reach[k]..=reach[k];
    range(0).flat_map(move |x| {
        range(1).flat_map(move |y| {
            range(2).map(move |z| DVec3::new(f64::from(x), f64::from(y), f64::from(z)))
        })
    })
}

/// Face-centred sites in a cube of edge 1.
fn face_centred(shift: f64) -> impl Iterator<Item = DVec3> {
    let sites = [[0.0, 0.0, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5], [0.5, 0.5, 0.0]];
    sites.into_iter().map(move |site| DVec3::from_array(site) + shift)
}

#[test]
fn crystals_have_madelungs_constants() {
    let salt: Vec<DVec3> =
        face_centred(0.0).chain(face_centred(0.5).map(|p| p.map(|c| c % 1.0))).collect();
    let blende: Vec<DVec3> = face_centred(0.0).chain(face_centred(0.25)).collect();
    let chloride = vec![DVec3::ZERO, DVec3::splat(0.5)];
    let crystals = [
        ("NaCl", salt, 0.5, 1.747_564_594_633_182_2),
        ("CsCl", chloride, 0.75f64.sqrt(), 1.762_674_773_070_988_4),
        ("ZnS", blende, 0.1875f64.sqrt(), 1.638_055_053_388_789_4),
    ];
    // One plan for all of them: ions of the others are without charge.
    let all: Vec<DVec3> = crystals.iter().flat_map(|(_, ions, ..)| ions.clone()).collect();
    let fmm = plan(INVERSE, 1e-9, [Some(1.0); 3], &all, &all).unwrap();
    assert!(fmm.needs_neutral() && fmm.near_images() == 27);
    let mut first = 0;
    for (name, ions, nearest, constant) in crystals {
        let n = ions.len();
        let mut qs = vec![0.0; all.len()];
        qs[first..first + n / 2].fill(1.0);
        qs[first + n / 2..first + n].fill(-1.0);
        let sums = fmm.apply(&qs).unwrap();
        for (u, q) in sums[first..first + n].iter().zip(&qs[first..]) {
            let found = -u * q * nearest;
            assert!((found - constant).abs() < 1e-8, "{name}: {found}");
        }
        first += n;
    }
}

#[test]
fn boxes_have_ewalds_sums() {
    for (n, tolerance) in [(40, 1e-3), (40, 1e-9), (2000, 1e-5)] {
        let (sources, targets) = (cube(n, 1), cube(30, 2));
        let qs = neutral(n, 3);
        let dipole: DVec3 = sources.iter().zip(&qs).map(|(y, q)| *y * *q).sum();
        assert!(dipole.length() > 0.1, "sums depend on the order in which images are added");
        let fmm = plan(INVERSE, tolerance, [Some(1.0); 3], &sources, &targets).unwrap();
        let error = relative_l2_error(&fmm.apply(&qs).unwrap(), &ewald(&sources, &qs, &targets));
        assert!(error < tolerance, "{n} {tolerance:e}: {error:e}");
    }
}

#[test]
fn it_does_not_matter_where_the_box_is_cut() {
    let sources = cube(50, 4);
    let qs = neutral(50, 5);
    let fmm = plan(INVERSE, 1e-6, [Some(1.0); 3], &sources, &sources).unwrap();
    let expected = fmm.apply(&qs).unwrap();
    let cut: Vec<DVec3> =
        sources.iter().map(|p| (*p + DVec3::new(0.3, 0.5, 0.0)).fract()).collect();
    let fmm = plan(INVERSE, 1e-6, [Some(1.0); 3], &cut, &cut).unwrap();
    let error = relative_l2_error(&fmm.apply(&qs).unwrap(), &expected);
    assert!(error < 2e-6, "{error:e}");
}

#[test]
fn slabs_have_ewalds_sums() {
    for (thickness, tolerance) in [(0.3, 1e-3), (1.0, 1e-6), (0.02, 1e-9)] {
        let flat = |p: &DVec3| DVec3::new(p.x, p.y, thickness * p.z);
        let [sources, targets] =
            [cube(30, 6), cube(20, 7)].map(|points| points.iter().map(flat).collect::<Vec<_>>());
        let qs = neutral(30, 8);
        let periods = [Some(1.0), Some(1.0), None];
        let fmm = plan(INVERSE, tolerance, periods, &sources, &targets).unwrap();
        assert_eq!(fmm.near_images(), 9);
        let exact = ewald_slab(&sources, &qs, &targets);
        let error = relative_l2_error(&fmm.apply(&qs).unwrap(), &exact);
        assert!(error < tolerance, "{thickness} {tolerance:e}: {error:e}");
    }
}

#[test]
fn kernels_that_die_out_take_any_charges_and_boxes() {
    let boxes = [
        ([Some(1.0), None, None], [9, 0, 0]),
        ([None, Some(1.0), Some(1.25)], [0, 9, 8]),
        ([Some(1.0), Some(1.2), Some(1.5)], [7, 6, 5]),
    ];
    for (periods, reach) in boxes {
        let edge = |k: usize| periods[k].unwrap_or(0.8);
        let edges = DVec3::new(edge(0), edge(1), edge(2));
        let place = |p: &DVec3| *p * edges - 40.0;
        let [sources, targets] =
            [cube(40, 9), cube(20, 1)].map(|points| points.iter().map(place).collect::<Vec<_>>());
        let qs: Vec<f64> = charges(40, 2).iter().map(|q| q + 0.5).collect();
        let fmm = plan(YUKAWA, 1e-6, periods, &sources, &targets).unwrap();
        assert!(!fmm.needs_neutral());
        let all: Vec<DVec3> =
            lattice(reach).flat_map(|n| sources.iter().map(move |y| *y + n * edges)).collect();
        let exact = direct(&plain(YUKAWA), &all, &qs.repeat(all.len() / 40), &targets).unwrap();
        let error = relative_l2_error(&fmm.apply(&qs).unwrap(), &exact);
        assert!(error < 1e-6, "{periods:?}: {error:e}");
    }
    // Without periods, it is a plan as any other.
    let (points, qs) = (cube(40, 3), charges(40, 4));
    let fmm = plan(INVERSE, 1e-6, [None; 3], &points, &points).unwrap();
    let exact = direct(&plain(INVERSE), &points, &qs, &points).unwrap();
    assert!(relative_l2_error(&fmm.apply(&qs).unwrap(), &exact) < 1e-12);
}

#[test]
fn gradients_are_those_of_the_sums() {
    let sources = cube(30, 5);
    let qs = neutral(30, 6);
    let middle: Vec<DVec3> = cube(10, 7).iter().map(|p| *p * 0.9 + 0.05).collect();
    const STEP: f64 = 1e-3;
    let mut targets = middle.clone();
    for axis in DVec3::AXES {
        targets.extend(
            [2.0, 1.0, -1.0, -2.0]
                .into_iter()
                .flat_map(|s| middle.iter().map(move |p| *p + s * STEP * axis)),
        );
    }
    let builder = Fmm::builder(from_formula(Softened).gradient()).tolerance(1e-6);
    let fmm = builder.periodic([Some(1.0), Some(1.1), Some(0.9)]);
    let scaled = |points: &[DVec3]| -> Vec<DVec3> {
        points.iter().map(|p| *p * DVec3::new(1.0, 1.0, 0.85)).collect()
    };
    let (sources, targets) = (scaled(&sources), scaled(&targets));
    let steps = [STEP, STEP, 0.85 * STEP];
    let sums = fmm.build(&sources, &targets).unwrap().apply(&qs).unwrap();
    let (mut found, mut expected) = (Vec::new(), Vec::new());
    for i in 0..middle.len() {
        for axis in 0..3 {
            let at = |k: usize| sums[(1 + 4 * axis + k) * middle.len() + i].value;
            found.push(sums[i].gradient[axis]);
            expected.push((8.0 * (at(1) - at(2)) - (at(0) - at(3))) / (12.0 * steps[axis]));
        }
    }
    let error = relative_l2_error(&found, &expected);
    assert!(error < 2e-6, "{error:e}");
}

#[test]
fn what_has_no_sum_is_refused_by_name() {
    let points = cube(20, 8);
    let all = [Some(1.0); 3];
    let refused =
        |formula, periods, points: &[DVec3]| plan(formula, 1e-4, periods, points, points).err();
    let zero = [Some(1.0), Some(0.0), None];
    assert!(matches!(refused(INVERSE, zero, &points), Some(Error::InvalidPeriod { axis: 1, .. })));
    let short = [None, None, Some(0.25)];
    let outside = refused(INVERSE, short, &points);
    assert!(matches!(outside, Some(Error::OutsidePeriod { axis: 2, .. })), "{outside:?}");
    let long = [Some(1.0), Some(1.0), Some(1e5)];
    let many = refused(INVERSE, long, &points);
    assert!(matches!(many, Some(Error::TooManyImages { .. })), "{many:?}");
    let mut broken = points.clone();
    broken[3].x = f64::NAN;
    let named = refused(INVERSE, all, &broken);
    assert!(matches!(named, Some(Error::NonFinitePosition { index: 3, .. })), "{named:?}");
    let placed: Formula = |x, y| (1.0 + x.x) / x.distance(y);
    assert_eq!(refused(placed, all, &points), Some(Error::PositionDependent));
    let wave: Formula = |x, y| (9.0 * x.distance(y)).cos() / x.distance(y);
    assert_eq!(refused(wave, all, &points), Some(Error::DivergentImages));

    let fmm = plan(INVERSE, 1e-4, all, &points, &points).unwrap();
    let refused = fmm.apply(&[1.0; 20]);
    assert!(matches!(refused, Err(Error::NotNeutral { density: 0, .. })), "{refused:?}");
    let refused = fmm.apply(&[1.0; 21]);
    assert!(matches!(refused, Err(Error::LengthMismatch { expected: 20, found: 21, .. })));
    let mut qs = neutral(20, 1);
    qs[7] = f64::INFINITY;
    assert!(matches!(fmm.apply(&qs), Err(Error::NonFiniteCharge { index: 7, .. })));
    let empty = plan(INVERSE, 1e-4, all, &[], &points).unwrap();
    assert_eq!(empty.apply(&[]).unwrap(), vec![0.0; 20]);
}
