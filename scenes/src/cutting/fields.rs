//! Fields on a mesh: one number per element and band.

use std::io;

use farfield_radiosity::Element;

use crate::cutting::mesh::Mesh;

/// Fields on a mesh, as files and pictures show them. All bands of the first element come first, then
/// those of the second, and so on.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fields {
    /// Number of bands.
    pub bands: usize,
    /// Radiosity B \[W/m²\].
    pub radiosity: Vec<f64>,
    /// Emitted exitance E \[W/m²\].
    pub emission: Vec<f64>,
    /// Irradiance H \[W/m²\].
    pub irradiance: Vec<f64>,
    /// The sum of an element's form factors to all others, one number per element: 1 in a closed room.
    pub row_sums: Vec<f64>,
}

/// One element with its numbers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row<'a> {
    /// The element.
    pub(crate) element: &'a Element,
    /// Index of its material.
    pub(crate) material: u32,
    /// The sum of its form factors.
    pub(crate) row_sum: f64,
    /// Its radiosity, band by band.
    pub(crate) radiosity: &'a [f64],
    /// Its emitted exitance.
    pub(crate) emission: &'a [f64],
    /// Its irradiance.
    pub(crate) irradiance: &'a [f64],
}

impl Fields {
    /// The elements of `mesh` with their numbers, one after the other.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidInput`] unless there are as many numbers as the elements need.
    pub(crate) fn rows<'a>(
        &'a self,
        mesh: &'a Mesh,
    ) -> io::Result<impl ExactSizeIterator<Item = Row<'a>> + Clone> {
        let (count, bands) = (mesh.elements.len(), self.bands);
        let of_bands = [&self.radiosity, &self.emission, &self.irradiance];
        if of_bands.iter().any(|field| field.len() != count * bands)
            || self.row_sums.len() != count
            || mesh.material.len() != count
        {
            let message = format!("numbers don't match {count} elements of {bands} bands");
            return Err(io::Error::new(io::ErrorKind::InvalidInput, message));
        }
        Ok((0..count).map(move |index| {
            let of = |field: &'a [f64]| &field[index * bands..][..bands];
            Row {
                element: &mesh.elements[index],
                material: mesh.material[index],
                row_sum: self.row_sums[index],
                radiosity: of(&self.radiosity),
                emission: of(&self.emission),
                irradiance: of(&self.irradiance),
            }
        }))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use farfield_radiosity::{Patch, Surfel};
    use glam::DVec3;

    /// A disk, with a triangle and a quadrangle before it or two more disks, and two bands of numbers
    /// that no decimal fraction ends.
    pub(crate) fn sample(patches: bool) -> (Mesh, Fields) {
        let [x, y, z] = DVec3::AXES;
        let patch = |corners: &[DVec3]| Element::patch(Patch::new(corners).expect("flat"), 0);
        let disk = |k: usize| {
            let position = z / 3.0 + k as f64 * x;
            Element::disk(Surfel { position, normal: y, area: 0.1 + k as f64, face: 1 })
        };
        let elements = if patches {
            vec![patch(&[y, y + z, x / 7.0]), patch(&[x, x + y, y, 0.0 * z]), disk(2)]
        } else {
            (0..3).map(disk).collect()
        };
        let numbers = |count: usize, scale: f64| (1..=count).map(|k| scale / k as f64).collect();
        let fields = Fields {
            bands: 2,
            radiosity: numbers(6, 1e-3),
            emission: numbers(6, -5e7),
            irradiance: numbers(6, 11.0),
            row_sums: numbers(3, 1.0),
        };
        let mesh = Mesh { elements, material: vec![4, 0, 70_000], ..Mesh::default() };
        (mesh, fields)
    }

    #[test]
    fn rows_have_the_numbers_of_their_elements() {
        let (mesh, fields) = sample(true);
        let rows: Vec<_> = fields.rows(&mesh).expect("matching").collect();
        assert_eq!((rows.len(), rows[1].material, rows[2].row_sum), (3, 0, 1.0 / 3.0));
        assert_eq!(rows[1].irradiance, &fields.irradiance[2..4]);
        assert_eq!(Fields::default().rows(&Mesh::default()).expect("none").len(), 0);
    }

    #[test]
    fn numbers_that_do_not_match_the_mesh_are_refused() {
        let (mesh, fields) = sample(true);
        let refused = |fields: &Fields| fields.rows(&mesh).is_err();
        assert!(refused(&Fields { bands: 3, ..fields.clone() }));
        assert!(refused(&Fields { row_sums: vec![1.0], ..fields.clone() }));
        assert!(refused(&Fields { emission: Vec::new(), ..fields.clone() }));
        let short = Mesh { material: vec![0], ..mesh.clone() };
        assert!(fields.rows(&short).is_err());
    }
}
