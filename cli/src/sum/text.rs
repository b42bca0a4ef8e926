//! Sums of kernels that are known by name or given as a formula.

use std::time::Instant;

use farfield::{Point, Real, Vector, relative_l2_error};
use farfield_formula::{KernelError, Options, Plan, Ready, TextFormula, direct_sums};

use super::args::{self, Args, Scheme};
use super::error::Failure;
use super::progress::shown;
use super::report::Report;
use super::run::{Errors, Input, TOLERANCE, publish, repeated};
use super::write::{self, Number};
use crate::memory::peak_memory_bytes;

/// Refuses flags of a formula with a power law.
pub(super) fn refuse_flags(args: &Args) -> Result<(), Failure> {
    let expected = "a formula or a name that `farfield kernels` lists";
    let flags = [
        ("--param", !args.param.is_empty()),
        ("--coincident", args.coincident.is_some()),
        ("--hessian", args.hessian),
    ];
    refuse(args, &flags, expected)
}

/// Does what the command line asks for, with a kernel that is no power law by its name.
pub(super) fn run<T: Number>(args: &Args) -> Result<(), Failure> {
    let kernel = kernel(args)?;
    let expected = "inverse-distance, inverse-square, inverse-fourth or squared-distance";
    let flags = [
        ("--expansion", args.expansion.is_some()),
        ("--order", args.order.is_some()),
        ("--scheme", args.scheme != Scheme::Auto),
        ("--leaf-size", args.leaf_size.is_some()),
    ];
    refuse(args, &flags, expected)?;
    let input = Input::<T>::read(args, kernel.columns())?;
    let start = Instant::now();
    let mut options = Options::default();
    options.tolerance = args.tolerance.unwrap_or(TOLERANCE);
    options.derivatives = args.derivatives();
    options.applications = args.repeat;
    let (sources, targets) = (&input.sources, &input.targets);
    let plan = || Plan::watched(&kernel, sources, targets, &options, &args.watch);
    let plan = shown(&args.watch, plan)?;
    let plan_s = start.elapsed().as_secs_f64();
    let apply = || plan.apply_columns(&input.charges, 1, &args.watch);
    let (values, apply_s) = shown(&args.watch, || repeated(args.repeat, apply))?;
    let peak_memory_bytes = peak_memory_bytes();
    let (errors, sampled) = errors(args, &kernel, &input, &values)?;
    let stats = plan.report().stats;
    let report = Report {
        points: input.sources.len(),
        targets: input.targets.len(),
        kernel: args.kernel.clone(),
        gradient: args.gradient || args.hessian,
        hessian: args.hessian,
        scheme: stats.scheme.to_string(),
        precision: args::name(args.precision),
        threads: rayon::current_num_threads(),
        tolerance: Some(options.tolerance),
        expansion: args::name(args::Expansion::Interpolation),
        order: None,
        plan_s,
        apply_s,
        repeat: args.repeat,
        relative_l2_error: errors[0],
        gradient_relative_l2_error: (args.gradient || args.hessian).then_some(errors[1]),
        hessian_relative_l2_error: args.hessian.then_some(errors[2]),
        sampled_targets: sampled,
        terms_per_cell: stats.terms_per_cell,
        cells: stats.cells,
        depth: stats.depth,
        leaf_size: stats.leaf_size,
        peak_memory_bytes,
    };
    publish(args, &report, &values, &write::columns(kernel.rows(), args.derivatives()))
}

/// The kernel that is asked for.
fn kernel(args: &Args) -> Result<TextFormula, Failure> {
    let parameters: Vec<_> = args.param.iter().map(|(name, x)| (name.as_str(), *x)).collect();
    let kernel = Ready::or_text(&args.kernel, &parameters).map_err(|error| match error {
        KernelError::UnknownKernel { .. } => {
            Failure::UnknownKernel { name: args.kernel.clone(), source: Box::new(error) }
        }
        other => Failure::Kernel(other),
    })?;
    Ok(match args.coincident {
        Some(coincident) => kernel.coincident(coincident),
        None => kernel,
    })
}

fn refuse(
    args: &Args,
    flags: &[(&'static str, bool)],
    expected: &'static str,
) -> Result<(), Failure> {
    match flags.iter().find(|(_, given)| *given) {
        Some((flag, _)) => Err(Failure::Flag { flag, kernel: args.kernel.clone(), expected }),
        None => Ok(()),
    }
}

/// Relative l2 errors of values, of gradients and of second derivatives against direct sums in double precision, at evenly spaced
/// targets; and how many these are.
fn errors<T: Real>(
    args: &Args,
    kernel: &TextFormula,
    input: &Input<T>,
    values: &[T],
) -> Result<([f64; 3], usize), Failure> {
    let (fields, count) = (kernel.rows(), input.targets.len());
    let numbers = args.derivatives().parts() * fields;
    let sampled = count.min(Errors::SAMPLES);
    let sample: Vec<_> = (0..sampled).map(|i| i * count / sampled).collect();
    let double = |p: &Point<T>| Point::<f64>::from_array(p.to_array().map(|c| c.as_f64()));
    let sources: Vec<_> = input.sources.iter().map(double).collect();
    let charges: Vec<_> = input.charges.iter().map(|q| q.as_f64()).collect();
    let targets: Vec<_> = sample.iter().map(|&i| double(&input.targets[i])).collect();
    let exact = direct_sums(kernel, &sources, &charges, &targets, args.derivatives())?;
    let found = sample.iter().flat_map(|&i| &values[i * numbers..][..numbers]);
    let found: Vec<_> = found.map(|u| u.as_f64()).collect();
    let part = |numbers_of: &[f64], from: usize, len: usize| -> Vec<f64> {
        numbers_of.chunks(numbers).flat_map(|u| u[from..][..len].to_vec()).collect()
    };
    let error = |from: usize, len: usize| {
        relative_l2_error::<f64>(&part(&found, from, len), &part(&exact, from, len))
    };
    let slopes = numbers.min(4 * fields) - fields;
    let rest = fields + slopes;
    Ok(([error(0, fields), error(fields, slopes), error(rest, numbers - rest)], sampled))
}
