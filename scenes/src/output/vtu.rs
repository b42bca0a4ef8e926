//! A mesh as an unstructured grid in the XML format of the Visualization Toolkit.

use std::io::{self, Write};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use crate::cutting::fields::{Fields, Row};
use crate::cutting::mesh::Mesh;
use crate::pictures::sight::outline;

/// Writes elements as cells with points of their own, disks as octagons: radiosity B, emitted exitance
/// E and irradiance H with the bands as components, area, sum of form factors and material of each.
///
/// # Errors
/// Those of `file`, and those of [`Fields::rows`].
pub(crate) fn write(file: &mut impl Write, mesh: &Mesh, fields: &Fields) -> io::Result<()> {
    let rows = fields.rows(mesh)?;
    let outlines: Vec<_> = mesh.elements.iter().map(outline).collect();
    let points = outlines.iter().map(Vec::len).sum::<usize>();
    let ends = outlines.iter().scan(0, |end, corners| {
        *end += corners.len() as i64;
        Some(*end)
    });
    writeln!(file, "<?xml version=\"1.0\"?>")?;
    writeln!(
        file,
        "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" \
         header_type=\"UInt64\">"
    )?;
    let cells = mesh.elements.len();
    writeln!(file, "<UnstructuredGrid>")?;
    writeln!(file, "<Piece NumberOfPoints=\"{points}\" NumberOfCells=\"{cells}\">")?;

    writeln!(file, "<Points>")?;
    let coordinates = outlines.iter().flatten().flat_map(|corner| corner.to_array());
    array(file, "Points", Some(3), coordinates)?;
    writeln!(file, "</Points>\n<Cells>")?;
    array(file, "connectivity", None, 0..points as i64)?;
    array(file, "offsets", None, ends)?;
    array(file, "types", None, outlines.iter().map(|corners| cell_type(corners.len())))?;
    writeln!(file, "</Cells>\n<CellData>")?;
    type Column = fn(&Row<'_>) -> Vec<f64>;
    let columns: [(&str, Column); 3] = [
        ("B", |row| row.radiosity.to_vec()),
        ("E", |row| row.emission.to_vec()),
        ("H", |row| row.irradiance.to_vec()),
    ];
    for (name, column) in columns {
        array(file, name, Some(fields.bands), rows.clone().flat_map(|row| column(&row)))?;
    }
    array(file, "area", None, rows.clone().map(|row| row.element.surfel().area))?;
    array(file, "row_sum", None, rows.clone().map(|row| row.row_sum))?;
    array(file, "material", None, rows.map(|row| i64::from(row.material)))?;
    writeln!(file, "</CellData>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>")
}

/// A number as the format knows it.
trait Number: Copy {
    /// Its type's name.
    const NAME: &'static str;
    /// Appends its bytes, the lowest first.
    fn append(self, bytes: &mut Vec<u8>);
}

impl Number for f64 {
    const NAME: &'static str = "Float64";

    fn append(self, bytes: &mut Vec<u8>) {
        bytes.extend(self.to_le_bytes());
    }
}

impl Number for i64 {
    const NAME: &'static str = "Int64";

    fn append(self, bytes: &mut Vec<u8>) {
        bytes.extend(self.to_le_bytes());
    }
}

impl Number for u8 {
    const NAME: &'static str = "UInt8";

    fn append(self, bytes: &mut Vec<u8>) {
        bytes.push(self);
    }
}

/// A triangle, a quadrangle, or a polygon of more corners.
fn cell_type(corners: usize) -> u8 {
    match corners {
        3 => 5,
        4 => 9,
        _ => 7,
    }
}

/// Writes one array: the number of its bytes and these, all in base 64.
fn array<T: Number>(
    file: &mut impl Write,
    name: &str,
    components: Option<usize>,
    numbers: impl Iterator<Item = T>,
) -> io::Result<()> {
    let mut bytes = vec![0; size_of::<u64>()];
    numbers.for_each(|number| number.append(&mut bytes));
    let length = (bytes.len() - size_of::<u64>()) as u64;
    bytes[..size_of::<u64>()].copy_from_slice(&length.to_le_bytes());
    let components =
        components.map_or(String::new(), |count| format!(" NumberOfComponents=\"{count}\""));
    let kind = T::NAME;
    writeln!(file, "<DataArray type=\"{kind}\" Name=\"{name}\"{components} format=\"binary\">")?;
    writeln!(file, "{}\n</DataArray>", STANDARD.encode(&bytes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cutting::fields::tests::sample;

    /// What base 64 stands for, bit by bit.
    fn decoded(text: &str) -> Vec<u8> {
        let alphabet = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
        let digits = text.trim_end_matches('=').chars();
        let bits: Vec<u8> = digits
            .map(|digit| alphabet.find(digit).expect("a digit") as u8)
            .flat_map(|digit| (0..6).rev().map(move |bit| digit >> bit & 1))
            .collect();
        bits.chunks_exact(8).map(|byte| byte.iter().fold(0, |sum, bit| 2 * sum + bit)).collect()
    }

    /// The attributes and the bytes of an array.
    fn array<'a>(text: &'a str, name: &str) -> (&'a str, Vec<u8>) {
        let at = text.find(&format!("Name=\"{name}\"")).expect("the array");
        let start = text[..at].rfind('<').expect("its tag");
        let (tag, rest) = text[start..].split_once(">\n").expect("its end");
        let bytes = decoded(rest.lines().next().expect("its bytes"));
        let length = u64::from_le_bytes(bytes[..8].try_into().expect("eight bytes"));
        assert_eq!(length as usize, bytes.len() - 8);
        (tag, bytes[8..].to_vec())
    }

    fn doubles(bytes: &[u8]) -> Vec<f64> {
        bytes.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().expect("eight"))).collect()
    }

    fn integers(bytes: &[u8]) -> Vec<i64> {
        bytes.chunks_exact(8).map(|b| i64::from_le_bytes(b.try_into().expect("eight"))).collect()
    }

    #[test]
    fn every_array_holds_the_exact_numbers() {
        let (mesh, fields) = sample(true);
        let mut file = Vec::new();
        write(&mut file, &mesh, &fields).expect("written");
        let text = String::from_utf8(file).expect("text");
        assert!(text.contains("<Piece NumberOfPoints=\"15\" NumberOfCells=\"3\">"));

        let (tag, bytes) = array(&text, "Points");
        assert!(tag.contains("type=\"Float64\"") && tag.contains("NumberOfComponents=\"3\""));
        let corners = mesh.elements.iter().flat_map(outline).flat_map(|p| p.to_array());
        assert_eq!(doubles(&bytes), corners.collect::<Vec<_>>());
        assert_eq!(integers(&array(&text, "connectivity").1), (0..15).collect::<Vec<_>>());
        assert_eq!(integers(&array(&text, "offsets").1), [3, 7, 15]);
        assert_eq!(array(&text, "types").1, [5, 9, 7]);

        let all = [("B", &fields.radiosity), ("E", &fields.emission), ("H", &fields.irradiance)];
        for (name, field) in all {
            let (tag, bytes) = array(&text, name);
            assert!(tag.contains("NumberOfComponents=\"2\""), "{tag}");
            assert_eq!(doubles(&bytes), *field);
        }
        let areas: Vec<_> = mesh.elements.iter().map(|element| element.surfel().area).collect();
        assert_eq!(doubles(&array(&text, "area").1), areas);
        assert_eq!(doubles(&array(&text, "row_sum").1), fields.row_sums);
        assert_eq!(integers(&array(&text, "material").1), [4, 0, 70_000]);
    }

    #[test]
    fn tags_are_closed_in_order() {
        let (mesh, fields) = sample(false);
        let mut file = Vec::new();
        write(&mut file, &mesh, &fields).expect("written");
        let text = String::from_utf8(file).expect("text");
        let mut open = Vec::new();
        for tag in text.split('<').filter_map(|part| part.split_once('>')).map(|(tag, _)| tag) {
            let name = tag.split(' ').next().expect("a name");
            match name.strip_prefix('/') {
                Some(name) => assert_eq!(open.pop(), Some(name)),
                None if !name.starts_with('?') => open.push(name),
                None => (),
            }
        }
        assert!(open.is_empty());
    }
}
