//! Formulas as kernels: evaluated for several pairs side by side.

use std::fmt;
use std::marker::PhantomData;

use crate::error::Error;
use crate::kernel::derivatives::{Derivatives, WithHessian};
use crate::kernel::formula::{Formula, FormulaEntry};
use crate::kernel::formula_block::FormulaBlock;
use crate::kernel::formula_cost::pair_seconds;
use crate::kernel::outermost::sizes;
use crate::kernel::side_by_side::{entries_side_by_side, slopes};
use crate::kernel::traits::{Kernel, Outcome, add_fields, check_densities, columns_of_a_charge};
use crate::kernel::wide::Near;
use crate::kernel::with_gradient::WithGradient;
use crate::numbers::dual::Dual;
use crate::numbers::traits::{Located, Numbers, Point, Scalar};

/// The kernel of a [`Formula`] between bare points.
///
/// Points are of any type with a position; charges of any type with as many numbers as the formula has
/// densities, or several times as many for several right-hand sides. Both types follow from what is summed.
/// Values have the type of the charges unless [`values`](FormulaKernel::values) says otherwise.
///
/// The formula is evaluated at coincident points too, unless
/// [`skip_coincident`](FormulaKernel::skip_coincident) is asked for.
pub fn from_formula<F: Formula, P, Q>(formula: F) -> FormulaKernel<F, P, Q> {
    FormulaKernel { formula, skip_coincident: false, columns: None, types: PhantomData }
}

/// The kernel made by [`from_formula`]: points of type `P`, charges `Q`, values `U`, with gradients if `S` says so.
#[derive(Clone, Copy)]
pub struct FormulaKernel<F, P, Q, U = Q, S = Values> {
    formula: F,
    skip_coincident: bool,
    /// How many right-hand sides, where the type of the charges doesn't say it.
    columns: Option<usize>,
    types: PhantomData<fn(P, Q, S) -> U>,
}

/// The kernel made by [`FormulaKernel::gradient`].
pub type FormulaGradient<F, P, Q, U = Q> = FormulaKernel<F, P, Q, U, Gradients>;

/// What a formula's kernel sums: [`Values`] of type `U`, or [`Gradients`] as well.
pub trait Summed<U: Numbers>: Send + Sync {
    /// What a target receives.
    type Value: Numbers<Real = U::Real>;
    /// Whether that needs derivatives.
    const GRADIENTS: bool;
    /// Adds what a target receives, as [`Kernel::value`] does.
    fn add<S: Scalar<Real = U::Real>>(u: &mut Self::Value, fields: &[S], gradients: &[[S; 3]]);
}

/// Values alone are summed.
#[derive(Clone, Copy, Debug)]
pub struct Values;

/// Values and their gradients are summed.
#[derive(Clone, Copy, Debug)]
pub struct Gradients;

impl<U: Numbers> Summed<U> for Values {
    type Value = U;
    const GRADIENTS: bool = false;

    #[inline(always)]
    fn add<S: Scalar<Real = U::Real>>(u: &mut U, fields: &[S], _gradients: &[[S; 3]]) {
        add_fields(u, fields);
    }
}

impl<U: Numbers> Summed<U> for Gradients {
    type Value = WithGradient<U>;
    const GRADIENTS: bool = true;

    #[inline(always)]
    fn add<S: Scalar<Real = U::Real>>(u: &mut WithGradient<U>, fields: &[S], gradients: &[[S; 3]]) {
        u.add(fields, gradients);
    }
}

impl<F, P, Q, U> FormulaKernel<F, P, Q, U> {
    /// Pairs at the same position contribute nothing: the usual choice for singular formulas.
    pub fn skip_coincident(self) -> Self {
        Self { skip_coincident: true, ..self }
    }

    /// The same kernel for values of another type: with as many numbers as the formula has fields, times
    /// the number of right-hand sides.
    pub fn values<W>(self) -> FormulaKernel<F, P, Q, W> {
        let Self { formula, skip_coincident, columns, .. } = self;
        FormulaKernel { formula, skip_coincident, columns, types: PhantomData }
    }

    /// The number of right-hand sides, for charges that are lists (`Vec<f64>`). Other charges say it by
    /// their type.
    pub fn with_columns(self, columns: usize) -> Self {
        Self { columns: Some(columns), ..self }
    }

    /// The same kernel with the gradient of its sum as part of the [value](WithGradient). The
    /// derivatives of the formula are its own: it is evaluated in numbers that carry them along. Where a point
    /// meets itself, as in sums over one set of points, they have to exist, or the pair to be
    /// [skipped](Self::skip_coincident): |d| has none at d = 0, |d|² has. So has every part of the formula to
    /// have derivatives, even one of y alone: √(y₁) gives NaN at y₁ = 0.
    pub fn gradient(self) -> FormulaGradient<F, P, Q, U> {
        let Self { formula, skip_coincident, columns, .. } = self;
        FormulaKernel { formula, skip_coincident, columns, types: PhantomData }
    }

    /// The same kernel with the gradient and the second derivatives of its sum as part of the
    /// [value](WithHessian). They are summed as further fields of the formula: ten times as many.
    pub fn hessian(self) -> FormulaKernel<Derivatives<F>, P, Q, WithHessian<U>> {
        let Self { formula, skip_coincident, columns, .. } = self;
        let formula = Derivatives(formula);
        FormulaKernel { formula, skip_coincident, columns, types: PhantomData }
    }
}

impl<F, P, Q, U, S> fmt::Debug for FormulaKernel<F, P, Q, U, S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FormulaKernel")
            .field("skip_coincident", &self.skip_coincident)
            .finish_non_exhaustive()
    }
}

