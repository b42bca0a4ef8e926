//! The power laws on registers.

use pulp::Simd;

use crate::exponent::Exponent;
use crate::reciprocal::{Digits, Reciprocal};

/// The exponents that the near field's inner loop knows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Law {
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
    /// The law of an exponent, if it is one of these.
    #[inline(always)]
    pub(crate) fn of<E: Exponent>() -> Option<Self> {
        match E::LAMBDA {
            0.5 => Some(Self::MinusOne),
            1.0 => Some(Self::MinusTwo),
            2.0 => Some(Self::MinusFour),
            -1.0 => Some(Self::PlusTwo),
            _ => None,
        }
    }

    /// K = r^(−2λ) and r⁻² in [units](Self::units), both 0 where r² < `least`, if there is such a bound. For r²,
    /// whose gradient is 2d, the latter is of no use and left out, as is the bound.
    #[inline(always)]
    pub(crate) fn at<F: Reciprocal, S: Simd>(
        self,
        simd: S,
        digits: Digits,
        least: Option<F::Register<S>>,
        r2: F::Register<S>,
    ) -> (F::Register<S>, Option<F::Register<S>>) {
        let apart = |a| match least {
            Some(least) => F::where_at_least(simd, r2, least, a),
            None => a,
        };
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

    /// What K and K r⁻² from [`at`](Self::at) have to be multiplied by: powers of two.
    #[inline(always)]
    pub(crate) fn units<F: Reciprocal, S: Simd>(self, simd: S, digits: Digits) -> [f64; 2] {
        match self {
            Self::MinusOne => {
                let unit = F::inverse_sqrt_unit(simd, digits);
                [unit, unit * unit * unit]
            }
            Self::MinusTwo | Self::MinusFour | Self::PlusTwo => [1.0; 2],
        }
    }

    /// The relative error of K, or of K and its gradient.
    #[inline(always)]
    pub(crate) fn error<F: Reciprocal, S: Simd>(
        self,
        simd: S,
        digits: Digits,
        gradient: bool,
    ) -> f64 {
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
