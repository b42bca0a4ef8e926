//! A mesh as text in the Stanford polygon format.

use std::io::{self, Write};

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
    let only_points = mesh.elements.iter().all(|element| element.as_patch().is_none());
    let outlines = || mesh.elements.iter().map(outline);
    let vertices = if only_points {
        mesh.elements.len()
    } else {
        outlines().map(|corners| corners.len()).sum()
    };
    writeln!(file, "ply\nformat ascii 1.0\nelement vertex {vertices}")?;
    properties(file, "double", ["x", "y", "z"])?;
    if only_points {
        properties(file, "double", ["nx", "ny", "nz"])?;
    }
    properties(file, "uchar", ["red", "green", "blue"])?;
    if !only_points {
        writeln!(file, "element face {}", mesh.elements.len())?;
        writeln!(file, "property list uchar uint vertex_indices")?;
    }
    scalar_properties(file, fields.bands)?;
    writeln!(file, "end_header")?;
    if only_points {
        for (row, [r, g, b]) in rows.zip(codes) {
            let surfel = row.element.surfel();
            let (p, n) = (surfel.position, surfel.normal);
            write!(file, "{:?} {:?} {:?} {:?} {:?} {:?}", p.x, p.y, p.z, n.x, n.y, n.z)?;
            write!(file, " {r} {g} {b}")?;
            scalars(file, &row)?;
        }
        return Ok(());
    }
    for (corners, [r, g, b]) in outlines().zip(codes) {
        for p in corners {
            writeln!(file, "{:?} {:?} {:?} {r} {g} {b}", p.x, p.y, p.z)?;
        }
    }
    let mut first = 0;
    for (row, corners) in rows.zip(outlines()) {
        write!(file, "{}", corners.len())?;
        (first..first + corners.len()).try_for_each(|vertex| write!(file, " {vertex}"))?;
        first += corners.len();
        scalars(file, &row)?;
    }
    Ok(())
}

fn properties<const N: usize>(
    file: &mut impl Write,
    kind: &str,
    names: [&str; N],
) -> io::Result<()> {
    names.iter().try_for_each(|name| writeln!(file, "property {kind} {name}"))
}

/// The names of [`scalars`].
fn scalar_properties(file: &mut impl Write, bands: usize) -> io::Result<()> {
    properties(file, "double", ["area", "row_sum"])?;
    properties(file, "uint", ["material"])?;
    for name in ["radiosity", "emission", "irradiance"] {
        (0..bands).try_for_each(|band| writeln!(file, "property double {name}_{band}"))?;
    }
    Ok(())
}

/// The rest of an element's line.
fn scalars(file: &mut impl Write, row: &Row) -> io::Result<()> {
    write!(file, " {:?} {:?} {}", row.element.surfel().area, row.row_sum, row.material)?;
    for field in [row.radiosity, row.emission, row.irradiance] {
        field.iter().try_for_each(|number| write!(file, " {number:?}"))?;
    }
    writeln!(file)
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
