//! Single precision against sums in double precision, pair by pair.

use super::*;
use crate::exponent::{MinusFour, MinusOne, MinusTwo};
use crate::near_field::Block;
use crate::output::{Potential, PotentialGradient, WithGradient};
use crate::pair::evaluate;
use farfield::{DispatchLevel, Outcome};
use glam::DVec3;
use pulp::WithSimd;
use std::marker::PhantomData;

const TOLERANCES: [f64; 4] = [1e-5, 3e-5, 1e-4, 1e-2];

fn points(n: usize, shift: f64) -> Vec<DVec3> {
    let step = DVec3::new(0.819_173, 0.671_044, 0.549_700);
    (1..=n).map(|i| (step * i as f64 + shift).fract()).collect()
}

/// How a block would be rounded.
struct How<'a, E>(f64, bool, &'a [DVec3], &'a [DVec3], PhantomData<E>);

impl<E: Exponent> WithSimd for How<'_, E> {
    type Output = Option<Single>;

    fn with_simd<S: Simd>(self, simd: S) -> Option<Single> {
        let Self(tolerance, gradient, xs, ys, _) = self;
        let law = Law::of::<E>()?;
        Single::of::<S, E, f64>(simd, law, gradient, tolerance, (xs, ys))
    }
}

fn sum<E: Exponent>(
    level: DispatchLevel,
    tolerance: f64,
    (xs, ys): (&[DVec3], &[DVec3]),
    qs: &[[f64; 2]],
) -> Vec<PotentialGradient<[f64; 2]>> {
    let (mut us, types) = (vec![PotentialGradient::zero(); xs.len()], PhantomData);
    let block =
        Block::<E, f64, f64, [f64; 2], WithGradient> { xs, ys, qs, tolerance, us: &mut us, types };
    assert_eq!(level.run(block), Outcome::Done);
    us
}

/// The worst errors of the sums of both columns, relative to Σ|K q| and Σ|∇K q|, in units of the tolerance.
fn worst<E: Exponent>(
    level: DispatchLevel,
    tolerance: f64,
    (xs, ys): (&[DVec3], &[DVec3]),
    qs: &[[f64; 2]],
) -> f64 {
    let found = sum::<E>(level, tolerance, (xs, ys), qs);
    let mut worst = 0.0;
    for (x, u) in xs.iter().zip(found) {
        for n in 0..2 {
            let (mut exact, mut sizes) = ([0.0; 4], [0.0; 2]);
            for (y, q) in ys.iter().zip(qs) {
                let (k, [a, b, c]) = evaluate::<E, f64>(*x, *y);
                for (sum, k) in exact.iter_mut().zip([k, a, b, c]) {
                    *sum += k * q[n];
                }
                let steepness = DVec3::new(a, b, c).length();
                sizes = [sizes[0] + (k * q[n]).abs(), sizes[1] + (steepness * q[n]).abs()];
            }
            let error = (u.potential[n] - exact[0]).abs() / sizes[0];
            let slopes = u.gradient.map(|component| component[n]);
            let difference = DVec3::from(slopes) - DVec3::new(exact[1], exact[2], exact[3]);
            let steep = difference.length() / sizes[1];
            for error in [error, steep] {
                assert!(!error.is_infinite());
                // 0/0 where no charge acts.
                worst = f64::max(worst, error / tolerance);
            }
        }
    }
    worst
}

/// Whether pairs keep every tolerance for which some block is rounded, at every level.
#[track_caller]
fn check<E: Exponent>(xs: &[DVec3], ys: &[DVec3], qs: &[[f64; 2]]) {
    for level in DispatchLevel::available().filter(|&level| level > DispatchLevel::Portable) {
        for tolerance in TOLERANCES {
            let error = worst::<E>(level, tolerance, (xs, ys), qs);
            assert!(error <= 1.0, "{:?}, {level}, {tolerance:e}: {error}", E::default());
        }
        let how = level.run(How::<E>(1e-4, true, xs, ys, PhantomData));
        assert!(how.is_some(), "{level}: in double precision");
    }
}

/// Every pair by itself: distances of all sizes, down to coincidence.
#[test]
fn pairs_keep_their_tolerance_at_any_distance() {
    let (xs, mut ys) = (points(33, 0.0), points(48, 0.3));
    for (j, y) in ys.iter_mut().enumerate().skip(2) {
        *y = xs[j % 33] + (*y - 0.5) * 0.6f64.powi(j as i32);
    }
    ys[2] = xs[2];
    for j in 0..ys.len() {
        let mut qs = vec![[0.0; 2]; ys.len()];
        qs[j] = [1.0, -0.3];
        check::<MinusOne>(&xs, &ys, &qs);
        check::<MinusFour>(&xs, &ys, &qs);
    }
}

