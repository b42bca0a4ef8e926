//! Reciprocals and reciprocal square roots, to the digits that are needed and no more.
//!
//! Divisions and square roots of whole registers are the slowest instructions of a pair. Where the
//! machine has an estimate of 1/x or 1/√x, a few terms of a series bring it to the digits wanted.

#[cfg(target_arch = "x86_64")]
use std::any::Any;

use pulp::Simd;
#[cfg(target_arch = "x86_64")]
use pulp::bytemuck::cast;
#[cfg(target_arch = "x86_64")]
use pulp::x86::{V3, V4};

use crate::registers::Registers;

/// How many digits are wanted; what that means in numbers depends on the machine, and the error
/// bounds of [`Reciprocal`] say it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Digits {
    /// About four.
    Few,
    /// About eight.
    Half,
    /// All, but for rounding.
    All,
}

/// Reciprocals of positive numbers between [`LEAST`](Self::LEAST) and its inverse. Beyond these, and
/// at 0, they are undefined.
pub(crate) trait Reciprocal: Registers {
    /// A power of two, far enough from the smallest number for squares of this size to be accurate.
    const LEAST: Self;
    /// Whether the cubes of these numbers are in range too.
    const CUBES: bool;

    /// 1/√x in units of [`inverse_sqrt_unit`](Self::inverse_sqrt_unit).
    fn inverse_sqrt<S: Simd>(simd: S, digits: Digits, x: Self::Register<S>) -> Self::Register<S>;
    /// 1/x
    fn inverse<S: Simd>(simd: S, digits: Digits, x: Self::Register<S>) -> Self::Register<S>;
    /// A power of two.
    fn inverse_sqrt_unit<S: Simd>(simd: S, digits: Digits) -> f64;
    /// The relative error of [`inverse_sqrt`](Self::inverse_sqrt) is less, rounding aside.
    fn inverse_sqrt_error<S: Simd>(simd: S, digits: Digits) -> f64;
    /// The relative error of [`inverse`](Self::inverse) is less, rounding aside.
    fn inverse_error<S: Simd>(simd: S, digits: Digits) -> f64;
}

/// Relative error of the estimates of AVX-512.
#[cfg(target_arch = "x86_64")]
const AVX512: f64 = 1.0 / 16_384.0;
/// Terms of the series from there.
#[cfg(target_arch = "x86_64")]
const AVX512_F32: [usize; 3] = [0, 1, 1];
#[cfg(target_arch = "x86_64")]
const AVX512_F64: [usize; 3] = [0, 1, 3];
/// Relative error of the estimate of AVX, which only `f32` has.
#[cfg(target_arch = "x86_64")]
const AVX: f64 = 1.5 / 4_096.0;
#[cfg(target_arch = "x86_64")]
const AVX_F32: [usize; 3] = [0, 1, 2];
/// Relative error of [`halved_exponent`] and two terms of the series.
#[cfg(target_arch = "x86_64")]
const HALVED: f64 = 1.2e-4;
#[cfg(target_arch = "x86_64")]
const HALVED_F64: [usize; 3] = [0, 1, 4];

