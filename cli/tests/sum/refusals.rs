//! Input that `sum` refuses: with one line that says where the fault is, and without leaving a file.

use std::fs;

use ndarray::Array1;
use ndarray_npy::write_npy;

use super::{Folder, OWN, fail, write_points};

#[test]
fn malformed_files_are_refused_by_name_and_place() {
    let folder = Folder::new(4);
    let points = "0,0,0\n1,0,0\n0,1,0\n0,0,1\n";
    let cases: [(&str, Vec<u8>, &[&str]); 25] = [
        ("nan.csv", points.replace("0,1,0", "0,nan,0").into(), &["line 3, column 2", "finite"]),
        ("infinite.csv", points.replace("1,0,0", "1,0,inf").into(), &["line 2, column 3"]),
        ("word.csv", points.replace("0,0,1", "0,zero,1").into(), &["line 4, column 2", "zero"]),
        ("blank.csv", points.replace("1,0,0", "\n\n1,,0").into(), &["line 4, column 2"]),
        ("windows.csv", points.replace('\n', "\r\n").replace("1,0,0", "1,x,0").into(), &["line 2"]),
        ("unended.csv", format!("x,y,z\n{points}0,0,e").into(), &["line 6, column 3"]),
        ("fortran.csv", "0.5d0,1d0,1d0\n".into(), &["line 1, column 1", "0.5d0"]),
        ("quoted.csv", "\"0.5\",\"1\",\"-.1\"\n".into(), &["line 1, column 1"]),
        ("two.csv", "x,y\n0,1\n".into(), &["line 1 has 2 columns", "expected 3"]),
        ("ragged.csv", points.replace("0,1,0", "0,1").into(), &["line 3 has 2 columns", "3"]),
        ("bytes.csv", b"0,0,0\n\xff,0,0\n".into(), &["line 2", "UTF-8"]),
        ("empty.csv", "".into(), &["empty"]),
        ("empty.npy", "".into(), &["empty"]),
        ("text.npy", points.into(), &["not an npy file"]),
        ("short.npy", b"\x93NUMPY\x01\x00".into(), &["not an npy file", "ends"]),
        ("garbled.npy", npy("{'descr': }", 0), &["not an npy file", "malformed"]),
        ("integers.npy", npy(&header("<i8", "(4, 3)"), 96), &["'<i8'", "'<f8'"]),
        ("big.npy", npy(&header(">f8", "(4, 3)"), 96), &["'>f8'", "little-endian"]),
        ("wide.npy", npy(&header("<f8", "(4, 4)"), 128), &["[4, 4]", "[N, 3]"]),
        ("flat.npy", npy(&header("<f8", "(12,)"), 96), &["[12]", "[N, 3]"]),
        ("cut.npy", npy(&header("<f8", "(4, 3)"), 95), &["95 bytes", "96"]),
        ("long.npy", npy(&header("<f8", "(4, 3)"), 97), &["97 bytes", "96"]),
        ("huge.npy", npy(&header("<f8", "(6000000000000000000, 3)"), 9), &["9 bytes"]),
        ("points.txt", points.into(), &["unknown file type", ".npy or .csv"]),
        ("points", points.into(), &["unknown file type"]),
    ];
    for (name, content, expected) in cases {
        folder.write(name, content);
        refused(
            &folder,
            &format!("--points {name} --charges charges.npy --kernel inverse-distance"),
            &[&[name], expected].concat(),
        );
        refused(
            &folder,
            &format!("{OWN} --targets {name} --kernel inverse-distance"),
            &[&[name], expected].concat(),
        );
        fs::remove_file(folder.path(name)).unwrap();
    }
}

#[test]
fn numbers_that_are_not_finite_are_refused_by_index() {
    let folder = Folder::new(4);
    let write = |name: &str, index: usize, value: f64| {
        let mut points = folder.points.clone();
        points[index].z = value;
        write_points(&folder.path(name), &points);
    };
    let charges = "--charges charges.npy --kernel inverse-distance";
    write("bad.npy", 2, f64::NAN);
    refused(&folder, &format!("--points bad.npy {charges}"), &["bad.npy", "[2, 2]", "NaN"]);
    write("bad.npy", 3, f64::INFINITY);
    refused(&folder, &format!("--points bad.npy {charges}"), &["bad.npy", "[3, 2]", "inf"]);
    write("bad.npy", 1, 1e39);
    let flags = format!("--points bad.npy {charges} --precision f32");
    refused(&folder, &flags, &["bad.npy", "[1, 2]", "f32"]);

    write_npy(folder.path("bad.npy"), &Array1::from(vec![1.0, f64::NAN, 1.0, 1.0])).unwrap();
    let flags = "--points points.npy --charges bad.npy --kernel inverse-distance";
    refused(&folder, flags, &["bad.npy", "[1]", "NaN"]);
    folder.write("bad.csv", "1\n1\nNaN\n1\n");
    let flags = "--points points.npy --charges bad.csv --kernel inverse-distance";
    refused(&folder, flags, &["bad.csv", "line 3, column 1", "NaN"]);
}

