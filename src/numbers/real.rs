//! Numbers and points: the real precisions, the scalars of kernels, what charges, values and terms
//! can do, and things that sit at points.

use std::fmt::Debug;
use std::ops::{Add, Mul, Neg, Sub};

use glam::{DVec3, Vec3};
use num_complex::Complex;
use num_traits::{Float, FloatConst, MulAdd, NumAssign};

use crate::linalg::dense::Dense;

/// A type that can be added and subtracted: charges, values, multipole and local terms.
pub trait Additive: Copy + Debug + Send + Sync + 'static {
    /// The neutral element of addition.
    fn zero() -> Self;
    /// `self += other`.
    fn accumulate(&mut self, other: &Self);
    /// `self -= other`.
    fn subtract(&mut self, other: &Self);
    /// Whether no component is NaN or infinite.
    fn is_finite(&self) -> bool;
    /// The l2 norm of all components, in double precision, also where their squares would leave its range.
    fn norm(&self) -> f64;
    /// The square of [`norm`](Self::norm).
    #[inline(always)]
    fn norm_squared(&self) -> f64 {
        let norm = self.norm();
        norm * norm
    }
}

/// The l2 norm of all of `items`, also where squares leave the range of numbers. O(n).
pub(crate) fn l2_norm<V: Additive>(items: impl Iterator<Item = V> + Clone) -> f64 {
    let squares: f64 = items.clone().map(|v| v.norm_squared()).sum();
    // Then no square that matters has overflowed or lost digits.
    if (1e-280..1e280).contains(&squares) {
        return squares.sqrt();
    }
    items.fold(0.0, |norm, v| norm.hypot(v.norm()))
}

/// An [`Additive`] type that can be scaled by `S`: a vector space over `S`.
///
/// Numbers, complex numbers, glam vectors and arrays of any of them are linear.
pub trait Linear<S>: Additive {
    /// `self += scale · other`.
    fn add_scaled(&mut self, scale: S, other: &Self);
}

/// A fixed number of independent right-hand sides, each a number of type `S`.
///
/// Numbers, complex numbers, glam vectors and arrays of any of them qualify.
pub trait Columns<S>: Linear<S> {
    /// How many.
    const WIDTH: usize;
    /// The number in one of them.
    fn column(&self, index: usize) -> S;
    /// Puts a number into one of them.
    fn set_column(&mut self, index: usize, number: S);
}

/// The number type that a kernel's entries have: f32, f64 or a complex number over them.
pub trait Scalar:
    Columns<Self> + NumAssign + MulAdd<Output = Self> + Neg<Output = Self> + Default + Dense
{
    /// The real precision underneath.
    type Real: Real;
    /// Whether there is an imaginary part.
    const COMPLEX: bool;
    /// The scalar with the given real part and no imaginary part.
    fn from_real(x: Self::Real) -> Self;
    /// The scalar with the given parts; a real number drops the imaginary one.
    fn from_parts(re: Self::Real, im: Self::Real) -> Self;
    /// The real and the imaginary part.
    fn parts(self) -> [Self::Real; 2];
    /// The complex conjugate; a real number is its own.
    fn conjugate(self) -> Self;
    /// The same kind of number in single precision.
    type Single: Scalar<Real = f32>;
    /// The nearest number in single precision.
    fn to_single(self) -> Self::Single;
    /// A number in single precision, as it is.
    fn from_single(single: Self::Single) -> Self;
    /// Absolute value.
    fn modulus(self) -> Self::Real;
}

/// A floating-point precision: `f32` or `f64`.
pub trait Real:
    Scalar<Real = Self> + Float + FloatConst + Linear<Self> + std::fmt::Display + sealed::Sealed
{
    /// The glam vector of this precision: [`Vec3`] or [`DVec3`].
    type Vector: Vector<Self>;
    /// The nearest value of this precision.
    fn from_f64(x: f64) -> Self;
    /// The same value in double precision.
    fn as_f64(self) -> f64;
}

/// A point in space: [`DVec3`] for `f64`, [`Vec3`] for `f32`.
pub type Point<T> = <T as Real>::Vector;

/// What the engine needs of glam's vectors, in either precision.
pub trait Vector<T: Real>:
    Linear<T>
    + Default
    + PartialEq
    + Located<Real = T>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Neg<Output = Self>
    + Mul<T, Output = Self>
{
    /// The vector (x, y, z).
    fn from_array(xyz: [T; 3]) -> Self;
    /// Its three components.
    fn to_array(self) -> [T; 3];
    /// Inner product.
    fn dot(self, other: Self) -> T;
    /// Squared Euclidean length.
    #[inline(always)]
    fn length_squared(self) -> T {
        self.dot(self)
    }
}

/// Anything that sits at a point. Attributes (normals, areas, ids) travel along with it: the tree
/// sorts the user's own things, not copies of their coordinates.
pub trait Located: Clone + Debug + Send + Sync + 'static {
    /// The precision of the coordinates.
    type Real: Real;
    /// Where it is.
    fn position(&self) -> Point<Self::Real>;
}

