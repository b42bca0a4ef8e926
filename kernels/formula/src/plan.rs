//! Sums of a kernel that is chosen at run time, from plain arrays to plain arrays.

use std::sync::{Arc, Mutex};

use farfield::{Certificate, Error, Point, Report, Watch};

use crate::coincidence::check_derivatives;
use crate::columns::{self, Columns};
use crate::formula::TextFormula;
use crate::precision::{Precision, Request, Sum, is_fast};

/// What a [`Plan`] is built for.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Options {
    /// The relative l2 error to stay below; 1e-6 by default.
    pub tolerance: f64,
    /// What is summed beside values; nothing by default.
    pub derivatives: Derivatives,
    /// How often the plan will be applied, about; once by default.
    pub applications: usize,
    /// How many right-hand sides it will be applied to at once, about; one by default.
    pub columns: usize,
}

/// What is summed beside values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Derivatives {
    /// Nothing.
    #[default]
    None,
    /// The three derivatives with respect to the target.
    Gradient,
    /// Those, and the six second derivatives: along axes 1 1, 1 2, 1 3, 2 2, 2 3, 3 3.
    Hessian,
}

impl Derivatives {
    /// How many numbers there are for one value: 1, 4 or 10.
    pub fn parts(self) -> usize {
        match self {
            Self::None => 1,
            Self::Gradient => 4,
            Self::Hessian => 10,
        }
    }
}

impl Default for Options {
    fn default() -> Self {
        let derivatives = Derivatives::None;
        Self { tolerance: 1e-6, derivatives, applications: 1, columns: 1 }
    }
}

