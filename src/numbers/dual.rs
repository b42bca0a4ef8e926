//! Numbers that carry their derivatives along.

use std::f64::consts::FRAC_2_SQRT_PI;
use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::numbers::number::Number;
use crate::numbers::traits::sealed;

/// A number together with its derivatives along the three axes (a dual number with three parts). A
/// dual of duals carries second derivatives too.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual<N> {
    pub(crate) value: N,
    pub(crate) slope: [N; 3],
}

impl<N> sealed::Sealed for Dual<N> {}

impl<N: Number> Dual<N> {
    /// A number that does not change from place to place.
    #[inline(always)]
    pub(crate) fn fixed(value: N) -> Self {
        Self { value, slope: [N::constant(0.0); 3] }
    }

    /// The coordinate along `axis`.
    #[inline(always)]
    pub(crate) fn along(value: N, axis: usize) -> Self {
        let mut slope = [N::constant(0.0); 3];
        slope[axis] = N::constant(1.0);
        Self { value, slope }
    }

    /// f(self), from f and its derivative at the value: the chain rule.
    #[inline(always)]
    fn chain(self, value: N, derivative: N) -> Self {
        Self { value, slope: self.slope.map(|slope| slope * derivative) }
    }

    /// The same with both sides combined part by part.
    #[inline(always)]
    fn combine(self, value: N, other: Self, slope: impl Fn(N, N) -> N) -> Self {
        let [a, b, c] = self.slope;
        let [p, q, r] = other.slope;
        Self { value, slope: [slope(a, p), slope(b, q), slope(c, r)] }
    }
}

impl<N: Number> Add for Dual<N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.combine(self.value + other.value, other, |a, b| a + b)
    }
}

impl<N: Number> Sub for Dual<N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.combine(self.value - other.value, other, |a, b| a - b)
    }
}

impl<N: Number> Mul for Dual<N> {
    type Output = Self;
    #[inline(always)]
    #[expect(clippy::suspicious_arithmetic_impl, reason = "the product rule is a sum")]
    fn mul(self, other: Self) -> Self {
        let (u, v) = (self.value, other.value);
        self.combine(u * v, other, |a, b| a * v + b * u)
    }
}

impl<N: Number> Div for Dual<N> {
    type Output = Self;
    #[inline(always)]
    #[expect(clippy::suspicious_arithmetic_impl, reason = "the quotient rule is a difference")]
    fn div(self, other: Self) -> Self {
        let inverse = other.value.recip();
        let quotient = self.value / other.value;
        self.combine(quotient, other, |a, b| (a - b * quotient) * inverse)
    }
}

impl<N: Number> Neg for Dual<N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { value: -self.value, slope: self.slope.map(|slope| -slope) }
    }
}

impl<N: Number> Add<f64> for Dual<N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: f64) -> Self {
        Self { value: self.value + other, slope: self.slope }
    }
}

impl<N: Number> Sub<f64> for Dual<N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: f64) -> Self {
        Self { value: self.value - other, slope: self.slope }
    }
}

impl<N: Number> Mul<f64> for Dual<N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: f64) -> Self {
        Self { value: self.value * other, slope: self.slope.map(|slope| slope * other) }
    }
}

impl<N: Number> Div<f64> for Dual<N> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: f64) -> Self {
        Self { value: self.value / other, slope: self.slope.map(|slope| slope / other) }
    }
}

impl<N: Number> Number for Dual<N> {
    type Real = N::Real;
    type Condition = N::Condition;

    #[inline(always)]
    fn constant(x: f64) -> Self {
        Self::fixed(N::constant(x))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, root.recip() * 0.5)
    }
    #[inline(always)]
    fn recip(self) -> Self {
        let inverse = self.value.recip();
        self.chain(inverse, -(inverse * inverse))
    }
    #[inline(always)]
    fn exp(self) -> Self {
        let exp = self.value.exp();
        self.chain(exp, exp)
    }
    #[inline(always)]
    fn ln(self) -> Self {
        self.chain(self.value.ln(), self.value.recip())
    }
    #[inline(always)]
    fn sin(self) -> Self {
        self.chain(self.value.sin(), self.value.cos())
    }
    #[inline(always)]
    fn cos(self) -> Self {
        self.chain(self.value.cos(), -self.value.sin())
    }
    #[inline(always)]
    fn tanh(self) -> Self {
        let tanh = self.value.tanh();
        self.chain(tanh, -(tanh * tanh) + 1.0)
    }
    #[inline(always)]
    fn erf(self) -> Self {
        self.chain(self.value.erf(), erf_slope(self.value))
    }
    #[inline(always)]
    fn erfc(self) -> Self {
        self.chain(self.value.erfc(), -erf_slope(self.value))
    }
    #[inline(always)]
    fn powi(self, n: i32) -> Self {
        // x⁰ is flat, also at x = 0, where x⁻¹ is not a number.
        let derivative =
            if n == 0 { N::constant(0.0) } else { self.value.powi(n - 1) * f64::from(n) };
        self.chain(self.value.powi(n), derivative)
    }
    #[inline(always)]
    fn powf(self, p: f64) -> Self {
        let derivative = if p == 0.0 { N::constant(0.0) } else { self.value.powf(p - 1.0) * p };
        self.chain(self.value.powf(p), derivative)
    }
    #[inline(always)]
    fn less_than(self, other: Self) -> N::Condition {
        self.value.less_than(other.value)
    }
    #[inline(always)]
    fn select(condition: N::Condition, yes: Self, no: Self) -> Self {
        let value = N::select(condition, yes.value, no.value);
        yes.combine(value, no, |a, b| N::select(condition, a, b))
    }
}