mod sealed {
    pub trait Sealed {}
}

macro_rules! real {
    ($t:ty, $vector:ty) => {
        impl sealed::Sealed for $t {}

        impl Additive for $t {
            #[inline(always)]
            fn zero() -> Self {
                0.0
            }
            #[inline(always)]
            fn accumulate(&mut self, other: &Self) {
                *self += other;
            }
            #[inline(always)]
            fn subtract(&mut self, other: &Self) {
                *self -= other;
            }
            #[inline(always)]
            fn is_finite(&self) -> bool {
                <$t>::is_finite(*self)
            }
            #[inline(always)]
            fn norm(&self) -> f64 {
                self.as_f64().abs()
            }
        }

        impl Linear<$t> for $t {
            #[inline(always)]
            fn add_scaled(&mut self, scale: $t, other: &Self) {
                *self += scale * other;
            }
        }

        impl Columns<$t> for $t {
            const WIDTH: usize = 1;
            #[inline(always)]
            fn column(&self, _: usize) -> $t {
                *self
            }
            #[inline(always)]
            fn set_column(&mut self, _: usize, number: $t) {
                *self = number;
            }
        }

        impl Scalar for $t {
            type Real = $t;
            const COMPLEX: bool = false;
            #[inline(always)]
            fn from_real(x: $t) -> Self {
                x
            }
            #[inline(always)]
            fn from_parts(re: $t, _: $t) -> Self {
                re
            }
            #[inline(always)]
            fn parts(self) -> [$t; 2] {
                [self, 0.0]
            }
            #[inline(always)]
            fn conjugate(self) -> Self {
                self
            }
            type Single = f32;
            #[inline(always)]
            fn to_single(self) -> f32 {
                self as f32
            }
            #[inline(always)]
            fn from_single(single: f32) -> Self {
                <$t>::from(single)
            }
            #[inline(always)]
            fn modulus(self) -> $t {
                self.abs()
            }
        }

        impl Real for $t {
            type Vector = $vector;
            #[inline(always)]
            fn from_f64(x: f64) -> Self {
                x as $t
            }
            #[inline(always)]
            fn as_f64(self) -> f64 {
                self as f64
            }
        }

        impl Linear<$t> for Complex<$t> {
            #[inline(always)]
            fn add_scaled(&mut self, scale: $t, other: &Self) {
                *self += other * scale;
            }
        }

        impl Columns<$t> for Complex<$t> {
            const WIDTH: usize = 2;
            #[inline(always)]
            fn column(&self, index: usize) -> $t {
                if index == 0 { self.re } else { self.im }
            }
            #[inline(always)]
            fn set_column(&mut self, index: usize, number: $t) {
                *(if index == 0 { &mut self.re } else { &mut self.im }) = number;
            }
        }

        impl Columns<$t> for $vector {
            const WIDTH: usize = 3;
            #[inline(always)]
            fn column(&self, index: usize) -> $t {
                self[index]
            }
            #[inline(always)]
            fn set_column(&mut self, index: usize, number: $t) {
                self[index] = number;
            }
        }

        impl Scalar for Complex<$t> {
            type Real = $t;
            const COMPLEX: bool = true;
            #[inline(always)]
            fn from_real(x: $t) -> Self {
                Complex::new(x, 0.0)
            }
            #[inline(always)]
            fn from_parts(re: $t, im: $t) -> Self {
                Complex::new(re, im)
            }
            #[inline(always)]
            fn parts(self) -> [$t; 2] {
                [self.re, self.im]
            }
            #[inline(always)]
            fn conjugate(self) -> Self {
                self.conj()
            }
            type Single = Complex<f32>;
            #[inline(always)]
            fn to_single(self) -> Complex<f32> {
                Complex::new(self.re as f32, self.im as f32)
            }
            #[inline(always)]
            fn from_single(single: Complex<f32>) -> Self {
                Complex::new(<$t>::from(single.re), <$t>::from(single.im))
            }
            #[inline(always)]
            fn modulus(self) -> $t {
                self.norm()
            }
        }

        impl Additive for $vector {
            #[inline(always)]
            fn zero() -> Self {
                <$vector>::ZERO
            }
            #[inline(always)]
            fn accumulate(&mut self, other: &Self) {
                *self += *other;
            }
            #[inline(always)]
            fn subtract(&mut self, other: &Self) {
                *self -= *other;
            }
            #[inline(always)]
            fn is_finite(&self) -> bool {
                <$vector>::is_finite(*self)
            }
            #[inline(always)]
            fn norm(&self) -> f64 {
                self.to_array().norm()
            }
            #[inline(always)]
            fn norm_squared(&self) -> f64 {
                self.to_array().norm_squared()
            }
        }

        impl Linear<$t> for $vector {
            #[inline(always)]
            fn add_scaled(&mut self, scale: $t, other: &Self) {
                *self += *other * scale;
            }
        }

        impl Vector<$t> for $vector {
            #[inline(always)]
            fn from_array(xyz: [$t; 3]) -> Self {
                <$vector>::from_array(xyz)
            }
            #[inline(always)]
            fn to_array(self) -> [$t; 3] {
                <$vector>::to_array(&self)
            }
            #[inline(always)]
            fn dot(self, other: Self) -> $t {
                <$vector>::dot(self, other)
            }
        }

        impl Located for $vector {
            type Real = $t;
            #[inline(always)]
            fn position(&self) -> Self {
                *self
            }
        }
    };
}

