//! Measures what accuracy costs, whether it is delivered, and how many terms it needs.
//!
//! ```text
//! cargo run --release -p farfield-benches --example accuracy_speed -- --out benches/charts
//! cargo run --release -p farfield-benches --example accuracy_speed -- --charts speed --points 1e5 --kernels 1/r
//! cargo run --release -p farfield-benches --example accuracy_speed -- --charts contract,terms
//! ```
//!
//! * `speed`: error against time per point, for kernels × expansions × precisions, with treecodes and
//!   direct sums beside them.
//! * `contract`: the error asked for against the error delivered.
//! * `terms`: the terms of a cell against its error, above the least that any method could need.
//!
//! Each writes a CSV file, which `benches/draw.py` turns into charts, and a short table as text. The exit
//! code is 1 if a sum missed what was asked of it.

mod args;
mod case;
mod contract;
mod far_field;
mod output;
mod placed;
mod problem;
mod speed;
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

/// Measures for all charts that were asked for; returns how many sums missed what was asked of them.
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
    println!("\nfiles in {}; benches/draw.py makes the charts", args.out.display());
    Ok(missed)
}
