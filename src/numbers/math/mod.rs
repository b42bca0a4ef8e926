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
//! | [`exp`], [`ln`] | 1 |
//! | [`sin`], [`cos`] up to 10⁵; beyond, they are those of the standard library | 1.5 |
//! | [`tanh`], [`powf`], [`erf`] | 1.5 |
//! | [`erfc`] up to x = 0.7; beyond, where it falls to zero | 1.5; 3 |

pub(crate) mod error_function;
pub(crate) mod exponential;
pub(crate) mod format;
pub(crate) mod functions;
pub(crate) mod power;
#[cfg(test)]
mod reference;
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

#[cfg(test)]
mod tests {
    use super::reference::{self, Pair};
    use super::*;
    use crate::dispatch_level::DispatchLevel;
    use pulp::{Simd, WithSimd};
    use std::fmt::Debug;

    /// Numbers from `least` to `most`.
    fn spread(least: f64, most: f64) -> impl Iterator<Item = f64> + Clone {
        let at = move |i: u32| least + (most - least) * (f64::from(i) * 0.618_033_988_7).fract();
        (0..10_000).map(at)
    }

    /// Numbers of all magnitudes from `least` to `most`.
    fn magnitudes(least: f64, most: f64) -> impl Iterator<Item = f64> + Clone {
        spread(least.ln(), most.ln()).map(f64::exp)
    }

    /// Those and the same below zero.
    fn signed(numbers: impl Iterator<Item = f64> + Clone) -> impl Iterator<Item = f64> {
        numbers.clone().chain(numbers.map(|x| -x))
    }

    /// The error of a number whose exact value is normal, in units in the last place.
    fn ulp(found: f64, Pair(high, low): Pair) -> f64 {
        let power_of_two = f64::from_bits(high.abs().to_bits() & (0x7ff << 52));
        ((found - high) - low).abs() / (power_of_two * f64::EPSILON)
    }

    /// The same in single precision; 0 where the nearest number was found, and for all that is not normal.
    fn ulp_single(found: f32, exact: f64) -> f64 {
        let nearest = exact as f32;
        if found == nearest || (found.is_nan() && nearest.is_nan()) {
            return 0.0;
        }
        let power_of_two = f32::from_bits(nearest.to_bits() & (0xff << 23)).max(f32::MIN_POSITIVE);
        (f64::from(found) - exact).abs() / f64::from(power_of_two * f32::EPSILON)
    }

    /// Holds the errors of a function to a bound.
    fn check<X: Copy + Debug>(
        name: &str,
        bound: f64,
        arguments: impl IntoIterator<Item = X>,
        error: impl Fn(X) -> f64,
    ) {
        let errors = arguments.into_iter().map(|x| (error(x), x));
        let (worst, at) = errors.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
        println!("{name}: {worst:.3} ulp at {at:?}");
        assert!(worst <= bound, "{name} of {at:?} is wrong by {worst} ulp");
    }

    #[test]
    fn double_precision_is_as_accurate_as_documented() {
        let exponents = signed(magnitudes(1e-300, 690.0)).chain(spread(-690.0, 709.0));
        check("exp", 1.0, exponents, |x| ulp(exp(x), reference::exp(Pair::of(x))));
        let near_one = spread(0.5, 2.0).chain(signed(magnitudes(1e-15, 0.3)).map(|d| 1.0 + d));
        let numbers = magnitudes(1e-307, 1e308).chain(near_one);
        check("ln", 1.0, numbers, |x| ulp(ln(x), reference::ln(x)));
        // Next to multiples of π/2, digits cancel.
        let next = (1..63_000).step_by(7).map(|k| f64::from(k) * std::f64::consts::FRAC_PI_2);
        let angles = signed(magnitudes(1e-300, 1e5).chain(spread(0.0, 7.0)).chain(next));
        let angles: Vec<f64> = angles.collect();
        check("sin", 1.5, angles.iter(), |&x| ulp(sin(x), reference::sin(x)));
        check("cos", 1.5, angles.iter(), |&x| ulp(cos(x), reference::cos(x)));
        let numbers = signed(magnitudes(1e-300, 22.0).chain(spread(0.0, 2.0)));
        check("tanh", 1.5, numbers, |x| ulp(tanh(x), reference::tanh(x)));
        let numbers = signed(magnitudes(1e-300, 6.0).chain(spread(0.1, 6.0)));
        check("erf", 1.5, numbers, |x| ulp(erf(x), reference::erf(x)));
        check("erfc", 1.5, spread(-6.0, 0.7), |x| ulp(erfc(x), reference::erfc(x)));
        check("erfc, tail", 3.0, spread(0.7, 26.0), |x| ulp(erfc(x), reference::erfc(x)));
    }