real!(f32, Vec3);
real!(f64, DVec3);

impl<T: Real> Additive for Complex<T> {
    #[inline(always)]
    fn zero() -> Self {
        Complex::new(<T as Additive>::zero(), <T as Additive>::zero())
    }
    #[inline(always)]
    fn accumulate(&mut self, other: &Self) {
        *self += other;
    }
    #[inline(always)]
    fn subtract(&mut self, other: &Self) {
        *self -= other;
    }
    #[inline(always)]
    fn is_finite(&self) -> bool {
        Additive::is_finite(&self.re) && Additive::is_finite(&self.im)
    }
    #[inline(always)]
    fn norm(&self) -> f64 {
        [self.re, self.im].norm()
    }
    #[inline(always)]
    fn norm_squared(&self) -> f64 {
        self.re.norm_squared() + self.im.norm_squared()
    }
}

impl<T: Real> Linear<Complex<T>> for Complex<T> {
    #[inline(always)]
    fn add_scaled(&mut self, scale: Complex<T>, other: &Self) {
        *self += scale * other;
    }
}

impl<T: Real> Columns<Complex<T>> for Complex<T> {
    const WIDTH: usize = 1;
    #[inline(always)]
    fn column(&self, _: usize) -> Complex<T> {
        *self
    }
    #[inline(always)]
    fn set_column(&mut self, _: usize, number: Complex<T>) {
        *self = number;
    }
}

impl<V: Additive, const N: usize> Additive for [V; N] {
    #[inline(always)]
    fn zero() -> Self {
        [V::zero(); N]
    }
    #[inline(always)]
    fn accumulate(&mut self, other: &Self) {
        for (a, b) in self.iter_mut().zip(other) {
            a.accumulate(b);
        }
    }
    #[inline(always)]
    fn subtract(&mut self, other: &Self) {
        for (a, b) in self.iter_mut().zip(other) {
            a.subtract(b);
        }
    }
    #[inline(always)]
    fn is_finite(&self) -> bool {
        self.iter().all(V::is_finite)
    }
    #[inline(always)]
    fn norm(&self) -> f64 {
        l2_norm(self.iter().copied())
    }
    #[inline(always)]
    fn norm_squared(&self) -> f64 {
        self.iter().map(V::norm_squared).sum()
    }
}

impl<S: Copy, V: Linear<S>, const N: usize> Linear<S> for [V; N] {
    #[inline(always)]
    fn add_scaled(&mut self, scale: S, other: &Self) {
        for (a, b) in self.iter_mut().zip(other) {
            a.add_scaled(scale, b);
        }
    }
}

impl<S: Copy, V: Columns<S>, const N: usize> Columns<S> for [V; N] {
    const WIDTH: usize = N * V::WIDTH;
    #[inline(always)]
    fn column(&self, index: usize) -> S {
        self[index / V::WIDTH].column(index % V::WIDTH)
    }
    #[inline(always)]
    fn set_column(&mut self, index: usize, number: S) {
        self[index / V::WIDTH].set_column(index % V::WIDTH, number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_of_complex_numbers_are_linear_over_both_scalars() {
        let one = [Complex::new(1.0, 2.0); 2];
        let mut real = one;
        real.add_scaled(2.0, &one);
        assert_eq!(real, [Complex::new(3.0, 6.0); 2]);
        let mut complex = one;
        complex.add_scaled(Complex::i(), &one);
        assert_eq!(complex, [Complex::new(-1.0, 3.0); 2]);
        assert_eq!(one.norm_squared(), 10.0);
        assert!(!Additive::is_finite(&[Complex::new(1.0, f64::NAN)]));
    }

    #[test]
    fn norms_stay_in_the_range_of_numbers() {
        for unit in [5e-320, 1e-200, 1.0, 1e200, 1e307] {
            let norm =
                [[Complex::new(3.0 * unit, 0.0); 2], [Complex::new(0.0, 4.0 * unit); 2]].norm();
            assert!((norm / (50f64.sqrt() * unit) - 1.0).abs() < 1e-3, "{unit:e}: {norm:e}");
            assert_eq!(DVec3::new(0.0, -2.0 * unit, 0.0).norm(), 2.0 * unit);
        }
        assert_eq!([0.0f32; 3].norm(), 0.0);
        assert!([1e300, f64::NAN].norm().is_nan() && [1e-300, f64::NAN].norm().is_nan());
    }
}
