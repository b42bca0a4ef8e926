//! Elementary functions that compilers turn into wide registers.
//!
//! A call of the standard library's [`f64::exp`] in a loop is a call for every number. The functions of this
//! module have no branches and no calls, but for sines and cosines of large angles, so that a loop around them
//! is compiled for several numbers at once. [Formulas](crate::Formula) are evaluated with them. A closure for
//! [`from_fn`](crate::from_fn) may call them as well:
//!
//! ```
//! use farfield::glam::DVec3;
//! use farfield::{direct, from_fn, math};
//!
//! let kernel = from_fn(|x: DVec3, y: DVec3| math::exp(-x.distance_squared(y)));
//! let sum = direct(&kernel, &[DVec3::ZERO], &[2.0], &[DVec3::X])?;
//! assert!((sum[0] - 2.0 * f64::exp(-1.0)).abs() < 1e-15);
//! # Ok::<(), farfield::Error>(())
//! ```
//!
//! The same argument gives the same bits on every processor, in every loop. Errors are in units in the last
//! place of the result (ulp). They hold for results that are normal numbers, and were measured on dense samples
//! of all magnitudes, against twice the precision:
//!
//! | function | ulp |
//! |---|---|
//! | [`exp`], [`ln`], [`powf`] | 1 |
//! | [`sin`], [`cos`] up to 10⁵; beyond, they are those of the standard library | 1.5 |
//! | [`tanh`], [`erf`] | 1.5 |
//! | [`erfc`] up to x = 0.7; beyond, where it falls to zero | 1.5; 3 |

pub(crate) mod error_function;
pub(crate) mod exponential;
pub(crate) mod format;
pub(crate) mod functions;
pub(crate) mod power;
pub(crate) mod trigonometric;

use crate::numbers::traits::Real;

/// eˣ. Results below the normal numbers are rounded once more; those out of range are 0 or ∞.
#[inline(always)]
pub fn exp<T: Real>(x: T) -> T {
    x.exponential()
}

/// The natural logarithm: −∞ for 0, and NaN for x < 0.
#[inline(always)]
pub fn ln<T: Real>(x: T) -> T {
    x.logarithm()
}

/// The sine of an angle in radians. There is a branch for |x| > 10⁵, so that no loop around it is compiled for
/// several numbers at once; formulas go round that. The sine of −0 is +0.
#[inline(always)]
pub fn sin<T: Real>(x: T) -> T {
    if x.is_near() { x.near_sine() } else { x.sin() }
}

/// The cosine of an angle in radians, with a branch as in [`sin`].
#[inline(always)]
pub fn cos<T: Real>(x: T) -> T {
    if x.is_near() { x.near_cosine() } else { x.cos() }
}

/// The hyperbolic tangent.
#[inline(always)]
pub fn tanh<T: Real>(x: T) -> T {
    x.hyperbolic_tangent()
}

/// xᵖ. For x < 0, NaN unless p is a whole number; x⁰ and 1ᵖ are 1. A zero of either sign counts as +0.
#[inline(always)]
pub fn powf<T: Real>(x: T, p: T) -> T {
    x.power(p)
}

/// The error function 2/√π ∫₀ˣ e^(−t²) dt.
#[inline(always)]
pub fn erf<T: Real>(x: T) -> T {
    x.error_function()
}

/// The complementary error function 1 − erf x, to all its digits also where it is small.
#[inline(always)]
pub fn erfc<T: Real>(x: T) -> T {
    x.complementary_error_function()
}
