//! Sums of a kernel that is chosen at run time, from plain arrays to plain arrays.

use farfield::{
    Certificate, ChargeOf, Error, Expansion, Fmm, Interpolation, Kernel, Numbers, Point, Real,
    RealOf, Report, ValueOf, direct,
};
use farfield_potentials::InverseDistance;

use crate::formula::{Coincident, TextFormula};
use crate::kernel::TextKernel;

/// What a [`Plan`] is built for.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Options {
    /// The relative l2 error to stay below; 1e-6 by default.
    pub tolerance: f64,
    /// Whether gradients with respect to the target are summed as well; not by default.
    pub gradient: bool,
    /// How often the plan will be applied, about; once by default.
    pub applications: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self { tolerance: 1e-6, gradient: false, applications: 1 }
    }
}

/// A plan for the sums of one kernel between fixed points, whatever the kernel is.
///
/// Charges and values are plain arrays: those of the first point, then those of the second, and so on.
///
/// ```
/// use farfield_formula::{Options, Plan, Ready};
///
/// let points = [[0.0, 0.0, 0.0].into(), [0.5, 0.0, 0.0].into()];
/// let kernel = Ready::or_text("exp(-k*r)/r", &[("k", 2.0)])?;
/// let plan = Plan::<f64>::new(&kernel, &points, &points, &Options::default())?;
/// let values = plan.apply(&[1.0, 3.0])?;
/// assert!((values[0] - 6.0 * f64::exp(-1.0)).abs() < 1e-5);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Plan<T> {
    sum: Box<dyn Sum<T>>,
    densities: usize,
    numbers: usize,
    sources: usize,
    targets: usize,
}

impl<T: Precision> Plan<T> {
    /// Plans the sums of a kernel. 1/r, as it is [known by name](crate::Ready), is summed by
    /// [`farfield_potentials`], which knows it better.
    ///
    /// # Errors
    /// Those of [`Builder::build`](farfield::Builder::build).
    pub fn new(
        kernel: &TextFormula,
        sources: &[Point<T>],
        targets: &[Point<T>],
        options: &Options,
    ) -> Result<Self, Error> {
        let parts = if options.gradient { 4 } else { 1 };
        let (fields, densities) = (kernel.rows(), kernel.columns());
        let sum = T::plan(kernel, sources, targets, options)?;
        let (sources, targets) = (sources.len(), targets.len());
        Ok(Self { sum, densities, numbers: parts * fields, sources, targets })
    }

    /// The sums for some charges: for every target, the fields, then, with gradients, their derivatives along the
    /// first axis, the second and the third.
    ///
    /// # Errors
    /// Those of [`Fmm::apply`], and [`Error::LengthMismatch`] if there are not as many numbers as sources and densities.
    pub fn apply(&self, charges: &[T]) -> Result<Vec<T>, Error> {
        self.check(charges)?;
        self.sum.apply(charges, self.densities, self.numbers)
    }

    /// The sums, and how far they are from the exact ones, see [`Fmm::apply_certified`].
    ///
    /// # Errors
    /// As [`apply`](Self::apply).
    pub fn apply_certified(&self, charges: &[T]) -> Result<(Vec<T>, Certificate), Error> {
        self.check(charges)?;
        self.sum.apply_certified(charges, self.densities, self.numbers)
    }

    /// What the plan consists of, and what it took.
    pub fn report(&self) -> Report {
        self.sum.report()
    }

    /// Numbers of a charge.
    pub fn densities(&self) -> usize {
        self.densities
    }

    /// Numbers of a value, its derivatives among them.
    pub fn numbers(&self) -> usize {
        self.numbers
    }

    /// How many sources there are.
    pub fn sources(&self) -> usize {
        self.sources
    }

    /// How many targets there are.
    pub fn targets(&self) -> usize {
        self.targets
    }

    fn check(&self, charges: &[T]) -> Result<(), Error> {
        let (expected, found) = (self.sources * self.densities, charges.len());
        if found == expected {
            Ok(())
        } else {
            Err(Error::LengthMismatch { what: "numbers of charges", expected, found })
        }
    }
}

impl<T> std::fmt::Debug for Plan<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Plan")
            .field("sources", &self.sources)
            .field("targets", &self.targets)
            .finish_non_exhaustive()
    }
}

/// The same sums directly, over all pairs: the reference. O(sources × targets).
///
/// # Errors
/// As [`Plan::apply`].
pub fn direct_sums<T: Precision>(
    kernel: &TextFormula,
    sources: &[Point<T>],
    charges: &[T],
    targets: &[Point<T>],
    gradient: bool,
) -> Result<Vec<T>, Error> {
    T::direct_sums(kernel, sources, charges, targets, gradient)
}

/// A precision of [`Plan`]s: `f32` or `f64`. What they need of the engine is compiled here, once for all programs.
pub trait Precision: Real {
    #[doc(hidden)]
    /// What [`Plan::new`] keeps.
    fn plan(
        kernel: &TextFormula,
        sources: &[Point<Self>],
        targets: &[Point<Self>],
        options: &Options,
    ) -> Result<Box<dyn Sum<Self>>, Error>;
    #[doc(hidden)]
    /// What [`direct_sums`] gives.
    fn direct_sums(
        kernel: &TextFormula,
        sources: &[Point<Self>],
        charges: &[Self],
        targets: &[Point<Self>],
        gradient: bool,
    ) -> Result<Vec<Self>, Error>;
}

