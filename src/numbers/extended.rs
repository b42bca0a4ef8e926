//! Numbers whose exponents don't end where those of their precision do.

use std::f64::consts::{FRAC_2_SQRT_PI, LN_2};
use std::marker::PhantomData;
use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::numbers::math;
use crate::numbers::number::Number;
use crate::numbers::traits::{Real, sealed};

/// A number with the digits of double precision and an exponent of 64 bits, for formulas over points so far apart, or
/// so near each other, that numbers of the precision `T` overflow or vanish on the way to a result that doesn't.
///
/// It knows whether that happened: [`left`](Self::left). One operation takes some ten times as long as with plain
/// numbers.
///
/// ```
/// use farfield::{Extended, Number};
///
/// let r = Extended::<f32>::new(1e30);
/// let square = r * r;
/// assert!(square.left() && !r.left());
/// assert_eq!(square.sqrt().rounded(), 1e30);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Extended<T> {
    /// From 1 to 2 in absolute value, or 0, infinite, or not a number.
    mantissa: f64,
    /// 0 with the last three.
    exponent: i64,
    left: bool,
    precision: PhantomData<T>,
}

/// Numbers this much smaller than another don't change it.
const DIGITS: i64 = 64;
/// Two times as many bits as ln 2 keeps when it is cut off: its products with exponents are exact.
const LN_2_HIGH: f64 = 0.693_147_180_369_123_8;
const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;
/// Exponents of eˣ beyond which it counts as 0 or infinite.
const LARGEST_EXPONENT: f64 = 1_048_576.0;

impl<T: Real> Extended<T> {
    /// A number of the precision.
    pub fn new(x: T) -> Self {
        Self::normal(x.as_f64(), 0, false)
    }

    /// The nearest number of the precision: infinite or zero where that ends.
    pub fn rounded(self) -> T {
        T::from_f64(self.to_f64())
    }

    /// Whether the number, or one that it was computed from, is not within the range in which the precision has all
    /// its digits.
    pub fn left(self) -> bool {
        self.left
    }

    /// The nearest number in double precision: infinite or zero where that ends.
    pub fn to_f64(self) -> f64 {
        scaled(self.mantissa, self.exponent)
    }

    /// The absolute value in double precision, where numbers that are not 0 don't become 0.
    pub fn size(self) -> f64 {
        let size = self.to_f64().abs();
        if size == 0.0 && self.mantissa != 0.0 { f64::from_bits(1) } else { size }
    }

    /// mantissa · 2^exponent, which has left the range if something that it comes from has.
    fn normal(mantissa: f64, exponent: i64, left: bool) -> Self {
        let precision = PhantomData;
        if mantissa == 0.0 || !mantissa.is_finite() {
            let left = left | mantissa.is_infinite();
            return Self { mantissa, exponent: 0, left, precision };
        }
        // Subnormal ones are lifted first.
        let (mantissa, exponent) = if mantissa.is_normal() {
            (mantissa, exponent)
        } else {
            (mantissa * 2f64.powi(64), exponent - 64)
        };
        let bits = mantissa.to_bits();
        let exponent = exponent.saturating_add((bits >> 52 & 0x7ff) as i64 - 1023);
        let mantissa = f64::from_bits(bits & !(0x7ff << 52) | 1023 << 52);
        let single = size_of::<T>() == size_of::<f32>();
        let range = if single { -126..=127 } else { -1022..=1023 };
        Self { mantissa, exponent, left: left | !range.contains(&exponent), precision }
    }

    fn of(self, x: f64) -> Self {
        Self::normal(x, 0, self.left)
    }

    /// Whether double precision has all digits of the number.
    fn fits(self) -> bool {
        (-1022..=1023).contains(&self.exponent)
    }

    /// Whether it is so small that an odd function is its tangent there.
    fn is_tiny(self) -> bool {
        self.exponent < -500
    }

    /// 2^x · mantissa, for any x.
    fn power_of_two(mantissa: f64, x: f64, left: bool) -> Self {
        let whole = x.round();
        let part = math::exp((x - whole) * LN_2);
        Self::normal(mantissa * part, whole as i64, left)
    }
}

