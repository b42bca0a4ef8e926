//! What numbers and points can do: a few numbers side by side, the numbers of kernels' entries, the
//! precisions, and things that sit at points.

use std::ops::{Add, Mul, Neg, Sub};

use num_traits::{Float, FloatConst, MulAdd, NumAssign};

use crate::linalg::dense::Dense;
use crate::numbers::math::functions::Functions;

/// A few real numbers side by side: a charge, a value, or a term of an expansion.
///
/// Numbers, complex numbers, glam vectors and arrays of any of them qualify. A struct of your own
/// needs the four required items. `Vec<T>` qualifies too, for sizes that are known only at run
/// time; an empty vector stands for zeros of any length.
///
/// ```
/// use farfield::Numbers;
///
/// #[derive(Clone, Debug, PartialEq)]
/// struct Flow { density: f64, momentum: [f64; 3] }
///
/// impl Numbers for Flow {
///     type Real = f64;
///     const LEN: usize = 4;
///     fn zero() -> Self {
///         Flow { density: 0.0, momentum: [0.0; 3] }
///     }
///     fn number(&self, i: usize) -> f64 {
///         if i == 0 { self.density } else { self.momentum[i - 1] }
///     }
///     fn set_number(&mut self, i: usize, number: f64) {
///         *(if i == 0 { &mut self.density } else { &mut self.momentum[i - 1] }) = number;
///     }
/// }
///
/// let mut sum = Flow::zero();
/// sum.add_scaled(2.0, &Flow { density: 1.0, momentum: [0.0, 0.5, 1.0] });
/// assert_eq!(sum, Flow { density: 2.0, momentum: [0.0, 1.0, 2.0] });
/// ```
pub trait Numbers: Clone + Send + Sync + 'static {
    /// The precision of the numbers.
    type Real: Real;
    /// How many there are; a complex number counts as two. 0 if that is known only at run time:
    /// [`count`](Self::count) says it then.
    const LEN: usize;

    /// All zeros.
    fn zero() -> Self;
    /// The number at `index`.
    fn number(&self, index: usize) -> Self::Real;
    /// Puts a number at `index`.
    fn set_number(&mut self, index: usize, number: Self::Real);

    /// How many there are in this value: [`LEN`](Self::LEN), unless that is known only at run time.
    #[inline(always)]
    fn count(&self) -> usize {
        Self::LEN
    }

    /// The `index`-th number of type `S`: of a complex type, each takes the place of two.
    #[inline(always)]
    fn column<S: Scalar<Real = Self::Real>>(&self, index: usize) -> S {
        if S::COMPLEX {
            S::from_parts(self.number(2 * index), self.number(2 * index + 1))
        } else {
            S::from_real(self.number(index))
        }
    }

    /// Puts a number of type `S` at the place that [`column`](Self::column) reads it from.
    #[inline(always)]
    fn set_column<S: Scalar<Real = Self::Real>>(&mut self, index: usize, number: S) {
        let [re, im] = number.parts();
        if S::COMPLEX {
            self.set_number(2 * index, re);
            self.set_number(2 * index + 1, im);
        } else {
            self.set_number(index, re);
        }
    }

    /// `self += other`.
    #[inline(always)]
    fn accumulate(&mut self, other: &Self) {
        for i in 0..other.count() {
            self.set_number(i, self.number(i) + other.number(i));
        }
    }

    /// `self -= other`.
    #[inline(always)]
    fn subtract(&mut self, other: &Self) {
        for i in 0..other.count() {
            self.set_number(i, self.number(i) - other.number(i));
        }
    }

    /// `self += scale · other`, for a real scale, or for a complex one where the numbers are pairs of
    /// real and imaginary parts.
    #[inline(always)]
    fn add_scaled<S: Scalar<Real = Self::Real>>(&mut self, scale: S, other: &Self) {
        for i in 0..other.count().div_ceil(S::PARTS) {
            self.set_column(i, self.column::<S>(i) + scale * other.column::<S>(i));
        }
    }

    /// All numbers, in double precision.
    fn to_f64s(&self) -> Vec<f64> {
        (0..self.count()).map(|i| self.number(i).as_f64()).collect()
    }

    /// Whether no number is NaN or infinite.
    #[inline(always)]
    fn is_finite(&self) -> bool {
        (0..self.count()).all(|i| num_traits::Float::is_finite(self.number(i)))
    }

    /// The l2 norm in double precision, also where squares would leave the range of numbers.
    #[inline(always)]
    fn norm(&self) -> f64 {
        let squares = self.norm_squared();
        if SQUARES_IN_RANGE.contains(&squares) {
            return squares.sqrt();
        }
        (0..self.count()).fold(0.0, |norm, i| norm.hypot(self.number(i).as_f64()))
    }

    /// The sum of the squares of all numbers, in double precision.
    #[inline(always)]
    fn norm_squared(&self) -> f64 {
        (0..self.count()).map(|i| self.number(i).as_f64().powi(2)).sum()
    }
}

