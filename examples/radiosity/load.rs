//! Scenes by what the command line says: the name of a generated one, or a file.

use std::path::Path;

use crate::generators::{GENERATORS, generate};
use crate::scene::Scene;
use crate::scene_error::SceneError;
use crate::{description, obj, off, ply, stl};

/// The generated scene of this name or, if there is none, the scene in the file of this name.
///
/// # Errors
/// [`SceneError::Unknown`] if the name is neither, or whatever is wrong with the file or the scene in
/// it.
pub(crate) fn load(name: &str) -> Result<Scene, SceneError> {
    let path = Path::new(name);
    let scene = match generate(name) {
        Some(scene) => scene,
        None if ending(path) == DESCRIPTION => description::read(path)?,
        None => read_mesh(path)?,
    };
    scene.check()?;
    Ok(scene)
}

/// The scene in a mesh file.
///
/// # Errors
/// [`SceneError::Unknown`] if its name ends otherwise than those of such files, or whatever is wrong
/// with it.
pub(crate) fn read_mesh(path: &Path) -> Result<Scene, SceneError> {
    match ending(path).as_str() {
        "obj" => obj::read(path),
        "stl" => stl::read(path),
        "ply" => ply::read(path),
        "off" => off::read(path),
        _ => Err(SceneError::Unknown {
            name: path.display().to_string(),
            generators: GENERATORS.join(", "),
            endings: format!(".{}, .{DESCRIPTION}", MESHES.join(", .")),
        }),
    }
}

/// How the names of mesh files end.
const MESHES: [&str; 4] = ["obj", "stl", "ply", "off"];
/// How the names of scene descriptions end.
const DESCRIPTION: &str = "toml";

/// What a file name ends in, in lower case.
fn ending(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn generated_scenes_come_by_name_and_others_by_file() {
        assert_eq!(load("furnace").expect("generated").surfaces.len(), 6);
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("Mesh.OFF");
        fs::write(&path, "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n").expect("written");
        let scene = load(&path.to_string_lossy()).expect("valid");
        assert_eq!(scene.surfaces.len(), 1);
        assert!(!scene.closed && scene.camera.is_none());
        fs::write(&path, "OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n").expect("written");
        let error = load(&path.to_string_lossy()).expect_err("nothing there");
        assert!(matches!(error, SceneError::Empty));
    }

    #[test]
    fn names_of_nothing_are_refused() {
        for name in ["corneli", "mesh.gltf", "", "obj"] {
            let message = load(name).expect_err(name).to_string();
            let expected = format!(
                "`{name}`: expected one of cornell, furnace, sphere, bowl, two-rooms, canyon, \
                 columns, or a file that ends in .obj, .stl, .ply, .off, .toml"
            );
            assert_eq!(message, expected);
        }
        for name in ["no.obj", "no.stl", "no.ply", "no.off", "no.toml"] {
            let message = load(name).expect_err(name).to_string();
            assert!(message.starts_with(&format!("cannot read {name}: ")), "{message}");
        }
    }
}
