//! From files to files, by all ranks together.

use std::fs;
use std::path::PathBuf;
use std::time::Instant;

use farfield::{Kernel, Numbers, Point, relative_l2_error};
use farfield_formula::{Derivatives, KernelError, Ready, TextFormula, direct_sums};
use rayon::ThreadPoolBuilder;
use serde_json::{Value, json};

use super::args::Args;
use super::files::{self, FileError, Table, own_rows};
use crate::collective::agree;
use crate::error::Error;
use crate::fmm::DistributedFmm;
use crate::transport::{Transport, Volume};

/// Targets at which the error is measured, at most.
const SAMPLES: usize = 1000;

/// Why nothing is written.
#[derive(Debug, thiserror::Error)]
pub(super) enum Failure {
    #[error(transparent)]
    Ranks(#[from] Error),
    #[error("{} holds {found} charges: expected one for each of the {expected} points", path.display())]
    Charges { path: PathBuf, found: usize, expected: usize },
    #[error(
        "the error is {error:.1e} at {sampled} targets: expected no more than the tolerance of {tolerance:e}"
    )]
    Inaccurate { error: f64, sampled: usize, tolerance: f64 },
}

/// Sums, measures the error, and writes everything; the report, unless it goes to a file.
pub(super) fn run(ranks: &dyn Transport, args: &Args) -> Result<String, Failure> {
    if let Some(count) = args.threads {
        let threads = ThreadPoolBuilder::new().num_threads(count.into()).build_global();
        agree(ranks, threads)?;
    }
    let kernel = agree(ranks, kernel(args))?;
    agree(ranks, args.out.as_deref().map_or(Ok(()), files::check_out))?;
    let input = Input::read(ranks, args, kernel.columns())?;
    let sizes = [kernel.columns(), args.derivatives().parts() * kernel.rows()];
    let plain = || kernel.kernel::<Point<f64>, f64, f64>();
    let lists = || kernel.kernel::<Point<f64>, Vec<f64>, Vec<f64>>().with_columns(1);
    let sums = match args.derivatives() {
        Derivatives::None if sizes == [1, 1] => Sums::new(ranks, args, &input, sizes, plain()),
        Derivatives::None => Sums::new(ranks, args, &input, sizes, lists()),
        Derivatives::Gradient => {
            Sums::new(ranks, args, &input, sizes, lists().gradient::<Vec<f64>>())
        }
        Derivatives::Hessian => {
            Sums::new(ranks, args, &input, sizes, lists().hessian::<Vec<f64>>())
        }
    }?;
    let (errors, sampled) = errors(ranks, args, &kernel, &input, &sums)?;
    let report = report(ranks, args, &input, &sums, (errors, sampled))?;
    let error = errors.into_iter().fold(0.0, f64::max);
    if error > args.tolerance {
        return Err(Failure::Inaccurate { error, sampled, tolerance: args.tolerance });
    }
    if let Some(path) = &args.out {
        files::write(ranks, path, [input.all_targets, sums.numbers], &sums.values)?;
    }
    let text = format!("{report:#}\n");
    let Some(path) = &args.report else { return Ok(text) };
    let written = if ranks.rank() == 0 { fs::write(path, text) } else { Ok(()) };
    agree(ranks, written.map_err(|error| format!("{}: {error}", path.display())))?;
    Ok(String::new())
}

fn kernel(args: &Args) -> Result<TextFormula, KernelError> {
    let parameters: Vec<_> = args.param.iter().map(|(name, x)| (name.as_str(), *x)).collect();
    let kernel = Ready::or_text(&args.kernel, &parameters)?;
    Ok(match args.coincident {
        Some(coincident) => kernel.coincident(coincident),
        None => kernel,
    })
}

/// This rank's part of what is in the files.
struct Input {
    sources: Vec<Point<f64>>,
    charges: Vec<f64>,
    targets: Vec<Point<f64>>,
    all_sources: usize,
    all_targets: usize,
}

impl Input {
    fn read(ranks: &dyn Transport, args: &Args, densities: usize) -> Result<Self, Failure> {
        let open = || {
            let targets = args.targets.as_ref().unwrap_or(&args.points);
            Ok::<_, FileError>([
                Table::open(&args.points, 3)?,
                Table::open(&args.charges, densities)?,
                Table::open(targets, 3)?,
            ])
        };
        let [mut points, mut charges, mut targets] = agree(ranks, open())?;
        let rows = [points.rows, charges.rows, targets.rows];
        same_for_all(ranks, rows)?;
        let [all_sources, found, all_targets] = rows;
        if found != all_sources {
            let path = args.charges.clone();
            return Err(Failure::Charges { path, found, expected: all_sources });
        }
        let own = |rows| own_rows(rows, ranks.rank(), ranks.size());
        let mut read = || {
            Ok::<_, FileError>(Self {
                sources: self::points(&points.read(own(all_sources))?),
                charges: charges.read(own(all_sources))?,
                targets: self::points(&targets.read(own(all_targets))?),
                all_sources,
                all_targets,
            })
        };
        Ok(agree(ranks, read())?)
    }
}

/// Refuses ranks that see other files than rank 0.
fn same_for_all(ranks: &dyn Transport, rows: [usize; 3]) -> Result<(), Error> {
    let all = ranks.gather(&rows.map(|rows| rows as u64))?;
    let names = ["rows of points", "rows of charges", "rows of targets"];
    for (rank, own) in all.iter().enumerate() {
        for ((what, found), expected) in names.into_iter().zip(own).zip(&all[0]) {
            if found != expected {
                let [found, expected] = [found, expected].map(u64::to_string);
                return Err(Error::Unlike { rank, what, found, expected });
            }
        }
    }
    Ok(())
}

