//! The plan: everything that depends on geometry alone, built once, applied to any charges.

use std::fmt;
use std::sync::Arc;

use crate::error::Error;
use crate::expansion::{ChargeOf, Expansion, ValueOf};
use crate::kernel::direct::check_charges;
use crate::numbers::traits::Numbers;
use crate::parallel;
use crate::parallel::watch::Watch;
use crate::plan::Plan;
use crate::plan::choices::Choices;
use crate::plan::estimate::Estimate;
use crate::plan::guard::Guard;
use crate::plan::ready::Ready;
use crate::plan::stats::{Stats, stats};
use crate::plan::times::{ApplyTimes, BuildTimes, Clock};
use crate::plan::tuning::CHECK_CHUNK;

/// A plan for sums between fixed points: trees, interaction lists, operators and mask.
///
/// Building costs O(N log N); [`apply`](Self::apply) may then be called any number of times, from
/// any thread. Its result has the same bits for any number of threads.
///
/// ```
/// use farfield::{Fmm, from_fn};
/// use glam::DVec3;
///
/// let points: Vec<DVec3> = (0..500).map(|i| DVec3::splat(f64::from(i)).map(f64::sin)).collect();
/// let charges = vec![1.0; points.len()];
///
/// let kernel = from_fn(|x: DVec3, y: DVec3| (-x.distance(y)).exp());
/// let fmm = Fmm::builder(kernel).tolerance(1e-6).build(&points, &points)?;
/// let potentials = fmm.apply(&charges)?;
///
/// let exact = farfield::direct(&kernel, &points, &charges, &points)?;
/// assert!(farfield::relative_l2_error(&potentials, &exact) < 1e-6);
/// # Ok::<(), farfield::Error>(())
/// ```
pub struct Fmm<E: Expansion> {
    /// For charges of like size everywhere.
    pub(crate) usual: Arc<Ready<E>>,
    /// What was chosen for it, and is for plans that take its place.
    pub(crate) choices: Choices<'static>,
    /// What sees to others, where they make a difference.
    pub(crate) guard: Option<Guard<E>>,
    pub(crate) stats: Stats,
    pub(crate) build_times: BuildTimes,
    pub(crate) estimate: Option<Estimate>,
}

impl<E: Expansion> Fmm<E> {
    pub(crate) fn new(
        plan: Plan<E>,
        choices: Choices<'static>,
        guard: Option<Guard<E>>,
        build_times: BuildTimes,
        estimate: Option<Estimate>,
        fallback: Option<String>,
    ) -> Self {
        let stats = Stats { fallback, ..stats(&plan) };
        Self { usual: Arc::new(Ready::new(plan)), choices, guard, stats, build_times, estimate }
    }

    /// The sums u_i = Σ_j K(x_i, y_j) q_j at all targets, in the caller's order. O(N).
    ///
    /// The tolerance holds for ‖ũ − u‖₂ relative to the larger of ‖u‖₂ and (Σ_ij |K_ij|² |q_j|²)^½, which is
    /// what sums come to for charges of random sign. Where charges are so distributed that far more of the sums
    /// comes from afar than if they were of one size, operators are set up for them first, or they are summed
    /// directly.
    ///
    /// # Errors
    /// If there is not one charge per source, a charge is not finite, or a sum is not.
    pub fn apply(&self, charges: &[ChargeOf<E>]) -> Result<Vec<ValueOf<E>>, Error> {
        self.apply_watched(charges, &Watch::default())
    }

    /// The same sums as [`apply`](Self::apply), to the bit, while a watch looks on that can stop them. The plan stays as
    /// it is then.
    ///
    /// # Errors
    /// As [`apply`](Self::apply), or [`Error::Stopped`].
    pub fn apply_watched(
        &self,
        charges: &[ChargeOf<E>],
        watch: &Watch,
    ) -> Result<Vec<ValueOf<E>>, Error> {
        self.check_charges(charges)?;
        let ready = self.plan_for(charges, watch)?;
        let values = ready.with_workspace(|workspace| ready.plan.run(charges, workspace, watch));
        watch.check()?;
        check_values(&values)?;
        Ok(values)
    }

