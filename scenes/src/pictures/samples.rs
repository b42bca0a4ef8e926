//! Elements for tests.

use farfield_radiosity::{Element, Patch, Triangle};
use glam::DVec3;

use crate::cutting::mesh::Mesh;
use crate::scene::Scene;
use crate::scene::material::Material;
use crate::scene::surface::ScenePoint;

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

/// The scene in which each of these patches, or disks, is a surface or a point of its own, and its mesh.
pub(crate) fn scene_of(elements: &[Element]) -> (Scene, Mesh) {
    let mut scene = Scene { materials: vec![Material::grey()], ..Scene::default() };
    for element in elements {
        let surfel = element.surfel();
        let (position, normal, area) = (surfel.position, surfel.normal, surfel.area);
        match element.as_patch() {
            Some(patch) => scene.add(patch.corners(), 0, surfel.face),
            None => scene.points.push(ScenePoint { position, normal, area, material: 0 }),
        }
    }
    let mesh = match elements {
        [] => Mesh::default(),
        _ => Mesh::with_cuts(&scene, &vec![[1, 1]; scene.surfaces.len()]).expect("valid"),
    };
    (scene, mesh)
}

/// A parallelogram as triangles.
pub(crate) fn sheet(origin: DVec3, u: DVec3, v: DVec3, face: u32) -> Vec<Triangle> {
    let [a, b, c, d] = [origin, origin + u, origin + u + v, origin + v];
    [[a, b, c], [a, c, d]].map(|vertices| Triangle { vertices, face }).to_vec()
}
