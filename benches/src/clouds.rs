//! Points and charges, the same in every run.

use clap::ValueEnum;
use farfield_testing::clouds;
use glam::DVec3;

/// A distribution of points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Cloud {
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

/// `n` points of a distribution.
pub fn cloud(cloud: Cloud, n: usize) -> Vec<DVec3> {
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

/// `n` points of a low-discrepancy sequence: evenly spread in the unit cube.
pub fn even(n: usize) -> Vec<DVec3> {
    let point = |i| (DVec3::new(0.819_173, 0.671_044, 0.549_700) * i as f64).fract();
    (1..=n).map(point).collect()
}

/// `n` charges, uniform in [−1, 1).
pub fn charges(n: usize) -> Vec<f64> {
    clouds::charges(n, 7)
}
