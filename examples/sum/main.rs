//! Sums over points from files: the library for those who do not write Rust, and the driver by which
//! it is compared with others.
//!
//! ```sh
//! cargo run --release --example sum -- --points points.npy --charges charges.npy \
//!     --kernel inverse-distance --tolerance 1e-6 --gradient --out values.npy
//! ```
//!
//! `--help` explains every flag.

mod args;
mod read;
mod report;
mod run;
mod write;

use std::process::ExitCode;

use clap::Parser;
use clap::error::ErrorKind;

use args::Args;

fn main() -> ExitCode {
    let args = match Args::try_parse() {
        Ok(args) => args,
        Err(error) if error.kind() == ErrorKind::DisplayHelp => {
            print!("{error}");
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            eprintln!("{}", args::one_line(&error));
            return ExitCode::from(2);
        }
    };
    match run::run(&args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
