//! The command line.

use std::path::PathBuf;

use clap::{Parser, ValueEnum};

/// What the sky, the ground around and the sun give each element of a scene, past all that hides them.
///
/// Light that surfaces pass on to each other is not in it: `farfield radiosity` is for that. The table has a line for
/// each element with its centre, its normal, its area and its material; then `sky`, its irradiance by the sky in units
/// of what an open horizontal plane receives, which of a uniform sky is the sky view factor; `ground`, the form factor
/// to what lies below the horizon around the scene; and for each position of the sun `sun_TIME`, the direct beam in
/// units of what a plane across the beam receives.
#[derive(Clone, Debug, Parser)]
#[command(name = "daylight")]
pub(crate) struct Args {
    /// canyon, columns or another scene of `farfield radiosity`, or a file: .obj, .stl, .ply, .off, .vs3, .gltf, .glb,
    /// or a scene description in .toml
    #[arg(long, value_name = "NAME|FILE")]
    pub(crate) scene: String,

    /// The table, which ends in .csv
    #[arg(long, value_name = "FILE")]
    pub(crate) out: PathBuf,

    /// About how many elements to cut the surfaces into
    #[arg(long, value_name = "N", default_value_t = 10_000,
        value_parser = clap::value_parser!(u32).range(1..=4_000_000), allow_negative_numbers = true)]
    pub(crate) elements: u32,

    /// How bright the sky is, direction by direction
    #[arg(long, value_enum, default_value_t = SkyName::Uniform)]
    pub(crate) sky: SkyName,

    /// Positions of the sun: a CSV file with the columns time, azimuth, elevation; the time is any name, azimuths are in
    /// degrees from north by east, elevations in degrees above the horizon, and a sun below it gives nothing
    #[arg(long, value_name = "FILE")]
    pub(crate) sun: Option<PathBuf>,

    /// Which way is up
    #[arg(long, value_name = "X,Y,Z", default_value = "0,0,1", value_parser = vector, allow_hyphen_values = true)]
    pub(crate) zenith: [f64; 3],

    /// Which way is north; what of it is not horizontal doesn't count
    #[arg(long, value_name = "X,Y,Z", default_value = "0,1,0", value_parser = vector, allow_hyphen_values = true)]
    pub(crate) north: [f64; 3],

    /// Rays from each element to the sky, and to each position of the sun: the error is about 0.5/√rays at most, and
    /// mostly much less
    #[arg(long, value_name = "N", default_value_t = 512,
        value_parser = clap::value_parser!(u32).range(1..=1 << 20), allow_negative_numbers = true)]
    pub(crate) rays: u32,

    /// No bars
    #[arg(long)]
    pub(crate) quiet: bool,

    /// Number of threads; 0 takes one per core. The result is the same for any number
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u16).range(..=1024))]
    pub(crate) threads: u16,
}

/// How bright the sky is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum SkyName {
    /// As bright everywhere
    Uniform,
    /// The overcast sky of the CIE, three times as bright in the zenith as at the horizon
    Overcast,
}

fn vector(text: &str) -> Result<[f64; 3], String> {
    let numbers =
        text.split(',').map(|word| word.trim().parse().ok().filter(|x: &f64| x.is_finite()));
    let numbers: Option<Vec<f64>> = numbers.collect();
    let vector = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
    vector.filter(|vector| *vector != [0.0; 3]).ok_or_else(|| {
        "expected three finite numbers, not all of them zero, such as 0,0,1".to_owned()
    })
}
