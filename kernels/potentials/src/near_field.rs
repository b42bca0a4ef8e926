//! The inner loop of direct sums: blocks of targets and sources in SIMD registers.
//!
//! A group of one to three registers of targets stays put while the sources pass, each broadcast to
//! all places of a register. Three independent chains of arithmetic hide the latency of the
//! instructions, and groups this small waste few places on leaves of 20 to 60 points. All that is
//! generic here is settled when the code is compiled: per machine (AVX-512, AVX2, or neither), number
//! of digits and size of group there is one straight loop.
//!
//! Code with wide registers must be inlined into the function that `pulp` compiles for the machine.
//! Hence `#[inline(always)]` throughout, and loops where closures on arrays would be shorter.
//!
//! Where a tolerance is loose enough, blocks of double precision are summed in single precision, see
//! [`single`](crate::single).
//!
//! The loop is for blocks of ordinary coordinates and of charges of up to four numbers. It declines
//! any other, which [`PowerLaw`](crate::PowerLaw) sums pair by pair.

use std::marker::PhantomData;

use farfield::{Numbers, Outcome, Point, Real, dispatch};
use pulp::{Simd, WithSimd};

use crate::exponent::Exponent;
use crate::group::{group, group_size, lanes};
use crate::law::Law;
use crate::ordinary::is_ordinary;
use crate::output::Output;
use crate::reciprocal::{Digits, Reciprocal};
use crate::single::Single;

/// The block Σ_j K(x_i, y_j) q_j, to be added to `us[i]`, each pair to a relative error `tolerance`.
/// `F` is the same precision as `T`, but known by name.
pub(crate) struct Block<'a, E, F, T: Real, C, O: Output<T, C>>
where
    C: Numbers<Real = T>,
{
    pub(crate) xs: &'a [Point<T>],
    pub(crate) ys: &'a [Point<T>],
    pub(crate) qs: &'a [C],
    pub(crate) tolerance: f64,
    pub(crate) us: &'a mut [O::Value],
    pub(crate) types: PhantomData<(E, F)>,
}

impl<E, F, T, C, O> WithSimd for Block<'_, E, F, T, C, O>
where
    E: Exponent,
    F: Reciprocal,
    T: Real,
    C: Numbers<Real = T>,
    O: Output<T, C>,
{
    type Output = Outcome;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Outcome {
        let Some(law) = Law::of::<E>() else { return Outcome::Declined };
        match C::LEN {
            1 => self.sum::<S, 1>(simd, law),
            2 => self.sum::<S, 2>(simd, law),
            3 => self.sum::<S, 3>(simd, law),
            4 => self.sum::<S, 4>(simd, law),
            _ => Outcome::Declined,
        }
    }
}

