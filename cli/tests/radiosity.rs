//! `farfield radiosity` as its users meet it: Ctrl-C, messages, exit codes.

#![cfg(unix)]

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

const BINARY: &str = env!("CARGO_BIN_EXE_farfield");

/// Runs the program, sends it SIGINT as soon as there is something at the path that `path` makes of its
/// process number, and waits for its end.
fn interrupted(arguments: &str, path: impl Fn(u32) -> PathBuf) -> Output {
    let mut child = Command::new(BINARY)
        .args(arguments.split_whitespace())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("started");
    let path = path(child.id());
    let something = || fs::metadata(&path).is_ok_and(|found| found.is_dir() || found.len() > 0);
    while child.try_wait().expect("known").is_none() && !something() {
        std::thread::sleep(Duration::from_millis(2));
    }
    let signal = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(signal.expect("there is `kill`").success(), "{:?}", child.wait_with_output());
    child.wait_with_output().expect("ended")
}

#[test]
fn ctrl_c_keeps_what_is_done() {
    let folder = tempfile::tempdir().expect("a folder");
    let (out, table) = (folder.path().join("out"), folder.path().join("table.csv"));
    let common = format!("radiosity --quiet --out {}", out.display());

    // The folder is there before anything is planned, which takes its time.
    let output = interrupted(&format!("{common} --elements 200000"), |_| out.clone());
    assert_eq!(output.status.code(), Some(130), "{output:?}");
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(message.contains("radiosity: interrupted: nothing more is written"), "{message}");
    assert_eq!(fs::read_dir(&out).expect("made").count(), 0);

    // The table has a name of its own until it is whole.
    let partial = |child: u32| folder.path().join(format!(".table.csv.{child}.partial"));
    let factors = format!("{common} --elements 4000 --form-factors {}", table.display());
    let output = interrupted(&factors, partial);
    assert!(output.status.success(), "{output:?}");
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(message.contains("interrupted: what is done will be written"), "{message}");
    let report = fs::read_to_string(out.join("report.json")).expect("written");
    assert!(report.contains("\"interrupted\": true"), "{report}");
    let table = fs::read_to_string(table).expect("written");
    let rows = table.lines().filter(|line| line.contains(",sky,")).count();
    assert!((512..3500).contains(&rows) && table.ends_with('\n'), "{rows} rows");
}

#[test]
fn ctrl_c_while_smaller_elements_are_planned_keeps_the_solution_on_larger_ones() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let mut child = Command::new(BINARY)
        .args(["radiosity", "--tolerance", "0.002", "--no-picture", "--out"])
        .arg(&out)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("started");
    let mut lines = BufReader::new(child.stderr.take().expect("piped"));
    let mut again = String::new();
    while !again.contains("once more with smaller ones") {
        again.clear();
        assert!(lines.read_line(&mut again).expect("text") > 0, "it ended");
    }
    let signal = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(signal.expect("there is `kill`").success());
    let mut rest = String::new();
    lines.read_to_string(&mut rest).expect("text");
    assert!(child.wait().expect("ended").success(), "{rest}");
    assert!(rest.contains("interrupted: what is done will be written"), "{rest}");
    let report = report(&out);
    assert_eq!(report["interrupted"], true);
    let elements = again.split(' ').find_map(|word| word.parse::<u64>().ok());
    assert_eq!(report["elements"].as_u64(), elements, "{again}");
    assert!(report["residual"].as_f64().is_some_and(|residual| residual < 0.002));
    assert!(out.join("elements.csv").exists() && !out.join("radiosity.png").exists());
}

/// The report in a folder.
fn report(out: &Path) -> serde_json::Value {
    let text = fs::read_to_string(out.join("report.json")).expect("written");
    serde_json::from_str(&text).expect("JSON")
}

