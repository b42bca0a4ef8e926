//! Meshes from stereolithography (STL), binary and ASCII.

use std::path::Path;

use glam::Vec3;

use crate::formats::text::{Lines, read_bytes};
use crate::repair::soup::Soup;
use crate::scene::Scene;
use crate::scene::error::SceneError;
use crate::scene::material::Material;

/// The mesh in an STL file, all of it grey. A triangle's front is where its corners run
/// counter-clockwise; the normals in the file are passed over.
///
/// # Errors
/// [`SceneError::Read`], or [`SceneError::File`], [`SceneError::Line`] or [`SceneError::Entry`] for
/// what isn't as it should be.
pub(crate) fn read(path: &Path) -> Result<Scene, SceneError> {
    let bytes = read_bytes(path)?;
    let declared = bytes.get(HEADER - 4..HEADER).and_then(|count| count.try_into().ok());
    let size = declared.map(|count| HEADER + RECORD * u32::from_le_bytes(count) as usize);
    // Binary files may begin with `solid` as well: their length tells.
    let mut soup = if size != Some(bytes.len()) && bytes.trim_ascii_start().starts_with(b"solid") {
        ascii(path, &String::from_utf8_lossy(&bytes))?
    } else {
        match size.filter(|&size| size <= bytes.len()) {
            Some(size) => binary(path, &bytes[HEADER..size])?,
            None => {
                let size = size.unwrap_or(HEADER);
                let found = bytes.len();
                let expected =
                    format!("`solid`, or {size} bytes of binary STL at least, found {found}");
                return Err(SceneError::File { path: path.to_owned(), expected });
            }
        }
    };
    let firsts = (0..soup.vertices()).step_by(3);
    firsts.for_each(|k| _ = soup.add_polygon(&[k, k + 1, k + 2], 0));
    Ok(soup.into_scene(vec![Material::grey()]))
}

/// Bytes before the first triangle of a binary file, the last four of which are the number of
/// triangles.
const HEADER: usize = 84;
/// Bytes of a triangle: its normal, its corners and two more.
const RECORD: usize = 50;

/// The corners of the triangles in a binary file.
fn binary(path: &Path, records: &[u8]) -> Result<Soup, SceneError> {
    let mut soup = Soup::default();
    for (index, record) in records.chunks_exact(RECORD).enumerate() {
        for corner in record[12..48].chunks_exact(12) {
            let number = |k: usize| {
                f32::from_le_bytes([corner[k], corner[k + 1], corner[k + 2], corner[k + 3]])
            };
            let vertex = Vec3::new(number(0), number(4), number(8));
            if !vertex.is_finite() {
                let expected = format!("finite coordinates, found {vertex}");
                let path = path.to_owned();
                return Err(SceneError::Entry { path, kind: "triangle", index, expected });
            }
            soup.add_vertex(vertex.as_dvec3());
        }
    }
    Ok(soup)
}

