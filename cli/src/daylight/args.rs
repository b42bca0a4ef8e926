//! The command line.

use std::path::PathBuf;

use clap::Parser;

use crate::outdoors::Outdoors;

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

    #[command(flatten)]
    pub(crate) outdoors: Outdoors,

    /// Positions of the sun: a CSV file with the columns time, azimuth, elevation; the time is any name, azimuths are in
    /// degrees from north by east, elevations in degrees above the horizon, and a sun below it gives nothing
    #[arg(long, value_name = "FILE")]
    pub(crate) sun: Option<PathBuf>,

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