    #[test]
    fn powers_are_as_accurate_as_documented() {
        let error = |(x, p): (f64, f64)| ulp(powf(x, p), reference::powf(x, p));
        // The exponents take powers from one end of the range to the other.
        let with_exponents = |x: f64| {
            let most = 690.0 / x.ln().abs();
            [-1.0, -0.71, -0.01, 0.3, 0.999].map(|share| (x, share * most))
        };
        let numbers = magnitudes(1e-307, 1e308).chain(spread(0.5, 2.0));
        let numbers = numbers.chain(signed(magnitudes(1e-9, 0.3)).map(|d| 1.0 + d));
        check("powf", 1.5, numbers.flat_map(with_exponents), error);
        let usual = |x: f64| [-3.0, -1.5, 0.5, 0.7, 1.0, 2.0, 3.3].map(|p| (x, p));
        check("powf, usual exponents", 1.5, spread(1e-3, 10.0).flat_map(usual), error);
    }

    #[test]
    fn single_precision_is_as_accurate_as_documented() {
        let numbers = || (0..=u32::MAX).step_by(4_999).map(f32::from_bits);
        macro_rules! check {
            ($($name:ident $bound:literal $exact:expr;)*) => {$(
                check(stringify!($name), $bound, numbers(), |x| ulp_single($name(x), $exact(f64::from(x))));
            )*};
        }
        check! {
            exp 1.0 f64::exp;
            ln 1.0 f64::ln;
            sin 1.0 f64::sin;
            cos 1.0 f64::cos;
            tanh 1.5 f64::tanh;
            erf 1.0 erf::<f64>;
            erfc 1.0 erfc::<f64>;
        }
        for p in [-40.5, -1.3, -1.0, 0.001, 0.5, 0.7, 2.0, 3.0, 40.5] {
            let exact = |x: f32| f64::from(x).powf(f64::from(p));
            check("powf", 1.0, numbers(), |x| ulp_single(powf(x, p), exact(x)));
        }
    }

    #[test]
    fn the_reference_agrees_with_known_digits() {
        let close = |Pair(high, low): Pair, digits: [f64; 2]| {
            let error = ((high - digits[0]) + (low - digits[1])).abs() / high.abs();
            assert!(error < 1e-28, "{high:e} + {low:e}: {error:e}");
        };
        close(reference::exp(Pair::of(-3.7)), [0.024723526470339388, -1.294857794723138e-18]);
        close(reference::ln(0.3), [-1.2039728043259361, 8.935521583403776e-17]);
        close(reference::sin(1e4), [-0.30561438888825215, 1.1737169553511932e-17]);
        close(reference::cos(2.5), [-0.8011436155469337, -1.8674742705085553e-17]);
        close(reference::tanh(0.3), [0.2913126124515909, -6.4602656586469586e-18]);
        close(reference::tanh(1e-4), [9.999999966666667e-5, 4.51890806545438e-21]);
        close(reference::powf(1.5, 10.25), [63.81685612928153, 3.0315032076075073e-16]);
        close(reference::erf(0.9), [0.7969082124228322, -2.3193178035628794e-17]);
        close(reference::erf(3.0), [0.9999779095030014, 5.363397058636269e-17]);
        close(reference::erfc(4.0), [1.541725790028002e-8, -1.1417872168371026e-24]);
    }

