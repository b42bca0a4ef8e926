//! The Cornell box by a fast multipole sum with occlusion: solved, checked and rendered.
//!
//! B(x) = E(x) + ρ(x) H(x),   H(x) = Σ_y V(x, y) K(x, y) A_y B(y)
//!
//! Every surfel x receives light from all surfels y that it sees. The sum H goes through an expansion
//! where all pairs of two cells see each other, and pair by pair elsewhere.

mod args;
#[cfg_attr(not(test), allow(dead_code, reason = "not yet in use"))]
mod camera;
mod check;
mod cornell;
#[cfg_attr(not(test), allow(dead_code, reason = "not yet in use"))]
mod fields;
#[cfg_attr(not(test), allow(dead_code, reason = "not yet in use"))]
mod fit;
mod gather;
#[cfg_attr(not(test), allow(dead_code, reason = "not yet in use"))]
mod lamps;
#[expect(dead_code, reason = "not yet in use")]
mod mesh;
#[cfg_attr(not(test), allow(dead_code, reason = "not yet in use"))]
mod neighbours;
#[cfg_attr(not(test), allow(dead_code, reason = "not yet in use"))]
mod output;
#[cfg_attr(not(test), allow(dead_code, reason = "not yet in use"))]
mod palette;
#[cfg_attr(not(test), allow(dead_code, reason = "not yet in use"))]
mod ply;
mod progress;
mod render;
mod report;
#[expect(dead_code, reason = "not yet in use")]
mod scene;
mod shading;
#[cfg_attr(not(test), allow(dead_code, reason = "not yet in use"))]
mod sight;
#[cfg_attr(not(test), allow(dead_code, reason = "not yet in use"))]
mod smooth;
mod solve;
mod surfels;
#[cfg_attr(not(test), allow(dead_code, reason = "not yet in use"))]
mod table;
mod tone;
#[cfg_attr(not(test), allow(dead_code, reason = "not yet in use"))]
mod vertices;
#[cfg_attr(not(test), allow(dead_code, reason = "not yet in use"))]
mod view;
#[cfg_attr(not(test), allow(dead_code, reason = "not yet in use"))]
mod viewpoint;
#[cfg_attr(not(test), allow(dead_code, reason = "not yet in use"))]
mod vtu;

use std::f64::consts::FRAC_1_PI;
use std::io::{self, Write};
use std::process::ExitCode;
use std::time::Instant;

use clap::Parser;
use farfield_radiosity::{Occluders, Visibility};

use crate::args::{Args, SolverName};
use crate::camera::Camera;
use crate::check::Check;
use crate::cornell::{EYE, FILM_OVER_FOCAL, FORWARD, Scene, UP};
use crate::gather::Gather;
use crate::output::{Output, OutputError};
use crate::render::View;
use crate::report::{Pairs, Report, peak_memory_bytes};
use crate::shading::{Rgb, Shading};
use crate::surfels::{Surfels, triangles};
use crate::tone::ToneMap;

/// Surfels at which the gathered light is held against direct summation.
const SAMPLES: usize = 500;
/// Rows and columns of the picture.
const PICTURE_SIZE: usize = 512;

/// Why a run failed.
#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error("cannot start the threads: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error(transparent)]
    Radiosity(#[from] farfield_radiosity::Error),
    #[error(transparent)]
    Sum(#[from] farfield::Error),
    #[error(
        "the gathered light is off by {error:.1e} (relative l2, at {sampled} surfels): expected at \
         most {tolerance:e}; nothing was written"
    )]
    Inaccurate { error: f64, sampled: usize, tolerance: f64 },
}

