//! Emissions that change with time, by `farfield radiosity --steps`.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn run(folder: &Path, arguments: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_farfield"));
    let common = "radiosity --quiet --no-picture --elements 400 --out out";
    let arguments = common.split_whitespace().chain(arguments.split_whitespace());
    command.current_dir(folder).args(arguments).output().expect("the program runs")
}

/// The numbers of a table's columns with these names, line by line.
fn columns(path: &Path, names: &[&str]) -> Vec<Vec<f64>> {
    let text = fs::read_to_string(path).expect("written");
    let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = lines.next().expect("a header");
    let place = |name: &&str| header.iter().position(|own| own == name).expect("a column");
    let places: Vec<usize> = names.iter().map(place).collect();
    let numbers =
        |line: Vec<&str>| places.iter().map(|&k| line[k].parse().expect("a number")).collect();
    lines.map(numbers).collect()
}

#[test]
fn one_run_has_all_times() {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("times.csv"), "time,lamp\non,1\nhalf,0.5\noff,0\n")
        .expect("written");
    let output = run(folder.path(), "--steps times.csv");
    assert!(output.status.success(), "{output:?}");
    let out = folder.path().join("out");

    let elements = columns(&out.join("elements.csv"), &["area", "B_1", "H_1"]);
    let steps = columns(&out.join("steps.csv"), &["area", "B_1", "H_1"]);
    let sums =
        |rows: &[Vec<f64>]| [1, 2].map(|k| rows.iter().map(|row| row[0] * row[k]).sum::<f64>());
    let whole = sums(&elements);
    let materials = steps.len() / 3;
    for (step, factor) in steps.chunks_exact(materials).zip([1.0, 0.5, 0.0]) {
        for (found, whole) in sums(step).into_iter().zip(whole) {
            assert!((found - factor * whole).abs() <= 1e-3 * whole, "{found} {factor} {whole}");
        }
    }
}

#[test]
fn what_is_read_is_not_written_over() {
    let folder = tempfile::tempdir().expect("a folder");
    let times = "time,lamp\n0,1\n";
    fs::create_dir(folder.path().join("out")).expect("made");
    for path in ["out/steps.csv", "times.csv"] {
        fs::write(folder.path().join(path), times).expect("written");
    }
    for (arguments, flag) in [
        ("--steps out/steps.csv", "--steps out/steps.csv"),
        ("--steps times.csv --form-factors ./times.csv", "--form-factors ./times.csv"),
    ] {
        let output = run(folder.path(), arguments);
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{message}");
        let expected = format!("{flag}: expected a name that no other file of the run has");
        assert!(message.contains(&expected), "{message}");
    }
    for path in ["out/steps.csv", "times.csv"] {
        assert_eq!(fs::read_to_string(folder.path().join(path)).expect("there"), times);
    }
}
