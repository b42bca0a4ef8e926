//! Bodies of flat pieces whose factors converge to those of round ones, and what extrapolates them.

use std::f64::consts::{PI, TAU};

use farfield_radiosity::Patch;
use glam::DVec3;

/// Corner k of a regular polygon of n corners around the z axis.
fn corner(n: usize, k: usize, radius: f64, z: f64) -> DVec3 {
    let angle = TAU * (k % n) as f64 / n as f64;
    DVec3::new(radius * angle.cos(), radius * angle.sin(), z)
}

/// The n triangles of a regular polygon around the z axis, the front upwards or downwards.
pub(crate) fn disk(n: usize, radius: f64, z: f64, up: bool) -> Vec<Patch> {
    let piece = |k: usize| {
        let (a, b) = (corner(n, k, radius, z), corner(n, k + 1, radius, z));
        let centre = DVec3::Z * z;
        Patch::new(&if up { [centre, a, b] } else { [centre, b, a] }).unwrap()
    };
    (0..n).map(piece).collect()
}

/// The n walls of a prism between two such polygons of one radius, seen from inside.
pub(crate) fn mantle(n: usize, radius: f64, height: f64) -> Vec<Patch> {
    let piece = |k: usize| {
        let [a, b] = [corner(n, k, radius, 0.0), corner(n, k + 1, radius, 0.0)];
        let up = DVec3::Z * height;
        Patch::new(&[b, a, a + up, b + up]).unwrap()
    };
    (0..n).map(piece).collect()
}

/// The factor between two bodies that n-fold symmetry turns into themselves: from one piece of the
/// first to all of the second.
pub(crate) fn symmetric_factor(from: &[Patch], to: &[Patch]) -> f64 {
    to.iter().map(|to| from[0].exchange(to)).sum::<f64>() / from[0].area()
}

/// The limit of what depends on n by even powers of 1/n, from n, 2n and 4n (Richardson).
pub(crate) fn extrapolated(n: usize, value: impl Fn(usize) -> f64) -> f64 {
    let [coarse, middle, fine] = [n, 2 * n, 4 * n].map(value);
    let (first, second) = ((4.0 * middle - coarse) / 3.0, (4.0 * fine - middle) / 3.0);
    (16.0 * second - first) / 15.0
}

/// A ball of flat pieces around the origin: n meridians; rings at the polar angles `rings`, poles left
/// out. Fronts outwards.
pub(crate) fn ball(n: usize, radius: f64, rings: &[f64]) -> Vec<Patch> {
    let ring = |angle: f64, k: usize| corner(n, k, radius * angle.sin(), radius * angle.cos());
    let (north, south) = (DVec3::Z * radius, DVec3::NEG_Z * radius);
    let mut corners = Vec::new();
    for k in 0..n {
        let (first, last) = (rings[0], rings[rings.len() - 1]);
        corners.push(vec![north, ring(first, k), ring(first, k + 1)]);
        corners.push(vec![south, ring(last, k + 1), ring(last, k)]);
        for pair in rings.windows(2) {
            let [above, below] =
                [pair[0], pair[1]].map(|angle| [ring(angle, k), ring(angle, k + 1)]);
            corners.push(vec![above[0], below[0], below[1], above[1]]);
        }
    }
    corners.iter().map(|corners| Patch::new(corners).unwrap()).collect()
}

/// `count` polar angles between the poles, evenly spread.
pub(crate) fn even_rings(count: usize) -> Vec<f64> {
    (1..=count).map(|k| PI * k as f64 / (count + 1) as f64).collect()
}

/// The same patch from its other side.
pub(crate) fn turned(patch: &Patch) -> Patch {
    Patch::new(&patch.corners().iter().rev().copied().collect::<Vec<_>>()).unwrap()
}

/// The same patch, `scale` times as large.
pub(crate) fn scaled(patch: &Patch, scale: f64) -> Patch {
    Patch::new(&patch.corners().iter().map(|&c| c * scale).collect::<Vec<_>>()).unwrap()
}
