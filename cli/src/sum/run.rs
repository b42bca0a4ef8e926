//! From files to files: reads, sums, measures the error, writes.

use std::io::{self, Write};
use std::path::Path;
use std::time::Instant;

use farfield::{
    Builder, Expansion, Fmm, Interpolation, Kernel, OperatorStore, Point, Real, Unmasked, Vector,
    direct, relative_l2_error,
};
use farfield_potentials::{
    Exponent, HarmonicExpansion, MinusFour, MinusOne, MinusTwo, Output, PlusTwo, Potential,
    PotentialGradient, PowerLaw, WithGradient,
};
use farfield_scenes::{is_same_file, write_file};

use super::args::{self, Args, Precision, Scheme};
use super::error::Failure;
use super::progress::shown;
use super::read;
use super::report::Report;
use super::text;
use super::write::{self, Number, WriteError};
use crate::memory::peak_memory_bytes;

/// The tolerance if neither that nor an order is asked for.
pub(super) const TOLERANCE: f64 = 1e-6;

/// The rule from tolerance to the order of harmonics speaks of charges of one sign. Where their signs are random and no
/// near field hides the error of the far field (two unit cubes, 1/4 apart), up to a digit is lost.
const MARGIN: f64 = 0.1;

/// Does what the command line asks for.
pub(crate) fn run(args: &Args) -> Result<(), Failure> {
    if let Some(path) = &args.out {
        write::check_values_path(path)?;
    }
    if let Some(path) = &args.report {
        write::check_folder(path)?;
        if args.out.as_ref().is_some_and(|out| is_same_file(out, path)) {
            return Err(Failure::SameFile(path.clone()));
        }
    }
    if let Some(count) = args.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(count);
        pool.build_global().map_err(|source| Failure::Threads { count, source })?;
    }
    let store = OperatorStore::of_process();
    if let Some(folder) = &args.operators {
        // Makes the folder, or says at once that it can't be made.
        store.save(folder)?;
        store.load(folder)?;
    }
    match args.precision {
        Precision::F32 => with_precision::<f32>(args),
        Precision::F64 => with_precision::<f64>(args),
    }?;
    if let Some(folder) = &args.operators {
        store.save(folder)?;
    }
    Ok(())
}

/// What is read from the files, in the precision asked for.
pub(super) struct Input<T: Real> {
    pub(super) sources: Vec<Point<T>>,
    pub(super) charges: Vec<T>,
    pub(super) targets: Vec<Point<T>>,
}

impl<T: Real> Input<T> {
    /// Points, and charges of so many numbers each.
    pub(super) fn read(args: &Args, numbers: usize) -> Result<Self, Failure> {
        let sources = read::points::<T>(&args.points)?;
        let charges = read::charges(&args.charges, numbers)?;
        if charges.len() != numbers * sources.len() {
            return Err(Failure::Lengths {
                charges: args.charges.clone(),
                found: charges.len() / numbers,
                points: args.points.clone(),
                expected: sources.len(),
            });
        }
        let targets = match &args.targets {
            Some(path) => read::points::<T>(path)?,
            None => sources.clone(),
        };
        Ok(Self { sources, charges, targets })
    }
}

fn with_precision<T: Number>(args: &Args) -> Result<(), Failure> {
    let Some(power_law) = args.power_law() else { return text::run::<T>(args) };
    text::refuse_flags(args)?;
    let input = Input::<T>::read(args, 1)?;
    match power_law {
        args::Kernel::InverseDistance => with_kernel::<MinusOne, T>(args, &input),
        args::Kernel::InverseSquare => with_kernel::<MinusTwo, T>(args, &input),
        args::Kernel::InverseFourth => with_kernel::<MinusFour, T>(args, &input),
        args::Kernel::SquaredDistance => with_kernel::<PlusTwo, T>(args, &input),
    }
}

fn with_kernel<E: Exponent, T: Number>(args: &Args, input: &Input<T>) -> Result<(), Failure> {
    if args.gradient {
        sum::<E, T, WithGradient>(args, input)
    } else {
        sum::<E, T, Potential>(args, input)
    }
}

fn sum<E, T, O>(args: &Args, input: &Input<T>) -> Result<(), Failure>
where
    E: Exponent,
    T: Number,
    O: Output<T, T, Value: Row<T>> + Output<f64, f64, Value: Row<f64>>,
{
    let start = Instant::now();
    let kernel = PowerLaw::<E, T, T, O>::default();
    match args.expansion() {
        args::Expansion::Interpolation => {
            let fmm = shown(&args.watch, || interpolated(args, kernel, input))?;
            let order = fmm.expansion().nodes_per_axis();
            finish::<E, T, O, _>(args, input, &fmm, order, start)
        }
        args::Expansion::Harmonic => {
            let order = order::<E, O>(args)?;
            let builder = Fmm::with_expansion(HarmonicExpansion::new(kernel, order)?);
            let build = || planned(args, builder).build(&input.sources, &input.targets);
            let fmm = shown(&args.watch, build)?;
            finish::<E, T, O, _>(args, input, &fmm, order, start)
        }
    }
}