/// How many right-hand sides are summed together, and in how many groups. 1/r, as it is known by name, is summed so fast
/// for one of them that several together take no less.
fn groups(kernel: &TextFormula, derivatives: Derivatives, columns: usize) -> (usize, usize) {
    if is_fast(kernel, derivatives) { (1, columns) } else { columns::groups(columns) }
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
pub struct Plan<T: Precision> {
    kernel: TextFormula,
    options: Options,
    sources: Arc<[Point<T>]>,
    targets: Arc<[Point<T>]>,
    /// As many right-hand sides as it was planned for, and how many these are.
    sum: Columned<T>,
    /// Likewise, as many as it was applied to last.
    other: Mutex<Option<Columned<T>>>,
}

/// A sum, and the number of right-hand sides that it takes.
type Columned<T> = (usize, Arc<dyn Sum<T>>);

impl<T: Precision> Plan<T> {
    /// Plans the sums of a kernel. 1/r, as it is [known by name](crate::Ready), is summed by
    /// [`farfield_potentials`], which knows it better.
    ///
    /// # Errors
    /// Those of [`Builder::build`](farfield::Builder::build); [`Error::NotDifferentiable`] if derivatives are asked for
    /// where points coincide, such pairs count, and the kernel has none.
    pub fn new(
        kernel: &TextFormula,
        sources: &[Point<T>],
        targets: &[Point<T>],
        options: &Options,
    ) -> Result<Self, Error> {
        Self::watched(kernel, sources, targets, options, &Watch::default())
    }

    /// As [`new`](Self::new), while a watch looks on that can stop it.
    ///
    /// # Errors
    /// As [`new`](Self::new), or [`Error::Stopped`].
    pub fn watched(
        kernel: &TextFormula,
        sources: &[Point<T>],
        targets: &[Point<T>],
        options: &Options,
        watch: &Watch,
    ) -> Result<Self, Error> {
        Self::like(None, kernel, sources.into(), targets.into(), options, watch)
    }

    fn like(
        scheme: Option<farfield::Scheme>,
        kernel: &TextFormula,
        sources: Arc<[Point<T>]>,
        targets: Arc<[Point<T>]>,
        options: &Options,
        watch: &Watch,
    ) -> Result<Self, Error> {
        let (columns, _) = groups(kernel, options.derivatives, options.columns);
        let request = Request { columns, scheme, leaf_size: None, watch };
        let sum = T::plan(kernel, &sources, &targets, options, &request)?;
        check_derivatives::<T>(kernel, &sources, &targets, options.derivatives)?;
        Ok(Self {
            kernel: kernel.clone(),
            options: *options,
            sources,
            targets,
            sum: (columns, sum.into()),
            other: Mutex::new(None),
        })
    }

    /// The plan for the transposed matrix: w ↦ Σ_i K(x_i, y_j)ᵀ w_i, at all sources. It has the same points and the
    /// same tolerance, and is a plan of its own: where this one sums directly, so does the other, and both products
    /// are adjoint to each other but for rounding. Otherwise each is as near to the exact matrix and its transpose as
    /// the tolerance says, and no nearer to the other's.
    ///
    /// # Errors
    /// As [`watched`](Self::watched).
    pub fn transposed(&self, watch: &Watch) -> Result<Self, Error> {
        let direct = (self.report().stats.scheme == farfield::Scheme::Direct)
            .then_some(farfield::Scheme::Direct);
        let (sources, targets) = (Arc::clone(&self.targets), Arc::clone(&self.sources));
        Self::like(direct, &self.kernel.transposed(), sources, targets, &self.options, watch)
    }

    /// The sums for some charges: for every target, the fields, then, with gradients, their derivatives along the
    /// first axis, the second and the third, then, with Hessians, their second derivatives.
    ///
    /// # Errors
    /// Those of [`Fmm::apply`](farfield::Fmm::apply), and [`Error::LengthMismatch`] if there are not as many numbers as
    /// sources and densities.
    pub fn apply(&self, charges: &[T]) -> Result<Vec<T>, Error> {
        self.apply_columns(charges, 1, &Watch::default())
    }

    /// The sums for several right-hand sides, while a watch looks on that can stop them.
    ///
    /// Of each source, there are for each density its numbers in all columns. Of each target there are, for each number
    /// that [`apply`](Self::apply) gives, those of all columns. Kernel and trees are gone through once for some columns
    /// together, which takes less than a sum for each. Columns are brought to one size first, by powers of two, so that
    /// small ones are as accurate as large ones; the tolerance holds for all that are summed together.
    ///
    /// # Errors
    /// As [`apply`](Self::apply), or [`Error::Stopped`].
    pub fn apply_columns(
        &self,
        charges: &[T],
        columns: usize,
        watch: &Watch,
    ) -> Result<Vec<T>, Error> {
        let (expected, found) = (self.sources.len() * self.densities() * columns, charges.len());
        if found != expected {
            return Err(Error::LengthMismatch { what: "numbers of charges", expected, found });
        }
        let (width, groups) = groups(&self.kernel, self.options.derivatives, columns);
        if columns == 0 {
            return Ok(Vec::new());
        }
        let sum = self.sum_of(width, watch)?;
        let (densities, numbers) = (self.densities(), self.numbers());
        if columns == 1 {
            return sum.apply(charges, densities, numbers, watch);
        }
        let mut values = vec![T::from_f64(0.0); self.targets.len() * numbers * columns];
        let all = Columns { columns, first: 0, width };
        for group in 0..groups {
            let own = Columns { first: group * width, ..all };
            let (charges, units) = own.taken(charges);
            let found = sum.apply(&charges, densities * width, numbers * width, watch)?;
            own.put(&found, &units, &mut values);
        }
        Ok(values)
    }

    /// The sums, and how far they are from the exact ones, see
    /// [`Fmm::apply_certified`](farfield::Fmm::apply_certified).
    ///
    /// # Errors
    /// As [`apply`](Self::apply), or [`Error::Stopped`].
    pub fn apply_certified(
        &self,
        charges: &[T],
        watch: &Watch,
    ) -> Result<(Vec<T>, Certificate), Error> {
        let (expected, found) = (self.sources.len() * self.densities(), charges.len());
        if found != expected {
            return Err(Error::LengthMismatch { what: "numbers of charges", expected, found });
        }
        let sum = self.sum_of(1, watch)?;
        sum.apply_certified(charges, self.densities(), self.numbers(), watch)
    }

    /// What the plan consists of, and what it took.
    pub fn report(&self) -> Report {
        self.sum.1.report()
    }

    /// Numbers of a charge.
    pub fn densities(&self) -> usize {
        self.kernel.columns()
    }

    /// Numbers of a value, its derivatives among them.
    pub fn numbers(&self) -> usize {
        self.options.derivatives.parts() * self.kernel.rows()
    }

    /// How many sources there are.
    pub fn sources(&self) -> usize {
        self.sources.len()
    }

    /// How many targets there are.
    pub fn targets(&self) -> usize {
        self.targets.len()
    }

    /// The sum for so many right-hand sides: the one that was planned, the last one, or one that is planned now, with
    /// the same scheme and leaves.
    fn sum_of(&self, columns: usize, watch: &Watch) -> Result<Arc<dyn Sum<T>>, Error> {
        let locked = || self.other.lock().unwrap_or_else(|e| e.into_inner());
        let other = locked().clone();
        let known = [Some(self.sum.clone()), other].into_iter().flatten();
        if let Some((_, sum)) = known.into_iter().find(|(known, _)| *known == columns) {
            return Ok(sum);
        }
        let stats = self.report().stats;
        let (scheme, leaf_size) = (Some(stats.scheme), Some(stats.leaf_size));
        let request = Request { columns, scheme, leaf_size, watch };
        let sum = T::plan(&self.kernel, &self.sources, &self.targets, &self.options, &request)?;
        let sum: Arc<dyn Sum<T>> = sum.into();
        *locked() = Some((columns, Arc::clone(&sum)));
        Ok(sum)
    }
}

impl<T: Precision> std::fmt::Debug for Plan<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Plan")
            .field("kernel", &self.kernel)
            .field("sources", &self.sources.len())
            .field("targets", &self.targets.len())
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
    derivatives: Derivatives,
) -> Result<Vec<T>, Error> {
    T::direct_sums(kernel, sources, charges, targets, derivatives)
}
