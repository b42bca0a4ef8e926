//! The functions in either precision.

use crate::numbers::math::exponential::{exp, ln, tanh};
use crate::numbers::math::{error_function, power, trigonometric};

/// The elementary functions of a precision.
///
/// Not named as the functions are, so that they are not mixed up with those of the standard library.
pub trait Functions: Copy {
    /// eˣ
    fn exponential(self) -> Self;
    /// ln x
    fn logarithm(self) -> Self;
    /// tanh x
    fn hyperbolic_tangent(self) -> Self;
    /// Whether |x| is small enough for the next two.
    fn is_near(self) -> bool;
    /// sin x
    fn near_sine(self) -> Self;
    /// cos x
    fn near_cosine(self) -> Self;
    /// xᵖ
    fn power(self, p: Self) -> Self;
    /// erf x
    fn error_function(self) -> Self;
    /// erfc x
    fn complementary_error_function(self) -> Self;
}

macro_rules! functions {
    ($t:ident, $sin:ident, $cos:ident, $powf:ident, $erf:ident, $erfc:ident) => {
        impl Functions for $t {
            #[inline(always)]
            fn exponential(self) -> Self {
                exp(self)
            }
            #[inline(always)]
            fn logarithm(self) -> Self {
                ln(self)
            }
            #[inline(always)]
            fn hyperbolic_tangent(self) -> Self {
                tanh(self)
            }
            #[inline(always)]
            fn is_near(self) -> bool {
                self.abs() <= trigonometric::NEAR as $t
            }
            #[inline(always)]
            fn near_sine(self) -> Self {
                trigonometric::$sin(self)
            }
            #[inline(always)]
            fn near_cosine(self) -> Self {
                trigonometric::$cos(self)
            }
            #[inline(always)]
            fn power(self, p: Self) -> Self {
                power::$powf(self, p)
            }
            #[inline(always)]
            fn error_function(self) -> Self {
                error_function::$erf(self)
            }
            #[inline(always)]
            fn complementary_error_function(self) -> Self {
                error_function::$erfc(self)
            }
        }
    };
}

functions!(f32, sin_near_single, cos_near_single, powf_single, erf_single, erfc_single);
functions!(f64, sin_near, cos_near, powf, erf, erfc);
