//! Rows that differ in the number of points alone: fitted exponents, and charts.

use crate::chart::{Chart, Panel, Series};
use crate::cli::name;
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

/// A chart, by its file name, for each kernel, precision and number of threads.
pub(crate) fn charts(rows: &[(Setting, Outcome)]) -> Vec<(String, String)> {
    let mut left = grouped(rows);
    let mut charts = Vec::new();
    while let Some((first, _)) = left.first() {
        let key = |s: &Setting| (s.kernel, s.precision, s.threads);
        let (first, wanted) = (*first, key(first));
        let (these, others): (Vec<_>, Vec<_>) =
            left.into_iter().partition(|(s, _)| key(s) == wanted);
        left = others;
        let (kernel, precision) = (name(first.kernel), name(first.precision));
        let mut tolerances: Vec<f64> = these.iter().map(|(s, _)| s.tolerance).collect();
        tolerances.sort_by(f64::total_cmp);
        tolerances.dedup();
        let panel = |&(time, of): &Time| {
            let series = these.iter().map(|(s, rows)| Series {
                label: format!("{}, {:.0e}", name(s.cloud), s.tolerance),
                colour: tolerances.iter().position(|&t| t == s.tolerance).unwrap_or(0),
                dashes: s.cloud as usize,
                width: 1.6,
                dots: 2.5,
                points: rows.iter().map(|(n, row)| (*n, of(row))).collect(),
            });
            Panel { title: time.into(), series: series.collect(), ..Panel::default() }
        };
        let panels = TIMES[..2].iter().map(panel).collect();
        let title = format!("{kernel}, {precision}, threads: {}", first.threads);
        let file = format!("{kernel}-{precision}-{}.svg", first.threads).replace('/', "-over-");
        let (x, y) = ("points".into(), "seconds".into());
        charts.push((file, Chart { title, x, y, panels, ..Chart::default() }.svg()));
    }
    charts
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
