//! Meshes from Wavefront OBJ files, with their materials from MTL files.

use std::path::Path;

use crate::formats::mtl::Library;
use crate::formats::text::{Line, Lines, read_text};
use crate::repair::soup::Soup;
use crate::scene::Scene;
use crate::scene::error::SceneError;

/// The mesh in an OBJ file, in the bands red, green and blue.
///
/// Materials are those of the MTL files that it names: `Kd` is the reflectance, `Ke` the emission.
/// What isn't found is grey, and noted as missing. Faces are all that is taken from the file, and may
/// come before their vertices; curves, normals and texture coordinates are passed over.
///
/// # Errors
/// [`SceneError::Read`], or [`SceneError::Line`] for the first line of either file that isn't what it
/// should be.
pub(crate) fn read(path: &Path) -> Result<Scene, SceneError> {
    let text = read_text(path)?;
    let mut soup = Soup::default();
    let mut library = Library::default();
    let mut faces = Faces::default();
    // The names of materials in the order of their first use; nothing for faces that name none.
    let mut names: Vec<String> = Vec::new();
    let mut current = String::new();
    for line in Lines::wavefront(path, &text, &NAMED) {
        match line.words[0] {
            "v" => soup.add_vertex(line.point(1)?),
            // The second is an old spelling.
            "f" | "fo" => {
                let known = names.iter().position(|known| *known == current);
                faces.add(&line, soup.vertices(), known.unwrap_or(names.len()))?;
                if known.is_none() {
                    names.push(current.clone());
                }
            }
            "usemtl" => current = line.words[1..].join(" "),
            "mtllib" => library.read(path.parent().unwrap_or(Path::new("")), &line.words[1..])?,
            _ => (),
        }
    }
    let mut corners = faces.corners.as_slice();
    for face in &faces.lines {
        let (own, rest) = corners.split_at(face.corners);
        corners = rest;
        if !soup.add_polygon(own, face.material) {
            let (vertices, last) =
                (soup.vertices(), own.iter().max().map_or(0, |&k| u64::from(k) + 1));
            let expected = format!("three or more of {vertices} vertices, found {last} among them");
            return Err(SceneError::Line { path: path.to_owned(), line: face.number, expected });
        }
    }
    let materials = names.iter().map(|name| library.material(name)).collect();
    let Library { missing, mut repairs, .. } = library;
    let mut scene = soup.into_scene(materials);
    repairs.append(&mut scene.repairs);
    Ok(Scene { repairs, missing, ..scene })
}

/// First words of the lines that are names from there on.
const NAMED: [&str; 2] = ["usemtl", "mtllib"];

/// The faces of a file, kept until all vertices are known.
#[derive(Clone, Debug, Default)]
struct Faces {
    lines: Vec<Face>,
    /// The corners of all faces, one face after the other.
    corners: Vec<u32>,
}

/// A face of a file.
#[derive(Clone, Copy, Debug)]
struct Face {
    /// The number of its line.
    number: usize,
    /// How many corners it has.
    corners: usize,
    /// The number of its material.
    material: usize,
}

impl Faces {
    /// Adds the face of a line after which there are so many vertices.
    fn add(&mut self, line: &Line, vertices: u32, material: usize) -> Result<(), SceneError> {
        let first = self.corners.len();
        for word in &line.words[1..] {
            self.corners.push(corner(word, vertices).ok_or_else(|| refusal(line, vertices))?);
        }
        let corners = self.corners.len() - first;
        if corners < 3 {
            return Err(refusal(line, vertices));
        }
        self.lines.push(Face { number: line.number, corners, material });
        Ok(())
    }
}

/// The number of the vertex that a word means where there are so many so far.
fn corner(word: &str, vertices: u32) -> Option<u32> {
    // Texture coordinates and normals may follow after slashes.
    let number: i64 = word.split('/').next()?.parse().ok()?;
    // Negative numbers count from the latest vertex backwards.
    let before = if number < 0 { i64::from(vertices) } else { -1 };
    u32::try_from(before.checked_add(number)?).ok()
}

