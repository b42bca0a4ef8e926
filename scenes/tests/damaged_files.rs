//! Damaged scene files: read, repaired or refused, whatever is in them.

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use farfield_scenes::load;
use farfield_testing::damage::{damaged, for_each_damaged};

/// Damaged copies of each file without the environment's asking for more.
const COPIES: u64 = 400;

const OBJ: &str = "mtllib damaged.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\n\
                   usemtl red\nf 1 2 3 4\nf 1//1 2//1 5//1\nf -5 -4 -1\n";
const OFF: &str = "OFF\n# comment\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 2 3 255 0 0\n";
const STL: &str = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n\
                   endloop\nendfacet\nendsolid a\n";
const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
                   property float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n\
                   0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 2 3\n";
const CLOUD: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
                     property float z\nproperty float nx\nproperty float ny\nproperty float nz\n\
                     end_header\n0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n";
const VS3: &str = "T pair\nC encl=0 out=1\nF 3\nV 1 0 0 0\nV 2 1 0 0\nV 3 1 1 0\nV 4 0 1 0\n\
                   V 5 0 0 1\nV 6 1 0 1\nV 7 1 1 1\n! pair\nS 1 1 2 3 4 0 0 0.9 low\n\
                   S 2 7 6 5 0 0 1 0.5 high\nO 3 1 2 7 0 0 0 .5 O\nEnd\n";
const TOML: &str = "[[quad]]\ncorners = [[0, 0, 0], [0, 0, 2], [2, 0, 2], [2, 0, 0]]\n\
                    material = \"white\"\n[materials.white]\nreflectance = [0.7, 0.7, 0.7]\n\
                    emission = [1, 1, 1]\n";

const GLTF: &str = r#"{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0, "children": [1], "scale": [2, 2, 2]}, {"camera": 0, "translation": [0, 0, 9]}],
    "cameras": [{"perspective": {"yfov": 1, "aspectRatio": 1.5}}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0, "mode": 5}]}],
    "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1]}, "emissiveFactor": [1, 1, 1],
    "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 2}}}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
    {"bufferView": 1, "byteOffset": 0, "componentType": 5121, "count": 4, "type": "SCALAR"}],
    "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 4}],
    "buffers": [{"byteLength": 52}]}"#;

/// The bytes of that document: the corners of a unit square, and their numbers.
fn gltf_bytes() -> Vec<u8> {
    let corners = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0];
    let mut bytes: Vec<u8> = corners.iter().flat_map(|x: &f32| x.to_le_bytes()).collect();
    bytes.extend([0, 1, 2, 3]);
    bytes
}

/// The document with its bytes in a data URI.
fn gltf() -> String {
    let uri = format!("\"data:application/gltf-buffer;base64,{}\"", STANDARD.encode(gltf_bytes()));
    GLTF.replacen("\"byteLength\": 52", &format!("\"uri\": {uri}, \"byteLength\": 52"), 1)
}

