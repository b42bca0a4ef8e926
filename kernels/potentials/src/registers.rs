//! Arithmetic on registers of `f32` or `f64`, under one name for both.

use farfield::Real;
use pulp::Simd;

/// A precision, with the operations on its registers that the near field needs. `S` stands for the
/// instructions that the machine was found to have; [`Register`](Self::Register) is as wide as these
/// allow.
pub trait Registers: Real {
    /// Several numbers side by side.
    type Register<S: Simd>: Copy;

    /// The numbers as registers; what doesn't fill one is left out.
    fn registers<S: Simd>(numbers: &[Self]) -> &[Self::Register<S>];
    /// The numbers as registers, to write to.
    fn registers_mut<S: Simd>(numbers: &mut [Self]) -> &mut [Self::Register<S>];
    /// The same number in every place.
    fn splat<S: Simd>(simd: S, a: Self) -> Self::Register<S>;
    /// a − b
    fn minus<S: Simd>(simd: S, a: Self::Register<S>, b: Self::Register<S>) -> Self::Register<S>;
    /// a + b
    fn plus<S: Simd>(simd: S, a: Self::Register<S>, b: Self::Register<S>) -> Self::Register<S>;
    /// The lesser of a and b.
    fn lesser<S: Simd>(simd: S, a: Self::Register<S>, b: Self::Register<S>) -> Self::Register<S>;
    /// a b
    fn times<S: Simd>(simd: S, a: Self::Register<S>, b: Self::Register<S>) -> Self::Register<S>;
    /// a b + c, rounded once where the machine has an instruction for it.
    fn plus_product<S: Simd>(
        simd: S,
        a: Self::Register<S>,
        b: Self::Register<S>,
        c: Self::Register<S>,
    ) -> Self::Register<S>;
    /// c − a b, rounded once where the machine has an instruction for it.
    fn minus_product<S: Simd>(
        simd: S,
        a: Self::Register<S>,
        b: Self::Register<S>,
        c: Self::Register<S>,
    ) -> Self::Register<S>;
    /// a where x ≥ `least`, 0 elsewhere.
    fn where_at_least<S: Simd>(
        simd: S,
        x: Self::Register<S>,
        least: Self::Register<S>,
        a: Self::Register<S>,
    ) -> Self::Register<S>;
    /// 1/x, by division.
    fn one_over<S: Simd>(simd: S, x: Self::Register<S>) -> Self::Register<S>;
    /// √x
    fn root<S: Simd>(simd: S, x: Self::Register<S>) -> Self::Register<S>;
    /// The sum of all places.
    fn sum<S: Simd>(simd: S, x: Self::Register<S>) -> Self;
}

macro_rules! registers {
    (
        $t:ident, $register:ident, $as_simd:ident, $as_mut_simd:ident, $splat:ident,
        $add:ident, $min:ident, $sub:ident, $mul:ident, $div:ident, $sqrt:ident, $mul_add:ident, $sub_product:ident,
        $at_least:ident, $select:ident, $reduce:ident
    ) => {
        impl Registers for $t {
            type Register<S: Simd> = S::$register;

            #[inline(always)]
            fn registers<S: Simd>(numbers: &[$t]) -> &[S::$register] {
                S::$as_simd(numbers).0
            }
            #[inline(always)]
            fn registers_mut<S: Simd>(numbers: &mut [$t]) -> &mut [S::$register] {
                S::$as_mut_simd(numbers).0
            }
            #[inline(always)]
            fn splat<S: Simd>(simd: S, a: $t) -> S::$register {
                simd.$splat(a)
            }
            #[inline(always)]
            fn minus<S: Simd>(simd: S, a: S::$register, b: S::$register) -> S::$register {
                simd.$sub(a, b)
            }
            #[inline(always)]
            fn plus<S: Simd>(simd: S, a: S::$register, b: S::$register) -> S::$register {
                simd.$add(a, b)
            }
            #[inline(always)]
            fn lesser<S: Simd>(simd: S, a: S::$register, b: S::$register) -> S::$register {
                simd.$min(a, b)
            }
            #[inline(always)]
            fn times<S: Simd>(simd: S, a: S::$register, b: S::$register) -> S::$register {
                simd.$mul(a, b)
            }
            #[inline(always)]
            fn plus_product<S: Simd>(
                simd: S,
                a: S::$register,
                b: S::$register,
                c: S::$register,
            ) -> S::$register {
                simd.$mul_add(a, b, c)
            }
            #[inline(always)]
            fn minus_product<S: Simd>(
                simd: S,
                a: S::$register,
                b: S::$register,
                c: S::$register,
            ) -> S::$register {
                simd.$sub_product(a, b, c)
            }
            #[inline(always)]
            fn where_at_least<S: Simd>(
                simd: S,
                x: S::$register,
                least: S::$register,
                a: S::$register,
            ) -> S::$register {
                simd.$select(simd.$at_least(x, least), a, simd.$splat(0.0))
            }
            #[inline(always)]
            fn one_over<S: Simd>(simd: S, x: S::$register) -> S::$register {
                simd.$div(simd.$splat(1.0), x)
            }
            #[inline(always)]
            fn root<S: Simd>(simd: S, x: S::$register) -> S::$register {
                simd.$sqrt(x)
            }
            #[inline(always)]
            fn sum<S: Simd>(simd: S, x: S::$register) -> $t {
                simd.$reduce(x)
            }
        }
    };
}

registers!(
    f32,
    f32s,
    as_simd_f32s,
    as_mut_simd_f32s,
    splat_f32s,
    add_f32s,
    min_f32s,
    sub_f32s,
    mul_f32s,
    div_f32s,
    sqrt_f32s,
    mul_add_e_f32s,
    negate_mul_add_e_f32s,
    greater_than_or_equal_f32s,
    select_f32s,
    reduce_sum_f32s
);
registers!(
    f64,
    f64s,
    as_simd_f64s,
    as_mut_simd_f64s,
    splat_f64s,
    add_f64s,
    min_f64s,
    sub_f64s,
    mul_f64s,
    div_f64s,
    sqrt_f64s,
    mul_add_e_f64s,
    negate_mul_add_e_f64s,
    greater_than_or_equal_f64s,
    select_f64s,
    reduce_sum_f64s
);