macro_rules! precisions {
    ($($t:ty),*) => {$(
        impl Precision for $t {
            fn plan(
                kernel: &TextFormula,
                sources: &[Point<Self>],
                targets: &[Point<Self>],
                options: &Options,
            ) -> Result<Box<dyn Sum<Self>>, Error> {
                Inputs { sources, targets, options }.plan(kernel)
            }

            fn direct_sums(
                kernel: &TextFormula,
                sources: &[Point<Self>],
                charges: &[Self],
                targets: &[Point<Self>],
                gradient: bool,
            ) -> Result<Vec<Self>, Error> {
                type Lists = Interpolation<TextKernel<Point<$t>, Vec<$t>>>;
                let lists = gathered::<Lists>(charges, kernel.columns());
                let values = kernel.kernel::<Point<$t>, Vec<$t>, Vec<$t>>().with_columns(1);
                if gradient {
                    let sums = direct(&values.gradient::<Vec<$t>>(), sources, &lists, targets)?;
                    return Ok(flat::<Lists>(&sums, 4 * kernel.rows()));
                }
                Ok(flat::<Lists>(&direct(&values, sources, &lists, targets)?, kernel.rows()))
            }
        }
    )*};
}

precisions!(f32, f64);

/// What a plan is built from, but for the kernel.
struct Inputs<'a, T: Real> {
    sources: &'a [Point<T>],
    targets: &'a [Point<T>],
    options: &'a Options,
}

impl<T: Real> Inputs<'_, T> {
    fn plan(&self, kernel: &TextFormula) -> Result<Box<dyn Sum<T>>, Error> {
        let is_laplace =
            kernel.is_ready("laplace") && kernel.at_coincident_points() == Coincident::Skip;
        match (kernel.rows(), kernel.columns(), self.options.gradient) {
            (1, 1, false) if is_laplace => self.plan_of(InverseDistance::<T>::new()),
            (1, 1, true) if is_laplace => self.plan_of(InverseDistance::<T>::new().with_gradient()),
            (1, 1, false) => self.plan_of(kernel.kernel::<Point<T>, T, T>()),
            (1, 1, true) => self.plan_of(kernel.kernel::<Point<T>, T, T>().gradient::<[T; 4]>()),
            (3, 3, false) => self.plan_of(kernel.kernel::<Point<T>, [T; 3], [T; 3]>()),
            (_, _, false) => {
                self.plan_of(kernel.kernel::<Point<T>, Vec<T>, Vec<T>>().with_columns(1))
            }
            (_, _, true) => {
                let kernel = kernel.kernel::<Point<T>, Vec<T>, Vec<T>>().with_columns(1);
                self.plan_of(kernel.gradient::<Vec<T>>())
            }
        }
    }

    fn plan_of<K>(&self, kernel: K) -> Result<Box<dyn Sum<T>>, Error>
    where
        K: Kernel<Real = T, Source = Point<T>, Target = Point<T>> + 'static,
    {
        let Options { tolerance, applications, .. } = *self.options;
        let builder = Fmm::builder(kernel).tolerance(tolerance).applications(applications);
        Ok(Box::new(builder.build(self.sources, self.targets)?))
    }
}

/// A plan whose kernel's type is forgotten.
pub trait Sum<T>: Send + Sync {
    /// The sums.
    fn apply(&self, charges: &[T], densities: usize, numbers: usize) -> Result<Vec<T>, Error>;
    /// The sums and their error.
    fn apply_certified(
        &self,
        charges: &[T],
        densities: usize,
        numbers: usize,
    ) -> Result<(Vec<T>, Certificate), Error>;
    /// What the plan consists of.
    fn report(&self) -> Report;
}

impl<K: Kernel> Sum<K::Real> for Fmm<Interpolation<K>> {
    fn apply(
        &self,
        charges: &[K::Real],
        densities: usize,
        numbers: usize,
    ) -> Result<Vec<K::Real>, Error> {
        let charges = gathered::<Interpolation<K>>(charges, densities);
        Ok(flat::<Interpolation<K>>(&self.apply(&charges)?, numbers))
    }

    fn apply_certified(
        &self,
        charges: &[K::Real],
        densities: usize,
        numbers: usize,
    ) -> Result<(Vec<K::Real>, Certificate), Error> {
        let charges = gathered::<Interpolation<K>>(charges, densities);
        let (values, certificate) = self.apply_certified(&charges)?;
        Ok((flat::<Interpolation<K>>(&values, numbers), certificate))
    }

    fn report(&self) -> Report {
        self.report()
    }
}

fn gathered<E: Expansion>(numbers: &[RealOf<E>], len: usize) -> Vec<ChargeOf<E>> {
    let charge = |numbers: &[RealOf<E>]| {
        let mut charge = ChargeOf::<E>::zero();
        numbers.iter().enumerate().for_each(|(k, number)| charge.set_number(k, *number));
        charge
    };
    numbers.chunks_exact(len.max(1)).map(charge).collect()
}

fn flat<E: Expansion>(values: &[ValueOf<E>], len: usize) -> Vec<RealOf<E>> {
    values.iter().flat_map(|value| (0..len).map(|k| value.number(k))).collect()
}
