//! Fields on meshes and pictures written to files.

pub(crate) mod files;
mod gltf;
pub(crate) mod page;
pub(crate) mod ply;
pub(crate) mod replacing;
pub(crate) mod table;
pub(crate) mod vtu;