/// Runs the program on a scene of some files, the first of which is the scene, and returns its exit code,
/// what it says on standard error, and the folder, below which `out` is for its output.
fn run_on(files: &[(&str, &str)], arguments: &str) -> (Option<i32>, String, tempfile::TempDir) {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, text) in files {
        fs::write(folder.path().join(name), text).expect("written");
    }
    let output = Command::new(BINARY)
        .current_dir(folder.path())
        .args(["radiosity", "--out", "out", "--scene", files[0].0])
        .args(arguments.split_whitespace())
        .output()
        .expect("the program runs");
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned(), folder)
}

/// The kinds of the warnings in a report.
fn kinds(report: &serde_json::Value) -> Vec<&str> {
    let warnings = report["warnings"].as_array().expect("a list");
    warnings.iter().map(|warning| warning["kind"].as_str().expect("a kind")).collect()
}

/// Two unit squares that face each other.
const PAIR: &str = "OFF\n8 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n1 0 1\n1 1 1\n0 1 1\n\
    4 0 1 2 3\n4 7 6 5 4\n";

/// The inside of a unit cube in six quads as a description of one material, `material`, followed by more.
fn cube(material: &str, more: &str) -> String {
    let quads = [
        "[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]",
        "[0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1]",
        "[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]",
        "[0, 1, 0], [1, 1, 0], [1, 1, 1], [0, 1, 1]",
        "[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]",
        "[1, 0, 0], [1, 0, 1], [1, 1, 1], [1, 1, 0]",
    ]
    .map(|corners| format!("[[quad]]\ncorners = [{corners}]\nmaterial = \"w\"\n"));
    format!("closed = true\n{}{more}\n[materials.w]\n{material}\n", quads.concat())
}

#[test]
fn where_nothing_emits_there_are_form_factors_and_no_solution() {
    let scene = [("pair.off", PAIR)];
    for (arguments, expected) in [
        ("", "nothing in the scene emits light: expected a material with an emission"),
        ("--quantity heat", "nothing in the scene has a temperature: expected `temperature`"),
        ("--strict --form-factors f.csv", "emits light: expected a material with an emission"),
    ] {
        let (code, message, folder) = run_on(&scene, arguments);
        assert_eq!(code, Some(1), "{message}");
        assert!(message.contains(expected), "{message}");
        assert_eq!(fs::read_dir(folder.path().join("out")).expect("made").count(), 0);
        assert!(!folder.path().join("f.csv").exists());
    }
    for visibility in ["exact", "fractional"] {
        let arguments = format!("--elements 200 --form-factors f.csv --visibility {visibility}");
        let (code, message, folder) = run_on(&scene, &arguments);
        assert_eq!(code, Some(0), "{message}");
        assert!(message.starts_with("farfield radiosity: warning: nothing in the scene emits"));
        let report = report(&folder.path().join("out"));
        assert_eq!(kinds(&report), ["nothing-emits"]);
        for unknown in ["residual", "energy_residual", "element_error", "relative_l2_error"] {
            assert!(report[unknown].is_null(), "{unknown}: {}", report[unknown]);
        }
        assert!(report["factor_l2_error"].as_f64().is_some_and(|error| error < 0.01), "{report}");
        let table = fs::read_to_string(folder.path().join("f.csv")).expect("written");
        let of_row = |row: &str, column: &str| -> f64 {
            let lines = table.lines().filter(|line| line.starts_with(&format!("{row},")));
            let cells =
                lines.filter(|line| (line.split(',').nth(1) == Some("sky")) == (column == "sky"));
            cells
                .map(|line| {
                    line.split(',').nth(2).expect("three").parse::<f64>().expect("a number")
                })
                .sum()
        };
        // The mean of the rows of the lower square is the form factor of two unit squares.
        let sky: f64 = (0..100).map(|row| of_row(&row.to_string(), "sky")).sum::<f64>() / 100.0;
        assert!((1.0 - sky - 0.1998248957).abs() < 1e-3, "{sky}");
        assert!((of_row("0", "others") + of_row("0", "sky") - 1.0).abs() < 1e-5);
        assert!(!folder.path().join("out/radiosity.png").exists(), "there is nothing to be seen");
    }
}

