//! The command line.

use std::num::NonZero;
use std::path::PathBuf;
use std::thread::available_parallelism;

use clap::{Parser, ValueEnum};
use farfield_benches::cli::{Precision, count, threads, tolerance};
use farfield_benches::clouds::Cloud;

/// Measures how plans and applications scale with the number of points.
///
/// Errors are relative in the l2 norm against direct sums in double precision at 1,000 targets. They
/// are measured before any time is; a row that misses its tolerance says FAILED, has no times, and
/// makes the exit code 1.
#[derive(Debug, Parser)]
#[command(name = "scaling")]
pub(crate) struct Args {
    /// Numbers of points
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = count)]
    #[arg(default_value = "1e4,1e5,1e6")]
    pub(crate) points: Vec<usize>,

    /// Where the points lie
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_enum)]
    #[arg(default_value = "cube,sphere,plummer")]
    pub(crate) clouds: Vec<Cloud>,

    /// Errors asked for
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = tolerance)]
    #[arg(default_value = "1e-3,1e-6,1e-9")]
    pub(crate) tolerances: Vec<f64>,

    /// Numbers of threads [default: 1 and one per core]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = threads)]
    threads: Option<Vec<usize>>,

    /// Precisions; kernels given by formulas are measured in f64 alone
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_enum, default_value = "f64")]
    pub(crate) precision: Vec<Precision>,

    /// What is summed
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_enum)]
    #[arg(default_value = "1/r")]
    pub(crate) kernels: Vec<KernelName>,

    /// Sum the gradient too; 1/r and 1/r4 only
    #[arg(long)]
    pub(crate) gradient: bool,

    /// Applications per row, of which the median counts
    #[arg(long, value_name = "R", default_value = "5", value_parser = count)]
    pub(crate) repeats: usize,

    /// Folder for scaling.csv
    #[arg(long, value_name = "DIR", default_value = "target/scaling")]
    pub(crate) out: PathBuf,
}

/// A kernel; r = |x − y|, and h is half the longest side of the cloud's bounding box.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum KernelName {
    /// 1/r
    #[value(name = "1/r")]
    InverseDistance,
    /// 1/r⁴
    #[value(name = "1/r4")]
    InverseFourth,
    /// exp(−r/h)/r
    Yukawa,
    /// exp(−(r/h)²)
    Gaussian,
    /// log(r/h)
    Log,
    /// (r/h)³
    R3,
    /// exp(ikr)/r with kh = 3
    Helmholtz,
    /// 1/√((x − y)ᵀ M (x − y)), M full: stretched along axes that are not the tree's
    Anisotropic,
}

impl Args {
    /// The numbers of threads to measure with, each once.
    pub(crate) fn threads(&self) -> Vec<usize> {
        let all = available_parallelism().map_or(1, NonZero::get);
        let mut threads = self.threads.clone().unwrap_or_else(|| vec![1, all]);
        threads.dedup();
        threads
    }
}
