//! Clouds of very different shapes, in units of a length of 1.

use farfield_testing::clouds::{Random, cube, line, plummer, sphere};
use glam::DVec3;

/// Points per cloud.
pub(crate) const POINTS: usize = 2000;

/// All clouds by name, each in the cube [−1, 1]³.
pub(crate) fn all() -> Vec<(&'static str, Vec<DVec3>)> {
    vec![
        ("cube", fitted(cube(POINTS, 1))),
        ("sphere", fitted(sphere(POINTS, 2))),
        ("Plummer", fitted(plummer(POINTS, 3))),
        ("line", fitted(line(POINTS, 4))),
        ("clusters", fitted(clusters(5))),
        ("plane", fitted(plane(6))),
        ("helix", fitted(helix(7))),
    ]
}

/// Three clusters, small against what lies between them.
fn clusters(seed: u64) -> Vec<DVec3> {
    let mut random = Random::new(seed);
    let centres = [DVec3::ZERO, DVec3::X, DVec3::new(0.3, 0.9, 0.2)];
    (0..POINTS).map(|i| centres[i % 3] + 0.03 * random.in_cube()).collect()
}

/// A wall across the axes, thin against the cells of the tree.
fn plane(seed: u64) -> Vec<DVec3> {
    let mut random = Random::new(seed);
    let [a, b] = [DVec3::new(1.0, 0.2, 0.1), DVec3::new(-0.1, 1.0, 0.3)];
    (0..POINTS).map(|_| a * random.unit() + b * random.unit()).collect()
}

/// A wire in the shape of a screw.
fn helix(seed: u64) -> Vec<DVec3> {
    let mut random = Random::new(seed);
    let wire = |t: f64| DVec3::new((9.0 * t).cos(), (9.0 * t).sin(), t);
    (0..POINTS).map(|_| wire(random.between(-1.0, 1.0)) + 0.02 * random.in_cube()).collect()
}

/// Moved and scaled so that the longest side of the bounding box runs from −1 to 1.
fn fitted(points: Vec<DVec3>) -> Vec<DVec3> {
    let bounds = |(low, high): (DVec3, DVec3), &p: &DVec3| (low.min(p), high.max(p));
    let (low, high) = points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), bounds);
    let (centre, half) = (0.5 * (low + high), 0.5 * (high - low).max_element());
    points.into_iter().map(|p| (p - centre) / half).collect()
}