#[test]
fn heat_without_all_temperatures_and_files_that_are_missing_are_warned_of() {
    let two = cube("reflectance = [0.5]\ntemperature = 300", "").replacen("\"w\"", "\"cold\"", 1)
        + "[materials.cold]\nreflectance = [0.5]\n";
    let quick = "--elements 200 --no-picture";
    let (code, message, folder) = run_on(&[("a.toml", &two)], &format!("--quantity heat {quick}"));
    assert_eq!(code, Some(0), "{message}");
    assert_eq!(kinds(&report(&folder.path().join("out"))), ["no-temperature"]);
    assert!(message.contains("without a temperature, taken for 0 K: `cold`"), "{message}");

    let mesh = "mtllib a.mtl b.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl lamp\nf 1 2 3\nusemtl x #1\n\
        f 1 3 2\n";
    let files = [("a.obj", mesh), ("a.mtl", "newmtl lamp\nKe 1 1 1\nKd 1 1 1\n")];
    let (code, message, folder) = run_on(&files, quick);
    assert_eq!(code, Some(0), "{message}");
    let report = report(&folder.path().join("out"));
    assert_eq!(kinds(&report), ["missing", "missing"]);
    assert!(message.contains("material file `b.mtl` not found"), "{message}");
    assert!(message.contains("material `x #1` not found"), "{message}");
    let white = "material `lamp` reflects everything, taken for 0.999";
    assert_eq!(report["repairs"], serde_json::json!([white]));
    let (code, _, folder) = run_on(&files, &format!("{quick} --strict"));
    assert_eq!(code, Some(1));
    assert_eq!(fs::read_dir(folder.path().join("out")).expect("made").count(), 0);
}

#[test]
fn walls_around_a_fine_mesh_are_cut_and_the_ceiling_is_lit() {
    // A ball in a cube that is lit by its floor alone.
    let mut ball = String::new();
    let (rings, sectors) = (16, 32);
    let mut faces = Vec::new();
    for i in 0..=rings {
        for j in 0..sectors {
            let (polar, around) = (
                std::f64::consts::PI * f64::from(i) / f64::from(rings),
                std::f64::consts::TAU * f64::from(j) / f64::from(sectors),
            );
            let (sin, cos) = polar.sin_cos();
            let place = [sin * around.cos(), sin * around.sin(), cos].map(|x| 0.5 + 0.1 * x);
            ball += &format!("{} {} {}\n", place[0], place[1], place[2]);
            let (next, below) = ((j + 1) % sectors, (i + 1) * sectors);
            if i < rings {
                faces.push(format!("3 {} {} {}", i * sectors + j, below + j, below + next));
                faces.push(format!(
                    "3 {} {} {}",
                    i * sectors + j,
                    below + next,
                    i * sectors + next
                ));
            }
        }
    }
    let ball =
        format!("OFF\n{} {} 0\n{ball}{}\n", (rings + 1) * sectors, faces.len(), faces.join("\n"));
    let more = "[[mesh]]\nfile = \"ball.off\"\nmaterial = \"w\"\n[materials.lamp]\nreflectance = [0.0]\n\
        emission = [1.0]";
    let room = cube("reflectance = [0.5]", more).replacen("\"w\"", "\"lamp\"", 1);
    let ceiling = |elements: usize| {
        let arguments = format!("--elements {elements} --no-picture");
        let (code, message, folder) =
            run_on(&[("room.toml", &room), ("ball.off", &ball)], &arguments);
        assert_eq!(code, Some(0), "{message}");
        let report = report(&folder.path().join("out"));
        let table = fs::read_to_string(folder.path().join("out/elements.csv")).expect("written");
        let (mut sum, mut area) = (0.0, 0.0);
        for line in table.lines().skip(1) {
            let cells: Vec<f64> =
                line.split(',').map(|cell| cell.parse().expect("a number")).collect();
            if cells[2] > 0.999 {
                sum += cells[6] * cells[11];
                area += cells[6];
            }
        }
        assert!((area - 1.0f64).abs() < 1e-9);
        (sum / area, report)
    };
    let (few, report) = ceiling(400);
    assert_eq!(kinds(&report), ["few-elements"]);
    let message = report["warnings"][0]["message"].as_str().expect("a sentence");
    let enough = message.split(": ").nth(1).and_then(|rest| rest.split(' ').next());
    let enough: usize = enough.expect("a number").parse().expect("a number");
    assert!(message.starts_with("400 elements are too few for the scene"), "{message}");
    let (more, report) = ceiling(enough);
    assert!(kinds(&report).is_empty() && report["elements"].as_u64() <= Some(enough as u64));
    assert!(more > 0.2 && (few / more - 1.0).abs() < 0.05, "{few} {more}");
}

