//! Scenes from files: meshes, oriented points, and descriptions that put them together.

pub(crate) mod assembly;
pub(crate) mod description;
pub(crate) mod gltf;
pub(crate) mod load;
pub(crate) mod mesh_file;
pub(crate) mod mtl;
pub(crate) mod obj;
pub(crate) mod off;
pub(crate) mod ply;
pub(crate) mod stl;
pub(crate) mod text;
pub(crate) mod view3d;
