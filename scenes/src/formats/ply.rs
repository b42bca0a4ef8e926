//! Meshes and oriented points from the Polygon File Format (PLY), ASCII and binary.

use std::path::Path;

use glam::DVec3;
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Property, PropertyAccess, PropertyAccessResult, PropertyType};

use crate::formats::text::{BYTE_ORDER_MARK, read_bytes};
use crate::repair::point_areas::areas;
use crate::repair::soup::Soup;
use crate::scene::Scene;
use crate::scene::error::SceneError;
use crate::scene::material::Material;
use crate::scene::surface::ScenePoint;

/// The mesh in a PLY file or, if there are no faces in it, its oriented points; all of it grey.
///
/// Vertices have the properties x, y, z, and as points also nx, ny, nz and an area or a radius; where
/// that is missing, the area is estimated from the distances to the nearest neighbours. Faces have a
/// list `vertex_indices` or `vertex_index`.
///
/// # Errors
/// [`SceneError::Read`], [`SceneError::Ply`] if the format isn't met, [`SceneError::File`] for missing
/// properties, or [`SceneError::Entry`] for what is wrong with a vertex or a face.
pub(crate) fn read(path: &Path) -> Result<Scene, SceneError> {
    let bytes = read_bytes(path)?;
    let bytes = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&bytes);
    let Elements { vertices, faces, oriented } = elements(path, bytes)?;
    if let Some(index) = vertices.iter().position(|v| !v.position.is_finite()) {
        let expected = format!("finite coordinates, found {}", vertices[index].position);
        return Err(SceneError::Entry { path: path.to_owned(), kind: "vertex", index, expected });
    }
    if !faces.is_empty() {
        mesh(path, &vertices, faces)
    } else if oriented {
        points(path, &vertices)
    } else {
        Err(file_refusal(path, "faces, or a normal nx, ny, nz of every vertex"))
    }
}

/// What there is in a file.
#[derive(Clone, Debug, Default)]
struct Elements {
    vertices: Vec<Vertex>,
    faces: Vec<Face>,
    /// Whether the vertices have normals.
    oriented: bool,
}

/// A vertex or an oriented point.
#[derive(Clone, Copy, Debug, Default)]
struct Vertex {
    position: DVec3,
    normal: DVec3,
    area: Option<f64>,
    radius: Option<f64>,
}

/// A face: its vertices, unless they aren't integers from 0 on, or missing.
#[derive(Clone, Debug, Default)]
struct Face {
    corners: Option<Vec<u32>>,
}

/// What is of no use here.
#[derive(Clone, Copy, Debug, Default)]
struct Passed;

impl Vertex {
    /// The area, or that of a disk of the radius.
    fn given_area(&self) -> Option<f64> {
        self.area.or_else(|| self.radius.map(|radius| std::f64::consts::PI * radius * radius))
    }
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let Some(value) = number(&property) else { return PropertyAccessResult::Ignored };
        match name {
            "x" => self.position.x = value,
            "y" => self.position.y = value,
            "z" => self.position.z = value,
            "nx" => self.normal.x = value,
            "ny" => self.normal.y = value,
            "nz" => self.normal.z = value,
            "area" => self.area = Some(value),
            "radius" => self.radius = Some(value),
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !["vertex_indices", "vertex_index"].contains(&name) {
            return PropertyAccessResult::Ignored;
        }
        self.corners = property.to_u32_list();
        PropertyAccessResult::Set
    }
}

impl PropertyAccess for Passed {
    fn new() -> Self {
        Self
    }
}

/// The value of a scalar property.
fn number(property: &Property) -> Option<f64> {
    match *property {
        Property::Char(value) => Some(value.into()),
        Property::UChar(value) => Some(value.into()),
        Property::Short(value) => Some(value.into()),
        Property::UShort(value) => Some(value.into()),
        Property::Int(value) => Some(value.into()),
        Property::UInt(value) => Some(value.into()),
        Property::Float(value) => Some(value.into()),
        Property::Double(value) => Some(value),
        _ => None,
    }
}

fn is_scalar(element: &ElementDef, name: &str) -> bool {
    let property = element.properties.get(name);
    property.is_some_and(|property| matches!(property.data_type, PropertyType::Scalar(_)))
}

