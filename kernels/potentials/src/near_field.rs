//! The inner loop of direct sums: blocks of targets and sources in SIMD registers.
//!
//! A group of up to three registers of targets stays put while the sources pass, each broadcast to
//! all places of a register. Three independent chains of arithmetic are what hides an instruction's
//! latency; few targets in a register are what leaves have. All that is generic here is settled when
//! the code is compiled: per machine (AVX-512, AVX2, or neither), number of digits and group size,
//! one straight loop.
//!
//! The loop is for blocks of ordinary coordinates and of charges that are plain numbers. It declines
//! any other, which [`PowerLaw`](crate::PowerLaw) sums pair by pair.

use std::any::{Any, TypeId};
use std::marker::PhantomData;

use farfield::{Additive, Linear, Outcome, Point, Real, Vector};
use pulp::{Arch, Simd, WithSimd};

use crate::exponent::Exponent;
use crate::output::Output;
use crate::reciprocal::{Digits, Reciprocal};
use crate::registers::Registers;

/// The block Σ_j K(x_i, y_j) q_j, to be added to `us[i]`, each pair to a relative error `tolerance`.
/// `F` is the same precision as `T`, but known by name.
pub(crate) struct Block<'a, E, F, T: Real, C, O: Output<T, C>>
where
    C: Linear<T>,
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
    C: Linear<T>,
    O: Output<T, C>,
{
    type Output = Outcome;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Outcome {
        if !(is_ordinary::<F, T>(self.xs) && is_ordinary::<F, T>(self.ys)) {
            return Outcome::Declined;
        }
        let Some(law) = Law::of::<E>() else { return Outcome::Declined };
        match columns::<T, C>() {
            Some(1) => self.sum::<S, 1>(simd, law),
            Some(2) => self.sum::<S, 2>(simd, law),
            Some(3) => self.sum::<S, 3>(simd, law),
            Some(4) => self.sum::<S, 4>(simd, law),
            _ => return Outcome::Declined,
        }
        Outcome::Done
    }
}

impl<E, F, T, C, O> Block<'_, E, F, T, C, O>
where
    E: Exponent,
    F: Reciprocal,
    T: Real,
    C: Linear<T>,
    O: Output<T, C>,
{
    /// Adds the block, or declines it, with the best instructions that the machine has.
    pub(crate) fn run(self) -> Outcome {
        Arch::new().dispatch(self)
    }

    /// The block for charges of `N` columns.
    #[inline(always)]
    fn sum<S: Simd, const N: usize>(self, simd: S, law: Law) {
        // Decided per type, so that only the one loop that fits a charge is compiled.
        if const { size_of::<C>() == N * size_of::<T>() } {
            let enough = |digits| law.error::<F, S>(simd, digits, O::GRADIENT) <= self.tolerance;
            if enough(Digits::Few) {
                self.groups::<S, N>(simd, law, Digits::Few);
            } else if enough(Digits::Half) {
                self.groups::<S, N>(simd, law, Digits::Half);
            } else {
                self.groups::<S, N>(simd, law, Digits::All);
            }
        }
    }

    /// The targets in groups of up to three registers, fewer where the sums would not fit.
    #[inline(always)]
    fn groups<S: Simd, const N: usize>(self, simd: S, law: Law, digits: Digits) {
        let lanes = lanes::<F, S>();
        let sums = if O::GRADIENT { 4 * N } else { N };
        let most = (3 * S::REGISTER_COUNT / 8 / sums).clamp(1, S::REGISTER_COUNT / 10);
        let Self { mut xs, ys, qs, mut us, .. } = self;
        while !xs.is_empty() {
            let registers = xs.len().div_ceil(lanes);
            // Four are two and two: a lone register would wait for its own results.
            let size = if registers == 4 { 2.min(most) } else { registers.min(most) };
            let count = (size * lanes).min(xs.len());
            let (x, rest_x) = xs.split_at(count);
            let (u, rest_u) = us.split_at_mut(count);
            match size {
                1 => group::<S, E, F, T, C, O, 1, N>(simd, law, digits, x, ys, qs, u),
                2 => group::<S, E, F, T, C, O, 2, N>(simd, law, digits, x, ys, qs, u),
                _ => group::<S, E, F, T, C, O, 3, N>(simd, law, digits, x, ys, qs, u),
            }
            (xs, us) = (rest_x, rest_u);
        }
    }
}

/// The most numbers that a register can have: 512 bits of `f32`.
const LANES: usize = 16;

