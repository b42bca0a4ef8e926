//! Pieces of surface and oriented points.

use glam::DVec3;

/// How far the squared length of a unit normal may be off one.
const UNIT_TOLERANCE: f64 = 1e-8;

/// A flat convex piece of surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Indices of its three or four vertices, counter-clockwise around its front.
    pub corners: Vec<u32>,
    /// Index of its material.
    pub material: usize,
    /// Number of the occluder face it belongs to: surfaces of one face never hide each other's points
    /// (those of one plane, say).
    pub face: u32,
}

/// An oriented point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScenePoint {
    /// Where it is.
    pub position: DVec3,
    /// Unit normal on the side that radiates and receives.
    pub normal: DVec3,
    /// The area that it stands for.
    pub area: f64,
    /// Index of its material.
    pub material: usize,
}

impl ScenePoint {
    /// Checks its place, its normal and its area; otherwise says what was expected.
    pub(crate) fn check(&self) -> Result<(), &'static str> {
        let unit = (self.normal.length_squared() - 1.0).abs() <= UNIT_TOLERANCE;
        if !self.position.is_finite() {
            Err("finite coordinates")
        } else if !unit {
            Err("a unit normal")
        } else if !(self.area > 0.0 && self.area.is_finite()) {
            Err("a positive finite area")
        } else {
            Ok(())
        }
    }
}