macro_rules! reciprocal {
    (
        $t:ident, $register:ident, $least:expr, $cubes:expr, $rsqrt14:ident, $rcp14:ident, $avx512:ident,
        $rsqrt_avx2:ident, $avx2_error:ident, $avx2:ident
    ) => {
        impl Reciprocal for $t {
            const LEAST: $t = $least;
            const CUBES: bool = $cubes;

            #[inline(always)]
            fn inverse_sqrt<S: Simd>(simd: S, digits: Digits, x: S::$register) -> S::$register {
                #[cfg(target_arch = "x86_64")]
                {
                    if let Some(machine) = is::<V4, S>(simd) {
                        let y = cast(machine.avx512f.$rsqrt14(cast(x)));
                        return refine_sqrt::<$t, S>(simd, $avx512[digits as usize], x, y);
                    }
                    if let Some(machine) = is::<V3, S>(simd) {
                        let y = $rsqrt_avx2(simd, machine, x);
                        return refine_sqrt::<$t, S>(simd, $avx2[digits as usize], x, y);
                    }
                }
                $t::one_over(simd, $t::root(simd, x))
            }

            #[inline(always)]
            fn inverse<S: Simd>(simd: S, digits: Digits, x: S::$register) -> S::$register {
                #[cfg(target_arch = "x86_64")]
                if let Some(machine) = is::<V4, S>(simd) {
                    let y = cast(machine.avx512f.$rcp14(cast(x)));
                    return refine::<$t, S>(simd, $avx512[digits as usize], x, y);
                }
                // One division of 256 bits costs no more than refining an estimate.
                $t::one_over(simd, x)
            }

            #[inline(always)]
            fn inverse_sqrt_unit<S: Simd>(simd: S, digits: Digits) -> f64 {
                #[cfg(target_arch = "x86_64")]
                {
                    if is::<V4, S>(simd).is_some() {
                        return refined_sqrt_unit($avx512[digits as usize]);
                    }
                    if is::<V3, S>(simd).is_some() {
                        return refined_sqrt_unit($avx2[digits as usize]);
                    }
                }
                1.0
            }

            #[inline(always)]
            fn inverse_sqrt_error<S: Simd>(simd: S, digits: Digits) -> f64 {
                #[cfg(target_arch = "x86_64")]
                {
                    if is::<V4, S>(simd).is_some() {
                        return refined_sqrt_error(AVX512, $avx512[digits as usize]);
                    }
                    if is::<V3, S>(simd).is_some() {
                        return refined_sqrt_error($avx2_error, $avx2[digits as usize]);
                    }
                }
                0.0
            }

            #[inline(always)]
            fn inverse_error<S: Simd>(simd: S, digits: Digits) -> f64 {
                #[cfg(target_arch = "x86_64")]
                if is::<V4, S>(simd).is_some() {
                    return AVX512.powi($avx512[digits as usize] as i32 + 1);
                }
                0.0
            }
        }
    };
}

reciprocal!(
    f32,
    f32s,
    TWO_TO_MINUS_102,
    false,
    _mm512_rsqrt14_ps,
    _mm512_rcp14_ps,
    AVX512_F32,
    rsqrt_avx,
    AVX,
    AVX_F32
);
reciprocal!(
    f64,
    f64s,
    TWO_TO_MINUS_300,
    true,
    _mm512_rsqrt14_pd,
    _mm512_rcp14_pd,
    AVX512_F64,
    halved_exponent,
    HALVED,
    HALVED_F64
);

/// r² = 2⁻¹⁰²: every square that matters in it is normal.
const TWO_TO_MINUS_102: f32 = f32::from_bits((127 - 102) << 23);
/// r² = 2⁻³⁰⁰: even r⁻⁶ is in range.
const TWO_TO_MINUS_300: f64 = f64::from_bits((1023 - 300) << 52);

/// The machine, if it is an `M`. This is known when the code is compiled: no test is left of it.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn is<M: Copy + 'static, S: Simd>(simd: S) -> Option<M> {
    (&simd as &dyn Any).downcast_ref().copied()
}

#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn rsqrt_avx<S: Simd>(_simd: S, machine: V3, x: S::f32s) -> S::f32s {
    cast(machine.avx._mm256_rsqrt_ps(cast(x)))
}

/// 1/√x within [`HALVED`]. There is no estimate in double precision, and that in single precision
/// has too few exponents. But a number's bits, read as an integer, are nearly its logarithm; halving
/// and negating it leaves 3.4 %, which two terms of the series reduce.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn halved_exponent<S: Simd>(simd: S, machine: V3, x: S::f64s) -> S::f64s {
    let half = machine.avx2._mm256_srli_epi64::<1>(cast(x));
    let magic = machine.avx._mm256_set1_epi64x(0x5fe6_eb50_c7b5_37a9);
    let y = cast(machine.avx2._mm256_sub_epi64(magic, half));
    refine_sqrt::<f64, S>(simd, 2, x, y)
}

/// y (1 − e)^(−1/2), e = 1 − x y²: the binomial series up to e^`degree`, from an estimate y of 1/√x. With one term
/// it is y (3 − x y²)/2, of which the half is left to the [unit](refined_sqrt_unit).
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn refine_sqrt<F: Registers, S: Simd>(
    simd: S,
    degree: usize,
    x: F::Register<S>,
    y: F::Register<S>,
) -> F::Register<S> {
    if degree == 0 {
        return y;
    }
    if degree == 1 {
        let three = F::splat(simd, F::from_f64(3.0));
        return F::times(simd, y, F::minus_product(simd, F::times(simd, x, y), y, three));
    }
    let coefficient = |k: usize| F::splat(simd, F::from_f64(BINOMIAL[k]));
    let e = F::minus_product(simd, F::times(simd, x, y), y, coefficient(0));
    let mut series = coefficient(degree);
    for k in (1..degree).rev() {
        series = F::plus_product(simd, series, e, coefficient(k));
    }
    F::plus_product(simd, F::times(simd, y, e), series, y)
}

