//! `ferreus_bbfmm`, in a process of its own.

use std::path::Path;
use std::time::Instant;
use std::{error, io};

use faer::{Mat, RowRef};
use ferreus_bbfmm::{FmmTree, KernelFunction};

use crate::problem::Problem;
use crate::{Trial, median};

/// 1/r, 0 at r = 0.
struct InverseDistance;

impl KernelFunction for InverseDistance {
    #[inline(always)]
    fn evaluate(&self, target: RowRef<f64>, source: RowRef<f64>) -> f64 {
        let [x, y, z] = [0, 1, 2].map(|k| target[k] - source[k]);
        let r2 = x * x + y * y + z * z;
        if r2 > 0.0 { 1.0 / r2.sqrt() } else { 0.0 }
    }
}

/// The largest order that is tried.
const MAX_ORDER: usize = 14;

/// Raises the order until the error is at most `tolerance`, from one node per digit on; prints each
/// trial as a line of four numbers.
///
/// # Errors
/// If the problem can't be read or the sum can't be done.
pub(crate) fn run(
    folder: &Path,
    tolerance: f64,
    repeats: usize,
) -> Result<(), Box<dyn error::Error>> {
    let problem = Problem::read(folder)?;
    let n = problem.points.len();
    let points = Mat::from_fn(n, 3, |i, k| problem.points[i][k]);
    let charges = Mat::from_fn(n, 1, |i, _| problem.charges[i]);
    let first = (-tolerance.log10()).ceil().max(2.0) as usize;
    for order in first..=MAX_ORDER {
        let (mut plans, mut applies) = (Vec::new(), Vec::new());
        loop {
            let start = Instant::now();
            let mut tree =
                FmmTree::new(points.clone(), order, InverseDistance, true, true, None, None);
            let plan = start.elapsed().as_secs_f64();
            let start = Instant::now();
            tree.set_weights(&charges.as_ref());
            let sums = tree
                .evaluate(&charges.as_ref(), &points)
                .map_err(|error| io::Error::other(error.to_string()))?;
            plans.push(plan);
            applies.push(start.elapsed().as_secs_f64());
            let values: Vec<f64> = (0..n).map(|i| sums[(i, 0)]).collect();
            let error = problem.error(&values);
            if error > tolerance || error.is_nan() || applies.len() >= repeats {
                let (plan, apply) = (median(&mut plans), median(&mut applies));
                println!("{}", Trial { knob: order as f64, error, plan, apply });
                if error <= tolerance {
                    return Ok(());
                }
                break;
            }
        }
    }
    Ok(())
}