/// The refusal of a face.
fn refusal(line: &Line, vertices: u32) -> SceneError {
    line.refusal(format!("three or more of {vertices} vertices, found {}", line.quoted()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::geometry::vector_area;
    use crate::scene::material::Material;
    use glam::DVec3;
    use std::fs;

    const MESH: &str = "mtllib some colours.mtl\nv 0 0 0\nv 1 0 0 1.0\nv 1 1 0\nv 0 1 0\nvt 0 0\n\
        o one\nusemtl red wall\nf 1 2 3 4 # a square\nvn 0 0 1\ng two\nusemtl lamp\n\
        v 0 0 1\nv 1 0 1\nv 1 1 1\nf -1/1/1 -2//1 -3/1\nl 1 2\ns off\n";
    const COLOURS: &str = "# two of three are in use\nnewmtl red wall\n  Kd 0.6 0.1 0.05\nNs 10\n\
        newmtl lamp\nKe 17 12 4\nKd 0 0 0\nmap_Kd lamp.png\nnewmtl white\nKd 1 1 1\n";

    fn read_obj(mesh: &str, colours: Option<&str>) -> Result<Scene, SceneError> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("mesh.obj");
        fs::write(&path, mesh).expect("written");
        if let Some(colours) = colours {
            fs::write(folder.path().join("some colours.mtl"), colours).expect("written");
        }
        read(&path)
    }

    #[test]
    fn faces_and_their_materials_come_back() {
        let scene = read_obj(MESH, Some(COLOURS)).expect("valid");
        assert!(scene.check().is_ok() && scene.repairs.is_empty());
        let lamp = Material::rgb("lamp", [0.0; 3], [17.0, 12.0, 4.0]);
        let red = Material::rgb("red wall", [0.6, 0.1, 0.05], [0.0; 3]);
        assert_eq!(scene.materials, [red, lamp]);
        let materials: Vec<_> = scene.surfaces.iter().map(|s| s.material).collect();
        assert_eq!(materials, [0, 1]);
        assert_eq!(scene.surfaces.iter().map(|s| scene.area(s)).collect::<Vec<_>>(), [1.0, 0.5]);
        assert_eq!(vector_area(&scene.corners(&scene.surfaces[1])), -0.5 * DVec3::Z);
    }

    #[test]
    fn what_is_missing_is_grey_and_said() {
        let scene = read_obj(MESH, None).expect("valid");
        let found = [
            "material file `some colours.mtl` not found",
            "material `red wall` not found, faces made grey",
            "material `lamp` not found, faces made grey",
        ];
        assert_eq!(scene.missing, found);
        assert!(scene.repairs.is_empty() && scene.materials.len() == 2);
        assert!(scene.materials.iter().all(|m| m.reflectance == [0.5; 3]));
        let scene = read_obj(&MESH.replace("usemtl lamp", "usemtl LAMP"), Some(COLOURS));
        let missing = scene.expect("valid").missing;
        assert_eq!(missing, ["material `LAMP` not found, faces made grey"]);
        let scene = read_obj(&MESH.replace("usemtl", "#"), Some(COLOURS)).expect("valid");
        assert_eq!(scene.missing, ["faces without a material made grey"]);
        assert_eq!(scene.materials, [Material { name: String::new(), ..Material::grey() }]);
    }

    #[test]
    fn faces_may_be_spelt_as_of_old() {
        let [new, old] = [MESH.to_owned(), MESH.replace("\nf ", "\nfo ")]
            .map(|text| read_obj(&text, Some(COLOURS)).expect("valid"));
        assert!(!new.surfaces.is_empty() && new.surfaces == old.surfaces);
    }

    #[test]
    fn malformed_files_are_refused_at_the_line() {
        for (from, to, line) in [
            ("f 1 2 3 4", "f 0 2 3 4", 9),
            ("f 1 2 3 4", "f 1 2 3 8", 9),
            ("f 1 2 3 4", "f 1 2 3 -5", 9),
            ("f 1 2 3 4", "f 1 2 -9223372036854775808", 9),
            ("f 1 2 3 4", "f 1 2", 9),
            ("f 1 2 3 4", "f 1 2 x", 9),
            ("f 1 2 3 4", "f", 9),
            ("v 1 1 0", "v 1 1", 4),
            ("v 1 1 0", "v 1 NaN 0", 4),
            ("v 1 1 0", "v 1 inf 0", 4),
        ] {
            let error = read_obj(&MESH.replacen(from, to, 1), Some(COLOURS));
            let message = error.expect_err(to).to_string();
            assert!(message.contains(&format!("mesh.obj, line {line}: expected")), "{message}");
        }
        let error = read_obj(MESH, Some(&COLOURS.replace("Kd 0.6 0.1 0.05", "Kd 0.6 0.1")));
        let message = error.expect_err("too short").to_string();
        assert!(message.contains("some colours.mtl, line 3: expected three finite"), "{message}");
    }

    #[test]
    fn only_materials_in_use_must_obey_the_laws_of_nature() {
        let colours = COLOURS.replace("Kd 1 1 1", "Kd 2 1 1");
        assert!(read_obj(MESH, Some(&colours)).expect("readable").check().is_ok());
        let scene = read_obj(&MESH.replace("usemtl lamp", "usemtl white"), Some(&colours));
        let error = scene.expect("readable").check().expect_err("too white").to_string();
        assert!(error.starts_with("material `white` has the reflectance 2 in band 0"), "{error}");
        let scene = read_obj(&MESH.replace("usemtl lamp", "usemtl white"), Some(COLOURS));
        let scene = scene.expect("readable");
        assert!(scene.check().is_ok() && scene.materials[1].reflectance == [0.999; 3]);
        assert_eq!(scene.repairs, ["material `white` reflects everything, taken for 0.999"]);
    }

    #[test]
    fn faces_before_vertices_joined_lines_marks_and_signs_in_names_change_nothing() {
        let expected = read_obj(MESH, Some(COLOURS)).expect("valid");
        let (vertices, others): (Vec<_>, Vec<_>) =
            MESH.lines().partition(|line| line.starts_with("v "));
        let turned =
            [others, vertices].concat().join("\n").replace("f -1/1/1 -2//1 -3/1", "f 7 6 5");
        for text in [
            turned,
            format!("\u{feff}{MESH}"),
            MESH.replace("f 1 2 3 4", "f 1 2 \\\n 3 4").replace("v 1 1 0", "v 1 \\\r\n1 0"),
        ] {
            let scene = read_obj(&text, Some(COLOURS)).expect("valid");
            assert_eq!(scene.materials, expected.materials);
            let corners = |scene: &Scene| -> Vec<_> {
                scene.surfaces.iter().map(|s| (s.material, scene.corners(s))).collect()
            };
            assert_eq!(corners(&scene), corners(&expected), "{text}");
        }
        let named = |text: &str| text.replace("red wall", "Wall #1").replace("lamp", "Wall #2");
        let scene = read_obj(&named(MESH), Some(&named(COLOURS))).expect("valid");
        let names: Vec<_> = scene.materials.iter().map(|m| m.name.as_str()).collect();
        assert_eq!(names, ["Wall #1", "Wall #2"]);
        assert_eq!(scene.materials[1].emission, [17.0, 12.0, 4.0]);
    }
}
