//! Scenes from glTF 2.0 (.gltf and .glb).

mod accessor;
mod container;
mod document;
mod materials;
mod places;
#[cfg(test)]
pub(crate) mod for_tests;
#[cfg(test)]
mod tests;

use std::path::Path;

use glam::DVec3;

use crate::formats::gltf::accessor::Content;
use crate::formats::gltf::document::{Document, Primitive};
use crate::formats::gltf::materials::Materials;
use crate::formats::gltf::places::{Placed, name, named, nodes, viewpoint};
use crate::formats::text::read_bytes;
use crate::repair::soup::Soup;
use crate::scene::Scene;
use crate::scene::error::SceneError;
use crate::scene::place::Part;

/// The scene in a glTF file, .glb or .gltf with its buffers in files beside it or in data URIs, in the bands red,
/// green and blue, in metres.
///
/// The scene to show is read: the triangles of all its meshes, placed by their nodes, and its first camera.
/// The base colour of a material is its reflectance; its emissive factor, times the strength that
/// `KHR_materials_emissive_strength` says, is the emitted exitance. Textures, alpha and lights without a surface are
/// not read, and noted as missing; whatever else says nothing of surfaces is passed over.
///
/// # Errors
/// [`SceneError::Read`], [`SceneError::Json`] for what isn't a document, [`SceneError::File`] for what is wrong with
/// a file as a whole, or [`SceneError::Gltf`] for what can't be used of it: skins, morph targets, compressed meshes,
/// points and lines among them.
pub(crate) fn read(path: &Path) -> Result<Scene, SceneError> {
    let bytes = read_bytes(path)?;
    let content = container::open(path, &bytes)?;
    check_version(path, &content.document)?;
    let placed = nodes(path, &content.document)?;
    let mut reading = Reading {
        path,
        content,
        soup: Soup::default(),
        materials: Materials::default(),
        groups: Vec::new(),
        polygons: 0,
        missing: Vec::new(),
    };
    placed.iter().try_for_each(|node| reading.add_node(node))?;
    reading.into_scene(&placed)
}

/// Extensions that may be required, beyond those of materials that are read: what they change is of no concern.
const KNOWN: [&str; 5] =
    [QUANTIZATION, "KHR_texture_transform", "KHR_texture_basisu", "EXT_texture_webp", LIGHTS];
/// Positions may be integers.
const QUANTIZATION: &str = "KHR_mesh_quantization";
/// Lights without a surface.
const LIGHTS: &str = "KHR_lights_punctual";
/// Copies of a mesh that no node says.
const INSTANCES: &str = "EXT_mesh_gpu_instancing";

/// Checks that a document is one of version 2, and needs nothing that isn't known.
fn check_version(path: &Path, document: &Document) -> Result<(), SceneError> {
    let refusal = |expected| Err(SceneError::File { path: path.to_owned(), expected });
    let asset = &document.asset;
    if !asset.version.starts_with("2.") {
        return refusal(format!("version 2 of glTF in `asset`, found `{}`", asset.version));
    }
    if let Some(least) = asset.min_version.as_ref().filter(|&least| least != "2.0") {
        return refusal(format!("a document that version 2.0 of glTF reads, found `{least}`"));
    }
    let is_unknown = |&name: &&String| !KNOWN.contains(&name.as_str()) && !materials::is_read(name);
    match document.extensions_required.iter().find(is_unknown) {
        Some(name) => {
            refusal(format!("a document without compression and the like, which {name} is"))
        }
        None => Ok(()),
    }
}

/// A scene in the making.
struct Reading<'a> {
    path: &'a Path,
    content: Content<'a>,
    soup: Soup,
    materials: Materials,
    /// The primitives so far: what they are called, and how many polygons there were before them.
    groups: Vec<(String, u32)>,
    polygons: u32,
    /// What is in the document and isn't read, one sentence each.
    missing: Vec<String>,
}

/// Vertices and corners of all primitives at most, each counted as often as it is placed.
const MOST_CORNERS: usize = 24_000_000;

