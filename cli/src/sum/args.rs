//! The command line: its flags, their ranges and their explanations.

use std::path::PathBuf;
use std::sync::Arc;

use clap::{Parser, ValueEnum};
use farfield::Watch;
use farfield_formula::{Coincident, Derivatives};

use crate::interrupt::Interrupt;

/// Sums u(x_i) = Σ_j K(x_i, y_j) q_j over points from files, and measures its own error.
///
/// Point files hold N rows of x, y, z; charge files hold N numbers, or N rows where the kernel takes several from each
/// source. Both are either `.npy`
/// (`<f4` or `<f8`, shapes N×3 and N) or `.csv` (three columns and one, a header line optional).
/// An empty set is an array of shape 0×3, or a CSV file with nothing but its header.
/// A power law never acts between points at the same position; see --coincident for others.
///
/// The error is always measured, against direct sums in double precision at 1,000 targets spaced
/// evenly through the target file. If it exceeds --tolerance, the report is still written, the
/// values are not, and the exit code is 1, as it is for bad input; a bad command line gives 2, and Ctrl-C 130.
#[derive(Clone, Debug, Parser)]
#[command(name = "sum")]
pub(crate) struct Args {
    /// Where the charges sit: N×3
    #[arg(long, value_name = "FILE")]
    pub(crate) points: PathBuf,

    /// What they carry: N numbers
    #[arg(long, value_name = "FILE")]
    pub(crate) charges: PathBuf,

    /// Where values are asked for: M×3 [default: the points themselves]
    #[arg(long, value_name = "FILE")]
    pub(crate) targets: Option<PathBuf>,

    /// What is summed: inverse-distance, inverse-square, inverse-fourth, squared-distance, a name that
    /// `farfield kernels` lists, or a formula such as "exp(-k*r)/r"
    #[arg(long, value_name = "NAME|TEXT", allow_hyphen_values = true)]
    pub(crate) kernel: String,

    /// A parameter of the kernel, such as k=2; may be given several times
    #[arg(long, value_name = "NAME=VALUE", value_parser = param)]
    pub(crate) param: Vec<(String, f64)>,

    /// What holds for a formula where points are at one place: skip, formula (what it gives there), or a
    /// number [default: skip; what it is known for, for a kernel by name]
    #[arg(long, value_name = "RULE", allow_hyphen_values = true)]
    pub(crate) coincident: Option<Coincident>,

    /// Sum the gradient with respect to x as well
    #[arg(long)]
    pub(crate) gradient: bool,

    /// Sum the gradient and the six second derivatives with respect to x as well; not for power laws by their names here
    #[arg(long)]
    pub(crate) hessian: bool,

    /// How the far field is expanded [default: interpolation, the faster one; harmonic with --gradient,
    /// because gradients of interpolations can miss the tolerance]
    #[arg(long, value_enum)]
    pub(crate) expansion: Option<Expansion>,

    /// Order of the expansion: of the harmonics, or nodes per axis of the interpolation. For those who
    /// want to choose it themselves; nothing is then promised about the error, only measured
    #[arg(long, value_name = "P", conflicts_with = "tolerance")]
    pub(crate) order: Option<usize>,

    /// Largest relative l2 error wanted, of the potential and, with --gradient, of the gradient.
    /// Interpolation takes just what this asks for; for harmonics it becomes an order by a simple rule,
    /// linear in the digits and fitted to measured errors, with one digit to spare [default: 1e-6]
    #[arg(long, value_name = "E", value_parser = tolerance)]
    pub(crate) tolerance: Option<f64>,

    /// Precision of the arithmetic and of an .npy result; single precision rounds at about 1e-6
    #[arg(long, value_enum, default_value_t = Precision::F64)]
    pub(crate) precision: Precision,

    /// How to sum
    #[arg(long, value_enum, default_value_t = Scheme::Auto)]
    pub(crate) scheme: Scheme,

    /// Most points in a leaf of the octree [default: the expansion's choice]
    #[arg(long, value_name = "N", value_parser = at_least_one)]
    pub(crate) leaf_size: Option<usize>,