impl<E, F, T, C, O> Block<'_, E, F, T, C, O>
where
    E: Exponent,
    F: Reciprocal,
    T: Real,
    C: Numbers<Real = T>,
    O: Output<T, C>,
{
    /// Adds the block, or declines it, with the best instructions that the machine has.
    pub(crate) fn run(self) -> Outcome {
        dispatch(self)
    }

    /// The block for charges of `N` columns.
    #[inline(always)]
    fn sum<S: Simd, const N: usize>(self, simd: S, law: Law) -> Outcome {
        // Decided per type, so that only the one loop that fits a charge is compiled.
        if const { C::LEN != N } {
            return Outcome::Declined;
        }
        let double = const { size_of::<F>() == size_of::<f64>() && E::LAMBDA > 0.0 };
        if double {
            let Self { xs, ys, qs, tolerance, .. } = self;
            let single = Single::of::<S, E, T>(simd, law, O::GRADIENT, tolerance, (xs, ys));
            if let Some(single) = single {
                single.sum::<S, E, T, C, O, N>(simd, xs, ys, qs, self.us);
                return Outcome::Done;
            }
        }
        if !is_ordinary::<F, T>(self.xs, self.ys) {
            return Outcome::Declined;
        }
        // What rounding hides is always enough: then the loops for more digits aren't compiled.
        let hidden = F::epsilon().as_f64() / 8.0;
        let enough = |digits| {
            let error = law.error::<F, S>(simd, digits, O::GRADIENT);
            error <= hidden || error <= self.tolerance
        };
        // Fewer digits of double precision are for blocks too small for single precision: no large groups.
        let rounded = law.error::<F, S>(simd, Digits::Few, O::GRADIENT) > hidden;
        let few = if double && rounded { 1 } else { 3 };
        if enough(Digits::Few) {
            self.groups::<S, N>(simd, law, Digits::Few, few);
        } else if enough(Digits::Half) {
            self.groups::<S, N>(simd, law, Digits::Half, 3);
        } else {
            self.groups::<S, N>(simd, law, Digits::All, 3);
        }
        Outcome::Done
    }

    /// The targets in groups of up to `most` registers, fewer where the sums would not fit.
    #[inline(always)]
    fn groups<S: Simd, const N: usize>(self, simd: S, law: Law, digits: Digits, most: usize) {
        let lanes = lanes::<F, S>();
        let Self { mut xs, ys, qs, mut us, .. } = self;
        while !xs.is_empty() {
            let size = group_size::<S>(xs.len().div_ceil(lanes), N, O::GRADIENT).min(most);
            let count = (size * lanes).min(xs.len());
            let (x, rest_x) = xs.split_at(count);
            let (u, rest_u) = us.split_at_mut(count);
            if size == 1 || most == 1 {
                group::<S, E, F, T, C, O, 1, N>(simd, law, digits, x, ys, qs, u);
            } else if size == 2 {
                group::<S, E, F, T, C, O, 2, N>(simd, law, digits, x, ys, qs, u);
            } else {
                group::<S, E, F, T, C, O, 3, N>(simd, law, digits, x, ys, qs, u);
            }
            (xs, us) = (rest_x, rest_u);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exponent::{MinusFour, MinusOne, MinusTwo, PlusTwo};
    use crate::output::{PotentialGradient, WithGradient};
    use farfield::{DispatchLevel, Numbers, Vector};

    fn points<T: Real>(n: usize, shift: f64) -> Vec<Point<T>> {
        let fraction = |i: usize, step: f64| T::from_f64((i as f64 * step + shift).fract() - 0.5);
        (1..=n)
            .map(|i| [fraction(i, 0.819_173), fraction(i, 0.671_044), fraction(i, 0.549_700)])
            .map(Point::<T>::from_array)
            .collect()
    }

    /// Potential and gradient of one charge at one target in double precision.
    fn exact<E: Exponent, T: Real>(x: Point<T>, y: Point<T>) -> [f64; 4] {
        let (x, y) = (x.to_array().map(T::as_f64), y.to_array().map(T::as_f64));
        let d = [x[0] - y[0], x[1] - y[1], x[2] - y[2]];
        let r2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        if r2 == 0.0 {
            return [0.0; 4];
        }
        let k = r2.powf(-E::LAMBDA);
        let [a, b, c] = d.map(|d| -2.0 * E::LAMBDA * k * d / r2);
        [k, a, b, c]
    }

    /// The worst error of a block, beyond rounding, relative to Σ|K q| and Σ|∇K q|.
    fn worst<E: Exponent, F: Reciprocal, T: Real>(
        level: DispatchLevel,
        tolerance: f64,
        (xs, ys): (&[Point<T>], &[Point<T>]),
    ) -> f64 {
        let qs: Vec<T> = (0..ys.len()).map(|j| T::from_f64((j as f64).cos())).collect();
        let pairs: Vec<[T; 2]> = qs.iter().map(|&q| [T::from_f64(1.0), q]).collect();
        let types = PhantomData;
        let mut single = vec![<T as Numbers>::zero(); xs.len()];
        let us = &mut single[..];
        let block = Block::<E, F, T, T, crate::Potential> { xs, ys, qs: &qs, tolerance, us, types };
        assert_eq!(level.run(block), Outcome::Done);
        let mut double = vec![PotentialGradient::<[T; 2]>::zero(); xs.len()];
        let us = &mut double[..];
        let block =
            Block::<E, F, T, [T; 2], WithGradient> { xs, ys, qs: &pairs, tolerance, us, types };
        assert_eq!(level.run(block), Outcome::Done);

        let mut worst = 0.0;
        for ((x, single), double) in xs.iter().zip(single).zip(double) {
            let (mut sum, mut scale) = ([0.0; 4], [0.0; 2]);
            for (y, q) in ys.iter().zip(&qs) {
                let [k, a, b, c] = exact::<E, T>(*x, *y).map(|k| k * q.as_f64());
                for (sum, term) in sum.iter_mut().zip([k, a, b, c]) {
                    *sum += term;
                }
                scale[0] += k.abs();
                scale[1] += (a * a + b * b + c * c).sqrt();
            }
            let rounding = T::epsilon().as_f64() * (8.0 + ys.len() as f64);
            let mut compare = |found: T, exact: f64, scale: f64| {
                let error = (found.as_f64() - exact).abs() - rounding * scale;
                worst = f64::max(worst, if error > 0.0 { error / scale } else { 0.0 });
            };
            compare(single, sum[0], scale[0]);
            compare(double.potential[1], sum[0], scale[0]);
            for (component, sum) in double.gradient.iter().zip(&sum[1..]) {
                compare(component[1], *sum, scale[1]);
            }
        }
        worst
    }

    fn check<E: Exponent, F: Reciprocal, T: Real>() {
        let (xs, mut ys) = (points::<T>(70, 0.0), points::<T>(50, 0.3));
        for j in (0..50).step_by(7) {
            ys[j] = xs[j + 3];
        }
        for level in DispatchLevel::available() {
            for tolerance in [0.0, 1e-12, 1e-9, 1e-7, 1e-6, 2e-4, 1e-3] {
                for n in 1..=xs.len() {
                    for m in [0, 1, 2, 50] {
                        let sets = (&xs[..n], &ys[..m]);
                        let error = worst::<E, F, T>(level, tolerance, sets);
                        assert!(
                            error <= tolerance,
                            "r^{}, {level}, {n} targets, {m} sources: {error:e} > {tolerance:e}",
                            -2.0 * E::LAMBDA
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn tolerances_are_kept_at_every_level_and_size() {
        check::<MinusOne, f64, f64>();
        check::<MinusFour, f64, f64>();
        check::<PlusTwo, f64, f64>();
        check::<MinusOne, f32, f32>();
        check::<MinusTwo, f32, f32>();
    }

    #[test]
    fn fewer_digits_are_made_use_of() {
        let sets = (&points::<f64>(9, 0.0)[..], &points::<f64>(7, 0.3)[..]);
        for level in DispatchLevel::available().filter(|&level| level >= DispatchLevel::Avx2) {
            let error = |tolerance| worst::<MinusOne, f64, f64>(level, tolerance, sets);
            let (few, half) = (error(1e-3), error(1e-6));
            assert!(few > 1e-7 && half > 1e-12, "{level}: {few:e}, {half:e}");
        }
    }

    #[test]
    fn a_target_does_not_notice_its_neighbours() {
        let (xs, ys) = (points::<f64>(61, 0.0), points::<f64>(40, 0.3));
        let qs = vec![[1.0, 0.3, -2.0]; ys.len()];
        let sum = |xs: &[Point<f64>]| {
            let mut us = vec![PotentialGradient::zero(); xs.len()];
            let (qs, us_, types) = (&qs[..], &mut us[..], PhantomData);
            let outcome = Block::<MinusOne, f64, f64, [f64; 3], WithGradient> {
                xs,
                ys: &ys,
                qs,
                tolerance: 1e-6,
                us: us_,
                types,
            }
            .run();
            assert_eq!(outcome, Outcome::Done);
            us
        };
        let together = sum(&xs);
        for (i, u) in together.iter().enumerate() {
            assert_eq!(sum(&xs[i..=i]), [*u]);
        }
    }

    #[test]
    fn blocks_with_extreme_distances_are_declined() {
        fn outcome<F: Reciprocal + Real>(level: DispatchLevel, distance: F) -> Outcome {
            let (zero, types) = (F::from_f64(0.0), PhantomData);
            let [x, y] = [zero, distance].map(|z| Point::<F>::from_array([zero, zero, z]));
            let (xs, ys, qs, us) = (&[x], &[y], &[F::from_f64(1.0)], &mut [zero]);
            let tolerance = 0.0;
            type Single<'a, F> = Block<'a, MinusOne, F, F, F, crate::Potential>;
            level.run(Single { xs, ys, qs, tolerance, us, types })
        }
        for level in DispatchLevel::available() {
            for extreme in [1e-170, 1e160, f64::NAN] {
                assert_eq!(outcome(level, extreme), Outcome::Declined);
            }
            assert_eq!(outcome(level, 1e-20f32), Outcome::Declined);
            assert_eq!(outcome(level, 0.0f32), Outcome::Done);
            assert_eq!(outcome(level, 1e-40), Outcome::Done);
        }
    }
}
