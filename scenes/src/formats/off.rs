//! Meshes in the Object File Format (OFF).

use std::path::Path;

use crate::formats::text::{Line, Lines, read_text};
use crate::repair::soup::Soup;
use crate::scene::Scene;
use crate::scene::error::SceneError;
use crate::scene::material::Material;

/// The mesh in an OFF file, all of it grey. Colours, normals and texture coordinates are passed over.
///
/// # Errors
/// [`SceneError::Read`], or [`SceneError::Line`] for the first line that isn't what it should be.
pub(crate) fn read(path: &Path) -> Result<Scene, SceneError> {
    let text = read_text(path)?;
    let mut lines = Lines::new(path, &text);
    let mut header = lines.expect("the keyword OFF")?;
    if !KEYWORDS.contains(&header.words[0]) {
        return Err(header.refusal(format!("the keyword OFF, found {}", header.quoted())));
    }
    header.words.remove(0);
    // The numbers may follow on the same line.
    let counts = if header.words.is_empty() {
        lines.expect("the numbers of vertices and faces")?
    } else {
        header
    };
    let count = |k: usize| counts.words.get(k).and_then(|word| word.parse::<usize>().ok());
    let (Some(vertices), Some(faces)) = (count(0), count(1)) else {
        let expected = format!("the numbers of vertices and faces, found {}", counts.quoted());
        return Err(counts.refusal(expected));
    };
    let mut soup = Soup::default();
    for index in 0..vertices {
        let line = lines.expect(&format!("vertex {index} of {vertices}"))?;
        soup.add_vertex(line.point(0)?);
    }
    for index in 0..faces {
        let line = lines.expect(&format!("face {index} of {faces}"))?;
        add_polygon(&mut soup, &line)?;
    }
    Ok(soup.into_scene(vec![Material::grey()]))
}

/// The keywords of files in three dimensions: with texture coordinates, colours or normals.
const KEYWORDS: [&str; 6] = ["OFF", "COFF", "NOFF", "CNOFF", "NCOFF", "STOFF"];

/// Adds the polygon of a line: how many corners, and which vertices they are.
fn add_polygon(soup: &mut Soup, line: &Line) -> Result<(), SceneError> {
    let count = line.words.first().and_then(|word| word.parse::<usize>().ok());
    let corners = line.words[1..].iter().map_while(|word| word.parse().ok());
    let corners: Vec<u32> = corners.collect();
    match count.and_then(|count| corners.get(..count)) {
        Some(corners) if soup.add_polygon(corners, 0) => Ok(()),
        _ => {
            let (found, vertices) = (line.quoted(), soup.vertices());
            let expected = format!("a number of corners and as many vertices below {vertices}");
            Err(line.refusal(format!("{expected}, found {found}")))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::geometry::is_watertight;
    use std::fs;

    fn read_off(text: &str) -> Result<Scene, SceneError> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("mesh.off");
        fs::write(&path, text).expect("written");
        read(&path)
    }

    const TETRAHEDRON: &str = "OFF # a comment\n4 4 6\n\n0 0 0\n1 0 0\n0 1 0 \n0 0 1\n\
        3 0 2 1\n3 0 1 3 255 0 0\n3 0 3 2\n3 1 2 3\n";

    #[test]
    fn a_tetrahedron_comes_back() {
        let scene = read_off(TETRAHEDRON).expect("valid");
        assert!(is_watertight(&scene.surfaces));
        assert!((scene.volume() - 1.0 / 6.0).abs() < 1e-15);
        assert_eq!(scene.materials, [Material::grey()]);
        assert!(scene.repairs.is_empty());
        let one_line = TETRAHEDRON.replacen("OFF # a comment\n", "COFF ", 1);
        assert_eq!(read_off(&one_line).expect("valid").surfaces, scene.surfaces);
    }

    #[test]
    fn polygons_with_many_corners_are_cut() {
        let scene = read_off("OFF\n5 1 0\n0 0 0\n1 0 0\n1 1 0\n.5 2 0\n0 1 0\n5 0 1 2 3 4\n");
        let scene = scene.expect("valid");
        let area = scene.surfaces.iter().map(|s| scene.area(s)).sum::<f64>();
        assert!((area - 1.5).abs() < 1e-15);
    }

    #[test]
    fn malformed_files_are_refused_at_the_line() {
        for (from, to, line, expected) in [
            ("OFF #", "PLY #", 1, "the keyword OFF, found `PLY`"),
            ("4 4 6", "4 x 6", 2, "the numbers of vertices and faces, found `4 x 6`"),
            ("1 0 0\n", "1 0\n", 5, "three finite numbers, found `1 0`"),
            ("1 0 0\n", "1 nan 0\n", 5, "three finite numbers, found `1 nan 0`"),
            ("1 0 0\n", "1 1e999 0\n", 5, "three finite numbers, found `1 1e999 0`"),
            ("3 0 2 1", "3 0 2 4", 8, "a number of corners and as many vertices below 4"),
            ("3 0 2 1", "4 0 2 1", 8, "a number of corners and as many vertices below 4"),
            ("3 0 2 1", "3 0 -2 1", 8, "a number of corners and as many vertices below 4"),
            ("3 1 2 3", "", 10, "face 3 of 4, found the end of the file"),
            ("4 4 6", "4000000000 4 6", 11, "vertex 8 of 4000000000, found the end of the file"),
        ] {
            let error = read_off(&TETRAHEDRON.replacen(from, to, 1));
            let message = error.expect_err(to).to_string();
            let place = format!("mesh.off, line {line}: expected {expected}");
            assert!(message.contains(&place), "{message}");
        }
    }
}
