//! `farfield sum`: sums over points from files, for those who do not write Rust.

mod args;
#[cfg(test)]
mod damaged;
mod error;
mod read;
mod report;
mod run;
mod text;
mod write;

pub(crate) use args::{Args, one_line};

use std::process::ExitCode;

/// Does what the command line asks for.
pub(crate) fn main(args: &Args) -> ExitCode {
    match run::run(args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
