//! The points and the charges: the same in every run.

use clap::ValueEnum;
use farfield_testing::clouds;
use glam::DVec3;

/// A distribution of points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Cloud {
    /// Uniform in the unit cube
    Cube,
    /// Uniform on the unit sphere
    Sphere,
    /// Plummer's star cluster, truncated at ten of its radii
    Plummer,
    /// Uniform on a line that is not along an axis
    Line,
    /// Two small balls far apart
    Clusters,
    /// On a tube of one hundredth of its length that winds three times
    Helix,
}

/// A cloud of `n` points.
pub(crate) fn cloud(cloud: Cloud, n: usize) -> Vec<DVec3> {
    let points = match cloud {
        Cloud::Cube => clouds::cube,
        Cloud::Sphere => clouds::sphere,
        Cloud::Plummer => clouds::plummer,
        Cloud::Line => clouds::line,
        Cloud::Clusters => clouds::two_balls,
        Cloud::Helix => clouds::helix,
    };
    points(n, cloud as u64 + 1)
}

/// `n` charges, uniform in [−1, 1).
pub(crate) fn charges(n: usize) -> Vec<f64> {
    clouds::charges(n, 7)
}
