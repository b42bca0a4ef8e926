//! A scene: surfaces, oriented points, what they are made of, and from where to look at them.

use glam::DVec3;

/// Everything that a run needs to know of a scene.
#[derive(Clone, Debug, Default)]
pub(crate) struct Scene {
    /// What surfaces and points are made of; all have the same number of bands.
    pub(crate) materials: Vec<Material>,
    /// Flat pieces of surface.
    pub(crate) surfaces: Vec<Surface>,
    /// Oriented points, each standing for a disk.
    pub(crate) points: Vec<ScenePoint>,
    /// From where to look; chosen from the scene's extent if none.
    pub(crate) camera: Option<Viewpoint>,
    /// Whether the surfaces close a room without gaps, as far as the maker of the scene knows: then
    /// all light that leaves one of them arrives at another.
    pub(crate) closed: bool,
    /// What was mended while the scene was read, one sentence each.
    pub(crate) repairs: Vec<String>,
}

/// What a surface does with light, band by band.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Material {
    /// Its name, for messages.
    pub(crate) name: String,
    /// Diffuse reflectance ρ, in [0, 1).
    pub(crate) reflectance: Vec<f64>,
    /// Emitted exitance E \[W/m²\].
    pub(crate) emission: Vec<f64>,
    /// Its temperature [K], for heat: then E = (1 − ρ) σ T⁴ takes the place of `emission`.
    pub(crate) temperature: Option<f64>,
    /// Whether the back of a surface is like its front; otherwise it neither radiates nor receives.
    pub(crate) two_sided: bool,
}

/// A flat convex piece of surface.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Surface {
    /// Its three or four corners, counter-clockwise around its front.
    pub(crate) corners: Vec<DVec3>,
    /// Index of its material.
    pub(crate) material: usize,
    /// Number of the occluder face it belongs to: surfaces of one face never hide each other's points
    /// (those of one plane, say).
    pub(crate) face: u32,
}

/// An oriented point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ScenePoint {
    /// Where it is.
    pub(crate) position: DVec3,
    /// Unit normal on the side that radiates and receives.
    pub(crate) normal: DVec3,
    /// The area that it stands for.
    pub(crate) area: f64,
    /// Index of its material.
    pub(crate) material: usize,
}

/// A pinhole camera's place and direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Viewpoint {
    /// Where the camera is.
    pub(crate) eye: DVec3,
    /// The point in the middle of the picture.
    pub(crate) target: DVec3,
    /// Which way is up in the picture; not along the line of sight.
    pub(crate) up: DVec3,
    /// Edge of the square film over its distance from the lens.
    pub(crate) film_over_focal: f64,
}