    /// Threads to compute with, at most 512; the result does not depend on it [default: one per core]
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,

    /// How often to sum; the time reported is the median
    #[arg(long, value_name = "R", default_value = "1", value_parser = at_least_one)]
    pub(crate) repeat: usize,

    /// Where to write the values: .npy or .csv, M numbers, or M×4 (potential, gradient) with
    /// --gradient, M×10 with --hessian (then along xx, xy, xz, yy, yz, zz). The file appears complete or not at all
    #[arg(long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,

    /// Where to write sizes, times and errors, as JSON [default: a summary on standard output]
    #[arg(long, value_name = "FILE")]
    pub(crate) report: Option<PathBuf>,

    /// Folder of operators for kernels met before: they are read from it, and new ones are added to it, so that the next
    /// run with the same kernel and tolerance has little to prepare. It is made if need be
    #[arg(long, value_name = "FOLDER")]
    pub(crate) operators: Option<PathBuf>,

    /// What ends the run on Ctrl-C.
    #[arg(skip)]
    pub(crate) interrupt: Arc<Interrupt>,

    /// What knows how far the sums are.
    #[arg(skip)]
    pub(crate) watch: Watch,
}

/// Power laws of r = |x − y| with a harmonic expansion, which have flags of their own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Kernel {
    /// 1/r
    InverseDistance,
    /// 1/r²
    InverseSquare,
    /// 1/r⁴
    InverseFourth,
    /// r², whose expansions are finite and exact: the order is irrelevant
    SquaredDistance,
}

/// A far-field expansion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Expansion {
    /// Chebyshev interpolation of the kernel
    Interpolation,
    /// Spherical harmonics of the power law
    Harmonic,
}

/// A floating-point precision.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Precision {
    /// Single
    F32,
    /// Double
    F64,
}

/// A way to sum.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Scheme {
    /// Whichever is expected to be fastest; with --leaf-size, fmm
    Auto,
    /// Fast multipole method: cells act on cells, O(N)
    Fmm,
    /// Treecode: cells act on points, O(N log N)
    Treecode,
    /// All pairs, O(N²)
    Direct,
}

impl Args {
    /// The power law asked for, if it is one.
    pub(crate) fn power_law(&self) -> Option<Kernel> {
        Kernel::from_str(&self.kernel, false).ok()
    }

    /// What is summed beside values.
    pub(crate) fn derivatives(&self) -> Derivatives {
        match (self.hessian, self.gradient) {
            (true, _) => Derivatives::Hessian,
            (false, true) => Derivatives::Gradient,
            (false, false) => Derivatives::None,
        }
    }

    /// The expansion asked for, or the one that meets the tolerance.
    pub(crate) fn expansion(&self) -> Expansion {
        let usual = if self.gradient { Expansion::Harmonic } else { Expansion::Interpolation };
        self.expansion.unwrap_or(usual)
    }
}

/// The name that a value of one of the enums above has on the command line.
pub(crate) fn name(value: impl ValueEnum) -> String {
    value.to_possible_value().map_or_else(String::new, |v| v.get_name().to_owned())
}

/// A usage error on one line: clap's own message without the usage that follows it.
pub(crate) fn one_line(error: &clap::Error) -> String {
    let text = error.to_string();
    let message = text.split("\n\n").next().unwrap_or_default();
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn tolerance(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(tolerance) if 0.0 < tolerance && tolerance < 1.0 => Ok(tolerance),
        _ => Err("expected a number between 0 and 1, both excluded".into()),
    }
}

fn param(text: &str) -> Result<(String, f64), String> {
    let value = |text: &str| text.trim().parse().ok();
    match text.split_once('=').and_then(|(name, text)| Some((name, value(text)?))) {
        Some((name, value)) => Ok((name.trim().to_owned(), value)),
        None => Err("expected a name and a number, such as k=2".into()),
    }
}

fn threads(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count @ 1..=512) => Ok(count),
        _ => Err("expected a whole number from 1 to 512".into()),
    }
}

fn at_least_one(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count) if count >= 1 => Ok(count),
        _ => Err("expected a whole number of at least 1".into()),
    }
}