impl Reading<'_> {
    /// Adds all primitives of a node's mesh.
    fn add_node(&mut self, placed: &Placed) -> Result<(), SceneError> {
        let whose = name(&self.content.document, placed.node);
        let node = &self.content.document.nodes[placed.node];
        for extension in node.extensions.keys() {
            let what = match extension.as_str() {
                INSTANCES => {
                    let expected = format!("a node for each of its copies, found {INSTANCES}");
                    return Err(self.refusal(&whose, expected));
                }
                LIGHTS => "a light without a surface is not read: expected a surface that emits"
                    .to_owned(),
                other => format!("what it says by {other} is not read"),
            };
            self.missing.push(format!("{whose}: {what}"));
        }
        if node.skin.is_some() {
            return Err(
                self.refusal(&whose, "a mesh without a skin, baked as it is to be".to_owned())
            );
        }
        let Some(index) = node.mesh else { return Ok(()) };
        let meshes = &self.content.document.meshes;
        let Some(mesh) = meshes.get(index) else {
            let expected = format!("a mesh below {}, found {index}", meshes.len());
            return Err(self.refusal(&whose, expected));
        };
        let whose = format!("{whose}, {}", named("mesh", index, mesh.name.as_deref()));
        for number in 0..mesh.primitives.len() {
            let whose = format!("{whose}, primitive {number}");
            self.add_primitive(placed, index, number)
                .map_err(|expected| self.refusal(&whose, expected))?;
            self.groups.push((whose, self.polygons));
            self.polygons = self.soup.vertices() / 3;
        }
        Ok(())
    }

    /// Adds the triangles of a primitive, placed.
    ///
    /// # Errors
    /// What was expected of it.
    fn add_primitive(&mut self, placed: &Placed, mesh: usize, number: usize) -> Result<(), String> {
        let content = &self.content;
        let primitive = &content.document.meshes[mesh].primitives[number];
        if !primitive.targets.is_empty() {
            return Err("a mesh without morph targets, baked as it is to be".to_owned());
        }
        let positions = positions(content, primitive)?;
        let corners = match primitive.indices {
            Some(accessor) => content.indices(accessor)?,
            None => (0..positions.len()).collect(),
        };
        let so_far = self.soup.vertices() as usize;
        if so_far + positions.len().max(3 * corners.len()) > MOST_CORNERS {
            return Err(format!("{MOST_CORNERS} corners at most in the whole scene"));
        }
        if let Some(&index) = corners.iter().find(|&&index| index >= positions.len()) {
            return Err(format!("indices below {}, found {index}", positions.len()));
        }
        let triangles = triangles(primitive.mode.unwrap_or(TRIANGLES), &corners)?;
        for extension in primitive.extensions.keys() {
            let whose = name(&content.document, placed.node);
            self.missing
                .push(format!("{whose}: what primitive {number} says by {extension} is not read"));
        }
        if primitive.attributes.contains_key("COLOR_0") {
            let whose = name(&content.document, placed.node);
            let what = "the colours of its vertices are not read, those of its material are";
            self.missing.push(format!("{whose}: primitive {number}: {what}"));
        }
        let material = self.materials.number(&content.document, primitive.material)?;
        // What is mirrored is turned inside out, and back again.
        let mirrored = placed.place.matrix3.determinant() < 0.0;
        for [a, b, c] in triangles {
            let first = self.soup.vertices();
            let corners = if mirrored { [a, c, b] } else { [a, b, c] };
            for corner in corners {
                let place = placed.place.transform_point3(positions[corner]);
                if !place.is_finite() {
                    return Err(format!(
                        "finite places of vertices, found {place} of vertex {corner}"
                    ));
                }
                self.soup.add_vertex(place);
            }
            self.soup.add_polygon(&[first, first + 1, first + 2], material);
        }
        Ok(())
    }

    /// The scene of all that has been added, with the first camera of the nodes.
    fn into_scene(self, placed: &[Placed]) -> Result<Scene, SceneError> {
        let mut cameras = placed
            .iter()
            .filter_map(|placed| Some((placed, self.content.document.nodes[placed.node].camera?)));
        let mut repairs = Vec::new();
        let mut camera = None;
        if let Some((placed, index)) = cameras.next() {
            let whose = name(&self.content.document, placed.node);
            let all = &self.content.document.cameras;
            let Some(entry) = all.get(index) else {
                let expected = format!("a camera below {}, found {index}", all.len());
                return Err(self.refusal(&whose, expected));
            };
            match &entry.perspective {
                None => repairs.push(format!("camera of {whose} without perspective, passed over")),
                Some(perspective) => {
                    let view = viewpoint(&placed.place, perspective);
                    camera = Some(view.map_err(|expected| self.refusal(&whose, expected))?);
                }
            }
        }
        let document = &self.content.document;
        for (count, what) in [
            (cameras.count(), "cameras beside the first, passed over"),
            (document.scenes.len().saturating_sub(1), "scenes beside the one to show, passed over"),
            (document.animations.len(), "animations, passed over"),
        ] {
            repairs.extend((count > 0).then(|| format!("{what}: {count}")));
        }
        let Materials { materials, missing, repairs: mut of_materials, .. } = self.materials;
        let mut scene = self.soup.into_scene(materials);
        repairs.append(&mut of_materials);
        repairs.append(&mut scene.repairs);
        let numbers = scene.parts.pop().unwrap_or_default().numbers;
        let parts = parts(&self.groups, &numbers);
        let missing = [self.missing, missing].concat();
        Ok(Scene { camera, parts, repairs, missing, ..scene })
    }

    fn refusal(&self, place: &str, expected: String) -> SceneError {
        SceneError::Gltf { path: self.path.to_owned(), place: place.to_owned(), expected }
    }
}

