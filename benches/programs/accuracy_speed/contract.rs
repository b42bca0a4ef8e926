//! The error asked for against the error delivered.

use std::error::Error;
use std::fmt::Write as _;

use farfield_benches::cli::{Precision, name};
use farfield_benches::clouds::{self, Cloud};
use farfield_testing::clouds::half_width;
use glam::DVec3;

use crate::args::Args;
use crate::case::{KernelName, Way, methods};
use crate::output::Output;
use crate::problem::misses;

/// One sum.
struct Row {
    n: usize,
    cloud: Cloud,
    kernel: KernelName,
    way: Way,
    asked: f64,
    /// The error at all targets; none if the engine said that what was asked for is out of reach.
    delivered: Option<f64>,
}

const CLOUDS: [Cloud; 6] =
    [Cloud::Cube, Cloud::Sphere, Cloud::Plummer, Cloud::Line, Cloud::Clusters, Cloud::Helix];

const KERNELS: [KernelName; 16] = [
    KernelName::InverseDistance,
    KernelName::InverseFourth,
    KernelName::SquaredDistance,
    KernelName::Radiosity,
    KernelName::Yukawa,
    KernelName::Gaussian,
    KernelName::Log,
    KernelName::R3,
    KernelName::Helmholtz,
    KernelName::Anisotropic,
    KernelName::Matern,
    KernelName::Multiquadric,
    KernelName::RLogR,
    KernelName::InverseQuadratic,
    KernelName::AnisotropicGaussian,
    KernelName::Stokeslet,
];

/// Half the longest side of all clouds, so that their cells are of the same sizes and operators serve
/// several of them.
const HALF_WIDTH: f64 = 0.49;

/// Measures everything, prints it row by row, and writes files. Returns how many sums missed what was
/// asked of them.
///
/// # Errors
/// If a file can't be written, or the engine refuses anything but a tolerance.
pub(crate) fn run(args: &Args, output: &Output) -> Result<usize, Box<dyn Error>> {
    let mut rows = Vec::new();
    for kernel in args.kernels(&KERNELS) {
        for n in args.points(&[10_000]) {
            for cloud in args.clouds(&CLOUDS) {
                measure(args, kernel, cloud, n, &mut rows)?;
            }
        }
        output.write("contract.csv", &csv(&rows))?;
        output.write("contract.txt", &table(&rows))?;
    }
    println!("\n{}", table(&rows));
    Ok(rows.iter().filter(|row| row.missed()).count())
}

fn measure(
    args: &Args,
    kernel: KernelName,
    cloud: Cloud,
    n: usize,
    rows: &mut Vec<Row>,
) -> Result<(), farfield::Error> {
    let points = clouds::cloud(cloud, n);
    let scale = HALF_WIDTH / half_width(&points);
    let points: Vec<DVec3> = points.into_iter().map(|p| p * scale).collect();
    let methods = methods(kernel, Precision::F64, &points, usize::MAX).into_iter().flatten();
    for method in methods.filter(|m| matches!(m.way, Way::Interpolation | Way::Harmonic)) {
        let way = method.way;
        let mut line = format!("{:<22}{:<20}{:<9}", kernel.label(), way.label(), name(cloud));
        for asked in args.tolerances(2..=11) {
            let measured = match method.run(asked, 0) {
                Ok(measured) => Some(measured),
                Err(farfield::Error::UnreachableTolerance { .. }) => None,
                Err(error) => return Err(error),
            };
            let delivered = measured.as_ref().map(|measured| measured.error);
            let row = Row { n, cloud, kernel, way, asked, delivered };
            let share = delivered.map_or("  –".into(), |error| format!("{:9.1e}", error / asked));
            // Writing to a string can't fail, here and below.
            let _ = write!(line, "{share:>9}{}", if row.missed() { "!" } else { " " });
            rows.push(row);
            if measured.is_some_and(|m| m.first_plan + m.apply > args.limit) {
                line.push_str("  over the limit");
                break;
            }
        }
        println!("{line}");
    }
    Ok(())
}

impl Row {
    /// Whether the error is more than was asked for.
    fn missed(&self) -> bool {
        self.delivered.is_some_and(|delivered| misses(delivered, self.asked))
    }

    fn label(&self) -> String {
        match self.way {
            Way::Harmonic => format!("{}, harmonics", self.kernel.label()),
            _ => self.kernel.label().into(),
        }
    }
}

fn csv(rows: &[Row]) -> String {
    let mut csv = String::from("n,cloud,kernel,way,asked,outcome,delivered\n");
    for row in rows {
        let [cloud, kernel, way] = [name(row.cloud), name(row.kernel), name(row.way)];
        let _ = write!(csv, "{},{cloud},{kernel},{way},{:e},", row.n, row.asked);
        let _ = match row.delivered {
            None => writeln!(csv, "unreachable,"),
            Some(delivered) => {
                let outcome = if row.missed() { "missed" } else { "kept" };
                writeln!(csv, "{outcome},{delivered:.3e}")
            }
        };
    }
    csv
}

/// For each kernel, how its errors stand to what was asked for.
fn table(rows: &[Row]) -> String {
    let mut table = String::from(
        "Errors delivered, as shares of the errors asked for: least, median and greatest over all\n\
         clouds and tolerances; sums that missed; tolerances said to be out of reach\n\n\
         kernel                       least    median  greatest  missed  out of reach   sums\n",
    );
    for label in labels(rows) {
        let own = || rows.iter().filter(|row| row.label() == label);
        let mut shares: Vec<f64> =
            own().filter_map(|row| Some(row.delivered? / row.asked)).collect();
        shares.sort_by(f64::total_cmp);
        let at = |i: usize| shares.get(i).copied().unwrap_or(f64::NAN);
        let _ = writeln!(
            table,
            "{label:<24}{:>10.1e}{:>10.1e}{:>10.1e}{:>8}{:>14}{:>7}",
            at(0),
            at(shares.len() / 2),
            at(shares.len().saturating_sub(1)),
            own().filter(|row| row.missed()).count(),
            own().filter(|row| row.delivered.is_none()).count(),
            own().count()
        );
    }
    let missed = rows.iter().filter(|row| row.missed()).count();
    let _ = writeln!(table, "\n{} sums, {missed} missed", rows.len());
    table
}

/// The lines of the table, in the order of their rows.
fn labels(rows: &[Row]) -> Vec<String> {
    let mut labels: Vec<String> = Vec::new();
    for row in rows {
        if !labels.contains(&row.label()) {
            labels.push(row.label());
        }
    }
    labels
}
