//! Elements for tests.

use farfield_radiosity::{Element, Patch, Triangle};
use glam::DVec3;

/// The parallelogram at `origin` along `u` and `v` in `counts` cells, with its front towards u × v.
pub(crate) fn grid(
    origin: DVec3,
    u: DVec3,
    v: DVec3,
    [nu, nv]: [usize; 2],
    face: u32,
) -> Vec<Element> {
    let corner =
        |i: usize, j: usize| origin + u * (i as f64 / nu as f64) + v * (j as f64 / nv as f64);
    let cell = |k: usize| {
        let (i, j) = (k / nv, k % nv);
        let corners = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
        Element::patch(Patch::new(&corners).expect("a parallelogram"), face)
    };
    (0..nu * nv).map(cell).collect()
}

/// A parallelogram as triangles.
pub(crate) fn sheet(origin: DVec3, u: DVec3, v: DVec3, face: u32) -> Vec<Triangle> {
    let [a, b, c, d] = [origin, origin + u, origin + u + v, origin + v];
    [[a, b, c], [a, c, d]].map(|vertices| Triangle { vertices, face }).to_vec()
}
