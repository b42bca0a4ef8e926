//! The command line.

use std::path::PathBuf;

use clap::{Parser, ValueEnum};
use farfield_scenes::Quantity;
use serde::Serialize;

use super::daylight::Sun;
use crate::outdoors::Outdoors;

/// Light or radiant heat in a scene: solves the radiosity equation by a fast multipole sum with
/// occlusion, checks the sum against direct summation, and pictures the result.
///
/// Writes radiosity.png, radiosity.exr, elements.ply, elements.glb, elements.vtu, elements.csv, elements.npy,
/// scene.html to walk through (up to 500000 elements), report.json and report.html, all of them or none. Fails if the measured error of the sums exceeds the tolerance, or if
/// nothing emits and no form factors are asked for. What else may be wrong is a warning, on standard
/// error and in report.json: a tolerance that so many elements can't meet is one. Warnings don't change
/// the exit code, unless --strict is given.
#[derive(Clone, Debug, Parser)]
#[command(name = "radiosity")]
pub(crate) struct Args {
    /// cornell, furnace, sphere, bowl, two-rooms, canyon, columns, or a file: .obj, .stl, .ply, .off, .vs3, .gltf,
    /// .glb, or a scene description in .toml
    #[arg(long, value_name = "NAME|FILE", default_value = "cornell")]
    pub(crate) scene: String,

    /// About how many elements to cut the surfaces into, from 100 to 4000000; with --tolerance, at most
    /// so many [default: 10000, or as many as the tolerance takes up to 200000]
    #[arg(long, value_name = "N", value_parser = elements, allow_negative_numbers = true)]
    pub(crate) elements: Option<usize>,

    /// Relative l2 error of the irradiance, between 0 and 1; given, it decides the size of the elements
    /// too [default: 0.01 for the sums alone]
    #[arg(long, value_name = "ERROR", value_parser = tolerance, allow_negative_numbers = true)]
    pub(crate) tolerance: Option<f64>,

    /// How it is found out which elements see each other
    #[arg(long, value_enum, default_value_t = VisibilityName::Exact)]
    pub(crate) visibility: VisibilityName,

    /// How the equation B = E + ρH is solved
    #[arg(long, value_enum, default_value_t = SolverName::Cg)]
    pub(crate) solver: SolverName,

    /// How the far field is expanded
    #[arg(long, value_enum, default_value_t = ExpansionName::Interpolation)]
    pub(crate) expansion: ExpansionName,

    /// How the pairs are summed
    #[arg(long, value_enum, default_value_t = SchemeName::Fmm)]
    pub(crate) scheme: SchemeName,

    /// What is exchanged: heat takes the temperatures of materials, E = εσT⁴ with ε = 1 − ρ
    #[arg(long, value_enum, default_value_t = QuantityName::Light)]
    pub(crate) quantity: QuantityName,

    /// What an open horizontal plane receives of the sky [W/m²], alike in all bands. Light from outside arrives past
    /// everything that hides it, by about 4/tolerance rays from each element
    #[arg(long, value_name = "IRRADIANCE", value_parser = not_negative, allow_negative_numbers = true)]
    pub(crate) sky: Option<f64>,

    /// Where the sun is, in degrees from north by east and above the horizon, and what a plane across its beam receives
    /// [W/m²], such as 180,45,800; a sun below the horizon gives nothing
    #[arg(long, value_name = "AZIMUTH,ELEVATION,IRRADIANCE", value_parser = Sun::parse, allow_hyphen_values = true)]
    pub(crate) sun: Option<Sun>,

    /// Which share of sky and sun the ground around the scene reflects [default: 0]
    #[arg(long, value_name = "ALBEDO", value_parser = albedo, allow_negative_numbers = true)]
    pub(crate) ground: Option<f64>,

    /// For heat, the temperature of what is around the scene, black, above the horizon and below [K]
    #[arg(long, value_name = "KELVIN", value_parser = not_negative, allow_negative_numbers = true)]
    pub(crate) ambient: Option<f64>,

    #[command(flatten)]
    pub(crate) outdoors: Outdoors,

    /// Number of bands: 1 for their mean, or all that the scene has [default: all; 1 for heat]
    #[arg(long, value_name = "N", value_parser = bands, allow_negative_numbers = true)]
    pub(crate) bands: Option<usize>,

    /// Number of threads; 0 takes one per core. The result is the same for any number
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = threads, allow_negative_numbers = true)]
    pub(crate) threads: usize,

    /// Also writes the form factors to this CSV file, row by row, with what ends at backs of surfaces, what
    /// goes to the sky, and what the row then lacks to 1. They need nothing that emits
    #[arg(long, value_name = "FILE")]
    pub(crate) form_factors: Option<PathBuf>,

    /// Also solves for emissions that change with time: a CSV file with a header `time,MATERIAL,...` and a line for
    /// each time, with what each material's emission is multiplied by; for heat, with its temperature [K]. What is
    /// not named stays as it is. Writes steps.csv with the mean radiosity and irradiance of each material at each time,
    /// from one solution for each column
    #[arg(long, value_name = "FILE")]
    pub(crate) steps: Option<PathBuf>,

    /// Makes warnings errors: the exit code is 1 and nothing is written
    #[arg(long)]
    pub(crate) strict: bool,

    /// Takes no picture and writes no scene.html, which may take longer than the solution
    #[arg(long, conflicts_with = "size")]
    pub(crate) no_picture: bool,

    /// Columns and rows of the picture, from 1x1 to 8192x8192 [default: 720x720]
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
    pub(crate) size: Option<[usize; 2]>,

    /// Folder for the output, made if missing
    #[arg(long, value_name = "DIR", default_value = "target/radiosity")]
    pub(crate) out: PathBuf,

    /// Show neither progress nor report, but warnings
    #[arg(long)]
    pub(crate) quiet: bool,
}