/// What [`refine_sqrt`] has to be multiplied by.
#[cfg(target_arch = "x86_64")]
fn refined_sqrt_unit(degree: usize) -> f64 {
    if degree == 1 { 0.5 } else { 1.0 }
}

/// y (1 − e)⁻¹, e = 1 − x y: the geometric series up to e^`degree`, from an estimate y of 1/x.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn refine<F: Registers, S: Simd>(
    simd: S,
    degree: usize,
    x: F::Register<S>,
    y: F::Register<S>,
) -> F::Register<S> {
    if degree == 0 {
        return y;
    }
    let e = F::minus_product(simd, x, y, F::splat(simd, F::from_f64(1.0)));
    let mut series = e;
    for _ in 1..degree {
        series = F::plus_product(simd, series, e, e);
    }
    F::plus_product(simd, y, series, y)
}

/// What is left out of the series if y = (1 ± δ)/√x, so that |e| ≤ 2δ + δ².
#[cfg(target_arch = "x86_64")]
fn refined_sqrt_error(delta: f64, degree: usize) -> f64 {
    let e = delta * (2.0 + delta);
    if degree == 0 { delta } else { BINOMIAL[degree + 1] * e.powi(degree as i32 + 1) / (1.0 - e) }
}

/// (1 − e)^(−1/2) = Σ_k `BINOMIAL[k]` e^k
#[cfg(target_arch = "x86_64")]
const BINOMIAL: [f64; 6] = [1.0, 1.0 / 2.0, 3.0 / 8.0, 5.0 / 16.0, 35.0 / 128.0, 63.0 / 256.0];

#[cfg(test)]
mod tests {
    use super::*;
    use farfield::DispatchLevel;
    use pulp::WithSimd;
    use std::marker::PhantomData;

    /// The worst relative errors of 1/√x and 1/x, and their bounds.
    struct Worst<F>(Digits, PhantomData<F>);

    impl<F: Reciprocal> WithSimd for Worst<F> {
        type Output = [(f64, f64); 2];

        fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
            let digits = self.0;
            let mut worst = [0.0; 2];
            let exponent = F::LEAST.as_f64().log2() as i32;
            for i in 0..20_000 {
                let fraction = 1.0 + f64::from(i) * 0.618_034 % 1.0;
                let x = F::from_f64(fraction * 2f64.powi(exponent + i % (-2 * exponent)));
                let unit = F::inverse_sqrt_unit(simd, digits);
                let found = [
                    first::<F, S>(F::inverse_sqrt(simd, digits, F::splat(simd, x))) * unit,
                    first::<F, S>(F::inverse(simd, digits, F::splat(simd, x))),
                ];
                let exact = [x.as_f64().sqrt().recip(), x.as_f64().recip()];
                for ((worst, found), exact) in worst.iter_mut().zip(found).zip(exact) {
                    *worst = f64::max(*worst, (found / exact - 1.0).abs());
                }
            }
            let bounds = [F::inverse_sqrt_error(simd, digits), F::inverse_error(simd, digits)];
            [(worst[0], bounds[0]), (worst[1], bounds[1])]
        }
    }

    fn first<F: Registers, S: Simd>(register: F::Register<S>) -> f64 {
        let mut numbers = [F::from_f64(0.0); 16];
        F::registers_mut::<S>(&mut numbers)[0] = register;
        numbers[0].as_f64()
    }

    fn check<F: Reciprocal>() {
        for (digits, most) in [(Digits::Few, 4e-4), (Digits::Half, 3e-7), (Digits::All, 0.0)] {
            let worst = || Worst::<F>(digits, PhantomData);
            let found = DispatchLevel::available().map(|level| level.run(worst()));
            let rounding = F::epsilon().as_f64();
            for (error, bound) in found.flatten() {
                assert!(error <= bound + rounding, "{digits:?}: {error:e} > {bound:e}");
                assert!(bound <= most + rounding / 2.0, "{digits:?}: {bound:e}");
                assert!(bound < rounding || bound < 4.0 * error, "{digits:?}: {error:e} {bound:e}");
            }
        }
    }

    #[test]
    fn errors_keep_their_bounds_at_every_level() {
        check::<f32>();
        check::<f64>();
    }
}