#[test]
fn uncut_triangles_are_cut_to_the_tolerance_and_a_missed_one_is_said() {
    // A tent: two large triangles of a floor under one small lamp each, as a mesh of nothing but triangles.
    let mut mesh = "mtllib a.mtl\nusemtl w\n".to_owned();
    let n = 12;
    let mut grid =
        |corner: [f64; 3], u: [f64; 3], v: [f64; 3], material: &str, n: usize, first: usize| {
            for k in 0..(n + 1) * (n + 1) {
                let (i, j) = ((k % (n + 1)) as f64 / n as f64, (k / (n + 1)) as f64 / n as f64);
                let p: Vec<f64> = (0..3).map(|c| corner[c] + i * u[c] + j * v[c]).collect();
                mesh += &format!("v {} {} {}\n", p[0], p[1], p[2]);
            }
            mesh += &format!("usemtl {material}\n");
            for (i, j) in (0..n * n).map(|k| (k % n, k / n)) {
                let at = |i: usize, j: usize| first + j * (n + 1) + i;
                mesh += &format!("f {} {} {}\n", at(i, j), at(i + 1, j), at(i + 1, j + 1));
                mesh += &format!("f {} {} {}\n", at(i, j), at(i + 1, j + 1), at(i, j + 1));
            }
            first + (n + 1) * (n + 1)
        };
    let first = grid([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], "w", n, 1);
    grid([0.3, 0.3, 0.5], [0.0, 0.4, 0.0], [0.4, 0.0, 0.0], "lamp", n, first);
    let colours = "newmtl w\nKd .5\nnewmtl lamp\nKd 0\nKe 1\n";
    let files = [("a.obj", &mesh[..]), ("a.mtl", colours)];
    let (code, message, folder) = run_on(&files, "--tolerance 0.02 --no-picture");
    assert_eq!(code, Some(0), "{message}");
    let fine = report(&folder.path().join("out"));
    assert!(message.contains("once more with smaller ones"), "{message}");
    assert!(kinds(&fine).is_empty() && fine["elements"].as_u64() > Some(1000), "{fine}");
    let error = fine["element_error"].as_f64().expect("known");
    assert!(error > 0.005 && error <= 0.02, "{error}");

    let (code, message, folder) = run_on(&files, "--tolerance 0.001 --elements 700 --no-picture");
    assert_eq!(code, Some(0), "{message}");
    let coarse = report(&folder.path().join("out"));
    assert_eq!(kinds(&coarse), ["missed-tolerance"]);
    assert!(message.contains("the tolerance of 1e-3 is missed: constants on "), "{message}");
    assert!(coarse["elements"].as_u64().is_some_and(|count| count <= 700), "{coarse}");
    assert!(coarse["element_error"].as_f64().is_some_and(|error| error > 0.02), "{coarse}");
    let (code, message, _) =
        run_on(&files, "--tolerance 0.001 --elements 700 --no-picture --strict");
    assert!(code == Some(1) && message.contains("nothing was written (--strict)"), "{message}");
}

