//! The command line.

use std::num::NonZero;
use std::path::PathBuf;
use std::thread::available_parallelism;

use clap::Parser;
use farfield_benches::cli::count;
use farfield_benches::clouds::Cloud;

/// Sums 1/r by farfield, ferreus_bbfmm and fmm3dpy: same points, charges and threads, equal error.
#[derive(Debug, Parser)]
#[command(name = "peers")]
pub(crate) struct Args {
    /// Numbers of points
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = count)]
    #[arg(default_value = "1e5,1e6")]
    pub(crate) points: Vec<usize>,

    /// Where the points lie
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_enum)]
    #[arg(default_value = "cube,sphere,plummer")]
    pub(crate) clouds: Vec<Cloud>,

    /// Relative l2 errors that everyone has to keep
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "1e-3,1e-6,1e-9")]
    pub(crate) tolerances: Vec<f64>,

    /// Threads for everyone [default: one per core]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,

    /// Sums of which the median counts
    #[arg(long, value_name = "R", default_value = "3", value_parser = count)]
    pub(crate) repeats: usize,

    /// Seconds that a rival may take for one row, the search for its accuracy included
    #[arg(long, value_name = "S", default_value = "400")]
    pub(crate) limit: f64,

    /// Rivals that are left out: ferreus, fmm3dpy
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub(crate) without: Vec<String>,

    /// Where peers.csv and the data for the rivals go
    #[arg(long, value_name = "DIR", default_value = "target/peers")]
    pub(crate) out: PathBuf,
}

impl Args {
    /// How many threads everyone computes with.
    pub(crate) fn threads(&self) -> usize {
        self.threads.unwrap_or_else(|| available_parallelism().map_or(1, NonZero::get)).max(1)
    }
}
