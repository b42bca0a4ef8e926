//! Damaged scene files: read, repaired or refused, whatever is in them.

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};

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
    ] {
        let path = folder.path().join(format!("damaged.{ending}"));
        fs::write(&path, text).expect("written");
        assert!(load(&path.to_string_lossy()).is_err(), "{ending}");
    }
    let (stl, ply) = (binary_stl(), binary_ply());
    for (ending, samples) in [
        ("obj", vec![OBJ.as_bytes()]),
        ("off", vec![OFF.as_bytes()]),
        ("stl", vec![STL.as_bytes(), &stl]),
        ("ply", vec![PLY.as_bytes(), CLOUD.as_bytes(), &ply]),
        ("vs3", vec![VS3.as_bytes()]),
        ("toml", vec![TOML.as_bytes()]),
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