fn points(coordinates: &[f64]) -> Vec<Point<f64>> {
    coordinates.as_chunks::<3>().0.iter().map(|&p| p.into()).collect()
}

/// The sums at this rank's targets.
struct Sums {
    values: Vec<f64>,
    /// How many numbers there are of each target.
    numbers: usize,
    plan_s: f64,
    apply_s: f64,
    /// What an application takes this rank to send.
    volume: Volume,
}

impl Sums {
    /// Of a kernel with so many densities, and so many numbers in a value.
    fn new<K>(
        ranks: &dyn Transport,
        args: &Args,
        input: &Input,
        [densities, numbers]: [usize; 2],
        kernel: K,
    ) -> Result<Self, Error>
    where
        K: Kernel<Real = f64, Source = Point<f64>, Target = Point<f64>>,
    {
        let start = Instant::now();
        let mut builder = DistributedFmm::builder(kernel, ranks).tolerance(args.tolerance);
        if let Some(leaf_size) = args.leaf_size {
            builder = builder.leaf_size(leaf_size as usize);
        }
        let fmm = builder.build(&input.sources, &input.targets)?;
        let plan_s = start.elapsed().as_secs_f64();
        let charge = |numbers: &[f64]| {
            let mut charge = K::Charge::zero();
            // From the last one on: lists get their whole length at once.
            numbers.iter().enumerate().rev().for_each(|(k, &number)| charge.set_number(k, number));
            charge
        };
        let charges: Vec<K::Charge> = input.charges.chunks(densities).map(charge).collect();
        let (start, before) = (Instant::now(), ranks.volume());
        let values = fmm.apply(&charges)?;
        let apply_s = start.elapsed().as_secs_f64();
        let volume = ranks.volume() - before;
        let numbers_of =
            |value: &K::Value| (0..numbers).map(|k| value.number(k)).collect::<Vec<_>>();
        let values = values.iter().flat_map(numbers_of).collect();
        Ok(Self { values, numbers, plan_s, apply_s, volume })
    }
}

/// The relative l2 errors of values, gradients and second derivatives against direct sums, at targets spaced evenly, and how many
/// these are. All ranks get the same.
fn errors(
    ranks: &dyn Transport,
    args: &Args,
    kernel: &TextFormula,
    input: &Input,
    sums: &Sums,
) -> Result<([f64; 3], usize), Error> {
    let (all, numbers) = (input.all_targets, sums.numbers);
    let sampled = all.min(SAMPLES);
    let own = own_rows(all, ranks.rank(), ranks.size());
    let sample = (0..sampled).map(|i| (i as u128 * all as u128 / sampled as u128) as usize);
    let sample: Vec<usize> = sample.filter(|i| own.contains(i)).map(|i| i - own.start).collect();
    let places: Vec<f64> = sample.iter().flat_map(|&i| input.targets[i].to_array()).collect();
    let found: Vec<f64> =
        sample.iter().flat_map(|&i| &sums.values[i * numbers..][..numbers]).copied().collect();
    let targets = points(&gathered(ranks, &places)?.concat());
    let found = gathered(ranks, &found)?.concat();
    // Each rank has the sums over its own sources.
    let part = direct_sums(kernel, &input.sources, &input.charges, &targets, args.derivatives());
    let parts = gathered(ranks, &agree(ranks, part)?)?;
    let exact = parts.into_iter().reduce(|mut sum, part| {
        sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        sum
    });
    let exact = exact.unwrap_or_default();
    let fields = kernel.rows();
    let error = |from: usize, to: usize| {
        let of = |all: &[f64]| -> Vec<f64> {
            all.chunks(numbers)
                .flat_map(|u| u[from.min(numbers)..to.min(numbers)].to_vec())
                .collect()
        };
        relative_l2_error::<f64>(&of(&found), &of(&exact))
    };
    let errors = [error(0, fields), error(fields, 4 * fields), error(4 * fields, 10 * fields)];
    Ok((errors, sampled))
}

/// The numbers of all ranks.
fn gathered(ranks: &dyn Transport, own: &[f64]) -> Result<Vec<Vec<f64>>, Error> {
    let words: Vec<u64> = own.iter().map(|number| number.to_bits()).collect();
    let all = ranks.gather(&words)?;
    Ok(all.iter().map(|words| words.iter().map(|&word| f64::from_bits(word)).collect()).collect())
}

/// What was done: the times of the slowest rank, and what all send to each other in an application.
fn report(
    ranks: &dyn Transport,
    args: &Args,
    input: &Input,
    sums: &Sums,
    (errors, sampled): ([f64; 3], usize),
) -> Result<Value, Error> {
    let times = gathered(ranks, &[sums.plan_s, sums.apply_s])?;
    let slowest = |k: usize| times.iter().map(|times| times[k]).fold(0.0, f64::max);
    let sent = ranks.gather(&[sums.volume.messages, sums.volume.words])?;
    let of_all = |k: usize| sent.iter().map(|sent| sent[k]).sum::<u64>();
    let derivatives = args.derivatives().parts();
    Ok(json!({
        "points": input.all_sources,
        "targets": input.all_targets,
        "kernel": args.kernel,
        "gradient": derivatives > 1,
        "hessian": derivatives > 4,
        "ranks": ranks.size(),
        "threads": rayon::current_num_threads(),
        "tolerance": args.tolerance,
        "plan_s": slowest(0),
        "apply_s": slowest(1),
        "relative_l2_error": errors[0],
        "gradient_relative_l2_error": (derivatives > 1).then_some(errors[1]),
        "hessian_relative_l2_error": (derivatives > 4).then_some(errors[2]),
        "sampled_targets": sampled,
        "messages_sent": of_all(0),
        "words_sent": of_all(1),
        "most_words_sent_by_a_rank": sent.iter().map(|sent| sent[1]).max(),
    }))
}