fn main() -> ExitCode {
    let args = Args::parse();
    match run(&args) {
        Ok(report) => {
            let folder = args.out.display();
            let files = "cornell.png, surfels.ply, report.json";
            // A reader that has gone away doesn't make the run a failure.
            drop(writeln!(io::stdout(), "{report}\nwrote {files} to {folder}"));
            ExitCode::SUCCESS
        }
        Err(failure) => {
            eprintln!("radiosity: {failure}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> Result<Report, Failure> {
    let mut output = Output::new(&args.out)?;
    rayon::ThreadPoolBuilder::new().num_threads(args.threads).build_global()?;

    let scene = Scene::cornell_box();
    let surfels = Surfels::new(&scene, args.surfels);
    let walls = Occluders::new(&triangles(&scene))?;
    let nothing = Occluders::new(&[])?;
    let shadowing = if args.no_occlusion { &nothing } else { &walls };
    let visibility = Visibility::new(shadowing);

    let start = Instant::now();
    let bar = progress::bar("planning", progress::FINE);
    let gather = Gather::plan(&surfels.surfels, &visibility, args, &|done| {
        progress::show(&bar, done.fraction);
    })?;
    bar.finish_and_clear();
    let plan_s = start.elapsed().as_secs_f64();
    let pairs = Pairs::new(gather.stats(), &visibility.counts());

    let start = Instant::now();
    let solution = solve::solve(&surfels, &gather, &visibility, args)?;
    let solve_s = start.elapsed().as_secs_f64();
    let energy_residual = solve::energy_residual(&surfels, &gather, &solution)?;

    let spinner = progress::spinner("checking");
    let gathered = gather.apply(&solution.radiosity)?;
    let check = Check::new(&surfels.surfels, &visibility, &solution.radiosity, &gathered, SAMPLES);
    spinner.finish_and_clear();
    let accurate = check.relative_l2_error <= args.tolerance;
    if !accurate {
        let Check { relative_l2_error: error, sampled, .. } = check;
        return Err(Failure::Inaccurate { error, sampled, tolerance: args.tolerance });
    }

    let indirect = gather.apply(&without(&solution.radiosity, &surfels.emission))?;
    let shading = Shading::new(&surfels, &indirect);
    let view = View::new(&scene, &walls, shadowing, &shading);
    let camera = Camera::new(EYE, FORWARD, UP, FILM_OVER_FOCAL);
    let bar = progress::bar("rendering", PICTURE_SIZE as u64);
    let picture = view.render(&camera, PICTURE_SIZE, || bar.inc(1));
    bar.finish_and_clear();

    // Each iteration gathers once; Southwell's shots, pair by pair as they are, weigh as one.
    let sums = match args.solver {
        SolverName::Cg | SolverName::Jacobi => solution.iterations,
        SolverName::Southwell => 1,
    };
    let report = Report {
        scheme: args.scheme,
        expansion: args.expansion,
        solver: args.solver,
        occlusion: !args.no_occlusion,
        threads: rayon::current_num_threads(),
        tolerance: args.tolerance,
        surfels: surfels.surfels.len(),
        pairs,
        plan_s,
        solve_s,
        direct_s: check.visibility_s + sums as f64 * check.sum_s,
        iterations: solution.iterations,
        energy_residual,
        relative_l2_error: check.relative_l2_error,
        sampled_surfels: check.sampled,
        peak_memory_bytes: peak_memory_bytes(),
    };
    let tone = ToneMap::exposing(&picture);
    let codes: Vec<_> = picture.iter().map(|radiance| tone.code(radiance)).collect();
    output.png("cornell.png", PICTURE_SIZE, &codes)?;
    let colour = |b: &Rgb| tone.code(&b.map(|band| FRAC_1_PI * band));
    let colours: Vec<_> = solution.radiosity.iter().map(colour).collect();
    output.ply("surfels.ply", &surfels.surfels, &colours)?;
    output.json("report.json", &report)?;
    output.publish()?;
    Ok(report)
}

/// What surfels reflect of their radiosity: B − E.
fn without(radiosity: &[Rgb], emission: &[Rgb]) -> Vec<Rgb> {
    let pairs = radiosity.iter().zip(emission);
    pairs.map(|(b, e)| [0, 1, 2].map(|band| b[band] - e[band])).collect()
}
