use super::*;
use crate::scene::geometry::vector_area;
use crate::scene::material::Material;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::fs;

/// The corners of a unit square in floats, and their numbers in two bytes: of two triangles, then of a strip.
fn buffer() -> Vec<u8> {
    let corners = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0];
    let mut bytes: Vec<u8> = corners.iter().flat_map(|x| x.to_le_bytes()).collect();
    for index in [0u16, 1, 2, 0, 2, 3, 0, 1, 3, 2] {
        bytes.extend(index.to_le_bytes());
    }
    bytes
}

/// A document of two nodes: a white square, and a red one of a lamp's material above it, mirrored.
const DOCUMENT: &str = r#"{
    "asset": {"version": "2.0"},
    "scene": 0,
    "scenes": [{"nodes": [0, 1, 2]}],
    "nodes": [
        {"name": "floor", "mesh": 0},
        {"name": "roof", "mesh": 1, "scale": [2, 2, -2], "translation": [0, 0, 3]},
        {"name": "eye", "camera": 0, "translation": [0.5, 0.5, 9]}
    ],
    "cameras": [{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}],
    "meshes": [
        {"name": "square", "primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]},
        {"primitives": [{"attributes": {"POSITION": 0}, "indices": 2, "material": 1, "mode": 5}]}
    ],
    "materials": [
        {"name": "paper", "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.7, 0.6, 1]}, "doubleSided": true},
        {"name": "lamp", "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]},
         "emissiveFactor": [1, 0.5, 0.25],
         "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 20}}}
    ],
    "accessors": [
        {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
        {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
        {"bufferView": 1, "byteOffset": 12, "componentType": 5123, "count": 4, "type": "SCALAR"}
    ],
    "bufferViews": [
        {"buffer": 0, "byteLength": 48},
        {"buffer": 0, "byteOffset": 48, "byteLength": 20}
    ],
    "buffers": [{"uri": "a%20square.bin", "byteLength": 68}]
}"#;

fn read_gltf(document: &str) -> Result<Scene, SceneError> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("mesh.gltf");
    fs::write(folder.path().join("a square.bin"), buffer()).expect("written");
    fs::write(&path, document).expect("written");
    read(&path)
}

/// A document and its bytes in a binary file.
fn glb(document: &str, binary: &[u8]) -> Vec<u8> {
    let mut json = document.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF".to_vec();
    let length = 12 + 8 + json.len() + 8 + binary.len();
    bytes.extend([2, length as u32, json.len() as u32].map(u32::to_le_bytes).concat());
    bytes.extend(b"JSON");
    bytes.extend(json);
    bytes.extend((binary.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(binary);
    bytes
}

#[test]
fn nodes_meshes_materials_and_the_camera_come_back() {
    let scene = read_gltf(DOCUMENT).expect("valid");
    assert!(scene.check().is_ok() && scene.repairs.is_empty() && scene.missing.is_empty());
    let paper = Material { two_sided: true, ..Material::rgb("paper", [0.8, 0.7, 0.6], [0.0; 3]) };
    let lamp = Material::rgb("lamp", [0.0; 3], [20.0, 10.0, 5.0]);
    assert_eq!(scene.materials, [paper, lamp]);
    let of = |k: usize| vector_area(&scene.corners(&scene.surfaces[k]));
    assert_eq!([of(0), of(1)], [0.5 * DVec3::Z; 2]);
    // Mirrored by z, a square in the plane z = 0 looks down.
    assert_eq!([of(2), of(3)], [-2.0 * DVec3::Z; 2]);
    assert_eq!(scene.surfaces.iter().map(|s| s.material).collect::<Vec<_>>(), [0, 0, 1, 1]);
    assert!(scene.corners(&scene.surfaces[2]).iter().all(|p| p.z == 3.0));
    assert_eq!(scene.vertices.len(), 8);
    let camera = scene.camera.expect("there is one");
    assert_eq!((camera.eye, camera.target), (DVec3::new(0.5, 0.5, 9.0), DVec3::new(0.5, 0.5, 8.0)));
    assert_eq!(
        scene.describe(3),
        "triangle 2 of node 1 `roof`, mesh 1, primitive 0, of material `lamp`, around (1.333, 1.333, 3) \
         with the normal (0, 0, -1)"
    );
}

#[test]
fn buffers_in_files_in_uris_and_in_the_file_itself_are_the_same() {
    let expected = read_gltf(DOCUMENT).expect("valid");
    let data = STANDARD.encode(buffer());
    let name = "\"uri\": \"a%20square.bin\", ";
    for kind in ["application/octet-stream", "application/gltf-buffer"] {
        let uri = format!("\"uri\": \"data:{kind};base64,{data}\", ");
        let found = read_gltf(&DOCUMENT.replace(name, &uri)).expect("valid");
        assert_eq!(found.surfaces, expected.surfaces);
        assert_eq!(found.vertices, expected.vertices);
    }
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("mesh.glb");
    let write = |bytes: &[u8]| fs::write(&path, bytes).expect("written");
    let whole = glb(&DOCUMENT.replace(name, ""), &buffer());
    write(&whole);
    let found = read(&path).expect("valid");
    assert_eq!((found.surfaces, found.vertices), (expected.surfaces, expected.vertices));
    write(&glb(&DOCUMENT.replace(name, ""), &buffer()[..60]));
    let message = read(&path).expect_err("too short").to_string();
    assert!(message.ends_with("mesh.glb, buffer 0: expected 68 bytes, found 60"), "{message}");
    write(&whole[..whole.len() - 1]);
    let message = read(&path).expect_err("cut").to_string();
    assert!(message.contains("mesh.glb: expected ") && message.contains("as its header says"));
}

#[test]
fn strips_fans_and_bare_vertices_are_the_triangles_of_the_specification() {
    let corners = [10, 11, 12, 13, 14];
    let strip = triangles(STRIP, &corners).expect("long enough");
    assert_eq!(strip, [[10, 11, 12], [11, 13, 12], [12, 13, 14]]);
    let fan = triangles(FAN, &corners).expect("long enough");
    assert_eq!(fan, [[11, 12, 10], [12, 13, 10], [13, 14, 10]]);
    let bare = DOCUMENT.replacen(", \"indices\": 1", ", \"mode\": 6", 1);
    let scene = read_gltf(&bare).expect("valid");
    let areas: Vec<_> = scene.surfaces.iter().map(|s| scene.area(s)).collect();
    assert_eq!(areas, [0.5, 0.5, 2.0, 2.0]);
    assert!(scene.repairs.is_empty(), "{:?}", scene.repairs);
}

#[test]
fn what_cannot_be_used_is_refused_with_its_place() {
    let floor = "node 0 `floor`, mesh 0 `square`, primitive 0";
    for (from, to, place, expected) in [
        (
            "\"mode\": 5",
            "\"mode\": 1",
            "node 1 `roof`, mesh 1, primitive 0",
            "triangles, strips or fans",
        ),
        (
            "\"mode\": 5",
            "\"mode\": 4",
            "node 1 `roof`, mesh 1, primitive 0",
            "a multiple of three corners, found 4",
        ),
        ("\"indices\": 1", "\"targets\": [{}]", floor, "a mesh without morph targets"),
        ("\"POSITION\": 0", "\"NORMAL\": 0", floor, "an attribute POSITION, found none"),
        (
            "\"POSITION\": 0",
            "\"POSITION\": 1",
            floor,
            "floats (5126) as POSITION, found the component type 5123",
        ),
        ("\"indices\": 1", "\"indices\": 0", floor, "unsigned integers as indices, found"),
        ("\"indices\": 1", "\"indices\": 9", floor, "an accessor below 3, found 9"),
        ("\"material\": 0", "\"material\": 2", floor, "a material below 2, found 2"),
        (
            "\"count\": 4, \"type\": \"VEC3\"",
            "\"count\": 3, \"type\": \"VEC3\"",
            floor,
            "indices below 3, found 3",
        ),
        ("\"mesh\": 0}", "\"mesh\": 0, \"skin\": 0}", "node 0 `floor`", "a mesh without a skin"),
        ("\"mesh\": 0}", "\"mesh\": 5}", "node 0 `floor`", "a mesh below 2, found 5"),
        ("\"camera\": 0", "\"camera\": 1", "node 2 `eye`", "a camera below 1, found 1"),
        ("\"yfov\": 1.0", "\"yfov\": -1.0", "node 2 `eye`", "yfov between 0 and pi, found -1"),
        ("68}", "69}", "buffer 0", "69 bytes, found 68"),
        (
            "\"mesh\": 0}",
            "\"mesh\": 0, \"extensions\": {\"EXT_mesh_gpu_instancing\": {}}}",
            "node 0 `floor`",
            "a node for each of its copies",
        ),
    ] {
        let message = read_gltf(&DOCUMENT.replacen(from, to, 1)).expect_err(to).to_string();
        assert!(message.contains(&format!("mesh.gltf, {place}: expected {expected}")), "{message}");
    }
    for (from, to, expected) in [
        (
            "\"version\": \"2.0\"",
            "\"version\": \"1.0\"",
            "version 2 of glTF in `asset`, found `1.0`",
        ),
        (
            "\"scene\": 0",
            "\"extensionsRequired\": [\"KHR_draco_mesh_compression\"], \"scene\": 0",
            "a document without compression and the like, which KHR_draco_mesh_compression is",
        ),
        ("\"scene\": 0", "\"scene\": -1", "a document of glTF 2.0: invalid value: integer `-1`"),
        ("\"scene\": 0,", "\"scene\": 0", "a document of glTF 2.0: expected `,` or `}` at line 4"),
    ] {
        let message = read_gltf(&DOCUMENT.replacen(from, to, 1)).expect_err(to).to_string();
        assert!(message.contains(&format!("mesh.gltf: expected {expected}")), "{message}");
    }
}

#[test]
fn what_is_not_read_is_said() {
    let scene = read_gltf(
        &DOCUMENT
            .replacen("\"material\": 0", "\"extensions\": {\"X\": {}}", 1)
            .replacen(
                "\"camera\": 0",
                "\"camera\": 0, \"extensions\": {\"KHR_lights_punctual\": {}}",
                1,
            )
            .replacen(
                "\"emissiveFactor\"",
                "\"emissiveTexture\": {\"index\": 0}, \"emissiveFactor\"",
                1,
            )
            .replacen("[0, 0, 0, 1]}", "[0, 0, 0, 0.5]}, \"alphaMode\": \"BLEND\"", 1)
            .replacen("\"scene\": 0", "\"animations\": [{}, {}], \"scene\": 0", 1)
            .replacen("{\"nodes\": [0, 1, 2]}", "{\"nodes\": [0, 1, 2]}, {}", 1),
    );
    let scene = scene.expect("valid");
    let missing = [
        "node 0 `floor`: what primitive 0 says by X is not read",
        "node 2 `eye`: a light without a surface is not read: expected a surface that emits",
        "faces without a material made grey",
        "material `lamp`: its texture of emission is not read, the factor before it taken for the emission",
        "material `lamp`: light passes through it, which is not read: taken to be opaque",
    ];
    assert_eq!(scene.missing, missing);
    let repairs = ["scenes beside the one to show, passed over: 1", "animations, passed over: 2"];
    assert_eq!(scene.repairs, repairs);
    let white = DOCUMENT.replacen("[0.8, 0.7, 0.6, 1]", "[1, 0.7, 0.6, 1]", 1);
    let scene = read_gltf(&white).expect("valid");
    assert_eq!(scene.materials[0].reflectance, [0.999, 0.7, 0.6]);
    assert_eq!(scene.repairs, ["material `paper` reflects everything, taken for 0.999"]);
}
