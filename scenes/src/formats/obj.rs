//! Meshes from Wavefront OBJ files, with their materials from MTL files.

use std::collections::HashMap;
use std::io;
use std::path::Path;

use crate::formats::text::{Line, Lines, read_text};
use crate::repair::soup::Soup;
use crate::scene::Scene;
use crate::scene::error::SceneError;
use crate::scene::material::Material;

/// The mesh in an OBJ file, in the bands red, green and blue.
///
/// Materials are those of the MTL files that it names: `Kd` is the reflectance, `Ke` the emission.
/// What isn't found is grey, and noted among the repairs. Faces are all that is taken from the file;
/// curves, normals and texture coordinates are passed over.
///
/// # Errors
/// [`SceneError::Read`], or [`SceneError::Line`] for the first line of either file that isn't what it
/// should be.
pub(crate) fn read(path: &Path) -> Result<Scene, SceneError> {
    let text = read_text(path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut soup = Soup::default();
    let mut library = HashMap::new();
    let mut repairs = Vec::new();
    // The names of materials in the order of their first use; nothing for faces that name none.
    let mut names: Vec<String> = Vec::new();
    let mut current = String::new();
    for line in Lines::new(path, &text) {
        match line.words[0] {
            "v" => soup.add_vertex(line.point(1)?),
            "f" => {
                let known = names.iter().position(|known| *known == current);
                add_polygon(&mut soup, &line, known.unwrap_or(names.len()))?;
                if known.is_none() {
                    names.push(current.clone());
                }
            }
            "usemtl" => current = line.words[1..].join(" "),
            "mtllib" => {
                let name = line.words[1..].join(" ");
                match read_materials(&folder.join(&name)) {
                    Ok(found) => library.extend(found.into_iter().map(|m| (m.name.clone(), m))),
                    Err(SceneError::Read { source, .. })
                        if source.kind() == io::ErrorKind::NotFound =>
                    {
                        repairs.push(format!("material file `{name}` not found"));
                    }
                    Err(error) => return Err(error),
                }
            }
            _ => (),
        }
    }
    let materials = names.into_iter().map(|name| {
        library.remove(&name).unwrap_or_else(|| {
            repairs.push(if name.is_empty() {
                "faces without a material made grey".to_owned()
            } else {
                format!("material `{name}` not found, faces made grey")
            });
            Material { name, ..Material::grey() }
        })
    });
    let materials = materials.collect();
    let mut scene = soup.into_scene(materials);
    repairs.append(&mut scene.repairs);
    Ok(Scene { repairs, ..scene })
}

/// Adds the face of a line.
fn add_polygon(soup: &mut Soup, line: &Line, material: usize) -> Result<(), SceneError> {
    let vertices = soup.vertices();
    let corner = |word: &&str| {
        // Texture coordinates and normals may follow after slashes.
        let number: i64 = word.split('/').next()?.parse().ok()?;
        // Negative numbers count from the latest vertex backwards.
        let before = if number < 0 { i64::from(vertices) } else { -1 };
        u32::try_from(before.checked_add(number)?).ok()
    };
    let corners: Option<Vec<_>> = line.words[1..].iter().map(corner).collect();
    match corners {
        Some(corners) if corners.len() > 2 && soup.add_polygon(&corners, material) => Ok(()),
        _ => {
            let found = line.quoted();
            let expected =
                format!("three or more of the {vertices} vertices so far, found {found}");
            Err(line.refusal(expected))
        }
    }
}

/// The materials in an MTL file.
fn read_materials(path: &Path) -> Result<Vec<Material>, SceneError> {
    let text = read_text(path)?;
    let mut materials: Vec<Material> = Vec::new();
    for line in Lines::new(path, &text) {
        let word = line.words[0];
        if word == "newmtl" {
            let name = line.words[1..].join(" ");
            materials.push(Material { name, ..Material::grey() });
        } else if let ("Kd" | "Ke", Some(material)) = (word, materials.last_mut()) {
            let values = line.numbers(1)?.to_vec();
            let place =
                if word == "Kd" { &mut material.reflectance } else { &mut material.emission };
            *place = values;
        }
    }
    Ok(materials)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::geometry::vector_area;
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
        assert_eq!(scene.repairs, found);
        assert_eq!(scene.materials.len(), 2);
        assert!(scene.materials.iter().all(|m| m.reflectance == [0.5; 3]));
        let scene = read_obj(&MESH.replace("usemtl lamp", "usemtl LAMP"), Some(COLOURS));
        let repairs = scene.expect("valid").repairs;
        assert_eq!(repairs, ["material `LAMP` not found, faces made grey"]);
        let scene = read_obj(&MESH.replace("usemtl", "#"), Some(COLOURS)).expect("valid");
        assert_eq!(scene.repairs, ["faces without a material made grey"]);
        assert_eq!(scene.materials, [Material { name: String::new(), ..Material::grey() }]);
    }

    #[test]
    fn malformed_files_are_refused_at_the_line() {
        for (from, to, line) in [
            ("f 1 2 3 4", "f 0 2 3 4", 9),
            ("f 1 2 3 4", "f 1 2 3 5", 9),
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
        let error = read_obj(MESH, Some(&COLOURS.replace("Kd 0.6 0.1 0.05", "Kd 0.6")));
        let message = error.expect_err("too short").to_string();
        assert!(message.contains("some colours.mtl, line 3: expected three finite"), "{message}");
    }

    #[test]
    fn only_materials_in_use_must_obey_the_laws_of_nature() {
        let scene = read_obj(&MESH.replace("usemtl lamp", "usemtl white"), Some(COLOURS));
        let error = scene.expect("readable").check().expect_err("too white").to_string();
        assert!(error.starts_with("material `white` has the reflectance 1 in band 0"), "{error}");
    }
}
