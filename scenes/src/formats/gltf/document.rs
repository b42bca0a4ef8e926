//! What a glTF 2.0 document holds, as far as it is read here.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde::de::IgnoredAny;

/// A document. Whatever it doesn't say is empty, or has the default of the specification.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(crate) struct Document {
    pub(crate) asset: Asset,
    /// Extensions that can't be left out.
    pub(crate) extensions_required: Vec<String>,
    /// Index of the scene to show.
    pub(crate) scene: Option<usize>,
    pub(crate) scenes: Vec<Roots>,
    pub(crate) nodes: Vec<Node>,
    pub(crate) meshes: Vec<Mesh>,
    pub(crate) materials: Vec<Material>,
    pub(crate) cameras: Vec<Camera>,
    pub(crate) animations: Vec<IgnoredAny>,
    pub(crate) accessors: Vec<Accessor>,
    pub(crate) buffer_views: Vec<BufferView>,
    pub(crate) buffers: Vec<Buffer>,
}

/// What is said beyond the specification, by the names of extensions.
pub(crate) type Extensions = BTreeMap<String, serde_json::Value>;

/// The format's version, such as `2.0`, and the least that reads it.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(crate) struct Asset {
    pub(crate) version: String,
    pub(crate) min_version: Option<String>,
}

/// A scene: the nodes at the roots of its trees.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct Roots {
    pub(crate) nodes: Vec<usize>,
}

/// A place in a tree, by a matrix, column by column, or by a scale, a rotation (x, y, z, w) and a translation.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct Node {
    pub(crate) name: Option<String>,
    pub(crate) children: Vec<usize>,
    pub(crate) matrix: Option<[f64; 16]>,
    pub(crate) translation: Option<[f64; 3]>,
    pub(crate) rotation: Option<[f64; 4]>,
    pub(crate) scale: Option<[f64; 3]>,
    pub(crate) mesh: Option<usize>,
    pub(crate) camera: Option<usize>,
    pub(crate) skin: Option<usize>,
    pub(crate) extensions: Extensions,
}

/// Primitives that belong together.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct Mesh {
    pub(crate) name: Option<String>,
    pub(crate) primitives: Vec<Primitive>,
}

/// Triangles of one material.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct Primitive {
    /// Accessors by what they are of a vertex.
    pub(crate) attributes: BTreeMap<String, usize>,
    /// The accessor of the numbers of corners; without one, corners are the vertices in their order.
    pub(crate) indices: Option<usize>,
    pub(crate) material: Option<usize>,
    /// How corners make triangles; 4 if it isn't said.
    pub(crate) mode: Option<u32>,
    pub(crate) targets: Vec<IgnoredAny>,
    pub(crate) extensions: Extensions,
}

/// A material of the model of metals and roughness.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(crate) struct Material {
    pub(crate) name: Option<String>,
    pub(crate) pbr_metallic_roughness: Pbr,
    pub(crate) emissive_factor: Option<[f64; 3]>,
    pub(crate) emissive_texture: Option<IgnoredAny>,
    pub(crate) alpha_mode: Option<String>,
    pub(crate) double_sided: bool,
    pub(crate) extensions: Extensions,
}

/// What a material reflects.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(crate) struct Pbr {
    pub(crate) base_color_factor: Option<[f64; 4]>,
    pub(crate) base_color_texture: Option<IgnoredAny>,
}

/// A camera.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct Camera {
    pub(crate) perspective: Option<Perspective>,
}

/// A pinhole camera.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Perspective {
    /// The angle between the lower and the upper edge of the picture.
    pub(crate) yfov: f64,
    /// Width over height.
    pub(crate) aspect_ratio: Option<f64>,
}

/// Numbers in a buffer view, or zeros, of which some are replaced.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Accessor {
    pub(crate) buffer_view: Option<usize>,
    #[serde(default)]
    pub(crate) byte_offset: usize,
    pub(crate) component_type: u32,
    #[serde(default)]
    pub(crate) normalized: bool,
    pub(crate) count: usize,
    #[serde(rename = "type")]
    pub(crate) shape: String,
    pub(crate) sparse: Option<Sparse>,
}

/// Which entries are replaced, and by what.
#[derive(Debug, Deserialize)]
pub(crate) struct Sparse {
    pub(crate) count: usize,
    pub(crate) indices: SparseIndices,
    pub(crate) values: SparseValues,
}

/// Where the numbers of replaced entries are.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct SparseIndices {
    pub(crate) buffer_view: usize,
    #[serde(default)]
    pub(crate) byte_offset: usize,
    pub(crate) component_type: u32,
}

/// Where what replaces them is.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct SparseValues {
    pub(crate) buffer_view: usize,
    #[serde(default)]
    pub(crate) byte_offset: usize,
}

/// A part of a buffer.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct BufferView {
    pub(crate) buffer: usize,
    #[serde(default)]
    pub(crate) byte_offset: usize,
    pub(crate) byte_length: usize,
    /// From one entry to the next; they follow each other closely if it isn't said.
    pub(crate) byte_stride: Option<usize>,
}

/// Bytes: of a file, of a data URI, or, without a URI, those that follow the document in a .glb file.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Buffer {
    pub(crate) uri: Option<String>,
    pub(crate) byte_length: usize,
}