/// The document and its bytes in one file.
fn glb() -> Vec<u8> {
    let mut json = GLTF.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let binary = gltf_bytes();
    let length = 12 + 8 + json.len() + 8 + binary.len();
    let mut bytes = b"glTF".to_vec();
    bytes.extend([2, length as u32, json.len() as u32].map(u32::to_le_bytes).concat());
    bytes.extend(b"JSON");
    bytes.extend(json);
    bytes.extend((binary.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(binary);
    bytes
}

/// A triangle in the binary form of STL.
fn binary_stl() -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend(1u32.to_le_bytes());
    let numbers = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    bytes.extend(numbers.iter().flat_map(|x: &f32| x.to_le_bytes()));
    bytes.extend([0, 0]);
    bytes
}

/// The triangle in the binary form of PLY.
fn binary_ply() -> Vec<u8> {
    let header = PLY.split("0 0 0\n").next().unwrap_or_default();
    let mut bytes = header.replace("ascii", "binary_little_endian").into_bytes();
    let corners = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    bytes.extend(corners.iter().flat_map(|x: &f32| x.to_le_bytes()));
    for corners in [[0, 1, 2], [0, 2, 3]] {
        bytes.push(3);
        bytes.extend(corners.iter().flat_map(|i: &i32| i.to_le_bytes()));
    }
    bytes
}

#[test]
fn damaged_scenes_are_read_or_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let material = "newmtl red\nKd 0.6 0.1 0.1\nKe 0 0 0\n";
    fs::write(folder.path().join("damaged.mtl"), material).expect("written");
    // What damage at random seldom does: a number that is read, and is none.
    for (ending, text) in [
        ("obj", OBJ.replacen("v 1 1 0", "v 1 nan 0", 1)),
        ("off", OFF.replacen("\n1 0 0", "\nnan 0 0", 1)),
        ("stl", STL.replacen("vertex 1 0 0", "vertex inf 0 0", 1)),
        ("ply", PLY.replacen("\n1 0 0", "\nnan 0 0", 1)),
        ("vs3", VS3.replacen("V 2 1 0 0", "V 2 nan 0 0", 1)),
        ("toml", TOML.replacen("2, 0, 0", "2, nan, 0", 1)),
        ("gltf", gltf().replacen("[2, 2, 2]", "[2, 1e999, 2]", 1)),
    ] {
        let path = folder.path().join(format!("damaged.{ending}"));
        fs::write(&path, text).expect("written");
        assert!(load(&path.to_string_lossy()).is_err(), "{ending}");
    }
    let (stl, ply, gltf, glb) = (binary_stl(), binary_ply(), gltf(), glb());
    for (ending, samples) in [
        ("obj", vec![OBJ.as_bytes()]),
        ("off", vec![OFF.as_bytes()]),
        ("stl", vec![STL.as_bytes(), &stl]),
        ("ply", vec![PLY.as_bytes(), CLOUD.as_bytes(), &ply]),
        ("vs3", vec![VS3.as_bytes()]),
        ("toml", vec![TOML.as_bytes()]),
        ("gltf", vec![gltf.as_bytes()]),
        ("glb", vec![&glb[..]]),
    ] {
        let path = folder.path().join(format!("damaged.{ending}"));
        let name = path.to_string_lossy();
        let (mut accepted, mut refused) = (0, 0);
        let mut read = |bytes: &[u8]| {
            fs::write(&path, bytes).expect("written");
            match load(&name) {
                Ok(scene) => {
                    let corners = scene.surfaces.iter().flat_map(|s| scene.corners(s));
                    let positions = scene.points.iter().map(|point| point.position);
                    assert!(corners.chain(positions).all(|p| p.is_finite()));
                    accepted += 1;
                }
                Err(error) => {
                    assert!(!error.to_string().is_empty());
                    refused += 1;
                }
            }
        };
        for sample in &samples {
            read(sample);
        }
        let tried = for_each_damaged(&samples, COPIES, |seed, bytes| {
            let outcome = catch_unwind(AssertUnwindSafe(|| read(bytes)));
            assert!(
                outcome.is_ok(),
                "{ending}, seed {seed}: {:?}",
                bytes.escape_ascii().to_string()
            );
        });
        println!("{ending}: {tried} damaged files, {accepted} read, {refused} refused");
        assert!(accepted > samples.len() && refused > 0, "{ending}: {accepted} {refused}");
    }
}

#[test]
fn damaged_material_files_are_read_or_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let [mesh, materials] = ["damaged.obj", "damaged.mtl"].map(|name| folder.path().join(name));
    fs::write(&mesh, OBJ.replacen("mtllib", "mtllib none.mtl", 1)).expect("written");
    let sample =
        "newmtl red # wall\nKd 1 .1 \\\n.1\nKe 0 0 0\nnewmtl red\nKd .5 # grey\n".as_bytes();
    let (mut accepted, mut refused) = (0, 0);
    for_each_damaged(&[sample], COPIES, |seed, bytes| {
        fs::write(&materials, bytes).expect("written");
        let read = catch_unwind(|| load(&mesh.to_string_lossy()));
        match read.unwrap_or_else(|_| panic!("seed {seed}: {:?}", bytes.escape_ascii().to_string()))
        {
            Ok(scene) => {
                assert!(scene.missing.contains(&"material file `none.mtl` not found".to_owned()));
                accepted += 1;
            }
            Err(error) => {
                assert!(!error.to_string().is_empty());
                refused += 1;
            }
        }
    });
    assert!(accepted > 0 && refused > 0, "{accepted} {refused}");
}

#[test]
fn damage_is_the_same_for_a_seed_and_differs_between_seeds() {
    let copies: Vec<Vec<u8>> = (0..100).map(|seed| damaged(seed, OBJ.as_bytes())).collect();
    assert_eq!(copies[7], damaged(7, OBJ.as_bytes()));
    assert!(copies.windows(2).filter(|pair| pair[0] != pair[1]).count() > 90);
}