    #[test]
    fn what_is_not_normal_is_as_usual() {
        let (inf, nan) = (f64::INFINITY, f64::NAN);
        macro_rules! check {
            ($($f:ident($($x:expr),*) = $y:expr;)*) => {$(
                let (found, expected): (f64, f64) = ($f($($x),*), $y);
                let same = found == expected || (found.is_nan() && expected.is_nan());
                assert!(same, "{}{:?}: {found:e}", stringify!($f), ($($x),*));
                // Single precision has the same, but for what is out of its range.
                if expected == 0.0 || !expected.is_normal() || expected.abs() <= 2.0 {
                    let found = f64::from($f($($x as f32),*));
                    let same = found == expected || (found.is_nan() && expected.is_nan());
                    assert!(same, "{}{:?} in single precision: {found:e}", stringify!($f), ($($x),*));
                }
            )*};
        }
        check! {
            exp(0.0) = 1.0; exp(-inf) = 0.0; exp(inf) = inf; exp(nan) = nan; exp(1e30) = inf; exp(-1e30) = 0.0;
            ln(1.0) = 0.0; ln(0.0) = -inf; ln(-0.0) = -inf; ln(-1.0) = nan; ln(-inf) = nan; ln(inf) = inf;
            ln(nan) = nan;
            sin(0.0) = 0.0; sin(inf) = nan; sin(-inf) = nan; sin(nan) = nan;
            cos(0.0) = 1.0; cos(inf) = nan; cos(-inf) = nan; cos(nan) = nan;
            tanh(0.0) = 0.0; tanh(inf) = 1.0; tanh(-inf) = -1.0; tanh(nan) = nan; tanh(1e30) = 1.0;
            erf(0.0) = 0.0; erf(inf) = 1.0; erf(-inf) = -1.0; erf(nan) = nan;
            erfc(0.0) = 1.0; erfc(inf) = 0.0; erfc(-inf) = 2.0; erfc(nan) = nan; erfc(-30.0) = 2.0;
            powf(0.0, 2.0) = 0.0; powf(0.0, -2.0) = inf; powf(0.0, 0.0) = 1.0; powf(nan, 0.0) = 1.0;
            powf(1.0, nan) = 1.0; powf(1.0, inf) = 1.0; powf(2.0, nan) = nan; powf(nan, 2.0) = nan;
            powf(inf, 0.5) = inf; powf(inf, -0.5) = 0.0; powf(2.0, inf) = inf; powf(2.0, -inf) = 0.0;
            powf(0.5, inf) = 0.0; powf(0.5, -inf) = inf; powf(-1.0, 3.0) = -1.0; powf(-1.0, 2.0) = 1.0;
            powf(-2.0, 0.5) = nan; powf(-inf, 3.0) = -inf; powf(2.0, 1e30) = inf; powf(2.0, -1e30) = 0.0;
            powf(nan, nan) = nan;
        }
        assert_eq!(tanh(-0.0f64).to_bits(), (-0.0f64).to_bits());
        assert_eq!(erf(-0.0f64).to_bits(), (-0.0f64).to_bits());
    }

    #[test]
    fn subnormal_numbers_and_the_ends_of_the_range_are_rounded_well() {
        let close = |found: f64, exact: f64| {
            let steps = found.to_bits().abs_diff(exact.to_bits());
            assert!(steps <= 1, "{found:e} instead of {exact:e}");
        };
        close(exp(-708.25), 2.5759248692837695e-308);
        close(exp(-720.0), 2.0322308024e-313);
        close(exp(-745.0), 5e-324);
        close(exp(709.75), 1.7398368732641605e308);
        close(erfc(26.5), 2.2109076642637343e-307);
        close(erfc(27.0), 5.23705e-319);
        close(powf(2.0, -1060.5), 5.7238e-320);
        close(powf(5e-324, 0.5), 2.2227587494850775e-162);
        close(ln(5e-324), -744.4400719213812);
        for k in 1..=1074 {
            close(powf(2.0, -f64::from(k)), 0.5f64.powi(k));
        }
    }

    /// All functions of some numbers, in loops that are compiled for a level.
    struct Loops<'a, T>(&'a [T]);

    impl<T: Real> WithSimd for Loops<'_, T> {
        type Output = Vec<T>;

        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) -> Vec<T> {
            let mut found = vec![T::from_f64(0.0); 9 * self.0.len()];
            let (part, xs) = (self.0.len(), self.0);
            let mut parts = found.chunks_exact_mut(part);
            macro_rules! loops {
                ($($f:expr),*) => {$(
                    for (y, x) in parts.next().unwrap_or_default().iter_mut().zip(xs) {
                        *y = $f(*x);
                    }
                )*};
            }
            let p = T::from_f64(1.7);
            loops!(exp, ln, sin, cos, T::near_sine, tanh, erf, erfc, |x| powf(x, p));
            found
        }
    }

    fn check_levels<T: Real>(numbers: &[f64]) {
        let numbers: Vec<T> = numbers.iter().map(|x| T::from_f64(*x)).collect();
        let alone: Vec<Vec<T>> =
            numbers.iter().map(|x| DispatchLevel::Portable.run(Loops(&[*x]))).collect();
        for level in DispatchLevel::available() {
            let found = level.run(Loops(&numbers));
            for (k, &found) in found.iter().enumerate() {
                let (f, i) = (k / numbers.len(), k % numbers.len());
                let expected = alone[i][f];
                let same = found == expected || (found.is_nan() && expected.is_nan());
                assert!(same, "{level}, function {f} of {:?}: {found:?}", numbers[i]);
            }
        }
    }

    #[test]
    fn bits_are_the_same_in_registers_of_any_width() {
        let mut numbers: Vec<f64> = signed(magnitudes(1e-3, 1e3)).collect();
        numbers.extend(signed(magnitudes(1e-320, 1e308)));
        numbers.extend([0.0, -0.0, f64::INFINITY, f64::NEG_INFINITY, f64::NAN]);
        check_levels::<f64>(&numbers);
        check_levels::<f32>(&numbers);
    }
}
