//! Powers of positive numbers, for any exponent.

use crate::numbers::math::exponential::{decomposed, exp, ln, scaled_exp};
use crate::numbers::math::format::{Format, polynomial};

/// 2/3 in two parts, of which the first has 26 digits.
const TWO_THIRDS: [f64; 2] = [0.6666666567325592, 9.934107462565105e-9];
/// From here on, every power is 0, 1 or infinite, but for numbers that are no double.
const LARGEST_EXPONENT: f64 = (1u128 << 70) as f64;
/// A power that is e to more than this is infinite; e to less than minus this is zero.
const RANGE: f64 = 800.0;

/// (3 artanh s / s − 3 − s²) / s⁴ for |s| ≤ 3 − √8, in powers of s².
const LN_REST: [f64; 7] = [
    0.6000000000000004,
    0.42857142857007485,
    0.3333333340677797,
    0.2727271235100472,
    0.23078363674230062,
    0.19928886985863298,
    0.19371034075422539,
];

/// xᵖ = e^(p ln x), with ln x and the product in about 66 digits.
#[inline(always)]
pub(super) fn powf(x: f64, p: f64) -> f64 {
    let [log, log_tail] = ln_in_two_parts(x.abs());
    let p_clamped = if LARGEST_EXPONENT < p { LARGEST_EXPONENT } else { p };
    let p_clamped = if p_clamped < -LARGEST_EXPONENT { -LARGEST_EXPONENT } else { p_clamped };
    let p_high = high(p_clamped);
    let product = p_high * log;
    let tail = p_clamped * log_tail + (p_clamped - p_high) * log;
    // Comparisons with NaN are false, so that NaN stays.
    let clamped = if RANGE < product { RANGE } else { product };
    let clamped = if clamped < -RANGE { -RANGE } else { clamped };
    let tail = if clamped == product { tail } else { 0.0 };
    special(x, p, scaled_exp(1.0, clamped, tail))
}

/// As [`powf`], in single precision.
#[inline(always)]
pub(super) fn powf_single(x: f32, p: f32) -> f32 {
    let (x, p) = (f64::from(x), f64::from(p));
    special(x, p, exp(p * ln(x.abs()))) as f32
}

/// xᵖ for any x and p, given |x|ᵖ for a finite x other than zero and a p other than zero.
#[inline(always)]
fn special(x: f64, p: f64, power: f64) -> f64 {
    let whole = p == p.trunc();
    let odd = whole && 0.5 * p != (0.5 * p).trunc();
    let at_zero = if p > 0.0 { 0.0 } else { f64::INFINITY };
    let at_infinity = if p > 0.0 { f64::INFINITY } else { 0.0 };
    let power = if x == 0.0 { at_zero } else { power };
    let power = if x.abs() == f64::INFINITY { at_infinity } else { power };
    let below = if odd { -power } else { power };
    let below = if whole { below } else { f64::NAN };
    let power = if x < 0.0 { below } else { power };
    let power = if x.is_nan() { x } else { power };
    if x == 1.0 || p == 0.0 { 1.0 } else { power }
}

/// ln x for a positive, finite x in two parts, of which the first has 26 digits.
///
/// ln (m 2ᵏ) = k ln 2 + 2/3 s (3 + s² + R) with s = (m − 1) / (m + 1), where R is small enough to be rounded, and
/// everything else is kept in two parts.
#[inline(always)]
fn ln_in_two_parts(x: f64) -> [f64; 2] {
    let [k, m] = decomposed(x);
    let f = m - 1.0;
    let inverse = 1.0 / (m + 1.0);
    let s = f * inverse;
    let s_high = high(s);
    let m_high = high(m);
    // What s_high leaves of f = s (m + 1): all products are exact.
    let left = ((f - s_high) - s_high * m_high) - s_high * (m - m_high);
    let s_low = left * inverse;
    let square = s_high * s_high;
    let square_low = s_low * (s_high + s);
    let z = square + square_low;
    let rest = z * z * polynomial(&LN_REST, z) + square_low;
    let sum = high(3.0 + square + rest);
    let sum_low = rest - ((sum - 3.0) - square);
    let product = s_high * sum;
    let product_low = s_low * sum + sum_low * s;
    let p = high(product + product_low);
    let p_low = product_low - (p - product);
    let [ln_2, ln_2_tail] = f64::LN_2;
    let (start, more) = (k * ln_2, TWO_THIRDS[0] * p);
    let more_low = TWO_THIRDS[1] * p + p_low * (TWO_THIRDS[0] + TWO_THIRDS[1]) + k * ln_2_tail;
    let log = start + more;
    let log_low = (more - (log - start)) + more_low;
    let result = high(log + log_low);
    [result, log_low - (result - log)]
}

/// The first 26 digits: products of two such numbers are exact.
#[inline(always)]
pub(super) fn high(x: f64) -> f64 {
    f64::from_bits(x.to_bits() & !((1 << 27) - 1))
}