/// The corners of the triangles in an ASCII file.
fn ascii(path: &Path, text: &str) -> Result<Soup, SceneError> {
    let mut soup = Soup::default();
    let mut lines = Lines::new(path, text);
    let mut corners = 0;
    loop {
        let line = lines.expect("facet or endsolid")?;
        match line.words[0].to_ascii_lowercase().as_str() {
            "solid" | "facet" | "endfacet" => (),
            "outer" => corners = 0,
            "vertex" => {
                soup.add_vertex(line.point(1)?);
                corners += 1;
            }
            "endloop" if corners == 3 => (),
            "endloop" => return Err(line.refusal(format!("three corners before, found {corners}"))),
            "endsolid" if soup.vertices().is_multiple_of(3) => return Ok(soup),
            _ => return Err(line.refusal(format!("facet or endsolid, found {}", line.quoted()))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generators::round::sphere;
    use crate::scene::geometry::is_watertight;
    use std::fmt::Write;
    use std::fs;

    fn read_stl(bytes: &[u8]) -> Result<Scene, SceneError> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("mesh.stl");
        fs::write(&path, bytes).expect("written");
        read(&path)
    }

    /// The first triangles of the sphere.
    fn part(count: usize) -> Scene {
        let mut scene = sphere();
        scene.surfaces.truncate(count);
        scene
    }

    fn binary_file(scene: &Scene, title: &[u8]) -> Vec<u8> {
        let mut bytes = title.to_vec();
        bytes.resize(HEADER - 4, 0);
        bytes.extend((scene.surfaces.len() as u32).to_le_bytes());
        for surface in &scene.surfaces {
            bytes.extend([0; 12]);
            let corners = scene.corners(surface).into_iter();
            let numbers = corners.flat_map(|p| p.as_vec3().to_array());
            bytes.extend(numbers.flat_map(f32::to_le_bytes));
            bytes.extend([0; 2]);
        }
        bytes
    }

    fn ascii_file(scene: &Scene) -> String {
        let mut text = "solid a body\n".to_owned();
        for surface in &scene.surfaces {
            text += "  facet normal 0 0 0\n    outer loop\n";
            for p in scene.corners(surface) {
                writeln!(text, "      vertex {} {} {}", p.x, p.y, p.z).expect("memory");
            }
            text += "    endloop\n  endfacet\n";
        }
        text + "endsolid a body\n"
    }

    #[test]
    fn a_sphere_comes_back_in_both_formats() {
        let scene = sphere();
        let ascii = read_stl(ascii_file(&scene).as_bytes()).expect("valid");
        let corners =
            |scene: &Scene| -> Vec<_> { scene.surfaces.iter().map(|s| scene.corners(s)).collect() };
        assert_eq!(corners(&ascii), corners(&scene));
        assert!(ascii.vertices.len() == 2562 && ascii.repairs.is_empty());
        for title in [&b"exported"[..], b"solid but binary"] {
            let binary = read_stl(&binary_file(&scene, title)).expect("valid");
            assert_eq!(binary.surfaces.len(), scene.surfaces.len());
            assert!(is_watertight(&binary.surfaces) && binary.repairs.is_empty());
            assert!((binary.volume() - scene.volume()).abs() < 1e-6);
        }
    }

    #[test]
    fn turned_triangles_of_a_sphere_are_turned_outwards() {
        let mut turned = sphere();
        turned.surfaces.iter_mut().for_each(|s| s.corners.reverse());
        turned.surfaces.iter_mut().step_by(3).for_each(|s| s.corners.reverse());
        let scene = read_stl(ascii_file(&turned).as_bytes()).expect("valid");
        assert_eq!(scene.repairs, ["faces turned round to agree with their neighbours: 1707"]);
        assert!(is_watertight(&scene.surfaces) && scene.volume() > 4.0);
    }

    #[test]
    fn malformed_files_are_refused() {
        let message = |bytes: &[u8]| read_stl(bytes).expect_err("malformed").to_string();
        let mut bytes = binary_file(&part(2), b"");
        bytes.pop();
        assert!(message(&bytes).contains("184 bytes of binary STL at least, found 183"));
        assert!(message(b"short").contains("84 bytes of binary STL at least, found 5"));
        assert!(message(b"").contains("found 0"));
        bytes.push(0);
        bytes[HEADER + RECORD + 12..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
        assert!(message(&bytes).contains("triangle 1: expected finite coordinates, found [NaN"));
        let text = ascii_file(&part(2));
        for (from, to, place) in [
            ("endsolid a body", "", "line 15: expected facet or endsolid, found the end"),
            ("vertex", "vertices", "line 4: expected facet or endsolid, found `vertices"),
            ("vertex", "vertex inf", "line 4: expected three finite numbers"),
            ("outer loop\n", "outer loop\nvertex 0 0 0\n", "line 8: expected three corners before"),
            ("endloop", "endsolid", "line 7"),
        ] {
            let found = read_stl(text.replacen(from, to, 1).as_bytes());
            match found {
                Err(error) => assert!(error.to_string().contains(place), "{error}"),
                // An early end leaves the triangles up to there.
                Ok(scene) => assert_eq!((from, scene.surfaces.len()), ("endloop", 1)),
            }
        }
    }
}
