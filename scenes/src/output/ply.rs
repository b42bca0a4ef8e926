//! A mesh as text in the Polygon File Format (PLY).

use std::io::{self, Write};

use ply_rs_bw::ply::{
    Addable, ElementDef, Header, PropertyAccess, PropertyDef, PropertyType, ScalarType,
};
use ply_rs_bw::writer::Writer;

use crate::cutting::fields::{Fields, Row};
use crate::cutting::mesh::Mesh;
use crate::pictures::sight::outline;

/// Writes elements as faces with vertices of their own, disks as octagons, or, if there are only disks,
/// as points with normals. Colours, sRGB codes, are those of vertices; all numbers belong to the faces,
/// or to the points.
///
/// # Errors
/// Those of `file`, those of [`Fields::rows`], and [`io::ErrorKind::InvalidInput`] unless there is a
/// colour for every element.
pub(crate) fn write(
    file: &mut impl Write,
    mesh: &Mesh,
    fields: &Fields,
    codes: &[[u8; 3]],
) -> io::Result<()> {
    let rows = fields.rows(mesh)?;
    if codes.len() != mesh.elements.len() {
        let message = format!("{} colours for {} elements", codes.len(), mesh.elements.len());
        return Err(io::Error::new(io::ErrorKind::InvalidInput, message));
    }
    if mesh.elements.iter().all(|element| element.as_patch().is_none()) {
        let mut points = element("vertex", rows.len());
        add(&mut points, ScalarType::Double, ["x", "y", "z", "nx", "ny", "nz"]);
        add(&mut points, ScalarType::UChar, COLOURS);
        add_scalars(&mut points, fields.bands);
        let file = &mut begin(file, [&points])?;
        for (row, code) in rows.zip(codes) {
            let surfel = row.element.surfel();
            let place = [surfel.position, surfel.normal].map(|p| p.to_array()).into_iter();
            let code = code.map(f64::from);
            let numbers = place.flatten().chain(code).chain(scalars(&row)).collect();
            file.line(&points, numbers, Vec::new())?;
        }
        return Ok(());
    }

    let outlines = || mesh.elements.iter().map(outline);
    let mut vertices = element("vertex", outlines().map(|corners| corners.len()).sum());
    add(&mut vertices, ScalarType::Double, ["x", "y", "z"]);
    add(&mut vertices, ScalarType::UChar, COLOURS);
    let mut faces = element("face", mesh.elements.len());
    let list = PropertyType::List(ScalarType::UChar, ScalarType::UInt);
    faces.properties.add(PropertyDef::new("vertex_indices".to_owned(), list));
    add_scalars(&mut faces, fields.bands);
    let file = &mut begin(file, [&vertices, &faces])?;
    for (corners, code) in outlines().zip(codes) {
        for corner in corners {
            let numbers = corner.to_array().into_iter().chain(code.map(f64::from)).collect();
            file.line(&vertices, numbers, Vec::new())?;
        }
    }
    let mut first = 0;
    for (row, corners) in rows.zip(outlines()) {
        let next = first + corners.len() as u32;
        // The list has no number of its own.
        let numbers = std::iter::once(0.0).chain(scalars(&row)).collect();
        file.line(&faces, numbers, (first..next).collect())?;
        first = next;
    }
    Ok(())
}

const COLOURS: [&str; 3] = ["red", "green", "blue"];

/// The definition of `count` elements without properties.
fn element(name: &str, count: usize) -> ElementDef {
    ElementDef { count, ..ElementDef::new(name.to_owned()) }
}

fn add<const N: usize>(element: &mut ElementDef, scalar: ScalarType, names: [&str; N]) {
    for name in names {
        let kind = PropertyType::Scalar(scalar.clone());
        element.properties.add(PropertyDef::new(name.to_owned(), kind));
    }
}

/// The definitions of [`scalars`].
fn add_scalars(element: &mut ElementDef, bands: usize) {
    add(element, ScalarType::Double, ["area", "row_sum"]);
    add(element, ScalarType::UInt, ["material"]);
    for name in ["radiosity", "emission", "irradiance"] {
        (0..bands).for_each(|k| add(element, ScalarType::Double, [&format!("{name}_{k}")]));
    }
}

/// The numbers that belong to an element as a whole.
fn scalars<'a>(row: &Row<'a>) -> impl Iterator<Item = f64> + use<'a> {
    let own = [row.element.surfel().area, row.row_sum, f64::from(row.material)];
    let bands = [row.radiosity, row.emission, row.irradiance];
    own.into_iter().chain(bands.into_iter().flatten().copied())
}

/// A file whose header is written.
struct Body<'a, W> {
    file: &'a mut W,
    writer: Writer<Record<'a>>,
}

