//! The charts of error against time per point, and what can't be beaten in both.

use crate::case::{KernelName, Way};
use crate::chart::{Chart, Panel, Series};
use crate::cli::{Precision, name};
use crate::clouds::Cloud;
use crate::problem::Measured;
use crate::rivals::Rival;
use crate::speed_row::Row;

/// Errors below are rounding, in which no way is better than another.
const FLOOR: f64 = 3e-15;

/// One of the times, by its name.
#[derive(Clone, Copy)]
struct Time {
    name: &'static str,
    of: fn(&Measured) -> f64,
    of_rival: fn(&Rival) -> f64,
    /// Whether a direct sum has it.
    direct: bool,
}

const TIMES: [Time; 2] = [
    Time { name: "apply", of: |m| m.apply, of_rival: |r| r.apply, direct: true },
    Time { name: "plan", of: |m| m.first_plan, of_rival: |r| r.plan, direct: false },
];

/// A chart of applications and one of plans for each cloud and number of points, by their files.
pub(crate) fn charts(rows: &[Row], rivals: &[Rival]) -> Vec<(String, Chart)> {
    let mut clouds: Vec<(usize, Cloud)> = Vec::new();
    for row in rows {
        if !clouds.contains(&(row.n, row.cloud)) {
            clouds.push((row.n, row.cloud));
        }
    }
    let mut charts = Vec::new();
    for (n, cloud) in clouds {
        let rows: Vec<&Row> = rows.iter().filter(|r| (r.n, r.cloud) == (n, cloud)).collect();
        let here = |r: &&Rival| (r.n, &r.cloud) == (n, &name(cloud));
        let rivals: Vec<&Rival> = rivals.iter().filter(here).collect();
        for time in TIMES {
            let file = format!("speed_{}_{}_{n:e}.svg", time.name, name(cloud));
            charts
                .push((file, chart(&rows, &rivals, time, &format!("{}, N = {n:e}", name(cloud)))));
        }
    }
    charts
}

fn chart(rows: &[&Row], rivals: &[&Rival], time: Time, of: &str) -> Chart {
    let mut kernels: Vec<KernelName> = rows.iter().map(|row| row.kernel).collect();
    kernels.dedup();
    let of_kernel = |&kernel: &KernelName| {
        let rows: Vec<&Row> = rows.iter().copied().filter(|row| row.kernel == kernel).collect();
        // Peers are compared in 1/r alone.
        let rivals = if kernel == KernelName::InverseDistance { rivals } else { &[] };
        panel(kernel, &rows, rivals, time)
    };
    let what = match time.direct {
        true => "from charges to values",
        false => "first plan, operators included",
    };
    Chart {
        title: format!("Error and time, {of}: {what}; towards the lower left is better"),
        x: "relative l2 error, measured".into(),
        y: format!("μs per point, {}", time.name),
        ring: "none better in both".into(),
        cross: "missed what was asked".into(),
        panels: kernels.iter().map(of_kernel).collect(),
    }
}

fn panel(kernel: KernelName, rows: &[&Row], rivals: &[&Rival], time: Time) -> Panel {
    let place = |row: &Row| {
        let measured = row.measured()?;
        let y = row.per_point((time.of)(measured));
        (y > 0.0).then(|| (measured.error.max(FLOOR), y))
    };
    let mut series: Vec<Series> = Vec::new();
    for row in rows.iter().filter(|row| row.way != Way::Direct) {
        let (Some(point), label) = (place(row), label(row)) else { continue };
        match series.iter_mut().find(|s| s.label == label) {
            Some(series) => series.points.push(point),
            None => series.push(Series {
                label,
                colour: if row.way == Way::Separable { 9 } else { row.way as usize },
                dashes: usize::from(row.precision == Precision::F32),
                width: 1.4,
                dots: if row.way.asks() { 2.4 } else { 4.0 },
                points: vec![point],
            }),
        }
    }
    for rival in rivals {
        let y = 1e6 * (time.of_rival)(rival) / rival.n as f64;
        if y == 0.0 {
            continue;
        }
        match series.iter_mut().find(|s| s.label == rival.who) {
            Some(series) => series.points.push((rival.error, y)),
            None => series.push(Series {
                label: rival.who.clone(),
                colour: if rival.who == "ferreus" { 6 } else { 8 },
                dashes: 3,
                width: 1.4,
                dots: 2.4,
                points: vec![(rival.error, y)],
            }),
        }
    }
    let all: Vec<(f64, f64)> = series.iter().flat_map(|s| s.points.clone()).collect();
    let rings = front(&all);
    // Where direct sums are: a line, since what they are judged by is a direct sum too.
    for row in rows.iter().filter(|row| row.way == Way::Direct && time.direct) {
        if let Some((_, y)) = place(row) {
            series.push(Series {
                label: label(row),
                colour: 5,
                dashes: usize::from(row.precision == Precision::F32),
                width: 1.0,
                dots: 0.0,
                points: vec![(FLOOR, y), (1.0, y)],
            });
        }
    }
    let missed = rows.iter().filter(|row| row.missed());
    let crosses = missed.filter_map(|row| place(row)).collect();
    Panel { title: kernel.label().into(), series, rings, crosses }
}

fn label(row: &Row) -> String {
    format!("{}, {}", row.way.label(), name(row.precision))
}

/// The points (x, y) of which no other has a smaller x without a larger y.
fn front(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut least = f64::INFINITY;
    sorted.retain(|&(_, y)| {
        let better = y < least;
        least = least.min(y);
        better
    });
    sorted
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_is_what_nothing_beats_in_both() {
        let points = [(1e-3, 2.0), (1e-6, 5.0), (1e-4, 6.0), (1e-1, 1.0), (1e-3, 3.0)];
        assert_eq!(front(&points), [(1e-6, 5.0), (1e-3, 2.0), (1e-1, 1.0)]);
        assert_eq!(front(&[]), []);
    }
}
