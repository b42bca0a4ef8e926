//! The power laws on registers.
//!
//! Which law it is, and how many digits it needs, are types: of each loop, only what it does is compiled.

use pulp::Simd;

use crate::exponent::Exponent;
use crate::reciprocal::{Digits, Reciprocal};

/// Whether the near field's inner loop knows the law r^(−2λ): 1/r, 1/r², 1/r⁴ and r².
pub(crate) const fn is_known<E: Exponent>() -> bool {
    matches!(E::LAMBDA, 0.5 | 1.0 | 2.0 | -1.0)
}

/// K = r^(−2λ) and r⁻² in [units](units), both 0 where r² < `least`, if there is such a bound. For r², whose gradient
/// is 2d, the latter is of no use and left out, as is the bound.
#[inline(always)]
pub(crate) fn power<E: Exponent, F: Reciprocal, S: Simd, D: Digits>(
    simd: S,
    least: Option<F::Register<S>>,
    r2: F::Register<S>,
) -> (F::Register<S>, Option<F::Register<S>>) {
    if const { E::LAMBDA == -1.0 } {
        return (r2, None);
    }
    let apart = |a| match least {
        Some(least) => F::where_at_least(simd, r2, least, a),
        None => a,
    };
    if const { E::LAMBDA == 0.5 } {
        let k = apart(F::inverse_sqrt::<S, D>(simd, r2));
        return (k, Some(F::times(simd, k, k)));
    }
    let inverse = apart(F::inverse::<S, D>(simd, r2));
    let k = if const { E::LAMBDA == 2.0 } { F::times(simd, inverse, inverse) } else { inverse };
    (k, Some(inverse))
}

/// What K and K r⁻² from [`power`] have to be multiplied by: powers of two.
#[inline(always)]
pub(crate) fn units<E: Exponent, F: Reciprocal, S: Simd, D: Digits>(simd: S) -> [f64; 2] {
    if const { E::LAMBDA == 0.5 } {
        let unit = F::inverse_sqrt_unit::<S, D>(simd);
        [unit, unit * unit * unit]
    } else {
        [1.0; 2]
    }
}

/// The relative error of K, or of K and its gradient.
#[inline(always)]
pub(crate) fn error<E: Exponent, F: Reciprocal, S: Simd, D: Digits>(
    simd: S,
    gradient: bool,
) -> f64 {
    if const { E::LAMBDA == -1.0 } {
        return 0.0;
    }
    let (power, error) = if const { E::LAMBDA == 0.5 } {
        (1 + 2 * i32::from(gradient), F::inverse_sqrt_error::<S, D>(simd))
    } else {
        (E::LAMBDA as i32 + i32::from(gradient), F::inverse_error::<S, D>(simd))
    };
    (1.0 + error).powi(power) - 1.0
}

/// K d / r² as a vector and a factor, multiplied in an order that stays in range.
#[inline(always)]
pub(crate) fn slope<F: Reciprocal, S: Simd>(
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