/// Sums of squares of which no square that matters has overflowed or lost digits.
const SQUARES_IN_RANGE: std::ops::Range<f64> = 1e-280..1e280;

/// The l2 norm of all of `items`, also where squares leave the range of numbers. O(n).
pub(crate) fn l2_norm<V: Numbers>(items: impl Iterator<Item = V> + Clone) -> f64 {
    let squares: f64 = items.clone().map(|v| v.norm_squared()).sum();
    if SQUARES_IN_RANGE.contains(&squares) {
        return squares.sqrt();
    }
    items.fold(0.0, |norm, v| norm.hypot(v.norm()))
}

/// The number type that a kernel's entries have: f32, f64 or a complex number over them.
///
/// Sealed: there are no others.
pub trait Scalar:
    Numbers
    + Copy
    + NumAssign
    + MulAdd<Output = Self>
    + Neg<Output = Self>
    + Default
    + std::fmt::Debug
    + Dense
    + sealed::Sealed
{
    /// Whether there is an imaginary part.
    const COMPLEX: bool;
    /// How many real numbers it consists of: 1 or 2.
    const PARTS: usize = if Self::COMPLEX { 2 } else { 1 };
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
///
/// Sealed: there are no others.
pub trait Real: Scalar<Real = Self> + Float + FloatConst + Functions + std::fmt::Display {
    /// The glam vector of this precision: [`Vec3`](glam::Vec3) or [`DVec3`](glam::DVec3).
    type Vector: Vector<Self>;
    /// The complex numbers of this precision.
    type Complex: Scalar<Real = Self>;
    /// The nearest value of this precision.
    fn from_f64(x: f64) -> Self;
    /// The same value in double precision.
    fn as_f64(self) -> f64;
}

/// A point in space: [`DVec3`](glam::DVec3) for `f64`, [`Vec3`](glam::Vec3) for `f32`.
pub type Point<T> = <T as Real>::Vector;

/// What the engine needs of glam's vectors, in either precision.
///
/// Sealed: there are no others.
pub trait Vector<T: Real>:
    Numbers<Real = T>
    + Copy
    + std::fmt::Debug
    + Default
    + PartialEq
    + Located<Real = T>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Neg<Output = Self>
    + Mul<T, Output = Self>
    + sealed::Sealed
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
pub trait Located: Clone + Send + Sync {
    /// The precision of the coordinates.
    type Real: Real;
    /// Where it is.
    fn position(&self) -> Point<Self::Real>;
}

/// A point of which there can be a copy elsewhere: what is repeated with a [period](crate::Builder::periodic). All that it has
/// besides its position (normals, areas) goes with it.
pub trait Movable: Located {
    /// The same at its position plus `shift`.
    fn moved_by(&self, shift: Point<Self::Real>) -> Self;
}

/// Names that only this crate can implement.
pub(crate) mod sealed {
    /// Holds other crates off.
    pub trait Sealed {}
}
