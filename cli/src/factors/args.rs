//! The command line.

use std::path::PathBuf;

use clap::{Parser, ValueEnum};

/// Form factors between whole surfaces, summed over groups of them, past all that hides them from each other.
///
/// Every pair of surfaces by itself: exact where nothing is in between, by rays and ever smaller pieces where
/// something is. Takes time in proportion to the pairs. `farfield factors --scene room.vs3 --out room.txt` reads a
/// file of View3D, subsurfaces, masks, nulls, obstructions and combined surfaces included, and writes the table
/// that View3D writes; of its controls `out`, `encl` and `emit` are heeded, and nothing is adjusted to enclosures.
#[derive(Clone, Debug, Parser)]
#[command(name = "factors")]
pub(crate) struct Args {
    /// cornell, furnace, sphere, bowl, two-rooms, canyon, columns, or a file: .obj, .stl, .ply, .off, .vs3, or
    /// a scene description in .toml
    #[arg(long, value_name = "NAME|FILE")]
    pub(crate) scene: String,

    /// The table: .csv has names, areas, a row of factors for each group, and what a row lacks to 1; .npy has
    /// the factors alone; .txt is the file of View3D
    #[arg(long, value_name = "FILE")]
    pub(crate) out: PathBuf,

    /// What factors are summed over [default: surfaces; of .vs3 what it combines]
    #[arg(long, value_enum)]
    pub(crate) by: Option<By>,

    /// Factors between these alone, summed over all that have the same name: surfaces of .vs3, otherwise materials,
    /// or files by `--by file`. Everything else hides what it hides, and counts as `rest`
    #[arg(long, value_name = "NAME", num_args = 1..)]
    pub(crate) between: Vec<String>,

    /// By how much a factor between two surfaces may be off, between 0 and 1
    #[arg(long, value_name = "ERROR", default_value_t = 1e-4, value_parser = fraction)]
    pub(crate) tolerance: f64,

    /// Writes a line `from,to,factor` for each factor of at least so much, for .csv alone
    #[arg(long, value_name = "FACTOR", value_parser = fraction)]
    pub(crate) sparse: Option<f64>,

    /// No bars
    #[arg(long)]
    pub(crate) quiet: bool,

    /// Number of threads; 0 takes one per core. The result is the same for any number
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u16).range(..=1024))]
    pub(crate) threads: u16,
}

/// What factors are summed over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum By {
    /// Nothing: each surface by itself
    Surface,
    /// All surfaces of a material, by its name
    Material,
    /// All surfaces from a file
    File,
}

fn fraction(text: &str) -> Result<f64, String> {
    let valid = text.parse().ok().filter(|&t| 0.0 < t && t < 1.0);
    valid.ok_or_else(|| "expected a number between 0 and 1, both excluded".to_owned())
}
