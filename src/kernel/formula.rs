//! Formulas: kernels between bare points, written once, in numbers that the engine chooses.

use num_complex::Complex;

use crate::numbers::dual::Dual;
use crate::numbers::number::{Coordinates, Number};
use crate::numbers::traits::{Real, Scalar, sealed};

/// A kernel between bare points as a formula that is generic over its numbers.
///
/// One body serves for everything: it is evaluated for several pairs side by side, in single and
/// double precision, and in numbers that carry derivatives along. [`from_formula`](crate::from_formula)
/// makes it a kernel; the macro [`formula!`](crate::formula) does both in one line.
///
/// ```
/// use farfield::{Coordinates, Difference, Formula, Number, direct, from_formula};
///
/// /// The screened potential e^(−κr)/r.
/// struct Yukawa { kappa: f64 }
///
/// impl Formula for Yukawa {
///     type Of = Difference;
///     type Entry<N: Number> = N;
///     #[inline(always)]
///     fn entries<N: Number>(&self, d: Coordinates<N>, g: &mut [N]) {
///         let r = d.length();
///         g[0] = (r * -self.kappa).exp() / r;
///     }
/// }
///
/// let kernel = from_formula(Yukawa { kappa: 2.0 }).gradient();
/// let sum = direct(&kernel, &[[0.0; 3]], &[1.0], &[[0.5, 0.0, 0.0]])?;
/// assert!((sum[0].value - 2.0 * f64::exp(-1.0)).abs() < 1e-15);
/// assert!((sum[0].gradient[0] + 8.0 * f64::exp(-1.0)).abs() < 1e-14);
/// # Ok::<(), farfield::Error>(())
/// ```
pub trait Formula: Send + Sync {
    /// What the formula is of: the [`Difference`] d = x − y of target and source, or their
    /// [`Positions`] (x, y). A formula of the difference is translation invariant by its type.
    type Of: Form;
    /// What the entries are: `N`, or [`Complex<N>`](num_complex::Complex).
    type Entry<N: Number>: FormulaEntry<N>;

    /// Writes the entries into `g`, row after row: [`fields`](Self::fields) ×
    /// [`densities`](Self::densities) of them.
    ///
    /// Mark it `#[inline(always)]`. It is called for one pair, in loops that are compiled for registers of several
    /// pairs: only a body that is inlined becomes part of them.
    fn entries<N: Number>(&self, at: <Self::Of as Form>::At<N>, g: &mut [Self::Entry<N>]);

    /// How many fields a target receives: the rows of the matrix.
    #[inline(always)]
    fn fields(&self) -> usize {
        1
    }

    /// How many densities a source sends: the columns of the matrix.
    #[inline(always)]
    fn densities(&self) -> usize {
        1
    }

    /// What tells this formula from all others, its parameters included, see [`Kernel::identity`](crate::Kernel::identity).
    fn identity(&self) -> Option<String> {
        None
    }
}

/// What a [`Formula`] is of: [`Difference`] or [`Positions`].
///
/// Sealed: there are no others.
pub trait Form: sealed::Sealed {
    /// The argument of the formula.
    type At<N: Number>: Copy;
    #[doc(hidden)]
    /// The argument for a target at x and a source at y.
    fn at<N: Number>(x: Coordinates<N>, y: Coordinates<N>) -> Self::At<N>;
    #[doc(hidden)]
    /// The same argument, its derivatives with respect to x carried along.
    fn with_derivatives<N: Number>(at: Self::At<N>) -> Self::At<Dual<N>>;
}

/// A formula of the difference d = x − y between target and source.
#[derive(Clone, Copy, Debug)]
pub enum Difference {}

/// A formula of the positions (x, y) of target and source.
#[derive(Clone, Copy, Debug)]
pub enum Positions {}

impl sealed::Sealed for Difference {}
impl sealed::Sealed for Positions {}

impl Form for Difference {
    type At<N: Number> = Coordinates<N>;
    #[inline(always)]
    fn at<N: Number>(x: Coordinates<N>, y: Coordinates<N>) -> Coordinates<N> {
        x - y
    }
    #[inline(always)]
    fn with_derivatives<N: Number>(d: Coordinates<N>) -> Coordinates<Dual<N>> {
        varying(d)
    }
}

impl Form for Positions {
    type At<N: Number> = (Coordinates<N>, Coordinates<N>);
    #[inline(always)]
    fn at<N: Number>(x: Coordinates<N>, y: Coordinates<N>) -> Self::At<N> {
        (x, y)
    }
    #[inline(always)]
    fn with_derivatives<N: Number>((x, y): Self::At<N>) -> Self::At<Dual<N>> {
        (varying(x), Coordinates { x: Dual::fixed(y.x), y: Dual::fixed(y.y), z: Dual::fixed(y.z) })
    }
}

/// Coordinates that derivatives are taken along.
#[inline(always)]
fn varying<N: Number>(p: Coordinates<N>) -> Coordinates<Dual<N>> {
    Coordinates { x: Dual::along(p.x, 0), y: Dual::along(p.y, 1), z: Dual::along(p.z, 2) }
}

/// An entry of a [`Formula`] in numbers of type `N`: `N` itself or a complex number.
///
/// Sealed: there are no others.
pub trait FormulaEntry<N: Number>: Copy + sealed::Sealed {
    /// The entry of one pair.
    type Scalar: Scalar<Real = N::Real>;
    /// Zero.
    fn zero() -> Self;
    /// The real and the imaginary part.
    fn parts(self) -> [N; 2];
    /// The entry with these parts; a real one drops the imaginary part.
    fn from_parts(parts: [N; 2]) -> Self;
}

impl<N: Number> FormulaEntry<N> for N {
    type Scalar = N::Real;
    #[inline(always)]
    fn zero() -> Self {
        N::constant(0.0)
    }
    #[inline(always)]
    fn parts(self) -> [N; 2] {
        [self, N::constant(0.0)]
    }
    #[inline(always)]
    fn from_parts([re, _]: [N; 2]) -> Self {
        re
    }
}

impl<N: Number> FormulaEntry<N> for Complex<N> {
    type Scalar = <N::Real as Real>::Complex;
    #[inline(always)]
    fn zero() -> Self {
        Complex { re: N::constant(0.0), im: N::constant(0.0) }
    }
    #[inline(always)]
    fn parts(self) -> [N; 2] {
        [self.re, self.im]
    }
    #[inline(always)]
    fn from_parts([re, im]: [N; 2]) -> Self {
        Complex { re, im }
    }
}
