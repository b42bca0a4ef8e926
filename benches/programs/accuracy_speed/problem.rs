//! One sum, and what it takes in any way of summing.

use std::time::Instant;

use farfield::{Error, Expansion, Fmm, Kernel, Numbers, Scheme, direct, relative_l2_error};
use farfield_benches::clouds;
use farfield_benches::operators::forget_operators;
use glam::DVec3;

use crate::placed::{Placed, charges, numbers};

/// Points that act on each other, with exact sums at some of them.
#[derive(Debug)]
pub(crate) struct Problem<K: Kernel> {
    /// What is summed.
    pub(crate) kernel: K,
    points: Vec<K::Source>,
    charges: Vec<K::Charge>,
    exact: Vec<f64>,
    /// Every so many-th point is a target whose exact sum is known.
    step: usize,
}

/// What a sum took. Times in seconds.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Measured {
    /// Relative l2 error.
    pub(crate) error: f64,
    /// A plan with no operators to remember.
    pub(crate) first_plan: f64,
    /// The same plan again.
    pub(crate) plan: f64,
    /// From charges to values.
    pub(crate) apply: f64,
    /// Terms of a cell at the deepest level.
    pub(crate) terms: usize,
}

/// Whether an error is more than was asked for; so is one that is not a number.
pub(crate) fn misses(error: f64, asked: f64) -> bool {
    error.is_nan() || error > asked
}

/// A sum that takes more seconds than this is done once.
const LONG: f64 = 10.0;

impl<K, P> Problem<K>
where
    P: Placed,
    K: Kernel<Source = P, Target = P>,
{
    /// The sum over a cloud, judged at about `samples` targets by the same kernel in double precision.
    pub(crate) fn new<J>(kernel: K, judge: &J, cloud: &[DVec3], samples: usize) -> Self
    where
        J: Kernel<Real = f64, Source = P::Wide, Target = P::Wide>,
        J::Charge: Numbers<Real = f64>,
        J::Value: Numbers<Real = f64>,
    {
        let points: Vec<P> = cloud.iter().enumerate().map(|(i, &p)| P::at(p, i)).collect();
        let width = <K::Charge as Numbers>::LEN;
        let charges: Vec<K::Charge> = charges(&clouds::charges(width * points.len()));
        let step = points.len().div_ceil(samples).max(1);

        let sources: Vec<P::Wide> = points.iter().map(P::widened).collect();
        let targets: Vec<P::Wide> = sources.iter().step_by(step).cloned().collect();
        let rounded: Vec<J::Charge> = crate::placed::charges(&numbers(&charges));
        let exact = numbers(&direct(judge, &sources, &rounded, &targets).unwrap());
        Self { kernel, points, charges, exact, step }
    }

    /// Direct summation in the kernel's own precision, timed at the sampled targets and scaled up.
    pub(crate) fn directly(&self) -> Measured {
        let targets: Vec<P> = self.points.iter().step_by(self.step).cloned().collect();
        let start = Instant::now();
        let values = direct(&self.kernel, &self.points, &self.charges, &targets).unwrap();
        let seconds = start.elapsed().as_secs_f64();
        let error = relative_l2_error(&numbers(&values), &self.exact);
        let apply = seconds * self.points.len() as f64 / targets.len() as f64;
        Measured { error, apply, ..Measured::default() }
    }

    /// A sum that needs no plan.
    ///
    /// # Errors
    /// Those of the sum.
    pub(crate) fn without_plan(
        &self,
        sum: impl Fn(&[P], &[K::Charge]) -> Result<Vec<K::Value>, Error>,
        repeats: usize,
    ) -> Result<Measured, Error> {
        let (values, first) = timed(|| sum(&self.points, &self.charges))?;
        let apply = median(first, repeats, || sum(&self.points, &self.charges))?;
        Ok(Measured { error: self.error(&values), apply, ..Measured::default() })
    }

    /// Sums by an expansion that `make` makes. With no `repeats`, the error alone counts, and operators
    /// are remembered.
    ///
    /// # Errors
    /// Those of the expansion, the plan and the sum.
    pub(crate) fn measure<E: Expansion<Kernel = K>>(
        &self,
        scheme: Scheme,
        make: impl Fn() -> Result<E, Error>,
        repeats: usize,
    ) -> Result<Measured, Error> {
        if repeats > 0 {
            forget_operators()?;
        }
        let build = || {
            let builder = Fmm::with_expansion(make()?).scheme(scheme);
            builder.build(&self.points, &self.points)
        };
        let (fmm, first_plan) = timed(build)?;
        let (values, first) = timed(|| fmm.apply(&self.charges))?;
        let (error, terms) = (self.error(&values), fmm.report().stats.terms_per_cell);
        if repeats == 0 {
            return Ok(Measured { error, first_plan, plan: first_plan, apply: first, terms });
        }
        drop(fmm);
        let (fmm, plan) = timed(build)?;
        if first <= LONG {
            // The first application after a plan allocates what the others work on.
            fmm.apply(&self.charges)?;
        }
        let apply = median(first, repeats, || fmm.apply(&self.charges))?;
        Ok(Measured { error, first_plan, plan, apply, terms })
    }

    fn error(&self, values: &[K::Value]) -> f64 {
        relative_l2_error(&numbers(values.iter().step_by(self.step)), &self.exact)
    }
}

/// The median time of a job that took `first` seconds already, which is the answer if that was long.
fn median<V>(first: f64, repeats: usize, job: impl Fn() -> Result<V, Error>) -> Result<f64, Error> {
    if first > LONG || repeats == 0 {
        return Ok(first);
    }
    let mut times = Vec::new();
    for _ in 0..repeats {
        times.push(timed(&job)?.1);
    }
    times.sort_by(f64::total_cmp);
    Ok(times[times.len() / 2])
}

fn timed<V>(job: impl FnOnce() -> Result<V, Error>) -> Result<(V, f64), Error> {
    let start = Instant::now();
    let value = job()?;
    Ok((value, start.elapsed().as_secs_f64()))
}
