//! The rows behind the chart of speed: a file with all, and a table of the fastest.

use std::fmt::Write as _;

use farfield_benches::cli::{Precision, name};
use farfield_benches::clouds::Cloud;

use crate::case::{KernelName, Way};
use crate::problem::{Measured, misses};

/// One sum in one way.
#[derive(Clone, Debug)]
pub(crate) struct Row {
    /// Number of points.
    pub(crate) n: usize,
    /// Where they lie.
    pub(crate) cloud: Cloud,
    /// What is summed.
    pub(crate) kernel: KernelName,
    /// In which precision.
    pub(crate) precision: Precision,
    /// In which way.
    pub(crate) way: Way,
    /// The error asked for, if this way can be asked.
    pub(crate) asked: Option<f64>,
    /// What came of it.
    pub(crate) outcome: Outcome,
}

/// What came of a row.
#[derive(Clone, Debug)]
pub(crate) enum Outcome {
    /// A sum, whether or not it keeps the tolerance.
    Measured(Measured),
    /// Refused by the engine: the tolerance is out of reach.
    Unreachable,
    /// Not tried: a larger tolerance took longer than the limit.
    OverLimit,
}

impl Row {
    /// What was measured, if anything was.
    pub(crate) fn measured(&self) -> Option<&Measured> {
        match &self.outcome {
            Outcome::Measured(measured) => Some(measured),
            Outcome::Unreachable | Outcome::OverLimit => None,
        }
    }

    /// Whether the error is more than was asked for.
    pub(crate) fn missed(&self) -> bool {
        match (self.measured(), self.asked) {
            (Some(measured), Some(asked)) => misses(measured.error, asked),
            _ => false,
        }
    }

    /// Microseconds per point.
    pub(crate) fn per_point(&self, seconds: f64) -> f64 {
        1e6 * seconds / self.n as f64
    }

    /// A line for who waits.
    pub(crate) fn line(&self) -> String {
        let asked = self.asked.map_or_else(String::new, |asked| format!("{asked:.0e}"));
        let what = match &self.outcome {
            Outcome::Unreachable => "out of reach".to_owned(),
            Outcome::OverLimit => "not tried: over the limit".to_owned(),
            Outcome::Measured(measured) => {
                let [first_plan, plan, apply] =
                    [measured.first_plan, measured.plan, measured.apply].map(|s| self.per_point(s));
                let missed = if self.missed() { "  MISSED" } else { "" };
                format!(
                    "{:>9.1e}{first_plan:>10.3}{plan:>10.3}{apply:>10.3}{:>7}{missed}",
                    measured.error, measured.terms
                )
            }
        };
        let precision = name(self.precision);
        format!("  {precision}  {:<24}{asked:>7}  {what}", self.way.label())
    }
}

/// Explains what [`Row::line`] writes.
pub(crate) const HEADING: &str = "\
                                 asked      error  1st plan      plan     apply  terms
                                                   μs per point";

/// All rows as comma-separated values, with a header; times in seconds.
pub(crate) fn csv(rows: &[Row]) -> String {
    let mut csv = String::from(
        "n,cloud,kernel,precision,way,asked,outcome,error,first_plan,plan,apply,terms_per_cell\n",
    );
    for row in rows {
        let [cloud, kernel] = [name(row.cloud), name(row.kernel)];
        let [precision, way] = [name(row.precision), name(row.way)];
        let asked = row.asked.map_or_else(String::new, |asked| format!("{asked:e}"));
        // Writing to a string can't fail.
        let _ = write!(csv, "{},{cloud},{kernel},{precision},{way},{asked},", row.n);
        let _ = match &row.outcome {
            Outcome::Unreachable => writeln!(csv, "unreachable,,,,,"),
            Outcome::OverLimit => writeln!(csv, "over_limit,,,,,"),
            Outcome::Measured(measured) => {
                let outcome = if row.missed() { "missed" } else { "kept" };
                let Measured { error, first_plan, plan, apply, terms } = measured;
                writeln!(csv, "{outcome},{error:.3e},{first_plan:.6},{plan:.6},{apply:.6},{terms}")
            }
        };
    }
    csv
}

/// For each sum and some tolerances: the way that applies fastest among those that keep it.
pub(crate) fn table(rows: &[Row]) -> String {
    let mut table = String::from(
        "The fastest way to keep an error: μs per point in apply, how many direct sums (f64) take as\n\
         long, and the way. Ways that miss what was asked of them don't count.\n",
    );
    let mut sums: Vec<(usize, Cloud, KernelName)> = Vec::new();
    for row in rows {
        if !sums.contains(&(row.n, row.cloud, row.kernel)) {
            sums.push((row.n, row.cloud, row.kernel));
        }
    }
    for (n, cloud, kernel) in sums {
        let of_sum = || rows.iter().filter(|r| (r.n, r.cloud, r.kernel) == (n, cloud, kernel));
        let direct = of_sum().find(|r| r.way == Way::Direct && r.precision == Precision::F64);
        let direct = direct.and_then(Row::measured).map_or(f64::NAN, |m| m.apply);
        let _ = writeln!(table, "\n{}, {} of {n:e} points", kernel.label(), name(cloud));
        for tolerance in [1e-3, 1e-6, 1e-9, 1e-12] {
            let fits = |row: &&Row| {
                row.way != Way::Direct
                    && row.measured().is_some_and(|m| m.error <= tolerance)
                    && !row.missed()
            };
            let apply = |row: &Row| row.measured().map_or(f64::INFINITY, |m| m.apply);
            let fastest = of_sum().filter(fits).min_by(|a, b| apply(a).total_cmp(&apply(b)));
            let _ = match fastest {
                None => writeln!(table, "  {tolerance:.0e}  none"),
                Some(row) => writeln!(
                    table,
                    "  {tolerance:.0e}{:>10.3}{:>12.2e}  {}, {}",
                    row.per_point(apply(row)),
                    apply(row) / direct,
                    row.way.label(),
                    name(row.precision)
                ),
            };
        }
    }
    let missed = rows.iter().filter(|row| row.missed()).count();
    let unreachable = rows.iter().filter(|r| matches!(r.outcome, Outcome::Unreachable)).count();
    let over = rows.iter().filter(|r| matches!(r.outcome, Outcome::OverLimit)).count();
    let _ = writeln!(
        table,
        "\n{} rows: {missed} missed the error asked for, {unreachable} out of reach, {over} not tried",
        rows.len()
    );
    table
}
