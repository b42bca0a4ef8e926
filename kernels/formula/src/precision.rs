//! What plans need of the engine, compiled once for all programs.

use farfield::{
    Certificate, ChargeOf, Error, Expansion, Fmm, Interpolation, Kernel, Numbers, Point, Real,
    RealOf, Report, Sampling, Scheme, ValueOf, Watch, direct,
};
use farfield_potentials::InverseDistance;

use crate::formula::{Coincident, TextFormula};
use crate::kernel::TextKernel;
use crate::plan::{Derivatives, Options};

/// A precision of [`Plan`](crate::Plan)s: `f32` or `f64`. What they need of the engine is compiled here, once for all
/// programs.
pub trait Precision: Real {
    #[doc(hidden)]
    /// What a plan keeps.
    fn plan(
        kernel: &TextFormula,
        sources: &[Point<Self>],
        targets: &[Point<Self>],
        options: &Options,
        request: &Request<'_>,
    ) -> Result<Box<dyn Sum<Self>>, Error>;
    #[doc(hidden)]
    /// What [`direct_sums`](crate::direct_sums) gives.
    fn direct_sums(
        kernel: &TextFormula,
        sources: &[Point<Self>],
        charges: &[Self],
        targets: &[Point<Self>],
        derivatives: Derivatives,
    ) -> Result<Vec<Self>, Error>;
}

/// What a plan is asked for beside its [`Options`].
#[derive(Debug)]
pub struct Request<'a> {
    /// How many right-hand sides it takes.
    pub(crate) columns: usize,
    /// How it sums, unless that is its own choice.
    pub(crate) scheme: Option<Scheme>,
    pub(crate) leaf_size: Option<usize>,
    pub(crate) watch: &'a Watch,
}

/// Lists of numbers, whatever the sizes of the kernel.
type Lists<T> = TextKernel<Point<T>, Vec<T>, Vec<T>>;

/// The kernel for lists of so many right-hand sides, with derivatives.
fn lists<T: Real>(kernel: &TextFormula, columns: usize, derivatives: Derivatives) -> Lists<T> {
    let values: Lists<T> = kernel.kernel::<Point<T>, Vec<T>, Vec<T>>().with_columns(columns);
    match derivatives {
        Derivatives::None => values,
        Derivatives::Gradient => values.gradient(),
        Derivatives::Hessian => values.hessian(),
    }
}

macro_rules! precisions {
    ($($t:ty),*) => {$(
        impl Precision for $t {
            fn plan(
                kernel: &TextFormula,
                sources: &[Point<Self>],
                targets: &[Point<Self>],
                options: &Options,
                request: &Request<'_>,
            ) -> Result<Box<dyn Sum<Self>>, Error> {
                Inputs { sources, targets, options, request }.plan(kernel)
            }

            fn direct_sums(
                kernel: &TextFormula,
                sources: &[Point<Self>],
                charges: &[Self],
                targets: &[Point<Self>],
                derivatives: Derivatives,
            ) -> Result<Vec<Self>, Error> {
                type Own = Interpolation<Lists<$t>>;
                let numbers = derivatives.parts() * kernel.rows();
                let charges = gathered::<Own>(charges, kernel.columns());
                let sums = direct(&lists(kernel, 1, derivatives), sources, &charges, targets)?;
                Ok(flat::<Own>(&sums, numbers))
            }
        }
    )*};
}

precisions!(f32, f64);

/// Whether the sums are those of 1/r as it is known by name, which [`farfield_potentials`] knows better.
pub(crate) fn is_fast(kernel: &TextFormula, derivatives: Derivatives) -> bool {
    kernel.is_ready("laplace")
        && kernel.at_coincident_points() == Coincident::Skip
        && derivatives != Derivatives::Hessian
}

/// What a plan is built from, but for the kernel.
struct Inputs<'a, T: Real> {
    sources: &'a [Point<T>],
    targets: &'a [Point<T>],
    options: &'a Options,
    request: &'a Request<'a>,
}