/// `G` registers of targets and all sources.
#[expect(clippy::too_many_arguments, reason = "the loop itself, with all that it depends on")]
#[inline(always)]
fn group<S, E, F, T, C, O, const G: usize, const N: usize>(
    simd: S,
    law: Law,
    digits: Digits,
    xs: &[Point<T>],
    ys: &[Point<T>],
    qs: &[C],
    us: &mut [O::Value],
) where
    S: Simd,
    E: Exponent,
    F: Reciprocal,
    T: Real,
    C: Linear<T>,
    O: Output<T, C>,
{
    let zero = F::splat(simd, F::from_f64(0.0));
    let mut x = [[zero; G]; 3];
    for (g, xs) in xs.chunks(lanes::<F, S>()).enumerate() {
        // The places beyond the last target hold the origin; what they sum up to is dropped.
        let mut coordinates = [[F::from_f64(0.0); LANES]; 3];
        for (i, x) in xs.iter().enumerate() {
            let [x0, x1, x2] = x.to_array();
            coordinates[0][i] = same(x0);
            coordinates[1][i] = same(x1);
            coordinates[2][i] = same(x2);
        }
        for (x, row) in x.iter_mut().zip(&coordinates) {
            x[g] = F::registers::<S>(row)[0];
        }
    }
    let mut potential = [[zero; G]; N];
    let mut gradient = [[[zero; G]; N]; 3];

    for (y, q) in ys.iter().zip(qs) {
        let [y0, y1, y2] = y.to_array();
        let y = [F::splat(simd, same(y0)), F::splat(simd, same(y1)), F::splat(simd, same(y2))];
        let columns = to_columns::<T, C, F, N>(q);
        let mut q = [zero; N];
        for n in 0..N {
            q[n] = F::splat(simd, columns[n]);
        }
        for g in 0..G {
            let d = [
                F::minus(simd, x[0][g], y[0]),
                F::minus(simd, x[1][g], y[1]),
                F::minus(simd, x[2][g], y[2]),
            ];
            let r2 = F::times(simd, d[0], d[0]);
            let r2 = F::plus_product(simd, d[1], d[1], r2);
            let r2 = F::plus_product(simd, d[2], d[2], r2);
            let (k, inverse) = law.at::<F, S>(simd, digits, r2);
            for n in 0..N {
                potential[n][g] = F::plus_product(simd, k, q[n], potential[n][g]);
            }
            if O::GRADIENT {
                let (d, slope) = slope::<F, S>(simd, d, k, inverse);
                for (n, &q) in q.iter().enumerate() {
                    let slope = F::times(simd, slope, q);
                    for c in 0..3 {
                        gradient[c][n][g] = F::plus_product(simd, d[c], slope, gradient[c][n][g]);
                    }
                }
            }
        }
    }

    let factor = F::splat(simd, F::from_f64(-2.0 * E::LAMBDA));
    for (g, us) in us.chunks_mut(lanes::<F, S>()).enumerate() {
        let mut sums = [[F::from_f64(0.0); LANES]; N];
        let mut slopes = [[[F::from_f64(0.0); LANES]; N]; 3];
        for n in 0..N {
            F::registers_mut::<S>(&mut sums[n])[0] = potential[n][g];
            if O::GRADIENT {
                for c in 0..3 {
                    let slope = F::times(simd, factor, gradient[c][n][g]);
                    F::registers_mut::<S>(&mut slopes[c][n])[0] = slope;
                }
            }
        }
        for (i, u) in us.iter_mut().enumerate() {
            let mut gradient = [C::zero(); 3];
            if O::GRADIENT {
                for c in 0..3 {
                    gradient[c] = from_columns::<T, C, F, N>(&slopes[c], i);
                }
            }
            O::add(u, &from_columns::<T, C, F, N>(&sums, i), &gradient);
        }
    }
}

/// The exponents that the loop knows.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Law {
    /// 1/r
    MinusOne,
    /// 1/r²
    MinusTwo,
    /// 1/r⁴
    MinusFour,
    /// r²
    PlusTwo,
}

impl Law {
    #[inline(always)]
    fn of<E: Exponent>() -> Option<Self> {
        match E::LAMBDA {
            0.5 => Some(Self::MinusOne),
            1.0 => Some(Self::MinusTwo),
            2.0 => Some(Self::MinusFour),
            -1.0 => Some(Self::PlusTwo),
            _ => None,
        }
    }

    /// K = r^(−2λ) and r⁻², both 0 at coincident points. For r², whose gradient is 2d, the latter is
    /// of no use and left out.
    #[inline(always)]
    fn at<F: Reciprocal, S: Simd>(
        self,
        simd: S,
        digits: Digits,
        r2: F::Register<S>,
    ) -> (F::Register<S>, Option<F::Register<S>>) {
        let least = F::splat(simd, F::LEAST);
        let apart = |a| F::where_at_least(simd, r2, least, a);
        match self {
            Self::MinusOne => {
                let k = apart(F::inverse_sqrt(simd, digits, r2));
                (k, Some(F::times(simd, k, k)))
            }
            Self::MinusTwo => {
                let k = apart(F::inverse(simd, digits, r2));
                (k, Some(k))
            }
            Self::MinusFour => {
                let inverse = apart(F::inverse(simd, digits, r2));
                (F::times(simd, inverse, inverse), Some(inverse))
            }
            Self::PlusTwo => (r2, None),
        }
    }

