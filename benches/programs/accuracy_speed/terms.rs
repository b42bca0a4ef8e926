//! The terms of a cell against the error of its far field, above the least that could do.

use std::error::Error;
use std::fmt::Write as _;
use std::iter;

use farfield::{Expansion, Interpolation, Kernel};
use farfield_potentials::{Exponent, HarmonicExpansion, MinusFour, MinusOne, PowerLaw};
use farfield_radiosity::{Irradiance, SixteenMoment};

use crate::case::KernelName;
use crate::far_field::{FarField, Sampling};
use crate::output::Output;
use crate::placed::Placed;

/// One kernel: the bound, and the points of each expansion.
struct Kind {
    kernel: KernelName,
    bound: Vec<f64>,
    points: Vec<Point>,
}

type KindResult = Result<Kind, Box<dyn Error>>;

/// One expansion of the far field.
struct Point {
    expansion: Expanded,
    /// What sets its accuracy: an order, nodes per axis, a tolerance.
    knob: f64,
    terms: usize,
    error: f64,
}

/// An expansion, by how its terms are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Expanded {
    Harmonics,
    SixteenMoments,
    Nodes,
    Compressed,
}

const EXPANSIONS: [Expanded; 4] =
    [Expanded::Harmonics, Expanded::SixteenMoments, Expanded::Nodes, Expanded::Compressed];

impl Expanded {
    fn label(self) -> &'static str {
        match self {
            Self::Harmonics => "solid harmonics",
            Self::SixteenMoments => "16 moments in harmonics",
            Self::Nodes => "Chebyshev nodes, n³ per field",
            Self::Compressed => "interpolation, compressed to rank",
        }
    }
}

/// The errors that the table is about.
const ERRORS: [f64; 4] = [1e-2, 1e-3, 1e-6, 1e-9];

/// Measures three kernels and writes files.
///
/// # Errors
/// If a file can't be written or an expansion can't be prepared.
pub(crate) fn run(output: &Output) -> Result<(), Box<dyn Error>> {
    let mut kinds = Vec::new();
    println!("\nfar field of one cell: terms and error by expansion");
    let measurements: [fn() -> KindResult; 3] = [
        || power_law::<MinusOne>(KernelName::InverseDistance, 1..=26),
        || power_law::<MinusFour>(KernelName::InverseFourth, 1..=16),
        radiosity,
    ];
    for measure in measurements {
        kinds.push(measure()?);
        output.write("terms.csv", &csv(&kinds))?;
        output.write("terms.txt", &table(&kinds))?;
    }
    println!("\n{}", table(&kinds));
    Ok(())
}

/// The fewest terms whose bound is at most `error`.
pub(crate) fn least_terms(bound: &[f64], error: f64) -> usize {
    bound.partition_point(|&left| left > error)
}

fn power_law<E: Exponent>(
    kernel: KernelName,
    orders: std::ops::RangeInclusive<usize>,
) -> KindResult {
    let law = PowerLaw::<E, f64>::new();
    let field = FarField::new(law, Sampling { nodes: [10, 4], copies: 1 });
    let mut kind = kind(kernel, &field, law, 2..=10, 1..=10)?;
    for order in orders {
        let (error, expansion) = field.error(HarmonicExpansion::new(law, order)?)?;
        kind.note(Expanded::Harmonics, order as f64, expansion.multipole_len(0), error);
    }
    Ok(kind)
}

fn radiosity() -> KindResult {
    let irradiance = Irradiance::<f64>::signed();
    // Three directions at each node, as many as the irradiance vector has components.
    let field = FarField::new(irradiance, Sampling { nodes: [8, 3], copies: 3 });
    // Beyond, the operators of nine components take minutes.
    let mut kind = kind(KernelName::Radiosity, &field, irradiance, 2..=6, 1..=6)?;
    for order in 1..=10 {
        let (error, expansion) = field.error(SixteenMoment::new(irradiance, order)?)?;
        kind.note(Expanded::SixteenMoments, order as f64, 16 * expansion.multipole_len(0), error);
    }
    Ok(kind)
}