/// The elements in a file of these bytes.
fn elements(path: &Path, bytes: &[u8]) -> Result<Elements, SceneError> {
    let refusal = |error: ParseError| {
        // The reader's messages run over several lines.
        let problem = error.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        SceneError::Ply { path: path.to_owned(), problem }
    };
    let mut reader = Reader::new(bytes);
    let header = Parser::<Passed>::new().read_header(&mut reader).map_err(refusal)?;
    let mut all = Elements::default();
    for element in header.elements.values() {
        if element.properties.is_empty() && element.count > 0 {
            // Any number of them would take no bytes in a binary file.
            return Err(file_refusal(path, "properties of every element"));
        }
        let has = |names: [&str; 3]| names.iter().all(|name| is_scalar(element, name));
        match element.name.as_str() {
            "vertex" if has(["x", "y", "z"]) => {
                let vertices =
                    Parser::new().read_payload_for_element(&mut reader, element, &header);
                all.vertices = vertices.map_err(refusal)?;
                all.oriented = has(["nx", "ny", "nz"]);
            }
            "vertex" => return Err(file_refusal(path, "numbers x, y and z of every vertex")),
            "face" => {
                let faces = Parser::new().read_payload_for_element(&mut reader, element, &header);
                all.faces = faces.map_err(refusal)?;
            }
            _ => {
                let parser = Parser::<Passed>::new();
                let passed = parser.read_payload_for_element(&mut reader, element, &header);
                passed.map_err(refusal)?;
            }
        }
    }
    Ok(all)
}

/// The scene of a mesh.
fn mesh(path: &Path, vertices: &[Vertex], faces: Vec<Face>) -> Result<Scene, SceneError> {
    let mut soup = Soup::default();
    vertices.iter().for_each(|v| soup.add_vertex(v.position));
    for (index, face) in faces.into_iter().enumerate() {
        if !face.corners.is_some_and(|corners| soup.add_polygon(&corners, 0)) {
            let expected = format!("a list of vertices below {}", vertices.len());
            let path = path.to_owned();
            return Err(SceneError::Entry { path, kind: "face", index, expected });
        }
    }
    Ok(soup.into_scene(vec![Material::grey()]))
}

/// The scene of oriented points.
fn points(path: &Path, vertices: &[Vertex]) -> Result<Scene, SceneError> {
    let wrong = |v: &Vertex| {
        let positive = |value: f64| value > 0.0 && value.is_finite();
        v.given_area().is_some_and(|area| !positive(area))
            || v.radius.is_some_and(|radius| !positive(radius))
    };
    if let Some(index) = vertices.iter().position(wrong) {
        let (path, expected) = (path.to_owned(), "a positive finite area or radius".to_owned());
        return Err(SceneError::Entry { path, kind: "vertex", index, expected });
    }
    let mut repairs = Vec::new();
    let oriented: Vec<_> =
        vertices.iter().filter(|v| v.normal.try_normalize().is_some()).copied().collect();
    let dropped = vertices.len() - oriented.len();
    if dropped > 0 {
        repairs.push(format!("points without a normal, dropped: {dropped}"));
    }
    let given: Option<Vec<_>> = oriented.iter().map(Vertex::given_area).collect();
    let areas = match given {
        Some(areas) => areas,
        None => {
            let positions: Vec<_> = oriented.iter().map(|v| v.position).collect();
            let expected = "an area or a radius of every vertex, or neighbours to tell it";
            let areas = areas(&positions).ok_or_else(|| file_refusal(path, expected))?;
            let count = areas.len();
            repairs.push(format!("points whose area was estimated from their neighbours: {count}"));
            areas
        }
    };
    let point = |(v, area): (&Vertex, f64)| {
        let normal = v.normal.normalize_or_zero();
        ScenePoint { position: v.position, normal, area, material: 0 }
    };
    let points = oriented.iter().zip(areas).map(point).collect();
    Ok(Scene { materials: vec![Material::grey()], points, repairs, ..Scene::default() })
}