    /// The relative error of K, or of K and its gradient.
    #[inline(always)]
    fn error<F: Reciprocal, S: Simd>(self, simd: S, digits: Digits, gradient: bool) -> f64 {
        let (power, error) = match self {
            Self::MinusOne => (1 + 2 * i32::from(gradient), F::inverse_sqrt_error(simd, digits)),
            Self::MinusTwo => (1 + i32::from(gradient), F::inverse_error(simd, digits)),
            Self::MinusFour => (2 + i32::from(gradient), F::inverse_error(simd, digits)),
            Self::PlusTwo => (0, 0.0),
        };
        (1.0 + error).powi(power) - 1.0
    }
}

/// K d / r² as a vector and a factor, multiplied in an order that stays in range.
#[inline(always)]
fn slope<F: Reciprocal, S: Simd>(
    simd: S,
    d: [F::Register<S>; 3],
    k: F::Register<S>,
    inverse: Option<F::Register<S>>,
) -> ([F::Register<S>; 3], F::Register<S>) {
    match inverse {
        None => (d, F::splat(simd, F::from_f64(1.0))),
        Some(inverse) if F::CUBES => (d, F::times(simd, k, inverse)),
        Some(inverse) => {
            let [a, b, c] = d;
            let d = [
                F::times(simd, a, inverse),
                F::times(simd, b, inverse),
                F::times(simd, c, inverse),
            ];
            (d, k)
        }
    }
}

/// Whether no square, and no difference of two that isn't 0, leaves the range that the loop is for:
/// numbers of at least √`LEAST` / ε differ by at least √`LEAST`, if they differ.
#[inline(always)]
fn is_ordinary<F: Reciprocal, T: Real>(points: &[Point<T>]) -> bool {
    let root = F::LEAST.sqrt();
    let (least, greatest) = (root / F::epsilon(), (F::from_f64(4.0) * root).recip());
    points.iter().fold(true, |ordinary, point| {
        point.to_array().into_iter().fold(ordinary, |ordinary, c| {
            let c = same::<T, F>(c).abs();
            ordinary & ((c >= least) | (c == F::from_f64(0.0))) & (c <= greatest)
        })
    })
}

/// The same number in the same precision, by its other name.
#[inline(always)]
fn same<A: Real, B: Real>(a: A) -> B {
    B::from_f64(a.as_f64())
}

/// How many numbers a charge is made of, if it is a number, a point, or an array of up to four
/// numbers.
#[inline(always)]
fn columns<T: Real, C: 'static>() -> Option<usize> {
    let types = [
        (TypeId::of::<T>(), 1),
        (TypeId::of::<[T; 1]>(), 1),
        (TypeId::of::<[T; 2]>(), 2),
        (TypeId::of::<[T; 3]>(), 3),
        (TypeId::of::<Point<T>>(), 3),
        (TypeId::of::<[T; 4]>(), 4),
    ];
    types.into_iter().find(|(id, _)| *id == TypeId::of::<C>()).map(|(_, columns)| columns)
}

/// The `N` numbers of a charge; see [`columns`].
#[inline(always)]
fn to_columns<T: Real, C: 'static, F: Real, const N: usize>(charge: &C) -> [F; N] {
    let charge: &dyn Any = charge;
    let mut columns = [F::from_f64(0.0); N];
    if let Some(numbers) = charge.downcast_ref::<[T; N]>() {
        for n in 0..N {
            columns[n] = same(numbers[n]);
        }
    } else if let Some(&number) = charge.downcast_ref::<T>() {
        columns[0] = same(number);
    } else if let Some(point) = charge.downcast_ref::<Point<T>>() {
        let point = point.to_array();
        for n in 0..N {
            columns[n] = same(point[n % 3]);
        }
    }
    columns
}

/// The inverse of [`to_columns`], from the numbers at place `i`.
#[inline(always)]
fn from_columns<T: Real, C: Additive, F: Real, const N: usize>(
    rows: &[[F; LANES]; N],
    i: usize,
) -> C {
    let mut columns = [T::from_f64(0.0); N];
    for n in 0..N {
        columns[n] = same(rows[n][i]);
    }
    let at = |n: usize| columns[n % N];
    let point = Point::<T>::from_array([at(0), at(1), at(2)]);
    let forms: [&dyn Any; 3] = [&columns, &columns[0], &point];
    for form in forms {
        if let Some(&charge) = form.downcast_ref::<C>() {
            return charge;
        }
    }
    C::zero()
}

/// Numbers in a register.
#[inline(always)]
const fn lanes<F: Registers, S: Simd>() -> usize {
    size_of::<F::Register<S>>() / size_of::<F>()
}
