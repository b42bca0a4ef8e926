//! Triangles that hide.

use glam::DVec3;

/// A triangle that light does not pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle {
    /// Its corners, in either orientation: both sides block.
    pub vertices: [DVec3; 3],
    /// The face it belongs to, which may consist of any number of triangles that don't hide each
    /// other (a planar wall, say); [`Surfel::NO_FACE`](crate::Surfel::NO_FACE) if none.
    pub face: u32,
}