/// Corners in threes, each after the first two with these, and each with the one before it and the first.
const TRIANGLES: u32 = 4;
const STRIP: u32 = 5;
const FAN: u32 = 6;

/// The positions of a primitive's vertices.
fn positions(content: &Content, primitive: &Primitive) -> Result<Vec<DVec3>, String> {
    let Some(&accessor) = primitive.attributes.get("POSITION") else {
        return Err("an attribute POSITION, found none".to_owned());
    };
    let kind = content.accessor(accessor)?.component_type;
    let quantized = content.document.extensions_required.iter().any(|name| name == QUANTIZATION);
    if kind != FLOAT && !quantized {
        return Err(format!("floats (5126) as POSITION, found the component type {kind}"));
    }
    Ok(content.numbers(accessor)?.into_iter().map(DVec3::from_array).collect())
}

/// The component type of single precision.
const FLOAT: u32 = 5126;

/// The triangles of corners, counter-clockwise around their fronts.
fn triangles(mode: u32, corners: &[usize]) -> Result<Vec<[usize; 3]>, String> {
    let count = corners.len();
    match mode {
        _ if count < 3 => Err(format!("three corners or more, found {count}")),
        TRIANGLES => match corners.as_chunks::<3>() {
            (triangles, []) => Ok(triangles.to_vec()),
            _ => Err(format!("a multiple of three corners, found {count}")),
        },
        STRIP => {
            let triangle = |k: usize| match k % 2 {
                0 => [corners[k], corners[k + 1], corners[k + 2]],
                _ => [corners[k], corners[k + 2], corners[k + 1]],
            };
            Ok((0..count - 2).map(triangle).collect())
        }
        FAN => Ok((1..count - 1).map(|k| [corners[k], corners[k + 1], corners[0]]).collect()),
        _ => {
            Err(format!("triangles, strips or fans of them (modes 4 to 6), found the mode {mode}"))
        }
    }
}

/// The surfaces of each primitive, numbered within it, given the number of the polygon of each surface.
fn parts(groups: &[(String, u32)], numbers: &[u32]) -> Vec<Part> {
    let mut parts = Vec::new();
    let mut first = 0;
    for (k, (whose, before)) in groups.iter().enumerate() {
        let after = groups.get(k + 1).map_or(u32::MAX, |(_, before)| *before);
        let own = numbers[first..].iter().take_while(|&&number| number <= after);
        let numbers: Vec<u32> = own.map(|number| number - before).collect();
        let next = first + numbers.len();
        parts.push(Part { file: whose.clone(), kind: "triangle", first, numbers });
        first = next;
    }
    parts
}
