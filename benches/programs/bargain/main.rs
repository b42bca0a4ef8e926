//! Holds plans of many kernels on many clouds against direct sums: no plan is a bad bargain, and every
//! error is what was asked for.
//!
//! ```text
//! cargo run --release -p farfield-benches --example bargain
//! cargo run --release -p farfield-benches --example bargain -- --kernels gauss --points 1e4 --tolerances 1e-6
//! ```
//!
//! Errors are relative to the larger of ‖u‖ and s, s² = Σ |K|² |q|², at targets spread over the cloud.
//! "ratio" is plan and one application over direct sums; 10 ms are free.

mod clouds;
mod kernels;

use std::process::ExitCode;
use std::time::Instant;

use clap::Parser;
use farfield::{Fmm, Stats, direct, from_fn};
use farfield_benches::cli::{count, tolerance};
use farfield_testing::clouds::charges;
use glam::DVec3;

use clouds::CLOUDS;
use kernels::{Formula, KERNELS};

/// What is measured.
#[derive(Parser)]
struct Args {
    /// Kernels whose names contain one of these
    #[arg(long, value_delimiter = ',')]
    kernels: Vec<String>,
    /// Clouds by name
    #[arg(long, value_delimiter = ',')]
    clouds: Vec<String>,
    /// Numbers of points
    #[arg(long, value_delimiter = ',', value_parser = count, default_value = "100,1000,1e4")]
    points: Vec<usize>,
    /// Relative errors to ask for
    #[arg(long, value_delimiter = ',', value_parser = tolerance, default_value = "1e-3,1e-6,1e-9")]
    tolerances: Vec<f64>,
}

/// Seconds that are free.
const FREE: f64 = 0.01;
/// Targets at which errors and the time of direct sums are measured, at most.
const JUDGED: usize = 1000;

fn main() -> ExitCode {
    let args = Args::parse();
    let named = |all: &[String], name: &str| all.is_empty() || all.iter().any(|a| name.contains(a));
    println!(
        "{:>16} {:>6} {:>7} {:>6} {:>9} {:>9} {:>9} {:>6} {:>8}  scheme",
        "kernel", "cloud", "points", "asked", "plan", "apply", "direct", "ratio", "error"
    );
    let (mut ratios, mut failed) = (Vec::new(), 0);
    for &(kernel, formula) in KERNELS.iter().filter(|(name, _)| named(&args.kernels, name)) {
        for &(cloud, make) in CLOUDS.iter().filter(|(name, _)| named(&args.clouds, name)) {
            for &n in &args.points {
                let case = Case::new(formula, make(n));
                if !case.size.is_finite() {
                    println!("{kernel:>16} {cloud:>6} {n:>7} has no finite sum");
                    continue;
                }
                for &tolerance in &args.tolerances {
                    print!("{kernel:>16} {cloud:>6} {n:>7} {tolerance:>6.0e} ");
                    match case.measure(tolerance) {
                        Ok(ratio) => ratios.push(ratio),
                        Err(error) => {
                            println!("FAILED: {error}");
                            failed += 1;
                        }
                    }
                }
            }
        }
    }
    ratios.sort_by(f64::total_cmp);
    if let Some(largest) = ratios.last() {
        let median = ratios[ratios.len() / 2];
        println!("{} sums: median ratio {median:.2}, largest {largest:.2}", ratios.len());
    }
    println!("{failed} failed");
    if failed > 0 { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

/// Points, charges and what is right.
struct Case {
    formula: Formula,
    points: Vec<DVec3>,
    charges: Vec<f64>,
    /// Every so manieth target is judged.
    step: usize,
    exact: Vec<f64>,
    /// The larger of ‖u‖ and s at the judged targets.
    size: f64,
    /// Seconds of direct sums at all targets.
    direct: f64,
}

impl Case {
    fn new(formula: Formula, points: Vec<DVec3>) -> Self {
        let charges = charges(points.len(), 7);
        let step = points.len().div_ceil(JUDGED);
        let judged: Vec<_> = points.iter().copied().step_by(step).collect();
        let kernel = from_fn(formula).skip_coincident();
        let (mut exact, mut shortest) = (Vec::new(), f64::INFINITY);
        for _ in 0..3 {
            let start = Instant::now();
            exact = direct(&kernel, &points, &charges, &judged).unwrap_or_default();
            shortest = shortest.min(start.elapsed().as_secs_f64());
        }
        let squared = |x: f64| x * x;
        let pairs =
            judged.iter().flat_map(|x| points.iter().zip(&charges).map(move |(y, q)| (x, y, q)));
        let s: f64 =
            pairs.filter(|(x, y, _)| x != y).map(|(x, y, q)| squared(formula(*x, *y) * q)).sum();
        let u: f64 = exact.iter().copied().map(squared).sum();
        let direct = shortest * points.len() as f64 / judged.len() as f64;
        Self { formula, points, charges, step, exact, size: s.max(u).sqrt(), direct }
    }

    /// Plans and applies; the ratio of times, or what went wrong.
    fn measure(&self, tolerance: f64) -> Result<f64, String> {
        let kernel = from_fn(self.formula).skip_coincident();
        let start = Instant::now();
        let fmm = Fmm::builder(kernel)
            .tolerance(tolerance)
            .build(&self.points, &self.points)
            .map_err(|error| error.to_string())?;
        let plan = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let sums = fmm.apply(&self.charges).map_err(|error| error.to_string())?;
        let apply = start.elapsed().as_secs_f64();
        let judged = sums.iter().step_by(self.step).zip(&self.exact);
        let error = judged.map(|(u, exact)| (u - exact).powi(2)).sum::<f64>().sqrt();
        // Some kernels are zero between all points.
        let error = if error > 0.0 { error / self.size } else { error };
        let ratio = (plan + apply - FREE).max(0.0) / self.direct;
        let Stats { scheme, .. } = fmm.report().stats;
        println!(
            "{plan:>9.1e} {apply:>9.1e} {:>9.1e} {ratio:>6.2} {error:>8.1e}  {scheme}",
            self.direct
        );
        if error <= tolerance { Ok(ratio) } else { Err(format!("error {error:e}")) }
    }
}