fn begin<'a, W: Write, const N: usize>(
    file: &'a mut W,
    elements: [&ElementDef; N],
) -> io::Result<Body<'a, W>> {
    let mut header = Header::new();
    elements.into_iter().for_each(|element| header.elements.add(element.clone()));
    let writer = Writer::new();
    writer.write_header(file, &header)?;
    Ok(Body { file, writer })
}

impl<'a, W: Write> Body<'a, W> {
    /// Writes the numbers of one element, in the order of its properties.
    fn line(
        &mut self,
        element: &'a ElementDef,
        numbers: Vec<f64>,
        corners: Vec<u32>,
    ) -> io::Result<()> {
        let record = Record { element: Some(element), numbers, corners };
        self.writer.write_ascii_element(self.file, &record, element).map(drop)
    }
}

/// One element as its writer asks for it.
#[derive(Default)]
struct Record<'a> {
    element: Option<&'a ElementDef>,
    numbers: Vec<f64>,
    corners: Vec<u32>,
}

impl Record<'_> {
    fn number(&self, name: &str) -> Option<f64> {
        self.numbers.get(self.element?.properties.get_index_of(name)?).copied()
    }
}

impl PropertyAccess for Record<'_> {
    fn new() -> Self {
        Self::default()
    }

    fn get_uchar(&self, name: &str) -> Option<u8> {
        self.number(name).map(|number| number as u8)
    }

    fn get_uint(&self, name: &str) -> Option<u32> {
        self.number(name).map(|number| number as u32)
    }

    fn get_double(&self, name: &str) -> Option<f64> {
        self.number(name)
    }

    fn get_list_uint(&self, _: &str) -> Option<&[u32]> {
        Some(&self.corners)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cutting::fields::tests::sample;

    const CODES: [[u8; 3]; 3] = [[1, 2, 3], [4, 5, 6], [7, 8, 255]];

    /// The names of the properties, and the lines of numbers after the header.
    fn read(mesh: &Mesh, fields: &Fields) -> (Vec<String>, Vec<Vec<f64>>) {
        let mut file = Vec::new();
        write(&mut file, mesh, fields, &CODES).expect("written");
        let text = String::from_utf8(file).expect("text");
        let (header, body) = text.split_once("end_header\n").expect("a header");
        let name = |line: &str| line.rsplit(' ').next().map(String::from);
        let names = header.lines().skip(2).filter_map(name).collect();
        let numbers = |line: &str| line.split(' ').map(|n| n.parse().expect("number")).collect();
        (names, body.lines().map(numbers).collect())
    }

    /// What ends the line of an element.
    fn expected(mesh: &Mesh, fields: &Fields, index: usize) -> Vec<f64> {
        let of = |field: &[f64]| field[2 * index..][..2].to_vec();
        let area = mesh.elements[index].surfel().area;
        let own = vec![area, fields.row_sums[index], f64::from(mesh.material[index])];
        [own, of(&fields.radiosity), of(&fields.emission), of(&fields.irradiance)].concat()
    }

    #[test]
    fn faces_have_their_own_vertices_and_exact_numbers() {
        let (mesh, fields) = sample(true);
        let (names, lines) = read(&mesh, &fields);
        let expected_names = "15 x y z red green blue 3 vertex_indices area row_sum material \
            radiosity_0 radiosity_1 emission_0 emission_1 irradiance_0 irradiance_1";
        assert_eq!(names.join(" "), expected_names);
        assert_eq!(lines.len(), 18);
        let mut first = 0;
        for (index, element) in mesh.elements.iter().enumerate() {
            let corners = outline(element);
            let face = &lines[15 + index];
            assert_eq!(face[0], corners.len() as f64);
            for (k, corner) in corners.iter().enumerate() {
                assert_eq!(face[1 + k], (first + k) as f64);
                assert_eq!(lines[first + k][..3], corner.to_array());
                assert_eq!(lines[first + k][3..], CODES[index].map(f64::from));
            }
            assert_eq!(face[1 + corners.len()..], expected(&mesh, &fields, index));
            first += corners.len();
        }
    }

    #[test]
    fn disks_alone_are_points() {
        let (mesh, fields) = sample(false);
        let (names, lines) = read(&mesh, &fields);
        assert_eq!(names[..10].join(" "), "3 x y z nx ny nz red green blue");
        assert_eq!(lines.len(), 3);
        for (index, line) in lines.iter().enumerate() {
            let surfel = mesh.elements[index].surfel();
            assert_eq!(line[..3], surfel.position.to_array());
            assert_eq!(line[3..6], surfel.normal.to_array());
            assert_eq!(line[6..9], CODES[index].map(f64::from));
            assert_eq!(line[9..], expected(&mesh, &fields, index));
        }
        assert!(write(&mut Vec::new(), &mesh, &fields, &CODES[..2]).is_err());
    }
}
