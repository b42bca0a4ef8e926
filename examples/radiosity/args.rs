//! The command line.

use std::path::PathBuf;

use clap::{Parser, ValueEnum};
use serde::Serialize;

/// Light in the Cornell box: solves the radiosity equation by a fast multipole sum with occlusion,
/// checks the sum against direct summation, and renders the result.
///
/// Writes cornell.png, surfels.ply and report.json. Fails if the measured error exceeds the tolerance.
#[derive(Clone, Debug, Parser)]
#[command(name = "radiosity")]
pub(crate) struct Args {
    /// About how many surfels to cut the walls into, from 100 to 1000000
    #[arg(long, value_name = "N", default_value_t = 10_000, value_parser = surfels, allow_negative_numbers = true)]
    pub(crate) surfels: usize,

    /// Relative l2 error that the gathered light may have, between 0 and 1
    #[arg(long, value_name = "ERROR", default_value_t = 1e-2, value_parser = tolerance, allow_negative_numbers = true)]
    pub(crate) tolerance: f64,

    /// How the far field is expanded
    #[arg(long, value_enum, default_value_t = ExpansionName::Interpolation)]
    pub(crate) expansion: ExpansionName,

    /// How the pairs are summed
    #[arg(long, value_enum, default_value_t = SchemeName::Fmm)]
    pub(crate) scheme: SchemeName,

    /// How the equation B = E + ρH is solved
    #[arg(long, value_enum, default_value_t = SolverName::Cg)]
    pub(crate) solver: SolverName,

    /// Let light pass through walls and blocks: no shadows
    #[arg(long)]
    pub(crate) no_occlusion: bool,

    /// Number of threads; 0 takes one per core. The result is the same for any number
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = threads, allow_negative_numbers = true)]
    pub(crate) threads: usize,

    /// Folder for the output, made if missing
    #[arg(long, value_name = "DIR", default_value = "target/radiosity")]
    pub(crate) out: PathBuf,
}

/// The far-field expansions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ExpansionName {
    /// 16 moments for each term of the harmonic expansion of 1/r⁴
    SixteenMoment,
    /// Chebyshev interpolation of the tensor d dᵗ/r⁴
    Interpolation,
}

/// The summation schemes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum SchemeName {
    /// Multipole and local expansions: O(N)
    Fmm,
    /// Multipole expansions evaluated at every surfel: O(N log N)
    Treecode,
    /// Every pair by itself: O(N²)
    Direct,
}

/// The solvers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum SolverName {
    /// Conjugate gradients: a few sums over all surfels, however white they are
    Cg,
    /// All surfels gather at once, bounce after bounce
    Jacobi,
    /// The surfel with the most unshot light shoots, one after the other; every pair by itself
    Southwell,
}

fn surfels(text: &str) -> Result<usize, String> {
    integer(text, 100, 1_000_000)
}

fn threads(text: &str) -> Result<usize, String> {
    integer(text, 0, 1024)
}

fn integer(text: &str, min: usize, max: usize) -> Result<usize, String> {
    let valid = text.parse().ok().filter(|n| (min..=max).contains(n));
    valid.ok_or_else(|| format!("expected an integer from {min} to {max}"))
}

fn tolerance(text: &str) -> Result<f64, String> {
    let valid = text.parse().ok().filter(|&t| 0.0 < t && t < 1.0);
    valid.ok_or_else(|| "expected a number between 0 and 1, both excluded".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent_and_needs_no_arguments() {
        Args::command().debug_assert();
        let args = Args::try_parse_from(["radiosity"]).expect("every argument has a default");
        assert_eq!((args.surfels, args.tolerance), (10_000, 1e-2));
    }

    #[test]
    fn values_out_of_range_are_refused() {
        let refused = [
            ["--surfels", "0"],
            ["--surfels", "-5"],
            ["--surfels", "1e4"],
            ["--tolerance", "0"],
            ["--tolerance", "1"],
            ["--tolerance", "NaN"],
            ["--tolerance", "inf"],
            ["--threads", "two"],
            ["--scheme", "magic"],
        ];
        for [option, value] in refused {
            let error = Args::try_parse_from(["radiosity", option, value]).expect_err(value);
            let message = error.to_string();
            assert!(message.starts_with(&format!("error: invalid value '{value}' for '{option}")));
        }
    }
}