/// x · 2^exponent, rounded once but where it is subnormal.
fn scaled(x: f64, exponent: i64) -> f64 {
    let half = exponent.clamp(-2200, 2200) / 2;
    let rest = exponent.clamp(-2200, 2200) - half;
    let power = |exponent: i64| {
        let quarter = (exponent / 2) as i32;
        [2f64.powi(quarter), 2f64.powi(exponent as i32 - quarter)]
    };
    power(half).into_iter().chain(power(rest)).fold(x, |x, factor| x * factor)
}

impl<T> sealed::Sealed for Extended<T> {}

impl<T: Real> Add for Extended<T> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        let left = self.left | other.left;
        let (large, small) =
            if self.exponent >= other.exponent { (self, other) } else { (other, self) };
        // Of zeros, infinities and what is no number, exponents say nothing.
        if self.mantissa == 0.0 {
            return Self { left, ..other };
        }
        if other.mantissa == 0.0 {
            return Self { left, ..self };
        }
        if !(self.mantissa.is_finite() && other.mantissa.is_finite()) {
            let plain = |x: Self| if x.mantissa.is_finite() { 0.0 } else { x.mantissa };
            return Self::normal(plain(self) + plain(other), 0, left);
        }
        let shift = small.exponent.saturating_sub(large.exponent);
        let addend = if shift < -DIGITS { 0.0 } else { scaled(small.mantissa, shift) };
        Self::normal(large.mantissa + addend, large.exponent, left)
    }
}

impl<T: Real> Sub for Extended<T> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl<T: Real> Mul for Extended<T> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let exponent = self.exponent.saturating_add(other.exponent);
        Self::normal(self.mantissa * other.mantissa, exponent, self.left | other.left)
    }
}

impl<T: Real> Div for Extended<T> {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let exponent = self.exponent.saturating_sub(other.exponent);
        Self::normal(self.mantissa / other.mantissa, exponent, self.left | other.left)
    }
}

impl<T: Real> Neg for Extended<T> {
    type Output = Self;
    fn neg(self) -> Self {
        Self { mantissa: -self.mantissa, ..self }
    }
}

macro_rules! with_constants {
    ($($operator:ident $method:ident),*) => {$(
        impl<T: Real> $operator<f64> for Extended<T> {
            type Output = Self;
            fn $method(self, other: f64) -> Self {
                self.$method(Self::constant(other))
            }
        }
    )*};
}

with_constants!(Add add, Sub sub, Mul mul, Div div);

impl<T: Real> Number for Extended<T> {
    type Real = T;
    type Condition = bool;

