//! The exponential function, the natural logarithm, and the hyperbolic tangent.

use crate::numbers::math::format::{Format, nearest_whole, polynomial};

/// eˣ = 2ᵏ eʳ with a whole number k and |r| ≤ ln 2 / 2 (Cody and Waite, "Software manual for the elementary
/// functions", 1980).
#[inline(always)]
pub(super) fn exp<T: Format>(x: T) -> T {
    let [least, most] = T::EXP_RANGE;
    // Comparisons with NaN are false, so that NaN stays.
    let x = if most < x { most } else { x };
    let x = if x < least { least } else { x };
    let [k, shifted] = nearest_whole(x * T::LOG2_E);
    let [ln_2, tail] = T::LN_2;
    let r = (x - k * ln_2) - k * tail;
    (T::one() + (r + exp_beyond_r(r))).times_power_of_two(shifted)
}

/// scale · e^(high + low) for a sum that is at most twice as far from zero as eˣ is of any use.
#[inline(always)]
pub(super) fn scaled_exp<T: Format>(scale: T, high: T, low: T) -> T {
    let [k, shifted] = nearest_whole(high * T::LOG2_E);
    let [ln_2, tail] = T::LN_2;
    let r = (high - k * ln_2) + (low - k * tail);
    (scale + scale * (r + exp_beyond_r(r))).times_power_of_two(shifted)
}

/// eʳ − 1 − r for |r| ≤ ln 2 / 2.
#[inline(always)]
fn exp_beyond_r<T: Format>(r: T) -> T {
    r * r * polynomial(T::EXP, r)
}

/// ln (m 2ᵏ) = k ln 2 + 2 artanh s with s = (m − 1) / (m + 1) and m between √½ and √2.
///
/// For f = m − 1 and h = f²/2, 2 artanh s is f − (h − s (h + R)) with R = 2 artanh s / s − 2: all but the last
/// sum is small, and rounded where that matters little.
#[inline(always)]
pub(super) fn ln<T: Format>(x: T) -> T {
    let [k, m] = decomposed(x);
    let f = m - T::one();
    let s = f / (m + T::one());
    let (h, z) = (T::rounded(0.5) * f * f, s * s);
    let [ln_2, tail] = T::LN_2;
    let small = s * (h + z * polynomial(T::LN, z)) + k * tail;
    let positive = k * ln_2 - ((h - small) - f);
    let finite = if x > T::zero() { positive } else { T::nan() };
    let finite = if x == T::zero() { -T::infinity() } else { finite };
    if x == T::infinity() { x } else { finite }
}

/// The exponent k and the rest m, between √½ and √2, of a number m 2ᵏ that is positive and finite.
#[inline(always)]
pub(super) fn decomposed<T: Format>(x: T) -> [T; 2] {
    let subnormal = x < T::min_positive_value();
    let [k, m] = (if subnormal { x * (T::one() / T::epsilon()) } else { x }).exponent_and_rest();
    [if subnormal { k - T::DIGITS } else { k }, m]
}

/// a + b, and what rounding takes from it, for |a| ≥ |b| (Dekker's Fast2Sum).
#[inline(always)]
fn with_rounding<T: Format>(a: T, b: T) -> (T, T) {
    let sum = a + b;
    (sum, b - (sum - a))
}

/// tanh x = E / (E + 2) with E = e²ˣ − 1 = 2ᵏ (eʳ − 1) + (2ᵏ − 1), for x ≥ 0.
#[inline(always)]
pub(super) fn tanh<T: Format>(x: T) -> T {
    let y = x.abs() + x.abs();
    // The comparison with NaN is false, so that NaN stays.
    let y = if T::TWICE_TANH_RANGE < y { T::TWICE_TANH_RANGE } else { y };
    let [k, shifted] = nearest_whole(y * T::LOG2_E);
    let [ln_2, tail] = T::LN_2;
    let (close, less) = (y - k * ln_2, k * tail);
    let r = close - less;
    let scale = T::power_of_two(shifted);
    // The two large terms, then the small ones together with what rounding took from the large ones.
    let (first, second) = (scale - T::one(), scale * r);
    let (sum, rounding) = with_rounding(first, second);
    let rest = rounding + scale * (exp_beyond_r(r) + ((close - r) - less));
    let (one, half, two) = (T::one(), T::rounded(0.5), T::rounded(2.0));
    let (e, e_low) = with_rounding(sum, rest);
    let d = e + two;
    let d_low = (e - (d - two)) + (two - (d - (d - two)));
    // The first correction of the quotient; 1 / (E + 2) is (1 − tanh x) / 2.
    let quotient = e / d;
    let correction = (e_low - quotient * (d_low + e_low)) * (half * (one - quotient));
    (quotient + correction).copysign(x)
}
