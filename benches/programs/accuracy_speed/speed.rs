//! Error against time per point.

use std::error::Error;

use farfield_benches::cli::name;
use farfield_benches::clouds::{self, Cloud};

use crate::args::Args;
use crate::case::{KernelName, Method, methods};
use crate::output::Output;
use crate::speed_row::{HEADING, Outcome, Row, csv, table};

/// Targets at which errors are measured.
const SAMPLES: usize = 1000;

/// Measures everything, prints it row by row, and writes files as it goes. Returns how many rows missed
/// what was asked of them.
///
/// # Errors
/// If a file can't be written, or the engine refuses anything but a tolerance.
pub(crate) fn run(args: &Args, output: &Output) -> Result<usize, Box<dyn Error>> {
    let mut missed = 0;
    for n in args.points(&[100_000, 1_000_000]) {
        for cloud in args.clouds(&[Cloud::Cube, Cloud::Sphere]) {
            let mut rows = Vec::new();
            let points = clouds::cloud(cloud, n);
            for kernel in args.kernels(&KernelName::SPEED) {
                println!("\n{}, {} of {n:e} points\n{HEADING}", kernel.label(), name(cloud));
                for &precision in &args.precision {
                    let Some(methods) = methods(kernel, precision, &points, SAMPLES) else {
                        println!("  {}  left out: formulas are in f64", name(precision));
                        continue;
                    };
                    for method in &methods {
                        let row = |asked, outcome| {
                            let way = method.way;
                            let row = Row { n, cloud, kernel, precision, way, asked, outcome };
                            println!("{}", row.line());
                            rows.push(row);
                        };
                        measure(args, method, row)?;
                    }
                }
                // All there is so far: the rest may take hours.
                let cloud = format!("{}_{n:e}", name(cloud));
                output.write(&format!("speed_{cloud}.csv"), &csv(&rows))?;
                output.write(&format!("speed_{cloud}.txt"), &table(&rows))?;
            }
            println!("\n{}", table(&rows));
            missed += rows.iter().filter(|row| row.missed()).count();
        }
    }
    Ok(missed)
}

/// Asks one way for smaller and smaller errors, as long as it makes sense.
fn measure(
    args: &Args,
    method: &Method,
    mut report: impl FnMut(Option<f64>, Outcome),
) -> Result<(), farfield::Error> {
    if !method.way.asks() {
        report(None, Outcome::Measured(method.run(0.5, args.repeats)?));
        return Ok(());
    }
    let mut ended = None;
    for tolerance in args.tolerances(1..=13) {
        let outcome = match ended.clone() {
            Some(outcome) => outcome,
            None => match method.run(tolerance, args.repeats) {
                Ok(measured) => {
                    if measured.first_plan + measured.apply > args.limit {
                        ended = Some(Outcome::OverLimit);
                    }
                    Outcome::Measured(measured)
                }
                Err(farfield::Error::UnreachableTolerance { .. }) => {
                    ended = Some(Outcome::Unreachable);
                    Outcome::Unreachable
                }
                Err(error) => return Err(error),
            },
        };
        report(Some(tolerance), outcome);
    }
    Ok(())
}
