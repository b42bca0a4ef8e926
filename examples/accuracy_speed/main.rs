//! What accuracy costs, whether it is delivered, and how many terms it needs: charts, tables and files.
//!
//! ```text
//! cargo run --release -p farfield-benches --example accuracy_speed -- --out benches/charts
//! cargo run --release -p farfield-benches --example accuracy_speed -- --charts speed --points 1e5 --kernels 1/r
//! cargo run --release -p farfield-benches --example accuracy_speed -- --charts contract,terms
//! ```
//!
//! * `speed`: error against time per point, for kernels × expansions × precisions, with treecodes and
//!   direct sums beside them, and rivals if `benches/peers/run.sh` has left its file.
//! * `contract`: the error asked for against the error delivered.
//! * `terms`: the terms of a cell against its error, above the least that any method could need.
//!
//! Each writes a CSV file, a short table as text, and charts as SVG, and as PNG if `rsvg-convert` is
//! installed. The exit code is 1 if a sum missed what was asked of it.

mod args;
mod case;
#[path = "../scaling/chart.rs"]
mod chart;
#[path = "../scaling/cli.rs"]
mod cli;
#[path = "../scaling/clouds.rs"]
mod clouds;
mod contract;
mod far_field;
mod output;
mod placed;
mod problem;
#[path = "../scaling/remembered.rs"]
mod remembered;
mod rivals;
mod speed;
mod speed_chart;
mod speed_row;
mod terms;

use std::error::Error;
use std::process::ExitCode;

use clap::Parser;
use rayon::ThreadPoolBuilder;

use args::{Args, ChartName};
use output::Output;

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(0) => ExitCode::SUCCESS,
        Ok(missed) => {
            eprintln!("{missed} sums missed the error that was asked for");
            ExitCode::FAILURE
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Makes all charts; returns how many sums missed what was asked of them.
fn run(args: &Args) -> Result<usize, Box<dyn Error>> {
    // Zero stands for one per core.
    ThreadPoolBuilder::new().num_threads(args.threads.unwrap_or(0)).build_global()?;
    let output = Output::new(&args.out)?;
    let mut missed = 0;
    for chart in &args.charts {
        match chart {
            ChartName::Speed => missed += speed::run(args, &output)?,
            ChartName::Contract => missed += contract::run(args, &output)?,
            ChartName::Terms => terms::run(&output)?,
        }
    }
    output.close();
    Ok(missed)
}
