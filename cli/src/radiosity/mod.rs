//! `farfield radiosity`: light or radiant heat in a scene by a fast multipole sum with occlusion: solved,
//! checked, pictured.
//!
//! B(x) = E(x) + ρ(x) H(x),   H(x) = Σ_y V(x, y) F(x, y) B(y)
//!
//! Every element x receives light from all elements y that it sees. Between cells of elements that see
//! each other the sum goes through an expansion; near elements exchange by their whole areas.

mod args;
mod balance;
mod check;
mod closing;
mod daylight;
mod delivery;
mod exr;
mod factors;
mod failure;
mod figures;
#[cfg(test)]
mod fixture;
mod gather;
mod negative;
mod npy;
mod report;
mod report_page;
mod series;
mod simulation;
mod solve;
mod steps;
mod warning;

pub(crate) use args::Args;

use std::io::{self, Write};
use std::process::ExitCode;

use farfield_scenes::{Output, Scene, load};

use self::args::QuantityName;
use self::failure::Failure;
use self::report::Report;
use crate::interrupt::Interrupt;

/// Does what the command line asks for.
pub(crate) fn main(args: &Args) -> ExitCode {
    match run(args) {
        Ok(report) => {
            for warning in &report.warnings {
                drop(writeln!(io::stderr(), "farfield radiosity: warning: {warning}"));
            }
            let files = report.files.join(", ");
            // A reader that has gone away doesn't make the run a failure.
            if !args.quiet {
                let folder = args.out.display();
                drop(writeln!(io::stdout(), "{report}\nwrote {files} to {folder}"));
            }
            ExitCode::SUCCESS
        }
        Err(failure) => {
            eprintln!("farfield radiosity: {failure}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> Result<Report, Failure> {
    let interrupt = Interrupt::by_ctrl_c("radiosity")?;
    let output = Output::new(&args.out)?;
    rayon::ThreadPoolBuilder::new().num_threads(args.threads).build_global()?;
    let scene = load(&args.scene)?.cut_where_surfaces_meet();
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
