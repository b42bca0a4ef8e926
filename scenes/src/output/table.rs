//! A table of all elements: position, normal, area, material, sum of form factors, and light by bands.

use std::io::{self, Write};

use crate::cutting::fields::{Fields, Row};
use crate::cutting::mesh::Mesh;

/// Writes comma-separated values: a line of names, then one per element, with all digits that tell a
/// number from its neighbours.
///
/// # Errors
/// Those of `file`, and those of [`Fields::rows`].
pub(crate) fn csv(file: &mut impl Write, mesh: &Mesh, fields: &Fields) -> io::Result<()> {
    let rows = fields.rows(mesh)?;
    writeln!(file, "{}", names(fields.bands).join(","))?;
    for row in rows {
        for (column, number) in numbers(&row).enumerate() {
            let separator = if column > 0 { "," } else { "" };
            if column == MATERIAL {
                write!(file, "{separator}{number}")?;
            } else {
                // Scientific notation where plain digits would be many.
                write!(file, "{separator}{number:?}")?;
            }
        }
        writeln!(file)?;
    }
    Ok(())
}

/// All elements with their numbers: what a CSV file holds, as a matrix with a row for each element.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Table {
    /// The names of the columns.
    pub columns: Vec<String>,
    /// The numbers, row by row.
    pub numbers: Vec<f64>,
}

impl Table {
    /// The numbers of a mesh and of fields on it.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidInput`] unless there are as many numbers as the elements need.
    pub fn new(mesh: &Mesh, fields: &Fields) -> io::Result<Self> {
        let rows = fields.rows(mesh)?;
        let numbers = rows.flat_map(|row| numbers(&row).collect::<Vec<_>>()).collect();
        Ok(Self { columns: names(fields.bands), numbers })
    }
}

/// Names of the first columns; the others are B, E and H of each band.
const NAMES: [&str; 9] = ["x", "y", "z", "nx", "ny", "nz", "area", "material", "row_sum"];
/// The column that holds whole numbers.
const MATERIAL: usize = 7;

fn names(bands: usize) -> Vec<String> {
    let fixed = NAMES.into_iter().map(String::from);
    fixed
        .chain((0..bands).flat_map(|k| ["B", "E", "H"].map(|name| format!("{name}_{k}"))))
        .collect()
}

fn numbers<'a>(row: &Row<'a>) -> impl Iterator<Item = f64> + use<'a> {
    let &Row { element, material, row_sum, radiosity, emission, irradiance } = row;
    let surfel = element.surfel();
    let place = surfel.position.to_array().into_iter().chain(surfel.normal.to_array());
    let bands = (0..radiosity.len()).flat_map(move |k| [radiosity[k], emission[k], irradiance[k]]);
    place.chain([surfel.area, f64::from(material), row_sum]).chain(bands)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cutting::fields::tests::sample;

    #[test]
    fn table_and_text_hold_the_exact_numbers() {
        let (mesh, fields) = sample(true);
        let mut text = Vec::new();
        csv(&mut text, &mesh, &fields).expect("written");
        let table = Table::new(&mesh, &fields).expect("matching");
        assert_eq!((table.columns.len(), table.numbers.len()), (15, 3 * 15));
        let text = String::from_utf8(text).expect("text");
        let mut lines = text.lines();
        let header = "x,y,z,nx,ny,nz,area,material,row_sum,B_0,E_0,H_0,B_1,E_1,H_1";
        assert_eq!(lines.next(), Some(header));
        assert_eq!(table.columns.join(","), header);
        for (index, line) in lines.by_ref().enumerate() {
            let numbers: Vec<f64> =
                line.split(',').map(|number| number.parse().expect("a number")).collect();
            assert_eq!(numbers, table.numbers[15 * index..][..15]);
            let surfel = mesh.elements[index].surfel();
            assert_eq!(numbers[..3], surfel.position.to_array());
            assert_eq!(numbers[3..6], surfel.normal.to_array());
            let own = [surfel.area, f64::from(mesh.material[index]), fields.row_sums[index]];
            assert_eq!(numbers[6..9], own);
            for band in 0..2 {
                let k = 2 * index + band;
                let of_band = [fields.radiosity[k], fields.emission[k], fields.irradiance[k]];
                assert_eq!(numbers[9 + 3 * band..][..3], of_band);
            }
        }
        assert_eq!(text.lines().count(), 4);
        assert_eq!(text.lines().nth(3).and_then(|line| line.split(',').nth(7)), Some("70000"));
    }
}
