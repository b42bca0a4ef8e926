//! One real number, in loops over many that compilers turn into registers.

use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::numbers::math;
use crate::numbers::number::Number;
use crate::numbers::traits::{Real, sealed};

/// Numbers that are worked on side by side: a whole number of registers in either precision.
pub(crate) const LANES: usize = 8;

/// A real number that one lane of a register holds.
///
/// Sines and cosines of large angles take calls, with which no compiler can fill registers. With `FAR`, numbers
/// are right for all angles. Without, they say whether they come from an angle that was too large: whoever
/// evaluates a formula looks at that once in a while, and starts again with `FAR` where it is so. For all other
/// functions, and in all formulas without angles, nothing is left of this in the compiled code.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lane<T, const FAR: bool> {
    pub(crate) value: T,
    /// Whether the value is wrong, since it comes from an angle that was too large.
    pub(crate) wrong: bool,
}

/// What a comparison gives.
#[derive(Clone, Copy, Debug)]
pub struct Answer {
    holds: bool,
    wrong: bool,
}

impl<T, const FAR: bool> sealed::Sealed for Lane<T, FAR> {}

impl<T: Real, const FAR: bool> Lane<T, FAR> {
    #[inline(always)]
    pub(crate) fn new(value: T) -> Self {
        Self { value, wrong: false }
    }

    #[inline(always)]
    fn with(self, value: T) -> Self {
        Self { value, wrong: self.wrong }
    }

    /// A function of an angle, from what it is for any angle and for one that is near zero.
    #[inline(always)]
    fn of_angle(self, any: impl Fn(T) -> T, near: impl Fn(T) -> T) -> Self {
        if FAR {
            self.with(any(self.value))
        } else {
            Self { value: near(self.value), wrong: self.wrong | !self.value.is_near() }
        }
    }
}

macro_rules! operators {
    ($($operator:ident $method:ident $sign:tt),*) => {$(
        impl<T: Real, const FAR: bool> $operator for Lane<T, FAR> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self { value: self.value $sign other.value, wrong: self.wrong | other.wrong }
            }
        }

        impl<T: Real, const FAR: bool> $operator<f64> for Lane<T, FAR> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: f64) -> Self {
                self.with(self.value $sign T::from_f64(other))
            }
        }
    )*};
}

operators!(Add add +, Sub sub -, Mul mul *, Div div /);

impl<T: Real, const FAR: bool> Neg for Lane<T, FAR> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.with(-self.value)
    }
}

impl<T: Real, const FAR: bool> Number for Lane<T, FAR> {
    type Real = T;
    type Condition = Answer;

    #[inline(always)]
    fn constant(x: f64) -> Self {
        Self::new(T::from_f64(x))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.with(self.value.sqrt())
    }
    #[inline(always)]
    fn recip(self) -> Self {
        self.with(T::from_f64(1.0) / self.value)
    }
    #[inline(always)]
    fn exp(self) -> Self {
        self.with(math::exp(self.value))
    }
    #[inline(always)]
    fn ln(self) -> Self {
        self.with(math::ln(self.value))
    }
    #[inline(always)]
    fn sin(self) -> Self {
        self.of_angle(math::sin, T::near_sine)
    }
    #[inline(always)]
    fn cos(self) -> Self {
        self.of_angle(math::cos, T::near_cosine)
    }
    #[inline(always)]
    fn tanh(self) -> Self {
        self.with(math::tanh(self.value))
    }
    #[inline(always)]
    fn erf(self) -> Self {
        self.with(math::erf(self.value))
    }
    #[inline(always)]
    fn erfc(self) -> Self {
        self.with(math::erfc(self.value))
    }
    #[inline(always)]
    fn powi(self, n: i32) -> Self {
        self.with(self.value.powi(n))
    }
    #[inline(always)]
    fn powf(self, p: f64) -> Self {
        self.with(math::powf(self.value, T::from_f64(p)))
    }
    #[inline(always)]
    fn less_than(self, other: Self) -> Answer {
        Answer { holds: self.value < other.value, wrong: self.wrong | other.wrong }
    }
    #[inline(always)]
    fn select(condition: Answer, yes: Self, no: Self) -> Self {
        let value = if condition.holds { yes.value } else { no.value };
        Self { value, wrong: condition.wrong | yes.wrong | no.wrong }
    }
}