fn file_refusal(path: &Path, expected: &str) -> SceneError {
    SceneError::File { path: path.to_owned(), expected: expected.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::geometry::is_watertight;
    use std::fs;

    fn read_ply(bytes: &[u8]) -> Result<Scene, SceneError> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("mesh.ply");
        fs::write(&path, bytes).expect("written");
        read(&path)
    }

    const TETRAHEDRON: &str = "ply\nformat ascii 1.0\ncomment a body\nelement vertex 4\n\
        property double x\nproperty float y\nproperty int z\nproperty uchar red\n\
        element face 4\nproperty list uchar int vertex_indices\nelement edge 1\n\
        property int vertex1\nend_header\n\
        0 0 0 9\n1 0 0 9\n0 1 0 9\n0 0 1 9\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n0\n";

    /// The same tetrahedron in binary, whichever end comes first.
    fn binary(big: bool) -> Vec<u8> {
        let name = if big { "binary_big_endian" } else { "binary_little_endian" };
        let header = format!(
            "ply\nformat {name} 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
             property float z\nelement face 4\nproperty list uchar uint vertex_index\nend_header\n"
        );
        let mut bytes = header.into_bytes();
        let word = |word: [u8; 4], bytes: &mut Vec<u8>| {
            bytes.extend(if big { word } else { [word[3], word[2], word[1], word[0]] });
        };
        for p in [[0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
            p.iter().for_each(|c| word(c.to_be_bytes(), &mut bytes));
        }
        for face in [[0u32, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] {
            bytes.push(3);
            face.iter().for_each(|k| word(k.to_be_bytes(), &mut bytes));
        }
        bytes
    }

    #[test]
    fn a_tetrahedron_comes_back_from_all_formats() {
        for bytes in [TETRAHEDRON.as_bytes().to_vec(), binary(false), binary(true)] {
            let scene = read_ply(&bytes).expect("valid");
            assert!(is_watertight(&scene.surfaces) && scene.repairs.is_empty());
            assert!((scene.volume() - 1.0 / 6.0).abs() < 1e-15);
        }
    }

    #[test]
    fn truncated_binary_files_are_refused_wherever_they_end() {
        let whole = binary(false);
        for length in 0..whole.len() {
            assert!(read_ply(&whole[..length]).is_err(), "{length}");
        }
    }

    #[test]
    fn coordinates_that_are_not_finite_are_refused() {
        let mut bytes = binary(false);
        let body = bytes.len() - 4 * 12 - 4 * 13;
        bytes[body + 16..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
        let message = read_ply(&bytes).expect_err("NaN").to_string();
        assert!(message.contains("vertex 1: expected finite coordinates, found [1, NaN, 0]"));
    }

    #[test]
    fn malformed_files_are_refused() {
        for (from, to, place) in [
            ("ply\n", "plot\n", "mesh.ply: Line 1"),
            ("property float y\n", "", "expected numbers x, y and z of every vertex"),
            ("1 0 0 9", "1 nan 0 9", "Line 15"),
            ("1 0 0 9", "1 zero 0 9", "Line 15"),
            ("3 0 2 1", "3 0 2 4", "face 0: expected a list of vertices below 4"),
            ("3 0 2 1", "3 0 2 -1", "face 0: expected a list of vertices below 4"),
            ("vertex_indices", "corners", "face 0: expected a list of vertices below 4"),
            ("property int vertex1\n", "", "expected properties of every element"),
            ("element face 4", "element face 400", "Line"),
        ] {
            let error = read_ply(TETRAHEDRON.replacen(from, to, 1).as_bytes());
            let message = error.expect_err(to).to_string();
            assert!(message.contains(place), "{to}: {message}");
        }
    }

    fn cloud(properties: &[&str], rows: &[&str]) -> String {
        let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", rows.len());
        for property in ["x", "y", "z"].iter().chain(properties) {
            text += &format!("property float {property}\n");
        }
        text + "end_header\n" + &rows.join("\n") + "\n"
    }

    #[test]
    fn oriented_points_have_the_area_given() {
        let normal = ["nx", "ny", "nz"];
        let areas = cloud(&[&normal[..], &["area"]].concat(), &["0 0 1 0 0 2 3", "1 0 1 1 0 0 4"]);
        let scene = read_ply(areas.as_bytes()).expect("valid");
        assert_eq!(scene.points[0].normal, DVec3::Z);
        assert_eq!(scene.points.iter().map(|p| p.area).collect::<Vec<_>>(), [3.0, 4.0]);
        assert!(scene.repairs.is_empty() && scene.check().is_ok());
        let radii = areas.replace("float area", "float radius");
        let scene = read_ply(radii.as_bytes()).expect("valid");
        assert_eq!(scene.points[1].area, 16.0 * std::f64::consts::PI);
        for wrong in ["0", "-2"] {
            let message = read_ply(areas.replace("0 0 4", &format!("0 0 {wrong}")).as_bytes());
            let message = message.expect_err(wrong).to_string();
            assert!(message.contains("vertex 1: expected a positive finite area"), "{message}");
        }
    }

    #[test]
    fn missing_areas_are_estimated_and_missing_normals_dropped() {
        let rows: Vec<_> =
            (0..100).map(|k| format!("{} {} 0 0 0 {}", k % 10, k / 10, k.min(1))).collect();
        let rows: Vec<_> = rows.iter().map(String::as_str).collect();
        let scene = read_ply(cloud(&["nx", "ny", "nz"], &rows).as_bytes()).expect("valid");
        assert_eq!(scene.points.len(), 99);
        let expected = [
            "points without a normal, dropped: 1",
            "points whose area was estimated from their neighbours: 99",
        ];
        assert_eq!(scene.repairs, expected);
        let lone = cloud(&["nx", "ny", "nz"], &rows[1..2]);
        let message = read_ply(lone.as_bytes()).expect_err("lone").to_string();
        assert!(message.contains("expected an area or a radius of every vertex"));
        let bare = cloud(&[], &["0 0 0"]);
        let message = read_ply(bare.as_bytes()).expect_err("bare").to_string();
        assert!(message.contains("expected faces, or a normal nx, ny, nz"));
    }
}
