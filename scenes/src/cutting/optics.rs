//! What the elements of a mesh emit and reflect, a few bands at a time.

use farfield_radiosity::Surfel;

use crate::cutting::mesh::Mesh;
use crate::scene::{Quantity, Scene};

/// What every element emits and reflects, in as many bands as are solved for at once.
#[derive(Clone, Debug)]
pub struct Optics<const BANDS: usize> {
    /// Emitted exitance E \[W/m²\] of each element.
    pub emission: Vec<[f64; BANDS]>,
    /// Diffuse reflectance ρ.
    pub reflectance: Vec<[f64; BANDS]>,
}

impl<const BANDS: usize> Optics<BANDS> {
    /// The bands from number `first` on. `bands` is how many are solved for in all: a single one is the
    /// mean of all that the scene has. Bands beyond the last are black.
    pub fn new(scene: &Scene, mesh: &Mesh, quantity: Quantity, bands: usize, first: usize) -> Self {
        let taken = |values: &[f64]| -> [f64; BANDS] {
            if bands == 1 && values.len() > 1 {
                [values.iter().sum::<f64>() / values.len() as f64; BANDS]
            } else {
                std::array::from_fn(|k| values.get(first + k).copied().unwrap_or(0.0))
            }
        };
        let materials: Vec<_> = (0..scene.materials.len())
            .map(|k| (taken(&scene.emission(k, quantity)), taken(&scene.materials[k].reflectance)))
            .collect();
        let of = |&material: &u32| materials[material as usize];
        let (emission, reflectance) = mesh.material.iter().map(of).unzip();
        Self { emission, reflectance }
    }

    /// Adds what elements reflect of light that arrives from outside of the scene: `irradiance` of each element
    /// \[W/m²], alike in all bands.
    pub fn lit_by(mut self, irradiance: &[f64]) -> Self {
        let lit = self.emission.iter_mut().zip(&self.reflectance).zip(irradiance);
        for ((emission, reflectance), irradiance) in lit {
            emission.iter_mut().zip(reflectance).for_each(|(e, rho)| *e += rho * irradiance);
        }
        self
    }
}

impl Optics<1> {
    /// How much brighter than the mean each face may be, for what samples may leave out; none if all
    /// is dark.
    pub fn brightness(&self, surfels: &[Surfel]) -> Option<Vec<f64>> {
        let mut brightness: Vec<f64> = Vec::new();
        let (mut emitted, mut absorbed, mut area) = (0.0, 0.0, 0.0);
        for ((surfel, e), rho) in surfels.iter().zip(&self.emission).zip(&self.reflectance) {
            area += surfel.area;
            emitted += surfel.area * e[0];
            absorbed += surfel.area * (1.0 - rho[0]);
            let face = surfel.face as usize;
            if surfel.face != Surfel::<f64>::NO_FACE && e[0] > 0.0 {
                brightness.resize(brightness.len().max(face + 1), 0.0);
                brightness[face] = brightness[face].max(e[0]);
            }
        }
        // All light that is emitted is absorbed in the end: that is what it takes on average.
        let mean = emitted / absorbed.max(1e-3 * area);
        (mean > 0.0).then(|| brightness.into_iter().map(|e| (e / mean).max(1.0)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generators::generate;

    #[test]
    fn bands_are_taken_one_after_the_other_or_by_their_mean() {
        let mut scene = generate("furnace").expect("a scene");
        for material in &mut scene.materials {
            material.reflectance = vec![0.1, 0.2, 0.3, 0.8];
            material.emission = vec![4.0, 3.0, 2.0, 1.0];
            material.temperature = Some(100.0);
        }
        let mesh = Mesh::new(&scene, 6).expect("a mesh");
        let of = |first| Optics::<3>::new(&scene, &mesh, Quantity::Light, 4, first);
        assert_eq!(of(0).reflectance[5], [0.1, 0.2, 0.3]);
        assert_eq!((of(3).reflectance[0], of(3).emission[0]), ([0.8, 0.0, 0.0], [1.0, 0.0, 0.0]));
        let mean = Optics::<1>::new(&scene, &mesh, Quantity::Light, 1, 0);
        assert!((mean.reflectance[0][0] - 0.35).abs() < 1e-12);
        assert_eq!(mean.emission[0], [2.5]);
        let heat = Optics::<1>::new(&scene, &mesh, Quantity::Heat, 1, 0);
        assert!((heat.emission[0][0] / (0.65 * 5.670374419) - 1.0).abs() < 1e-12);
    }
}
