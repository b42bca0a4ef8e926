//! Numbers side by side, in loops that compilers turn into registers.

use std::array::from_fn;
use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::numbers::number::Number;
use crate::numbers::traits::{Real, sealed};

/// `L` real numbers side by side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lanes<T, const L: usize>(pub(crate) [T; L]);

impl<T, const L: usize> sealed::Sealed for Lanes<T, L> {}

macro_rules! operators {
    ($($operator:ident $method:ident $assign:tt),*) => {$(
        impl<T: Real, const L: usize> $operator for Lanes<T, L> {
            type Output = Self;
            #[inline(always)]
            fn $method(mut self, other: Self) -> Self {
                for l in 0..L {
                    self.0[l] $assign other.0[l];
                }
                self
            }
        }

        impl<T: Real, const L: usize> $operator<f64> for Lanes<T, L> {
            type Output = Self;
            #[inline(always)]
            fn $method(mut self, other: f64) -> Self {
                let other = T::from_f64(other);
                for l in 0..L {
                    self.0[l] $assign other;
                }
                self
            }
        }
    )*};
}

operators!(Add add +=, Sub sub -=, Mul mul *=, Div div /=);

impl<T: Real, const L: usize> Neg for Lanes<T, L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.map(|x| -x)
    }
}

impl<T: Real, const L: usize> Lanes<T, L> {
    /// Every number times the same one.
    #[inline(always)]
    pub(crate) fn scaled(self, scale: T) -> Self {
        self.map(|x| x * scale)
    }

    #[inline(always)]
    fn map(mut self, f: impl Fn(T) -> T) -> Self {
        for l in 0..L {
            self.0[l] = f(self.0[l]);
        }
        self
    }
}

impl<T: Real, const L: usize> Number for Lanes<T, L> {
    type Real = T;
    type Condition = [bool; L];

    #[inline(always)]
    fn constant(x: f64) -> Self {
        Self([T::from_f64(x); L])
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.map(T::sqrt)
    }
    #[inline(always)]
    fn recip(self) -> Self {
        self.map(|x| T::from_f64(1.0) / x)
    }
    #[inline(always)]
    fn exp(self) -> Self {
        self.map(T::exp)
    }
    #[inline(always)]
    fn ln(self) -> Self {
        self.map(T::ln)
    }
    #[inline(always)]
    fn sin(self) -> Self {
        self.map(T::sin)
    }
    #[inline(always)]
    fn cos(self) -> Self {
        self.map(T::cos)
    }
    #[inline(always)]
    fn tanh(self) -> Self {
        self.map(T::tanh)
    }
    #[inline(always)]
    fn powi(self, n: i32) -> Self {
        self.map(|x| x.powi(n))
    }
    #[inline(always)]
    fn powf(self, p: f64) -> Self {
        self.map(|x| x.powf(T::from_f64(p)))
    }
    #[inline(always)]
    fn less_than(self, other: Self) -> [bool; L] {
        from_fn(|l| self.0[l] < other.0[l])
    }
    #[inline(always)]
    fn select(condition: [bool; L], yes: Self, no: Self) -> Self {
        Self(from_fn(|l| if condition[l] { yes.0[l] } else { no.0[l] }))
    }
}
