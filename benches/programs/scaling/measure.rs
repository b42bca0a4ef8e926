//! The measurement of one set of points: first the error, then the times.

use std::time::Instant;

use farfield::{
    ApplyTimes, Error, Fmm, Point, Real, Scalar, Scheme, Vector, direct, relative_l2_error,
};
use farfield_benches::cli::Precision;
use farfield_benches::clouds;
use farfield_benches::operators::forget_operators;
use glam::DVec3;
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};

use crate::args::Args;
use crate::kernels::{Charge, Summed, Value, Visit};
use crate::limits::Limits;
use crate::row::{Outcome, Row, Setting};

/// Targets at which errors are measured.
const SAMPLED: usize = 1000;

/// Measures every tolerance and number of threads on one set of points.
pub(crate) struct Measurement<'a> {
    /// What of the setting is fixed: all but tolerance and threads.
    pub(crate) setting: Setting,
    /// The points, rounded to the precision.
    pub(crate) points: &'a [DVec3],
    /// What was asked for.
    pub(crate) args: &'a Args,
    /// The pools to compute in.
    pub(crate) pools: &'a [ThreadPool],
    /// What the machine can do.
    pub(crate) limits: &'a Limits,
    /// Who hears of every row.
    pub(crate) report: &'a mut dyn FnMut(Setting, Outcome),
}

/// A pool of the given number of threads.
///
/// # Errors
/// If the system refuses them.
pub(crate) fn pool(threads: usize) -> Result<ThreadPool, ThreadPoolBuildError> {
    ThreadPoolBuilder::new().num_threads(threads).build()
}

/// Rounds a number to a precision.
pub(crate) fn rounded(x: f64, precision: Precision) -> f64 {
    match precision {
        Precision::F32 => f64::from(x as f32),
        Precision::F64 => x,
    }
}

impl Visit for Measurement<'_> {
    fn visit<T: Real, K: Summed<T>, R: Summed<f64>>(&mut self, kernel: K, reference: R) {
        let charges = clouds::charges(self.points.len()).into_iter();
        let charges: Vec<f64> = charges.map(|q| rounded(q, self.setting.precision)).collect();

        let step = self.points.len().div_ceil(SAMPLED);
        let sampled: Vec<DVec3> = self.points.iter().step_by(step).copied().collect();
        let qs: Vec<R::Charge> = charges.iter().map(|&q| Charge::of(q)).collect();
        let exact = direct(&reference, self.points, &qs, &sampled).unwrap();

        let points = self.points.iter().map(|p| Vector::from_array(p.to_array().map(T::from_f64)));
        let points: Vec<Point<T>> = points.collect();
        let charges: Vec<K::Charge> = charges.into_iter().map(Charge::of).collect();
        let (args, limits) = (self.args, self.limits);
        for &tolerance in &args.tolerances {
            for pool in self.pools {
                let threads = pool.current_num_threads();
                let setting = Setting { tolerance, threads, ..self.setting };
                let outcome = pool.install(|| {
                    let error = |values: &[K::Value]| {
                        let values: Vec<_> = values.iter().step_by(step).collect();
                        error(&values, &exact)
                    };
                    row(&setting, kernel, (&points, &charges), error, args.repeats, limits)
                });
                let refused = |error: Error| Outcome::Refused(error.to_string());
                (self.report)(setting, outcome.unwrap_or_else(refused));
            }
        }
    }
}

fn row<T: Real, K: Summed<T>>(
    setting: &Setting,
    kernel: K,
    (points, charges): (&[Point<T>], &[K::Charge]),
    error: impl Fn(&[K::Value]) -> f64,
    repeats: usize,
    limits: &Limits,
) -> Result<Outcome, Error> {
    forget_operators()?;
    let build = || {
        let builder = Fmm::builder(kernel).tolerance(setting.tolerance);
        builder.scheme(Scheme::Fmm).build(points, points)
    };
    let (fmm, plan) = timed(build)?;
    let error = error(&fmm.apply(charges)?);
    // A NaN fails too.
    if !matches!(error.partial_cmp(&setting.tolerance), Some(order) if order.is_le()) {
        return Ok(Outcome::Failed(error));
    }
    let first = fmm.report().build;
    drop(fmm);
    let (fmm, replan) = timed(build)?;

    // The first application after a plan allocates what the others work on.
    fmm.apply(charges)?;
    let mut applies = Vec::new();
    let mut runs: Vec<ApplyTimes> = Vec::new();
    for _ in 0..repeats {
        applies.push(timed(|| fmm.apply(charges))?.1);
        runs.push(fmm.apply_timed(charges)?.1);
    }
    applies.sort_by(f64::total_cmp);
    runs.sort_by(|a, b| a.total().total_cmp(&b.total()));
    let (apply, parts) = (applies[applies.len() / 2], runs[runs.len() / 2]);

    let stats = fmm.report().stats;
    let threads = setting.threads as f64;
    let pairs = stats.direct_pairs as f64 / (parts.near * threads);
    let bare = limits.pairs(setting.kernel, setting.precision, setting.tolerance);
    let far = stats.cell_pairs[0] > 0;
    let rank = stats.terms_per_cell;
    let k = if far { fmm.expansion().mean_m2l_rank(stats.depth) } else { None };
    let per_cell = if far { fmm.expansion().m2l_multiply_adds(stats.depth) } else { None };
    let per_pair = 2.0 * per_cell.unwrap_or(f64::NAN) / 189.0;
    let columns = kernel.columns() as f64;
    let complex = if K::Entry::COMPLEX { 4.0 } else { 1.0 };
    let flops = stats.cell_pairs[0] as f64 * per_pair * columns * complex;
    let product = limits.product(setting.precision);
    Ok(Outcome::Passed(Box::new(Row {
        error,
        plan,
        build: first,
        replan,
        built: first.operators > 2.0 * fmm.report().build.operators,
        apply,
        parts,
        nodes: fmm.expansion().nodes_per_axis(),
        rank,
        m2l_rank: k.unwrap_or(f64::NAN),
        leaf_size: stats.leaf_size,
        bytes_per_point: stats.bytes_per_point(),
        near_fraction: pairs / bare,
        m2l_fraction: flops / (parts.m2l * threads) / product,
    })))
}

/// The larger of the relative errors of potential and gradient.
fn error<V: Value, R: Value>(values: &[&V], exact: &[R]) -> f64 {
    let potentials: Vec<_> = values.iter().map(|v| v.potential()).collect();
    let gradients: Vec<_> = values.iter().map(|v| v.gradient()).collect();
    let exact_potentials: Vec<_> = exact.iter().map(Value::potential).collect();
    let exact_gradients: Vec<_> = exact.iter().map(Value::gradient).collect();
    let [u, gradient] = [
        relative_l2_error(&potentials, &exact_potentials),
        relative_l2_error(&gradients, &exact_gradients),
    ];
    if u.is_nan() || gradient.is_nan() { f64::NAN } else { u.max(gradient) }
}

fn timed<V>(job: impl FnOnce() -> Result<V, Error>) -> Result<(V, f64), Error> {
    let start = Instant::now();
    let value = job()?;
    Ok((value, start.elapsed().as_secs_f64()))
}