#[test]
fn a_room_that_light_leaves_is_told_by_place_and_taken_to_be_open() {
    let room = cube("reflectance = [0.5]\nemission = [1.0]", "");
    let open = room.replacen(
        "[[quad]]\ncorners = [[0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1]]\nmaterial = \"w\"\n",
        "",
        1,
    );
    assert_ne!(open, room);
    let files = [("open.toml", &open[..])];
    let (code, message, folder) = run_on(&files, "--elements 300 --no-picture");
    assert_eq!(code, Some(0), "{message}");
    let report = report(&folder.path().join("out"));
    assert_eq!(kinds(&report), ["leak"]);
    // A wall sees 0.2 of the missing one, as does the floor: form factors of a cube.
    let sky = report["to_sky"].as_f64().expect("known");
    assert!((sky - 0.2).abs() < 0.01, "{sky}");
    assert!(
        message.contains(" % of the light leaves a scene that is said to be closed"),
        "{message}"
    );
    assert!(message.contains(" of open.toml, of material `w`, around ("), "{message}");
    let (code, message, _) = run_on(&files, "--elements 300 --no-picture --strict");
    assert!(code == Some(1) && message.contains("nothing was written (--strict)"), "{message}");
}

#[test]
fn the_relative_error_of_no_light_is_unknown() {
    // A lamp that nothing is in front of.
    let lamp = "[[quad]]\ncorners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]\nmaterial = \"w\"\n\
        [materials.w]\nreflectance = [0.5]\nemission = [1.0]\n";
    let (code, message, folder) = run_on(&[("a.toml", lamp)], "--elements 100 --no-picture");
    assert_eq!(code, Some(0), "{message}");
    let report = report(&folder.path().join("out"));
    assert!(report["relative_l2_error"].is_null() && report["element_error"].is_null(), "{report}");
    assert!(report["residual"].as_f64().is_some() && kinds(&report).is_empty());
}

#[test]
fn pictures_are_as_large_as_asked_for_or_left_out() {
    let room = cube(
        "reflectance = [0.5]\nemission = [1.0]",
        "[camera]\neye = [0.5, 0.1, 0.5]\n\
        target = [0.5, 0.9, 0.5]\nup = [0, 0, 1]",
    );
    let (code, message, folder) = run_on(&[("a.toml", &room)], "--elements 200 --size 48x20");
    assert_eq!(code, Some(0), "{message}");
    let png = fs::read(folder.path().join("out/radiosity.png")).expect("written");
    let edge = |at: usize| u32::from_be_bytes([png[at], png[at + 1], png[at + 2], png[at + 3]]);
    assert_eq!([edge(16), edge(20)], [48, 20]);
    let (code, message, folder) = run_on(&[("a.toml", &room)], "--elements 200 --no-picture");
    assert_eq!(code, Some(0), "{message}");
    let mut names: Vec<_> = fs::read_dir(folder.path().join("out"))
        .expect("made")
        .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
        .collect();
    names.sort_unstable();
    let expected = [
        "elements.csv",
        "elements.glb",
        "elements.npy",
        "elements.ply",
        "elements.vtu",
        "report.html",
        "report.json",
    ];
    assert_eq!(names, expected);
}

#[test]
fn a_scene_that_cannot_be_read_and_a_bad_flag_are_told_apart() {
    let run = |arguments: &[&str]| {
        let output = Command::new(BINARY).arg("radiosity").args(arguments).output();
        output.expect("the program runs")
    };
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out").to_string_lossy().into_owned();
    let output = run(&["--scene", "corneli", "--out", &out]);
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.starts_with("farfield radiosity: `corneli`: expected one of"), "{message}");
    let output = run(&["--elements", "5"]);
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.starts_with("error: invalid value '5' for '--elements"), "{message}");
    assert!(run(&["--help"]).status.success());
}
