//! Exponents fitted to rows that differ in the number of points alone.

use farfield_benches::cli::name;

use crate::row::{Outcome, Row, Setting};

/// A time of a row, by its name.
type Time = (&'static str, fn(&Row) -> f64);

const TIMES: [Time; 3] =
    [("apply", |row| row.apply), ("plan", |row| row.plan), ("replan", |row| row.replan)];

/// A line for each series of at least two sizes: the exponents p of seconds ∝ N^p, by least squares.
pub(crate) fn exponents(rows: &[(Setting, Outcome)]) -> Vec<String> {
    let line = |(setting, rows): (Setting, Vec<(f64, Row)>)| {
        let fit = |(time, of): Time| {
            let points: Vec<_> = rows.iter().map(|(n, row)| (*n, of(row))).collect();
            slope(&points).map(|p| format!("{time} N^{p:.2}"))
        };
        let fits = TIMES.map(fit).into_iter().collect::<Option<Vec<_>>>()?;
        let Setting { cloud, kernel, precision, tolerance, threads, .. } = setting;
        let (cloud, kernel, precision) = (name(cloud), name(kernel), name(precision));
        let series = format!("{kernel} {precision} {cloud} {tolerance:.0e} on {threads}");
        Some(format!("{series:<44} {}", fits.join("  ")))
    };
    grouped(rows).into_iter().filter_map(line).collect()
}

/// The rows with times, by all of the setting but the number of points, which ascends in each group.
fn grouped(rows: &[(Setting, Outcome)]) -> Vec<(Setting, Vec<(f64, Row)>)> {
    let mut groups: Vec<(Setting, Vec<(f64, Row)>)> = Vec::new();
    for (setting, outcome) in rows {
        let Outcome::Passed(row) = outcome else { continue };
        let key = Setting { n: 0, ..*setting };
        let entry = (setting.n as f64, (**row).clone());
        match groups.iter_mut().find(|(known, _)| *known == key) {
            Some((_, group)) => group.push(entry),
            None => groups.push((key, vec![entry])),
        }
    }
    groups.iter_mut().for_each(|(_, group)| group.sort_by(|a, b| a.0.total_cmp(&b.0)));
    groups
}

/// The least-squares slope of log y over log x; none if all x are the same.
fn slope(points: &[(f64, f64)]) -> Option<f64> {
    let logs = points.iter().map(|&(x, y)| (x.ln(), y.ln()));
    let count = points.len() as f64;
    let (sum_x, sum_y) = logs.clone().fold((0.0, 0.0), |(a, b), (x, y)| (a + x, b + y));
    let (mean_x, mean_y) = (sum_x / count, sum_y / count);
    let (covariance, variance) = logs.fold((0.0, 0.0), |(c, v), (x, y)| {
        (c + (x - mean_x) * (y - mean_y), v + (x - mean_x) * (x - mean_x))
    });
    (variance > 0.0).then(|| covariance / variance)
}
