//! The command line.

use std::path::PathBuf;

use clap::{Parser, ValueEnum};
use farfield_benches::cli::{Precision, count, threads, tolerance};
use farfield_benches::clouds::Cloud;

use crate::case::KernelName;

/// Measures what accuracy costs, whether it is delivered, and how many terms it needs.
///
/// Errors are relative in the l2 norm against direct sums in double precision. Times are medians. An
/// error above what was asked for is counted as missed.
#[derive(Debug, Parser)]
#[command(name = "accuracy_speed")]
pub(crate) struct Args {
    /// What is measured
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_enum)]
    #[arg(default_value = "speed,contract,terms")]
    pub(crate) charts: Vec<ChartName>,

    /// Numbers of points [default: 1e5 and 1e6 for speed, 1e4 for contract]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = count)]
    points: Option<Vec<usize>>,

    /// Where the points lie [default: cube and sphere for speed, all for contract]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_enum)]
    clouds: Option<Vec<Cloud>>,

    /// What is summed [default: six kernels for speed, all for contract]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_enum)]
    kernels: Option<Vec<KernelName>>,

    /// Errors asked for [default: 1e-1 to 1e-13 for speed, 1e-2 to 1e-11 for contract]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = tolerance)]
    tolerances: Option<Vec<f64>>,

    /// Precisions of speed; contract is about f64
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_enum, default_value = "f64,f32")]
    pub(crate) precision: Vec<Precision>,

    /// Threads [default: one per core]
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,

    /// Applications per row of speed, of which the median counts
    #[arg(long, value_name = "R", default_value = "3", value_parser = count)]
    pub(crate) repeats: usize,

    /// Seconds of a plan and a sum after which no smaller error is asked for in the same way
    #[arg(long, value_name = "S", default_value = "60")]
    pub(crate) limit: f64,

    /// Folder for the files
    #[arg(long, value_name = "DIR", default_value = "target/accuracy_speed")]
    pub(crate) out: PathBuf,
}

/// What is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ChartName {
    /// Error against time per point
    Speed,
    /// Error asked for against error delivered
    Contract,
    /// Terms of a cell against its error
    Terms,
}

/// A list that was asked for, or the one that is meant otherwise.
fn listed<T: Clone>(asked: &Option<Vec<T>>, default: &[T]) -> Vec<T> {
    asked.clone().unwrap_or_else(|| default.to_vec())
}

impl Args {
    /// Numbers of points.
    pub(crate) fn points(&self, default: &[usize]) -> Vec<usize> {
        listed(&self.points, default)
    }

    /// Where they lie.
    pub(crate) fn clouds(&self, default: &[Cloud]) -> Vec<Cloud> {
        listed(&self.clouds, default)
    }

    /// What is summed.
    pub(crate) fn kernels(&self, default: &[KernelName]) -> Vec<KernelName> {
        listed(&self.kernels, default)
    }

    /// Errors asked for, the largest first; 10^−1 and so on for the powers in `default`.
    pub(crate) fn tolerances(&self, default: std::ops::RangeInclusive<i32>) -> Vec<f64> {
        let powers: Vec<f64> = default.map(|power| 10f64.powi(-power)).collect();
        let mut tolerances = listed(&self.tolerances, &powers);
        tolerances.sort_by(|a, b| b.total_cmp(a));
        tolerances
    }
}