/// A plan that interpolates: with the nodes asked for, or as few as the tolerance takes.
fn interpolated<K, T>(
    args: &Args,
    kernel: K,
    input: &Input<T>,
) -> Result<Fmm<Interpolation<K>>, farfield::Error>
where
    K: Kernel<Target = Point<T>, Source = Point<T>> + Clone,
    T: Real,
{
    let build = |expansion: Interpolation<K>| {
        let builder = Fmm::with_expansion(expansion);
        planned(args, builder).build(&input.sources, &input.targets)
    };
    if let Some(order) = args.order.filter(|_| !is_finite(args)) {
        return build(Interpolation::new(kernel).order(order));
    }
    let within = |tolerance| build(Interpolation::new(kernel.clone()).tolerance(tolerance));
    match within(args.tolerance.unwrap_or(TOLERANCE)) {
        // As near as it gets; this, too, may be enough. Errors seen differ a little between plans.
        Err(farfield::Error::UnreachableTolerance { reachable, .. }) => within(2.0 * reachable),
        plan => plan,
    }
}

/// A builder with the scheme and the leaves that the command line asks for.
fn planned<'a, E: Expansion>(
    args: &Args,
    builder: Builder<'a, E, Unmasked>,
) -> Builder<'a, E, Unmasked> {
    let builder = builder.watch(&args.watch);
    let builder = match args.scheme {
        Scheme::Auto => builder,
        Scheme::Fmm => builder.scheme(farfield::Scheme::Fmm),
        Scheme::Treecode => builder.scheme(farfield::Scheme::Treecode { m2m: true }),
        Scheme::Direct => builder.scheme(farfield::Scheme::Direct),
    };
    match args.leaf_size {
        Some(leaf_size) => builder.leaf_size(leaf_size),
        None => builder,
    }
}

/// Sums by a plan that was begun at `start`, measures the error, and writes everything.
fn finish<E, T, O, X>(
    args: &Args,
    input: &Input<T>,
    fmm: &Fmm<X>,
    order: usize,
    start: Instant,
) -> Result<(), Failure>
where
    E: Exponent,
    T: Number,
    O: Output<T, T, Value: Row<T>> + Output<f64, f64, Value: Row<f64>>,
    X: Expansion<Kernel = PowerLaw<E, T, T, O>>,
{
    let plan_s = start.elapsed().as_secs_f64();
    let apply = || fmm.apply_watched(&input.charges, &args.watch);
    let (values, apply_s) = shown(&args.watch, || repeated(args.repeat, apply))?;
    let peak_memory_bytes = peak_memory_bytes();
    let errors = Errors::measure::<E, T, O>(input, &values)?;
    let stats = fmm.report().stats;
    let report = Report {
        points: input.sources.len(),
        targets: input.targets.len(),
        kernel: args.kernel.clone(),
        gradient: args.gradient,
        hessian: false,
        scheme: stats.scheme.to_string(),
        precision: args::name(args.precision),
        threads: rayon::current_num_threads(),
        tolerance: args.order.is_none().then(|| args.tolerance.unwrap_or(TOLERANCE)),
        expansion: args::name(args.expansion()),
        order: Some(order),
        plan_s,
        apply_s,
        repeat: args.repeat,
        relative_l2_error: errors.potential,
        gradient_relative_l2_error: args.gradient.then_some(errors.gradient),
        hessian_relative_l2_error: None,
        sampled_targets: errors.sampled,
        terms_per_cell: stats.terms_per_cell,
        cells: stats.cells,
        depth: stats.depth,
        leaf_size: stats.leaf_size,
        peak_memory_bytes,
    };
    let columns = write::columns(1, args.derivatives());
    let row = |value: &<O as Output<T, T>>::Value| {
        let (u, [x, y, z]) = Row::<T>::parts(value);
        [u, x, y, z].into_iter().take(columns.len())
    };
    publish(args, &report, &values.iter().flat_map(row).collect::<Vec<_>>(), &columns)
}

