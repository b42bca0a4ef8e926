//! Elements as a renderer takes them: vertices that neighbours share, with what arrives at each.

use farfield_radiosity::Error;
use glam::DVec3;

use crate::cutting::fields::Fields;
use crate::cutting::mesh::Mesh;
use crate::pictures::colours::Colours;
use crate::pictures::sight::{Sight, outline};
use crate::pictures::smooth::Smooth;
use crate::pictures::tone::Rgb;

/// The elements of a mesh as polygons of shared vertices, and the irradiance at each vertex.
#[derive(Clone, Debug)]
pub struct Shading {
    /// Where the vertices are.
    pub(crate) positions: Vec<DVec3>,
    /// The irradiance there \[W/m²], in the bands that the colours take.
    pub(crate) irradiance: Vec<Rgb>,
    /// The vertices at the corners of all elements, one element after the other, counter-clockwise around fronts.
    corners: Vec<u32>,
    /// Where each element's corners begin, and where the last one's end.
    starts: Vec<u32>,
}

impl Shading {
    /// Elements that share the vertices of smooth surfaces, with the irradiance that pictures show there; disks are
    /// octagons of one irradiance. Takes rays for each element and vertex.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] unless the fields match the mesh.
    pub fn smooth(sight: &Sight, fields: &Fields, colours: &Colours) -> Result<Self, Error> {
        let elements = &sight.mesh.elements;
        check(elements.len(), fields)?;
        let means: Vec<Rgb> = means(fields, colours).collect();
        let smooth = Smooth::new(elements, sight, sight.occluders(), &means);
        let mut shading = Self {
            positions: smooth.positions().collect(),
            irradiance: smooth.values().to_vec(),
            corners: Vec::new(),
            starts: vec![0],
        };
        for (index, element) in elements.iter().enumerate() {
            match element.as_patch() {
                Some(patch) => {
                    shading.corners.extend(&smooth.corners(index)[..patch.corners().len()]);
                    shading.starts.push(shading.corners.len() as u32);
                }
                None => shading.add(&outline(element), means[index]),
            }
        }
        Ok(shading)
    }

    /// Elements with vertices of their own, all of an element's with its own irradiance.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] unless the fields match the mesh.
    pub fn constant(mesh: &Mesh, fields: &Fields, colours: &Colours) -> Result<Self, Error> {
        check(mesh.elements.len(), fields)?;
        let mut shading = Self {
            positions: Vec::new(),
            irradiance: Vec::new(),
            corners: Vec::new(),
            starts: vec![0],
        };
        let means = means(fields, colours);
        mesh.elements.iter().zip(means).for_each(|(e, mean)| shading.add(&outline(e), mean));
        Ok(shading)
    }

    /// The vertices at the corners of an element.
    pub(crate) fn corners(&self, element: usize) -> &[u32] {
        &self.corners[self.starts[element] as usize..self.starts[element + 1] as usize]
    }

    /// All corners, one element after the other.
    pub(crate) fn all_corners(&self) -> &[u32] {
        &self.corners
    }

    /// How many elements there are.
    pub(crate) fn elements(&self) -> usize {
        self.starts.len() - 1
    }

    /// Adds an element with vertices of its own.
    fn add(&mut self, corners: &[DVec3], irradiance: Rgb) {
        let first = self.positions.len() as u32;
        self.positions.extend(corners);
        self.irradiance.resize(self.positions.len(), irradiance);
        self.corners.extend(first..self.positions.len() as u32);
        self.starts.push(self.corners.len() as u32);
    }
}

/// The irradiance of each element.
fn means(fields: &Fields, colours: &Colours) -> impl Iterator<Item = Rgb> {
    fields.irradiance.chunks(fields.bands.max(1)).map(|bands| colours.bands(bands))
}

/// Checks that there is a number for every element and band.
fn check(elements: usize, fields: &Fields) -> Result<(), Error> {
    let expected = elements * fields.bands.max(1);
    for (what, field) in [("irradiance", &fields.irradiance), ("emission", &fields.emission)] {
        if field.len() != expected {
            return Err(Error::LengthMismatch { what, expected, found: field.len() });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generators::generate;
    use crate::scene::Quantity;

    #[test]
    fn neighbours_share_vertices_and_elements_keep_their_corners() {
        let scene = generate("cornell").expect("listed");
        let mesh = Mesh::new(&scene, 600).expect("valid");
        let sight = Sight::new(&scene, &mesh).expect("finite");
        let count = mesh.elements.len();
        let fields = Fields {
            bands: 1,
            irradiance: (0..count).map(|k| mesh.elements[k].surfel().position.x + 1.0).collect(),
            emission: vec![0.0; count],
            ..Fields::default()
        };
        let colours = Colours::of_elements(&fields, Quantity::Light);
        let smooth = Shading::smooth(&sight, &fields, &colours).expect("matching");
        let constant = Shading::constant(&mesh, &fields, &colours).expect("matching");
        assert!(smooth.positions.len() < constant.positions.len() / 2);
        assert_eq!((smooth.elements(), constant.elements()), (count, count));
        for (index, element) in mesh.elements.iter().enumerate() {
            let corners = outline(element);
            for shading in [&smooth, &constant] {
                let places = shading.corners(index).iter().map(|&k| shading.positions[k as usize]);
                assert!(places.zip(&corners).all(|(p, q)| p.distance(*q) < 1e-3));
            }
            let own = constant.corners(index).iter().map(|&k| constant.irradiance[k as usize]);
            assert!(own.into_iter().all(|h| h == [fields.irradiance[index]; 3]));
        }
        // The field is linear: so it is at the vertices.
        let off = |k: usize| (smooth.irradiance[k][0] - smooth.positions[k].x - 1.0).abs();
        assert!((0..smooth.positions.len()).filter(|&k| off(k) > 1.0).count() < 20);
        let short = Fields { irradiance: vec![1.0], ..fields };
        assert!(Shading::smooth(&sight, &short, &colours).is_err());
        assert!(Shading::constant(&mesh, &short, &colours).is_err());
    }
}