/// The derivative 2/√π e^(−x²) of the error function.
#[inline(always)]
fn erf_slope<N: Number>(x: N) -> N {
    (-(x * x)).exp() * FRAC_2_SQRT_PI
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numbers::lane::Lane;
    use approx::assert_relative_eq;

    type Plain = Lane<f64, false>;
    type Twice = Dual<Dual<Plain>>;

    /// A named function of (x, y, z), in any numbers.
    trait Function {
        fn at<N: Number>(x: N, y: N, z: N) -> N;
    }

    fn plain<F: Function>([x, y, z]: [f64; 3]) -> f64 {
        F::at::<Plain>(Lane::new(x), Lane::new(y), Lane::new(z)).value
    }

    fn twice<F: Function>(p: [f64; 3]) -> Twice {
        let [x, y, z] = [0, 1, 2].map(|axis| {
            let inner = Dual::along(Lane::new(p[axis]), axis);
            Dual::along(inner, axis)
        });
        F::at(x, y, z)
    }

    /// First and second derivatives against central differences.
    fn check<F: Function>(p: [f64; 3]) {
        let found = twice::<F>(p);
        assert_eq!(found.value.value.value, plain::<F>(p));
        let moved = |steps: &[(usize, f64)]| {
            let mut moved = p;
            steps.iter().for_each(|&(axis, step)| moved[axis] += step);
            plain::<F>(moved)
        };
        let h = 1e-4;
        for i in 0..3 {
            let slope = (moved(&[(i, h)]) - moved(&[(i, -h)])) / (2.0 * h);
            let both = [found.slope[i].value.value, found.value.slope[i].value];
            assert_relative_eq!(both[0], both[1], max_relative = 1e-14);
            assert_relative_eq!(both[0], slope, epsilon = 1e-6, max_relative = 1e-6);
            for j in 0..3 {
                let corner = |a: f64, b: f64| moved(&[(i, a * h), (j, b * h)]);
                let sum = corner(1.0, 1.0) - corner(1.0, -1.0) - corner(-1.0, 1.0);
                let curvature = (sum + corner(-1.0, -1.0)) / (4.0 * h * h);
                let exact = found.slope[i].slope[j].value;
                assert_relative_eq!(exact, curvature, epsilon = 2e-5, max_relative = 2e-5);
            }
        }
    }

    macro_rules! functions {
        ($($name:ident |$x:ident, $y:ident, $z:ident| $formula:expr;)*) => {$(
            struct $name;
            impl Function for $name {
                fn at<N: Number>($x: N, $y: N, $z: N) -> N {
                    $formula
                }
            }
        )*};
    }

    functions! {
        Arithmetic |x, y, z| (x * y - z / x + y * 3.0 - 2.0) / (z + 4.0) / 2.0 - (-x) * z;
        Roots |x, y, z| (x * x + y * y + z * z).sqrt().recip() + (x * y).sqrt();
        Exponentials |x, y, z| (-(x * y)).exp() * z.ln() + (x * z).tanh();
        Errors |x, y, z| (x * y).erf() * z.erfc();
        Waves |x, y, z| (x * y).sin() * z.cos() + (z * 2.0).sin();
        Powers |x, y, z| x.powi(3) * y.powi(-2) + z.powf(1.7) + x.powi(0) + y.powf(0.0) + y.powi(1);
        Choices |x, y, z| (x - 5.0).abs() * y.max(z) + N::select(x.less_than(y), x * x, y * y) + x.min(z);
    }

    #[test]
    fn derivatives_agree_with_differences() {
        for p in [[0.7, 1.3, 0.4], [1.9, 0.2, 2.5]] {
            check::<Arithmetic>(p);
            check::<Roots>(p);
            check::<Exponentials>(p);
            check::<Errors>(p);
            check::<Waves>(p);
            check::<Powers>(p);
            check::<Choices>(p);
        }
    }
}