/// The order of harmonics that is asked for, or one that is enough for the tolerance in double
/// precision; whether a lower precision spoils it is left to the measurement.
fn order<E: Exponent, O: Output<f64, f64>>(args: &Args) -> Result<usize, farfield::Error> {
    let enough_for = |tolerance| {
        let kernel = PowerLaw::<E, f64, f64, O>::default();
        HarmonicExpansion::with_tolerance(kernel, tolerance).map(|expansion| expansion.order())
    };
    match args.order {
        Some(order) if !is_finite(args) => Ok(order),
        _ => match enough_for(MARGIN * args.tolerance.unwrap_or(TOLERANCE)) {
            // As near as it gets; this, too, may be enough.
            Err(farfield::Error::UnreachableTolerance { reachable, .. }) => enough_for(reachable),
            order => order,
        },
    }
}

/// Whether expansions of the kernel are finite, so that no order needs to be chosen.
fn is_finite(args: &Args) -> bool {
    args.power_law() == Some(args::Kernel::SquaredDistance)
}

/// The sums, and the median time of `repeat` runs in seconds.
pub(super) fn repeated<V>(
    repeat: usize,
    apply: impl Fn() -> Result<Vec<V>, farfield::Error>,
) -> Result<(Vec<V>, f64), farfield::Error> {
    let mut values = Vec::new();
    let mut seconds = Vec::with_capacity(repeat);
    for _ in 0..repeat {
        let start = Instant::now();
        values = apply()?;
        seconds.push(start.elapsed().as_secs_f64());
    }
    seconds.sort_by(f64::total_cmp);
    let median = 0.5 * (seconds[(repeat - 1) / 2] + seconds[repeat / 2]);
    Ok((values, median))
}

/// Relative l2 errors at the sampled targets.
pub(super) struct Errors {
    potential: f64,
    gradient: f64,
    sampled: usize,
}

impl Errors {
    /// Most targets that are compared.
    pub(super) const SAMPLES: usize = 1000;

    /// Compares evenly spaced targets with direct sums in double precision, so that the rounding of
    /// a lower precision counts as error too.
    fn measure<E, T, O>(
        input: &Input<T>,
        values: &[<O as Output<T, T>>::Value],
    ) -> Result<Self, farfield::Error>
    where
        E: Exponent,
        T: Real,
        O: Output<T, T, Value: Row<T>> + Output<f64, f64, Value: Row<f64>>,
    {
        let count = input.targets.len();
        let sampled = count.min(Self::SAMPLES);
        let sample: Vec<_> = (0..sampled).map(|i| i * count / sampled).collect();
        let double = |p: &Point<T>| Point::<f64>::from_array(p.to_array().map(|c| c.as_f64()));
        let sources: Vec<_> = input.sources.iter().map(double).collect();
        let charges: Vec<_> = input.charges.iter().map(|q| q.as_f64()).collect();
        let targets: Vec<_> = sample.iter().map(|&i| double(&input.targets[i])).collect();
        let exact = direct(&PowerLaw::<E, f64, f64, O>::default(), &sources, &charges, &targets)?;

        let (mut found_u, mut exact_u) = (Vec::new(), Vec::new());
        let (mut found_du, mut exact_du) = (Vec::new(), Vec::new());
        for (&i, exact) in sample.iter().zip(&exact) {
            let (u, du) = values[i].parts();
            found_u.push(u.as_f64());
            found_du.push(du.map(Real::as_f64));
            let (u, du) = exact.parts();
            exact_u.push(u);
            exact_du.push(du);
        }
        Ok(Self {
            potential: relative_l2_error(&found_u, &exact_u),
            gradient: relative_l2_error(&found_du, &exact_du),
            sampled,
        })
    }
}

/// Writes the report and, if the tolerance is kept, the values.
pub(super) fn publish<T: Number>(
    args: &Args,
    report: &Report,
    values: &[T],
    columns: &[String],
) -> Result<(), Failure> {
    // There is something to keep from now on.
    args.interrupt.hold(true);
    match &args.report {
        Some(path) => write_report(path, report)?,
        None => print!("{report}"),
    }
    if let Some(expected) = report.tolerance.filter(|_| report.misses_tolerance()) {
        return Err(Failure::Inaccurate { found: report.error(), expected });
    }
    if let Some(path) = &args.out {
        write::values(path, values, columns)?;
    }
    Ok(())
}

fn write_report(path: &Path, report: &Report) -> Result<(), WriteError> {
    Ok(write_file(path, |file| {
        serde_json::to_writer_pretty(&mut *file, report).map_err(io::Error::other)?;
        writeln!(file)
    })?)
}

/// What a target receives, taken apart.
trait Row<T> {
    /// Its potential and its gradient; zero if there is none.
    fn parts(&self) -> (T, [T; 3]);
}

impl<T: Real> Row<T> for T {
    fn parts(&self) -> (T, [T; 3]) {
        (*self, [T::from_f64(0.0); 3])
    }
}

impl<T: Real> Row<T> for PotentialGradient<T> {
    fn parts(&self) -> (T, [T; 3]) {
        (self.potential, self.gradient)
    }
}