impl<T: Real> Inputs<'_, T> {
    fn plan(&self, kernel: &TextFormula) -> Result<Box<dyn Sum<T>>, Error> {
        let Options { derivatives, .. } = *self.options;
        let is_laplace = is_fast(kernel, derivatives);
        match (kernel.rows(), kernel.columns(), self.request.columns, derivatives) {
            (1, 1, 1, Derivatives::None) if is_laplace => self.plan_of(InverseDistance::<T>::new()),
            (1, 1, 1, Derivatives::Gradient) if is_laplace => {
                self.plan_of(InverseDistance::<T>::new().with_gradient())
            }
            (1, 1, 1, Derivatives::None) => self.plan_of(kernel.kernel::<Point<T>, T, T>()),
            (1, 1, 1, Derivatives::Gradient) => {
                self.plan_of(kernel.kernel::<Point<T>, T, T>().gradient::<[T; 4]>())
            }
            (3, 3, 1, Derivatives::None) => {
                self.plan_of(kernel.kernel::<Point<T>, [T; 3], [T; 3]>())
            }
            (_, _, columns, derivatives) => self.plan_of(lists::<T>(kernel, columns, derivatives)),
        }
    }

    fn plan_of<K>(&self, kernel: K) -> Result<Box<dyn Sum<T>>, Error>
    where
        K: Kernel<Real = T, Source = Point<T>, Target = Point<T>> + 'static,
    {
        let Options { tolerance, applications, .. } = *self.options;
        let Request { scheme, leaf_size, watch, .. } = *self.request;
        let mut builder = Fmm::builder(kernel).tolerance(tolerance).applications(applications);
        builder = builder.watch(watch);
        if let Some(scheme) = scheme {
            builder = builder.scheme(scheme);
        }
        if let Some(leaf_size) = leaf_size {
            builder = builder.leaf_size(leaf_size);
        }
        Ok(Box::new(builder.build(self.sources, self.targets)?))
    }
}

/// A plan whose kernel's type is forgotten.
pub trait Sum<T>: Send + Sync {
    /// The sums.
    fn apply(
        &self,
        charges: &[T],
        densities: usize,
        numbers: usize,
        watch: &Watch,
    ) -> Result<Vec<T>, Error>;
    /// The sums and their error.
    fn apply_certified(
        &self,
        charges: &[T],
        densities: usize,
        numbers: usize,
        watch: &Watch,
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
        watch: &Watch,
    ) -> Result<Vec<K::Real>, Error> {
        let charges = gathered::<Interpolation<K>>(charges, densities);
        Ok(flat::<Interpolation<K>>(&self.apply_watched(&charges, watch)?, numbers))
    }

    fn apply_certified(
        &self,
        charges: &[K::Real],
        densities: usize,
        numbers: usize,
        watch: &Watch,
    ) -> Result<(Vec<K::Real>, Certificate), Error> {
        let charges = gathered::<Interpolation<K>>(charges, densities);
        let (values, certificate) =
            self.apply_certified_watched(&charges, &Sampling::default(), watch)?;
        Ok((flat::<Interpolation<K>>(&values, numbers), certificate))
    }

    fn report(&self) -> Report {
        self.report()
    }
}

fn gathered<E: Expansion>(numbers: &[RealOf<E>], len: usize) -> Vec<ChargeOf<E>> {
    let charge = |numbers: &[RealOf<E>]| {
        let mut charge = ChargeOf::<E>::zero();
        // From the last one on: lists get their whole length at once.
        numbers.iter().enumerate().rev().for_each(|(k, number)| charge.set_number(k, *number));
        charge
    };
    numbers.chunks_exact(len.max(1)).map(charge).collect()
}

fn flat<E: Expansion>(values: &[ValueOf<E>], len: usize) -> Vec<RealOf<E>> {
    values.iter().flat_map(|value| (0..len).map(|k| value.number(k))).collect()
}
