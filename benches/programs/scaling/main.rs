//! Measures how the times of plans and applications grow with the number of points, and how close they
//! come to what the machine can do.
//!
//! ```text
//! cargo run --release -p farfield-benches --example scaling
//! cargo run --release -p farfield-benches --example scaling -- --points 1e5 --clouds sphere --threads 2 --gradient
//! cargo run --release -p farfield-benches --example scaling -- --kernels 1/r,yukawa,helmholtz,anisotropic
//! ```
//!
//! The table goes to standard output, and `scaling.csv` to the folder `--out`, where `benches/draw.py`
//! turns it into a chart for each kernel, precision and number of threads. Points and charges are the same
//! in every run.

mod args;
mod kernels;
mod limits;
mod measure;
mod row;
mod series;

use std::error::Error;
use std::fs;
use std::process::ExitCode;

use clap::Parser;
use farfield_benches::cli::{Precision, name};
use farfield_benches::clouds;
use farfield_testing::clouds::half_width;
use glam::DVec3;

use args::{Args, KernelName};
use kernels::with_kernel;
use limits::Limits;
use measure::{Measurement, pool, rounded};
use row::{LEGEND, Outcome, Setting, heading, line};

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(rows) if rows.iter().any(|(_, o)| matches!(o, Outcome::Failed(_))) => ExitCode::FAILURE,
        Ok(_) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> Result<Vec<(Setting, Outcome)>, Box<dyn Error>> {
    fs::create_dir_all(&args.out).map_err(|error| format!("{}: {error}", args.out.display()))?;
    let (limits, cases) = limits(args);
    println!("\n{LEGEND}");
    let pools = args.threads().into_iter().map(pool).collect::<Result<Vec<_>, _>>()?;
    let mut rows = Vec::new();
    for &(kernel, precision) in &cases {
        let gradient = if args.gradient { " and its gradient" } else { "" };
        println!("\n{}{gradient}, {}\n{}", name(kernel), name(precision), heading());
        for &cloud in &args.clouds {
            for &n in &args.points {
                let round = |p: DVec3| p.map(|x| rounded(x, precision));
                let points: Vec<_> = clouds::cloud(cloud, n).into_iter().map(round).collect();
                let h = half_width(&points);
                let mut measurement = Measurement {
                    setting: Setting { n, cloud, kernel, precision, tolerance: 0.0, threads: 0 },
                    points: &points,
                    args,
                    pools: &pools,
                    limits: &limits,
                    report: &mut |setting, outcome| {
                        println!("{}", line(&setting, &outcome));
                        rows.push((setting, outcome));
                    },
                };
                with_kernel(kernel, precision, args.gradient, h, &mut measurement);
            }
        }
    }
    println!();
    series::exponents(&rows).iter().for_each(|line| println!("{line}"));
    let path = args.out.join("scaling.csv");
    fs::write(&path, row::csv(&rows)).map_err(|error| format!("{}: {error}", path.display()))?;
    println!("wrote {}", path.display());
    Ok(rows)
}

/// Measures and prints the limits; leaves out the kernels that do not exist.
fn limits(args: &Args) -> (Limits, Vec<(KernelName, Precision)>) {
    let mut limits = Limits::measure();
    println!("limits of one thread in this process");
    let [f64s, f32s] = limits.flops.map(|rate| rate / 1e9);
    println!("  matrix product 1024 × 1024: {f64s:.1} GFLOP/s in f64, {f32s:.1} in f32");
    println!("  copy of 128 MiB, read and written: {:.1} GB/s", limits.bandwidth / 1e9);
    let mut cases = Vec::new();
    for &kernel in &args.kernels {
        for &precision in &args.precision {
            let label = format!("{}, {}", name(kernel), name(precision));
            let rate = |&tolerance: &f64| {
                let rate = limits.add_pairs(kernel, precision, args.gradient, tolerance)?;
                Some(format!("{:.2} G/s at {tolerance:.0e}", rate / 1e9))
            };
            match args.tolerances.iter().map(rate).collect::<Option<Vec<_>>>() {
                Some(rates) => {
                    println!("  bare loop of pairs, {label}: {}", rates.join(", "));
                    cases.push((kernel, precision));
                }
                None => println!("  left out, has no such precision or no gradient: {label}"),
            }
        }
    }
    (limits, cases)
}
