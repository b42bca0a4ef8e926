//! Damaged files of points and charges. Those of scenes are damaged in the tests of `farfield-scenes`.

use std::fs;

use glam::DVec3;

use super::read;
use farfield_testing::damage::for_each_damaged;

/// Damaged copies of each file without the environment's asking for more.
const COPIES: u64 = 1500;

#[test]
fn damaged_files_are_read_or_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let array = |shape: &str, numbers: &[f64]| {
        let mut header =
            format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}").into_bytes();
        header.resize(117, b' ');
        header.push(b'\n');
        let start = [&b"\x93NUMPY\x01\x00"[..], &118u16.to_le_bytes()].concat();
        let numbers: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        [start, header, numbers].concat()
    };
    let points = array("(2, 3)", &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    let charges = array("(3,)", &[0.5, -1.0, 2e30]);
    let table = b"x,y,z\n0.5,1,2\n-1e3, 4 ,5\r\n3,.5,6\n".to_vec();
    let column = b"1\n2.5\n-3e-4\n".to_vec();

    // A header that speaks of more than there is, and a table of as many numbers in other rows.
    for (name, bytes, expected) in [
        ("long.npy", array("(1000000000000, 3)", &[0.0; 6]), "48 bytes of data"),
        ("vast.npy", array("(18446744073709551615, 3)", &[0.0; 6]), "48 bytes of data"),
        ("short.npy", array("(1, 3)", &[0.0; 6]), "48 bytes of data"),
        ("ragged.csv", b"1,2\n3,4,5,6\n".to_vec(), "line 1 has 2 columns"),
    ] {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        let refused = read::points::<f64>(&path).unwrap_err().to_string();
        assert!(refused.contains(expected), "{refused}");
    }

    let (mut accepted, mut refused) = (0u64, 0u64);
    let mut count = |ok: bool| if ok { accepted += 1 } else { refused += 1 };
    let mut tried = 0;
    for (name, samples) in [("npy", [&points[..], &charges]), ("csv", [&table[..], &column])] {
        let path = folder.path().join(format!("damaged.{name}"));
        tried += for_each_damaged(&samples, COPIES, |seed, bytes| {
            fs::write(&path, bytes).unwrap();
            match read::points::<f64>(&path) {
                Ok(points) => {
                    let finite = |p: &DVec3| p.to_array().iter().all(|x| x.is_finite());
                    assert!(points.iter().all(finite), "{name}, seed {seed}");
                    count(true);
                }
                Err(error) => {
                    assert!(error.to_string().contains("damaged."), "{name}, {seed}: {error}");
                    count(false);
                }
            }
            let narrow = read::charges::<f32>(&path, 1);
            assert!(narrow.is_err() || narrow.unwrap().iter().all(|q| q.is_finite()));
        });
    }
    assert!(accepted > 100 && refused > 100, "{accepted} {refused}");
    let share = 100.0 * accepted as f64 / (accepted + refused) as f64;
    println!("{tried} files: {share:.0} % read, all finite; the others refused by name and line");
}