    fn constant(x: f64) -> Self {
        Self::normal(x, 0, false)
    }
    fn sqrt(self) -> Self {
        let odd = self.exponent.rem_euclid(2);
        let mantissa = if odd == 1 { 2.0 * self.mantissa } else { self.mantissa };
        Self::normal(mantissa.sqrt(), (self.exponent - odd) / 2, self.left)
    }
    fn recip(self) -> Self {
        Self::constant(1.0) / self
    }
    fn exp(self) -> Self {
        let x = self.to_f64();
        if x.abs() < 700.0 || x.is_nan() {
            return self.of(math::exp(x));
        }
        // eˣ = 2ᵏ e^(x − k ln 2)
        let k = (x / LN_2).round().clamp(-LARGEST_EXPONENT, LARGEST_EXPONENT);
        if k.abs() == LARGEST_EXPONENT {
            let end = if k > 0.0 { f64::INFINITY } else { 0.0 };
            return Self { left: true, ..self.of(end) };
        }
        Self::normal(math::exp((x - k * LN_2_HIGH) - k * LN_2_LOW), k as i64, self.left)
    }
    fn ln(self) -> Self {
        if self.fits() {
            return self.of(math::ln(self.to_f64()));
        }
        let exponent = self.exponent as f64;
        self.of(exponent * LN_2_HIGH + (exponent * LN_2_LOW + math::ln(self.mantissa)))
    }
    fn sin(self) -> Self {
        if self.is_tiny() { self } else { self.of(math::sin(self.to_f64())) }
    }
    fn cos(self) -> Self {
        self.of(math::cos(self.to_f64()))
    }
    fn tanh(self) -> Self {
        if self.is_tiny() { self } else { self.of(math::tanh(self.to_f64())) }
    }
    fn erf(self) -> Self {
        if self.is_tiny() { self * FRAC_2_SQRT_PI } else { self.of(math::erf(self.to_f64())) }
    }
    fn erfc(self) -> Self {
        self.of(math::erfc(self.to_f64()))
    }
    fn powi(self, n: i32) -> Self {
        let (mut power, mut square, mut rest) = (Self::constant(1.0), self, n.unsigned_abs());
        while rest > 0 {
            if rest & 1 == 1 {
                power = power * square;
            }
            rest >>= 1;
            if rest > 0 {
                square = square * square;
            }
        }
        if n < 0 { power.recip() } else { power }
    }
    fn powf(self, p: f64) -> Self {
        let plain = math::powf(self.to_f64(), p);
        if plain.is_normal() && self.fits() || self.mantissa == 0.0 || !self.mantissa.is_finite() {
            return self.of(plain);
        }
        Self::power_of_two(math::powf(self.mantissa, p), self.exponent as f64 * p, self.left)
    }
    fn less_than(self, other: Self) -> bool {
        match (self.mantissa.is_finite(), other.mantissa.is_finite()) {
            (true, true) => (self - other).mantissa < 0.0,
            (true, false) => other.mantissa > 0.0,
            (false, true) => self.mantissa < 0.0,
            (false, false) => self.mantissa < other.mantissa,
        }
    }
    fn select(condition: bool, yes: Self, no: Self) -> Self {
        if condition { yes } else { no }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    type Number64 = Extended<f64>;

    #[test]
    fn numbers_come_back_from_beyond_the_range() {
        for x in [1e300, 3e-308, 5e-324, 1.5, -7e200] {
            let x = Number64::new(x);
            let square = x * x;
            assert_relative_eq!(square.sqrt().rounded(), x.rounded().abs(), max_relative = 4e-16);
            assert_relative_eq!((square / x).rounded(), x.rounded(), max_relative = 4e-16);
            assert_eq!(square.left(), !(1e-300..1e300).contains(&(x.rounded() * x.rounded())));
            let same = x.powi(9) * x.powi(-8);
            assert_relative_eq!(same.rounded(), x.rounded(), max_relative = 4e-15);
            let logarithm = (square.ln() * 0.5).rounded();
            assert_relative_eq!(logarithm, x.rounded().abs().ln(), max_relative = 1e-14);
            let root = (x * x).powf(2.5).powf(0.2).rounded();
            assert_relative_eq!(root, x.rounded().abs(), max_relative = 1e-12);
        }
    }

    #[test]
    fn functions_agree_with_plain_numbers_where_these_reach() {
        for x in [-3.0, -0.1, 1e-3, 0.5, 2.0, 30.0] {
            let e = Number64::new(x);
            assert_eq!(e.exp().rounded(), math::exp(x));
            assert_eq!(e.sin().rounded(), math::sin(x));
            assert_eq!(e.cos().rounded(), math::cos(x));
            assert_eq!(e.tanh().rounded(), math::tanh(x));
            assert_eq!(e.erf().rounded(), math::erf(x));
            assert_eq!(e.erfc().rounded(), math::erfc(x));
            assert_eq!((e + 1.0).rounded(), x + 1.0);
            assert_eq!((e - 1e-17).rounded(), x - 1e-17);
            assert!(e.less_than(Number64::new(31.0)) && !e.less_than(Number64::new(-3.0)));
        }
        let small = Number64::new(-2000.0).exp() * Number64::new(1990.0).exp();
        assert_relative_eq!(small.rounded(), f64::exp(-10.0), max_relative = 1e-13);
        assert_relative_eq!(
            (Number64::new(2.0).powf(-3e3) * Number64::new(2.0).powf(3e3)).rounded(),
            1.0
        );
    }

    #[test]
    fn zeros_and_what_is_not_finite_stay_what_they_are() {
        let [zero, one, infinite] = [0.0, 1.0, f64::INFINITY].map(Number64::constant);
        assert_eq!((zero + one).rounded(), 1.0);
        assert_eq!((one - one).rounded(), 0.0);
        assert!(!(one - one).left());
        assert_eq!((one / zero).rounded(), f64::INFINITY);
        assert!((zero / zero).rounded().is_nan() && (infinite - infinite).rounded().is_nan());
        assert!(one.less_than(infinite) && !infinite.less_than(one));
        assert_eq!((infinite + one).rounded(), f64::INFINITY);
        assert!(Extended::<f32>::new(1e30).powi(2).left() && !Number64::new(1e30).powi(2).left());
        assert_eq!(Extended::<f32>::new(1e30).powi(2).rounded(), f32::INFINITY);
    }
}