#[test]
fn files_that_do_not_fit_or_exist_are_refused() {
    let folder = Folder::new(4);
    let kernel = "--kernel inverse-distance";
    write_npy(folder.path("three.npy"), &Array1::from(vec![1.0; 3])).unwrap();
    let flags = format!("--points points.npy --charges three.npy {kernel}");
    refused(&folder, &flags, &["three.npy", "3 charges", "expected 4", "points.npy"]);
    let flags = format!("--points points.npy --charges points.npy {kernel}");
    refused(&folder, &flags, &["points.npy", "[4, 3]", "[N]"]);
    let flags = format!("--points missing.npy --charges charges.npy {kernel}");
    refused(&folder, &flags, &["missing.npy", "No such file"]);
    let output = folder.sum(&format!("{OWN} {kernel} --out values.txt"));
    assert!(fail(&output).contains("values.txt"), "{output:?}");
    let output = folder.sum(&format!("{OWN} {kernel} --out nowhere/values.npy"));
    assert!(fail(&output).contains("nowhere/values.npy"), "{output:?}");
    let output = folder.sum(&format!("{OWN} {kernel} --report nowhere/report.json"));
    assert!(fail(&output).contains("nowhere/report.json"), "{output:?}");
    let output = folder.sum(&format!("{OWN} {kernel} --out u.csv --report ./u.csv"));
    assert!(fail(&output).contains("--out and --report: expected two files"), "{output:?}");
    fs::create_dir(folder.path("taken.npy")).unwrap();
    let output = folder.sum(&format!("{OWN} {kernel} --out taken.npy"));
    assert!(fail(&output).contains("taken.npy"), "{output:?}");
    assert_eq!(folder.names(), ["charges.npy", "points.npy", "taken.npy", "three.npy"]);
}

#[test]
fn flags_out_of_range_are_refused() {
    let folder = Folder::new(4);
    for (flags, expected) in [
        ("--order 4 --tolerance 1e-3", &["--order", "--tolerance"][..]),
        ("--tolerance 0", &["'0'", "between 0 and 1"]),
        ("--tolerance NaN", &["'NaN'", "between 0 and 1"]),
        ("--tolerance 2", &["'2'", "between 0 and 1"]),
        ("--leaf-size 0", &["'0'", "--leaf-size", "at least 1"]),
        ("--threads 0", &["'0'", "--threads", "from 1 to 512"]),
        ("--threads 1000000", &["'1000000'", "--threads", "from 1 to 512"]),
        ("--repeat 0", &["'0'", "--repeat", "at least 1"]),
        ("--order 100000", &["order 100000", "expected"]),
        ("--order -1", &["-1"]),
        ("--scheme fast", &["'fast'", "treecode"]),
        ("--precision f16", &["'f16'", "f32", "f64"]),
        ("--kernel gravity", &["\"gravity\"", "inverse-distance"]),
    ] {
        let kernel = if flags.contains("--kernel") { "" } else { "--kernel inverse-distance" };
        refused(&folder, &format!("{OWN} {kernel} {flags}"), expected);
    }
    refused(&folder, "--charges charges.npy --kernel inverse-distance", &["--points"]);
}

/// Insists that `sum` fails with a message that holds all of `expected`, and leaves no file behind.
fn refused(folder: &Folder, flags: &str, expected: &[&str]) {
    let before = folder.names();
    let output = folder.sum(&format!("{flags} --out values.npy --report report.json"));
    let message = fail(&output);
    for part in expected {
        assert!(message.contains(part), "{flags}: {part:?} is not in {message}");
    }
    assert_eq!(folder.names(), before, "{flags}");
}

fn header(descriptor: &str, shape: &str) -> String {
    format!("{{'descr': '{descriptor}', 'fortran_order': False, 'shape': {shape}}}")
}

/// An npy file with any header and `len` zero bytes of data.
fn npy(header: &str, len: usize) -> Vec<u8> {
    let length = (header.len() + 1) as u16;
    let start = [b"\x93NUMPY\x01\x00".as_slice(), &length.to_le_bytes()].concat();
    [&start, header.as_bytes(), b"\n", &vec![0; len]].concat()
}
