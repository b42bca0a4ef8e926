//! What tests of other files read of a glTF file.

use std::fs;
use std::path::Path;

use crate::formats::gltf::container::open;

/// An attribute of all vertices of a file, primitive by primitive.
pub(crate) fn numbers<const WIDTH: usize>(path: &Path, attribute: &str) -> Vec<[f64; WIDTH]> {
    let bytes = fs::read(path).expect("readable");
    let content = open(path, &bytes).expect("valid");
    let primitives = content.document.meshes.iter().flat_map(|mesh| &mesh.primitives);
    let read = |accessor| content.numbers::<WIDTH>(accessor).expect("there");
    primitives.flat_map(|primitive| read(primitive.attributes[attribute])).collect()
}