#[test]
fn long_blocks_of_charges_of_all_sizes() {
    let (xs, ys) = (points(50, 0.0), points(700, 0.3));
    let alike = vec![[1.0, 0.7]; ys.len()];
    let unlike: Vec<_> =
        (0..ys.len()).map(|j| [(j as f64).sin(), 1e-300 * 10f64.powf(j as f64 / 40.0)]).collect();
    for qs in [alike, unlike] {
        check::<MinusOne>(&xs, &ys, &qs);
        check::<MinusTwo>(&xs, &ys, &qs);
    }
}

#[test]
fn neither_scales_nor_far_origins_matter() {
    let qs: Vec<_> = (0..40).map(|j| [1e-3 * f64::from(j), 1e30]).collect();
    for scale in [1e-30, 1e-3, 1e30] {
        for origin in [0.0, 1e3] {
            let place = |p: DVec3| (p + origin) * scale;
            let [xs, ys] = [points(40, 0.0), points(40, 0.3)]
                .map(|points| points.into_iter().map(place).collect::<Vec<_>>());
            check::<MinusOne>(&xs, &ys, &qs);
            check::<MinusFour>(&xs, &ys, &qs);
        }
    }
}

#[test]
fn a_target_does_not_notice_its_neighbours() {
    let (xs, mut ys) = (points(61, 0.0), points(300, 0.3));
    ys[7] = xs[20];
    ys[8] = xs[21] + 1e-5;
    let qs: Vec<_> = ys.iter().map(|y| [y.x, -1.0]).collect();
    for level in DispatchLevel::available() {
        let together = sum::<MinusOne>(level, 1e-4, (&xs, &ys), &qs);
        for first in 0..40 {
            let some = first..first + 20;
            let alone = sum::<MinusOne>(level, 1e-4, (&xs[some.clone()], &ys), &qs);
            assert_eq!(alone, together[some], "{level}");
        }
    }
}

#[test]
fn blocks_that_single_precision_does_not_serve() {
    let (xs, ys) = (points(40, 0.0), points(40, 0.3));
    for level in DispatchLevel::available() {
        let how = |tolerance, xs: &[DVec3], ys: &[DVec3]| {
            level.run(How::<MinusOne>(tolerance, false, xs, ys, PhantomData)).is_some()
        };
        assert_eq!(how(1e-4, &xs, &ys), level > DispatchLevel::Portable);
        assert!(!how(1e-6, &xs, &ys) && !how(0.0, &xs, &ys));
        assert!(!how(1e-4, &xs[..5], &ys) && !how(1e-4, &xs, &ys[..2]));
        // Targets that are as near to each other as close pairs.
        assert!(!how(1e-4, &[DVec3::ONE; 40], &ys));
        let near: Vec<_> = xs.iter().map(|x| x * 1e-4).collect();
        assert!(!how(1e-4, &near, &ys));
        for scale in [1e-200, 1e200, f64::INFINITY, f64::NAN] {
            let scaled: Vec<_> = ys.iter().map(|y| y * scale).collect();
            assert!(!how(1e-4, &scaled, &scaled), "{scale}");
        }
    }
}

#[test]
fn charges_that_are_not_finite_or_all_zero() {
    let (xs, ys) = (points(40, 0.0), points(40, 0.3));
    let sum = |q: f64| {
        let mut qs = vec![1.0; ys.len()];
        qs[3] = q;
        let (mut us, types, tolerance) = (vec![0.0; xs.len()], PhantomData, 1e-4);
        let (xs, ys, qs) = (&xs[..], &ys[..], &qs[..]);
        let us_ = &mut us[..];
        let block =
            Block::<MinusOne, f64, f64, f64, Potential> { xs, ys, qs, tolerance, us: us_, types };
        assert_eq!(block.run(), Outcome::Done);
        us
    };
    assert!(sum(f64::NAN).iter().all(|u| u.is_nan()));
    assert!(sum(f64::INFINITY).iter().all(|u| !u.is_finite()));
    let qs = vec![[0.0; 2]; ys.len()];
    for level in DispatchLevel::available() {
        let us = super::tests::sum::<MinusOne>(level, 1e-4, (&xs, &ys), &qs);
        assert!(us.iter().all(|u| *u == PotentialGradient::zero()));
    }
}
