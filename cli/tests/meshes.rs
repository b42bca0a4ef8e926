//! Meshes as people have them, with walls turned, doubled and shared, from their files to the tables.

use std::fs;
use std::process::Command;

use tempfile::TempDir;

const BINARY: &str = env!("CARGO_BIN_EXE_farfield");

/// Runs the program in a folder with these files, and returns its exit code and what it says on standard error.
fn run(files: &[(&str, String)], arguments: &str) -> (Option<i32>, String, TempDir) {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, text) in files {
        fs::write(folder.path().join(name), text).expect("written");
    }
    let output = Command::new(BINARY)
        .current_dir(folder.path())
        .args(arguments.split_whitespace())
        .output()
        .expect("the program runs");
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned(), folder)
}

/// Radiosities of all elements in the first band.
fn radiosities(folder: &TempDir) -> Vec<f64> {
    let table = fs::read_to_string(folder.path().join("out/elements.csv")).expect("written");
    let mut lines = table.lines().map(|line| line.split(','));
    let column = lines.next().expect("a header").position(|name| name == "B_0").expect("a column");
    lines.map(|mut line| line.nth(column).expect("whole").parse().expect("a number")).collect()
}

/// The inside of a unit cube.
const WALLS: [&str; 6] = ["1 2 3 4", "8 7 6 5", "1 5 6 2", "3 7 8 4", "2 6 7 3", "4 8 5 1"];

/// A mesh of these faces of the cube, in one material.
fn cube(faces: &[&str]) -> String {
    let vertices = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n";
    let faces: String = faces.iter().map(|face| format!("f {face}\n")).collect();
    format!("mtllib room.mtl\n{vertices}usemtl wall\n{faces}")
}

fn material(reflectance: f64, emission: f64) -> String {
    format!("newmtl wall\nKd {reflectance:?}\nKe {emission:?}\n")
}

const SOLVE: &str = "radiosity --scene room.obj --out out --elements 150 --bands 1 --no-picture";

#[test]
fn a_watertight_room_is_as_bright_as_its_balance_says_however_white_it_is() {
    for reflectance in [0.5, 0.999, 1.0 - 1e-7] {
        let files =
            [("room.obj", cube(&WALLS)), ("room.mtl", material(reflectance, 1.0 - reflectance))];
        let (code, message, folder) = run(&files, SOLVE);
        assert_eq!((code, message.as_str()), (Some(0), ""), "{reflectance}");
        for found in radiosities(&folder) {
            assert!((found - 1.0).abs() < 1e-3, "{reflectance}: {found}");
        }
    }
    // Where a wall is missing, light gets lost.
    let files = [("room.obj", cube(&WALLS[1..])), ("room.mtl", material(0.999, 1e-3))];
    let (code, message, folder) = run(&files, SOLVE);
    assert_eq!(code, Some(0), "{message}");
    assert!(radiosities(&folder).iter().all(|&found| found < 0.01));
}

#[test]
fn a_room_with_a_wall_turned_round_is_lit_inside() {
    let mut walls = WALLS;
    walls[2] = "2 6 5 1";
    let files = [("room.obj", cube(&walls)), ("room.mtl", material(0.5, 1.0))];
    let (code, message, folder) = run(&files, SOLVE);
    assert_eq!((code, message.as_str()), (Some(0), ""));
    assert!(radiosities(&folder).iter().all(|&found| (found - 2.0).abs() < 1e-3));
}

#[test]
fn a_room_that_looks_outwards_is_warned_of() {
    let reversed = |face: &&str| face.split(' ').rev().collect::<Vec<_>>().join(" ");
    let walls: Vec<String> = WALLS.iter().map(reversed).collect();
    let walls: Vec<&str> = walls.iter().map(String::as_str).collect();
    let files = [("room.obj", cube(&walls)), ("room.mtl", material(0.5, 1.0))];
    let (code, message, folder) = run(&files, SOLVE);
    assert!(code == Some(0) && message.contains("a room has to look inwards"), "{message}");
    assert!(radiosities(&folder).iter().all(|&found| found == 1.0));
    // Below the sky, a body may well be alone.
    let (code, message, _) = run(&files, &format!("{SOLVE} --sky 1 --zenith 0,0,1"));
    assert!(code == Some(0) && message.is_empty(), "{message}");
}

#[test]
fn surfaces_upon_each_other_are_warned_of() {
    let quad = |z: f64, x: f64, is_up: bool, name: &str| {
        let mut corners = [[x, 0.0, z], [x + 1.0, 0.0, z], [x + 1.0, 1.0, z], [x, 1.0, z]];
        if !is_up {
            corners.reverse();
        }
        format!("[[quad]]\ncorners = {corners:?}\nmaterial = \"{name}\"\n")
    };
    let pair = [quad(0.0, 0.0, true, "floor"), quad(1.0, 0.0, false, "ceiling")].concat();
    let materials = "[materials.floor]\nreflectance = [0.0]\nemission = [1.0]\n\
        [materials.ceiling]\nreflectance = [0.0]\n[materials.paint]\nreflectance = [0.0]\n";
    let solve = "radiosity --scene room.toml --out out --elements 200 --no-picture";
    let factors = "factors --scene room.toml --out factors.csv";
    let over = "surfaces lie upon each other and look the same way, so that their light counts twice: one pair";
    for (more, expected) in [
        (String::new(), None),
        // The same once more is dropped, and said.
        (quad(1.0, 0.0, false, "ceiling"), None),
        (quad(1.0, 0.3, false, "ceiling"), Some("quad 2 of room.toml")),
        (quad(1.0, 0.0, false, "paint"), Some("quad 3 of room.toml, of material `paint`")),
    ] {
        let files = [("room.toml", format!("{pair}{more}{materials}"))];
        for arguments in [solve, factors] {
            let (code, message, folder) = run(&files, arguments);
            assert_eq!(code, Some(0), "{message}");
            match expected {
                None => assert!(!message.contains("warning"), "{message}"),
                Some(place) => {
                    assert!(message.contains(over) && message.contains(place), "{message}");
                }
            }
            if arguments == solve && expected.is_none() {
                let report = fs::read_to_string(folder.path().join("out/report.json"));
                let said = report.expect("written").contains("duplicate quads, dropped: 1");
                assert_eq!(said, !more.is_empty());
            }
        }
        let (code, message, _folder) = run(&files, &format!("{solve} --strict"));
        assert_eq!(code, Some(i32::from(expected.is_some())), "{message}");
    }
}

#[test]
fn form_factors_take_no_name_of_another_file() {
    let files = [("room.obj", cube(&WALLS)), ("room.mtl", material(0.5, 1.0))];
    let (_, _, folder) = run(&files, SOLVE);
    let before = fs::read(folder.path().join("out/elements.csv")).expect("written");
    let taken = format!("{SOLVE} --form-factors out/../out/elements.csv");
    let output = Command::new(BINARY)
        .current_dir(folder.path())
        .args(taken.split_whitespace())
        .output()
        .expect("the program runs");
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("expected a name that no other file of the run has"), "{message}");
    assert_eq!(fs::read(folder.path().join("out/elements.csv")).expect("there"), before);
}
