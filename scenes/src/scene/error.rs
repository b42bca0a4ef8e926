//! Why there is no scene: in which file or material, where in it, and what was expected instead.

use std::io;
use std::path::PathBuf;

use glam::DVec3;

/// Every way in which a scene is refused.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// Neither a generated scene nor a file that can be read.
    #[error("`{name}`: expected one of {generators}, or a file that ends in {endings}")]
    Unknown {
        /// What was asked for.
        name: String,
        /// The generated scenes.
        generators: String,
        /// The endings of readable files.
        endings: String,
    },
    /// The system can't read a file.
    #[error("cannot read {path}: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: io::Error,
    },
    /// A line of a text file is not what it should be.
    #[error("{path}, line {line}: expected {expected}")]
    Line {
        /// The file.
        path: PathBuf,
        /// Number of the line, from 1.
        line: usize,
        /// What should be there.
        expected: String,
    },
    /// An entry of a file is not what it should be.
    #[error("{path}, {kind} {index}: expected {expected}")]
    Entry {
        /// The file.
        path: PathBuf,
        /// What sort of entry.
        kind: &'static str,
        /// Its index, from 0.
        index: usize,
        /// What it should be or have.
        expected: String,
    },
    /// A file is not what it should be.
    #[error("{path}: expected {expected}")]
    File {
        /// The file.
        path: PathBuf,
        /// What it should be or have.
        expected: String,
    },
    /// A scene description that isn't valid TOML, or not one of a scene.
    #[error("{path}: {source}")]
    Toml {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where.
        source: Box<toml::de::Error>,
    },
    /// A PLY file that its reader refuses.
    #[error("{path}: {problem}")]
    Ply {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where.
        problem: String,
    },
    /// A glTF file whose document isn't valid JSON, or not that of an asset.
    #[error("{path}: expected a document of glTF 2.0: {source}")]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where.
        source: serde_json::Error,
    },
    /// A part of a glTF asset that can't be used.
    #[error("{path}, {place}: expected {expected}")]
    Gltf {
        /// The file.
        path: PathBuf,
        /// Which node, mesh and primitive, or which other part.
        place: String,
        /// What it should be or have.
        expected: String,
    },
    /// A scene without anything in it.
    #[error("the scene has neither surfaces nor points: expected at least one of them")]
    Empty,
    /// A reflectance outside the interval [0, 1].
    #[error("material `{material}` has the reflectance {found} in band {band}: expected 0 to 1")]
    Reflectance {
        /// Name of the material.
        material: String,
        /// Index of the band.
        band: usize,
        /// The reflectance.
        found: f64,
    },
    /// An emission that is negative, NaN or infinite.
    #[error(
        "material `{material}` has the emission {found} in band {band}: expected a finite number, \
         0 or more"
    )]
    Emission {
        /// Name of the material.
        material: String,
        /// Index of the band.
        band: usize,
        /// The emission.
        found: f64,
    },
    /// A temperature that is negative, NaN or infinite.
    #[error(
        "material `{material}` has the temperature {found} K: expected a finite number, 0 or more"
    )]
    Temperature {
        /// Name of the material.
        material: String,
        /// The temperature \[K].
        found: f64,
    },
    /// A material that has not as many bands as the others, or none.
    #[error("material `{material}` has {found} bands of {what}: expected {expected}")]
    Bands {
        /// Name of the material.
        material: String,
        /// Reflectance or emission.
        what: &'static str,
        /// How many it has.
        found: usize,
        /// How many it should have.
        expected: String,
    },
    /// A vertex of a mesh in memory that has a coordinate that is NaN or infinite.
    #[error("vertex {vertex} is at {found:?}: expected finite coordinates")]
    Coordinates {
        /// Its index.
        vertex: usize,
        /// Where it is.
        found: [f64; 3],
    },
    /// A surface or a point of a material that doesn't exist.
    #[error("{kind} {index} is of material {found}: expected less than {materials}")]
    Material {
        /// What it is.
        kind: &'static str,
        /// Its index.
        index: usize,
        /// The index of its material.
        found: usize,
        /// How many materials there are.
        materials: usize,
    },
    /// A surface of a vertex that doesn't exist.
    #[error("surface {surface} has a corner at vertex {found}: expected less than {vertices}")]
    Vertex {
        /// Index of the surface.
        surface: usize,
        /// The index of the vertex.
        found: u32,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A surface that isn't a flat convex piece.
    #[error("surface {index}: {source}; it is {place}")]
    Surface {
        /// Its index.
        index: usize,
        /// What is wrong with it.
        source: farfield_radiosity::Error,
        /// Which entry of which file it is, its material, and where.
        place: String,
    },
    /// An oriented point that isn't one.
    #[error("point {index}: expected {expected}")]
    Point {
        /// Its index.
        index: usize,
        /// What it should have.
        expected: &'static str,
    },
    /// A camera that looks nowhere.
    #[error("camera: {what} at {found}, expected {expected}")]
    Camera {
        /// Its eye, its target, or what is up.
        what: &'static str,
        /// Where that is.
        found: DVec3,
        /// Where it should be.
        expected: &'static str,
    },
    /// More elements than a run can take.
    #[error("{found} elements: expected {limit} at most")]
    TooManyElements {
        /// How many were asked for, or are needed at least.
        found: f64,
        /// How many there may be.
        limit: usize,
    },
    /// Cuts of a mesh that don't belong to its scene.
    #[error("cuts of {found} surfaces: expected {expected}, all of them 1 or more")]
    Cuts {
        /// How many there are.
        found: usize,
        /// How many surfaces the scene has.
        expected: usize,
    },
}