/// Elements without a number and without a tolerance.
const ELEMENTS: usize = 10_000;
/// Elements at most where only the tolerance says how many.
const MOST_ELEMENTS: usize = 200_000;
/// The tolerance of the sums where none is given.
const TOLERANCE: f64 = 1e-2;

impl Args {
    /// The relative l2 error that sums may have.
    pub(crate) fn sum_tolerance(&self) -> f64 {
        self.tolerance.unwrap_or(TOLERANCE)
    }

    /// How many elements there are to be, at most if [adaptive](Self::is_adaptive).
    pub(crate) fn element_count(&self) -> usize {
        let most = if self.is_adaptive() { MOST_ELEMENTS } else { ELEMENTS };
        self.elements.unwrap_or(most)
    }

    /// Whether light or heat arrives from outside of the scene.
    pub(crate) fn is_outdoors(&self) -> bool {
        self.is_below_the_sky() || self.ambient.is_some()
    }

    /// Whether light arrives from the sky or the sun.
    pub(crate) fn is_below_the_sky(&self) -> bool {
        self.sky.is_some() || self.sun.is_some()
    }

    /// Whether the size of elements follows from the tolerance.
    pub(crate) fn is_adaptive(&self) -> bool {
        self.tolerance.is_some()
    }
}

/// How it is found out which elements see each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum VisibilityName {
    /// Every pair that no certificate settles by a ray of its own
    Exact,
    /// By samples where the tolerance allows
    Fractional,
    /// Not at all: light passes through everything
    None,
}

/// What is exchanged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum QuantityName {
    /// What lamps emit
    Light,
    /// What surfaces radiate by their temperature
    Heat,
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
    /// Multipole expansions evaluated at every element: O(N log N)
    Treecode,
    /// Every pair by itself: O(N²)
    Direct,
}

/// The solvers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum SolverName {
    /// Conjugate gradients: a few sums over all elements, however white they are
    Cg,
    /// All elements gather at once, bounce after bounce
    Jacobi,
    /// The element with the most unshot light shoots, one after the other; every pair by itself
    Southwell,
    /// Stabilised biconjugate gradients: a few sums, also where the exchange is not reciprocal
    Bicgstab,
}

impl From<QuantityName> for Quantity {
    fn from(name: QuantityName) -> Self {
        match name {
            QuantityName::Light => Self::Light,
            QuantityName::Heat => Self::Heat,
        }
    }
}

fn elements(text: &str) -> Result<usize, String> {
    integer(text, 100, 4_000_000)
}

fn bands(text: &str) -> Result<usize, String> {
    integer(text, 1, 1024)
}

fn threads(text: &str) -> Result<usize, String> {
    integer(text, 0, 1024)
}

fn integer(text: &str, min: usize, max: usize) -> Result<usize, String> {
    let valid = text.parse().ok().filter(|n| (min..=max).contains(n));
    valid.ok_or_else(|| format!("expected an integer from {min} to {max}"))
}

fn size(text: &str) -> Result<[usize; 2], String> {
    let edge = |text: &str| text.parse().ok().filter(|edge| (1..=MOST_PIXELS).contains(edge));
    let edges = text.split_once(['x', 'X']).and_then(|(w, h)| Some([edge(w)?, edge(h)?]));
    edges.ok_or_else(|| {
        format!("expected columns and rows from 1 to {MOST_PIXELS}, such as 1280x720")
    })
}

/// Columns and rows of a picture at most.
const MOST_PIXELS: usize = 8192;

fn not_negative(text: &str) -> Result<f64, String> {
    let valid = text.parse().ok().filter(|&e: &f64| e >= 0.0 && e.is_finite());
    valid.ok_or_else(|| "expected a finite number of 0 or more".to_owned())
}

fn albedo(text: &str) -> Result<f64, String> {
    let valid = text.parse().ok().filter(|share| (0.0..=1.0).contains(share));
    valid.ok_or_else(|| "expected a number from 0 to 1".to_owned())
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
        assert_eq!((args.element_count(), args.sum_tolerance()), (10_000, 1e-2));
        assert!(!args.is_adaptive());
        let args = Args::parse_from(["radiosity", "--tolerance", "0.1"]);
        assert_eq!((args.element_count(), args.sum_tolerance()), (200_000, 0.1));
        assert!(args.is_adaptive());
        let args = Args::parse_from(["radiosity", "--size", "1280x720"]);
        assert_eq!(args.size, Some([1280, 720]));
        let both = ["radiosity", "--size", "1280x720", "--no-picture"];
        assert!(Args::try_parse_from(both).is_err());
    }

    #[test]
    fn values_out_of_range_are_refused() {
        let refused = [
            ["--elements", "0"],
            ["--elements", "-5"],
            ["--elements", "1e4"],
            ["--bands", "0"],
            ["--visibility", "maybe"],
            ["--tolerance", "0"],
            ["--tolerance", "1"],
            ["--tolerance", "NaN"],
            ["--tolerance", "inf"],
            ["--threads", "two"],
            ["--scheme", "magic"],
            ["--size", "100"],
            ["--size", "0x10"],
            ["--size", "10x9000"],
            ["--size", "10x"],
            ["--sky", "-1"],
            ["--sky", "inf"],
            ["--ambient", "-1"],
            ["--ground", "1.1"],
            ["--sun", "1,2"],
            ["--sun", "0,91,1"],
            ["--sun", "0,1,-1"],
        ];
        for [option, value] in refused {
            let error = Args::try_parse_from(["radiosity", option, value]).expect_err(value);
            let message = error.to_string();
            assert!(message.starts_with(&format!("error: invalid value '{value}' for '{option}")));
        }
    }
}
