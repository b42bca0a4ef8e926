//! The elements that a scene is cut into.

use farfield_radiosity::{Element, Triangle};

/// A scene in elements.
#[derive(Clone, Debug, Default)]
pub(crate) struct Mesh {
    /// The elements; the two sides of a sheet are two elements with opposite normals.
    pub(crate) elements: Vec<Element>,
    /// For each element, the index of its surface, or the number of surfaces plus the index of its point.
    pub(crate) origin: Vec<u32>,
    /// For each element, the index of its material.
    pub(crate) material: Vec<u32>,
    /// What hides: the surfaces in triangles, and the disks of points.
    pub(crate) triangles: Vec<Triangle>,
}