/// The number type of a formula's entries in the precision `T`.
type EntryOf<F, T> = <<F as Formula>::Entry<Near<T>> as FormulaEntry<Near<T>>>::Scalar;

impl<F, P, Q, U, S> Kernel for FormulaKernel<F, P, Q, U, S>
where
    F: Formula,
    P: Located,
    Q: Numbers<Real = P::Real>,
    U: Numbers<Real = P::Real>,
    S: Summed<U>,
{
    type Real = P::Real;
    type Source = P;
    type Target = P;
    type Charge = Q;
    type Value = S::Value;
    type Entry = EntryOf<F, P::Real>;

    fn entries(&self, x: Point<P::Real>, y: Point<P::Real>, g: &mut [Self::Entry]) {
        self.entries_block(&[x], &[y], g);
    }

    #[inline(always)]
    fn fields(&self) -> usize {
        self.formula.fields()
    }

    #[inline(always)]
    fn densities(&self) -> usize {
        self.formula.densities()
    }

    #[inline(always)]
    fn columns(&self) -> usize {
        if Q::LEN > 0 { columns_of_a_charge(self) } else { self.columns.unwrap_or(0) }
    }

    fn check_sizes(&self) -> Result<(), Error> {
        check_densities(self)?;
        let (expected, found) = (Self::Entry::PARTS * self.fields(), U::LEN);
        if found == 0 || found == expected * self.columns() {
            Ok(())
        } else {
            Err(Error::KernelSize { what: "value", expected, found })
        }
    }

    #[inline(always)]
    fn value(
        &self,
        _x: &P,
        fields: &[Self::Entry],
        gradients: &[[Self::Entry; 3]],
        u: &mut S::Value,
    ) {
        S::add(u, fields, gradients);
    }

    #[inline(always)]
    fn needs_gradients(&self) -> bool {
        S::GRADIENTS
    }

    fn has_parameters(&self) -> bool {
        size_of::<F>() > 0
    }

    fn identity(&self) -> Option<String> {
        self.formula.identity()
    }

    fn pair_seconds(&self, _tolerance: f64) -> f64 {
        pair_seconds::<F, P::Real>(&self.formula, self.columns(), S::GRADIENTS)
    }

    fn sizes(&self, x: Point<P::Real>, y: Point<P::Real>) -> Option<[f64; 2]> {
        if self.skip_coincident && x == y {
            return Some([0.0; 2]);
        }
        Some(if S::GRADIENTS {
            sizes::<Dual<Near<P::Real>>, F, Self::Entry>(&self.formula, x, y)
        } else {
            sizes::<Near<P::Real>, F, Self::Entry>(&self.formula, x, y)
        })
    }

    fn entry_gradients(
        &self,
        x: Point<P::Real>,
        y: Point<P::Real>,
        g: &mut [[Self::Entry; 3]],
    ) -> Outcome {
        slopes(&self.formula, x, y, g);
        Outcome::Done
    }

    fn entries_block(&self, xs: &[Point<P::Real>], ys: &[Point<P::Real>], g: &mut [Self::Entry]) {
        entries_side_by_side(&self.formula, xs, ys, g);
    }

    fn add_block(&self, xs: &[P], ys: &[P], qs: &[Q], _tolerance: f64, us: &mut [S::Value]) {
        let (formula, skip_coincident) = (&self.formula, self.skip_coincident);
        FormulaBlock { kernel: self, formula, skip_coincident, xs, ys, qs, us }.add();
    }
}

/// A kernel from a formula in one line: a [`Formula`] of the [`Difference`](crate::Difference) d = x − y
/// or of the [`Positions`](crate::Positions) (x, y), with parameters after a semicolon.
///
/// ```
/// use farfield::{direct, formula};
///
/// let kappa = 2.0;
/// let yukawa = formula!(|d; kappa| (-d.length() * kappa).exp() / d.length());
/// let sum = direct(&yukawa, &[[0.0; 3]], &[1.0], &[[0.5, 0.0, 0.0]])?;
/// assert!((sum[0] - 2.0 * f64::exp(-1.0)).abs() < 1e-15);
///
/// let sheared = formula!(|x, y| (x - y).length() * (x.z + 2.0));
/// assert_eq!(direct(&sheared, &[[0.0; 3]], &[1.0], &[[0.0, 0.0, 1.0]])?, [3.0]);
/// # Ok::<(), farfield::Error>(())
/// ```
///
/// The expression is written in a [`Number`](crate::Number): see there which functions it has. Parameters
/// are variables of type f64.
#[macro_export]
macro_rules! formula {
    (|$d:ident $(; $($parameter:ident),+)?| $entry:expr) => {
        $crate::formula!(@ $crate::Difference, $d, [$($($parameter),+)?], $entry)
    };
    (|$x:ident, $y:ident $(; $($parameter:ident),+)?| $entry:expr) => {
        $crate::formula!(@ $crate::Positions, ($x, $y), [$($($parameter),+)?], $entry)
    };
    (@ $of:ty, $at:pat, [$($parameter:ident),*], $entry:expr) => {{
        #[derive(Clone, Copy)]
        struct Parameters {
            $($parameter: f64,)*
        }
        impl $crate::Formula for Parameters {
            type Of = $of;
            type Entry<N: $crate::Number> = N;
            #[inline(always)]
            fn entries<N: $crate::Number>(&self, $at: <$of as $crate::Form>::At<N>, g: &mut [N]) {
                let Self { $($parameter),* } = *self;
                g[0] = $entry;
            }
        }
        $crate::from_formula(Parameters { $($parameter),* })
    }};
}
