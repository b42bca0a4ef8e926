//! The command line.

use std::path::PathBuf;

use clap::{Parser, Subcommand};
use farfield_formula::{Coincident, Derivatives};

/// Sums over points on many machines: start it by `mpirun -n 4 farfield-mpi …`.
#[derive(Clone, Debug, Parser)]
#[command(name = "farfield-mpi", version)]
pub(super) struct Program {
    #[command(subcommand)]
    pub(super) command: Command,
}

#[derive(Clone, Debug, Subcommand)]
pub(super) enum Command {
    /// Sums u(x_i) = Σ_j K(x_i, y_j) q_j over points from files, and measures its own error
    Sum(Args),
}

/// Sums u(x_i) = Σ_j K(x_i, y_j) q_j over points from files, and measures its own error.
///
/// Files are `.npy` of `<f4` or `<f8`, which all ranks can open: N×3 for points, N for charges, or N rows where the kernel takes several from
/// each source. Each rank reads its part of the rows, and writes its part of the result, which has the same bits for any
/// number of ranks and threads. It appears complete or not at all.
///
/// The error is measured against direct sums at 1,000 targets spaced evenly through the target file. If it exceeds
/// --tolerance, no values are written, and the exit code is 1, as it is for bad input; a bad command line gives 2.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct Args {
    /// Where the charges sit: N×3
    #[arg(long, value_name = "FILE")]
    pub(super) points: PathBuf,

    /// What they carry: N numbers
    #[arg(long, value_name = "FILE")]
    pub(super) charges: PathBuf,

    /// Where values are asked for: M×3 [default: the points themselves]
    #[arg(long, value_name = "FILE")]
    pub(super) targets: Option<PathBuf>,

    /// What is summed: a name that `farfield kernels` lists, or a formula such as "exp(-k*r)/r"
    #[arg(long, value_name = "NAME|TEXT", allow_hyphen_values = true)]
    pub(super) kernel: String,

    /// A parameter of the kernel, such as k=2; may be given several times
    #[arg(long, value_name = "NAME=VALUE", value_parser = param)]
    pub(super) param: Vec<(String, f64)>,

    /// What holds for a formula where points are at one place: skip, formula (what it gives there), or a
    /// number [default: skip; what it is known for, for a kernel by name]
    #[arg(long, value_name = "RULE", allow_hyphen_values = true)]
    pub(super) coincident: Option<Coincident>,

    /// Sum the gradient with respect to x as well
    #[arg(long)]
    pub(super) gradient: bool,

    /// Sum the gradient and the six second derivatives with respect to x as well
    #[arg(long)]
    pub(super) hessian: bool,

    /// Largest relative l2 error wanted
    #[arg(long, value_name = "E", default_value_t = 1e-6, value_parser = tolerance)]
    pub(super) tolerance: f64,

    /// Most points in a leaf of the octree [default: what takes least time]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(super) leaf_size: Option<u32>,

    /// Threads of each rank [default: one per core, which is too many for several ranks on one machine]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=512))]
    pub(super) threads: Option<u16>,

    /// Where to write the values, an .npy file: M numbers, or M rows where there are more for each target
    #[arg(long, value_name = "FILE")]
    pub(super) out: Option<PathBuf>,

    /// Where to write sizes, times, errors and what ranks sent each other, as JSON [default: on standard output]
    #[arg(long, value_name = "FILE")]
    pub(super) report: Option<PathBuf>,
}

impl Args {
    /// What is summed beside values.
    pub(super) fn derivatives(&self) -> Derivatives {
        match (self.hessian, self.gradient) {
            (true, _) => Derivatives::Hessian,
            (false, true) => Derivatives::Gradient,
            (false, false) => Derivatives::None,
        }
    }
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
