//! Elements that exchange light by direct sums, for tests.

use farfield::direct_masked;
use farfield_radiosity::{Enclosure, Irradiance, Occluders, RadiosityOperator, Surfel, Visibility};
use farfield_scenes::{Mesh, Scene, generate};

use super::solve::Exchange;

/// Calls `test` with a generated scene, cut into about so many elements, and with how these exchange light:
/// every pair by itself, and closed if an enclosure is given.
pub(crate) fn exchanging<const BANDS: usize>(
    scene: &str,
    elements: usize,
    enclosure: Option<Enclosure>,
    test: impl FnOnce(&Scene, &Mesh, &Exchange<'_, BANDS>),
) {
    let scene = generate(scene).expect("a scene");
    let mesh = Mesh::new(&scene, elements).expect("a mesh");
    let occluders = Occluders::new(&mesh.triangles).expect("finite");
    let visibility = Visibility::of_elements(&occluders, &mesh.elements);
    let surfels: Vec<Surfel> = mesh.elements.iter().map(|e| *e.surfel()).collect();
    let corrections = visibility.corrections(&mesh.elements, 1e-2).expect("finite");
    let kernel = Irradiance::<f64, [f64; BANDS]>::clamped();
    let sum = |b: &[[f64; BANDS]]| direct_masked(&kernel, &visibility, &surfels, b, &surfels);
    let mut operator = RadiosityOperator::new(&mesh.elements, sum, corrections).expect("one each");
    if let Some(enclosure) = enclosure {
        operator.close(enclosure, 0.5).expect("it can be closed");
    }
    let exchange = Exchange { surfels: &surfels, operator: &operator, visibility: &visibility };
    test(&scene, &mesh, &exchange);
}
