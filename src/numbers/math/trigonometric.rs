//! Sines and cosines.

use crate::numbers::math::format::{nearest_whole, polynomial};

/// Up to this, three parts of π/2 are enough for all digits of sines and cosines.
pub(super) const NEAR: f64 = 1e5;

/// π/2 in three parts. The first two have 37 digits, so that products with up to 2¹⁶ are exact.
const HALF_PI: [f64; 3] = [1.5707963267923333, 2.5633441515839558e-12, 1.0562999066987428e-23];
/// What the first part leaves of π/2, as one number.
const HALF_PI_TAIL: f64 = 2.563344151594519e-12;

/// (sin r − r) / r³ for |r| ≤ π/4, in powers of r².
const SIN: [f64; 6] = [
    -0.16666666666666666,
    0.008333333333330946,
    -0.0001984126983675497,
    2.755731610068303e-6,
    -2.5051131455427946e-8,
    1.591810123027412e-10,
];
/// (cos r − 1 + r²/2) / r⁴ for |r| ≤ π/4, in powers of r².
const COS: [f64; 6] = [
    0.041666666666666664,
    -0.0013888888888887395,
    2.4801587298763433e-5,
    -2.7557317270560326e-7,
    2.0876146024689747e-9,
    -1.1382614868556325e-11,
];
/// As `SIN`, for results in single precision.
const SIN_SINGLE: [f64; 3] = [-0.16666664661114838, 0.008332748037517147, -0.00019587840521305324];
/// As `COS`, for results in single precision.
const COS_SINGLE: [f64; 3] = [0.04166666465830042, -0.0013888302802309161, 2.454789161981386e-5];

/// sin x for |x| up to [`NEAR`].
#[inline(always)]
pub(super) fn sin_near(x: f64) -> f64 {
    sin_and_cos(x).0
}

/// cos x for |x| up to [`NEAR`].
#[inline(always)]
pub(super) fn cos_near(x: f64) -> f64 {
    sin_and_cos(x).1
}

/// As [`sin_near`], in single precision.
#[inline(always)]
pub(super) fn sin_near_single(x: f32) -> f32 {
    sin_and_cos_single(f64::from(x)).0 as f32
}

/// As [`cos_near`], in single precision.
#[inline(always)]
pub(super) fn cos_near_single(x: f32) -> f32 {
    sin_and_cos_single(f64::from(x)).1 as f32
}

/// sin x and cos x from those of r = x − k π/2 with a whole number k and |r| ≤ π/4 (Cody and Waite, "Software
/// manual for the elementary functions", 1980). Compilers drop the one that is not asked for.
#[inline(always)]
fn sin_and_cos(x: f64) -> (f64, f64) {
    let [k, shifted] = nearest_whole(x * std::f64::consts::FRAC_2_PI);
    // The first difference is exact. What rounding takes away from the second counts next to a multiple of π/2.
    let close = x - k * HALF_PI[0];
    let less = k * HALF_PI[1];
    let closer = close - less;
    let r = closer + (((close - closer) - less) - k * HALF_PI[2]);
    let z = r * r;
    let sin = r + r * z * polynomial(&SIN, z);
    let cos = 1.0 - (0.5 * z - z * z * polynomial(&COS, z));
    turned(sin, cos, shifted.to_bits())
}

/// As [`sin_and_cos`], with errors of 1e-8.
#[inline(always)]
fn sin_and_cos_single(x: f64) -> (f64, f64) {
    let [k, shifted] = nearest_whole(x * std::f64::consts::FRAC_2_PI);
    let r = (x - k * HALF_PI[0]) - k * HALF_PI_TAIL;
    let z = r * r;
    let sin = r + r * z * polynomial(&SIN_SINGLE, z);
    let cos = 1.0 - (0.5 * z - z * z * polynomial(&COS_SINGLE, z));
    turned(sin, cos, shifted.to_bits())
}

/// The sine and the cosine of r + k π/2 from those of r.
#[inline(always)]
fn turned(sin: f64, cos: f64, k: u64) -> (f64, f64) {
    let odd = k & 1 == 1;
    let (s, c) = if odd { (cos, sin) } else { (sin, cos) };
    let sign = |k: u64| (k & 2) << 62;
    (f64::from_bits(s.to_bits() ^ sign(k)), f64::from_bits(c.to_bits() ^ sign(k.wrapping_add(1))))
}
