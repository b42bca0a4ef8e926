//! Light or radiant heat in a scene by a fast multipole sum with occlusion: solved, checked, pictured.
//!
//! B(x) = E(x) + ρ(x) H(x),   H(x) = Σ_y V(x, y) F(x, y) B(y)
//!
//! Every element x receives light from all elements y that it sees. Between cells of elements that see
//! each other the sum goes through an expansion; near elements exchange by their whole areas.

mod args;
mod assembly;
mod balance;
mod builder;
mod camera;
mod check;
mod city;
mod cornell_box;
mod description;
mod factors;
mod fields;
mod fit;
#[cfg(test)]
mod fuzz;
mod gather;
mod generators;
mod geometry;
mod hall;
mod interrupt;
mod lamps;
mod load;
mod mesh;
mod neighbours;
mod obj;
mod off;
mod orient;
mod output;
mod palette;
mod picture;
mod ply;
mod ply_mesh;
mod points;
mod polygon;
mod progress;
mod refine;
mod report;
mod rooms;
mod round;
mod scene;
mod scene_error;
mod sight;
mod simulation;
mod smooth;
mod solve;
mod soup;
mod stl;
mod surfaces;
mod table;
mod text;
mod tone;
mod triangulate;
mod vertices;
mod view;
mod viewpoint;
mod vtu;

use std::io::{self, Write};
use std::process::ExitCode;

use clap::Parser;

use crate::args::{Args, QuantityName};
use crate::interrupt::Interrupt;
use crate::output::{Output, OutputError};
use crate::report::Report;
use crate::scene::Scene;
use crate::scene_error::SceneError;

/// Why a run failed.
#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error("cannot start the threads: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    #[error("cannot listen to Ctrl-C: {0}")]
    Interrupt(#[from] ctrlc::Error),
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error("{found} bands were asked for: expected 1, or the {} of the scene", expected)]
    Bands { found: usize, expected: usize },
    #[error("fractional visibility needs `--scheme fmm` and `--expansion interpolation`")]
    Unweighed,
    #[error("nothing in the scene {0}: expected a lamp, a sky or a surface with a temperature")]
    Dark(&'static str),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error(transparent)]
    Radiosity(#[from] farfield_radiosity::Error),
    #[error(transparent)]
    Sum(#[from] farfield::Error),
    #[error(
        "the irradiance is off by {error:.1e} (relative l2, at {sampled} elements): expected at most \
         {tolerance:e}; nothing was written"
    )]
    Inaccurate { error: f64, sampled: usize, tolerance: f64 },
}

fn main() -> ExitCode {
    let args = Args::parse();
    match run(&args) {
        Ok(report) => {
            let files = report.files.join(", ");
            // A reader that has gone away doesn't make the run a failure.
            if !args.quiet {
                let folder = args.out.display();
                drop(writeln!(io::stdout(), "{report}\nwrote {files} to {folder}"));
            }
            ExitCode::SUCCESS
        }
        Err(failure) => {
            eprintln!("radiosity: {failure}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> Result<Report, Failure> {
    let interrupt = Interrupt::by_ctrl_c()?;
    let output = Output::new(&args.out)?;
    rayon::ThreadPoolBuilder::new().num_threads(args.threads).build_global()?;
    let scene = load::load(&args.scene)?;
    let bands = bands(args, &scene)?;
    // Bands of a scene go through the sum three at a time.
    if bands == 1 {
        simulation::run::<1>(args, &scene, bands, output, &interrupt)
    } else {
        simulation::run::<3>(args, &scene, bands, output, &interrupt)
    }
}

/// How many bands to solve for.
fn bands(args: &Args, scene: &Scene) -> Result<usize, Failure> {
    let expected = scene.bands();
    match (args.bands, args.quantity) {
        (Some(found), _) if found != 1 && found != expected => {
            Err(Failure::Bands { found, expected })
        }
        (Some(found), _) => Ok(found),
        (None, QuantityName::Heat) => Ok(1),
        (None, QuantityName::Light) => Ok(expected),
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::fs;
    use std::path::Path;
    use std::process::{Command, Output, Stdio};
    use std::time::Duration;

    /// Holds the arguments of the example where this program is started once more.
    const ARGUMENTS: &str = "RADIOSITY_ARGUMENTS";

    /// Runs the example, sends it SIGINT as soon as there is something at `path`, and waits for its end.
    fn interrupted(arguments: &str, path: &Path) -> Output {
        let test = ["--exact", "tests::ctrl_c_keeps_what_is_done", "--nocapture"];
        let mut child = Command::new(std::env::current_exe().expect("a path"))
            .args(test)
            .env(ARGUMENTS, arguments)
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
        if let Ok(arguments) = std::env::var(ARGUMENTS) {
            let args = Args::parse_from(arguments.split_whitespace());
            run(&args).expect("no failure");
            return;
        }
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
}
