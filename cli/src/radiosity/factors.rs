//! Form factors as a table: every row of the matrix but for what is next to nothing, what ends at backs, and
//! what goes to the sky.

use std::io::{self, Write};
use std::ops::ControlFlow;

use farfield::Mask;
use farfield_radiosity::{Irradiance, Seen, Surroundings};
use rayon::prelude::*;

use super::solve::Exchange;

/// Rows that are computed before they are written.
const ROWS: usize = 512;

/// Rays that tell where the light of each element goes: in all, and from each at least and at most.
const ALL_RAYS: usize = 1 << 21;
const LEAST_RAYS: usize = 256;
const MOST_RAYS: usize = 4096;

/// Writes a line `row,column,factor` for every form factor F_ij, i and j counted from 0 in the order of the
/// elements, but for the smallest of each row, which add up to no more than `cut`, and four more for each
/// row: `rest`, the sum of those that are not listed; `back` and `sky`, what ends at surfaces that take no
/// part and what leaves the scene, by rays; `error`, what a row with these lacks to 1. O(N²) pairs; `report`
/// is told the fraction done and may end it. Returns the number of rows written.
pub(crate) fn write<const BANDS: usize>(
    file: &mut impl Write,
    exchange: &Exchange<'_, BANDS>,
    around: &Surroundings<'_>,
    cut: f64,
    report: impl Fn(f64) -> ControlFlow<()>,
) -> io::Result<usize> {
    writeln!(file, "row,column,factor")?;
    let count = exchange.surfels.len();
    let rays = (ALL_RAYS / count.max(1)).clamp(LEAST_RAYS, MOST_RAYS);
    for first in (0..count).step_by(ROWS) {
        let rows = first..(first + ROWS).min(count);
        let whole = |i: usize| (row(exchange, i, cut), around.look(i, rays));
        let rows: Vec<(Row, Seen)> = rows.into_par_iter().map(whole).collect();
        for (i, (Row { listed, rest, sum }, seen)) in rows.iter().enumerate() {
            let i = first + i;
            for (j, factor) in listed {
                writeln!(file, "{i},{j},{factor:.6e}")?;
            }
            let Seen { backs, sky, .. } = seen;
            let error = 1.0 - sum - backs - sky;
            writeln!(file, "{i},rest,{rest:.6e}\n{i},back,{backs:.6e}")?;
            writeln!(file, "{i},sky,{sky:.6e}\n{i},error,{error:.6e}")?;
        }
        let done = first + rows.len();
        if report(done as f64 / count as f64).is_break() {
            return Ok(done);
        }
    }
    Ok(count)
}

/// One row of form factors.
struct Row {
    listed: Vec<(usize, f64)>,
    rest: f64,
    /// Of all, listed or not.
    sum: f64,
}

/// F_ij = d_i (V_ij K_ij A_j + C_ij/A_i) d_j.
fn row<const BANDS: usize>(exchange: &Exchange<'_, BANDS>, i: usize, cut: f64) -> Row {
    let kernel = Irradiance::<f64>::clamped();
    let receiver = &exchange.surfels[i];
    let mut factors: Vec<(usize, f64)> = Vec::new();
    for (j, source) in exchange.surfels.iter().enumerate() {
        let factor = kernel.factor(receiver, source) * source.area;
        if factor > 0.0 {
            let seen = Mask::<Irradiance<f64>>::pair(exchange.visibility, receiver, source);
            if seen > 0.0 {
                factors.push((j, seen * factor));
            }
        }
    }
    // C is symmetric: its column by i, per unit area of the other, is its row.
    for (j, value) in exchange.operator.corrections().column(i) {
        let value = value * exchange.surfels[j].area / receiver.area;
        match factors.binary_search_by_key(&j, |entry| entry.0) {
            Ok(place) => factors[place].1 += value,
            Err(place) => factors.insert(place, (j, value)),
        }
    }
    let own = exchange.operator.scaling(i);
    for (j, factor) in &mut factors {
        *factor *= own * exchange.operator.scaling(*j);
    }
    let sum: f64 = factors.iter().map(|entry| entry.1).sum();
    // From the smallest on, as long as they are next to nothing together.
    let mut order: Vec<usize> = (0..factors.len()).collect();
    order.sort_unstable_by(|&a, &b| factors[a].1.total_cmp(&factors[b].1));
    let mut rest = 0.0;
    for k in order {
        if rest + factors[k].1 > cut {
            break;
        }
        rest += std::mem::take(&mut factors[k].1);
    }
    factors.retain(|&(_, factor)| factor != 0.0);
    Row { listed: factors, rest, sum }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiosity::fixture::exchanging;
    use farfield_radiosity::Occluders;

    #[test]
    fn whole_rows_are_written_until_it_is_ended() {
        exchanging::<1>("furnace", 600, None, |_, mesh, exchange| {
            let count = mesh.elements.len();
            let occluders = Occluders::new(&mesh.triangles).expect("finite");
            let around = Surroundings::new(&mesh.elements, &occluders, 8);
            for (flow, expected) in
                [(ControlFlow::Continue(()), count), (ControlFlow::Break(()), ROWS)]
            {
                let mut table = Vec::new();
                let rows = write(&mut table, exchange, &around, 1e-5, |_| flow).expect("written");
                assert_eq!(rows, expected);
                let table = String::from_utf8(table).expect("text");
                let mut sums = vec![0.0; count];
                for line in table.lines().skip(1) {
                    let cells: Vec<_> = line.split(',').collect();
                    let factor: f64 = cells[2].parse().expect("a number");
                    sums[cells[0].parse::<usize>().expect("an index")] += factor;
                    let most = match cells[1] {
                        "rest" => 1e-5,
                        "back" | "sky" => 0.0,
                        "error" => 0.02,
                        _ => 1.0,
                    };
                    assert!(factor.abs() <= most, "{line}");
                }
                assert!(sums[..rows].iter().all(|sum| (sum - 1.0).abs() < 1e-4));
                assert!(sums[rows..].iter().all(|&sum| sum == 0.0));
            }
        });
    }
}
