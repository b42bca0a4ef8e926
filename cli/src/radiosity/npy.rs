//! The table of all elements in NumPy's format.

use std::io::{self, Write};

use farfield_scenes::Table;
use ndarray::ArrayView2;
use ndarray_npy::WriteNpyExt;

/// Writes the numbers of a CSV file as a matrix of doubles with a row for each element.
///
/// # Errors
/// Those of `file`.
pub(crate) fn write(file: &mut impl Write, table: &Table) -> io::Result<()> {
    let columns = table.columns.len();
    let shape = (table.numbers.len() / columns, columns);
    let matrix = ArrayView2::from_shape(shape, &table.numbers).map_err(io::Error::other)?;
    matrix.write_npy(file).map_err(io::Error::other)
}

#[cfg(test)]
mod tests {
    use super::*;
    use farfield_scenes::{Fields, Mesh, generate};
    use ndarray::Array2;
    use ndarray_npy::ReadNpyExt;

    #[test]
    fn the_matrix_holds_the_exact_numbers() {
        let mesh = Mesh::new(&generate("furnace").expect("a scene"), 24).expect("a mesh");
        let count = mesh.elements.len();
        let numbers = |count: usize, scale: f64| (1..=count).map(|k| scale / k as f64).collect();
        let fields = Fields {
            bands: 2,
            radiosity: numbers(2 * count, 1e-3),
            emission: numbers(2 * count, -5e7),
            irradiance: numbers(2 * count, 11.0),
            row_sums: numbers(count, 1.0),
        };
        let table = Table::new(&mesh, &fields).expect("matching");
        let mut bytes = Vec::new();
        write(&mut bytes, &table).expect("written");
        let matrix = Array2::<f64>::read_npy(&bytes[..]).expect("readable");
        assert_eq!(matrix.dim(), (count, 15));
        assert_eq!(matrix.into_raw_vec_and_offset().0, table.numbers);
    }
}
