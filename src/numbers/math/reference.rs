//! The functions in twice the precision, slowly and in other ways: what tests compare with.

use std::f64::consts::{FRAC_1_PI, LN_2};

/// The unevaluated sum of two numbers: about 106 bits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair(pub(super) f64, pub(super) f64);

/// ln 2, 2/√π, and π/2 in three parts.
const LN_2_PAIR: Pair = Pair(LN_2, 2.3190468138462996e-17);
const TWO_BY_ROOT_PI: Pair = Pair(std::f64::consts::FRAC_2_SQRT_PI, 1.533545961316588e-17);
const HALF_PI: [f64; 3] =
    [std::f64::consts::FRAC_PI_2, 6.123233995736766e-17, -1.4973849048591698e-33];

impl Pair {
    pub(super) fn of(x: f64) -> Self {
        Self(x, 0.0)
    }

    /// a · b without rounding.
    fn product(a: f64, b: f64) -> Self {
        let high = a * b;
        Self(high, a.mul_add(b, -high))
    }

    fn plus(self, other: Self) -> Self {
        let high = self.0 + other.0;
        let part = high - self.0;
        let low = (self.0 - (high - part)) + (other.0 - part);
        let low = low + (self.1 + other.1);
        let sum = high + low;
        Self(sum, low - (sum - high))
    }

    fn minus(self, other: Self) -> Self {
        self.plus(Self(-other.0, -other.1))
    }

    fn times(self, other: Self) -> Self {
        let Self(high, low) = Self::product(self.0, other.0);
        let low = low + (self.0 * other.1 + self.1 * other.0);
        let sum = high + low;
        Self(sum, low - (sum - high))
    }

    fn over(self, other: Self) -> Self {
        let first = self.0 / other.0;
        let left = self.minus(other.times(Self::of(first)));
        Self::of(first).plus(Self::of(left.0 / other.0))
    }

    /// 2ᵏ · `self`, in steps that stay in range.
    fn shifted(self, k: i32) -> Self {
        let (half, rest) = (2f64.powi(k / 2), 2f64.powi(k - k / 2));
        Self(self.0 * half * rest, self.1 * half * rest)
    }
}

/// By the series, for a small part of what is left of x after multiples of ln 2.
pub(super) fn exp(x: Pair) -> Pair {
    const HALVINGS: i32 = 8;
    let k = (x.0 / LN_2).round();
    let r = x.minus(LN_2_PAIR.times(Pair::of(k))).shifted(-HALVINGS);
    let mut sum = Pair::of(1.0);
    for n in (1..=12).rev() {
        sum = Pair::of(1.0).plus(r.times(sum).over(Pair::of(f64::from(n))));
    }
    (0..HALVINGS).for_each(|_| sum = sum.times(sum));
    sum.shifted(k as i32)
}

/// By the series 2 artanh s = 2 Σ s²ⁿ⁺¹ / (2n+1) with s = (m − 1) / (m + 1), after powers of two.
pub(super) fn ln(x: f64) -> Pair {
    let k = x.log2().round() as i32;
    let m = Pair::of(x).shifted(-k);
    let s = m.minus(Pair::of(1.0)).over(m.plus(Pair::of(1.0)));
    let z = s.times(s);
    let add =
        |sum: Pair, n: u32| z.times(sum).plus(Pair::of(2.0).over(Pair::of((2 * n + 1).into())));
    let sum = (0..24).rev().fold(Pair::of(0.0), add);
    LN_2_PAIR.times(Pair::of(k.into())).plus(s.times(sum))
}

/// By the series of what is left of x after multiples of π/2.
pub(super) fn sin(x: f64) -> Pair {
    sin_of_sum(x, 0.0)
}

/// sin (x + π/2)
pub(super) fn cos(x: f64) -> Pair {
    sin_of_sum(x, 1.0)
}

/// sin (x + quarters · π/2)
fn sin_of_sum(x: f64, quarters: f64) -> Pair {
    let k = (2.0 * x * FRAC_1_PI).round();
    let r = HALF_PI.iter().fold(Pair::of(x), |r, &part| r.minus(Pair::product(k, part)));
    let quadrant = (k + quarters).rem_euclid(4.0);
    let z = r.times(r);
    let series = |first: f64| {
        let mut sum = Pair::of(1.0);
        for n in (1..=13).rev() {
            let n = 2.0 * f64::from(n) + first;
            sum = Pair::of(1.0).minus(z.times(sum).over(Pair::of(n * (n - 1.0))));
        }
        sum
    };
    let turned = if quadrant % 2.0 == 1.0 { series(0.0) } else { r.times(series(1.0)) };
    if quadrant >= 2.0 { Pair::of(0.0).minus(turned) } else { turned }
}

/// By exponentials, or by the series near zero.
pub(super) fn tanh(x: f64) -> Pair {
    if x.abs() < 1e-3 {
        let z = Pair::product(x, x);
        let coefficients = [(-17.0, 315.0), (2.0, 15.0), (-1.0, 3.0), (1.0, 1.0)];
        let add = |sum: Pair, (a, b): (f64, f64)| z.times(sum).plus(Pair::of(a).over(Pair::of(b)));
        return Pair::of(x).times(coefficients.into_iter().fold(Pair::of(0.0), add));
    }
    let e = exp(Pair::of(2.0 * x));
    e.minus(Pair::of(1.0)).over(e.plus(Pair::of(1.0)))
}

/// xᵖ for x > 0.
pub(super) fn powf(x: f64, p: f64) -> Pair {
    exp(ln(x).times(Pair::of(p)))
}

/// By 2/√π e^(−x²) Σ 2ⁿ x²ⁿ⁺¹ / (2n+1)!!, of which all terms have one sign, or from the complement.
pub(super) fn erf(x: f64) -> Pair {
    if x.abs() > SERIES {
        let complement = erfc(x.abs());
        let one = Pair::of(1.0).minus(complement);
        return one.times(Pair::of(x.signum()));
    }
    let z = Pair::product(x, x);
    let mut sum = Pair::of(1.0);
    for n in (1..=80).rev() {
        let next = z.times(sum).times(Pair::of(2.0)).over(Pair::of(2.0 * f64::from(n) + 1.0));
        sum = Pair::of(1.0).plus(next);
    }
    TWO_BY_ROOT_PI.times(exp(Pair::of(0.0).minus(z))).times(sum).times(Pair::of(x))
}

/// By Laplace's continued fraction, or from the error function.
pub(super) fn erfc(x: f64) -> Pair {
    if x < SERIES {
        return Pair::of(1.0).minus(erf(x));
    }
    let mut fraction = Pair::of(x);
    for n in (1..=500).rev() {
        fraction = Pair::of(x).plus(Pair::of(0.5 * f64::from(n)).over(fraction));
    }
    let scale =
        TWO_BY_ROOT_PI.times(Pair::of(0.5)).times(exp(Pair::of(0.0).minus(Pair::product(x, x))));
    scale.over(fraction)
}

/// Up to this, the error function is summed, and its complement follows from it.
const SERIES: f64 = 2.5;
