//! The numbers that formulas are written in.

use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::numbers::traits::{Real, sealed};

/// A number that a [`Formula`](crate::Formula) is written in. It stands for several real numbers side by
/// side, and, where derivatives are wanted, for these too.
///
/// Formulas branch by [`select`](Self::select), since different numbers of one register may go
/// different ways. Literals are on the right: `r * 2.0`, or [`constant`](Self::constant).
///
/// Functions are those of the module [`math`](crate::math), with the errors given here in units in the last place
/// (ulp); √x and 1/x are rounded correctly.
///
/// Sealed: the engine chooses the numbers.
pub trait Number:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
    + Div<f64, Output = Self>
    + sealed::Sealed
{
    /// The precision underneath.
    type Real: Real;
    /// What comparing gives: an answer for each of the numbers side by side.
    type Condition: Copy;

    /// The number `x` in every place.
    fn constant(x: f64) -> Self;
    /// √x. Its derivative does not exist at x = 0.
    fn sqrt(self) -> Self;
    /// 1/x
    fn recip(self) -> Self;
    /// eˣ, to 1 ulp.
    fn exp(self) -> Self;
    /// The natural logarithm, to 1 ulp.
    fn ln(self) -> Self;
    /// The sine of an angle in radians, to 1.5 ulp up to 10⁵. One larger angle makes a whole block of pairs slow.
    fn sin(self) -> Self;
    /// The cosine of an angle in radians, as [`sin`](Self::sin).
    fn cos(self) -> Self;
    /// The hyperbolic tangent, to 1.5 ulp.
    fn tanh(self) -> Self;
    /// The error function 2/√π ∫₀ˣ e^(−t²) dt, to 1.5 ulp.
    fn erf(self) -> Self;
    /// The complementary error function 1 − erf x, to 1.5 ulp up to x = 0.7, and to 3 ulp beyond.
    fn erfc(self) -> Self;
    /// xⁿ for a whole number n.
    fn powi(self, n: i32) -> Self;
    /// xᵖ for x ≥ 0, to 1.5 ulp.
    fn powf(self, p: f64) -> Self;
    /// Whether `self` < `other`.
    fn less_than(self, other: Self) -> Self::Condition;
    /// `yes` where the condition holds, `no` elsewhere.
    fn select(condition: Self::Condition, yes: Self, no: Self) -> Self;

    /// |x|
    #[inline(always)]
    fn abs(self) -> Self {
        Self::select(self.less_than(Self::constant(0.0)), -self, self)
    }

    /// The smaller of two numbers.
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self::select(other.less_than(self), other, self)
    }

    /// The larger of two numbers.
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self::select(self.less_than(other), other, self)
    }
}

/// A point or a difference of points, in the numbers of a formula.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coordinates<N> {
    /// Along the first axis.
    pub x: N,
    /// Along the second axis.
    pub y: N,
    /// Along the third axis.
    pub z: N,
}

impl<N: Number> Coordinates<N> {
    /// The inner product x·x' + y·y' + z·z'.
    #[inline(always)]
    pub fn dot(self, other: Self) -> N {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    /// The squared Euclidean length.
    #[inline(always)]
    pub fn length_squared(self) -> N {
        self.dot(self)
    }

    /// The Euclidean length. Its derivative does not exist at zero: take
    /// [`length_squared`](Self::length_squared) where that is possible, or skip coincident pairs.
    #[inline(always)]
    pub fn length(self) -> N {
        self.length_squared().sqrt()
    }

    /// The three components.
    #[inline(always)]
    pub fn to_array(self) -> [N; 3] {
        [self.x, self.y, self.z]
    }
}

impl<N: Number> Sub for Coordinates<N> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }
}
