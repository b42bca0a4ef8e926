//! Meshes from stereolithography (STL), binary and ASCII.

use std::path::Path;

use glam::Vec3;

use crate::formats::text::{BYTE_ORDER_MARK, Lines, read_bytes, text};
use crate::repair::soup::Soup;
use crate::scene::Scene;
use crate::scene::error::SceneError;
use crate::scene::material::Material;

/// The mesh in an STL file, all solids in it together, all of it grey. A triangle's front is where its
/// corners run counter-clockwise; the normals in the file are passed over.
///
/// # Errors
/// [`SceneError::Read`], or [`SceneError::File`], [`SceneError::Line`] or [`SceneError::Entry`] for
/// what isn't as it should be.
pub(crate) fn read(path: &Path) -> Result<Scene, SceneError> {
    let bytes = read_bytes(path)?;
    let declared = bytes.get(HEADER - 4..HEADER).and_then(|count| count.try_into().ok());
    let size = declared.map(|count| HEADER + RECORD * u32::from_le_bytes(count) as usize);
    // Binary files may begin with `solid` as well: their length tells, or bytes that no text has.
    let mut behind = 0;
    let mut soup = if size != Some(bytes.len()) && is_ascii(&bytes) {
        ascii(path, &text(&bytes))?
    } else {
        match size.filter(|&size| size <= bytes.len()) {
            Some(size) => {
                behind = (bytes.len() - size) / RECORD;
                binary(path, &bytes[HEADER..size])?
            }
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
    let mut scene = soup.into_scene(vec![Material::grey()]);
    if behind > 0 {
        let what =
            "behind the triangles that it says it has there are bytes as of so many more, not read";
        scene.doubts.push(format!("{what}: {behind}"));
    }
    Ok(scene)
}

/// Bytes before the first triangle of a binary file, the last four of which are the number of
/// triangles.
const HEADER: usize = 84;
/// Bytes of a triangle: its normal, its corners and two more.
const RECORD: usize = 50;

/// Whether a file begins as ASCII files do.
fn is_ascii(bytes: &[u8]) -> bool {
    let bytes = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes).trim_ascii_start();
    let begins = bytes.get(..SOLID.len()).is_some_and(|word| word.eq_ignore_ascii_case(SOLID));
    begins && !bytes.contains(&0)
}

/// The first word of an ASCII file.
const SOLID: &[u8] = b"solid";

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

/// The corners of the triangles in an ASCII file, which may hold several solids.
fn ascii(path: &Path, text: &str) -> Result<Soup, SceneError> {
    let mut soup = Soup::default();
    let mut lines = Lines::new(path, text);
    // How many corners the loop has so far, while there is one.
    let mut corners: Option<usize> = None;
    let mut in_solid = true;
    loop {
        let line = match lines.next() {
            Some(line) => line,
            None if in_solid => lines.expect("facet or endsolid")?,
            None => return Ok(soup),
        };
        match (line.words[0].to_ascii_lowercase().as_str(), corners) {
            ("solid", None) => in_solid = true,
            ("facet" | "endfacet", None) if in_solid => (),
            ("outer", None) if in_solid => corners = Some(0),
            ("vertex", Some(count)) => {
                soup.add_vertex(line.point(1)?);
                corners = Some(count + 1);
            }
            ("endloop", Some(3)) => corners = None,
            ("endloop", count) => {
                let found = count.unwrap_or(0);
                return Err(line.refusal(format!("three corners before, found {found}")));
            }
            ("endsolid", None) => in_solid = false,
            (_, Some(_)) => {
                return Err(line.refusal(format!("vertex or endloop, found {}", line.quoted())));
            }
            _ => {
                let expected = if in_solid { "facet or endsolid" } else { "solid" };
                return Err(line.refusal(format!("{expected}, found {}", line.quoted())));
            }
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
    fn triangles_that_are_not_counted_are_said() {
        for title in [&b""[..], b"solid but binary"] {
            let mut bytes = binary_file(&part(5), title);
            let scene = read_stl(&bytes).expect("valid");
            assert_eq!((scene.surfaces.len(), scene.doubts.len()), (5, 0));
            bytes.extend([0; 3]);
            assert!(read_stl(&bytes).expect("valid").doubts.is_empty());
            bytes[HEADER - 4] = 3;
            let scene = read_stl(&bytes).expect("valid");
            assert_eq!(scene.surfaces.len(), 3);
            assert!(scene.doubts[0].ends_with("so many more, not read: 2"), "{:?}", scene.doubts);
            bytes[HEADER - 4] = 7;
            let message = read_stl(&bytes).expect_err("cut short").to_string();
            assert!(message.contains("434 bytes of binary STL at least, found 337"), "{message}");
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
    fn all_solids_of_a_file_are_read_in_any_case_and_after_a_byte_order_mark() {
        let one = ascii_file(&part(2));
        let other = ascii_file(&Scene { vertices: shifted(&part(3)), ..part(3) }).to_uppercase();
        let two = read_stl(format!("{one}\n{other}").as_bytes()).expect("valid");
        assert_eq!((two.surfaces.len(), two.repairs.len()), (5, 0));
        for text in [other.clone(), format!("\u{feff}{other}"), format!(" \n{one}")] {
            assert!(read_stl(text.as_bytes()).is_ok(), "{text}");
        }
        let torn = format!("{one}{}", &other[..other.len() / 2]);
        assert!(read_stl(torn.as_bytes()).is_err());
        let message = read_stl(format!("{one}facet").as_bytes()).expect_err("no solid").to_string();
        assert!(message.contains("line 17: expected solid, found `facet`"), "{message}");
    }

    /// The vertices of a scene, out of the way of themselves.
    fn shifted(scene: &Scene) -> Vec<glam::DVec3> {
        scene.vertices.iter().map(|p| p + 9.0 * glam::DVec3::X).collect()
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
            ("vertex", "vertices", "line 4: expected vertex or endloop, found `vertices"),
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
