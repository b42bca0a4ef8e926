//! Mesh files by the ending of their names.

use std::path::Path;

use crate::formats::view3d::View3d;
use crate::formats::{gltf, obj, off, ply, stl};
use crate::generators::GENERATORS;
use crate::scene::Scene;
use crate::scene::error::SceneError;

/// The scene in a mesh file.
///
/// # Errors
/// [`SceneError::Unknown`] if its name ends otherwise than those of such files, or whatever is wrong
/// with it.
pub(crate) fn read_mesh(path: &Path) -> Result<Scene, SceneError> {
    let mut scene = match ending(path).as_str() {
        "obj" => obj::read(path),
        "stl" => stl::read(path),
        "ply" => ply::read(path),
        "off" => off::read(path),
        "gltf" | "glb" => gltf::read(path),
        "vs3" => View3d::read(path)?.into_scene(path),
        _ => Err(SceneError::Unknown {
            name: path.display().to_string(),
            generators: GENERATORS.join(", "),
            endings: format!(".{}, .{DESCRIPTION}", MESHES.join(", .")),
        }),
    }?;
    let file = file_name(path);
    for part in &mut scene.parts {
        let within = std::mem::take(&mut part.file);
        part.file = if within.is_empty() { file.clone() } else { format!("{within} of {file}") };
    }
    Ok(scene)
}

/// The name of a file without its folder.
pub(crate) fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// How the names of mesh files end.
const MESHES: [&str; 7] = ["obj", "stl", "ply", "off", "vs3", "gltf", "glb"];
/// How the names of scene descriptions end.
pub(crate) const DESCRIPTION: &str = "toml";

/// What a file name ends in, in lower case.
pub(crate) fn ending(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}
