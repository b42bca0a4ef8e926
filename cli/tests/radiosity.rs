//! `farfield radiosity` as its users meet it: Ctrl-C, messages, exit codes.

#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

const BINARY: &str = env!("CARGO_BIN_EXE_farfield");

/// Runs the program, sends it SIGINT as soon as there is something at `path`, and waits for its end.
fn interrupted(arguments: &str, path: &Path) -> Output {
    let mut child = Command::new(BINARY)
        .args(arguments.split_whitespace())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("started");
    let something = || fs::metadata(path).is_ok_and(|found| found.is_dir() || found.len() > 0);
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
    let output = interrupted(&format!("{common} --elements 200000"), &out);
    assert_eq!(output.status.code(), Some(130), "{output:?}");
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(message.contains("radiosity: interrupted: nothing more is written"), "{message}");
    assert_eq!(fs::read_dir(&out).expect("made").count(), 0);

    let factors = format!("{common} --elements 4000 --form-factors {}", table.display());
    let output = interrupted(&factors, &table);
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