/// The bound, and what any kernel can be expanded in: bare nodes, and the ranks of tolerances that are
/// negative powers of ten.
fn kind<P, K>(
    name: KernelName,
    field: &FarField<K>,
    kernel: K,
    nodes: std::ops::RangeInclusive<usize>,
    powers: std::ops::RangeInclusive<i32>,
) -> KindResult
where
    P: Placed<Real = f64>,
    K: Kernel<Real = f64, Source = P, Target = P, Charge = f64, Value = f64> + Copy,
{
    let bound = field.bound().ok_or("the singular values of a far field can't be found")?;
    let mut kind = Kind { kernel: name, bound, points: Vec::new() };
    for n in nodes {
        // What the engine cuts off here adds some hundredths to the error of interpolation.
        let (error, _) = field.error(Interpolation::new(kernel).order(n))?;
        kind.note(Expanded::Nodes, n as f64, kernel.densities() * n.pow(3), error);
    }
    for power in powers {
        let tolerance = 10f64.powi(-power);
        match field.error(Interpolation::new(kernel).tolerance(tolerance)) {
            Ok((error, expansion)) => {
                kind.note(Expanded::Compressed, tolerance, expansion.multipole_len(3), error);
            }
            Err(farfield::Error::UnreachableTolerance { .. }) => break,
            Err(error) => return Err(error.into()),
        }
    }
    Ok(kind)
}

impl Kind {
    fn note(&mut self, expansion: Expanded, knob: f64, terms: usize, error: f64) {
        let (kernel, least) = (self.kernel.label(), least_terms(&self.bound, error));
        let label = expansion.label();
        println!(
            "  {kernel:<18}{label:<36}{knob:>8.0e}{terms:>7} terms{error:>9.1e}  least {least}"
        );
        self.points.push(Point { expansion, knob, terms, error });
    }

    /// The bound at every number of terms, or every thirtieth part of large ones, down to the least error of
    /// all expansions.
    fn bound_samples(&self) -> impl Iterator<Item = (usize, f64)> {
        let least = self.points.iter().map(|point| point.error).fold(1.0, f64::min);
        let terms = iter::successors(Some(1), |&terms: &usize| Some(terms + terms.div_ceil(30)));
        terms
            .map_while(|terms| Some((terms, *self.bound.get(terms)?)))
            .take_while(move |(_, error)| *error >= least)
    }

    fn of(&self, expansion: Expanded) -> impl Iterator<Item = &Point> {
        self.points.iter().filter(move |point| point.expansion == expansion)
    }
}

fn csv(kinds: &[Kind]) -> String {
    let mut csv = String::from("kernel,expansion,knob,terms_per_cell,error,least_terms\n");
    for kind in kinds {
        for Point { expansion, knob, terms, error } in &kind.points {
            let (kernel, least) = (kind.kernel.label(), least_terms(&kind.bound, *error));
            let label = format!("{expansion:?}").to_lowercase();
            // Writing to a string can't fail, here and below.
            let _ = writeln!(csv, "{kernel},{label},{knob},{terms},{error:.3e},{least}");
        }
        for (terms, error) in kind.bound_samples() {
            let _ = writeln!(csv, "{},bound,,{terms},{error:.3e},{terms}", kind.kernel.label());
        }
    }
    csv
}

/// The fewest terms of each expansion that keep some errors.
fn table(kinds: &[Kind]) -> String {
    let mut table = format!(
        "Terms per cell that keep an error of the far field of one cell, all 316 offsets together\n\n{:<18}{:<36}",
        "kernel", ""
    );
    ERRORS.iter().for_each(|error| table.push_str(&format!("{error:>8.0e}")));
    for kind in kinds {
        let mut line = |label: &str, terms: &dyn Fn(f64) -> Option<usize>| {
            let _ = write!(table, "\n{:<18}{label:<36}", kind.kernel.label());
            for error in ERRORS {
                let terms = terms(error).map_or("–".into(), |terms| terms.to_string());
                let _ = write!(table, "{terms:>8}");
            }
        };
        line("least of any method (SVD)", &|error| Some(least_terms(&kind.bound, error)));
        for expansion in EXPANSIONS {
            if kind.of(expansion).next().is_some() {
                line(expansion.label(), &|error| {
                    kind.of(expansion).filter(|p| p.error <= error).map(|p| p.terms).min()
                });
            }
        }
    }
    table + "\n"
}
