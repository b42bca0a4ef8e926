//! Scenes described in TOML: meshes, walls and materials, put together and into generated scenes.

use std::collections::BTreeMap;

use serde::Deserialize;

/// A scene file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Description {
    /// Metres per unit of all coordinates, those of a generated scene included.
    #[serde(default = "one")]
    pub(crate) units: f64,
    /// The generated scene to start from.
    pub(crate) generator: Option<String>,
    /// Whether the surfaces close a room; if it isn't said, the generated scene as long as all that is
    /// put into it is closed or two-sided.
    pub(crate) closed: Option<bool>,
    /// The mesh files in it.
    #[serde(default)]
    pub(crate) mesh: Vec<MeshFile>,
    /// The walls in it.
    #[serde(default)]
    pub(crate) quad: Vec<Quad>,
    /// Its materials by name.
    #[serde(default)]
    pub(crate) materials: BTreeMap<String, Finish>,
    /// From where to look; that of the generated scene if it isn't said.
    pub(crate) camera: Option<Camera>,
}

/// A mesh file, scaled, then rotated, then translated.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MeshFile {
    /// Name of the file, from the folder of the description.
    pub(crate) file: String,
    /// Takes the place of all materials in the file.
    pub(crate) material: Option<String>,
    /// By how much its lengths grow.
    #[serde(default = "one")]
    pub(crate) scale: f64,
    /// How it is turned around the origin.
    pub(crate) rotate: Option<Rotation>,
    /// By how much it is moved.
    #[serde(default)]
    pub(crate) translate: [f64; 3],
    /// Takes the place of what its material says.
    pub(crate) two_sided: Option<bool>,
}

/// A turn, counter-clockwise as seen from where the axis points to.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Rotation {
    /// The axis, of any length but zero.
    pub(crate) axis: [f64; 3],
    /// The angle \[°].
    pub(crate) degrees: f64,
}

/// A flat convex wall, its corners counter-clockwise around its front.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Quad {
    /// The corners.
    pub(crate) corners: [[f64; 3]; 4],
    /// Name of its material.
    pub(crate) material: String,
}

/// A material.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Finish {
    /// Reflectance, band by band.
    pub(crate) reflectance: Vec<f64>,
    /// Nothing in any band if it isn't said.
    pub(crate) emission: Option<Vec<f64>>,
    /// Temperature \[K].
    pub(crate) temperature: Option<f64>,
    /// Whether backs are like fronts.
    #[serde(default)]
    pub(crate) two_sided: bool,
}

/// A camera.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Camera {
    /// Where it is.
    pub(crate) eye: [f64; 3],
    /// What is in the middle of its picture.
    pub(crate) target: [f64; 3],
    /// What is up in its picture.
    #[serde(default = "y_axis")]
    pub(crate) up: [f64; 3],
    /// From the left edge of the picture to the right one; in a wide picture, of the square in its middle.
    #[serde(default = "normal_view")]
    pub(crate) fov_degrees: f64,
}

fn one() -> f64 {
    1.0
}

fn y_axis() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

/// Somewhat wider than what a camera with a normal lens sees.
fn normal_view() -> f64 {
    50.0
}
