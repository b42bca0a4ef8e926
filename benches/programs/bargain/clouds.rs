//! Where the points are.

use farfield_testing::clouds::{self, Random};
use glam::DVec3;

/// Makes `n` points.
pub(crate) type Cloud = fn(usize) -> Vec<DVec3>;

/// All clouds by name.
pub(crate) const CLOUDS: &[(&str, Cloud)] = &[
    ("cube", |n| clouds::cube(n, 1)),
    ("rod", |n| {
        clouds::cube(n, 2).into_iter().map(|p| p * DVec3::new(1000.0, 1.0, 1e-3)).collect()
    }),
    ("helix", |n| clouds::helix(n, 3)),
    // A hundred grains of a thousandth of the extent.
    ("dust", |n| {
        let (grains, inside) = (clouds::cube(100, 4), clouds::cube(n, 5));
        inside.into_iter().enumerate().map(|(i, p)| grains[i % 100] + p * 1e-3).collect()
    }),
    // Radii from 1e-8 to 1, as many in each decade.
    ("log", |n| {
        let mut random = Random::new(6);
        (0..n).map(|_| random.direction() * 10f64.powf(random.between(-8.0, 0.0))).collect()
    }),
    ("two", |n| {
        let inside = clouds::cube(n, 7).into_iter().enumerate();
        inside.map(|(i, p)| p + DVec3::X * (100 * (i % 2)) as f64).collect()
    }),
    ("grid", |n| {
        let side = (n as f64).cbrt().ceil() as usize;
        let at = |i: usize| [i / (side * side), i / side % side, i % side];
        (0..n).map(|i| DVec3::from(at(i).map(|k| k as f64)) / side as f64).collect()
    }),
];