    /// The same sums as [`apply`](Self::apply), to the bit, written over `values`, of which there is one for each
    /// target. For solvers that apply a plan again and again.
    ///
    /// ```
    /// use farfield::{Fmm, formula};
    ///
    /// let points: Vec<[f64; 3]> = (0..100).map(|i| [f64::from(i).sin(), f64::from(i).cos(), 0.0]).collect();
    /// let fmm = Fmm::builder(formula!(|d| d.length())).build(&points, &points)?;
    /// let mut potentials = vec![0.0; 100];
    /// fmm.apply_into(&[1.0; 100], &mut potentials)?;
    /// assert_eq!(potentials, fmm.apply(&[1.0; 100])?);
    /// # Ok::<(), farfield::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`apply`](Self::apply), and if there is not one value per target. What `values` hold after an error of a
    /// sum is not said.
    pub fn apply_into(
        &self,
        charges: &[ChargeOf<E>],
        values: &mut [ValueOf<E>],
    ) -> Result<(), Error> {
        let (expected, found) = (self.usual.plan.targets.len(), values.len());
        if found != expected {
            return Err(Error::LengthMismatch { what: "values", expected, found });
        }
        self.check_charges(charges)?;
        let watch = Watch::default();
        let ready = self.plan_for(charges, &watch)?;
        ready.with_workspace(|workspace| {
            ready.plan.run_into(charges, workspace, values, &watch);
        });
        check_values(values)
    }

    /// The same sums as [`apply`](Self::apply), to the bit, with the time that each operator took.
    /// A little slower: what `apply` does in one sweep over the targets takes three.
    ///
    /// # Errors
    /// As [`apply`](Self::apply).
    pub fn apply_timed(
        &self,
        charges: &[ChargeOf<E>],
    ) -> Result<(Vec<ValueOf<E>>, ApplyTimes), Error> {
        let mut clock = Clock::start();
        let mut checks = 0.0;
        self.check_charges(charges)?;
        clock.lap(&mut checks);
        let ready = self.plan_for(charges, &Watch::default())?;
        let (values, mut times) =
            ready.with_workspace(|workspace| ready.plan.run_timed(charges, workspace));
        clock = Clock::start();
        check_values(&values)?;
        clock.lap(&mut checks);
        times.permutation += checks;
        Ok((values, times))
    }

    /// The expansion, as prepared for this plan.
    pub fn expansion(&self) -> &E {
        &self.usual.plan.expansion
    }

    pub(crate) fn check_charges(&self, charges: &[ChargeOf<E>]) -> Result<(), Error> {
        let plan = &self.usual.plan;
        check_charges(plan.expansion.kernel(), plan.sources.len(), charges)?;
        match first_not_finite(charges) {
            Some(index) => Err(Error::NonFiniteCharge { index, charge: charges[index].to_f64s() }),
            None => Ok(()),
        }
    }

    /// The plan that keeps the tolerance for these charges.
    pub(crate) fn plan_for(
        &self,
        charges: &[ChargeOf<E>],
        watch: &Watch,
    ) -> Result<Arc<Ready<E>>, Error> {
        let other = match &self.guard {
            Some(guard) => guard.other_plan(&self.usual.plan, charges, watch)?,
            None => None,
        };
        Ok(other.unwrap_or_else(|| Arc::clone(&self.usual)))
    }
}

pub(crate) fn check_values<V: Numbers>(values: &[V]) -> Result<(), Error> {
    match first_not_finite(values) {
        Some(index) => Err(Error::NonFiniteValue { index, value: values[index].to_f64s() }),
        None => Ok(()),
    }
}

/// Index of the first value that is not finite. O(N).
fn first_not_finite<V: Numbers>(values: &[V]) -> Option<usize> {
    let all_finite = parallel::all(values.len().div_ceil(CHECK_CHUNK), &|chunk| {
        values[CHECK_CHUNK * chunk..].iter().take(CHECK_CHUNK).all(Numbers::is_finite)
    });
    if all_finite { None } else { values.iter().position(|value| !value.is_finite()) }
}

impl<E: Expansion> fmt::Debug for Fmm<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Fmm")
            .field("scheme", &self.usual.plan.scheme)
            .field("stats", &self.stats)
            .finish()
    }
}
